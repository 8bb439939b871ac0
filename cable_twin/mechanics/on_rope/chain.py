"""A carriage: a chain of rigid bodies below its joint with the cable. The only module that knows of a plane.

Body coordinates are x, z of the centre of mass and the pitch, right-handed about y: a point u of the body is at
c + A u with A = [[cos, sin], [-sin, cos]]. The multiplier of a joint is the force on the body below it.

The chain is eliminated from its end upwards (articulated bodies): at any pivot it acts on what is above as an
impedance, Δ(λ, m) = D Δ(p, θ) + b, where D is symmetric 3 x 3: force and moment there, by the place of the pivot and
the pitch of what is above. m is what a hinge passes on (`hinge`). One scalar division a body, no matrix to factorise.
"""

from __future__ import annotations

from math import cos, sin

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import store
from cable_twin.mechanics.on_rope.hinge import hinge_moment


@kernel
def pivot(pitch, offset):
    """Arm A u (m) from the centre of mass to a pivot, and its derivative by the pitch."""
    c, s = cos(pitch), sin(pitch)
    arm_x = c * offset[0] + s * offset[1]
    arm_z = -s * offset[0] + c * offset[1]
    return arm_x, arm_z, arm_z, -arm_x


@kernel
def pivot_position(state, body, offset):
    """Position (x, z) in m of a pivot of `body`."""
    q = state.bodies.position[body]
    arm_x, arm_z, _, _ = pivot(q[2], offset)
    return q[0] + arm_x, q[1] + arm_z


@kernel
def pivot_velocity(state, body, offset):
    """Velocity (x, z) in m/s of a pivot of `body`."""
    v = state.bodies.velocity[body]
    _, _, turn_x, turn_z = pivot(state.bodies.position[body, 2], offset)
    return v[0] + turn_x * v[2], v[1] + turn_z * v[2]


@kernel
def hang_chain(carriages, state, carriage, joint_x, joint_z):
    """Hang every body of a carriage upright below (joint_x, joint_z), in m."""
    x, z = joint_x, joint_z
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        state.bodies.position[body, 0] = x - carriages.upper_pivot[body, 0]
        state.bodies.position[body, 1] = z - carriages.upper_pivot[body, 1]
        state.bodies.position[body, 2] = 0.0
        x = state.bodies.position[body, 0] + carriages.lower_pivot[body, 0]
        z = state.bodies.position[body, 1] + carriages.lower_pivot[body, 1]


@kernel
def move_chain(carriages, gravity, state, carriage, velocity, acceleration):
    """Give all bodies of a carriage one velocity and acceleration (x, z) in m/s and m/s², and the forces of that."""
    force_x, force_z = 0.0, 0.0
    for body in range(carriages.body_offset[carriage + 1] - 1, carriages.body_offset[carriage] - 1, -1):
        for axis in range(2):
            state.bodies.velocity[body, axis] = velocity[axis]
            state.bodies.acceleration[body, axis] = acceleration[axis]
            state.bodies.algorithmic[body, axis] = acceleration[axis]
        state.bodies.velocity[body, 2] = 0.0
        state.bodies.acceleration[body, 2] = 0.0
        state.bodies.algorithmic[body, 2] = 0.0
        force_x += carriages.mass[body] * (acceleration[0] - gravity[0])
        force_z += carriages.mass[body] * (acceleration[1] - gravity[1])
        state.multipliers[body, 0], state.multipliers[body, 1] = force_x, force_z


@kernel
def close_joints(carriages, state, carriage, joint_x, joint_z, work):
    """Gaps (eq. 14) of all joints of a carriage whose place on the cable is (joint_x, joint_z), in m."""
    above_x, above_z = joint_x, joint_z
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        x, z = pivot_position(state, body, carriages.upper_pivot[body])
        work.joint_gap[body, 0] = above_x - x
        work.joint_gap[body, 1] = above_z - z
        above_x, above_z = pivot_position(state, body, carriages.lower_pivot[body])


@kernel
def joint_accelerations(carriages, state, carriage, feedback, position, velocity, acceleration, work):
    """Right side γ of eq. 12 for all joints of a carriage: accelerations (m/s²) that remain with q_ddot = 0.

    `position`, `velocity` (x, z) are those of the joint on the cable, `acceleration` the part of its acceleration that
    velocities make. The gaps and their rates are fed back with `feedback` (1/s) squared and doubled.
    """
    above_x, above_z = acceleration[0], acceleration[1]
    place_x, place_z, speed_x, speed_z = position[0], position[1], velocity[0], velocity[1]
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        pitch, spin = state.bodies.position[body, 2], state.bodies.velocity[body, 2]
        arm_x, arm_z, _, _ = pivot(pitch, carriages.upper_pivot[body])
        x, z = pivot_position(state, body, carriages.upper_pivot[body])
        v_x, v_z = pivot_velocity(state, body, carriages.upper_pivot[body])
        gap = feedback * (2.0 * (speed_x - v_x) + feedback * (place_x - x))
        work.joint_gap[body, 0] = above_x + arm_x * spin * spin + gap
        gap = feedback * (2.0 * (speed_z - v_z) + feedback * (place_z - z))
        work.joint_gap[body, 1] = above_z + arm_z * spin * spin + gap
        place_x, place_z = pivot_position(state, body, carriages.lower_pivot[body])
        speed_x, speed_z = pivot_velocity(state, body, carriages.lower_pivot[body])
        arm_x, arm_z, _, _ = pivot(pitch, carriages.lower_pivot[body])
        above_x, above_z = -arm_x * spin * spin, -arm_z * spin * spin


@kernel
def condense_chain(carriages, gravity, state, carriage, direction, mass_factor, rate_factor, stiffness_factor, work):
    """Eliminate all bodies of a carriage; leaves D and b of its joint with the cable in row body_offset[carriage].

    Needs `joint_gap`, and the pitch of the cable at the joint and its rate (rad, rad/s) as `direction` where there is
    a hinge. The equations of a body are M q_ddot - Q = λ, m at its upper pivot less λ, m at its lower one.
    """
    first, end = carriages.body_offset[carriage], carriages.body_offset[carriage + 1]
    d_xx, d_xz, d_zz, b_x, b_z = 0.0, 0.0, 0.0, 0.0, 0.0  # of what hangs below
    d_xt, d_zt, d_tt, b_t = 0.0, 0.0, 0.0, 0.0  # t: turning
    below_x, below_z, below_t = 0.0, 0.0, 0.0  # force and moment of the joint below
    for body in range(end - 1, first - 1, -1):
        mass, inertia = carriages.mass[body], carriages.inertia[body]
        q_ddot = state.bodies.acceleration[body]
        force_x, force_z = state.multipliers[body, 0], state.multipliers[body, 1]
        pitch = state.bodies.position[body, 2]
        moment, by_angle, by_rate = hinge_of(carriages, state, body, body == first, direction)
        store((moment, by_angle, by_rate), work.hinge[body])
        hinge = stiffness_factor * by_angle + rate_factor * by_rate
        _, _, turn_x, turn_z = pivot(pitch, carriages.upper_pivot[body])
        _, _, low_x, low_z = pivot(pitch, carriages.lower_pivot[body])
        if body == end - 1:
            low_x, low_z = 0.0, 0.0
        residual_x = mass * (q_ddot[0] - gravity[0]) - force_x + below_x - work.body_drag[body, 0]
        residual_z = mass * (q_ddot[1] - gravity[1]) - force_z + below_z - work.body_drag[body, 1]
        residual_pitch = inertia * q_ddot[2] - turn_x * force_x - turn_z * force_z + low_x * below_x + low_z * below_z
        residual_pitch += below_t - moment
        # the second derivative of an arm is the arm with its sign changed: turn' = (turn_z, -turn_x)
        geometric = -turn_z * force_x + turn_x * force_z + low_z * below_x - low_x * below_z
        gap_x, gap_z = work.joint_gap[body, 0], work.joint_gap[body, 1]
        m = mass_factor * mass
        drag = work.body_drag_tangent[body]  # adds to the mass as seen by Newton: xx, xz, zz
        up_x, up_z = -turn_x, -turn_z  # centre of mass by pitch, upper pivot held
        down_x, down_z = low_x - turn_x, low_z - turn_z  # lower pivot by pitch, upper pivot held
        on_x = residual_x + m * gap_x + (drag[0] * gap_x + drag[1] * gap_z)
        on_z = residual_z + m * gap_z + (drag[1] * gap_x + drag[2] * gap_z)
        b_x += d_xx * gap_x + d_xz * gap_z
        b_z += d_xz * gap_x + d_zz * gap_z
        b_t += d_xt * gap_x + d_zt * gap_z
        carried_x = d_xx * down_x + d_xz * down_z + d_xt  # D of (down, 1): the pitch turns what is below, too
        carried_z = d_xz * down_x + d_zz * down_z + d_zt
        carried_t = d_xt * down_x + d_zt * down_z + d_tt
        dragged_x, dragged_z = drag[0] * up_x + drag[1] * up_z, drag[1] * up_x + drag[2] * up_z
        row_x, row_z, row_t = m * up_x + carried_x + dragged_x, m * up_z + carried_z + dragged_z, -hinge
        stiffness = mass_factor * inertia + stiffness_factor * geometric
        stiffness += m * (up_x * up_x + up_z * up_z) + down_x * carried_x + down_z * carried_z
        stiffness += up_x * dragged_x + up_z * dragged_z + (carried_t + hinge)
        right = residual_pitch + up_x * on_x + up_z * on_z + down_x * b_x + down_z * b_z + b_t
        work.pitch_pivot[body], work.pitch_right[body] = stiffness, right
        store((row_x, row_z, row_t), work.pitch_row[body])
        d_xx += m - row_x * row_x / stiffness + drag[0]
        d_xz += drag[1] - row_x * row_z / stiffness
        d_zz += m - row_z * row_z / stiffness + drag[2]
        d_xt, d_zt, d_tt = -row_x * row_t / stiffness, -row_z * row_t / stiffness, hinge - row_t * row_t / stiffness
        b_x += on_x - row_x * right / stiffness
        b_z += on_z - row_z * right / stiffness
        b_t = -row_t * right / stiffness
        store((d_xx, d_xz, d_zz), work.impedance[body])
        store((d_xt, d_zt, d_tt), work.impedance_turning[body])
        store((b_x, b_z, b_t), work.impedance_force[body])
        below_x, below_z, below_t = force_x, force_z, moment


@kernel
def recover_chain(carriages, state, carriage, moved, turned, work):
    """Increments of bodies and multipliers for those of the joint's place (x, z) on the cable and its direction (rad).

    The increments of the bodies go to `body_increment`; the multipliers are brought up to date here.
    """
    p_x, p_z, p_t = moved[0], moved[1], turned
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        d, d_t, b = work.impedance[body], work.impedance_turning[body], work.impedance_force[body]
        state.multipliers[body, 0] += d[0] * p_x + d[1] * p_z + d_t[0] * p_t + b[0]
        state.multipliers[body, 1] += d[1] * p_x + d[2] * p_z + d_t[1] * p_t + b[1]
        row = work.pitch_row[body]
        turn = -(row[0] * p_x + row[1] * p_z + row[2] * p_t + work.pitch_right[body]) / work.pitch_pivot[body]
        pitch = state.bodies.position[body, 2]
        _, _, turn_x, turn_z = pivot(pitch, carriages.upper_pivot[body])
        _, _, low_x, low_z = pivot(pitch, carriages.lower_pivot[body])
        centre_x = p_x + work.joint_gap[body, 0] - turn_x * turn
        centre_z = p_z + work.joint_gap[body, 1] - turn_z * turn
        work.body_increment[body, 0] = centre_x
        work.body_increment[body, 1] = centre_z
        work.body_increment[body, 2] = turn
        p_x, p_z, p_t = centre_x + low_x * turn, centre_z + low_z * turn, turn


@kernel
def hinge_of(carriages, state, body, on_cable, direction):
    """Moment (N m) on a body at its upper pivot and its tangent, as `hinge_moment`; above it is a body or the cable."""
    above, rate = direction[0], direction[1]
    if not on_cable:
        above, rate = state.bodies.position[body - 1, 2], state.bodies.velocity[body - 1, 2]
    return hinge_moment(carriages, body, state.bodies.position[body, 2] - above, state.bodies.velocity[body, 2] - rate)


@kernel
def carriage_mass(carriages, carriage):
    """Mass (kg) of all bodies of a carriage."""
    total = 0.0
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        total += carriages.mass[body]
    return total
