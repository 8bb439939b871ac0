"""The rope at some of its places: where it is, and its tension."""

from __future__ import annotations

from cable_twin.mechanics.drives.pull import joint_forces
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.lanes import WIDTH, spread
from cable_twin.mechanics.language.memory import flat
from cable_twin.mechanics.language.vectors import dot, load, scale, subtract
from cable_twin.mechanics.on_rope.sliding_joint import joint_kink
from cable_twin.mechanics.parameters import Cable
from cable_twin.mechanics.rope.element import group_tension
from cable_twin.mechanics.rope.kink import has_kinks
from cable_twin.mechanics.rope.point import element_at, position_on_cable

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
                share = max(1.0 - abs(arc_lengths[k] - state.joints.position[carriage]) / reach, 0.0)
                if share > 0.0:
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


@kernel
def sample_tensions(cable, state, arc_lengths, tensions, means):
    """Fill `tensions` (n,) in N: linear between the means of the elements, placed at their middles.

    `means` (groups, WIDTH) is scratch, see `groups`. The end elements go on with the slope of their neighbour.
    """
    count, mean = cable.element_count, flat(means)
    for group in range(means.shape[0]):
        spread((group_tension(cable, state, group * WIDTH),), means, group)
    for k in range(arc_lengths.size):
        if count == 1:
            tensions[k] = mean[0]
        else:
            element = element_at(cable, arc_lengths[k])
            left = element if arc_lengths[k] >= middle(cable, element) else element - 1
            left = min(max(left, 0), count - 2)
            place = middle(cable, left)
            share = (arc_lengths[k] - place) / (middle(cable, left + 1) - place)
            tensions[k] = mean[left] + share * (mean[left + 1] - mean[left])


@inlined_kernel
def middle(cable, element):
    """Arc length (m) of the middle of an element."""
    return cable.node_arc_length[element] + 0.5 * cable.element_length[element]


def groups(cable: Cable) -> tuple[int, int]:
    """Shape of the scratch for the means of all elements."""
    return -(-cable.element_count // WIDTH), WIDTH
