"""Section forces of the rope, tension from section forces, and reactions of supports.

The strain of a cubic element oscillates over three elements beside a load. The forces of an element on the positions
of its nodes do not: Newton's method balances them node by node. So the section force G at a node A is the nodal force
there of the element after it, with inertia and weight, and the share of A in all point loads on that element. Within an
element

    F(s) = G_A - u (G_A - G_B - Σ P) - Σ P_(before s) + ρA u_r² / λ r_s,   u from 0 to 1,

P being the point loads on it: the section force falls by P at each of them, and evenly by the distributed load. The
last term is the momentum flux of a moving rope, which is in no nodal force (`rope.ale`). The tension is |F|, with the
sign of F·r_s: it includes the shear force that the bending stiffness of a rope carries where it is bent sharply.
"""

from __future__ import annotations

from math import inf, isnan, nan, sqrt
from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.drives.joint_drive import joint_forces
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import WIDTH, spread
from cable_twin.mechanics.language.vectors import accumulate, add_scaled, dot, load, scale, store, subtract
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.on_rope.sliding_joint import tangent_moment_force
from cable_twin.mechanics.on_rope.tower import contact_force
from cable_twin.mechanics.parameters import FloatArray, IntArray, System
from cable_twin.mechanics.rope.ale import flows, rest_stretch
from cable_twin.mechanics.rope.element import forces_of_elements, strand_now
from cable_twin.mechanics.rope.patch import beside_load, nodal_force
from cable_twin.mechanics.rope.point import point_at, point_on, slope

NONE = -1  # no further point load on an element
SMALL = 1e-160


@by_reference
class Sections(NamedTuple):
    """Section forces and point loads of a rope, filled by `recover_sections`."""

    node_force: FloatArray  # (nodes, dim) N, G at each node: of what is after it on what is before
    node_tension: FloatArray  # (nodes,) N
    lanes: FloatArray  # (dim, WIDTH) N, scratch of a group of elements
    first: IntArray  # (elements,) number of a point load on each, or NONE
    following: IntArray  # (point loads,) number of another one on the same element, or NONE
    place: FloatArray  # (point loads,) m, arc length
    force: FloatArray  # (point loads, dim) N on the rope
    given: IntArray  # (1,) how many of them, the first ones, other ropes have given


def allocate_sections(system: System, given: int = 0) -> Sections:
    """Allocate the section forces of a rope, with room for `given` point loads that other ropes exert on it."""
    elements, dim = system.cable.element_count, len(system.cable.gravity)
    places = given + system.cable.load_arc_length.size + system.carriages.fixed.size + system.towers.stiffness.size
    return Sections(
        node_force=np.zeros((elements + 1, dim)),
        node_tension=np.zeros(elements + 1),
        lanes=np.zeros((dim, WIDTH)),
        first=np.full(elements, NONE, dtype=np.int64),
        following=np.full(places, NONE, dtype=np.int64),
        place=np.zeros(places),
        force=np.zeros((places, dim)),
        given=np.zeros(1, dtype=np.int64),
    )


@inlined_kernel
def give(sections, arc_length, force):
    """Register a point load (dim,) in N that another rope exerts at an arc length (m)."""
    number = sections.given[0]
    sections.given[0] = number + 1
    sections.place[number] = arc_length
    store(force, sections.force[number])


@inlined_kernel
def own_count(system):
    """Number of a rope's own point loads: given loads, vehicles, contacts of towers."""
    return system.cable.load_arc_length.size + system.carriages.fixed.size + system.towers.stiffness.size


@inlined_kernel
def own_place(system, state, number):
    """Arc length (m) of a rope's own point load `number`; NaN for a vehicle off the rope."""
    loads, carriages = system.cable.load_arc_length.size, system.carriages.fixed.size
    if number < loads:
        return system.cable.load_arc_length[number]
    if number < loads + carriages:
        return state.joints.position[number - loads] if rides(system, state, number - loads) else nan
    return state.contact_arc_length[number - loads - carriages]


@kernel
def own_force(system, state, number):
    """Force (dim,) in N of a rope's own point load `number` on the rope."""
    loads, carriages = system.cable.load_arc_length.size, system.carriages.fixed.size
    if number < loads:
        return load(system.cable.load_force[number], system.cable.gravity)
    if number < loads + carriages:
        return scale(-1.0, joint_forces(system, state, number - loads)[0])
    return contact_force(system.cable, system.towers, state, number - loads - carriages)[0]


@kernel
def recover_sections(system, state, sections):
    """Compute the section forces and nodal tensions of a rope, including the given forces of other ropes."""
    cable, like, last = system.cable, system.cable.gravity, system.cable.element_count - 1
    strand = strand_now(system, state)
    for first in range(0, cable.element_count, WIDTH):
        spread(forces_of_elements(system, state, strand, first, 0), sections.lanes, 0)
        for lane in range(min(WIDTH, cable.element_count - first)):
            store(load(sections.lanes[:, lane], like), sections.node_force[first + lane])
            if beside_load(cable, state, first + lane):
                store(nodal_force(system, state, first + lane, 0), sections.node_force[first + lane])
            sections.first[first + lane] = NONE
    store(scale(-1.0, nodal_force(system, state, last, 2)), sections.node_force[last + 1])
    given = sections.given[0]
    for number in range(given):
        add_point_load(cable, state, sections, number)
    for own in range(own_count(system)):
        place, number = own_place(system, state, own), given + own
        if not isnan(place):
            sections.place[number] = place
            store(own_force(system, state, own), sections.force[number])
            add_point_load(cable, state, sections, number)
    for carriage in range(system.carriages.fixed.size):
        if rides(system, state, carriage):
            element = state.joint_element[carriage]
            accumulate(tangent_moment_force(system, state, carriage, 0), sections.node_force[element])
            if element == last:
                accumulate(scale(-1.0, tangent_moment_force(system, state, carriage, 2)), sections.node_force[last + 1])
    find_node_tensions(system, state, sections)


@kernel
def add_point_load(cable, state, sections, number):
    """Register a point load on its element, and add its shares to the section forces at the nodes."""
    point = point_at(cable, state, sections.place[number])
    force = load(sections.force[number], cable.gravity)
    sections.following[number], sections.first[point.element] = sections.first[point.element], number
    accumulate(scale(point.shape[0], force), sections.node_force[point.element])
    if point.element == cable.element_count - 1:
        accumulate(scale(-point.shape[2], force), sections.node_force[point.element + 1])


@kernel
def find_node_tensions(system, state, sections):
    """Compute the tension at all nodes from their section forces."""
    like, going = system.cable.gravity, momentum_of(system, state)
    for node in range(system.cable.element_count + 1):
        section, r_s = load(sections.node_force[node], like), load(state.nodes.position[node, 1], like)
        section = with_momentum(system, going, state.mesh.arc_length[node], r_s, section)
        sections.node_tension[node] = signed_size(section, r_s)


@inlined_kernel
def momentum_of(system, state):
    """Terms of a rope's momentum flux: whether it moves, mass ρA / λ (kg/m), speed u at the start (m/s), du/ds."""
    cable, speed = system.cable, state.rope.velocity
    if not (system.moving_cable.moving and flows(system, state)):
        return False, 0.0, 0.0, 0.0
    mass = cable.mass_per_length / rest_stretch(cable, state)
    return True, mass, speed[0], (speed[1] - speed[0]) / cable.unstrained_length


@inlined_kernel
def with_momentum(system, going, arc_length, r_s, section):
    """Section force (dim,) in N at an arc length (m), plus the momentum flux ρA u² / λ r_s of a moving rope."""
    if system.moving_cable.moving and going[0]:
        speed = going[2] + going[3] * arc_length
        return add_scaled(going[1] * speed * speed, r_s, section)
    return section


@inlined_kernel
def signed_size(section, r_s):
    """Tension (N) from a section force (dim,): its length, negative in compression along r_s (dim,)."""
    tension = sqrt(dot(section, section))
    if tension == inf:  # the square was too large a number, in a motion that blows up
        small = scale(SMALL, section)
        tension = sqrt(dot(small, small)) / SMALL
    return tension if dot(section, r_s) >= 0.0 else -tension


@kernel
def sections_beside(system, state, sections, element, arc_length):
    """Section forces (dim,) in N of a rope at an arc length (m) on an element with point loads, and its slope there.

    Returns:
        Section force before a load at that place; after it; r_s (dim,).
    """
    like = system.cable.gravity
    on_element, before, at = scale(0.0, like), scale(0.0, like), scale(0.0, like)
    number = sections.first[element]
    while number != NONE:
        force, place = load(sections.force[number], like), sections.place[number]
        on_element = add_scaled(1.0, force, on_element)
        if place < arc_length:
            before = add_scaled(1.0, force, before)
        elif place == arc_length:
            at = add_scaled(1.0, force, at)
        number = sections.following[number]
    here, there = load(sections.node_force[element], like), load(sections.node_force[element + 1], like)
    u = (arc_length - state.mesh.arc_length[element]) / state.mesh.length[element]
    along = subtract(subtract(here, there), on_element)
    r_s = slope(state.nodes.position, point_on(state, element, arc_length), like)
    section = subtract(add_scaled(-u, along, here), before)
    section = with_momentum(system, momentum_of(system, state), arc_length, r_s, section)
    return section, subtract(section, at), r_s


@kernel
def tensions_beside(system, state, sections, element, arc_length):
    """Tension (N) of a rope at an arc length (m) on an element with point loads: before and after a load there."""
    before, after, r_s = sections_beside(system, state, sections, element, arc_length)
    return signed_size(before, r_s), signed_size(after, r_s)


@kernel
def tension_over_load(system, state, sections, carriage):
    """Lower tension of the rope beside a vehicle over the force across the rope between both; NaN without such a force.

    That force is the jump of the section force from one side to the other, across the bisector of its two directions.
    """
    place = state.joints.position[carriage]
    element = point_at(system.cable, state, place).element
    before, after, _ = sections_beside(system, state, sections, element, place)
    one, other = sqrt(dot(before, before)), sqrt(dot(after, after))
    if not (one > 0.0 and other > 0.0):
        return nan
    bisector = add_scaled(1.0 / one, before, scale(1.0 / other, after))
    jump, square = subtract(after, before), dot(bisector, bisector)
    if not square > 0.0:
        return nan
    across = add_scaled(-dot(jump, bisector) / square, bisector, jump)
    size = sqrt(dot(across, across))
    return min(one, other) / size if size > 0.0 else nan


@kernel
def sample_tensions(system, state, sections, places, tensions):
    """Fill `tensions` (n,) in N of a rope at sample points, at a point load the one before it; needs section forces.

    Between nodes without a load the tension is almost linear.
    """
    for k in range(places.arc_length.size):
        element = places.element[k]
        if sections.first[element] != NONE:
            tensions[k] = tensions_beside(system, state, sections, element, places.arc_length[k])[0]
        else:
            here, there = sections.node_tension[element], sections.node_tension[element + 1]
            tensions[k] = here + places.share[k] * (there - here)


@kernel
def tension_range(system, state, sections, lowest, highest):
    """Write `lowest` and `highest` (2,) tension (N) of the rope and its arc length (m); needs the section forces.

    Nodes count, and both sides of every point load but tower contacts, over which the tension changes gradually.
    """
    cable, contacts = system.cable, first_contact(system, sections)
    lowest[0], highest[0] = inf, -inf
    for node in range(cable.element_count + 1):
        take_tension(sections.node_tension[node], state.mesh.arc_length[node], lowest, highest)
        number = sections.first[node] if node < cable.element_count else NONE
        while number != NONE:
            if number < contacts:
                place = sections.place[number]
                before, after = tensions_beside(system, state, sections, node, place)
                take_tension(before, place, lowest, highest)
                take_tension(after, place, lowest, highest)
            number = sections.following[number]


@inlined_kernel
def take_tension(tension, arc_length, lowest, highest):
    """Update `lowest` and `highest` (2,) with a tension (N) at an arc length (m)."""
    if tension < lowest[0]:
        lowest[0], lowest[1] = tension, arc_length
    if tension > highest[0]:
        highest[0], highest[1] = tension, arc_length


@inlined_kernel
def first_contact(system, sections):
    """Index of the first tower contact among the point loads of a rope."""
    return sections.given[0] + system.cable.load_arc_length.size + system.carriages.fixed.size


@kernel
def tower_force(system, sections, tower):
    """Force (dim,) in N of a tower on the rope; needs the section forces."""
    total = scale(0.0, system.cable.gravity)
    before = first_contact(system, sections)
    for contact in range(system.towers.contact_offset[tower], system.towers.contact_offset[tower + 1]):
        total = add_scaled(1.0, load(sections.force[before + contact], total), total)
    return total


@kernel
def end_force(system, state, end):
    """Force (dim,) in N of the support at `end` on the cable, by equilibrium of its node, without other ropes.

    Contact forces are taken as they are, so that a drive that has just been changed does not show in them yet.
    """
    element, row = (0, 0) if end == 0 else (system.cable.element_count - 1, 2)
    total = nodal_force(system, state, element, row)
    for own in range(own_count(system)):
        place = own_place(system, state, own)
        if not isnan(place):
            point = point_at(system.cable, state, place)
            share = point.shape[row]
            if point.element == element and share != 0.0:
                total = add_scaled(share, own_force(system, state, own), total)
    for carriage in range(system.carriages.fixed.size):
        if rides(system, state, carriage) and state.joint_element[carriage] == element:
            total = add_scaled(1.0, tangent_moment_force(system, state, carriage, row), total)
    return scale(-1.0, total)


__all__ = [
    "NONE",
    "Sections",
    "allocate_sections",
    "end_force",
    "give",
    "recover_sections",
    "sample_tensions",
    "tension_over_load",
    "tension_range",
    "tower_force",
]
