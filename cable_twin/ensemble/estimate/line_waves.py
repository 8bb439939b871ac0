"""Doubt about forces whose waves have other phases in the twin than in the plant, as after a stop or in a silence."""

from __future__ import annotations

import numpy as np

CALMED, MEAN = 40.0, 10.0  # s, in which the waves calm down, and over which their size is taken


class LineWaves:
    """Variances of forces by waves that were stirred: twice what these have in the twin.

    That is the variance of the difference of two waves of this size whose phases have nothing in common.
    """

    def __init__(self) -> None:
        self._stirred = -np.inf  # s
        self._moments: dict[str, tuple[float, float, float]] = {}  # time (s), mean (N) and mean square (N^2)

    def stir(self, time: float) -> None:
        """Begin to doubt forces at a time (s)."""
        self._stirred = time

    def variance(self, time: float, name: str, force: float) -> float:
        """Variance (N^2) of a force (N) by name at a time (s), which is asked for window by window."""
        before, mean, square = self._moments.get(name, (time, force, force**2))
        new = 1.0 - float(np.exp(min(before - time, 0.0) / MEAN))
        mean, square = mean + new * (force - mean), square + new * (force**2 - square)
        self._moments[name] = time, mean, square
        share = float(np.exp(min(self._stirred - time, 0.0) / CALMED))
        return 2.0 * share * (max(square - mean**2, 0.0) + (force - mean) ** 2)
