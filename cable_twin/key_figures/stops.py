"""Brakings to standstill, from the command on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import isnan, nan

from cable_twin.key_figures.figure import KeyFigure
from cable_twin.records import AppliedCommand

STANDSTILL = 1e-3  # m/s


@dataclass(slots=True)
class Stop:
    """A braking to standstill, under way or done."""

    kind: str
    time: float  # s, of the command
    start: float  # m, place there
    speed: float  # m/s there
    end: float = nan  # s, of the standstill
    distance: float = nan  # m


class Stops:
    """The stop that counts of one thing that is driven: the last emergency stop, else the last stop."""

    def __init__(self) -> None:
        self.stop: Stop | None = None
        self._braking: Stop | None = None

    def begin(self, kind: str, time: float, place: float, speed: float) -> None:
        """A command to stop: the emergency stop goes before a stop that is under way."""
        if not abs(speed) > STANDSTILL:
            return
        if self._braking is None or (kind == "emergency stop" and self._braking.kind != kind):
            self._braking = Stop(kind, time, place, speed)

    def cancel(self) -> None:
        """It is told to move again, or put elsewhere."""
        self._braking = None

    @property
    def braking(self) -> bool:
        """Whether a stop is under way."""
        return self._braking is not None

    def update(self, time: float, place: float, speed: float) -> None:
        """Take in where it is (m) and how fast (m/s)."""
        stop = self._braking
        if stop is None or isnan(place + speed) or (abs(speed) > STANDSTILL and speed * stop.speed > 0.0):
            return
        stop.end, stop.distance = time, abs(place - stop.start)
        if self.stop is None or stop.kind == "emergency stop" or self.stop.kind != "emergency stop":
            self.stop = stop
        self._braking = None


class StopsOf:
    """Those of all that is driven, by name.

    Args:
        names: of what is driven.
        motion: gives place (m) and speed (m/s) of one of them in the last frame.
    """

    def __init__(self, names: Iterable[str], motion: Callable[[str], tuple[float, float]]) -> None:
        self._stops, self._motion = {name: Stops() for name in names}, motion
        self._time = nan  # s, of the last frame
        self._braking: list[str] = []  # those of which a stop is under way

    def update(self, time: float) -> None:
        """Take in the last frame, at a time (s)."""
        self._time = time
        if self._braking:
            for name in self._braking:
                self._stops[name].update(time, *self._motion(name))
            self._find_braking()

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command where it took effect."""
        kind, values, seen = applied.command.kind, applied.command.values, not isnan(self._time)
        for name, stops in self._stops.items():
            if kind == "reset":
                stops.cancel()
            elif seen and kind == "emergency_stop":
                stops.begin("emergency stop", applied.time, *self._motion_at(name, applied.time))
            elif seen and kind == "speed" and values.get(name) == 0.0:
                stops.begin("stop", applied.time, *self._motion_at(name, applied.time))
            elif kind in ("speed", "force") and name in values:
                stops.cancel()
        self._find_braking()

    def figures(self, name: str, limited: Callable[[KeyFigure, str], KeyFigure]) -> Iterator[KeyFigure]:
        """Way and time of the stop that counts of one of them; `limited` gives them the limit of a key."""
        stop = self._stops[name].stop if name in self._stops else None
        if stop is not None:
            place = f"{stop.kind} from {abs(stop.speed):.2f} m/s at {stop.start:.1f} m"
            yield limited(
                KeyFigure(f"{name}: stopping distance", stop.distance, "m", stop.time, place), "stopping_distance"
            )
            yield limited(
                KeyFigure(f"{name}: stopping time", stop.end - stop.time, "s", stop.time, place), "stopping_time"
            )

    def _find_braking(self) -> None:
        self._braking = [name for name, stops in self._stops.items() if stops.braking]

    def _motion_at(self, name: str, time: float) -> tuple[float, float]:
        """Place (m) and speed (m/s) at a time (s) shortly after the last frame, which goes on as it was."""
        place, speed = self._motion(name)
        return place + speed * (time - self._time), speed


__all__ = ["Stop", "Stops", "StopsOf"]
