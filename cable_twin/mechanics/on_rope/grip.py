"""What the hinge of a first body does to the cable, which takes its moment by the tangent at the joint.

With α the pitch of the tangent, g = ∂α/∂r_x and H = ∂g/∂r_x, the cable turns at α_dot = g·w, w = S_x ė + ṡ r_xx. The
moment m on the body leaves -m S_x g to the nodes and -m g·r_xx to the sliding coordinate: the virtual work of -m on α.
Newton sees the turn that the hinge does, k Δα + c Δα_dot over what stiffens it, so that a body above or the cable is
the same to the chain. Planar, as carriages are.
"""

from __future__ import annotations

from math import atan2

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    apply,
    block,
    dot,
    load,
    minus,
    outer,
    quarter_turn,
    scale,
    store,
)
from cable_twin.mechanics.rope.point import add_block, add_to, bend, interpolate, slope
from cable_twin.mechanics.rope.shape_functions import shape_functions_xxx


@kernel
def tangent_pitch(r_x):
    """Pitch α (rad) of a cable of the slope r_x, within a quarter turn of level: the same whichever way it runs."""
    x, z = r_x[0], r_x[-1]
    return atan2(-z if x >= 0.0 else z, abs(x))


@kernel
def pitch_by_slope(r_x):
    """Derivative g (dim,) of α by r_x: (z, -x) / (x² + z²)."""
    return quarter_turn(1.0 / (r_x[0] * r_x[0] + r_x[-1] * r_x[-1]), r_x)


@kernel
def pitch_by_slope_twice(r_x):
    """Second derivative H (dim²) of α by r_x, in a plane."""
    x, z = r_x
    squared = x * x + z * z
    mixed, twice = (x * x - z * z) / (squared * squared), 2.0 * x * z / (squared * squared)
    return -twice, mixed, mixed, twice


@kernel
def add_grip(cable, state, carriage, first, point, along, rate_factor, stiffness_factor, work):
    """Add what the moment does at the nodes, and what it adds to row and column of the sliding coordinate.

    Args:
        cable: parameters.
        state: where to linearise.
        carriage: whose joint it is.
        first: its first body, with `hinge` and impedance.
        point: place of the joint.
        along: derivative (dim,) of the row of s by λ, zero where s is driven.
        rate_factor: as in `assemble`.
        stiffness_factor: as in `assemble`.
        work: `sliding_row` and `sliding_column` are added to.

    Returns:
        What comes to the pivot of s, and to its right side.
    """
    like, shape, shape_x, shape_xx = cable.gravity, point.shape, point.shape_x, point.shape_xx
    e, e_dot, s_dot = state.nodes.position, state.nodes.velocity, state.joints.velocity[carriage]
    r_x, r_xx = slope(e, point, like), bend(e, point, like)
    r_xxx = interpolate(e, point.element, shape_functions_xxx(cable.element_length[point.element]), like)
    g, h = pitch_by_slope(r_x), pitch_by_slope_twice(r_x)
    turning = add_scaled(s_dot, r_xx, slope(e_dot, point, like))  # w
    bending = add_scaled(s_dot, r_xxx, bend(e_dot, point, like))  # ∂w/∂s
    moment, by_angle, by_rate = work.hinge[first, 0], work.hinge[first, 1], work.hinge[first, 2]
    d_t, d_tt = load(work.impedance_turning[first], like), work.impedance_turning[first, 2]
    residual = moment + work.impedance_force[first, 2]
    free = 1.0 if dot(along, along) > 0.0 else 0.0

    # Δα as the hinge sees it: seen_j·Δe_j + by_s Δs
    hinge = stiffness_factor * by_angle + rate_factor * by_rate
    share = stiffness_factor * by_rate / hinge if hinge > 0.0 else 0.0
    by_slope = add_scaled(share, apply(h, turning), g)
    by_s = dot(by_slope, r_xx) + share * dot(g, bending)
    work.grip_by_s[carriage] = by_s

    stiff = stiffness_factor * moment
    bent, lever = apply(h, r_xx), dot(g, r_xx)
    on_s = free * (dot(d_t, along) + d_tt * lever)  # of the row of s, by Δα
    pull = dot(d_t, r_x) + d_tt * by_s  # of the moment, by Δs
    for j in range(4):
        seen = add_scaled(shape_x[j], by_slope, scale(share * s_dot * shape_xx[j], g))
        store(seen, work.grip_row[carriage, j])
        bends = add_scaled(stiff * shape_x[j], bent, scale(stiff * shape_xx[j], g))
        row = add_scaled(free * shape[j] * lever, d_t, add_scaled(on_s, seen, scale(free, bends)))
        accumulate(row, work.sliding_row[carriage, j])
        column = add_scaled(shape[j] * by_s, d_t, add_scaled(shape_x[j] * pull, g, bends))
        accumulate(column, work.sliding_column[j])
        force = add_scaled(shape[j], d_t, scale(d_tt, seen))  # of the moment, by Δe_j
        for i in range(4):
            tangent = minus(outer(shape[i], d_t, seen), outer(-shape_x[i], g, force))
            add_block(minus(tangent, block(-stiff * shape_x[i] * shape_x[j], h, 0.0)), point.element, i, j, work)
        add_to(scale(-shape_x[j] * residual, g), work.right_side, point.element, j)
    pivot = free * (lever * dot(d_t, r_x) + stiff * (dot(bent, r_xx) + dot(g, r_xxx)))
    return pivot + on_s * by_s, -free * residual * lever
