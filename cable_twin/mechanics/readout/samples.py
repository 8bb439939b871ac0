"""Positions of the rope at sample points, for output frames."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import load, store
from cable_twin.mechanics.parameters import Cable, FloatArray, IntArray
from cable_twin.mechanics.rope.point import interpolate, point_at, position_on_cable


@kernel
def store_in_space(vector, row):
    """Write a vector (dim,) as x, y, z to `row` (3,): first entry along the track, last one upwards; planar y is 0."""
    row[0], row[1], row[2] = vector[0], 0.0, vector[-1]
    if len(vector) == 3:
        row[1] = vector[1]


@kernel
def store_beside(vector, lateral, row):
    """Write a vector (dim,) as x, y, z into `row` (3,) like `store_in_space`; planar y is `lateral` (m)."""
    store_in_space(vector, row)
    if len(vector) == 2:
        row[1] = lateral


@by_reference
class Places(NamedTuple):
    """Sample points on a rope, with their elements and shape functions."""

    arc_length: FloatArray  # (n,) m
    element: IntArray  # (n,) that holds each
    shape: FloatArray  # (n, 4) S there: - for positions, m for slopes
    share: FloatArray  # (n,) from 0 at the first node of the element to 1 at the second one


def places_on(cable: Cable, state: Any, arc_lengths: FloatArray) -> Places:
    """Create the sample points of a rope at `arc_lengths` (n,) in m."""
    count = arc_lengths.size
    places = Places(
        arc_length=np.array(arc_lengths, dtype=np.float64),
        element=np.zeros(count, dtype=np.int64),
        shape=np.zeros((count, 4)),
        share=np.zeros(count),
    )
    find_places(cable, state, places)
    return places


@kernel
def find_places(cable, state, places):
    """Fill elements and shape functions of sample points on a rope from their arc lengths."""
    for k in range(places.arc_length.size):
        point = point_at(cable, state, places.arc_length[k])
        places.element[k] = point.element
        store(point.shape, places.shape[k])
        x = places.arc_length[k] - state.mesh.arc_length[point.element]
        places.share[k] = x / state.mesh.length[point.element]


@kernel
def sample_positions(cable, state, places, positions):
    """Fill `positions` (n, 3) in m of the rope at all sample points."""
    if cable.load_nodes:
        find_places(cable, state, places)
    for k in range(places.arc_length.size):
        shape = load(places.shape[k], (0.0, 0.0, 0.0, 0.0))
        store_in_space(interpolate(state.nodes.position, places.element[k], shape, cable.gravity), positions[k])


@kernel
def joint_place(system, state, carriage):
    """Position (dim,) in m of the joint of a vehicle on the rope."""
    return position_on_cable(system.cable, state, state.joints.position[carriage])
