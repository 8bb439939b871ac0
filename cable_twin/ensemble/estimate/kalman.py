"""Kalman filter of slow quantities, each a random walk or a decaying bias, with tests of its innovations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.parameters import FloatArray


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
    covariance = belief.covariance
    total = jacobian @ covariance @ jacobian.T + np.diag(variance)
    gain = np.linalg.solve(total, jacobian @ covariance).T
    left = np.eye(belief.mean.size) - gain @ jacobian
    after = left @ covariance @ left.T + (gain * variance) @ gain.T
    return Belief(belief.mean + gain @ innovation, 0.5 * (after + after.T))


def normalised_square(
    innovation: FloatArray, jacobian: FloatArray, variance: FloatArray, covariance: FloatArray
) -> float:
    """Normalised innovation squared: chi-square distributed with one degree of freedom per measurement."""
    total = jacobian @ covariance @ jacobian.T + np.diag(variance)
    return float(innovation @ np.linalg.solve(total, innovation))
