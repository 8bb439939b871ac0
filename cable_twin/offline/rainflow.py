"""Rainflow count of the cycles in a load history."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray


class Cycle(NamedTuple):
    """Load cycle: range and mean in the unit of the load, and weight 1 for a whole cycle, 0.5 for a half one."""

    range: float
    mean: float
    weight: float


def turning_points(values: FloatArray) -> FloatArray:
    """Peaks and valleys of a load history (n,), with its first and last value; repeated values count once."""
    values = values[np.isfinite(values)]
    if values.size:
        values = values[np.concatenate([[True], np.diff(values) != 0.0])]
    if values.size < 3:
        return values
    rises = np.diff(values) > 0.0
    turns: FloatArray = values[np.concatenate([[True], rises[1:] != rises[:-1], [True]])]
    return turns


def rainflow_cycles(values: FloatArray) -> list[Cycle]:
    """Cycles of a load history (n,) by rainflow counting, in the order of closing; half cycles of the residue last.

    Source: ASTM E1049-85, section 5.4.4.
    """
    found: list[Cycle] = []
    stack: list[float] = []
    for value in turning_points(values).tolist():
        stack.append(value)
        while len(stack) >= 3:
            last, before = abs(stack[-1] - stack[-2]), abs(stack[-2] - stack[-3])
            if last < before:
                break
            if len(stack) == 3:  # the first point is in the range
                found.append(_cycle(stack[0], stack[1], 0.5))
                del stack[0]
            else:
                found.append(_cycle(stack[-3], stack[-2], 1.0))
                del stack[-3:-1]
    return found + [_cycle(one, other, 0.5) for one, other in pairwise(stack)]


def _cycle(one: float, other: float, weight: float) -> Cycle:
    return Cycle(abs(one - other), 0.5 * (one + other), weight)
