"""One-sided elastic contact with damping: end stops, counterweights, towers, and buffers between vehicles.

After Hunt and Crossley (1975) the force is f(d) (1 + c ḋ) over the depth d, never pulling, so that it starts from zero.
f has the stiffness k, which sets in over a toe d_0: k d² / 2 d_0 up to it, and k (d - d_0 / 2) beyond.

The force between two vehicles on one rope is an internal one: equal, opposite and in one line, it acts on their joints
and not on the rope, as a haul rope's pull does; the rope takes λ less the push. Depth d = room - |r_2 - r_1| of both
joints, so that its potential is that of the buffer, and linear and angular momentum are kept.

Newton's tangent has J = -∂F/∂(p_1 - p_2) of a pair for both joints (`pair_tangent`). Where their nodes follow each
other, one patch has both, and J is in it whole (`couple_neighbours`). Elsewhere vehicles are eliminated one by one:
`predict_contacts` solves for their displacements along the rope as if that stood still, each meets its neighbours
there, and `contact_error` lets the iteration go on for the remainder, the displacement of the rope itself.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import larger
from cable_twin.mechanics.language.traced import if_less
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    dot,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    transpose,
    unit_matrix,
)
from cable_twin.mechanics.on_rope.friction import friction_force
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.rope.patch import at_node, mean_slope
from cable_twin.mechanics.rope.point import R, add_matrix, add_row, point_on, slope, value

ALMOST_MET = 0.1  # times the room: joints that are nearer are pressed almost through each other
LEAST_TOE = 1e-30  # m, for a division where there is no toe
CLOSEST = 1e-3  # m between the joints of two vehicles: if they are nearer, they are pressed through each other


@kernel
def buffer_force(stiffness, toe, damping, depth, depth_rate):
    """One-sided contact force (N), its derivatives by depth (N/m), rate (N s/m); softer up to a depth `toe` (m).

    `stiffness` is in N/m, `damping` in s/m. All are numbers, or SIMD lanes.
    """
    hysteresis = 1.0 + damping * depth_rate
    depth, over = larger(depth, 0.0), larger(toe, LEAST_TOE)
    elastic = if_less(depth, toe, 0.5 * stiffness * depth * depth / over, stiffness * (depth - 0.5 * toe))
    stiff = if_less(depth, toe, stiffness * depth / over, stiffness)
    return (
        if_less(0.0, depth, if_less(0.0, hysteresis, elastic * hysteresis, 0.0), 0.0),
        if_less(0.0, depth, if_less(0.0, hysteresis, stiff * hysteresis, 0.0), 0.0),
        if_less(0.0, depth, if_less(0.0, hysteresis, elastic * damping, 0.0), 0.0),
    )


@kernel
def buffer_energy(stiffness, toe, depth):
    """Elastic energy (J) of a one-sided contact: the integral of its elastic force f over the depth (m)."""
    if not depth > 0.0:
        return 0.0
    if depth < toe:
        return stiffness * depth * depth * depth / (6.0 * toe)
    return 0.5 * stiffness * (depth * (depth - toe) + toe * toe / 3.0)


@kernel
def stop_force(carriages, cable, carriage, s, s_dot):
    """Force (N) of the end stops along the cable on a vehicle at arc length s (m), its derivatives by s and ṡ."""
    stroke = carriages.stop_stroke[carriage]
    sign, depth = 1.0, stroke - s
    if s > 0.5 * cable.unstrained_length:
        sign, depth = -1.0, s - (cable.unstrained_length - stroke)
    stiffness, damping = carriages.stop_stiffness[carriage], carriages.stop_damping[carriage]
    force, by_depth, by_rate = buffer_force(stiffness, 0.0, damping, depth, -sign * s_dot)
    return sign * force, -by_depth, -by_rate


FAR = 2.0  # times the room: farther along the rope than that two do not touch, however it is bent
FORCE_NOW, HIGHEST, CLOSING, LAST = 0, 1, 2, 3  # columns of `State.push`
SAME = 0.5  # s: who touches again within that has bounced, and not met anew
SWEEPS = 12  # of a system of one number a vehicle, in which inertia outweighs the buffers
LEAST_SPEED = 0.01  # m/s, slower than that two which have met before only lean on each other anew


@inlined_kernel
def place_and_velocity(cable, state, carriage):
    """Position (dim,) in m and velocity (dim,) in m/s of a vehicle's joint on the rope."""
    if at_node(cable, state, carriage):
        node = state.joint_node[carriage]
        return load(state.nodes.position[node, R], cable.gravity), load(state.nodes.velocity[node, R], cable.gravity)
    point, like = point_on(state, state.joint_element[carriage], state.joints.position[carriage]), cable.gravity
    moving = value(state.nodes.velocity, point, like)
    velocity = add_scaled(state.joints.velocity[carriage], slope(state.nodes.position, point, like), moving)
    return value(state.nodes.position, point, like), velocity


class Contact(NamedTuple):
    """Buffer contact of two vehicles: compression d = contact distance - |b|, its rate, and b from joint to joint."""

    depth: float  # d (m), -inf where they are far from each other
    rate: float  # ḋ (m/s)
    way: Any  # w = b / |b| (dim,) to the other one; behind it, away from it
    turning: Any  # ẇ (dim,) in 1/s
    distance: float  # |b| (m), negative where one is behind the other


@kernel
def press(system, state, carriage, entry):
    """Buffer contact (`Contact`) of a vehicle with one of the vehicles that it may touch."""
    buffers, other = system.buffers, system.buffers.other[entry]
    apart = buffers.side[entry] * (state.joints.position[other] - state.joints.position[carriage])
    still = scale(0.0, system.cable.gravity)
    if not apart < FAR * buffers.room[entry]:
        return Contact(-inf, 0.0, still, still, inf)
    here, velocity = place_and_velocity(system.cable, state, carriage)
    there, other_velocity = place_and_velocity(system.cable, state, other)
    between = subtract(there, here)
    distance = sqrt(dot(between, between))
    if distance == 0.0:
        return Contact(buffers.room[entry], 0.0, still, still, inf)
    if apart < 0.0:
        distance = -distance
    way, parting = scale(1.0 / distance, between), subtract(other_velocity, velocity)
    rate = -dot(way, parting)
    turning = scale(1.0 / distance, add_scaled(rate, way, parting))
    return Contact(buffers.room[entry] - distance, rate, way, turning, distance)


@inlined_kernel
def pressed_force(buffers, entry, depth, rate):
    """Buffer force (N) between two vehicles and its derivatives by compression and rate, see `buffer_force`."""
    return buffer_force(buffers.stiffness[entry], 0.0, buffers.damping[entry], depth, rate)


@kernel
def push_on(system, state, carriage):
    """Total buffer force (dim,) in N of all neighbours on a vehicle, at its joint."""
    buffers, force = system.buffers, scale(0.0, system.cable.gravity)
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        contact = press(system, state, carriage, entry)
        force = add_scaled(-pressed_force(buffers, entry, contact.depth, contact.rate)[0], contact.way, force)
    return force


@kernel
def pair_tangent(buffers, entry, contact, rate_factor, stiffness_factor):
    """Tangent J (dim²) in N/m of the buffer force between two vehicles by the relative displacement of their joints.

    The force on either joint changes by J Δ(position of the other less its own). With F = -N w, N(d, ḋ), and velocities
    that change in proportion to positions,
    J = (N_d + N_ḋ ∂/∂t) w wᵀ + N_ḋ w ẇᵀ - N (1 - w wᵀ) / |b|. Where the joints have almost met, w is no smooth function
    of the positions any more, and is taken as constant.
    """
    size, by_depth, by_rate = pressed_force(buffers, entry, contact.depth, contact.rate)
    way = contact.way
    if abs(contact.distance) < ALMOST_MET * buffers.room[entry]:
        return outer(stiffness_factor * by_depth + rate_factor * by_rate, way, way)
    across = stiffness_factor * size / contact.distance
    along = stiffness_factor * by_depth + rate_factor * by_rate + across
    turned = add_scaled(1.0, outer(along, way, way), outer(stiffness_factor * by_rate, way, contact.turning))
    return add_scaled(-across, unit_matrix(way), turned)


@inlined_kernel
def in_one_patch(system, state, carriage, other):
    """Return whether two vehicles are at adjacent nodes that follow them, and so share a block of equations (patch)."""
    cable = system.cable
    if at_node(cable, state, carriage) and at_node(cable, state, other):
        return abs(state.joint_node[carriage] - state.joint_node[other]) == 1
    return False


@kernel
def predict_contacts(system, state, rate_factor, stiffness_factor, work):
    """Store tangents of buffers in contact; predict displacements of touching vehicles that share no patch (equations).

    Needs chains and drives condensed.
    """
    buffers, like, apart = system.buffers, system.cable.gravity, False
    square = outer(0.0, like, like)
    for carriage in range(work.pressed.size):
        work.pressed[carriage] = False
        for axis in range(len(like)):
            work.foreseen_move[carriage, axis] = 0.0
        if not belongs(system, state, carriage):
            continue
        for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
            contact = press(system, state, carriage, entry)
            work.touching[entry] = pressed_force(buffers, entry, contact.depth, contact.rate)[0] > 0.0
            if work.touching[entry]:
                tangent = pair_tangent(buffers, entry, contact, rate_factor, stiffness_factor)
                store(tangent, work.pressed_tangent[entry])
                work.pressed[carriage] = True
                apart = apart or not in_one_patch(system, state, carriage, buffers.other[entry])
            else:
                store(square, work.pressed_tangent[entry])
    for carriage in range(work.pressed.size):
        work.pressed[carriage] = work.pressed[carriage] and apart
        if work.pressed[carriage]:
            condense_along(system, state, carriage, rate_factor, stiffness_factor, work)
    for _ in range(SWEEPS if apart else 0):  # Gauss-Seidel
        for carriage in range(work.pressed.size):
            if work.pressed[carriage] and not work.driven[carriage]:
                way = load(work.foreseen_way[carriage], like)
                stiff, right = work.foreseen[carriage, 0], work.foreseen[carriage, 1]
                for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
                    by_place = product(way, load(work.pressed_tangent[entry], square))
                    stiff += dot(by_place, way)
                    right += dot(by_place, load(work.foreseen_move[buffers.other[entry]], like))
                store(scale(right / stiff if stiff > 0.0 else 0.0, way), work.foreseen_move[carriage])


@kernel
def condense_along(system, state, carriage, rate_factor, stiffness_factor, work):
    """Condense a vehicle in buffer contact to motion along the rope: stiffness and inertia (N/m), and force (N)."""
    cable, carriages, like = system.cable, system.carriages, system.cable.gravity
    s, s_dot = state.joints.position[carriage], state.joints.velocity[carriage]
    if at_node(cable, state, carriage):
        r_x = mean_slope(state.nodes.position, state.joint_node[carriage], like)
    else:
        r_x = slope(state.nodes.position, point_on(state, state.joint_element[carriage], s), like)
    norm = sqrt(dot(r_x, r_x))
    way, first = scale(1.0 / norm, r_x), carriages.body_offset[carriage]
    store(way, work.foreseen_way[carriage])
    if work.driven[carriage]:
        store(scale(work.sliding_increment[carriage], r_x), work.foreseen_move[carriage])
        return
    force = subtract(load(state.multipliers[first], like), push_on(system, state, carriage))
    change = load(work.impedance_force[first], like)
    stiff = dot(way, product(load(work.impedance[first], outer(0.0, like, like)), way))
    if work.haul_by_way[carriage] != 0.0:
        pull = load(work.haul_direction[carriage], like)
        force = add_scaled(-work.haul_force[carriage] - work.haul_change[carriage], pull, force)
        stiff -= work.haul_by_way[carriage] * dot(pull, way) ** 2
    along = dot(force, way)
    across = add_scaled(-along, way, force)
    friction, by_s, by_s_dot, _ = friction_force(carriages, state, carriage, sqrt(dot(across, across)))
    stop, stop_by_s, stop_by_s_dot = stop_force(carriages, cable, carriage, s, s_dot)
    stiff -= (stiffness_factor * (by_s + stop_by_s) + rate_factor * (by_s_dot + stop_by_s_dot)) / norm
    work.foreseen[carriage, 0] = stiff
    work.foreseen[carriage, 1] = work.given_force[carriage] + friction + stop - along - dot(change, way)


@kernel
def with_neighbours(system, state, carriage, force, impedance, work):
    """Contact force (dim,) in N and impedance D of a vehicle, with the buffers of its neighbours added.

    Neighbours outside its patch are displaced as `predict_contacts` predicts.
    """
    buffers, like = system.buffers, system.cable.gravity
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        if not work.touching[entry]:
            continue
        contact, other = press(system, state, carriage, entry), buffers.other[entry]
        tangent = load(work.pressed_tangent[entry], impedance)
        push = pressed_force(buffers, entry, contact.depth, contact.rate)[0]
        force = add_scaled(push, contact.way, force)
        if not in_one_patch(system, state, carriage, other):
            force = subtract(force, product(tangent, load(work.foreseen_move[other], like)))
        impedance = add_scaled(1.0, tangent, impedance)
    return force, impedance


@kernel
def couple_neighbours(system, state, carriage, by_force, work):
    """Add the buffer coupling of a vehicle and neighbours at adjacent nodes to their common block of equations (patch).

    Args:
        system: parameters.
        state: where to linearise.
        carriage: whose rows these are, of its place and along the rope.
        by_force: derivative (dim,) of the row along the rope by the contact force; 0 where s is given.
        work: with the patches.
    """
    buffers, like = system.buffers, system.cable.gravity
    dim, node = len(like), state.joint_node[carriage]
    own, square = 5 * dim + 1, outer(0.0, like, like)
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        other = buffers.other[entry]
        if not (work.touching[entry] and in_one_patch(system, state, carriage, other)):
            continue
        patch, here, there, along = work.patch[carriage], 2 * dim, own, 5 * dim
        if state.joint_node[other] < node:  # the patch of the first of them has both
            patch, here, there, along = work.patch[other], own, 2 * dim, own + 3 * dim
        tangent = load(work.pressed_tangent[entry], square)
        add_matrix(scale(-1.0, tangent), patch, here, there)
        add_row(product(transpose(tangent), by_force), patch, along, there)


@kernel
def contact_error(system, state, work, increment, previous):
    """Estimated error (m) that a Newton iteration leaves in vehicles whose buffers touch; 0 where it is exact.

    Args:
        system: parameters.
        state: after the increment.
        work: with what was pressed before it.
        increment: last Newton increment (m), and the error where a contact has begun or ended with it.
        previous: the one before it (m), 0 without; with both, the error of vehicles whose displacement is predicted.
    """
    buffers, error = system.buffers, 0.0
    for carriage in range(work.pressed.size if buffers.present else 0):
        if not belongs(system, state, carriage):
            continue
        if work.pressed[carriage]:
            error = max(error, increment * increment / previous if previous > 0.0 else inf)
        for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
            contact = press(system, state, carriage, entry)
            if (pressed_force(buffers, entry, contact.depth, contact.rate)[0] > 0.0) != work.touching[entry]:
                error = max(error, increment)
    return error


@kernel
def buffers_energy(system, state, carriage):
    """Elastic energy (J) of the buffers between a vehicle and the vehicles after it on the rope."""
    energy, buffers = 0.0, system.buffers
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        if buffers.side[entry] > 0.0:
            depth = press(system, state, carriage, entry).depth
            energy += buffer_energy(buffers.stiffness[entry], 0.0, depth)
    return energy


@kernel
def settle_buffers(system, state):
    """End a step: store buffer forces and contacts of each vehicle with the vehicles after it on the rope."""
    buffers = system.buffers
    for carriage in range(state.push.shape[0]):
        if not belongs(system, state, carriage):
            continue
        total, closing, speed, partner = 0.0, 0.0, 0.0, -1
        for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
            if buffers.side[entry] > 0.0:
                contact = press(system, state, carriage, entry)
                if contact.depth > 0.0:
                    total += pressed_force(buffers, entry, contact.depth, contact.rate)[0]
                    partner, speed = buffers.other[entry], contact.rate
                elif contact.depth > -inf:
                    closing = max(closing, contact.rate)
        push, touch = state.push[carriage], state.touch[carriage]
        clock = state.clock[0] + 1.0
        if partner >= 0 and (push[LAST] == 0.0 or (clock - push[LAST]) * system.solver.step > SAME):
            speed = max(speed, push[CLOSING])  # as before the buffers slowed them in this step
            if speed > LEAST_SPEED or touch[0] != partner + 1:
                touch[0], touch[1], touch[2] = partner + 1, state.joints.position[carriage], speed
                touch[3] = clock
        push[FORCE_NOW], push[HIGHEST] = total, max(push[HIGHEST], total)
        push[CLOSING] = closing
        if partner >= 0:
            push[LAST] = clock
