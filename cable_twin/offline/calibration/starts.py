"""Other starting points of a calibration, for where its first descent ends in a minimum that the sensors do not fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.offline.calibration.parameters import PAYLOAD, Parameter

PAYLOADS = 5  # values over the range of a payload
BESIDE_FOUND, BESIDE_PRIOR = (-2.0, -1.0, 0.0, 1.0, 2.0), (-2.0, 2.0)  # prior deviations, of other parameters
SAME = 0.1  # prior deviations, below which a point is none of its own


def starting_points(
    parameters: Sequence[Parameter], told: Sequence[int], bounds: tuple[FloatArray, FloatArray], found: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points from which a calibration can start again, each with one parameter elsewhere.

    A wrong minimum has some parameters right and others far off: a payload from the load cells, and a stiffness with
    which the swing has the wrong phase. So the points are about what was found, and about the priors with one
    parameter as found. Errors of sensors act linearly and need no other start.

    Args:
        parameters: of the calibration.
        told: numbers of the parameters that the data identify.
        bounds: lower and upper bounds (n,) of all parameters, in deviations of their priors from the mean.
        found: point (n,) of the minimum, in the same measure.

    Returns:
        Points (m, n) about what was found, and points (k, n) about the priors.
    """
    near: list[FloatArray] = []
    far: list[FloatArray] = []
    origin = found.copy()
    origin[told] = 0.0
    for number in told:
        parameter = parameters[number]
        if parameter.sensor:
            continue
        low, high = bounds[0][number], bounds[1][number]
        payloads = np.linspace(low, high, PAYLOADS) if PAYLOAD.fullmatch(parameter.key) else None
        for points, middle, beside in ((near, found, BESIDE_FOUND), (far, origin, (*BESIDE_PRIOR, found[number]))):
            for value in np.clip([*beside] if payloads is None else [*payloads, found[number]], low, high):
                if abs(value - middle[number]) >= SAME:
                    point = middle.copy()
                    point[number] = value
                    points.append(point)
    count = found.size
    return _distinct(near, count), _distinct(far, count)


def _distinct(points: Sequence[FloatArray], count: int) -> FloatArray:
    """Points (m, n) without those that are there already, in their order."""
    kept: list[FloatArray] = []
    for point in points:
        if all(np.abs(point - one).max() >= SAME for one in kept):
            kept.append(point)
    return np.array(kept).reshape(len(kept), count)
