"""Vehicle as a chain of rigid bodies below its joint with the cable, condensed to an impedance; its payload.

The coordinates of a body are its centre of mass (dim,) and its pitch about y, right-handed, or in space its unit
quaternion; a point u of the body is at c + A u. The multiplier of a joint is the force on the body below it; moments at
joints are in `hinge`. A payload is a point mass, merged with its body into one rigid body of changed mass, centre and
inertia.

The chain is eliminated from its end upwards (articulated bodies): at any pivot it acts on the body above as an
impedance, Δ(λ, m) = D Δ(p, θ) + b: force and moment there, by the displacement of the pivot and the rotation of the
body above. One matrix of rotations a body is inverted, which is a number in a plane.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import (
    by_turn,
    cross,
    gyration,
    inertia_of,
    inverse_of,
    moment,
    moment_by_turn,
    no_turn,
    orientation,
    set_upright,
)
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    block,
    linear,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
)
from cable_twin.mechanics.on_rope.hinge import (
    accelerate_held,
    add_held,
    hinge,
    hold,
    keep_held,
    measure_held,
    recover_held,
)
from cable_twin.mechanics.parameters import Carriages, FloatArray, Payloads
from cable_twin.mechanics.state import State


@inlined_kernel
def centre(state, body, like):
    """Centre of mass (dim,) in m of a body."""
    return load(state.bodies.position[body], like)


@inlined_kernel
def axes_of(state, body, like):
    """Rotation matrix (dim²) of a body, from its axes to those of the world."""
    return orientation(state.bodies.position[body], like)


@inlined_kernel
def spin_of(rates, body, like):
    """Angular velocity (turns,) in rad/s of a body, or its rate, from the rates (bodies, dim + turns) of all bodies."""
    return load(rates[body, len(like) :], no_turn(like))


@inlined_kernel
def arm_to(axes, offset, like):
    """Vector A u (dim,) in m from the centre of mass of a body to its point at `offset` (dim,) in body axes."""
    return product(axes, load(offset, like))


@inlined_kernel
def pivot_position(state, body, offset, like):
    """Position (dim,) in m of the point of a body, as a pivot, at `offset` (dim,) in m in body axes."""
    return add_scaled(1.0, centre(state, body, like), arm_to(axes_of(state, body, like), offset, like))


@inlined_kernel
def pivot_velocity(state, body, offset, like):
    """Velocity (dim,) in m/s of the point of a body, as a pivot, at `offset` (dim,) in m in body axes."""
    arm = arm_to(axes_of(state, body, like), offset, like)
    velocity = state.bodies.velocity
    return add_scaled(1.0, load(velocity[body], like), cross(spin_of(velocity, body, like), arm))


@kernel
def hang_chain(carriages, state, carriage, place, along):
    """Place every body of a vehicle upright below `place` (dim,) in m, with heading along the cable, `along` (dim,)."""
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        set_upright(state.bodies.position[body], along)
        axes = axes_of(state, body, place)
        at = subtract(place, arm_to(axes, carriages.upper_pivot[body], place))
        store(at, state.bodies.position[body])
        place = add_scaled(1.0, at, arm_to(axes, carriages.lower_pivot[body], place))


@kernel
def move_chain(carriages, gravity, state, carriage, velocity, acceleration):
    """Give all bodies of a vehicle one velocity (m/s) and acceleration (m/s²), (dim,), and store their joint forces."""
    force, still = scale(0.0, gravity), no_turn(gravity)
    dim = len(gravity)
    for body in range(carriages.body_offset[carriage + 1] - 1, carriages.body_offset[carriage] - 1, -1):
        store(velocity, state.bodies.velocity[body])
        store(acceleration, state.bodies.acceleration[body])
        store(acceleration, state.bodies.algorithmic[body])
        store(still, state.bodies.velocity[body, dim:])
        store(still, state.bodies.acceleration[body, dim:])
        store(still, state.bodies.algorithmic[body, dim:])
        store(still, state.moments[body])
        force = add_scaled(carriages.mass[body], subtract(acceleration, gravity), force)
        store(force, state.multipliers[body])


@kernel
def close_joints(carriages, state, carriage, pivot, above, work):
    """Store the gaps (eq. 14) of all joints of a vehicle on a rope at `pivot` (dim,) m, of orientation `above`."""
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        store(subtract(pivot, pivot_position(state, body, carriages.upper_pivot[body], pivot)), work.joint_gap[body])
        pivot = pivot_position(state, body, carriages.lower_pivot[body], pivot)
        measure_held(carriages, state, body, body == carriages.body_offset[carriage], above, work.held_gap[body])


@kernel
def joint_accelerations(carriages, state, carriage, feedback, cable, above, work):
    """Right side γ of eq. 12 for all joints of a vehicle: accelerations (m/s²) at q_ddot = 0.

    `cable` has position and velocity (dim,) of the joint on the cable, and the velocity-dependent parts of its
    acceleration and of the rate of its spin (turns,); `above` is the orientation of the cable there (`hinge.Above`).
    The gaps and their rates are fed back with `feedback` (1/s) squared and doubled.
    """
    position, velocity, acceleration, turning = cable
    like = position
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        upper, lower = carriages.upper_pivot[body], carriages.lower_pivot[body]
        axes, spin = axes_of(state, body, like), spin_of(state.bodies.velocity, body, like)
        there = pivot_position(state, body, upper, like), pivot_velocity(state, body, upper, like)
        gap = joint_acceleration((position, velocity, acceleration), there, arm_to(axes, upper, like), spin, feedback)
        store(gap, work.joint_gap[body])
        first = body == carriages.body_offset[carriage]
        accelerate_held(state, body, first, above, turning, feedback, work.held_gap[body])
        position = pivot_position(state, body, lower, like)
        velocity = pivot_velocity(state, body, lower, like)
        acceleration = cross(spin, cross(spin, arm_to(axes, lower, like)))


@formula
def joint_acceleration(above, pivot, arm, spin, feedback):
    """Right side γ of eq. 12 for a joint's gap Φ: Φ_ddot by velocities + 2 f Φ_dot + f² Φ, with feedback f (1/s)."""
    (position, velocity, acceleration), (own_position, own_velocity) = above, pivot
    gap, gap_rate = position - own_position, velocity - own_velocity
    return 2.0 * feedback * gap_rate + (feedback * feedback * gap + (acceleration - cross(spin, cross(spin, arm))))


class ChainImpedance(NamedTuple):
    """Impedance of a chain: Δ(force, moment) = D Δ(p, θ) + b, p place of its pivot, θ rotation of the body above."""

    pp: Any  # (dim²) N/m, force by displacement
    pt: Any  # (dim turns) N, force by rotation
    tp: Any  # (turns dim) N, moment by displacement
    tt: Any  # (turns²) N m, moment by rotation
    b: Any  # (dim,) N
    b_turn: Any  # (turns,) N m


class Rotation(NamedTuple):
    """Rotation of a body, -(by_place p + by_above θ + least): p displaces its upper pivot, θ rotates the body above."""

    by_place: Any  # (turns dim) rad/m
    by_above: Any  # (turns²)
    least: Any  # (turns,) rad


class Condensed(NamedTuple):
    """Condensed equations of a body with the chain below, before its rotation is eliminated: symbols of theory.md."""

    mass: Any  # m' (dim²), with the drag
    column: Any  # y: force by the rotation of the body
    row: Any  # moment by the displacement of its upper pivot
    stiff: Any  # S: moment by its rotation, without its hinge
    residual: Any  # R of its centre of mass, with the gap of its joint closed
    below: Any  # b of the chain below, with that gap closed
    right: Any  # h: residual of its moment


@formula
def without_chain(like):
    """Zero impedance, as that below the last body of a chain."""
    still = no_turn(like)
    nothing = 0.0 * like
    square, wide = outer(0.0, like, like), outer(0.0, like, still)
    return ChainImpedance(square, wide, outer(0.0, still, like), outer(0.0, still, still), nothing, still)


@formula
def balance(mass, accelerated, gyration_moment, arms, force, below, moments, drag):
    """Residuals of a body: M q_ddot - Q less force and moment at its upper pivot, plus those at its lower one.

    Args:
        mass: m, kg.
        accelerated: c_ddot - g (dim,), m/s².
        gyration_moment: J ω_dot + ω x J ω (turns,), N m.
        arms: t_u, t_l (dim,) from the centre of mass to both pivots, m.
        force: λ (dim,) at the upper pivot, N.
        below: λ' (dim,) at the lower pivot, N.
        moments: m and m' (turns,) at both, N m.
        drag: (dim,) N.
    """
    (up, low), (upper_moment, lower_moment) = arms, moments
    # R_c = m (c_ddot - g) - λ + λ' - drag
    residual = below + (mass * accelerated - force - drag)
    # R_θ = J ω_dot + ω x J ω - t_u x λ + t_l x λ' - m + m'
    turning = moment(low, below) + (gyration_moment - moment(up, force))
    return residual, lower_moment + (turning - upper_moment)


@formula
def condense_body(mass, drag_turning, arms, gap, residuals, stiff, chain):
    """Condense the chain below a body into the body's equations, by displacement p of its upper pivot and rotation θ.

    Closing the gap g of its joint moves centre and lower pivot by p + g + v θ and p + g + w θ.
    """
    (up, low), (residual, turning) = arms, residuals
    v, w = -by_turn(up), by_turn(low) - by_turn(up)
    # b^ = b' + D' g,  R^ = R_c + m' g
    below, below_turn = chain.pp @ gap + chain.b, chain.tp @ gap + chain.b_turn
    closed = residual + mass @ gap
    # y = m' v + D' w: the rotation of the body takes along the chain below it
    turned, carried = drag_turning + mass @ v, chain.pp @ w + chain.pt
    column = turned + carried
    row = v.T @ mass + (w.T @ chain.pp + chain.tp)
    # S = mu_M J + mu_K G + v^T m' v + w^T D' w
    stiff = stiff + v.T @ turned + w.T @ carried + (chain.tp @ w + chain.tt)
    # h = R_θ + v^T R^ + w^T b^
    right = w.T @ below + (below_turn + (turning + v.T @ closed))
    return Condensed(mass, column, row, stiff, closed, below, right)


@formula
def free_rotation(body, hinge_by_turn, hinge_by_above):
    """Rotation of a body (`Rotation`) without rotational constraints, and its rotational compliance in rad/(N m)."""
    inverse = inverse_of(body.stiff + hinge_by_turn)
    return Rotation(inverse @ body.row, -(inverse @ hinge_by_above), inverse @ body.right), inverse


@formula
def impedance_of(body, chain, hinge_by_turn, hinge_by_above, rotation, held):
    """Impedance of a body with the chain below at its upper pivot, with the rotation of the body eliminated.

    D = D' + m' - y θ_p,  b = b^ + R^ - y θ_0, and in the rows of the moment the hinge η with constraint moments.
    """
    by_place, by_above, least = rotation
    return ChainImpedance(
        body.mass + chain.pp - body.column @ by_place,
        -(body.column @ by_above),
        add_held(hinge_by_turn @ by_place, held.by_place),
        add_held(hinge_by_turn @ by_above + hinge_by_above, held.by_above),
        body.residual + (body.below - body.column @ least),
        add_held(hinge_by_turn @ least, held.least),
    )


@kernel
def condense_chain(carriages, gravity, state, carriage, above, mass_factor, rate_factor, stiffness_factor, work):
    """Eliminate all bodies of a vehicle: force D Δr + b by joint displacement Δr; D, b in row body_offset[carriage].

    Needs `joint_gap`, and the orientation of the cable at the joint, `above` (`hinge.Above`). From the last body
    upwards: its residuals and tangents, its equations with the chain below, and the impedance of both at its pivot.
    """
    like, still = gravity, no_turn(gravity)
    first, end = carriages.body_offset[carriage], carriages.body_offset[carriage + 1]
    chain = without_chain(like)
    below, below_moment = scale(0.0, like), still
    for body in range(end - 1, first - 1, -1):
        mass, axes = carriages.mass[body], axes_of(state, body, like)
        force = load(state.multipliers[body], like)
        joint = hinge(carriages, state, body, body == first, above, stiffness_factor, rate_factor, like)
        up, low = arm_to(axes, carriages.upper_pivot[body], like), arm_to(axes, carriages.lower_pivot[body], like)
        if body == end - 1:
            low = scale(0.0, low)

        # M q_ddot - Q - forces and moments at both pivots, and its derivative by the rotation: mu_M J + mu_K G
        inert, stiff = gyration(
            inertia_of(carriages.inertia, body, axes, like),
            spin_of(state.bodies.velocity, body, like),
            spin_of(state.bodies.acceleration, body, like),
            load(work.turned[body], still),
            mass_factor,
            rate_factor,
            stiffness_factor,
        )
        accelerated = subtract(load(state.bodies.acceleration[body], like), gravity)
        drag = load(work.body_drag[body], like)
        residuals = balance(mass, accelerated, inert, (up, low), force, below, (joint.moment, below_moment), drag)
        geometric = subtract(moment_by_turn(low, below), moment_by_turn(up, force))
        stiff = add_scaled(stiffness_factor, geometric, stiff)

        # the body with the chain below it, theory.md "Elimination"
        heavy = block(1.0, load(work.body_drag_tangent[body], chain.pp), mass_factor * mass)
        turning, gap = load(work.body_drag_turning[body], chain.pt), load(work.joint_gap[body], like)
        condensed = condense_body(heavy, turning, (up, low), gap, residuals, stiff, chain)

        # its rotation, within the constraints of its joint
        rotation, inverse = free_rotation(condensed, joint.by_turn, joint.by_above)
        by_place, by_above, least, held = hold(
            joint, inverse, rotation.by_place, rotation.by_above, rotation.least, work.held_gap[body]
        )
        store(by_place, work.turn_by_place[body])
        store(by_above, work.turn_by_above[body])
        store(least, work.turn_right[body])
        keep_held(held, body, work)

        # D and b at its upper pivot
        chain = impedance_of(condensed, chain, joint.by_turn, joint.by_above, (by_place, by_above, least), held)
        keep_impedance(chain, body, work)
        below, below_moment = force, joint.moment


@inlined_kernel
def keep_impedance(chain, body, work):
    """Store the impedance (`ChainImpedance`) of the chain from a body downwards in the workspace."""
    store(chain.pp, work.impedance[body])
    store(chain.pt, work.impedance_turning[body])
    store(chain.tp, work.impedance_moment[body])
    store(chain.tt, work.impedance_turn[body])
    store(chain.b, work.impedance_force[body])
    store(chain.b_turn, work.impedance_force[body, len(chain.b) :])


@formula
def moved_body(rotation, gap, arms, moved, turned):
    """Newton increments of a body: rotation (turns,), displacement (dim,) of centre of mass and of lower pivot."""
    by_place, by_above, least = rotation
    up, low = arms
    turn = -linear(by_place, moved, by_above, turned, least)
    centre = gap + moved - cross(turn, up)
    return turn, centre, centre + cross(turn, low)


@kernel
def recover_chain(carriages, state, carriage, moved, turned, work):
    """Recover bodies and multipliers of a vehicle from displacement (dim,) and rotation (turns,) of its cable joint.

    The increments of the bodies go to `body_increment`; the multipliers in the state are updated.
    """
    like, still, dim = moved, turned, len(moved)
    square, turns_by_place, turns = outer(0.0, like, like), outer(0.0, still, like), outer(0.0, still, still)
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        # Δλ = D_pp Δp + D_pt Δθ + b
        by_place, by_above = (
            load(work.impedance[body], square),
            load(work.impedance_turning[body], outer(0.0, like, still)),
        )
        change = linear(by_place, moved, by_above, turned, load(work.impedance_force[body], like))
        accumulate(change, state.multipliers[body])
        recover_held(state, body, moved, turned, work)
        rotation = (
            load(work.turn_by_place[body], turns_by_place),
            load(work.turn_by_above[body], turns),
            load(work.turn_right[body], still),
        )
        axes = axes_of(state, body, like)
        arms = arm_to(axes, carriages.upper_pivot[body], like), arm_to(axes, carriages.lower_pivot[body], like)
        turned, centre, moved = moved_body(rotation, load(work.joint_gap[body], like), arms, moved, turned)
        store(centre, work.body_increment[body])
        store(turned, work.body_increment[body, dim:])


@kernel
def carriage_mass(carriages, carriage):
    """Mass (kg) of all bodies of a vehicle."""
    total = 0.0
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        total += carriages.mass[body]
    return total


def centre_offsets(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> FloatArray:
    """Shift (bodies, dim) in m of the bodies' centres of mass due to payloads (carriages,) in kg."""
    offsets = np.zeros(carriages.upper_pivot.shape)
    for body, position, mass in zip(payloads.body, payloads.position, masses, strict=True):
        if mass > 0.0:
            offsets[body] = mass / (carriages.mass[body] + mass) * position
    return offsets


def load_bodies(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> Carriages:
    """Parameters of vehicles with payloads (carriages,) in kg: mass, inertia and pivots from the common centre."""
    offsets = centre_offsets(carriages, payloads, masses)
    mass, inertia = carriages.mass.copy(), carriages.inertia.copy()
    for body, position, added in zip(payloads.body, payloads.position, masses, strict=True):
        if added > 0.0:
            reduced = mass[body] * added / (mass[body] + added)
            if inertia.ndim == 1:
                inertia[body] += reduced * float(position @ position)
            else:
                tensor = np.eye(3) * float(position @ position) - np.outer(position, position)
                inertia[body] += reduced * tensor.ravel()
            mass[body] += added
    return carriages._replace(
        mass=mass,
        inertia=inertia,
        upper_pivot=carriages.upper_pivot - offsets,
        lower_pivot=carriages.lower_pivot - offsets,
        centre_offset=offsets,
    )


def shift_centres(state: State, change: FloatArray) -> None:
    """Refer the motion of bodies to centres of mass moved by `change` (bodies, dim), m in body axes; no body moves."""
    for body in np.flatnonzero(np.any(change != 0.0, axis=1)):
        dim = change.shape[1]
        axes = np.array(orientation(state.bodies.position[body], tuple(change[body]))).reshape(dim, dim)
        arm = tuple(axes @ change[body])
        spin = tuple(state.bodies.velocity[body, dim:])
        state.bodies.position[body, :dim] += arm
        state.bodies.velocity[body, :dim] += cross(spin, arm)
        for accelerations in (state.bodies.acceleration, state.bodies.algorithmic):
            turning = cross(tuple(accelerations[body, dim:]), arm)
            accelerations[body, :dim] += np.add(turning, cross(spin, cross(spin, arm)))


def top_of(carriages: Carriages, state: State, carriage: int) -> tuple[FloatArray, FloatArray]:
    """Position (dim,) in m and velocity (dim,) in m/s of the uppermost pivot of a vehicle."""
    body = int(carriages.body_offset[carriage])
    dim = carriages.upper_pivot.shape[1]
    arm, turning = _arm(state, body, carriages.upper_pivot[body])
    return state.bodies.position[body, :dim] + arm, state.bodies.velocity[body, :dim] + turning


def hang_together(carriages: Carriages, state: State, carriage: int, place: FloatArray, velocity: FloatArray) -> None:
    """Translate the bodies of a vehicle so that its joints close below `place` (dim,) in m with `velocity` in m/s.

    Orientations and spins stay, and so do accelerations, which the next step finds.
    """
    dim = place.size
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        for pivot, sign in ((carriages.upper_pivot[body], -1.0), (carriages.lower_pivot[body], 1.0)):
            arm, turning = _arm(state, body, pivot)
            place, velocity = place + sign * arm, velocity + sign * turning
            if sign < 0.0:
                state.bodies.position[body, :dim], state.bodies.velocity[body, :dim] = place, velocity


def _arm(state: State, body: int, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vector (dim,) in m from a body's centre to its point at `offset` in body axes, and its rate (dim,) in m/s."""
    dim = offset.size
    arm = np.array(orientation(state.bodies.position[body], tuple(offset))).reshape(dim, dim) @ offset
    return arm, np.array(cross(tuple(state.bodies.velocity[body, dim:]), tuple(arm)))
