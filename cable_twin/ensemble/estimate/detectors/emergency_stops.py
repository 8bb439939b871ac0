"""Detection of a plant's emergency stop by its encoders: a deceleration that no service stop has, and its beginning.

Until the deceleration a vehicle moves at a constant speed, for the span of a fit: the fit has a kink of the speed's
rate, at each moment that may be its beginning, and the best one counts. A carriage on an elastic haul rope is shaken
behind a tower as well, while its drive goes on: force and stiffness of the rope tell where the drive is, and in a stop
that leaves its constant speed before the carriage, and by more.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario, command_limits

SPAN, BEFORE = 2.0, 0.8  # s, of a fit, and of its part at constant speed, at least
SHORTEST = 0.25  # s, from which on a deceleration is known
FEWEST = 12  # samples of a fit
STEPS = 0.05  # s, from one beginning that is tried to the next
SHARE = 0.7  # of the way from a service stop to an emergency stop, from which on a deceleration is that of the latter
ROUGH, SMALL = 0.1, 5e-3  # of the lag behind the constant speed, and m, that a fit may be off
SLOWEST = 1.0  # m/s, below which a service stop is as good
LAG = 0.3  # s, by which a carriage on its haul rope begins to slow down later than its drive, as it seems to a fit
TOGETHER = 1.5  # s, within which several drives stop at once: as long as a stop takes to show, and what they differ by
DRIVEN = 0.5  # of what a carriage leaves a constant speed by, that its drive has to: 0.3 in a swing, 1.1 on in a stop
CONTRAST = 1.3  # times the service deceleration, above which an emergency stop is told from it


class Stop(NamedTuple):
    """Emergency stop of a plant, as an encoder shows it."""

    name: str  # of the carriage or drive
    time: float  # s, when it began
    speed: float  # m/s, before it, without sign
    lasts: float  # s, by the deceleration of the scenario


def decelerations(scenario: Scenario, name: str) -> tuple[float, float]:
    """Decelerations (m/s^2) of a service stop and of an emergency stop of a carriage or drive by name."""
    one = scenario.drives[name] if name in scenario.drives else scenario.carriages[name].drive
    return one.limits.service_deceleration, one.limits.emergency_deceleration


class DrivePlaces:
    """Places of the drive of a carriage on an elastic haul rope, by the stiffness of the rope and forces of the drive.

    Args:
        scenario: of the twin.
        name: of the carriage.
    """

    def __init__(self, scenario: Scenario, name: str) -> None:
        self._rope = scenario.haul_ropes[name]
        self._track = scenario.cables[scenario.rope_of(scenario.carriages[name])].unstrained_length
        self._forces: deque[tuple[float, float]] = deque()  # s and N, of the last `SPAN`

    def clear(self) -> None:
        """Forget all forces."""
        self._forces.clear()

    def pull(self, time: float, force: float) -> None:
        """Add the force (N) of the drive at a time (s)."""
        if self._forces and time <= self._forces[-1][0]:
            return
        self._forces.append((time, force))
        while time - self._forces[0][0] > SPAN:
            self._forces.popleft()

    def steady(self, times: FloatArray, places: FloatArray, begun: float) -> bool:
        """Whether the drive has kept a constant speed while its carriage, at places (m) at times (s), has not.

        False without a force since the carriage began to slow down, at `begun` (s).
        """
        if len(self._forces) < 2 or self._forces[-1][0] <= begun:
            return False
        known, forces = np.array(self._forces).T
        during = (times >= known[0]) & (times <= known[-1])
        times, places = times[during], places[during]
        free = self._rope.beyond_track + (self._track - places if self._rope.station == "end" else places)
        drive = places + np.interp(times, known, forces) * free / self._rope.axial_stiffness
        return len(times) >= FEWEST and _uneven(times, drive) < DRIVEN * _uneven(times, places)


class EmergencyStops:
    """Detector of emergency stops by the places that the encoders of a plant measure, and forces of haul ropes.

    Args:
        scenario: of the twin, whose drives have a service and an emergency deceleration. Of several drives all that
            move have to stop at once, as one may stop alone for another reason.
    """

    def __init__(self, scenario: Scenario) -> None:
        of_all = {name: decelerations(scenario, name) for name in command_limits(scenario)}
        self._decelerations = {name: one for name, one in of_all.items() if one[1] > CONTRAST * one[0]}
        self._drives = {name: DrivePlaces(scenario, name) for name in scenario.haul_ropes}
        self._lag = LAG if self._drives else 0.0
        self._places: Mapping[str, deque[tuple[float, float]]] = {name: deque() for name in self._decelerations}
        self._stopping: dict[str, Stop] = {}  # of each of several drives, lately

    def clear(self) -> None:
        """Forget all measured places and forces."""
        self._stopping.clear()
        for drive in self._drives.values():
            drive.clear()
        for kept in self._places.values():
            kept.clear()

    def pull(self, time: float, name: str, force: float) -> None:
        """Add the force (N) of the drive of a carriage at a time (s)."""
        if name in self._drives:
            self._drives[name].pull(time, force)

    def measure(self, time: float, name: str, place: float) -> Stop | None:
        """Add the place (m) of a carriage or drive at a time (s); returns an emergency stop that has begun lately."""
        kept = self._places.get(name)
        if kept is None or (kept and time <= kept[-1][0]):
            return None
        kept.append((time, place))
        while time - kept[0][0] > SPAN:
            kept.popleft()
        if len(kept) < FEWEST or time - kept[0][0] < BEFORE + SHORTEST:
            return None
        service, emergency = self._decelerations[name]
        times, places = np.array(kept).T
        begun, speed, slower, off = _kink(times - time, places)
        least = service + SHARE * (emergency - service)
        lag = 0.5 * slower * begun**2
        stuck = slower * -begun > abs(speed)  # a brake does not turn a vehicle round; places that stay seem to fit that
        if abs(speed) < SLOWEST or slower < least or stuck or off > max(SMALL, ROUGH * lag):
            return None
        if name in self._drives and self._drives[name].steady(times, places, time + begun):
            return None
        kept.clear()
        self._stopping[name] = Stop(name, float(time + begun) - self._lag, abs(speed), abs(speed) / emergency)
        return self._of_all(time)

    def _of_all(self, time: float) -> Stop | None:
        """Emergency stop that lasts longest, once each drive that has moved has one; None until then."""
        stopping = {name: one for name, one in self._stopping.items() if time - one.time < TOGETHER}
        if any(self._moves(name) for name in self._places.keys() - stopping.keys()):
            return None
        self._stopping.clear()
        return max(stopping.values(), key=lambda one: one.lasts)

    def _moves(self, name: str) -> bool:
        """Whether a carriage or drive has moved within the span of a fit."""
        kept = self._places[name]
        return len(kept) > 1 and abs(kept[-1][1] - kept[0][1]) > SLOWEST * (kept[-1][0] - kept[0][0])


def _kink(times: FloatArray, places: FloatArray) -> tuple[float, float, float, float]:
    """Best fit of places (m) by a constant speed and then a constant deceleration, at times (s) before the last one.

    Returns:
        Beginning of the deceleration (s), speed before it (m/s), deceleration (m/s^2), and deviation of the fit (m),
        which is infinite where a constant speed with a step is no worse: an encoder that has jumped.
    """
    best, stepped = (0.0, 0.0, 0.0, np.inf), np.inf
    for begun in np.arange(-SHORTEST, times[0] + BEFORE, -STEPS).tolist():
        found, off = _fitted(times, 0.5 * np.clip(times - begun, 0.0, None) ** 2, places)
        if off < best[-1]:
            best = begun, float(found[1]), float(-np.sign(found[1]) * found[2]), off
    for middle in 0.5 * (times[1:] + times[:-1]):
        stepped = min(stepped, _fitted(times, np.where(times > middle, 1.0, 0.0), places)[1])
    return best if best[-1] < stepped else (*best[:-1], np.inf)


def _uneven(times: FloatArray, places: FloatArray) -> float:
    """Deviation (m) of places (n,) from a constant speed."""
    return _fitted(times, np.zeros_like(times), places)[1]


def _fitted(times: FloatArray, shape: FloatArray, places: FloatArray) -> tuple[FloatArray, float]:
    """Place, speed and size of a shape, all (n,), by least squares of places (n,), and what they are off, root mean."""
    shapes = np.column_stack([np.ones_like(times), times, shape])
    found: FloatArray = np.asarray(np.linalg.lstsq(shapes, places, rcond=None)[0], np.float64)
    return found, float(np.sqrt(np.mean((shapes @ found - places) ** 2)))
