"""Hinge between a body and the body or cable above: spring, damper, and in space constrained axes.

In a plane a body at the angle φ = θ - θ_above has the moment m = -k φ - c φ_dot at its upper pivot, and the body above
has -m. Another law is another `hinge_moment`: its callers take moment and derivatives alone.

In space a joint turns about two axes at most, a of the part above and c of the body, which it keeps at right angles:
Φ = a·c = 0, with the moment λ c x a. On the cable a is its tangent (roll) and c the lateral axis of the body (pitch),
so that the vehicle keeps its heading along the cable. Between bodies a is the lateral axis of the one above (pitch)
and c that along the one below (roll); a revolute joint holds the roll as well, with another c, and turns about a alone.
Each such constraint is one equation and one moment, eliminated with the body below; in a plane there is none, and no
code is compiled for them. The cable has no twist: a twisting moment goes to its supports.
"""

from __future__ import annotations

from math import atan
from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import by_turn, cross, orientation
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    dot,
    linear,
    load,
    outer,
    scale,
    store,
    subtract,
    transpose,
    unit_matrix,
)
from cable_twin.mechanics.on_rope.tangent_hinge import tangent_pitch


class Above(NamedTuple):
    """Orientation and angular velocity of the cable at a vehicle's joint."""

    orientation: Any  # in a plane r_x (2,); in space its unit tangent (3,)
    spin: Any  # (turns,) rad/s, of its tangent


class Joint(NamedTuple):
    """Moment of a joint on the body below it, its derivatives, and the axes that it constrains."""

    moment: Any  # (turns,) N m
    by_turn: Any  # (turns²) minus its derivative by the turn of the body
    by_above: Any  # (turns²) its derivative by the turn of what is above
    steep: Any  # in a plane, minus the derivatives of the moment by angle and by rate
    held: Any  # in space, the axes c x a (2, 3) of the moments that hold
    holding: int  # how many of these hold


@kernel
def hinge_moment(carriages, body, angle, rate):
    """Moment (N m) of a hinge spring and damper at angle (rad) and rate (rad/s), and its negative derivatives."""
    stiffness, damping = carriages.hinge_stiffness[body], carriages.hinge_damping[body]
    return -stiffness * angle - damping * rate, stiffness, damping


@kernel
def hinge_energy(carriages, body, angle):
    """Elastic energy (J) of the spring of a hinge."""
    return 0.5 * carriages.hinge_stiffness[body] * angle * angle


@kernel
def is_hinged(carriages, body):
    """Return whether the joint above a body has a spring, damper or constrained axes; a bare pivot needs no angles."""
    return carriages.hinge_stiffness[body] > 0.0 or carriages.hinge_damping[body] > 0.0 or carriages.held[body] > 0


@inlined_kernel
def hinge(carriages, state, body, topmost, above, stiffness_factor, rate_factor, like):
    """Moment and axes (`Joint`) of the joint above a body; a `topmost` body hangs on a rope of orientation `above`."""
    if len(like) == 2:
        return _hinge_in_plane(carriages, state, body, topmost, above, stiffness_factor, rate_factor)
    return _hinge_in_space(carriages, state, body, topmost, above, stiffness_factor, rate_factor)


@inlined_kernel
def _hinge_in_plane(carriages, state, body, topmost, above, stiffness_factor, rate_factor):
    rate = above.spin[0] if topmost else state.bodies.velocity[body - 1, 2]
    angle, turning = 0.0, state.bodies.velocity[body, 2] - rate
    if carriages.hinge_stiffness[body] > 0.0:
        angle = hinge_angle(state, body, topmost, above)
    moment, by_angle, by_rate = hinge_moment(carriages, body, angle, turning)
    stiff = stiffness_factor * by_angle + rate_factor * by_rate
    return Joint((moment,), ((stiff,),), ((stiff,),), (by_angle, by_rate), 0.0, 0)


@inlined_kernel
def joint_axes(state, body, topmost, tangent):
    """Axes of a joint in space: a of the upper part, c of the body, second c if revolute; and pitch angle (rad)."""
    x, y, z = transpose(orientation(state.bodies.position[body], tangent))
    if topmost:
        return tangent, y, z, atan(dot(tangent, z) / dot(tangent, x))
    along, lateral, up = transpose(orientation(state.bodies.position[body - 1], tangent))
    return lateral, x, z, atan(-dot(x, up) / dot(x, along))


@inlined_kernel
def hinge_angle(state, body, topmost, above):
    """Pitch angle (rad) of a body relative to the body or cable above, for the hinge spring."""
    if len(above.spin) == 1:
        over = tangent_pitch(above.orientation) if topmost else state.bodies.position[body - 1, 2]
        return state.bodies.position[body, 2] - over
    return joint_axes(state, body, topmost, above.orientation)[3]


@inlined_kernel
def _hinge_in_space(carriages, state, body, topmost, above, stiffness_factor, rate_factor):
    a, c, other, pitch = joint_axes(state, body, topmost, above.orientation)
    spin = load(state.bodies.velocity[body, 3:], a)
    spin_above = above.spin
    if not topmost:
        spin_above = load(state.bodies.velocity[body - 1, 3:], a)
    relative = subtract(spin, spin_above)
    pitching = dot(c if topmost else a, relative)
    m_pitch, k_pitch, d_pitch = hinge_moment(carriages, body, pitch, pitching)
    d_roll = carriages.roll_damping[body]
    m_roll = -d_roll * dot(a if topmost else c, relative)
    m_a, k_a, d_a = (m_roll, 0.0, d_roll) if topmost else (m_pitch, k_pitch, d_pitch)
    m_c, k_c, d_c = (m_pitch, k_pitch, d_pitch) if topmost else (m_roll, 0.0, d_roll)
    moment, by_body, by_above = hinge_tangents(
        (a, c), (m_a, m_c), (k_a, k_c), (d_a, d_c), relative, stiffness_factor, rate_factor
    )
    holding = load(state.moments[body], a)
    first_axis, second_axis = cross(c, a), cross(other, a)
    count = carriages.held[body]
    for number in range(count):
        axis, own = (first_axis, c) if number == 0 else (second_axis, other)
        moment, by_body, by_above = with_constraint(moment, by_body, by_above, a, own, axis, holding, stiffness_factor)
    return Joint(moment, by_body, by_above, (0.0, 0.0), (first_axis, second_axis), count)


@formula
def hinge_tangents(axes, moments, stiffness, damping, relative, stiffness_factor, rate_factor):
    """Moment m_a a + m_c c of a hinge with axes a, c; its derivatives by rotations of body (negative) and part above.

    Args:
        axes: a of the part above and c of the body, unit vectors (3,).
        moments: m_a, m_c about them, N m.
        stiffness: minus their derivatives by angle, N m/rad.
        damping: minus their derivatives by rate, N m s/rad.
        relative: angular velocity (3,) of the body relative to the part above, rad/s.
        stiffness_factor: as in `assemble`.
        rate_factor: as in `assemble`.
    """
    (a, c), (m_a, m_c), (k_a, k_c), (d_a, d_c) = axes, moments, stiffness, damping
    stiff = outer(stiffness_factor * k_a + rate_factor * d_a, a, a)
    stiff = stiff + outer(stiffness_factor * k_c + rate_factor * d_c, c, c)
    # the axes turn, a with the part above and c with the body
    by_body = -stiffness_factor * m_c * by_turn(c) + outer(stiffness_factor * d_c, c, cross(c, relative))
    by_above = stiffness_factor * m_a * by_turn(a) + outer(-stiffness_factor * d_a, a, cross(a, relative))
    return m_a * a + m_c * c, stiff + by_body, stiff + by_above


@formula
def with_constraint(moment, by_body, by_above, a, c, axis, holding, stiffness_factor):
    """Hinge moment and derivatives, with a constraint moment λ c x a added, whose present value is `holding` (3,)."""
    size = holding @ axis / (axis @ axis)
    # δ(c x a) = c (a·θ) - (a·c) θ + (a·c) t - a (c·t)
    apart = stiffness_factor * size * (a @ c) * unit_matrix(a)
    by_body = apart + (by_body - outer(stiffness_factor * size, c, a))
    by_above = apart + (by_above - outer(stiffness_factor * size, a, c))
    return size * axis + moment, by_body, by_above


class Held(NamedTuple):
    """Increment of a rotational constraint moment: derivatives by pivot position and upper rotation, constant part."""

    by_place: Any
    by_above: Any
    least: Any


@kernel
def measure_held(carriages, state, body, topmost, direction, gap):
    """Write the rotational constraints Φ = a·c of a joint into `gap` (2,); no-op in a plane."""
    if len(direction.spin) == 1:
        return
    a, c, other, _ = joint_axes(state, body, topmost, direction.orientation)
    gap[0], gap[1] = dot(a, c), dot(a, other)


@kernel
def accelerate_held(state, body, topmost, above, turning, feedback, gap):
    """Write Φ_ddot of a joint's rotational constraints at zero accelerations into `gap` (2,); no-op in a plane.

    With q = c x a, Φ_dot = q·(ω - Ω). `turning` (turns,) in rad/s² is the velocity-dependent part of the rate of the
    spin Ω above the first body of a chain; gaps and rates are fed back with `feedback` (1/s) squared and doubled.
    """
    if len(above.spin) == 1:
        return
    a, c, other, _ = joint_axes(state, body, topmost, above.orientation)
    spin, over, rate = load(state.bodies.velocity[body, 3:], a), above.spin, turning
    if not topmost:
        over, rate = load(state.bodies.velocity[body - 1, 3:], a), scale(0.0, turning)
    relative = subtract(spin, over)
    for number in range(2):
        mine = c if number == 0 else other
        axis = cross(mine, a)
        axis_rate = add_scaled(1.0, cross(cross(spin, mine), a), cross(mine, cross(over, a)))
        left = dot(axis_rate, relative) - dot(axis, rate)
        gap[number] = left + feedback * (2.0 * dot(axis, relative) + feedback * dot(a, mine))


@inlined_kernel
def hold(joint, inverse, by_place, by_above, least, gap):
    """Apply a joint's rotational constraints to the free rotation -(by_place p + by_above θ + least) of its body.

    Takes the inverse of the rotational stiffness of the body, and the gaps Φ (2,). Each constrained axis q is one
    equation q·(turn - θ) = -Φ with one constraint moment λ q.

    Returns:
        The three coefficients of the constrained rotation, and those of the constraint moment (`Held`).
    """
    if len(joint.moment) == 1:
        return by_place, by_above, least, Held((), (), ())
    nothing = scale(0.0, by_place)
    held = Held(nothing, nothing, scale(0.0, least))
    through = unit_matrix(
        least
    )  # constraint moment by the one of its axis, with those that the axes before it then need
    for number in range(joint.holding):
        by_place, by_above, least, held, inverse, through = hold_axis(
            joint.held[number], gap[number], (by_place, by_above, least), held, inverse, through
        )
    return by_place, by_above, least, held


@formula
def hold_axis(axis, gap, rotation, held, inverse, through):
    """Constrain a body's rotation φ about one axis q: q·(φ - θ) = -Φ, θ rotation above, constraint moment λ q."""
    by_place, by_above, least = rotation
    yields = inverse @ axis
    weight = 1.0 / (axis @ yields)
    push = weight * (through @ axis)
    # q·turn - q·θ + Φ of the rotation without it, by p, by θ and constant
    place, above, rest = axis @ by_place, axis @ by_above + axis, axis @ least - gap
    held = Held(
        outer(1.0, push, place) + held.by_place, outer(1.0, push, above) + held.by_above, rest * push + held.least
    )
    by_place, by_above = by_place - outer(weight, yields, place), by_above - outer(weight, yields, above)
    least = -rest * weight * yields + least
    back = axis @ inverse
    return by_place, by_above, least, held, inverse - outer(weight, yields, back), through - outer(1.0, push, back)


@formula
def add_held(a, held):
    """Sum of a matrix or vector and the contribution of rotational constraints; in a plane `a` alone."""
    return a + held if held else a


@inlined_kernel
def keep_held(held, body, work):
    """Store the coefficients of a rotational constraint moment for its back substitution in `recover_held`."""
    store(held.by_place, work.held_by_place[body])
    store(held.by_above, work.held_by_above[body])
    store(held.least, work.held_right[body])


@kernel
def recover_held(state, body, moved, turned, work):
    """Update the rotational constraint moment of a joint, from the increments of pivot and upper rotation."""
    if len(turned) == 1:
        return
    square = outer(0.0, moved, moved)
    by_place, by_above = load(work.held_by_place[body], square), load(work.held_by_above[body], square)
    accumulate(linear(by_place, moved, by_above, turned, load(work.held_right[body], moved)), state.moments[body])
