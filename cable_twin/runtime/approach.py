"""Point-to-point motion: a trapezoidal speed profile within the limits of a drive, and a stop there, without rclpy.

The way is that of the ramp which the drive follows, so that an elastic haul rope is not rocked by a loop over it. How
far the vehicle is from there, the stretch of that rope, is filtered and added: so it has arrived where the drive rests
and the place around which the vehicle may still swing, for minutes on a long rope, is the one it was to go to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from cable_twin.scenario import Scenario, places_of

TOLERANCE = 0.1  # m from the place, where it counts as there
RESTING = 0.05  # m/s of the drive, below which it counts as at rest
SETTLED = 2.0  # s of simulated time within both
SHARE = 0.7  # of acceleration and deceleration that is asked for: the drive follows without being at its limits
LANDING = 0.5  # s, time constant of the last decimetres
STRETCHING, STIFF = 3.0, 1.0  # s, of the filter: with a haul rope, which bounces within a few seconds, and without
STALLED = 60.0  # s of simulated time without coming nearer
PERIOD = 0.05  # s of simulated time from one speed to the next
STATIONS = ("start", "end", "lower_station", "upper_station")


class Approach:
    """Speed profile that brings a carriage, or the cable of a drive, to a place.

    Args:
        scenario: that runs.
        name: of the carriage or drive.
        target: arc length (m) of the place, or cable gone by (m) of a drive.
        at_most: m/s on the way; None: what its drive has as its limit.

    Raises:
        ValueError: there is no limit of speed, and none is given; one line.
    """

    def __init__(self, scenario: Scenario, name: str, target: float, at_most: float | None) -> None:
        drive = scenario.drives.get(name)
        limits = drive.limits if drive is not None else scenario.carriages[name].drive.limits
        fastest = at_most or limits.speed
        if not fastest:
            raise ValueError(f"the drive of '{name}' has no speed limit: give the highest speed of the trip, in m/s")
        self.name, self.target, self.fastest = name, target, fastest
        slowing = limits.acceleration if limits.deceleration is None else limits.deceleration
        self._gaining = SHARE * limits.acceleration
        self._slowing = SHARE * min(limits.acceleration, slowing)
        self._landing = LANDING + (0.0 if limits.jerk is None else self._slowing / limits.jerk)
        elastic = drive is None and scenario.carriages[name].drive.haul_rope is not None
        self._filter_time = STRETCHING if elastic else STIFF
        self._last = (math.nan, 0.0)  # s and m/s of the newest speed
        self._filters = (math.nan, math.nan)  # m, place beside the way
        self._filtered = math.nan  # s
        self._near_since: float | None = None
        self._mean = (0.0, 0)  # m, place since then, and of how many it is the mean
        self._nearest, self._side = (math.inf, math.nan), 0.0  # m, and when; on the side of the sign of that

    def speed(self, time: float, place: float, way: float, speed: float) -> float | None:
        """Speed (m/s) due now; None after arrival.

        Args:
            time: s, simulated.
            place: m, of the vehicle or cable.
            way: m, of the ramp that the drive follows.
            speed: m/s, of that ramp.
        """
        if math.isnan(self._last[0]):
            self._last = time, speed
        left = self.target - way - self._filter(time, place - way)
        if abs(left) > TOLERANCE or abs(speed) > RESTING:
            self._near_since, self._mean = None, (0.0, 0)
        else:
            mean, count = self._mean
            self._mean = mean + (place - mean) / (count + 1), count + 1
            self._near_since = time if self._near_since is None else self._near_since
            if time - self._near_since >= SETTLED and abs(self.target - self._mean[0]) <= TOLERANCE:
                return None
        slowing, landing = self._slowing, self._landing
        size = min(self.fastest, slowing * (math.sqrt(landing**2 + 2.0 * abs(left) / slowing) - landing))
        gained = self._gaining * max(time - self._last[0], PERIOD)
        self._last = time, math.copysign(min(size, abs(self._last[1]) + gained), left)
        return self._last[1]

    def go_on_from(self, before: Approach) -> None:
        """Take over the speed and the swing filter of an approach to another place."""
        self._last, self._filters, self._filtered = before._last, before._filters, before._filtered

    def stalled(self, time: float, place: float) -> str:
        """Message about an approach without progress, empty during progress."""
        left = self.target - place
        distance, passed = abs(left), left * self._side < 0.0
        if passed or distance < self._nearest[0] - 1e-3 or distance <= TOLERANCE:
            self._nearest, self._side = (distance, time), left
        if time - self._nearest[1] <= STALLED:
            return ""
        return (
            f"'{self.name}' has come no nearer than {self._nearest[0]:.2f} m to {self.target:.2f} m "
            f"for {STALLED:g} s of simulated time: it may be held, or its drive too weak"
        )

    def _filter(self, time: float, beside: float) -> float:
        """Offset (m) of the place from the ramp, after two first-order filters that suppress vehicle swing."""
        if math.isnan(self._filtered):
            self._filters, self._filtered = (beside, beside), time
        share = 1.0 - math.exp(-max(time - self._filtered, 0.0) / self._filter_time)
        first = self._filters[0] + share * (beside - self._filters[0])
        self._filters, self._filtered = (first, self._filters[1] + share * (first - self._filters[1])), time
        return self._filters[1]


def target_of(scenario: Scenario, name: str, place: str, towers: Mapping[str, float] | None = None) -> float:
    """Arc length (m) of a place for a carriage, or cable gone by (m) of a drive.

    Args:
        scenario: that runs.
        name: of the carriage or drive.
        place: a number of metres, a tower, or one of `STATIONS`, before whose end stop a carriage stops; of a drive,
            the ends of its travel.
        towers: arc length (m) of the cable at each tower.

    Raises:
        ValueError: it cannot go there; one line.
    """
    try:
        metres = float(place)
    except ValueError:
        metres = math.nan
    low, high = places_of(scenario, name)
    if name in scenario.drives:
        metres = {"start": low, "end": high}.get(place, metres)
        if math.isfinite(metres) and low <= metres <= high:
            return metres
        way = f"{low:g} to {high:g} m of cable travel, or start, end" if math.isfinite(low) else "cable travel, in m"
        raise ValueError(f"{place!r} given for '{name}', which moves the cable; allowed: {way}")
    rope = scenario.carriages[name].rope
    cable = scenario.cable if rope is None else scenario.ropes[rope]
    ends = {"start": low, "end": high}
    downwards = cable.start.position[-1] > cable.end.position[-1]
    ends["lower_station"], ends["upper_station"] = sorted(ends.values(), reverse=downwards)
    target = {**(towers or {}), **ends}.get(place, metres)
    if not low <= target <= high:
        raise ValueError(
            f"{place!r} given for '{name}'; allowed: {low:.6g} to {high:.6g} m along the cable, or "
            f"{', '.join((*STATIONS, *scenario.towers))}"
        )
    return target


__all__ = ["PERIOD", "STATIONS", "TOLERANCE", "Approach", "target_of"]
