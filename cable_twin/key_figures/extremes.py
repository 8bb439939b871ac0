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
    """Largest values so far of `count` quantities (smallest ones with sign -1), with time and place of each."""

    sign: float
    best: FloatArray  # (count,) times sign, -inf where there was no value
    times: FloatArray  # (count,) s
    places: FloatArray  # (count,) NaN where there is none
    winds: FloatArray  # (count, 3) m/s, NaN where nobody asked

    def value(self, index: int = 0) -> float:
        """Extreme value of one quantity; NaN without a value so far."""
        best = float(self.best[index])
        return nan if best == -inf else self.sign * best

    def after_first(self) -> Extremes:
        """Extremes of all quantities but the first, sharing memory."""
        return Extremes(self.sign, self.best[1:], self.times[1:], self.places[1:], self.winds[1:])

    def worst(self, among: list[int]) -> int:
        """Index, among the given ones, of the most extreme quantity."""
        return among[int(self.best[among].argmax())]


def highest(count: int = 1) -> Extremes:
    """Largest values of `count` quantities, empty."""
    return Extremes(1.0, np.full(count, -inf), np.zeros(count), np.full(count, nan), np.full((count, 3), nan))


def lowest(count: int = 1) -> Extremes:
    """Smallest values of `count` quantities, empty."""
    return highest(count)._replace(sign=-1.0)


@inlined_kernel
def take(extremes, index, value, time, place):
    """Take in a value of one quantity at a time (s) and place; the first of equal values is kept, NaN is ignored."""
    signed = extremes.sign * value
    if signed > extremes.best[index]:
        extremes.best[index], extremes.times[index], extremes.places[index] = signed, time, place


@kernel
def take_in_wind(extremes, index, value, time, place, wind):
    """Take in a value of one quantity at a time (s) and place, with the wind (3,) in m/s at that time."""
    if extremes.sign * value > extremes.best[index]:
        take(extremes, index, value, time, place)
        for axis in range(3):
            extremes.winds[index, axis] = wind[axis]


__all__ = ["Extremes", "highest", "lowest", "take", "take_in_wind"]
