"""Sliding joint of cable and vehicle (paper, eq. 14, 15): constraint, friction, drive force, end stops.

Φ = S(s) e - r_p = 0, with s the arc length on the whole cable. s has no inertia; its row is λ·r_x = |r_x| f_t, where
f_t is the force of the cable on the vehicle along itself (the paper has f_t = 0). A driven joint has s given instead,
and its drive force follows from that row. A haul rope pulls the vehicle and not the cable, which bears λ less the pull.
"""

from __future__ import annotations

from math import inf

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import along_track, no_turn
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    block,
    dot,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    transpose,
)
from cable_twin.mechanics.on_rope.buffer import push_on, stop_force
from cable_twin.mechanics.on_rope.friction import along_and_across, friction_force
from cable_twin.mechanics.on_rope.hinge import Above, hinge, hinge_angle, hinge_energy, is_hinged
from cable_twin.mechanics.on_rope.load_node import direction_at_node, hang_at_node, pull_along
from cable_twin.mechanics.on_rope.tangent_hinge import (
    add_tangent_hinge,
    spin_rate_by_velocities,
    tangent_orientation,
    turn_by_slope,
)
from cable_twin.mechanics.on_rope.vehicle_impedance import contact_force, impedance_at_pivot
from cable_twin.mechanics.parameters import JOINT
from cable_twin.mechanics.rope.patch import at_node, mean_slope
from cable_twin.mechanics.rope.point import R, add_block, add_to, bend, coordinate, element_at, point_on, slope, value


@kernel
def place_joint(cable, state, carriage):
    """Find the element that holds a vehicle's joint; explicit integrators change it themselves at a node."""
    if cable.load_nodes and state.joint_node[carriage] >= 0:
        return  # `follow_joints` does
    state.joint_element[carriage] = element_at(cable, state, state.joints.position[carriage])


@inlined_kernel
def joint_point(cable, state, carriage):
    """Point of the rope at a vehicle's joint, on the joint's present element."""
    return point_on(state, state.joint_element[carriage], state.joints.position[carriage])


@kernel
def joint_position(cable, state, carriage):
    """Position S(n) e (dim,) in m of a vehicle's joint on the cable, or that of the node that follows the joint."""
    if at_node(cable, state, carriage):
        return load(state.nodes.position[state.joint_node[carriage], R], cable.gravity)
    return value(state.nodes.position, joint_point(cable, state, carriage), cable.gravity)


@kernel
def joint_tangent(cable, state, carriage):
    """Slope S_x(n) e (dim,) of the cable at a vehicle's joint; mean of both sides of a node that follows the joint."""
    if at_node(cable, state, carriage):
        return mean_slope(state.nodes.position, state.joint_node[carriage], cable.gravity)
    return slope(state.nodes.position, joint_point(cable, state, carriage), cable.gravity)


@kernel
def joint_velocity(cable, state, carriage):
    """Velocity (dim,) in m/s of a vehicle's joint: S ė + ṡ S_x e, or that of the node that follows the joint."""
    if at_node(cable, state, carriage):
        return load(state.nodes.velocity[state.joint_node[carriage], R], cable.gravity)
    point = joint_point(cable, state, carriage)
    moving = value(state.nodes.velocity, point, cable.gravity)
    return add_scaled(state.joints.velocity[carriage], slope(state.nodes.position, point, cable.gravity), moving)


@inlined_kernel
def direction_above(system, state, carriage):
    """Orientation of the cable above a hinged first body (`hinge.Above`); level and at rest above a bare pivot."""
    like = system.cable.gravity
    if is_hinged(system.carriages, system.carriages.body_offset[carriage]):
        return cable_direction(system.cable, state, carriage)
    return Above(tangent_orientation(along_track(like)), no_turn(like))


@inlined_kernel
def cable_direction(cable, state, carriage):
    """Orientation of the cable at a vehicle's joint, and its angular velocity G (S_x ė + ṡ S_xx e) (`hinge.Above`)."""
    if at_node(cable, state, carriage):
        return direction_at_node(state, state.joint_node[carriage], cable.gravity)
    point, like = joint_point(cable, state, carriage), cable.gravity
    r_x = slope(state.nodes.position, point, like)
    turning = slope(state.nodes.velocity, point, like)
    turning = add_scaled(state.joints.velocity[carriage], bend(state.nodes.position, point, like), turning)
    return Above(tangent_orientation(r_x), product(turn_by_slope(r_x), turning))


@inlined_kernel
def tangent_hinge(system, state, carriage, stiffness_factor, rate_factor):
    """Moment and axes (`hinge.Joint`) of the hinge between a vehicle's first body and the tangent of the cable."""
    first, above = system.carriages.body_offset[carriage], cable_direction(system.cable, state, carriage)
    return hinge(system.carriages, state, first, True, above, stiffness_factor, rate_factor, system.cable.gravity)


@kernel
def tangent_moment(system, state, carriage):
    """Moment m (turns,) in N m of the cable on a vehicle's first body, and force m·∂θ/∂s (N) on the coordinate s."""
    first, like = system.carriages.body_offset[carriage], system.cable.gravity
    still = no_turn(like)
    if not is_hinged(system.carriages, first):
        return still, 0.0
    moment = tangent_hinge(system, state, carriage, 0.0, 0.0).moment
    if at_node(system.cable, state, carriage):
        return moment, 0.0
    point = joint_point(system.cable, state, carriage)
    by_slope = turn_by_slope(slope(state.nodes.position, point, like))
    return moment, dot(moment, product(by_slope, bend(state.nodes.position, point, like)))


@kernel
def tangent_moment_force(system, state, carriage, row):
    """Force (dim,) in N of a vehicle's hinge moment m on nodal coordinate `row` of its joint's element: -S_x Gᵀ m."""
    moment, _ = tangent_moment(system, state, carriage)
    if at_node(system.cable, state, carriage):
        return scale(0.0, system.cable.gravity)  # on its slopes alone
    point, like = joint_point(system.cable, state, carriage), system.cable.gravity
    by_slope = turn_by_slope(slope(state.nodes.position, point, like))
    return scale(-point.shape_x[row], product(moment, by_slope))


@kernel
def spring_energy(system, state, carriage, body):
    """Elastic energy (J) of the hinge spring above a body of a vehicle."""
    carriages = system.carriages
    if not carriages.hinge_stiffness[body] > 0.0:
        return 0.0
    above = cable_direction(system.cable, state, carriage)
    return hinge_energy(carriages, body, hinge_angle(state, body, body == carriages.body_offset[carriage], above))


@kernel
def velocity_acceleration(cable, state, carriage):
    """Velocity-dependent acceleration (dim,) in m/s² of a vehicle's joint: 2 ṡ S_x ė + ṡ² S_xx e (eq. 12)."""
    point = joint_point(cable, state, carriage)
    s_dot = state.joints.velocity[carriage]
    turning = slope(state.nodes.velocity, point, cable.gravity)
    return add_scaled(2.0 * s_dot, turning, scale(s_dot * s_dot, bend(state.nodes.position, point, cable.gravity)))


@kernel
def velocity_turning(cable, state, carriage):
    """Velocity-dependent part (turns,) in rad/s² of the cable's angular acceleration at a joint; 0 in a plane."""
    s_dot = state.joints.velocity[carriage]
    return spin_rate_by_velocities(cable, state.nodes, joint_point(cable, state, carriage), s_dot, cable.gravity)


@inlined_kernel
def add_joint(system, state, carriage, rate_factor, stiffness_factor, work):
    """Condense the sliding coordinate of a vehicle, and add its impedance to the element of its joint.

    Needs the chain and the drive condensed (`condense_chain`, `condense_drive`), and `sliding_increment` where the
    joint is driven.
    """
    cable, carriages = system.cable, system.carriages
    like = cable.gravity
    if at_node(cable, state, carriage):
        hang_at_node(system, state, carriage, rate_factor, stiffness_factor, work)
        return
    s, s_dot = state.joints.position[carriage], state.joints.velocity[carriage]
    point = joint_point(cable, state, carriage)
    r_x, r_xx = slope(state.nodes.position, point, like), bend(state.nodes.position, point, like)
    first = carriages.body_offset[carriage]
    vehicle = impedance_at_pivot(system, state, carriage, work)
    force = vehicle.force

    norm, tangential, normal_force, normal = along_and_across(force, r_x)
    f_stop, stop_by_s, stop_by_s_dot = stop_force(carriages, cable, carriage, s, s_dot)
    f_friction, friction_by_s, friction_by_s_dot, friction_by_normal = friction_force(
        carriages, state, carriage, normal
    )

    d_r_x = product(vehicle.by_place, r_x)
    if work.driven[carriage]:
        pivot, right = 1.0, work.sliding_increment[carriage]
        along, d_along, across = scale(0.0, like), scale(0.0, like), scale(0.0, like)
    else:
        f_t = work.given_force[carriage] + f_friction + f_stop
        across = add_scaled(-f_t / norm, r_x, force)
        by_direction = friction_by_normal / max(normal, 1e-12)  # ∂f_t/∂λ is this times the normal force
        along = add_scaled(-norm * by_direction, normal_force, r_x)
        across = add_scaled(tangential * by_direction, normal_force, across)  # as r_x turns, so does the normal
        d_along = product(transpose(vehicle.by_place), along)
        pivot = dot(along, d_r_x) + stiffness_factor * (dot(across, r_xx) - norm * (stop_by_s + friction_by_s))
        pivot -= norm * rate_factor * (friction_by_s_dot + stop_by_s_dot)
        right = norm * f_t - dot(force, r_x) - dot(along, vehicle.left)

    shape, shape_x = point.shape, point.shape_x
    rows, columns = work.sliding_row[carriage], work.sliding_column[carriage]
    for i in range(4):
        store(add_scaled(shape[i], d_along, scale(stiffness_factor * shape_x[i], across)), rows[i])
        store(add_scaled(shape[i], d_r_x, scale(stiffness_factor * shape_x[i], force)), columns[i])
    if is_hinged(carriages, first):
        joint = tangent_hinge(system, state, carriage, stiffness_factor, rate_factor)
        more = add_tangent_hinge(cable, state, carriage, joint, vehicle, point, r_x, along, stiffness_factor, work)
        pivot, right = pivot + more[0], right + more[1]
    work.sliding_pivot[carriage], work.sliding_right[carriage] = pivot, right
    store(along, work.sliding_along[carriage])
    if state.clamp_holds[carriage]:
        pivot = inf  # s stays, and is solved for with the force of the clamp

    hang_on_nodes(point, add_scaled(1.0, force, vehicle.left), vehicle.by_place, pivot, right, rows, columns, work)


@inlined_kernel
def hang_on_nodes(point, contact, impedance, pivot, right, rows, columns, work):
    """Add force (dim,) in N and tangent of a joint to its element's nodes; the sliding coordinate is condensed."""
    like, shape = contact, point.shape
    for i in range(4):
        column = load(columns[i], like)
        pull = add_scaled(shape[i], contact, scale(right / pivot, column))
        add_to(scale(-1.0, pull), point.element, i, work)
        for j in range(4):
            condensed = outer(1.0 / pivot, column, load(rows[j], like))
            add_block(subtract(block(shape[i] * shape[j], impedance, 0.0), condensed), point.element, i, j, work)


@kernel
def driven_force(system, state, carriage):
    """Drive force (N) of a driven joint: tangential contact force less friction and end stops.

    Buffer forces of other vehicles are no part of the contact force, so the drive force includes holding against them.
    """
    cable, carriages = system.cable, system.carriages
    s, s_dot = state.joints.position[carriage], state.joints.velocity[carriage]
    r_x = joint_tangent(cable, state, carriage)
    force = contact_force(system, state, carriage)
    if system.buffers.present:
        force = subtract(force, push_on(system, state, carriage))
    norm, tangential, _, normal = along_and_across(force, r_x)
    if at_node(cable, state, carriage):
        tangential = pull_along(system, state, carriage)
        if system.haul_ropes.axial_stiffness[carriage] > 0.0 and state.axis[carriage] == JOINT:
            tangential += state.drives.force[carriage]  # of its haul rope at rest, which the cable does not feel
    f_stop, _, _ = stop_force(carriages, cable, carriage, s, s_dot)
    f_friction, _, _, _ = friction_force(carriages, state, carriage, normal)
    _, turning = tangent_moment(system, state, carriage)
    return tangential + turning / norm - f_friction - f_stop


@kernel
def recover_joint(system, state, carriage, work):
    """Recover the increment of a joint's s from nodal increments; return its displacement (dim,) on the cable."""
    cable = system.cable
    like = cable.gravity
    if at_node(cable, state, carriage):
        return load(work.right_side[state.joint_node[carriage], R], like)
    point = joint_point(cable, state, carriage)
    by_s = slope(state.nodes.position, point, like)
    moved = scale(0.0, like)
    right = work.sliding_right[carriage]
    for i in range(4):
        increment = coordinate(work.right_side, point.element, i, like)
        moved = add_scaled(point.shape[i], increment, moved)
        right -= dot(load(work.sliding_row[carriage, i], like), increment)
    delta = right / work.sliding_pivot[carriage]
    work.sliding_increment[carriage] = delta
    return add_scaled(delta, by_s, moved)


@kernel
def recover_turn(system, state, carriage, work):
    """Rotation increment (turns,) of the cable at a joint for its hinge, from increments of the nodes and of s."""
    like = system.cable.gravity
    still = no_turn(like)
    if not is_hinged(system.carriages, system.carriages.body_offset[carriage]):
        return still
    element, rows = state.joint_element[carriage], outer(0.0, still, like)
    if at_node(system.cable, state, carriage):
        both = scale(2.0, mean_slope(work.right_side, state.joint_node[carriage], like))
        return product(load(work.grip_row[carriage, 0], rows), both)
    turned = scale(work.sliding_increment[carriage], load(work.grip_by_s[carriage], still))
    for i in range(4):
        vehicle = product(load(work.grip_row[carriage, i], rows), coordinate(work.right_side, element, i, like))
        turned = add_scaled(1.0, vehicle, turned)
    return turned
