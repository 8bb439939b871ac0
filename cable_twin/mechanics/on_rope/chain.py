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
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    block,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    transpose,
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
    """Rotation matrix (dim²) of a body."""
    return orientation(state.bodies.position[body], like)


@inlined_kernel
def spin_of(rates, body, like):
    """Angular velocity (turns,) in rad/s of a body, or its rate, from the rates (bodies, dim + turns) of all bodies."""
    return load(rates[body, len(like) :], no_turn(like))


@inlined_kernel
def arm_to(axes, offset, like):
    """Arm A u (dim,) in m of a point at `offset` (dim,) in the axes of a body."""
    return product(axes, load(offset, like))


@inlined_kernel
def pivot_position(state, body, offset, like):
    """Position (dim,) in m of a point of `body`."""
    return add_scaled(1.0, centre(state, body, like), arm_to(axes_of(state, body, like), offset, like))


@inlined_kernel
def pivot_velocity(state, body, offset, like):
    """Velocity (dim,) in m/s of a point of `body`."""
    arm = arm_to(axes_of(state, body, like), offset, like)
    velocity = state.bodies.velocity
    return add_scaled(1.0, load(velocity[body], like), cross(spin_of(velocity, body, like), arm))


@kernel
def hang_chain(carriages, state, carriage, place, along):
    """Place every body of a carriage upright below `place` (dim,) in m, with heading `along` (dim,) the cable."""
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        set_upright(state.bodies.position[body], along)
        axes = axes_of(state, body, place)
        at = subtract(place, arm_to(axes, carriages.upper_pivot[body], place))
        store(at, state.bodies.position[body])
        place = add_scaled(1.0, at, arm_to(axes, carriages.lower_pivot[body], place))


@kernel
def move_chain(carriages, gravity, state, carriage, velocity, acceleration):
    """Set a common velocity (m/s) and acceleration (m/s²), (dim,), of all bodies of a carriage, and joint forces."""
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
def close_joints(carriages, state, carriage, place, direction, work):
    """Gaps (eq. 14) of all joints of a carriage at `place` (dim,) in m, for the cable orientation `direction`."""
    above = place
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        store(subtract(above, pivot_position(state, body, carriages.upper_pivot[body], place)), work.joint_gap[body])
        above = pivot_position(state, body, carriages.lower_pivot[body], place)
        measure_held(carriages, state, body, body == carriages.body_offset[carriage], direction, work.held_gap[body])


@kernel
def joint_accelerations(carriages, state, carriage, feedback, cable, above, work):
    """Right side γ of eq. 12 for all joints of a carriage: accelerations (m/s²) at q_ddot = 0.

    `cable` has position and velocity (dim,) of the joint on the cable, and the parts that velocities make of its
    acceleration and of the rate of its spin (turns,); `above` is how the cable is turned there. The gaps and their
    rates are fed back with `feedback` (1/s) squared and doubled.
    """
    position, velocity, acceleration, turning = cable
    like = position
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        upper, lower = carriages.upper_pivot[body], carriages.lower_pivot[body]
        axes, spin = axes_of(state, body, like), spin_of(state.bodies.velocity, body, like)
        towards = cross(spin, cross(spin, arm_to(axes, upper, like)))
        apart = subtract(position, pivot_position(state, body, upper, like))
        moving = subtract(velocity, pivot_velocity(state, body, upper, like))
        gap = add_scaled(
            2.0 * feedback, moving, add_scaled(feedback * feedback, apart, subtract(acceleration, towards))
        )
        store(gap, work.joint_gap[body])
        first = body == carriages.body_offset[carriage]
        accelerate_held(state, body, first, above, turning, feedback, work.held_gap[body])
        position = pivot_position(state, body, lower, like)
        velocity = pivot_velocity(state, body, lower, like)
        acceleration = cross(spin, cross(spin, arm_to(axes, lower, like)))


@inlined_kernel
def balance(carriages, gravity, state, body, arms, joints, factors, work):
    """Residual force (dim,) and moment (turns,) of a body, and derivative of its moment by its rotation.

    Takes its arms to both pivots, the force and moment at the lower one and the moment at the upper one, and the
    factors of `assemble`.
    """
    like, still, mass = gravity, no_turn(gravity), carriages.mass[body]
    up, low = arms
    below, below_moment, moment_above = joints
    force = load(state.multipliers[body], like)
    inertia = inertia_of(carriages.inertia, body, axes_of(state, body, like), like)
    spin = spin_of(state.bodies.velocity, body, like)
    turning = spin_of(state.bodies.acceleration, body, like)
    inert, stiff = gyration(inertia, spin, turning, load(work.turned[body], still), factors[0], factors[1], factors[2])
    residual = scale(mass, subtract(load(state.bodies.acceleration[body], like), gravity))
    residual = add_scaled(1.0, below, subtract(subtract(residual, force), load(work.body_drag[body], like)))
    residual_turn = add_scaled(1.0, moment(low, below), subtract(inert, moment(up, force)))
    return residual, add_scaled(1.0, below_moment, subtract(residual_turn, moment_above)), stiff


@kernel
def condense_chain(carriages, gravity, state, carriage, above, mass_factor, rate_factor, stiffness_factor, work):
    """Eliminate all bodies of a carriage; leaves D and b of its cable joint in row body_offset[carriage].

    Needs `joint_gap`, and how the cable is turned at the joint, `above` (`hinge.Above`). The equations of a body are
    M q_ddot - Q = λ, m at its upper pivot less λ, m at its lower one.
    """
    like, still = gravity, no_turn(gravity)
    first, end = carriages.body_offset[carriage], carriages.body_offset[carriage + 1]
    # of what hangs below: force and moment by the place of the pivot and by the turn of this body, and now
    pp, pt = outer(0.0, like, like), outer(0.0, like, still)
    tp, tt = outer(0.0, still, like), outer(0.0, still, still)
    b, b_turn = scale(0.0, like), still
    below, below_moment = scale(0.0, like), still
    for body in range(end - 1, first - 1, -1):
        mass, axes = carriages.mass[body], axes_of(state, body, like)
        force = load(state.multipliers[body], like)
        joint = hinge(carriages, state, body, body == first, above, stiffness_factor, rate_factor, like)
        up, low = arm_to(axes, carriages.upper_pivot[body], like), arm_to(axes, carriages.lower_pivot[body], like)
        if body == end - 1:
            low = scale(0.0, low)
        joints = below, below_moment, joint.moment
        residual, residual_turn, stiff = balance(
            carriages, gravity, state, body, (up, low), joints, (mass_factor, rate_factor, stiffness_factor), work
        )
        geometric = subtract(moment_by_turn(low, below), moment_by_turn(up, force))
        stiff = add_scaled(stiffness_factor, geometric, stiff)

        # centre of mass and lower pivot by the turn, upper pivot held
        by_up, down = scale(-1.0, by_turn(up)), subtract(by_turn(low), by_turn(up))
        row_up, row_down = transpose(by_up), transpose(down)
        gap = load(work.joint_gap[body], like)
        m = block(1.0, load(work.body_drag_tangent[body], pp), mass_factor * mass)
        on = add_scaled(1.0, residual, product(m, gap))
        b = add_scaled(1.0, product(pp, gap), b)
        b_turn = add_scaled(1.0, product(tp, gap), b_turn)
        m_up = add_scaled(1.0, load(work.body_drag_turning[body], pt), product(m, by_up))
        carried = add_scaled(1.0, product(pp, down), pt)  # the turn takes along what is below
        column = add_scaled(1.0, m_up, carried)  # force by the turn
        row = add_scaled(1.0, product(row_up, m), add_scaled(1.0, product(row_down, pp), tp))
        stiff = add_scaled(1.0, product(row_up, m_up), stiff)
        stiff = add_scaled(1.0, product(row_down, carried), stiff)
        stiff = add_scaled(1.0, add_scaled(1.0, product(tp, down), tt), stiff)
        right = add_scaled(1.0, product(row_up, on), residual_turn)
        right = add_scaled(1.0, product(row_down, b), add_scaled(1.0, b_turn, right))

        # the turn is -(by_place p + by_above θ + least), with what its joint holds
        inverse = inverse_of(add_scaled(1.0, joint.by_turn, stiff))
        by_place, by_above = product(inverse, row), scale(-1.0, product(inverse, joint.by_above))
        least = product(inverse, right)
        by_place, by_above, least, held = hold(joint, inverse, by_place, by_above, least, work.held_gap[body])
        keep_turn((by_place, by_above, least), held, body, work)

        pp = subtract(add_scaled(1.0, m, pp), product(column, by_place))
        pt = scale(-1.0, product(column, by_above))
        b = add_scaled(1.0, on, subtract(b, product(column, least)))
        tp = add_held(product(joint.by_turn, by_place), held.by_place)
        tt = add_held(add_scaled(1.0, product(joint.by_turn, by_above), joint.by_above), held.by_above)
        b_turn = add_held(product(joint.by_turn, least), held.least)
        keep_impedance((pp, pt, tp, tt, b, b_turn), body, work)
        below, below_moment = force, joint.moment


@inlined_kernel
def keep_turn(coefficients, held, body, work):
    """Store the coefficients of rotation and constraint moment of a body by the motion of its upper pivot."""
    store(coefficients[0], work.turn_by_place[body])
    store(coefficients[1], work.turn_by_above[body])
    store(coefficients[2], work.turn_right[body])
    keep_held(held, body, work)


@inlined_kernel
def keep_impedance(parts, body, work):
    """Store impedance D and b of the chain from a body downwards."""
    pp, pt, tp, tt, b, b_turn = parts
    store(pp, work.impedance[body])
    store(pt, work.impedance_turning[body])
    store(tp, work.impedance_moment[body])
    store(tt, work.impedance_turn[body])
    store(b, work.impedance_force[body])
    store(b_turn, work.impedance_force[body, len(b) :])


@kernel
def recover_chain(carriages, state, carriage, moved, turned, work):
    """Increments of bodies and multipliers, from displacement (dim,) and rotation (turns,) of the cable joint.

    The increments of the bodies go to `body_increment`; the multipliers are brought up to date here.
    """
    like, still, dim = moved, turned, len(moved)
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        by_place = load(work.impedance[body], outer(0.0, like, like))
        by_above = load(work.impedance_turning[body], outer(0.0, like, still))
        change = add_scaled(1.0, product(by_place, moved), product(by_above, turned))
        accumulate(add_scaled(1.0, load(work.impedance_force[body], like), change), state.multipliers[body])
        recover_held(state, body, moved, turned, work)
        by_place = load(work.turn_by_place[body], outer(0.0, still, like))
        by_above = load(work.turn_by_above[body], outer(0.0, still, still))
        turn = add_scaled(1.0, product(by_place, moved), product(by_above, turned))
        turn = scale(-1.0, add_scaled(1.0, load(work.turn_right[body], still), turn))
        axes = axes_of(state, body, like)
        up, low = arm_to(axes, carriages.upper_pivot[body], like), arm_to(axes, carriages.lower_pivot[body], like)
        place = subtract(add_scaled(1.0, load(work.joint_gap[body], like), moved), cross(turn, up))
        store(place, work.body_increment[body])
        store(turn, work.body_increment[body, dim:])
        moved, turned = add_scaled(1.0, place, cross(turn, low)), turn


@kernel
def carriage_mass(carriages, carriage):
    """Mass (kg) of all bodies of a carriage."""
    total = 0.0
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        total += carriages.mass[body]
    return total


def centre_offsets(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> FloatArray:
    """Shift (bodies, dim) in m of the centres of mass of the empty `carriages` under payloads (carriages,) in kg."""
    offsets = np.zeros(carriages.upper_pivot.shape)
    for body, position, mass in zip(payloads.body, payloads.position, masses, strict=True):
        if mass > 0.0:
            offsets[body] = mass / (carriages.mass[body] + mass) * position
    return offsets


def load_bodies(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> Carriages:
    """Carriages with payloads (carriages,) in kg: mass, inertia about the common centre, pivots from that centre."""
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
    """Move the reference centres of mass of `state` by `change` (bodies, dim) in m in body axes, bodies unmoved."""
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
