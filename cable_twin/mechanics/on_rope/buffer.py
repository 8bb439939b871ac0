"""One-sided elastic contact with damping: end stops, counterweights, towers, and buffers between vehicles.

After Hunt and Crossley (1975) the force is f(d) (1 + c ḋ) over the depth d, never pulling, so that it starts from zero.
f has the stiffness k, which sets in over a toe d_0: k d² / 2 d_0 up to it, and k (d - d_0 / 2) beyond.

The force between two vehicles on one rope is an internal one: equal, opposite and in one line, it acts on their joints
and not on the rope, as a haul rope's pull does; the rope takes λ less the push. Depth d = room - |r_2 - r_1| of both
joints, so that its potential is that of the buffer, and linear and angular momentum are kept.

In Newton's tangent each vehicle has its own share, F' u uᵀ. That of its neighbour would couple vehicles, which are
eliminated one by one. Instead, `predict_contacts` solves for their displacements along the rope as if that stood still,
and each meets its neighbours there; `contact_error` lets the iteration go on for the remainder, the displacement of the
rope itself.
"""

from __future__ import annotations

from math import inf, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, outer, product, scale, subtract
from cable_twin.mechanics.on_rope.friction import friction_force
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.rope.patch import at_node, mean_slope
from cable_twin.mechanics.rope.point import R, point_on, slope, value

CLOSEST = 1e-3  # m between the joints of two vehicles: if they are nearer, they are pressed through each other


@kernel
def buffer_force(stiffness, toe, damping, depth, depth_rate):
    """Contact force (N), and its derivatives by depth (N/m) and rate (N s/m); k in N/m, c in s/m, d_0 in m."""
    hysteresis = 1.0 + damping * depth_rate
    if not (depth > 0.0 and hysteresis > 0.0):
        return 0.0, 0.0, 0.0
    if depth < toe:
        elastic, stiff = 0.5 * stiffness * depth * depth / toe, stiffness * depth / toe
    else:
        elastic, stiff = stiffness * (depth - 0.5 * toe), stiffness
    return elastic * hysteresis, stiff * hysteresis, elastic * damping


@kernel
def buffer_energy(stiffness, toe, depth):
    """Elastic energy (J) of a contact: the integral of f over the depth (m)."""
    if not depth > 0.0:
        return 0.0
    if depth < toe:
        return stiffness * depth * depth * depth / (6.0 * toe)
    return 0.5 * stiffness * (depth * (depth - toe) + toe * toe / 3.0)


@kernel
def stop_force(carriages, cable, carriage, s, s_dot):
    """Force (N) of the end stops along the cable on a carriage at s (m), and its derivatives by s and ṡ."""
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
    """Position (dim,) in m and velocity (dim,) in m/s of a joint."""
    if at_node(cable, state, carriage):
        node = state.joint_node[carriage]
        return load(state.nodes.position[node, R], cable.gravity), load(state.nodes.velocity[node, R], cable.gravity)
    point, like = point_on(state, state.joint_element[carriage], state.joints.position[carriage]), cable.gravity
    moving = value(state.nodes.velocity, point, like)
    velocity = add_scaled(state.joints.velocity[carriage], slope(state.nodes.position, point, like), moving)
    return value(state.nodes.position, point, like), velocity


@kernel
def press(system, state, carriage, entry):
    """Compression (m) of the buffers of two vehicles, its rate (m/s), and the direction (dim,) to the other one."""
    buffers, other = system.buffers, system.buffers.other[entry]
    apart = buffers.side[entry] * (state.joints.position[other] - state.joints.position[carriage])
    still = scale(0.0, system.cable.gravity)
    if not apart < FAR * buffers.room[entry]:
        return -inf, 0.0, still
    here, velocity = place_and_velocity(system.cable, state, carriage)
    there, other_velocity = place_and_velocity(system.cable, state, other)
    between = subtract(there, here)
    distance = sqrt(dot(between, between))
    if distance == 0.0:
        return buffers.room[entry], 0.0, still
    if apart < 0.0:
        distance = -distance
    way = scale(1.0 / distance, between)
    return buffers.room[entry] - distance, dot(way, subtract(velocity, other_velocity)), way


@inlined_kernel
def pressed_force(buffers, entry, depth, rate):
    """Buffer force (N) of a pair of vehicles and its derivatives, see `buffer_force`."""
    return buffer_force(buffers.stiffness[entry], 0.0, buffers.damping[entry], depth, rate)


@kernel
def push_on(system, state, carriage, rate_factor, stiffness_factor):
    """Buffer force (dim,) in N of all neighbours on a vehicle at its joint, and its negative tangent (dim²)."""
    buffers, like = system.buffers, system.cable.gravity
    force, tangent = scale(0.0, like), outer(0.0, like, like)
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        depth, rate, way = press(system, state, carriage, entry)
        size, by_depth, by_rate = pressed_force(buffers, entry, depth, rate)
        force = add_scaled(-size, way, force)
        stiff = stiffness_factor * by_depth + rate_factor * by_rate
        tangent = add_scaled(1.0, outer(stiff, way, way), tangent)
    return force, tangent


@kernel
def predict_contacts(system, state, rate_factor, stiffness_factor, work):
    """Predict in `foreseen` the displacement of vehicles in buffer contact; needs chains and drives condensed."""
    buffers, any_pressed = system.buffers, False
    for carriage in range(work.pressed.size):
        work.pressed[carriage], work.foreseen[carriage, 2] = False, 0.0
        if not belongs(system, state, carriage):
            continue
        for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
            depth, rate, _ = press(system, state, carriage, entry)
            force, by_depth, by_rate = pressed_force(buffers, entry, depth, rate)
            work.pressed_stiffness[entry] = stiffness_factor * by_depth + rate_factor * by_rate
            if force > 0.0:
                work.pressed[carriage] = True
        if work.pressed[carriage]:
            any_pressed = True
            condense_along(system, state, carriage, rate_factor, stiffness_factor, work)
    for _ in range(SWEEPS if any_pressed else 0):  # Gauss-Seidel
        for carriage in range(work.pressed.size):
            if work.pressed[carriage] and not work.driven[carriage]:
                stiff, right = work.foreseen[carriage, 0], work.foreseen[carriage, 1]
                for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
                    stiff += work.pressed_stiffness[entry]
                    right += work.pressed_stiffness[entry] * work.foreseen[buffers.other[entry], 2]
                work.foreseen[carriage, 2] = right / stiff if stiff > 0.0 else 0.0


@kernel
def condense_along(system, state, carriage, rate_factor, stiffness_factor, work):
    """Condense a vehicle in buffer contact along the rope: stiffness and inertia (N/m), and force (N)."""
    cable, carriages, like = system.cable, system.carriages, system.cable.gravity
    s, s_dot = state.joints.position[carriage], state.joints.velocity[carriage]
    if at_node(cable, state, carriage):
        r_x = mean_slope(state.nodes.position, state.joint_node[carriage], like)
    else:
        r_x = slope(state.nodes.position, point_on(state, state.joint_element[carriage], s), like)
    norm = sqrt(dot(r_x, r_x))
    way, first = scale(1.0 / norm, r_x), carriages.body_offset[carriage]
    if work.driven[carriage]:
        work.foreseen[carriage, 2] = norm * work.sliding_increment[carriage]
        return
    push, _ = push_on(system, state, carriage, 0.0, 0.0)
    force = add_scaled(-1.0, push, load(state.multipliers[first], like))
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
    """Contact force (dim,) in N and impedance D of a carriage, with the buffers of its neighbours added.

    The others are where `predict_contacts` has them, along the way between.
    """
    buffers = system.buffers
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        depth, rate, way = press(system, state, carriage, entry)
        push, stiff = pressed_force(buffers, entry, depth, rate)[0], work.pressed_stiffness[entry]
        push -= stiff * buffers.side[entry] * work.foreseen[buffers.other[entry], 2]
        force = add_scaled(push, way, force)
        impedance = add_scaled(1.0, outer(stiff, way, way), impedance)
    return force, impedance


@kernel
def contact_error(system, work, increment, previous):
    """Residual error (m) of linearly converging vehicles in buffer contact; 0 without contact.

    Args:
        system: parameters.
        work: with what is pressed.
        increment: last Newton increment (m).
        previous: the one before it (m), 0 without.
    """
    if system.buffers.present:
        for carriage in range(work.pressed.size):
            if work.pressed[carriage]:
                return increment * increment / previous if previous > 0.0 else inf
    return 0.0


@kernel
def buffers_energy(system, state, carriage):
    """Elastic energy (J) of the buffers between a vehicle and the vehicles after it on the rope."""
    energy, buffers = 0.0, system.buffers
    for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
        if buffers.side[entry] > 0.0:
            depth, _, _ = press(system, state, carriage, entry)
            energy += buffer_energy(buffers.stiffness[entry], 0.0, depth)
    return energy


@kernel
def settle_buffers(system, state):
    """End a step: store buffer forces and touches of each vehicle with the vehicles after it on the rope."""
    buffers = system.buffers
    for carriage in range(state.push.shape[0]):
        if not belongs(system, state, carriage):
            continue
        total, closing, speed, partner = 0.0, 0.0, 0.0, -1
        for entry in range(buffers.offset[carriage], buffers.offset[carriage + 1]):
            if buffers.side[entry] > 0.0:
                depth, rate, _ = press(system, state, carriage, entry)
                if depth > 0.0:
                    total += pressed_force(buffers, entry, depth, rate)[0]
                    partner, speed = buffers.other[entry], rate
                elif depth > -inf:
                    closing = max(closing, rate)
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
