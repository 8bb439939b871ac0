"""Extremes over a run, with time and place of each: the memory of the key figures."""

from __future__ import annotations

from math import inf, nan
from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.parameters import FloatArray


@by_reference
class Extremes(NamedTuple):
    """The largest values so far of several things, or with sign -1 the smallest, with time and place of each."""

    sign: float
    best: FloatArray  # (count,) times sign, -inf where there was no value
    times: FloatArray  # (count,) s
    places: FloatArray  # (count,) NaN where there is none
    winds: FloatArray  # (count, 3) m/s, NaN where nobody asked

    def value(self, index: int = 0) -> float:
        """The extreme of one thing, NaN where it never had a value."""
        best = float(self.best[index])
        return nan if best == -inf else self.sign * best

    def after_first(self) -> Extremes:
        """Those of all things but the first."""
        return Extremes(self.sign, self.best[1:], self.times[1:], self.places[1:], self.winds[1:])

    def worst(self, among: list[int]) -> int:
        """Index of the thing, among those given, that went farthest."""
        return among[int(self.best[among].argmax())]


def highest(count: int = 1) -> Extremes:
    """The largest values of `count` things, none yet."""
    return Extremes(1.0, np.full(count, -inf), np.zeros(count), np.full(count, nan), np.full((count, 3), nan))


def lowest(count: int = 1) -> Extremes:
    """The smallest values of `count` things, none yet."""
    return highest(count)._replace(sign=-1.0)


@inlined_kernel
def take(extremes, index, value, time, place):
    """Take in a value of one thing at a time (s) and a place; of equal ones the first counts, NaN is no value."""
    signed = extremes.sign * value
    if signed > extremes.best[index]:
        extremes.best[index], extremes.times[index], extremes.places[index] = signed, time, place


@kernel
def take_in_wind(extremes, index, value, time, place, wind):
    """The same, with the wind (3,) in m/s at that time."""
    if extremes.sign * value > extremes.best[index]:
        take(extremes, index, value, time, place)
        for axis in range(3):
            extremes.winds[index, axis] = wind[axis]


__all__ = ["Extremes", "highest", "lowest", "take", "take_in_wind"]
