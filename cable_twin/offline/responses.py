"""Control metrics of drives: response to each step of the commanded speed, and effort over a whole run.

A command that holds for `HELD` s or more after a change is a step; one that is in force at the begin of the record, or
that begins where its speed is reached already, is none. For the speed v from v_0 then to the command v_c:

    rise time        from 10 to 90 % of v_c - v_0
    settling time    until v stays within 2 % of v_c - v_0 around v_c
    overshoot        largest v beyond v_c, over |v_c - v_0|
    steady error     mean of v - v_c over the last tenth of the step

and for a whole run: the tracking error v minus the ramped reference, its largest size and root of mean square; the
effort, the drive force as root of mean square, and the work of the drive as it drives and as it brakes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cable_twin.basics.units import rounded
from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures.shown import shown

HELD = 2.0  # s
SMALLEST, AT_REST = 1e-3, 0.05  # m/s, smallest step, and speed that counts as 0
BAND, LOW, HIGH, LAST = 0.02, 0.1, 0.9, 0.1  # shares: settling, rise (two), and time for the steady error
MOST = 50_000  # stored frames of a step; of a longer one each second, fourth, ... is stored
SHOWN = 12  # steps in a table


@dataclass(frozen=True, slots=True)
class StepResponse:
    """Response of one drive to one step of the commanded speed; None for times not reached."""

    name: str
    time: float  # s, of the step
    before: float  # m/s
    command: float  # m/s
    rise: float | None  # s
    settling: float | None  # s
    overshoot: float  # -
    steady_error: float  # m/s


@dataclass(slots=True)
class Effort:
    """Tracking error and control effort of one drive over a run."""

    name: str
    frames: int = 0
    largest_error: float = 0.0  # m/s, of the tracking
    squared_error: float = 0.0
    squared_force: float = 0.0
    driving: float = 0.0  # J
    braking: float = 0.0  # J, energy taken in while braking

    @property
    def rms_error(self) -> float:
        """Root of the mean square of the tracking error (m/s)."""
        return math.sqrt(self.squared_error / max(self.frames, 1))

    @property
    def rms_force(self) -> float:
        """Root of the mean square of the drive force (N)."""
        return math.sqrt(self.squared_force / max(self.frames, 1))


@dataclass(slots=True)
class _Step:
    """Step of the commanded speed of a drive, with the recorded speeds since then."""

    start: float  # s
    before: float  # m/s
    command: float  # m/s
    stride: int = 1
    frames: int = 0
    times: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)

    def take(self, time: float, speed: float) -> None:
        if self.frames % self.stride == 0:
            self.times.append(time - self.start)
            self.speeds.append(speed)
            if len(self.times) > MOST:
                self.times, self.speeds, self.stride = self.times[::2], self.speeds[::2], 2 * self.stride
        self.frames += 1


class Responses:
    """Collector of step responses and efforts from the frames of a run.

    Attributes:
        steps: responses of finished steps.
        efforts: tracking error and control effort of each drive, by name.
    """

    def __init__(self) -> None:
        self.steps: list[StepResponse] = []
        self.efforts: dict[str, Effort] = {}
        self._under_way: dict[str, _Step] = {}
        self._last_time = math.nan
        self._last_speeds: dict[str, float] = {}

    def take(self, snapshot: Snapshot) -> None:
        """Add a frame to step responses and efforts; frames without commands in the log are skipped."""
        layout, c = snapshot.layout, snapshot.columns
        commanded, reference = (SIGNALS[name].values(layout, c) for name in ("commanded_speed", "reference_speed"))
        if not layout.commanded or np.isnan(reference).all():
            return
        own = slice(None, len(layout.carriages))
        speeds = layout.of_commanded(c.speed[own], c.drive_speed)
        forces = layout.of_commanded(c.drive_force[own], c.moving_cable_force)
        elapsed = snapshot.time - self._last_time
        powers = layout.of_commanded(c.drive_power[own], c.moving_cable_force * c.drive_speed)
        numbers = (one.tolist() for one in (commanded, reference, speeds, forces, powers))
        for name, command, follows, speed, force, power in zip(layout.commanded, *numbers, strict=True):
            self._take_effort(name, speed - follows, force, power, elapsed)
            self._take_step(name, snapshot.time, command, speed)
            self._last_speeds[name] = speed
        self._last_time = snapshot.time

    def finish(self) -> list[StepResponse]:
        """Step responses of all drives in the order of time, also of steps cut short by the end of the run."""
        for name in list(self._under_way):
            self._end(name)
        return sorted(self.steps, key=lambda step: step.time)

    def rows(self) -> dict[str, list[dict[str, Any]]]:
        """Step responses and efforts of drives for JSON, in SI units."""
        means = ("rms_error", "rms_force")
        shown = ("name", "largest_error", "driving", "braking")
        return {
            "step_responses": [asdict(step) for step in self.finish()],
            "efforts": [{key: getattr(one, key) for key in (*shown, *means)} for one in self.efforts.values()],
        }

    def _take_effort(self, name: str, error: float, force: float, power: float, elapsed: float) -> None:
        effort = self.efforts.setdefault(name, Effort(name))
        effort.frames += 1
        effort.largest_error = max(effort.largest_error, abs(error))
        effort.squared_error += error * error
        effort.squared_force += force * force
        work = power * elapsed if elapsed > 0.0 else 0.0
        effort.driving, effort.braking = effort.driving + max(work, 0.0), effort.braking + max(-work, 0.0)

    def _take_step(self, name: str, time: float, command: float, speed: float) -> None:
        step = self._under_way.get(name)
        if step is None or step.command != command:  # also for NaN: no speed is commanded
            self._end(name)
            begun = time if math.isnan(self._last_time) else self._last_time  # a command comes after a frame
            before = self._last_speeds.get(name, command)  # one in force at the first frame is no step
            reached = abs(command - before) <= (BAND * abs(command) or AT_REST)
            if reached and (step is None or math.isnan(step.command)):
                before = command  # as it goes already
            self._under_way[name] = step = _Step(begun, before, command)
        step.take(time, speed)

    def _end(self, name: str) -> None:
        step = self._under_way.pop(name, None)
        if step is None or not step.times[-1] >= HELD or not abs(step.command - step.before) > SMALLEST:
            return
        self.steps.append(_response(name, step))


def _response(name: str, step: _Step) -> StepResponse:
    """Evaluate the response of a drive to one step of the commanded speed, from its samples."""
    times, speeds = np.array(step.times), np.array(step.speeds)
    share = (speeds - step.before) / (step.command - step.before)
    begun, risen = share >= LOW, share >= HIGH
    rise = float(times[risen.argmax()] - times[begun.argmax()]) if risen.any() else None
    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    after = int(outside[-1]) + 1 if outside.size else 0
    settling = float(times[after]) if after < times.size else None
    last = times >= (1.0 - LAST) * times[-1]
    return StepResponse(
        name,
        step.start,
        step.before,
        step.command,
        rise,
        settling,
        max(float(share.max()) - 1.0, 0.0),
        float(np.mean(speeds[last]) - step.command),
    )


def print_responses(
    console: Console, steps: Sequence[StepResponse], efforts: Iterable[Effort], label: str = ""
) -> None:
    """Print step responses and control efforts of a run, each as a table; empty tables are left out."""
    which = f" of {label}" if label else ""
    if steps:
        titles = ("at\n[s]", "from\n[m/s]", "to\n[m/s]", "rise\ntime [s]", "settling\ntime [s]")
        table = _table(
            f"response to steps of the commanded speed{which}", (*titles, "over-\nshoot [%]", "steady\nerror [m/s]")
        )
        for step in steps[:SHOWN]:
            times = (("not reached", step.rise), ("not settled", step.settling))
            reached = [without if time is None else f"{time:.2f}" for without, time in times]
            numbers = f"{step.time:.2f}", shown(step.before, 1.0), shown(step.command, 1.0)
            table.add_row(step.name, *numbers, *reached, f"{100.0 * step.overshoot:.2f}", rounded(step.steady_error, 2))
        console.print(table)
        if len(steps) > SHOWN:
            console.print(f"  {len(steps) - SHOWN} more steps; --json contains all")
    if moved := [effort for effort in efforts if effort.driving or effort.braking]:
        columns = ("force,\nrms [kN]", "driving\nwork [kJ]", "braking\nwork [kJ]")
        errors = "tracking error,\nrms [m/s]", "tracking error,\nlargest [m/s]"
        table = _table(f"control effort and tracking error{which}", (*columns, *errors))
        for effort in moved:
            sizes = effort.rms_force / 1e3, effort.driving / 1e3, effort.braking / 1e3
            table.add_row(effort.name, *map(rounded, (*sizes, effort.rms_error, effort.largest_error)))
        console.print(table)


def _table(title: str, columns: Sequence[str]) -> Table:
    """Empty table for step responses or control efforts, whose first column is the drive."""
    table = Table("drive", box=box.SIMPLE_HEAD, pad_edge=False, title=title, title_justify="left", title_style="bold")
    for column in columns:
        table.add_column(escape(column), justify="right")
    return table


__all__ = ["Effort", "Responses", "StepResponse", "print_responses"]
