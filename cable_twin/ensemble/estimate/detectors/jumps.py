"""Detection of encoders that jump by little against their twin, or leap to where their vehicle cannot be.

A jump is a step in the difference of encoder and twin, distinguished from waves and drifts: a bounce of the plant, or a
quantum of the sensor, each looks like a step to some fits. A jump is one of about the same size to all of them:
polynomials of several degrees over windows of several lengths about one moment, each with a step there; and it is
between two samples. A leap is known by the encoder alone: its vehicle cannot have come there since the sample before.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from cable_twin.mechanics.parameters import FloatArray

FITS = (10, 1), (15, 1), (20, 1), (30, 1), (20, 3), (30, 3), (30, 5)  # samples on each side, degree of the polynomial
HALF = max(count for count, _ in FITS)
SMALLEST = 3.7  # standard deviations of a sample, of which a jump is at least: one quantum is 3.5 and no jump
ROUGHER = 2.0  # times that, where a plant bounces otherwise than its twin: a quantum and a bounce at once are no jump
BOUNCES = 1.2  # times what places bounce by on either side, of which a jump is at least there
LEAST = 5e-3  # m, smaller steps are of no account
SUREST = 3.5  # standard deviations of the step of each fit, as its own residuals are
ALIKE = 2.0  # times the smallest step of all fits, which the largest one is at most
SHARP, BESIDE, ABOUT = 0.8, 2, 2  # share of the step that is between the means of two samples beside the middle
FLIPS, FLIP = 6, 1.5  # fewest changes of more than that many deviations where places are spread over quanta
LOST = 3.5  # times the usual time between two samples, up to which lost ones are interpolated
FASTEST = 3.0  # m/s^2, more than any vehicle accelerates or brakes by
NEAREST, NOISES = 0.3, 10.0  # m, and standard deviations of a sample, by which a place is beyond that at least
HELD = 20  # samples one after the other elsewhere, after which the encoder is followed there


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
        """Step in the middle of samples (2 n,), and its standard deviation by their scatter, at least their noise."""
        left = self._left @ values
        return float(self._step @ values), self._size * max(float(np.sqrt(left @ left / self._free)), noise)


_LINES = np.vander(np.arange(HALF), 2)
_LEVEL = np.eye(HALF) - _LINES @ np.linalg.pinv(_LINES)  # what is left of samples without their trend


class Jumps:
    """Detector of jumps of one encoder.

    Args:
        noise: standard deviation of a sample, m.

    Attributes:
        rough: whether the plant bounces otherwise than its twin, so that larger jumps alone are told.
    """

    def __init__(self, noise: float) -> None:
        self.rough = False
        self._noise, self._fits = noise, [_Fit(count, degree) for count, degree in FITS]
        self._times: deque[float] = deque(maxlen=2 * HALF)
        self._apart: deque[float] = deque(maxlen=2 * HALF)

    def forget(self) -> None:
        """Forget all samples, as after a restart of the twin or while a vehicle passes a tower."""
        self._times.clear()
        self._apart.clear()

    def shift(self, way: float) -> None:
        """Account for a correction (m) of the twin's place, so that it is not taken for a jump of the encoder."""
        self._apart = deque((one - way for one in self._apart), maxlen=2 * HALF)

    def note(self, time: float, apart: float) -> float:
        """Add a sample, encoder less twin (m), at a time (s); returns the size (m) of a detected jump, 0 for none.

        A jump is told at most `HALF` samples after it.
        """
        self._times.append(time)
        self._apart.append(apart)
        if len(self._times) < 2 * HALF:
            return 0.0
        times = np.array(self._times)
        between = np.diff(times)
        usual = float(np.median(between))
        if not usual > 0.0 or between.max() > LOST * usual:
            return 0.0
        values = np.interp(time - usual * np.arange(2 * HALF - 1, -1, -1), times, np.array(self._apart))
        found = [fit.step(values[fit.samples], self._noise) for fit in self._fits]
        sign, least = np.sign(found[0][0]), max(SMALLEST * self._noise, LEAST)
        if self.rough:
            least = max(ROUGHER * least, BOUNCES * max(float(np.ptp(_LEVEL @ side)) for side in np.split(values, 2)))
        steps = sign * np.array([step for step, _ in found])
        sure = all(sign * step > max(least, SUREST * deviation) for step, deviation in found)
        size = float(np.median(steps))
        if not sure or steps.max() > ALIKE * steps.min():
            return 0.0
        moments = range(HALF - ABOUT, HALF + ABOUT + 1)
        at_once = max(sign * (values[one : one + BESIDE].mean() - values[one - BESIDE : one].mean()) for one in moments)
        spread = np.count_nonzero(np.abs(np.diff(values)) > FLIP * self._noise) >= FLIPS
        return float(sign * size) if at_once > max(SHARP * size, 0.0 if spread else least) else 0.0


class Leaps:
    """Detector of leaps of one encoder, by its last two places where it was expected.

    Everybody who follows an encoder has one of his own, as each begins anew at other times.

    Args:
        noise: standard deviation of a sample, m.
    """

    def __init__(self, noise: float = 0.0) -> None:
        self._least = max(NEAREST, NOISES * noise)
        self._kept: deque[tuple[float, float]] = deque(maxlen=2)  # s and m
        self._elsewhere = 0  # samples one after the other

    def clear(self) -> None:
        """Forget the last places, as after a gap."""
        self._kept.clear()
        self._elsewhere = 0

    def note(self, time: float, place: float) -> float:
        """Distance (m) of a sample at a time (s) from where its vehicle may be; 0 where it may be there."""
        if len(self._kept) == 2 and self._elsewhere < HELD:
            (first, start), (last, end) = self._kept
            since, between = time - last, max(last - first, 1e-3)
            away = place - end - (end - start) / between * since
            if abs(away) > self._least + 0.5 * FASTEST * since * (since + between):
                self._elsewhere += 1
                return away
        elif self._elsewhere:
            self.clear()
        self._elsewhere = 0
        if not self._kept or time > self._kept[-1][0]:
            self._kept.append((time, place))
        return 0.0
