"""Speed commands that keep the drives of a twin at the places measured by the encoders of its plant."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from cable_twin.ensemble.estimate.detectors.emergency_stops import Stop
from cable_twin.ensemble.estimate.detectors.jumps import Leaps
from cable_twin.scenario import Scenario, command_limits

FRESH = 0.6  # s, for which a command of the plant, or a measured place, holds
SELDOM = 3.0  # times the usual time between two places, for which one holds where that is longer
APART, NEAR = 0.3, 0.1  # m beyond the way of `TIMING`, from which a place is pursued, and up to which
TIMING = 0.1  # s, by which commands of a plant may be earlier or later in the twin
CLOSING = 4.0  # s, in which a distance is made up for
BELOW = 0.95  # of its largest speed, which a drive does not pass to make up for a distance, unless its plant does
SLOWING = 0.1  # m/s^2, by which a twin that made up for a distance becomes slower: less than any drive can
SPAN, LONG_SPAN = 1.0, 2.0  # s, over which a measured speed is averaged, and an acceleration
FEWEST = 4  # samples that are kept of a sensor that measures seldom
CHANGED = 0.02  # m/s, from which on another speed is commanded
LONGEST = 0.3  # s, after which a speed is commanded again
LATE = 0.4  # s of the speed before a stop, by which a plant that has not stopped is farther away than `APART`
STARTS = 3.0  # s, in which a drive begins to move that is commanded to
STANDS = 0.05  # m, up to which a carriage or drive has not moved


class Pursuit:
    """Speed commands to the drives of a twin: as the plant is commanded, or else by the plant's encoders.

    A twin that gets all commands of its plant moves as the plant does. A twin that missed some is brought to the place
    of the plant by its speed. Places of an encoder that is silent, or has leapt, are none.

    Attributes:
        catching_up: whether a drive is brought to the place of the plant at present, by a speed that the plant has not.
        stopped: whether an emergency stop of the plant is in force in the twin, so that no speed is commanded.

    Args:
        most: largest speed (m/s) by name of a carriage or drive.
        period: distance (m) after which places of a drive are alike, as round a loop, by name.
        noise: standard deviation (m) of a measured place by name.
    """

    def __init__(
        self,
        most: Mapping[str, float],
        period: Mapping[str, float] | None = None,
        noise: Mapping[str, float] | None = None,
    ) -> None:
        self._most, self._period, self._noise = dict(most), dict(period or {}), dict(noise or {})
        self._commanded: dict[str, tuple[float, float]] = {}  # time (s) and speed (m/s) of the last command
        self._places: dict[str, deque[tuple[float, float]]] = {}  # times (s) and places (m) of the last `LONG_SPAN`
        self._asked_since: dict[str, float] = {}  # s, from when on a speed has been commanded without a stop
        self._stood: dict[str, tuple[float, float]] = {}  # time (s) and place (m), from which each has not moved
        self._given: dict[str, tuple[float, float]] = {}
        self._pursued: set[str] = set()
        self._leaps: dict[str, Leaps] = {}
        self._stop: Stop | None = None
        self._idle: set[str] = set()  # drives of a plant that has stopped that were commanded to stand since
        self._asked = False  # whether one of them was commanded to move then

    @property
    def stopped(self) -> bool:
        """Whether an emergency stop of the plant is in force in the twin."""
        return self._stop is not None

    @property
    def catching_up(self) -> bool:
        """Whether a drive is brought to the place of the plant at present."""
        return bool(self._pursued)

    def command(self, time: float, speeds: Mapping[str, float]) -> None:
        """Record the speeds (m/s) that a plant was commanded at a time (s), by name of carriage or drive."""
        for name, speed in speeds.items():
            self._commanded[name] = time, speed
            self._asked_since[name] = (
                min(self._asked_since.get(name, np.inf), time) if abs(speed) >= CHANGED else np.inf
            )
            if self._stop is not None and abs(speed) < CHANGED:
                self._idle.add(name)
            elif self._stop is not None:
                self._asked = self._asked or name in self._idle

    def measure(self, time: float, name: str, place: float) -> None:
        """Record the place (m) of a carriage or drive that an encoder measured at a time (s)."""
        kept = self._places.setdefault(name, deque())
        if self._leaps.setdefault(name, Leaps(self._noise.get(name, 0.0))).note(time, place):
            return
        kept.append((time, place))
        if name not in self._stood or abs(place - self._stood[name][1]) > STANDS:
            self._stood[name] = time, place
        while len(kept) > FEWEST and kept[-1][0] - kept[0][0] > LONG_SPAN + 1e-9:
            kept.popleft()

    def knows(self, name: str) -> bool:
        """Whether an encoder has measured a carriage or drive at any time, also before what is forgotten."""
        return name in self._places

    def speed_of(self, name: str) -> float | None:
        """Measured speed (m/s) of a carriage or drive, mean of the last `SPAN`; None with too few measurements."""
        return self._rate_of(name, SPAN, 1)

    def acceleration_of(self, name: str) -> float | None:
        """Measured acceleration (m/s^2) of a carriage or drive in the last `LONG_SPAN`; None with few measurements."""
        half = self._rate_of(name, LONG_SPAN, 2)
        return None if half is None else 2.0 * half

    def _rate_of(self, name: str, span: float, degree: int) -> float | None:
        """Highest coefficient of a polynomial fit of the places measured in a span (s); None with few measurements."""
        kept = self._places.get(name, deque())
        few = len(kept) - degree - 2  # of a sensor that measures seldom: as many as a fit needs
        recent = [one for row, one in enumerate(kept) if row >= few or kept[-1][0] - one[0] <= span + 1e-9]
        if len(recent) < degree + 2 or recent[-1][0] - recent[0][0] < 0.5 * span:
            return None
        times, places = np.array(recent).T
        return float(np.polyfit(times - times[-1], places, degree)[0])

    def place_of(self, name: str) -> float | None:
        """Newest measured place (m) of a carriage or drive; None without any measurement."""
        kept = self._places.get(name)
        return kept[-1][1] if kept else None

    def apart(self, name: str, there: float, place: float) -> float:
        """Signed distance (m) of a carriage or drive from `place` to `there`, on a loop the shorter way round."""
        period = self._period.get(name, np.inf)
        return float(
            np.remainder(there - place + 0.5 * period, period) - 0.5 * period if period < np.inf else there - place
        )

    def forget(self) -> None:
        """Forget all measured places, as after a silence of the plant."""
        for kept in self._places.values():
            kept.clear()
        for leaps in self._leaps.values():
            leaps.clear()
        self._stood.clear()
        self._pursued.clear()

    def stop(self, stop: Stop) -> None:
        """Record that an emergency stop of the plant is in force in the twin from now on."""
        stands = [
            name for name, (at, speed) in self._commanded.items() if stop.time - at <= FRESH and abs(speed) < CHANGED
        ]
        self._idle, self._asked, self._stop = set(stands), False, stop

    def is_held(self, time: float, name: str) -> bool:
        """Whether a plant that stands has been commanded to move all the same for longer than it needs to start."""
        stood, _ = self._stood.get(name, (-np.inf, 0.0))
        return self.is_asked(time, name) and time - max(stood, self._asked_since[name]) > STARTS

    def is_asked(self, time: float, name: str) -> bool:
        """Whether a carriage or drive of the plant is commanded to move at a time (s)."""
        commanded_at, _ = self._commanded.get(name, (-np.inf, 0.0))
        return time - commanded_at <= FRESH and self._asked_since[name] <= time

    def moves_again(self, time: float, name: str, place: float | None) -> bool:
        """Whether a plant that has stopped moves again, or is not where its twin at a place (m) has stopped.

        Commands tell it that ask for a speed after they had asked for none; else the place of the plant.
        """
        if self._stop is None:
            return False
        there, lasts = self._present_place(time, name), time < self._stop.time + self._stop.lasts + SPAN
        margin = APART + (LATE * self._stop.speed if lasts else 0.0)
        away = place is not None and there is not None and abs(self.apart(name, there, place)) > margin
        return self._asked or away

    def release(self) -> None:
        """Record that the emergency stop is no longer in force in the twin."""
        self._stop, self._idle, self._asked = None, set(), False
        self._given.clear()

    def leave(self, name: str) -> None:
        """Forget the measured places of a carriage or drive whose encoder is left out as faulty."""
        self._places.pop(name, None)
        self._leaps.pop(name, None)
        self._pursued.discard(name)

    def _present_place(self, time: float, name: str) -> float | None:
        """Place (m) of a carriage or drive at a time (s), by its last ones; None where its encoder is silent."""
        kept, speed = self._places.get(name), self.speed_of(name)
        if not kept:
            return None
        usual = (kept[-1][0] - kept[0][0]) / max(len(kept) - 1, 1)
        since = time - kept[-1][0]
        return kept[-1][1] + since * (speed or 0.0) if since <= max(FRESH, SELDOM * usual) else None

    def wanted(self, time: float, name: str, place: float) -> float | None:
        """Speed (m/s) to command to a drive of the twin that is at a place (m); None for no new command.

        Args:
            time: s, of the newest measurement and of the place.
            name: of the carriage or drive.
            place: m, of the twin.
        """
        if self.stopped:
            return None
        commanded_at, commanded = self._commanded.get(name, (-np.inf, 0.0))
        fresh = time - commanded_at <= FRESH
        measured, there = self.speed_of(name), self._present_place(time, name)
        if measured is None or there is None:
            self._pursued.discard(name)
            return self._give(time, name, commanded) if fresh else None
        apart = self.apart(name, there, place)
        margin = (NEAR if name in self._pursued else APART) + TIMING * abs(measured)
        self._pursued = self._pursued - {name} if abs(apart) <= margin else self._pursued | {name}
        speed = commanded if fresh else measured
        if name in self._pursued:
            closing = min(abs(apart) / CLOSING, float(np.sqrt(2.0 * SLOWING * abs(apart))))
            fastest = max(BELOW * self._most.get(name, np.inf), abs(measured))
            speed = float(np.clip(measured + np.copysign(closing, apart), -fastest, fastest))
        return self._give(time, name, speed)

    def _give(self, time: float, name: str, speed: float) -> float | None:
        most = self._most.get(name, np.inf)
        speed = 0.0 if abs(speed) < CHANGED else float(np.clip(speed, -most, most))
        given_at, given = self._given.get(name, (-np.inf, np.nan))
        if abs(speed - given) < CHANGED and time - given_at < LONGEST:
            return None
        speed = given if abs(speed - given) < CHANGED else speed
        self._given[name] = time, speed
        return speed


def pursuit_of(scenario: Scenario, period: Mapping[str, float] | None = None) -> Pursuit:
    """Pursuit by the drives and encoders of a scenario; `period` as of `Pursuit`."""
    most = {name: one.speed for name, one in command_limits(scenario).items()}
    noise = {one.of: one.noise for one in scenario.sensors.values() if one.kind == "encoder"}
    return Pursuit(most, period, noise)
