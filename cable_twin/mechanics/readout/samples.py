"""The rope at some of its places: where it is."""

from __future__ import annotations

from cable_twin.mechanics.drives.pull import joint_forces
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import dot, load, scale, subtract
from cable_twin.mechanics.on_rope.sliding_joint import joint_kink
from cable_twin.mechanics.rope.kink import has_kinks
from cable_twin.mechanics.rope.point import position_on_cable

KINK_REACH = 0.25  # of an element: a parabola from there to the joint has the slope that is lacking there


@kernel
def store_in_space(vector, row):
    """Write a vector (dim,) into `row` (3,): the first entry along the track, the last one upwards."""
    row[0], row[1], row[2] = vector[0], 0.0, vector[-1]
    if len(vector) == 3:
        row[1] = vector[1]


@kernel
def sample_positions(cable, state, arc_lengths, positions):
    """Fill `positions` (n, 3) in m at `arc_lengths` (n,) in m."""
    for k in range(arc_lengths.size):
        store_in_space(position_on_cable(cable, state, arc_lengths[k]), positions[k])


@kernel
def sample_shape(system, state, arc_lengths, positions):
    """The same, with the kinks under vehicles that elements round off where they are sharp."""
    cable = system.cable
    sample_positions(cable, state, arc_lengths, positions)
    for carriage in range(system.carriages.fixed.size if has_kinks(cable) else 0):
        if state.attached[carriage]:
            way = joint_kink(cable, state, carriage, joint_forces(system, state, carriage)[0]).way
            reach = KINK_REACH * cable.element_length[state.joint_element[carriage]]
            for k in range(arc_lengths.size):
                off = abs(arc_lengths[k] - state.joints.position[carriage])
                if off < reach:
                    share = 1.0 - off / reach
                    bend_down(cable, state, arc_lengths[k], scale(share * share, way), positions[k])


@kernel
def bend_down(cable, state, arc_length, way, position):
    """Put a point (3,) in m of the rope by `way` (dim,) in m beside its element, where it is not further away yet."""
    like, base = cable.gravity, position_on_cable(cable, state, arc_length)
    now = load(position, like) if len(like) == 3 else (position[0], position[2])
    moved = subtract(base, now)
    if dot(way, way) > dot(moved, moved):
        store_in_space(subtract(base, way), position)


@kernel
def sample_joints(system, state, positions):
    """Fill `positions` (vehicles, 3) in m with the places where vehicles hang on the rope, in their kinks."""
    cable = system.cable
    sample_positions(cable, state, state.joints.position, positions)
    for carriage in range(system.carriages.fixed.size if has_kinks(cable) else 0):
        if state.attached[carriage]:
            way = joint_kink(cable, state, carriage, joint_forces(system, state, carriage)[0]).way
            place = position_on_cable(cable, state, state.joints.position[carriage])
            store_in_space(subtract(place, way), positions[carriage])
