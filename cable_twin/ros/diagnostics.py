"""Diagnostics of the twin: a status for each task on /diagnostics, key figures, and the status line of the terminal."""

from __future__ import annotations

import math
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from rclpy.node import Node
from rich.text import Text

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.frame.plotted_signals import driven, driven_names
from cable_twin.messages import (
    APPLIED_COMMANDS,
    DIAGNOSTICS,
    JOINT_STATES,
    KEY_FIGURES,
    NAMESPACE,
    SCENARIO,
    Status,
    TopicNames,
    diagnostics_message,
)
from cable_twin.messages.figure_messages import OK, WARNING
from cable_twin.recording.run import Run
from cable_twin.runtime.following import LiveFollowing
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.outlook import LiveOutlook
from cable_twin.runtime.output import Output
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.watches import PaceWatch, RecordingWatch
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import typed

ERROR = 2  # level of diagnostics
SOLVER = ("newton_iterations_per_step", "halved_steps", "constraint_residual_m")  # of the statistics of the loop
SPAN = 1.5  # s over which the real-time factor is averaged
SHOWN = 2  # driven vehicles or drives, so that the text stays one line
SLIPPED = 0.005  # m of rope slip from which on it is shown
SOME, LATE = 1e-3, 0.1  # s of lateness from which on it is shown, and marked
LIVE_SPAN = "from at most two minutes before it is opened; the recording contains everything"
TaskStatus = tuple[int, str, Mapping[str, str]]  # level, message in a line, and figures


class Diagnostics:
    """Collector and publisher of the diagnostics of a node.

    Args:
        node: node of the twin, whose full name is in the names of the tasks; their hardware is the scenario.
        simulation: running simulation.
        loop: frame loop.
        output: output of the node.
        clock: clock of the time stamps.
        real_time: whether simulated time is meant to run as fast as the clock.

    Attributes:
        counts: numbers of applied and refused commands, and of set and refused parameters.
        following: plant that the twin follows; None where it follows none.
        outlook: publisher of outlooks; None without any.
        recording: watch of the recorder.
        pace: watch of the pace.
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
        self.following: LiveFollowing | None = None
        self.outlook: LiveOutlook | None = None
        self._outlook_late = False  # as told in the log
        self.recording = RecordingWatch(node.get_logger())
        self.pace = PaceWatch(node.get_logger(), clock, loop, real_time=real_time)
        self._node, self._simulation, self._loop, self._output, self._clock = node, simulation, loop, output, clock

    def publish(self) -> None:
        """Publish the diagnostics of the node, and log new events."""
        statistics = self._loop.take_statistics().summary()
        self.recording.check()
        stamp_ns = self._clock.stamp_ns(self._loop.simulated_time)
        figures = self._output.figures.statuses()
        for line in self._output.figures.take_messages():
            self._node.get_logger().warning(line)
        tasks: dict[str, TaskStatus] = {
            "pace": self._pace({key: value for key, value in statistics.items() if key not in SOLVER}),
            "solver": self._solver({key: statistics[key] for key in SOLVER}),
            "commands": self._commands(),
            "recording": self.recording.status(),
            "limits": self._output.figures.status(),
        }
        if self.following is not None:
            well, text, values = self.following.status()
            tasks["following"] = OK if well else WARNING, text, values
        if self.outlook is not None:
            tasks["outlook"] = self._of_outlook(self.outlook)
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

    def _of_outlook(self, outlook: LiveOutlook) -> TaskStatus:
        """Status of the outlook; one that gets late is logged."""
        well, text, values = outlook.status()
        if not well and not self._outlook_late:
            self._node.get_logger().warning(f"outlook: {text}")
        self._outlook_late = not well
        return OK if well else WARNING, text, values

    def _pace(self, statistics: Mapping[str, float]) -> TaskStatus:
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

    def _solver(self, statistics: Mapping[str, float]) -> TaskStatus:
        """Status of the solver: whether steps converge."""
        fault, values = self._loop.fault, _texts(statistics)
        return (ERROR, fault, values) if fault else (OK, "all steps converged", values)

    def _commands(self) -> TaskStatus:
        """Status of the commands: accepted or under an emergency stop, with counts of applied and refused ones."""
        stopped = self._simulation.emergency_stopped
        values = {key: str(count) for key, count in self.counts.items()}
        values["emergency_stop"] = str(stopped).lower()
        values |= {f"goal_{name}": text for name, text in self._loop.goals.texts.items()}
        return (WARNING, "emergency stop in force", values) if stopped else (OK, "takes commands", values)


def _texts(figures: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.9g}" for key, value in figures.items()}


class StatusLine:
    """Status line for the terminal: simulated time and pace, driven vehicles, tension, recording.

    Args:
        simulation: running simulation, of which only the newest snapshot is read.
        loop: frame loop.
        output: output of the node.
        diagnostics: counts of commands, and watch of the recorder.
        names: full names of the node's topics.
        now: returns the time (s) of a steady clock.
    """

    def __init__(
        self,
        simulation: Simulation,
        loop: FrameLoop,
        output: Output,
        diagnostics: Diagnostics,
        names: TopicNames,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._simulation, self._loop, self._output, self._diagnostics = simulation, loop, output, diagnostics
        self._now = now
        self._times: deque[tuple[float, float]] = deque()  # clock (s) and simulated time (s) in the last `SPAN`
        self._highest_tensions = _highest_tensions(simulation.scenario, output)
        self.hint = drive_hint(simulation.scenario, names)

    def text(self, width: int) -> Text:
        """Status line of a maximum width in characters, most important parts first; parts without room are left out."""
        simulated = self._loop.simulated_time
        parts = [(f"{simulated:.1f} s", ""), self._pace(simulated)]
        if self._simulation.emergency_stopped:
            parts.append(("EMERGENCY STOP", "bold red"))
        first = len(parts)
        parts += [*self._driven(), *self._slipping(), self._tension(), self._recording()]
        if not self._diagnostics.counts["commands_applied"]:
            hint = (f"from another terminal: {self.hint}", "cyan")
            wide = len(_joined([*parts, hint])) <= width
            parts.insert(len(parts) if wide else first, hint)  # before the state where the line is short
        named = _joined([(self._simulation.scenario.name, "bold"), *parts])
        return named if len(named) <= width else _joined(parts, width)  # the log above has the name too

    def _pace(self, simulated: float) -> tuple[str, str]:
        """Text of real-time factor and lateness, or of a paused or failed simulation, with its style."""
        now = self._now()
        self._times.append((now, simulated))
        while now - self._times[0][0] > SPAN:
            self._times.popleft()
        if self._loop.fault or self._loop.paused:
            self._times.clear()
            return ("solver failed: reset it", "bold red") if self._loop.fault else ("paused", "bold yellow")
        elapsed = now - self._times[0][0]
        factor = (simulated - self._times[0][1]) / elapsed if elapsed > 0.0 else 0.0
        late = self._loop.behind
        lateness = f", {late:.1f} s late" if late >= 1.0 else f", {late * 1e3:.0f} ms late" if late >= SOME else ""
        return f"x{factor:.2f}{lateness}", "yellow" if late > LATE else "green"

    def _driven(self) -> list[tuple[str, str]]:
        """Texts with the speed, and for carriages the place, of the first driven vehicles or drives."""
        snapshot = self._simulation.snapshot
        names, state = driven_names(snapshot.layout), driven(snapshot.layout, snapshot.columns)
        place = "" if snapshot.layout.drives else " at {:.1f} m"
        parts = [
            (f"{name}{place.format(state.place[row])} {round(state.speed[row], 2) + 0.0:+.2f} m/s", "")
            for row, name in enumerate(names[:SHOWN])
        ]
        return parts + ([(f"and {len(names) - SHOWN} more", "dim")] if len(names) > SHOWN else [])

    def _slipping(self) -> list[tuple[str, str]]:
        """Texts about bullwheels on which the rope has slipped, with the distance (m)."""
        snapshot = self._simulation.snapshot
        slips = dict(zip(snapshot.layout.sheaves, snapshot.columns.sheave_slip.tolist(), strict=True))
        return [(f"{name} slip {slip:+.2f} m", "red") for name, slip in slips.items() if abs(slip) > SLIPPED]

    def _tension(self) -> tuple[str, str]:
        """Text of the highest tension; with several ropes, of the rope nearest to the limit of its safety factor."""
        snapshot = self._simulation.snapshot
        ropes = [*snapshot.layout.ropes] if self._simulation.scenario.ropes else ["tension"]
        highest = dict(zip(ropes, snapshot.columns.highest_tension[:, 0].tolist(), strict=True))
        limits = self._highest_tensions
        name = max(highest, key=lambda name: (highest[name] / limits.get(name, math.inf), highest[name]))
        unit, scale = shown_unit("N", highest[name])
        if name not in limits:
            return f"{name} {rounded(highest[name] * scale)} {unit}", ""
        text = f"{name} {rounded(highest[name] * scale)} {unit} (limit {rounded(limits[name] * scale)})"
        return text, "red" if highest[name] > limits[name] else ""

    def _recording(self) -> tuple[str, str]:
        problem = self._diagnostics.recording.problem()
        if problem is not None:
            return ("log fails", "bold red") if problem[0] == 2 else ("log falls behind", "yellow")
        return ("recording", "green") if self._output.run is not None else ("not recorded", "dim")


def _joined(parts: Sequence[tuple[str, str]], width: int = sys.maxsize) -> Text:
    """Join styled texts to a line of limited width; each is shown whole or left out, as half a number misleads."""
    line = Text()
    for text, style in parts:
        part = Text("  " if line else "").append(text, style)
        if not line or len(line) + len(part) <= width:
            line.append_text(part)
    return line


def live_hint(run: Run) -> str:
    """Hint to open the live view of a run, after a semicolon; empty for a run that is only recorded."""
    if run.web is not None:
        return f"; live view, for a browser: {run.web.link} ({LIVE_SPAN})"
    if not run.live_url:
        return ""
    shown = "" if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") else "; no display here: --rerun web"
    return f"; live view ({LIVE_SPAN}): {typed('rerun')} --bind 127.0.0.1 --connect {run.live_url}{shown}"


def _highest_tensions(scenario: Scenario, output: Output) -> dict[str, float]:
    """Tension (N) at the limit of each rope's safety factor, where a rope has one."""
    found = {}
    for name, rope in scenario.cables.items():
        factor = output.figures.limit("rope_safety_factor", f"ropes.{name}")
        if factor is not None and rope.breaking_force is not None:
            found[name if scenario.ropes else "tension"] = rope.breaking_force / factor
    return found


def drive_hint(scenario: Scenario, names: TopicNames) -> str:
    """Example of a drive command for another terminal, at about half the allowed speed."""
    limits = [(name, drive.limits) for name, drive in scenario.drives.items()]
    limits += [(name, carriage.drive.limits) for name, carriage in scenario.carriages.items()]
    if not limits:
        return f"{typed('drive')} --help"
    name, limit = limits[0][0], limits[0][1].speed
    node = names.namespace
    elsewhere = "" if node == NAMESPACE else f" --node {node}"
    used = [topic for topic in (JOINT_COMMANDS, JOINT_STATES, APPLIED_COMMANDS, SCENARIO) if topic in names.remapped]
    if used:
        elsewhere += " --ros-args" + "".join(f" -r {node}/{topic}:={names.full(topic)}" for topic in used)
    return f"{typed('drive')} {name} --speed {1.0 if limit is None else 0.5 * limit:.2g}{elsewhere}"
