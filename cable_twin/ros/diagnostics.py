"""What the twin says of itself once a second: /diagnostics and key figures."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from cable_twin.messages import DIAGNOSTICS, KEY_FIGURES, Status, diagnostics_message
from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.ros.output import Output
from cable_twin.ros.pace_watch import PaceWatch
from cable_twin.ros.recording_watch import RecordingWatch
from cable_twin.ros.run_clock import RunClock
from cable_twin.simulation import Simulation


class Diagnostics:
    """Gathers and sends them.

    Args:
        node: whose name they have.
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
        """Send them, and say in the log what is new."""
        node, loop = self._node, self._loop
        statistics = loop.take_statistics().summary()
        total = {f"total_{key}": value for key, value in loop.total_lateness.summary().items()}
        values: dict[str, str] = {key: f"{value:.9g}" for key, value in {**statistics, **total}.items()}
        values["simulated_time_s"] = f"{loop.simulated_time:.3f}"
        values |= {key: str(count) for key, count in self.counts.items()}
        values["paused"] = str(loop.paused).lower()
        values["emergency_stop"] = str(self._simulation.emergency_stopped).lower()
        self.recording.look()
        values.update(self.recording.values)
        values.update(self.pace.look())
        level, message = self._judge(statistics)
        stamp_ns = self._clock.stamp_ns(loop.simulated_time)
        statuses = self._output.figures.statuses()
        for line in self._output.figures.take_news():
            node.get_logger().warning(line)
        summary = self._output.figures.summary(f"{node.get_name()}: key figures")
        own = Status(level, node.get_name(), message, values, node.get_fully_qualified_name())
        messages = [
            (KEY_FIGURES, diagnostics_message(stamp_ns, *statuses)),
            (DIAGNOSTICS, diagnostics_message(stamp_ns, own, summary)),
        ]
        self._output.send(messages, stamp_ns)

    def _judge(self, statistics: Mapping[str, float]) -> tuple[int, str]:
        """Level and message."""
        if self._loop.fault:
            return 2, self._loop.fault
        if (judged := self.recording.judge()) is not None:
            return judged
        if self._simulation.emergency_stopped:
            return 1, "emergency stop in force"
        if self._loop.paused:
            return 0, "paused"
        if statistics["missed_frames"] > 0:
            return 1, f"{statistics['missed_frames']:.0f} frames late, up to {statistics['lateness_max_ms']:.1f} ms"
        return 0, "running"
