"""Moment of the hinge of a vehicle's first body on the tangent of the cable at its joint.

With the turn G δr_x = r_x x δr_x / |r_x|² of the tangent, the cable spins at G w, w = S_x ė + ṡ r_xx. The moment m on
the body gives -S_x Gᵀ m on the nodes and -m·G r_xx on the sliding coordinate: the virtual work of -m on the turn.
In Newton's tangent the cable's turn is that of the hinge moment, k Δα + c Δα_dot over the hinge's tangent stiffness, so
that the chain treats the cable like a body above; in space it is Δα alone, with its rate in proportion to it.
"""

from __future__ import annotations

from math import atan2, sqrt
from typing import Any

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import by_turn, cross, moment
from cable_twin.mechanics.language.traced import Mat, Vec, formula
from cable_twin.mechanics.language.vectors import (
    Matrix,
    Vector,
    accumulate,
    add_scaled,
    dot,
    outer,
    product,
    scale,
    store,
    transpose,
)
from cable_twin.mechanics.rope.point import add_block, add_to, bend, interpolate, slope
from cable_twin.mechanics.rope.shape_functions import shape_functions_xxx


@kernel
def tangent_pitch(r_x):
    """Pitch α (rad) of a cable with slope r_x, within a quarter turn of level and independent of its direction."""
    x, z = r_x[0], r_x[-1]
    return atan2(-z if x >= 0.0 else z, abs(x))


@kernel
def tangent_orientation(r_x: Vector) -> Vector:
    """Unit tangent (3,) of a cable with slope r_x; in a plane r_x (2,) itself, since only springs need its pitch."""
    if len(r_x) == 2:
        return r_x
    return scale(1.0 / sqrt(dot(r_x, r_x)), r_x)


@formula
def turn_by_slope(r_x):
    """Derivative G (turns x dim) of the rotation of the cable tangent, in a plane its pitch α, by r_x."""
    return scale(1.0 / dot(r_x, r_x), transpose(by_turn(r_x)))


@formula
def by_arm(turn: Vector, like: Vector) -> Matrix:
    """Matrix (dim²) of the cross product m x a of a moment m (turns,) with an arm a, by the arm."""
    return Mat((Vec((0.0, turn[0])), Vec((-turn[0], 0.0)))) if len(like) == 2 else scale(-1.0, by_turn(turn))


@formula
def moment_by_slope(turn, r_x):
    """Derivative (dim²) of Gᵀ m = m x r_x / |r_x|² by r_x, for a moment m (turns,)."""
    per_square = 1.0 / dot(r_x, r_x)
    turned = outer(-2.0 * per_square * per_square, cross(turn, r_x), r_x)
    return add_scaled(per_square, by_arm(turn, r_x), turned)


@formula
def spin_by_slope(turning, r_x):
    """Derivative (turns x dim) of the angular velocity G w of the cable tangent by r_x, at a slope rate w (dim,)."""
    per_square = 1.0 / dot(r_x, r_x)
    turned = outer(-2.0 * per_square * per_square, moment(r_x, turning), r_x)
    return add_scaled(-per_square, transpose(by_turn(turning)), turned)


@kernel
def spin_rate_by_velocities(cable: Any, nodes: Any, point: Any, s_dot: float, like: Vector) -> Vector:
    """Rate (turns,) in rad/s² of the tangent's angular velocity G w at a joint by velocities alone; 0 in a plane.

    That is G w_dot - 2 (r_x·w) / |r_x|² G w.
    """
    if len(like) == 2:
        return (0.0,)
    e, e_dot = nodes.position, nodes.velocity
    r_x = slope(e, point, like)
    r_xxx = interpolate(e, point.element, shape_functions_xxx(cable.element_length[point.element]), like)
    turning = add_scaled(s_dot, bend(e, point, like), slope(e_dot, point, like))
    rate = add_scaled(2.0 * s_dot, bend(e_dot, point, like), scale(s_dot * s_dot, r_xxx))
    longer = 2.0 * dot(r_x, turning) / dot(r_x, r_x)
    return product(turn_by_slope(r_x), add_scaled(-longer, turning, rate))


@inlined_kernel
def add_tangent_hinge(cable, state, carriage, joint, vehicle, point, joint_by_s, along, stiffness_factor, work):
    """Add a vehicle's hinge moment on the cable tangent to the nodes, and to row and column of the sliding coordinate.

    Args:
        cable: parameters.
        state: where to linearise.
        carriage: whose joint it is.
        joint: of its first body (`hinge.Joint`).
        vehicle: the carriage (`vehicle_impedance.Impedance`).
        point: place of the joint.
        joint_by_s: derivative (dim,) of the place of the pivot by s.
        along: derivative (dim,) of the row of s by λ, zero where s is driven.
        stiffness_factor: as in `assemble`.
        work: `sliding_row` and `sliding_column` are added to.

    Returns:
        Terms to add to the pivot of s, and to its right side.
    """
    like = cable.gravity
    shape, shape_x, shape_xx = point.shape, point.shape_x, point.shape_xx
    e, e_dot, s_dot = state.nodes.position, state.nodes.velocity, state.joints.velocity[carriage]
    r_x, r_xx = slope(e, point, like), bend(e, point, like)
    r_xxx = interpolate(e, point.element, shape_functions_xxx(state.mesh.length[point.element]), like)
    g = turn_by_slope(r_x)
    turning = add_scaled(s_dot, r_xx, slope(e_dot, point, like))  # w
    bending = add_scaled(s_dot, r_xxx, bend(e_dot, point, like))  # ∂w/∂s
    pt, tp, tt = vehicle.by_turn, vehicle.moment_by_place, vehicle.moment_by_turn
    residual = add_scaled(1.0, joint.moment, vehicle.moment_left)
    free = 1.0 if dot(along, along) > 0.0 else 0.0

    # the turn as the hinge sees it: turned_j Δe_j + by_s Δs
    rated = joint.steep[1] > 0.0 and joint.by_turn[0][0] > 0.0
    share = stiffness_factor * joint.steep[1] / joint.by_turn[0][0] if rated else 0.0
    by_slope = add_scaled(share, spin_by_slope(turning, r_x), g)
    by_s = add_scaled(share, product(g, bending), product(by_slope, r_xx))
    store(by_s, work.grip_by_s[carriage])

    stiff = scale(stiffness_factor, moment_by_slope(joint.moment, r_x))
    force = scale(stiffness_factor, product(joint.moment, g))  # Gᵀ m
    bent, bent_back, lever = product(stiff, r_xx), product(r_xx, stiff), product(g, r_xx)
    on_s = scale(free, add_scaled(1.0, product(along, pt), product(lever, tt)))  # of row s, by the turn
    pull = add_scaled(1.0, product(tp, joint_by_s), product(tt, by_s))  # of the moment, by Δs
    for j in range(4):
        turned = add_scaled(shape_x[j], by_slope, scale(share * s_dot * shape_xx[j], g))
        store(turned, work.grip_row[carriage, j])
        row = add_scaled(shape_x[j], bent_back, scale(shape_xx[j], force))
        row = add_scaled(shape[j], product(lever, tp), row)
        accumulate(add_scaled(1.0, product(on_s, turned), scale(free, row)), work.sliding_row[carriage, j])
        column = add_scaled(shape_x[j], bent, scale(shape_xx[j], force))
        column = add_scaled(shape_x[j], product(pull, g), column)
        accumulate(add_scaled(shape[j], product(pt, by_s), column), work.sliding_column[carriage, j])
        moved = add_scaled(shape[j], tp, product(tt, turned))  # of the moment, by Δe_j
        on_node, on_slope = product(pt, turned), product(transpose(g), moved)
        for i in range(4):
            tangent = add_scaled(shape_x[i] * shape_x[j], stiff, scale(shape[i], on_node))
            add_block(add_scaled(shape_x[i], on_slope, tangent), point.element, i, j, work)
        add_to(scale(-shape_x[j], product(residual, g)), point.element, j, work)
    pivot = dot(lever, product(tp, joint_by_s)) + dot(bent, r_xx) + dot(force, r_xxx)
    return free * pivot + dot(on_s, by_s), -free * dot(residual, lever)
