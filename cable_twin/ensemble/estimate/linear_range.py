"""Range about the members of an ensemble in which the effects of slow quantities are linear."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_twin.ensemble.estimate.kalman import Belief
from cable_twin.ensemble.estimate.quantities import OF_SQUARE, Slow, bounds
from cable_twin.ensemble.estimate.swings import SIZE
from cable_twin.mechanics.parameters import FloatArray

FAR, FAR_SHARE = 3.0, 0.15  # m/s and share of it, by which a correction moves wind too far for its slopes
FAR_LOAD = 0.03  # of the capacity, by which one of the first corrections moves a payload too far for its slopes
FAR_SWING = 0.1  # rad and rad/s, standard deviation of the swing after such a correction


def wind_went_far(slow: Sequence[Slow], middle: FloatArray, before: Belief, after: Belief) -> bool:
    """Whether a correction moves a wind that is little known beyond the range in which its effects are linear.

    Such a correction only tells where to linearise: the quadratic effect of the wind would be attributed to
    payloads and friction, with standard deviations too small to be corrected later.

    Args:
        slow: n quantities.
        middle: (n,) values of the middle member.
        before: belief before the correction.
        after: belief after it.
    """
    moved, deviations = _moved(slow, middle, before, after)
    far = np.maximum(FAR, FAR_SHARE * np.abs(after.mean[: len(slow)]))
    of_wind = [one.curvature == OF_SQUARE for one in slow]
    return bool(((moved > far) & (deviations > FAR))[of_wind].any())


def loads_went_far(slow: Sequence[Slow], middle: FloatArray, before: Belief, after: Belief) -> bool:
    """Whether a correction moves a little known payload beyond that range; arguments as of `wind_went_far`."""
    moved, deviations = _moved(slow, middle, before, after)
    return any(
        min(size, deviation) > FAR_LOAD * one.high
        for one, size, deviation in zip(slow, moved, deviations, strict=True)
        if one.payload_of
    )


def doubt_steps(slow: Sequence[Slow], middle: FloatArray, after: Belief) -> Belief:
    """Belief with the second-order error of a correction of slow quantities; arguments as of `wind_went_far`."""
    count, covariance = len(slow), after.covariance.copy()
    curvature = np.array([one.curvature for one in slow])
    covariance[range(count), range(count)] += (curvature * (after.mean[:count] - middle)) ** 2
    return after._replace(covariance=covariance)


def any_swing(belief: Belief, first: int, count: int) -> FloatArray:
    """Covariance with larger variances of all swings, `count` from row `first` on, which a change of wind excites."""
    covariance = belief.covariance.copy()
    for row in range(first, first + count):
        covariance[row, row] = max(covariance[row, row], FAR_SWING**2)
    return covariance


def _moved(slow: Sequence[Slow], middle: FloatArray, before: Belief, after: Belief) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) of the estimates from the middle member, and standard deviations (n,) before the correction."""
    found = np.clip(after.mean[: len(slow)], *bounds(slow))
    return np.abs(found - middle), np.sqrt(np.diag(before.covariance)[: len(slow)])


def slopes(points: FloatArray, predicted: FloatArray, waving: Sequence[str] = ()) -> FloatArray:
    """Jacobian (m, n) of predicted measurements by slow quantities and swings, as differences between members.

    Ropes wave otherwise in each member, as rolling friction excites them when carriages begin to roll. Waves of the
    plant have other phases: taken for slopes, those of members would tell much of a quantity on which a force hardly
    depends. Of sensors that feel waves of a haul rope the mean slopes count.

    Args:
        points: (1 + 2 quantities, quantities) of the middle member and of two for each slow quantity.
        predicted: (m, members) measurements of these members, and of one for each swing of a size of `SIZE`.
        waving: (m,) sensor of each measurement that feels waves of a haul rope, empty for others.
    """
    number, first = np.arange(points.shape[1]), len(points)
    apart = points[1 + 2 * number, number] - points[2 + 2 * number, number]
    slow = (predicted[:, 1:first:2] - predicted[:, 2:first:2]) / apart
    fast = (predicted[:, first:] - predicted[:, :1]) / SIZE
    sensors = np.array(waving)
    for sensor in {*waving} - {""}:
        slow[sensors == sensor] = slow[sensors == sensor].mean(axis=0)
    return np.hstack([slow, fast])
