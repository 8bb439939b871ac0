"""Diagnostics of the twin once a second: a status for each task on /diagnostics, and key figures."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from cable_twin.messages import DIAGNOSTICS, KEY_FIGURES, Status, diagnostics_message
from cable_twin.messages.figure_messages import OK, WARNING
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.output import Output
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.watches import PaceWatch, RecordingWatch
from cable_twin.simulation import Simulation

ERROR = 2  # level of diagnostics
SOLVER = ("newton_iterations_per_step", "halved_steps", "constraint_residual_m")  # of what the loop counts
Judged = tuple[int, str, Mapping[str, str]]  # level, a line for people, and figures


class Diagnostics:
    """Collector and publisher of the diagnostics of a node.

    Args:
        node: whose full name they have; their hardware is the scenario.
        simulation: what runs.
        loop: that runs it.
        output: where they go.
        clock: of their stamps.
        real_time: whether simulated time is to keep up with the clock.

    Attributes:
        counts: of commands and parameters that were taken and refused.
        recording: watches the recorder.
    """

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        loop: FrameLoop,
        output: Output,
        clock: RunClock,
        *,
        real_time: bool,
    ) -> None:
        self.counts = dict.fromkeys(("commands_applied", "commands_refused", "parameters_set", "parameters_refused"), 0)
        self.recording = RecordingWatch(node.get_logger())
        self.pace = PaceWatch(node.get_logger(), clock, loop, real_time=real_time)
        self._node, self._simulation, self._loop, self._output, self._clock = node, simulation, loop, output, clock

    def publish(self) -> None:
        """Publish the diagnostics, and log new events."""
        statistics = self._loop.take_statistics().summary()
        self.recording.check()
        stamp_ns = self._clock.stamp_ns(self._loop.simulated_time)
        figures = self._output.figures.statuses()
        for line in self._output.figures.take_messages():
            self._node.get_logger().warning(line)
        tasks: dict[str, Judged] = {
            "pace": self._pace({key: value for key, value in statistics.items() if key not in SOLVER}),
            "solver": self._solver({key: statistics[key] for key in SOLVER}),
            "commands": self._commands(),
            "recording": self.recording.status(),
            "limits": self._output.figures.status(),
        }
        node, scenario = self._node.get_fully_qualified_name().lstrip("/"), self._simulation.scenario.name
        statuses = [
            Status(level, f"{node}: {task}", message, values, scenario)
            for task, (level, message, values) in tasks.items()
        ]
        messages = [
            (KEY_FIGURES, diagnostics_message(stamp_ns, *figures)),
            (DIAGNOSTICS, diagnostics_message(stamp_ns, *statuses)),
        ]
        self._output.send(messages, stamp_ns)

    def _pace(self, statistics: Mapping[str, float]) -> Judged:
        """Status of the real-time pace: whether frames come on time."""
        loop = self._loop
        total = {f"total_{key}": value for key, value in loop.total_lateness.summary().items()}
        values = _texts({**statistics, **total})
        values |= {"simulated_time_s": f"{loop.simulated_time:.3f}", "paused": str(loop.paused).lower()}
        values |= self.pace.check()
        missed = statistics["missed_frames"]
        if missed and not loop.paused:
            return WARNING, f"{missed:.0f} frames late, up to {statistics['lateness_max_ms']:.1f} ms", values
        return OK, "paused" if loop.paused else "running", values

    def _solver(self, statistics: Mapping[str, float]) -> Judged:
        """Status of the solver: whether steps converge."""
        fault, values = self._loop.fault, _texts(statistics)
        return (ERROR, fault, values) if fault else (OK, "all steps converged", values)

    def _commands(self) -> Judged:
        """Status of the commands: accepted or under an emergency stop, with counts of applied and refused ones."""
        stopped = self._simulation.emergency_stopped
        values = {key: str(count) for key, count in self.counts.items()}
        values["emergency_stop"] = str(stopped).lower()
        values |= {f"goal_{name}": text for name, text in self._loop.goals.texts.items()}
        return (WARNING, "emergency stop in force", values) if stopped else (OK, "takes commands", values)


def _texts(figures: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.9g}" for key, value in figures.items()}
