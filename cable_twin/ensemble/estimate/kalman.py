"""Kalman filter of slow quantities, each a random walk or a decaying bias, with tests of its innovations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cable_twin.mechanics.parameters import FloatArray

Terms = tuple[FloatArray, FloatArray, FloatArray]  # innovation (m,), derivatives (m, n) and variance (m,)


class Belief(NamedTuple):
    """Gaussian belief about n quantities: means (n,) and covariance (n, n)."""

    mean: FloatArray
    covariance: FloatArray


def predict(belief: Belief, decay: FloatArray, growth: FloatArray) -> Belief:
    """Kalman prediction: each quantity decays towards zero by a factor, and its variance grows.

    Args:
        belief: n quantities.
        decay: (n,) factor of each, 1 for a random walk.
        growth: (n,) added variance of each.
    """
    return Belief(decay * belief.mean, decay[:, None] * belief.covariance * decay + np.diag(growth))


def update(belief: Belief, innovation: FloatArray, jacobian: FloatArray, variance: FloatArray) -> Belief:
    """Kalman update by measurements with independent noise, in Joseph's form, which keeps the covariance positive.

    Args:
        belief: n quantities.
        innovation: (m,) measured less predicted values.
        jacobian: (m, n) derivatives of the predicted values.
        variance: (m,) of the noise.
    """
    return corrected(belief, innovation, jacobian, variance, gain_of(belief, jacobian, variance))


def gain_of(belief: Belief, jacobian: FloatArray, variance: FloatArray) -> FloatArray:
    """Kalman gain (n, m) of measurements; arguments as of `update`."""
    total = jacobian @ belief.covariance @ jacobian.T + np.diag(variance)
    return np.asarray(np.linalg.solve(total, jacobian @ belief.covariance).T, np.float64)


def corrected(
    belief: Belief, innovation: FloatArray, jacobian: FloatArray, variance: FloatArray, gain: FloatArray
) -> Belief:
    """Belief after an update with any gain (n, m): zero rows keep quantities whose doubt still counts (Schmidt 1966).

    Args:
        belief: n quantities.
        innovation: (m,) measured less predicted values.
        jacobian: (m, n) derivatives of the predicted values.
        variance: (m,) of the noise.
        gain: (n, m) of each quantity by each measurement.
    """
    left = np.eye(belief.mean.size) - gain @ jacobian
    after = left @ belief.covariance @ left.T + (gain * variance) @ gain.T
    return Belief(belief.mean + gain @ innovation, 0.5 * (after + after.T))


def reset(belief: Belief, rows: Sequence[int], mean: ArrayLike, deviation: ArrayLike) -> Belief:
    """Belief with some quantities (by row) known anew and apart from all others: a mean and deviation, or one each."""
    means, covariance = belief.mean.copy(), belief.covariance.copy()
    means[rows], covariance[rows, :], covariance[:, rows] = mean, 0.0, 0.0
    covariance[rows, rows] = np.asarray(deviation, dtype=np.float64) ** 2
    return Belief(means, covariance)


def within(belief: Belief, least: FloatArray, most: FloatArray) -> Belief:
    """Belief whose first k means are brought within bounds (k,), and all others along; deviations stay.

    It is for what is told: a filter that went on with it would take a bound for a measurement in each window.
    """
    mean, rows = belief.mean.copy(), range(least.size)
    for row in rows:
        apart = float(np.clip(mean[row], least[row], most[row]) - mean[row])
        if apart and belief.covariance[row, row] > 0.0:
            mean += belief.covariance[row] * (apart / belief.covariance[row, row])
    mean[: least.size] = np.clip(mean[: least.size], least, most)
    return belief._replace(mean=mean)


def normalised_square(
    innovation: FloatArray, jacobian: FloatArray, variance: FloatArray, covariance: FloatArray
) -> float:
    """Normalised innovation squared: chi-square distributed with one degree of freedom per measurement."""
    total = jacobian @ covariance @ jacobian.T + np.diag(variance)
    return float(innovation @ np.linalg.solve(total, innovation))
