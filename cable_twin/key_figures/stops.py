"""Brakings to standstill, from the command on."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, nan

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


__all__ = ["Stop", "Stops"]
