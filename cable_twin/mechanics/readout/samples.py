"""Sampled shape of the rope."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cable_twin.mechanics.drives.pull import joint_forces
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import dot, load, scale, store, subtract
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.on_rope.sliding_joint import compliance_of_joint
from cable_twin.mechanics.parameters import Cable, FloatArray, IntArray
from cable_twin.mechanics.rope.joint_compliance import has_joint_compliance
from cable_twin.mechanics.rope.point import interpolate, point_at, position_on_cable

KINK_REACH = 0.25  # of an element: a parabola from there to the joint has the slope that is lacking there


@kernel
def store_in_space(vector, row):
    """Write a vector (dim,) into `row` (3,): the first entry along the track, the last one upwards."""
    row[0], row[1], row[2] = vector[0], 0.0, vector[-1]
    if len(vector) == 3:
        row[1] = vector[1]


@kernel
def store_beside(vector, lateral, row):
    """Write a vector (dim,) into `row` (3,) like `store_in_space`; in a plane with y at `lateral` (m)."""
    store_in_space(vector, row)
    if len(vector) == 2:
        row[1] = lateral


@by_reference
class Places(NamedTuple):
    """Sample places on a rope, with their elements and shape functions."""

    arc_length: FloatArray  # (n,) m
    element: IntArray  # (n,) that holds each
    shape: FloatArray  # (n, 4) S there: - for positions, m for slopes
    share: FloatArray  # (n,) from 0 at the first node of the element to 1 at the second one
    rising: bool  # whether none is before the one that it comes after


def places_on(cable: Cable, state: Any, arc_lengths: FloatArray) -> Places:
    """Sample places at `arc_lengths` (n,) in m."""
    count = arc_lengths.size
    places = Places(
        arc_length=np.array(arc_lengths, dtype=np.float64),
        element=np.zeros(count, dtype=np.int64),
        shape=np.zeros((count, 4)),
        share=np.zeros(count),
        rising=bool(np.all(np.diff(arc_lengths) >= 0.0)),
    )
    find_places(cable, state, places)
    return places


@kernel
def find_places(cable, state, places):
    """Fill elements and shape functions of sample places from their arc lengths."""
    for k in range(places.arc_length.size):
        point = point_at(cable, state, places.arc_length[k])
        places.element[k] = point.element
        store(point.shape, places.shape[k])
        x = places.arc_length[k] - state.mesh.arc_length[point.element]
        places.share[k] = x / state.mesh.length[point.element]


@kernel
def sample_positions(cable, state, places, positions):
    """Fill `positions` (n, 3) in m at all places."""
    if cable.load_nodes:
        find_places(cable, state, places)
    for k in range(places.arc_length.size):
        shape = load(places.shape[k], (0.0, 0.0, 0.0, 0.0))
        store_in_space(interpolate(state.nodes.position, places.element[k], shape, cable.gravity), positions[k])


@kernel
def sample_shape(system, state, places, positions):
    """Fill `positions` (n, 3) in m at all places, with sharp kinks under vehicles if joints are compliant."""
    cable, arc_lengths, rising = system.cable, places.arc_length, places.rising
    sample_positions(cable, state, places, positions)
    for carriage in range(system.carriages.fixed.size if has_joint_compliance(cable) else 0):
        if rides(system, state, carriage):
            way = compliance_of_joint(cable, state, carriage, joint_forces(system, state, carriage)[0]).displacement
            place, reach = (
                state.joints.position[carriage],
                KINK_REACH * state.mesh.length[state.joint_element[carriage]],
            )
            for k in range(first_from(arc_lengths, place - reach) if rising else 0, arc_lengths.size):
                off = arc_lengths[k] - place
                if abs(off) < reach:
                    share = 1.0 - abs(off) / reach
                    bend_down(cable, state, arc_lengths[k], scale(share * share, way), positions[k])
                elif rising and off > 0.0:
                    break


@inlined_kernel
def first_from(numbers, least):
    """Index of the first of rising numbers not below `least`."""
    low, high = 0, numbers.size
    while low < high:
        middle = (low + high) // 2
        if numbers[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def bend_down(cable, state, arc_length, way, position):
    """Displace a sample (3,) in m by the kink `way` (dim,) in m from its element, unless displaced further already."""
    like, base = cable.gravity, position_on_cable(cable, state, arc_length)
    now = load(position, like) if len(like) == 3 else (position[0], position[2])
    moved = subtract(base, now)
    if dot(way, way) > dot(moved, moved):
        store_in_space(subtract(base, way), position)


@kernel
def joint_place(system, state, carriage):
    """Position (dim,) in m of the joint of a vehicle, at its sharp kink on the rope."""
    cable = system.cable
    place = position_on_cable(cable, state, state.joints.position[carriage])
    if has_joint_compliance(cable) and rides(system, state, carriage):
        way = compliance_of_joint(cable, state, carriage, joint_forces(system, state, carriage)[0]).displacement
        place = subtract(place, way)
    return place
