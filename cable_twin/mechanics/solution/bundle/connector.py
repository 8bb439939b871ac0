"""Connectors between two ropes, and the part β K of the Rayleigh damping of ropes, as in EN 50318.

A connector is massless: a dropper, or a slack carrier. Its ends are at nodes of both meshes. While a moving load has
taken such a node, that end is at the same arc length on an element beside the load, and the coupling of both ends is
left out of the tangent: there a Newton iteration leaves as much of the increment as the stiffness of the connector has
of that of the ropes, hardly a hundredth in time integration.

The second end of a connector that rolls, as that of a slack carrier, is where its rope is nearest to the first end: its
energy is that of the least distance, and by the envelope theorem its force is that along this distance, square to the
rope, at that place. Its tangent couples both ends as if the rope between node and place were straight and rigid.

The damping is C = α M + β K, K of the static tension: bending has damping of its own already (`damping_time` of the
elastic model); β adds the stiffness that a string has by its tension T, β T ∫S_xᵀS_x dx. α is in the elements
(`element`).
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    dot,
    full,
    load,
    outer,
    scale,
    store,
    subtract,
    symmetric,
    transpose,
)
from cable_twin.mechanics.rope.ale import nodal_vectors
from cable_twin.mechanics.rope.following_nodes import at_place
from cable_twin.mechanics.rope.patch import motion_at_rest
from cable_twin.mechanics.rope.point import bend, point_at, slope, value
from cable_twin.mechanics.rope.point_load import add_point_load, add_point_tangent
from cable_twin.mechanics.rope.shape_functions import SLOPE
from cable_twin.mechanics.solution.bundle.records import STATE, SYSTEM, rope_of

ROLLS_FAR = 2  # in `Connectors.rolls`: it rolls, but so far that both ends are not coupled in the tangent
GRADUAL = 1e-3  # m, extension over which damping sets in: a pull that jumps by it would have no place to rest in a step
MOST_TURNS, ROLLED = 20, 1e-9  # of Newton's method for the place of a roller; m, after which the next is of rounding
LEAST_BEND = 0.2  # share of r_x² that its derivative has at least, where the rope bends around the first end


@inlined_kernel
def is_taken(here, node):
    """Return whether a node follows a moving load, so that it is away from the rope point where a connector ends."""
    return here.node_load[node] >= 0


@inlined_kernel
def at_end(bundle, connector, end, place, system, state, like):
    """Position (dim,) in m and velocity (dim,) in m/s of the rope at one end, 0 or 1, of a connector at a place (m)."""
    own = bundle.records[bundle.connectors.rope[connector, end]]
    here, node = record_at(own[STATE], state), bundle.connectors.node[connector, end]
    if not is_off_node(bundle.connectors, connector, end, here):
        return load(here.nodes.position[node, 0], like), load(here.nodes.velocity[node, 0], like)
    cable = record_at(own[SYSTEM], system).cable
    point = point_at(cable, here, place)
    e, v, _ = motion_at_rest(cable, here, point.element, here.nodes.acceleration, here.joints.acceleration)
    return at_place(e, point.shape, point.shape_x)[0], at_place(v, point.shape, point.shape_x)[0]


@inlined_kernel
def is_off_node(connectors, connector, end, here):
    """Return whether an end of a connector is at a place on an element and not at its node."""
    return (end == 1 and connectors.rolls[connector] != 0) or is_taken(here, connectors.node[connector, end])


@kernel
def place_of(bundle, connector, system, state, like):
    """Arc length (m) of the second end of a connector: that of its node, or if it rolls that nearest to the first end.

    Newton's method for the root of (r - r_first)·r_x, from the node on.
    """
    connectors = bundle.connectors
    own = bundle.records[connectors.rope[connector, 1]]
    cable, here = record_at(own[SYSTEM], system).cable, record_at(own[STATE], state)
    nodes = cable.node_arc_length
    place = nodes[connectors.node[connector, 1]]
    if connectors.rolls[connector] == 0:
        return place
    beside = record_at(bundle.records[connectors.rope[connector, 0], SYSTEM], system).cable
    first, _ = at_end(bundle, connector, 0, beside.node_arc_length[connectors.node[connector, 0]], system, state, like)
    for _ in range(MOST_TURNS):
        point = point_at(cable, here, place)
        apart = subtract(value(here.nodes.position, point, like), first)
        r_x, r_xx = slope(here.nodes.position, point, like), bend(here.nodes.position, point, like)
        change = dot(apart, r_x) / max(dot(r_x, r_x) + dot(apart, r_xx), LEAST_BEND * dot(r_x, r_x))
        place = min(max(place - change, nodes[0]), nodes[nodes.size - 1])
        if abs(change) < ROLLED:
            break
    return place


@inlined_kernel
def connector_force(bundle, connector, system, state, like):
    """Pull (N) of a connector, its tangent, its direction from first to second end, and its length (m).

    Returns:
        Pull, its derivatives by distance (N/m) and by the rate of that (N s/m), unit vector (dim,), distance, the part
        (dim,) across of the velocity of the second end, as the first one sees it, in m/s, and the arc lengths (m) of
        both ends.
    """
    connectors = bundle.connectors
    own = record_at(bundle.records[connectors.rope[connector, 0], SYSTEM], system)
    places = (
        own.cable.node_arc_length[connectors.node[connector, 0]],
        place_of(bundle, connector, system, state, like),
    )
    first, first_speed = at_end(bundle, connector, 0, places[0], system, state, like)
    second, second_speed = at_end(bundle, connector, 1, places[1], system, state, like)
    apart = subtract(second, first)
    distance = sqrt(dot(apart, apart))
    along = scale(1.0 / distance, apart)
    moving = subtract(second_speed, first_speed)
    rate = dot(along, moving)
    across = add_scaled(-rate, along, moving)
    longer = distance - connectors.length[connector]
    if longer > 0.0:
        share = min(longer / GRADUAL, 1.0)
        stiffness, damping = connectors.stiffness[connector], share * connectors.damping[connector]
        pull = stiffness * longer + damping * rate
        if share < 1.0:
            stiffness = max(stiffness + connectors.damping[connector] / GRADUAL * rate, 0.0)
        return pull, stiffness, damping, along, distance, across, places
    stiffness = connectors.compression[connector]
    return stiffness * longer, stiffness, 0.0, along, distance, across, places


@kernel
def add_connectors(bundle, moving, scratch, system, state, work, rate_factor, stiffness_factor, like):
    """Add force and tangent of all connectors to their end nodes; store the coupling of both nodes in `scratch.cross`.

    Returns:
        Number of connectors that have begun or ceased to pull since the last call.
    """
    connectors, changed = bundle.connectors, 0
    for connector in range(connectors.length.size):
        pull, stiffness, damping, along, distance, across, places = connector_force(
            bundle, connector, system, state, like
        )
        radial = stiffness_factor * stiffness + rate_factor * damping
        turned = stiffness_factor * pull / distance
        matrix = full(1.0, symmetric(turned, radial - turned, along), 0.0)
        matrix = add_scaled(1.0, outer(stiffness_factor * damping / distance, along, across), matrix)
        nothing = scale(0.0, matrix)
        by_turn, of_turn = nothing, nothing
        if connectors.rolls[connector] != 0:  # d(F e) = ... - F / d r_x dX, dX = -(r_x·dr + d e·dr_x) / G
            own, here, _ = rope_of(bundle, connectors.rope[connector, 1], system, state, work)
            point = point_at(own.cable, here, places[1])
            r_x, r_xx = slope(here.nodes.position, point, like), bend(here.nodes.position, point, like)
            rolled = stiffness_factor * pull / (dot(r_x, r_x) + distance * dot(along, r_xx))
            matrix = add_scaled(1.0, outer(-rolled / distance, r_x, r_x), matrix)
            by_turn, of_turn = outer(-rolled, r_x, along), outer(-rolled * distance, along, along)
        coupled, lever = 1.0, 0.0  # of both nodes; m along the rope from that of the second end to its place
        for end in range(2):
            own, here, room = rope_of(bundle, connectors.rope[connector, end], system, state, work)
            node, force = connectors.node[connector, end], scale(pull if end == 0 else -pull, along)
            if is_off_node(connectors, connector, end, here):
                point, turned_to = point_at(own.cable, here, places[end]), by_turn if end == 1 else nothing
                turns = (transpose(turned_to), of_turn if end == 1 else nothing)
                add_point_load(force, point, here, room)
                add_point_tangent(force, (matrix, turned_to), turns, point, stiffness_factor, here, room)
                if end == 0 or is_taken(here, node) or connectors.rolls[connector] == ROLLS_FAR:
                    coupled = 0.0
                else:
                    lever = places[1] - own.cable.node_arc_length[node]
            else:
                accumulate(force, room.right_side[node, 0])
                accumulate(matrix, room.diagonal[node, 0, 0])
        store(scale(-coupled, matrix), scratch.cross[connector, 0, 0])
        store(scale(-coupled, matrix), scratch.cross[connector, 0, 1])
        if connectors.rolls[connector] != 0:
            store(scale(-coupled, add_scaled(lever, matrix, by_turn)), scratch.cross[connector, 1, 0])
            store(scale(-coupled, add_scaled(lever, matrix, transpose(by_turn))), scratch.cross[connector, 1, 1])
        tight = 1 if distance > connectors.length[connector] else 0
        changed += abs(tight - moving.tight[connector])
        moving.tight[connector] = tight
    return changed


@kernel
def connector_forces(bundle, system, state, like, forces):
    """Write the pull (connectors,) in N of all connectors into an array."""
    for connector in range(bundle.connectors.length.size):
        forces[connector] = connector_force(bundle, connector, system, state, like)[0]


@kernel
def damp_rope(cable, tension_time, state, work, rate_factor):
    """Add the Rayleigh damping β K of one rope to its residual and tangent.

    Args:
        cable: its parameters.
        tension_time: β T, N s.
        state: its motion.
        work: takes the result.
        rate_factor: as in `assemble`.
    """
    for element in range(cable.element_count):
        length = state.mesh.length[element]
        rates = nodal_vectors(state.nodes.velocity, element, cable.gravity)
        matrices = work.diagonal, work.upper, work.lower
        damp_element(element, length, tension_time / length, rates, rate_factor, *matrices, work.right_side)


@formula
def damp_element(element, length, tension, rates, rate_factor, diagonal, upper, lower, right_side):
    """Add the Rayleigh damping of an element's tension, β T / length (N s/m), for an element not beside a load."""
    for i in range(4):
        total = 0.0 * rates[i]
        for j in range(4):
            damping = tension * SLOPE[i][j]
            for _ in range(i % 2 + j % 2):
                damping = length * damping
            total = total - damping * rates[j]
            array = diagonal if i // 2 == j // 2 else upper if i // 2 == 0 else lower
            node = element + (i // 2 if i // 2 == j // 2 else 0)
            for axis in range(len(total)):
                entry = axis * (len(total) + 1)
                known = array[node, i % 2, j % 2, entry]
                array[node, i % 2, j % 2, entry] = known + rate_factor * damping
        accumulate(total, right_side[element + i // 2, i % 2])
