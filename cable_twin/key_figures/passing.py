"""Least clearance between vehicles on different ropes in space that pass each other, with the wind at its time.

A vehicle is the boxes of its bodies, as they are drawn; one without a box is the bar between its pins. Distances of
boxes are exact; between two looks, `CLEARANCE_PERIOD` of `measures` apart, nothing is seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement
from math import nan
from typing import Annotated, NamedTuple

import numpy as np

from cable_twin.geometry.bodies import body_box, body_outline
from cable_twin.key_figures.extremes import EXTREME
from cable_twin.key_figures.stops import groups_of
from cable_twin.mechanics.language import declared
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.declared import Of
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.vehicles import Body


@by_reference
class PassingExtremes(NamedTuple):
    """Least clearances between two groups of vehicles so far; the pair is first * groups + second."""

    clearance: Annotated[FloatArray, Of("pair", EXTREME, unit="m", first=nan)]  # with the arc length of one of both
    pair: Annotated[IntArray, Of("pair", 2)]  # vehicles at that time
    memory: declared.Memory


@by_reference
class Boxes(NamedTuple):
    """Bounding boxes of all bodies, groups of their vehicles, and scratch arrays."""

    group: IntArray  # (vehicles,) all carriers are one
    first_body: IntArray  # (vehicles + 1,)
    middle: FloatArray  # (bodies, 3) m, of its box in its axes
    body_half: FloatArray  # (bodies, 3) m, half the length of that along its axes
    centre: FloatArray  # (2, 3) m, scratch
    axes: FloatArray  # (2, 3, 3), scratch
    half: FloatArray  # (2, 3) m, scratch
    corners: FloatArray  # (2, 8, 3) m, scratch


class Hull(NamedTuple):
    """Bounding box of a body in its axes, from the centre of mass without payload."""

    middle: FloatArray  # (3,) m
    half: FloatArray  # (3,) m


def hull_of(body: Body) -> Hull:
    """Bounding box of a body; for a bar, a box of width 0."""
    box = body_box(body)
    if box is not None:
        return Hull(np.zeros(3), 0.5 * box)
    line = body_outline(body)
    low, high = line.min(axis=0), line.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return Hull(np.array([middle[0], 0.0, middle[1]]), np.array([half[0], 0.0, half[1]]))


def boxes_of(scenario: Scenario) -> Boxes:
    """Bounding boxes of the bodies of a scenario."""
    vehicles = list(scenario.vehicles.values())
    hulls = [hull_of(body) for one in vehicles for body in one.bodies.values()]
    return Boxes(
        group=np.minimum(np.arange(len(vehicles)), len(groups_of(scenario)) - 1),
        first_body=np.cumsum([0, *(len(one.bodies) for one in vehicles)]),
        middle=np.array([hull.middle for hull in hulls]).reshape(-1, 3),
        body_half=np.array([hull.half for hull in hulls]).reshape(-1, 3),
        centre=np.zeros((2, 3)),
        axes=np.zeros((2, 3, 3)),
        half=np.zeros((2, 3)),
        corners=np.zeros((2, 8, 3)),
    )


def no_passing_extremes(scenario: Scenario) -> PassingExtremes:
    """Clearances of a scenario before its first frame."""
    return declared.allocate(PassingExtremes, {"pair": len(groups_of(scenario)) ** 2})


def pairs_of(scenario: Scenario) -> Iterator[tuple[int, int, int]]:
    """Yield the row of each pair of groups of vehicles, and the numbers of both groups."""
    count = len(groups_of(scenario))
    for one, other in combinations_with_replacement(range(count), 2):
        yield one * count + other, one, other
