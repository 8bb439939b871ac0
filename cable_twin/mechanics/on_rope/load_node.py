"""Vehicle joint at a mesh node that follows the vehicle: contact force, force along the rope, choice of the node.

The joint is at r of the node, and turns with the mean r_x of both slopes there. Along the rope acts what the elements
beside the node give (`rope.patch`), against drive, friction and end stop: Q_X = |r_x| f_t, with the mean |r_x|. Of an
inextensible rope that is λ·r_x = |r_x| f_t, the last row of the paper's eq. 16.
"""

from __future__ import annotations

from math import copysign, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import no_turn
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    dot,
    load,
    product,
    scale,
    store,
    transpose,
    unit_matrix,
)
from cable_twin.mechanics.on_rope.buffer import couple_neighbours, stop_force
from cable_twin.mechanics.on_rope.friction import along_and_across, friction_force
from cable_twin.mechanics.on_rope.hand_over import hand_over
from cable_twin.mechanics.on_rope.hinge import Above, hinge, is_hinged
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.on_rope.tangent_hinge import (
    moment_by_slope,
    spin_by_slope,
    tangent_orientation,
    turn_by_slope,
)
from cable_twin.mechanics.on_rope.tower import contact_force
from cable_twin.mechanics.on_rope.vehicle_impedance import impedance_at_pivot
from cable_twin.mechanics.rope.following_nodes import (
    give_back,
    put_node,
    stand_still,
    take_node,
)
from cable_twin.mechanics.rope.patch import both_slopes, mean_slope, pull_at_node
from cable_twin.mechanics.rope.point import (
    AFTER,
    BEFORE,
    add_column,
    add_matrix,
    add_row,
    clamp_row,
    element_at,
    point_at,
)
from cable_twin.mechanics.rope.point_load import force_along

LEAST = 0.015  # of the shortest element: room that a node keeps to its neighbours
AT_END = 0.5  # of the element at an end of a moving rope: room that a node keeps to the end


@inlined_kernel
def rope_passing(coordinates, node, like):
    """Stretched length per arc length (-) of rope that passes a moving load's node: mean |r_x| of both sides."""
    before, after = both_slopes(coordinates, node, like)
    return 0.5 * (sqrt(dot(before, before)) + sqrt(dot(after, after)))


@inlined_kernel
def direction_at_node(state, node, like):
    """Orientation of the rope at a node that follows a moving load, and its angular velocity, as `hinge.Above`."""
    r_x = mean_slope(state.nodes.position, node, like)
    turning = mean_slope(state.nodes.velocity, node, like)
    return Above(tangent_orientation(r_x), product(turn_by_slope(r_x), turning))


@kernel
def follow_joints(state):
    """Move all nodes that follow a moving load to the load's joint, and set the lengths of the elements beside them."""
    for node in range(1, state.node_load.size - 1):
        number = state.node_load[node]
        if number >= 0:
            s = state.joints.position[number]
            if state.node_follows[number]:
                put_node(state, node, s)
                state.joint_element[number] = node - 1
            else:
                state.joint_element[number] = node - 1 if s < state.mesh.arc_length[node] else node


@inlined_kernel
def hang_at_node(system, state, carriage, rate_factor, stiffness_factor, work):
    """Add force and impedance of a vehicle at a node to its equations (patch); needs chain and drive condensed."""
    carriages, like = system.carriages, system.cable.gravity
    dim, node, first = len(like), state.joint_node[carriage], system.carriages.body_offset[carriage]
    patch, last = work.patch[carriage], work.patch.shape[1]
    place, along = 2 * dim, 5 * dim
    r_x = mean_slope(state.nodes.position, node, like)
    vehicle = impedance_at_pivot(system, state, carriage, work)
    force = vehicle.force
    add_matrix(vehicle.by_place, patch, place, place)
    add_column(scale(-1.0, add_scaled(1.0, force, vehicle.left)), patch, place, last)
    if state.clamp_holds[carriage]:  # rows and columns of its force F: the rope bears λ - F, and r stays with the clamp
        one = unit_matrix(like)
        add_matrix(scale(-1.0, one), patch, place, clamp_row(dim))
        add_matrix(one, patch, clamp_row(dim), place)
    if is_hinged(carriages, first):
        add_node_hinge(system, state, carriage, vehicle, r_x, rate_factor, stiffness_factor, work)
    if work.along_held[carriage]:
        if system.buffers.present:
            couple_neighbours(system, state, carriage, scale(0.0, like), work)
        return
    s, s_dot = state.joints.position[carriage], state.joints.velocity[carriage]
    _, tangential, normal_force, normal = along_and_across(force, r_x)
    passing = rope_passing(state.nodes.position, node, like)
    f_stop, stop_by_s, stop_by_s_dot = stop_force(carriages, system.cable, carriage, s, s_dot)
    f_friction, friction_by_s, friction_by_s_dot, by_normal = friction_force(carriages, state, carriage, normal)
    f_t = work.given_force[carriage] + f_friction + f_stop
    direction = scale(1.0 / max(normal, 1e-12), normal_force)
    patch[along, last] += passing * (f_t + by_normal * dot(direction, vehicle.left))
    stiff = stiffness_factor * (stop_by_s + friction_by_s) + rate_factor * (stop_by_s_dot + friction_by_s_dot)
    patch[along, along] -= passing * stiff
    by_place = product(transpose(vehicle.by_place), direction)
    add_row(scale(-passing * by_normal, by_place), patch, along, place)
    if system.buffers.present:
        couple_neighbours(system, state, carriage, scale(passing * by_normal, direction), work)
    if state.clamp_holds[carriage]:
        add_row(scale(passing * by_normal, direction), patch, along, clamp_row(dim))
    turned = scale(tangential * by_normal, direction)
    for row in (BEFORE, AFTER):
        side = load(state.nodes.position[node, row], like)
        by_slope = add_scaled(-f_t / sqrt(dot(side, side)), side, turned)
        add_row(scale(0.5 * stiffness_factor, by_slope), patch, along, (2 + row) * dim)


@inlined_kernel
def add_node_hinge(system, state, carriage, vehicle, r_x, rate_factor, stiffness_factor, work):
    """Add the hinge of a vehicle at a node, with the mean of the node's slopes, to the equations of the node (patch).

    The terms are those of `tangent_hinge`.
    """
    like, node = system.cable.gravity, state.joint_node[carriage]
    dim, still, patch, last = len(like), no_turn(like), work.patch[carriage], work.patch.shape[1]
    above = direction_at_node(state, node, like)
    first = system.carriages.body_offset[carriage]
    joint = hinge(system.carriages, state, first, True, above, stiffness_factor, rate_factor, like)
    g, turning = turn_by_slope(r_x), mean_slope(state.nodes.velocity, node, like)
    rated = joint.steep[1] > 0.0 and joint.by_turn[0][0] > 0.0
    share = stiffness_factor * joint.steep[1] / joint.by_turn[0][0] if rated else 0.0
    turned = scale(0.5, add_scaled(share, spin_by_slope(turning, r_x), g))  # of the rope, by either slope
    store(turned, work.grip_row[carriage, 0])
    store(still, work.grip_by_s[carriage])
    residual = add_scaled(1.0, joint.moment, vehicle.moment_left)
    by_turn, by_place = product(vehicle.by_turn, turned), scale(0.5, product(transpose(g), vehicle.moment_by_place))
    stiff = scale(0.25 * stiffness_factor, moment_by_slope(joint.moment, r_x))
    both = add_scaled(1.0, stiff, scale(0.5, product(transpose(g), product(vehicle.moment_by_turn, turned))))
    for i in range(2):
        row = (3 + i) * dim
        add_matrix(by_turn, patch, 2 * dim, row)
        add_matrix(by_place, patch, row, 2 * dim)
        add_matrix(both, patch, row, 3 * dim)
        add_matrix(both, patch, row, 4 * dim)
        add_column(scale(-0.5, product(residual, g)), patch, row, last)


@kernel
def pull_along(system, state, carriage):
    """Force (N) along the rope that holds a vehicle's joint at a node: Q_X of both elements over mean |r_x|.

    Q_X of a force on the rope is that against a shift of the node, so that of a point load is less its `force_along`.
    Connectors to another rope on these elements are left out.
    """
    cable, towers, like, node = system.cable, system.towers, system.cable.gravity, state.joint_node[carriage]
    total = pull_at_node(system, state, node)
    first, last = state.mesh.arc_length[node - 1], state.mesh.arc_length[node + 1]
    for k in range(cable.load_arc_length.size):
        if first <= cable.load_arc_length[k] <= last:
            point = point_at(cable, state, cable.load_arc_length[k])
            total -= force_along(state, node, load(cable.load_force[k], like), point, like)
    for contact in range(towers.stiffness.size):
        if first <= state.contact_arc_length[contact] <= last:
            point = point_at(cable, state, state.contact_arc_length[contact])
            force, _ = contact_force(cable, towers, state, contact)
            total -= force_along(state, node, force, point, like)
    return total / rope_passing(state.nodes.position, node, like)


# of an element, that a load goes from the place of its node before the next one takes it over: with long steps earlier
HOLD, LEAST_HOLD, STEPS_AHEAD = 0.7, 0.55, 4.0
BESIDE = 0.05  # of an element, within which the node of a connector follows a load
FARTHEST = 3  # nodes from a load that comes onto the rope, among which one is found to follow it


@kernel
def seat_loads(system, state):
    """Return the nodes of loads that have left a rope, and find nodes for those that have come onto it."""
    for node in range(1, state.node_load.size - 1):
        if state.node_load[node] >= 0 and not rides(system, state, state.node_load[node]):
            give_back(system, state, node)
    for carriage in range(state.joint_node.size):
        if rides(system, state, carriage) and state.joint_node[carriage] < 0:
            find_node(system, state, carriage)


@kernel
def update_load_nodes(system, state):
    """Reassign the nodes that follow loads on a rope, before a step, as loads have come, moved along it or left.

    Nodes stay as they are after a step: what is taken from a node leaves a wave in the accelerations of its rope, which
    is no wave of forces that are read then.
    """
    last, places, room = state.node_load.size - 1, state.mesh.arc_length, LEAST * system.cable.cell_length
    for node in range(1, last):
        number = state.node_load[node]
        if number >= 0:
            s, way = state.joints.position[number], system.solver.step * abs(state.joints.velocity[number])
            beyond = s + copysign(way + min(way, room), state.joints.velocity[number])  # farther than the next step
            at_end = is_at_end(system, s) and is_at_end(system, beyond)
            if not rides(system, state, number):
                give_back(system, state, node)
            elif state.node_follows[number]:
                ahead = room + way  # so that no step takes it there
                near = s - places[node - 1] < ahead or places[node + 1] - s < ahead
                near = near or at_end
                if state.clamp_holds[number] and (near or beside_other(state, node)):
                    give_back(system, state, node)
                elif near:
                    stand_still(system, state, node)
            elif s < places[node - 1] or s > places[node + 1]:
                give_back(system, state, node)
            elif not at_end and places[node - 1] + 2.0 * room <= s <= places[node + 1] - 2.0 * room:
                if abs(s - places[node]) < room + way:  # some step takes it there
                    take_node(system, state, number, node, s, True)
                else:
                    give_back(system, state, node)
    for node in range(last - 2, 0, -1):
        if state.node_load[node] >= 0 and state.node_load[node + 1] < 0:
            pass_on(system, state, node, 1)
    for node in range(2, last):
        if state.node_load[node] >= 0 and state.node_load[node - 1] < 0:
            pass_on(system, state, node, -1)
    seat_loads(system, state)


@kernel
def follow_moved_joints(system, state):
    """Reassign nodes to loads that were moved off their nodes, without moving the rope; return whether any was."""
    last, moved = state.node_load.size - 1, False
    for node in range(1, last):
        number = state.node_load[node]
        if number >= 0 and state.node_follows[number]:
            moved |= abs(state.joints.position[number] - state.mesh.arc_length[node]) > 0.0
    for node in range(1, last):
        if moved and state.node_load[node] >= 0:
            give_back(system, state, node)
    for carriage in range(state.joint_node.size):
        if moved and rides(system, state, carriage):
            find_node(system, state, carriage)
    return moved


@inlined_kernel
def is_at_end(system, s):
    """Return whether a moving load at an arc length (m) of a moving rope is too near an end for a node to follow it.

    At the end a load followed exactly would lose its bend, and the rope its transverse speed, in no time. Instead its
    node stands in the middle of the last element, and the load goes on over one short cubic. A load that comes from
    there is followed before it passes that node: its weight has bent the rope there, and it would be thrown up.
    """
    homes, last = system.cable.node_arc_length, system.cable.node_arc_length.size - 1
    return system.moving_cable.moving and (s < end_room(homes, 0) or s > homes[last] - end_room(homes, last - 1))


@inlined_kernel
def end_room(homes, element):
    """Length (m) at an end of a moving rope, in its first or last element, in which no node follows a moving load."""
    return AT_END * (homes[element + 1] - homes[element])


@inlined_kernel
def beside_other(state, node):
    """Return whether either neighbour of an inner node follows a moving load."""
    return state.node_load[node - 1] >= 0 or state.node_load[node + 1] >= 0


@inlined_kernel
def hold_of(system, state, node, way, element):
    """Share (-) of an element, `element` (m) long, that a load travels before the next node takes over following it.

    The load is handed over at least a few steps before the next node: with fewer steps the short element ahead of the
    load oscillates, and in the end the load's own node would stand still. The node of a connector takes a load that is
    near alone, as the connector bends the rope there.
    """
    number, joined = state.node_load[node], system.cable.node_joined
    ahead = LEAST * system.cable.cell_length + STEPS_AHEAD * system.solver.step * abs(state.joints.velocity[number])
    if joined[node] or joined[node + way]:
        near = max(BESIDE, ahead / element)
        return near if joined[node] else 1.0 - near
    return min(HOLD, max(LEAST_HOLD, 1.0 - ahead / element))


@kernel
def pass_on(system, state, front, way):
    """Hand a train of adjacent moving loads on to the next nodes, once its nodes are far from home arc lengths."""
    homes, places, beyond, node = system.cable.node_arc_length, state.mesh.arc_length, 0.0, front
    room = LEAST * system.cable.cell_length
    while 0 < node < places.size - 1 and state.node_load[node] >= 0:
        gone = way * (places[node] - homes[node])
        element = way * (homes[node + way] - homes[node])
        beyond += gone / element - hold_of(system, state, node, way, element)
        free = gone > room and way * (homes[node] - places[node - way]) > room
        if free and beyond > 0.0:
            hand_over(system, state, min(node, front), max(node, front), way)
            return
        node -= way


@inlined_kernel
def middle_of(joined, element):
    """Share (-) of an element up to which its first node is chosen to follow a load; less for a connector's node."""
    if joined[element] == joined[element + 1]:
        return 0.5
    return BESIDE if joined[element] else 1.0 - BESIDE


@kernel
def find_node(system, state, carriage):
    """Find a free node, in the order of the moving loads, to follow a vehicle that has come onto the rope."""
    s, last, homes = state.joints.position[carriage], state.node_load.size - 1, system.cable.node_arc_length
    element = element_at(system.cable, state, s)
    state.joint_element[carriage] = element
    room, follow = LEAST * system.cable.cell_length, not is_at_end(system, s)
    if not follow:
        s = max(min(s, homes[last] - end_room(homes, last - 1)), end_room(homes, 0))
    share = (s - homes[element]) / (homes[element + 1] - homes[element])
    nearest = element if share < middle_of(system.cable.node_joined, element) else element + 1
    nearest = min(max(nearest, 1), last - 1)
    way = 1
    if state.node_load[nearest] >= 0 and state.joints.position[state.node_load[nearest]] > s:
        way = -1
    node = nearest
    for _ in range(FARTHEST):
        if not 0 < node < last:
            return
        if state.node_load[node] < 0:
            free = not (state.clamp_holds[carriage] and beside_other(state, node))
            if free and state.mesh.arc_length[node - 1] + room < s < state.mesh.arc_length[node + 1] - room:
                take_node(system, state, carriage, node, s, follow)
            return
        if way * (state.joints.position[state.node_load[node]] - s) > 0.0:
            return
        node += way
