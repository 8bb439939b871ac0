"""Sudden changes of a plant: the quantity or sensor whose change best explains a window of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_twin.ensemble.estimate.kalman import Belief, Terms
from cable_twin.mechanics.parameters import FloatArray

SURELY_CHANGED = 10.0  # logarithm of how much likelier measurements are with a change than without any: 4.5 deviations


class Change(NamedTuple):
    """Sudden change of a quantity or sensor that explains measurements best: index, size and log-likelihood ratio."""

    number: int  # among those that were tried
    size: float
    likelier: float  # logarithm of how much likelier measurements are with it


def with_doubt_of_change(
    belief: Belief,
    terms: Terms,
    changes: Sequence[float],
    errors: FloatArray,
    rarer: float,
) -> tuple[Belief, int]:
    """Belief with more doubt of the slow quantity whose sudden change explains a window best, if no sensor's does.

    Args:
        belief: slow quantities first, slow errors of sensors last.
        terms: innovation (m,), derivatives (m, n) and variance (m,) of the measurements.
        changes: standard deviations of sudden changes of the slow quantities.
        errors: standard deviations of sudden errors of the sensors.
        rarer: logarithm of how much rarer these are.

    Returns:
        The belief, and the number of the slow quantity; -1 for none.
    """
    innovation, jacobian, variance = terms
    total = jacobian @ belief.covariance @ jacobian.T + np.diag(variance)
    count = len(changes)
    effects = np.hstack([jacobian[:, :count], jacobian[:, -errors.size :]])
    less = np.repeat([0.0, rarer], [count, errors.size])
    found = best_change(innovation, total, effects, np.concatenate([changes, errors]), less)
    if found is None or found.number >= count:
        return belief, -1
    covariance = belief.covariance.copy()
    covariance[found.number, found.number] += found.size**2
    return belief._replace(covariance=covariance), found.number


def best_change(
    innovation: FloatArray, total: FloatArray, effects: FloatArray, deviations: FloatArray, rarer: FloatArray
) -> Change | None:
    """Find the sudden change of a quantity or sensor that explains measurements best; None if none is significant.

    Each change is tried by itself with a normal distribution of its size, so that an implausibly large one counts less
    (generalised likelihood ratio, Willsky and Jones 1976, with a prior).

    Args:
        innovation: (m,) measured less predicted values.
        total: (m, m) covariance of the innovation without a change.
        effects: (m, n) what changes of size 1 add to measurements.
        deviations: (n,) standard deviations of the sizes; 0 for an impossible change.
        rarer: (n,) logarithms of how much less frequent each change is than others.
    """
    possible = np.flatnonzero(deviations > 0.0)
    if not possible.size or not innovation.size:
        return None
    seen = np.linalg.solve(total, np.column_stack([innovation, effects[:, possible]]))
    towards = effects[:, possible].T @ seen[:, 0]
    known = np.einsum("ij,ij->j", effects[:, possible], seen[:, 1:]) * deviations[possible] ** 2
    likelier = 0.5 * (deviations[possible] * towards) ** 2 / (1.0 + known) - 0.5 * np.log1p(known) - rarer[possible]
    best = int(np.argmax(likelier))
    if likelier[best] < SURELY_CHANGED:
        return None
    size = deviations[possible[best]] ** 2 * towards[best] / (1.0 + known[best])
    return Change(int(possible[best]), float(size), float(likelier[best]))
