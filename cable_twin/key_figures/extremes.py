"""Extremes over a run, with time and place of each, and brakings to standstill: the memory of the key figures."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan

import numpy as np

from cable_twin.records import FloatArray

STANDSTILL = 1e-3  # m/s


class Extremes:
    """The largest values so far of several things, or with sign -1 the smallest, with time and place of each.

    What is NaN is no value.
    """

    def __init__(self, count: int = 1, sign: float = 1.0) -> None:
        self.times, self.places = np.zeros(count), np.full(count, nan)
        self._sign = sign
        self._best = np.full(count, -inf)  # times sign

    def update(self, values: FloatArray | list[float], time: float, places: FloatArray | float = nan) -> None:
        """Take in values (count,) at a time (s), with places (count,) or one."""
        signed = np.asarray(values) if self._sign == 1.0 else -np.asarray(values)
        gains = signed > self._best
        if np.count_nonzero(gains):  # a fifth of the time of `any`
            self._best[gains], self.times[gains] = signed[gains], time
            self.places[gains] = np.broadcast_to(places, gains.shape)[gains]

    def value(self, index: int = 0) -> float:
        """The extreme of one thing, NaN where it never had a value."""
        best = float(self._best[index])
        return nan if best == -inf else self._sign * best

    def worst(self, among: list[int]) -> int:
        """Index of the thing, among those given, that went farthest."""
        return among[int(self._best[among].argmax())]


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
        if abs(speed) <= STANDSTILL:
            return
        if self._braking is None or (kind == "emergency stop" and self._braking.kind != kind):
            self._braking = Stop(kind, time, place, speed)

    def cancel(self) -> None:
        """It is told to move again, or put elsewhere."""
        self._braking = None

    def update(self, time: float, place: float, speed: float) -> None:
        """Take in where it is (m) and how fast (m/s)."""
        stop = self._braking
        if stop is None or (abs(speed) > STANDSTILL and speed * stop.speed > 0.0):
            return
        stop.end, stop.distance = time, abs(place - stop.start)
        if self.stop is None or stop.kind == "emergency stop" or self.stop.kind != "emergency stop":
            self.stop = stop
        self._braking = None


__all__ = ["Extremes", "Stop", "Stops"]
