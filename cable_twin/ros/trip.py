"""Drive something to a place: a trapezoid of speed within the limits of its drive, and a stop there.

The way is reckoned from the commands that the twin has applied, at their simulated times, so that an elastic haul rope
is not rocked by a loop over it. How far the vehicle is from there, the stretch of that rope, is filtered and added.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any

from cable_twin.command_messages import applied_command_from_message
from cable_twin.commands import KINDS
from cable_twin.ros.command_line import Ending
from cable_twin.ros.repeated_drive import RATE, Driver
from cable_twin.scenario import Scenario, load_scenario

TOLERANCE = 0.1  # m from the place, where it counts as there
SETTLED = 2.0  # s of simulated time within that
SHARE = 0.7  # of acceleration and deceleration that is asked for: the drive follows without being at its limits
LANDING = 1.0  # s, time constant of the last decimetres
STRETCHING, STIFF = 8.0, 1.0  # s, of the filter: with a haul rope, which bounces within a few seconds, and without
STALLED = 30.0  # s of simulated time without coming nearer
STATIONS = ("start", "end", "lower_station", "upper_station")


class Trip(Driver):
    """Sends speeds until a carriage, or the cable of a drive, has come to a place.

    Args:
        node: of rclpy.
        options: `name`, `to` (m, or a station), `at_most` (m/s or None), `node`, `wait` (s), as the command has them.
        ending: whether to end.
    """

    def __init__(self, node: Any, options: argparse.Namespace, ending: Ending) -> None:
        super().__init__(node, KINDS["speed"], options.at_most or 0.0, options, ending)
        self._target = math.nan  # m
        self._way: float | None = None  # m, that the commands have asked for
        self._last = (0.0, 0.0)  # s and m/s of the newest applied command
        self._time = math.nan  # s, of the newest joint states
        self._filters: list[float] | None = None  # m, place beside the way
        self._filtered = math.nan  # s
        self._near_since: float | None = None
        self._nearest = (math.inf, math.nan)  # m, and when

    def find_twin(self) -> str | None:
        """As of any drive; then where the place is, and how fast one may go there."""
        fault = super().find_twin()
        if fault is not None or self._ending.is_set():
            return fault
        assert self._scenario is not None
        scenario, name = load_scenario(self._scenario), self._options.name
        drive = scenario.drives.get(name)
        limits = drive.limits if drive is not None else scenario.carriages[name].drive.limits
        if not self._value and limits.speed is None:
            return f"the drive of '{name}' has no limit of speed: give one with --at-most, in m/s"
        self._value = abs(self._value or limits.speed or 0.0)
        acceleration = limits.acceleration if limits.deceleration is None else limits.deceleration
        self._gaining = SHARE * limits.acceleration
        self._slowing = SHARE * min(limits.acceleration, acceleration)
        self._landing = LANDING + (0.0 if limits.jerk is None else self._slowing / limits.jerk)
        elastic = drive is None and scenario.carriages[name].drive.haul_rope is not None
        self._filter_time = STRETCHING if elastic else STIFF
        try:
            self._target = target_of(scenario, name, self._options.to)
        except ValueError as error:
            return str(error)
        return None

    def _next(self, elapsed: float) -> float | None:
        """Speed (m/s) that is due now; None when it has arrived."""
        place, speed, _ = self._states[self._options.name]
        if self._way is None:
            self._way, self._last = place, (self._time, 0.0)
        asked = self._way + self._last[1] * max(self._time - self._last[0], 0.0)
        left = self._target - asked - self._filter(place - asked)
        if abs(self._target - place) > TOLERANCE or abs(speed) > TOLERANCE:
            self._near_since = None
        elif self._near_since is None:
            self._near_since = self._time
        elif self._time - self._near_since >= SETTLED:
            return None
        slowing, landing = self._slowing, self._landing
        size = min(self._value, slowing * (math.sqrt(landing**2 + 2.0 * abs(left) / slowing) - landing))
        gained = self._gaining * max(self._time - self._last[0], 1.0 / RATE)
        return math.copysign(min(size, abs(self._last[1]) + gained), left)

    def _fault(self) -> str | None:
        distance = abs(self._target - self._states[self._options.name][0])
        if distance < self._nearest[0] - 1e-3 or math.isnan(self._nearest[1]) or distance <= TOLERANCE:
            self._nearest = distance, self._time
        if self._time - self._nearest[1] > STALLED:
            return (
                f"'{self._options.name}' has come no nearer than {self._nearest[0]:.2f} m to {self._target:.2f} m "
                f"for {STALLED:g} s of simulated time: is it held, or is there not enough force?"
            )
        return None

    def _note(self) -> str:
        return f", {self._target - self._states[self._options.name][0]:+.2f} m to go"

    def _tell_end(self, elapsed: float) -> None:
        place = self._states[self._options.name][0]
        away = f"{abs(self._target - place):.2f} m from {self._target:.2f} m"
        print(f"arrived: {self._options.name} at {place:.2f} m, {away}, after {elapsed:.1f} s", file=sys.stdout)

    def _filter(self, beside: float) -> float:
        """Place beside the way (m), through two filters of the first order: little of it swings with the vehicle."""
        if self._filters is None:
            self._filters, self._filtered = [beside, beside], self._time
        share = 1.0 - math.exp(-max(self._time - self._filtered, 0.0) / self._filter_time)
        self._filtered = self._time
        self._filters[0] += share * (beside - self._filters[0])
        self._filters[1] += share * (self._filters[0] - self._filters[1])
        return self._filters[1]

    def _on_states(self, message: Any) -> None:
        super()._on_states(message)
        self._time = _seconds(message.header.stamp)

    def _on_applied(self, data: bytes) -> None:
        super()._on_applied(data)
        applied = applied_command_from_message(data)
        if self._way is not None and applied.command.kind == "speed" and self._options.name in applied.command.values:
            self._way += self._last[1] * (applied.time - self._last[0])
            self._last = applied.time, applied.command.values[self._options.name]


def target_of(scenario: Scenario, name: str, place: str) -> float:
    """Arc length (m) of a place for a carriage, or cable gone by (m) of a drive.

    Args:
        scenario: that runs.
        name: of the carriage or drive.
        place: a number of metres, or one of `STATIONS`, before whose end stop a carriage stops.

    Raises:
        ValueError: it cannot go there; one line.
    """
    from cable_twin.scenario.build_vehicles import stop_stroke  # noqa: PLC0415 - numpy and the mechanics, half a second

    try:
        metres = float(place)
    except ValueError:
        metres = math.nan
    if name in scenario.drives:
        if math.isfinite(metres):
            return metres
        raise ValueError(f"--to {place!r} given for '{name}', which moves the cable; allowed: cable gone by, in m")
    length, stroke = scenario.cable.unstrained_length, stop_stroke(scenario, scenario.carriages[name])
    start, end = scenario.cable.start.position[-1], scenario.cable.end.position[-1]
    ends = {"start": stroke, "end": length - stroke}
    ends["lower_station"], ends["upper_station"] = sorted(ends.values(), reverse=start > end)
    target = ends.get(place, metres)
    if not stroke <= target <= length - stroke:
        raise ValueError(
            f"--to {place!r} given for '{name}'; allowed: {stroke:.6g} to {length - stroke:.6g} m along the cable, or "
            f"{', '.join(STATIONS)}"
        )
    return target


def _seconds(stamp: Any) -> float:
    """Simulated time (s) but for a constant, precise to some 0.1 microseconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


__all__ = ["STATIONS", "TOLERANCE", "Trip", "target_of"]
