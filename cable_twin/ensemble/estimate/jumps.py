"""Jumps of an encoder: a step between its place and that of the twin, told from waves and from drifts.

A bounce of the plant, a quantum of the sensor and a correction of the twin each look like a step to some fits. A jump
is a step of the same size to all of them: polynomials of several degrees over windows of several lengths about one
moment, each with a step there.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.ndimage import median_filter

from cable_twin.mechanics.parameters import FloatArray

FITS = (15, 1), (20, 1), (30, 1), (20, 3), (30, 3), (30, 5)  # samples on each side, degree of the polynomial
HALF = max(count for count, _ in FITS)
SMALLEST = 3.7  # standard deviations of a sample, of which a jump is at least: one quantum is 3.5 and no jump
SUREST = 3.0  # standard deviations of the step of each fit, as its own residuals are
ALIKE = 2.0  # times the smallest step of all fits, which the largest one is at most
SHARP, BESIDE = 0.5, 9  # share of the step that is between two samples, beyond what is between those beside them
FLIPS, FLIP = 6, 1.5  # fewest changes of more than that many deviations where places are spread over quanta
GAP = 1.3  # times the usual time of as many samples, in which some may be lost


class _Fit:
    """Least-squares fit of a polynomial with a step in the middle of 2 n samples."""

    def __init__(self, count: int, degree: int) -> None:
        about = (np.arange(-count, count) + 0.5) / count
        shapes = np.column_stack([about**power for power in range(degree + 1)] + [np.where(about > 0.0, 0.5, -0.5)])
        inverse = np.linalg.pinv(shapes)
        self.samples = slice(HALF - count, HALF + count)
        self._step, self._left = inverse[-1], np.eye(2 * count) - shapes @ inverse
        self._free, self._size = 2 * count - degree - 2, float(np.linalg.norm(inverse[-1]))

    def step(self, values: FloatArray, noise: float) -> tuple[float, float]:
        """Step of samples (2 n,), and its standard deviation: by their scatter, at least by their noise."""
        left = self._left @ values
        return float(self._step @ values), self._size * max(float(np.sqrt(left @ left / self._free)), noise)


class Jumps:
    """Detector of jumps of one encoder.

    Args:
        noise: standard deviation of a sample, m.
    """

    def __init__(self, noise: float) -> None:
        self._noise, self._fits = noise, [_Fit(count, degree) for count, degree in FITS]
        self._kept: deque[tuple[float, float, float]] = deque(maxlen=2 * HALF)

    def forget(self) -> None:
        """Forget all samples, as after a restart of the twin or while a vehicle passes a tower."""
        self._kept.clear()

    def note(self, time: float, place: float, twin: float) -> float:
        """Take a sample (m) of a time (s) and the place of the twin then (m); size (m) of a jump, 0 for none.

        It is told at most `HALF` samples after it.
        """
        self._kept.append((time, place, twin))
        if len(self._kept) < 2 * HALF:
            return 0.0
        times, places, twins = np.array(self._kept).T
        if times[-1] - times[0] > GAP * (2 * HALF - 1) * float(np.median(np.diff(times))):
            return 0.0
        values = places - twins
        found = [fit.step(values[fit.samples] - values.mean(), self._noise) for fit in self._fits]
        sign, least = np.sign(found[0][0]), SMALLEST * self._noise
        steps = sign * np.array([step for step, _ in found])
        sure = all(sign * step > max(least, SUREST * deviation) for step, deviation in found)
        if not sure or steps.max() > ALIKE * steps.min():
            return 0.0
        changes = sign * np.diff(values)
        changes -= median_filter(changes, BESIDE, mode="nearest")
        spread = np.count_nonzero(np.abs(changes) > FLIP * self._noise) >= FLIPS
        size = float(changes.max())
        return float(sign * size) if size > (SHARP * steps.min() if spread else least) else 0.0
