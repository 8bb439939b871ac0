"""Status line of the twin for its terminal, read from the newest frame without access to the solver's thread."""

from __future__ import annotations

import math
import os
import sys
import time
from collections import deque
from collections.abc import Sequence

from rich.text import Text

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.frame.plotted_signals import driven, driven_names
from cable_twin.messages import APPLIED_COMMANDS, JOINT_STATES, NAMESPACE, SCENARIO, TopicNames
from cable_twin.recording.run import Run
from cable_twin.ros.diagnostics import Diagnostics
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.output import Output
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import typed

SPAN = 1.5  # s over which the real-time factor is taken
SHOWN = 2  # of what is driven, so that the line stays one
SLIPPED = 0.005  # m, from which on slip is shown
SOME, LATE = 1e-3, 0.1  # s, from which on lateness is shown, and marked


class Status:
    """Status line: simulated time and pace, driven vehicles, tension, recording.

    Args:
        simulation: what runs.
        loop: that runs it.
        output: where it goes.
        diagnostics: which count commands and watch the log.
        names: full names of the node's topics.
    """

    def __init__(
        self, simulation: Simulation, loop: FrameLoop, output: Output, diagnostics: Diagnostics, names: TopicNames
    ) -> None:
        self._simulation, self._loop, self._output, self._diagnostics = simulation, loop, output, diagnostics
        self._times: deque[tuple[float, float]] = deque()  # of the clock and simulated, in the last `SPAN`
        self._highest_tensions = _highest_tensions(simulation.scenario, output)
        self.hint = drive_hint(simulation.scenario, names)

    def text(self, width: int) -> Text:
        """Status line of a maximum width in characters, most important parts first; parts without room are left out."""
        simulated = self._loop.simulated_time
        parts = [(f"{simulated:.1f} s", ""), self._pace(simulated)]
        if self._simulation.emergency_stopped:
            parts.append(("EMERGENCY STOP", "bold red"))
        told = len(parts)
        parts += [*self._driven(), *self._slipping(), self._tension(), self._recording()]
        if not self._diagnostics.counts["commands_applied"]:
            hint = (f"from another terminal: {self.hint}", "cyan")
            wide = len(_joined([*parts, hint])) <= width
            parts.insert(len(parts) if wide else told, hint)  # what nobody has found out yet comes before how it is
        named = _joined([(self._simulation.scenario.name, "bold"), *parts])
        return named if len(named) <= width else _joined(parts, width)  # the log above has the name, too

    def _pace(self, simulated: float) -> tuple[str, str]:
        """Real-time factor and lateness, or that simulated time is paused or failed."""
        now = time.monotonic()
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
        """Speed, and of carriages the place, of the first driven vehicles or drives."""
        snapshot = self._simulation.snapshot
        names, state = driven_names(snapshot.layout), driven(snapshot.layout, snapshot.columns)
        place = "" if snapshot.layout.drives else " at {:.1f} m"
        parts = [
            (f"{name}{place.format(state.place[row])} {round(state.speed[row], 2) + 0.0:+.2f} m/s", "")
            for row, name in enumerate(names[:SHOWN])
        ]
        return parts + ([(f"and {len(names) - SHOWN} more", "dim")] if len(names) > SHOWN else [])

    def _slipping(self) -> list[tuple[str, str]]:
        """Bullwheels with rope slip, and its distance (m)."""
        snapshot = self._simulation.snapshot
        slips = dict(zip(snapshot.layout.sheaves, snapshot.columns.sheave_slip.tolist(), strict=True))
        return [(f"{name} slip {slip:+.2f} m", "red") for name, slip in slips.items() if abs(slip) > SLIPPED]

    def _tension(self) -> tuple[str, str]:
        """Highest tension; of several ropes, that of the rope nearest to the limit of its safety factor."""
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
    """Styled texts in a row, each shown whole or left out, as half a number would mislead."""
    line = Text()
    for text, style in parts:
        part = Text("  " if line else "").append(text, style)
        if not line or len(line) + len(part) <= width:
            line.append_text(part)
    return line


SEEN = "from at most two minutes before it is opened; the recording contains everything"


def live_hint(run: Run) -> str:
    """Hint to open the live view of a run, after a semicolon; empty for a run that is only recorded."""
    if run.web is not None:
        return f"; live view, for a browser: {run.web.link} ({SEEN})"
    if not run.live_url:
        return ""
    shown = "" if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") else "; no display here: --rerun web"
    return f"; live view ({SEEN}): {typed('rerun')} --bind 127.0.0.1 --connect {run.live_url}{shown}"


def _highest_tensions(scenario: Scenario, output: Output) -> dict[str, float]:
    """Tension (N) at the limit of each rope's safety factor, where a rope has one."""
    ropes = {f"{name}: rope": (name, rope) for name, rope in scenario.ropes.items()}
    found = {}
    for figure, (name, rope) in (ropes or {"rope": ("tension", scenario.cable)}).items():
        factor = output.figures.limit(f"{figure} safety factor")
        if factor is not None and rope.breaking_force is not None:
            found[name] = rope.breaking_force / factor
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
