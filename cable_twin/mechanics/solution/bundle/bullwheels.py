"""Bullwheels: friction drives and tensioning devices between two strands of a rope, and motion of the strand ends.

A wheel counts rope by its unstrained length, of which as much leaves it as comes to it; the force conjugate to that
length is the tension times the stretch there, and times the rate of the length the power. A wheel turned by its forces,
and the carriage of a counterweight, are coordinates of generalized-alpha like those of the ropes, solved for with them
(`wheel_tangent`). The motion of a driven wheel, of slipping rope, of a wheel stopped by its brake and of a
hydraulic cylinder follows from the forces at the start of the step. The ends of the strands move with their wheels.
"""

from __future__ import annotations

from math import inf, nan, sqrt

from cable_twin.mechanics.drives.motion import prescribe
from cable_twin.mechanics.drives.moving_rope import carry_clamped
from cable_twin.mechanics.drives.speed_reference import approach_target, follow, ramp
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, store
from cable_twin.mechanics.on_rope.brakes import drive_limit, saturation_of
from cable_twin.mechanics.on_rope.buffer import buffer_force
from cable_twin.mechanics.parameters import FORCE, SPEED
from cable_twin.mechanics.readout.columns import STOPPING
from cable_twin.mechanics.readout.sections import end_force
from cable_twin.mechanics.solution.bundle.records import (
    COUNTERWEIGHT,
    FIXED,
    HYDRAULIC,
    STATE,
    SYSTEM,
)
from cable_twin.mechanics.solution.prediction import factors, predict_one

HYDRAULIC_ACCELERATION = 0.2  # m/s², with which a tensioning cylinder takes up its speed
NOTHING, ROPE, WHEEL = range(3)  # BullwheelMotion.by_forces


@kernel
def move_bullwheels(sheaves, motion, c, h):
    """Advance all bullwheels and their tensioning carriages by `h` (s): prescribed, or predicted for Newton."""
    for sheave in range(sheaves.inertia.size):
        turn_wheel(sheaves, motion, sheave, c, h)
        if sheaves.tensioning[sheave] == COUNTERWEIGHT:
            predict_one(c, h, motion.carriage, sheave)
        if sheaves.tensioning[sheave] == HYDRAULIC:
            move_cylinder(sheaves, motion, sheave, h)


@kernel
def turn_wheel(sheaves, motion, sheave, c, h):
    """Advance the rim of one bullwheel, and the rope sticking to or slipping on the rim, by `h` (s)."""
    rim, rope, wrapped = motion.rim, motion.rope, sheaves.wrapped[sheave]
    pulled = motion.stretch[sheave] * (motion.tension[sheave, 1] - motion.tension[sheave, 0])
    place, was_turned = rim.position[sheave], motion.by_forces[sheave] == WHEEL
    slipping = motion.slipping[sheave]
    net = -friction_on_rope(sheaves, motion, sheave, slipping) if slipping != 0 else pulled
    inertia = sheaves.inertia[sheave] if slipping != 0 else sheaves.inertia[sheave] + wrapped
    turns, rate = drive_rim(sheaves, motion, sheave, net, inertia, h)
    if slipping == 0:
        if turns and was_turned:
            rate = rope.acceleration[sheave]
        traction = wrapped * rate - pulled
        if traction > friction_on_rope(sheaves, motion, sheave, 1):
            slipping = 1
        elif traction < friction_on_rope(sheaves, motion, sheave, -1):
            slipping = -1
        if turns and slipping != 0:  # from now on friction turns it
            follow(rim, sheave, place + rim.velocity[sheave] * h, rim.velocity[sheave], 0.0)
    motion.slipping[sheave] = slipping
    if slipping != 0:
        motion.by_forces[sheave] = ROPE
        predict_one(c, h, rope, sheave)
    elif turns:
        motion.by_forces[sheave] = WHEEL
        if not was_turned:  # its forces are new: go on with what they make of it now
            rope.acceleration[sheave] = rope.algorithmic[sheave] = rate
        before = rope.position[sheave]
        predict_one(c, h, rope, sheave)
        follow(rim, sheave, place + rope.position[sheave] - before, rope.velocity[sheave], rope.acceleration[sheave])
    else:
        motion.by_forces[sheave] = NOTHING
        follow(rope, sheave, rope.position[sheave] + rim.position[sheave] - place, rim.velocity[sheave], rate)
        rope.algorithmic[sheave] = rate


@kernel
def drive_rim(sheaves, motion, sheave, net, inertia, h):
    """Advance a bullwheel's rim by `h` (s) under its drive, or brake and bearings, against a net rope force (N).

    Returns:
        Whether forces turn the wheel with the rope, which the caller still has to advance; acceleration (m/s²).
    """
    rim, speed, place = motion.rim, motion.rim.velocity[sheave], motion.rim.position[sheave]
    by_brake = motion.drives.braking[sheave] and sheaves.brake_force[sheave] > 0.0
    if motion.drives.mode[sheave] == SPEED and not by_brake:
        ahead, behind = sheaves.way[sheave, 1] - place, place - sheaves.way[sheave, 0]
        approach_target(sheaves.limits, motion.drives, sheave, rim, ahead, behind, h)
        return False, rim.acceleration[sheave]
    against = resisting(sheaves, motion, sheave, h)
    given = motion.drives.force[sheave] if motion.drives.mode[sheave] == FORCE and not by_brake else 0.0
    net += given
    direction = speed if speed != 0.0 else net
    given -= against if direction > 0.0 else -against
    rate = (net - (against if direction > 0.0 else -against)) / inertia
    if abs(net) <= against and (speed == 0.0 or (speed + rate * h) * speed <= 0.0):
        follow(rim, sheave, place + 0.5 * speed * h, 0.0, -speed / h)  # it comes to rest, or stays so
        return False, -speed / h
    if motion.slipping[sheave] != 0:
        follow(rim, sheave, place + (speed + 0.5 * rate * h) * h, speed + rate * h, rate)
        return False, rate
    motion.given[sheave] = given
    return True, rate


@kernel
def friction_on_rope(sheaves, motion, sheave, sense):
    """Friction force (N) of a bullwheel's rim on a slipping rope; `sense` 1 for a faster rim, -1 for a slower one."""
    share = motion.stretch[sheave] * (sheaves.adhesion[sheave] - 1.0)
    return share * max(motion.tension[sheave, 1], 0.0) if sense > 0 else -share * max(motion.tension[sheave, 0], 0.0)


@kernel
def resisting(sheaves, motion, sheave, h):
    """Resisting force (N) of bearings and brake of a bullwheel: against motion, or up to the driving force at rest."""
    against = sheaves.resistance[sheave]
    if motion.drives.braking[sheave] and sheaves.brake_force[sheave] > 0.0:
        motion.drives.braking_time[sheave] += h
        rise = sheaves.brake_rise_time[sheave]
        share = min(motion.drives.braking_time[sheave] / rise, 1.0) if rise > 0.0 else 1.0
        against += share * sheaves.brake_force[sheave]
    return against


@kernel
def move_cylinder(sheaves, motion, sheave, h):
    """Advance the carriage of a hydraulic tensioning device by `h` (s), driven while the pull is out of its band."""
    travel, low, high = motion.carriage.position[sheave], sheaves.travel[sheave, 0], sheaves.travel[sheave, 1]
    missing, wanted = sheaves.pull[sheave] - motion.pull[sheave], 0.0
    if abs(missing) > sheaves.band[sheave]:
        wanted = sheaves.rate[sheave] if missing > 0.0 else -sheaves.rate[sheave]
    most = sqrt(2.0 * HYDRAULIC_ACCELERATION * max(high - travel, 0.0))
    least = -sqrt(2.0 * HYDRAULIC_ACCELERATION * max(travel - low, 0.0))
    ramp(motion.carriage, sheave, min(max(wanted, least), most), HYDRAULIC_ACCELERATION, inf, h)
    motion.carriage.algorithmic[sheave] = motion.carriage.acceleration[sheave]


@kernel
def add_increment(kind, row, c, h, delta):
    """Apply a Newton increment to one coordinate and its rates, see `prediction.correct`."""
    by_acceleration, by_velocity = factors(c, h)
    kind.position[row] += delta
    kind.velocity[row] += by_velocity * delta
    kind.algorithmic[row] += delta / (c.beta * h * h)
    kind.acceleration[row] += by_acceleration * delta


@kernel
def correct_bullwheels(sheaves, motion, increments, c, h):
    """Apply the Newton increments (2 wheels,) in m of rope over each bullwheel and of its tensioning carriage."""
    for sheave in range(sheaves.inertia.size):
        moved, travelled = increments[2 * sheave], increments[2 * sheave + 1]
        if motion.by_forces[sheave] != NOTHING:
            add_increment(motion.rope, sheave, c, h, moved)
            if motion.by_forces[sheave] == WHEEL:
                add_increment(motion.rim, sheave, c, h, moved)
        if sheaves.tensioning[sheave] == COUNTERWEIGHT:
            add_increment(motion.carriage, sheave, c, h, travelled)


@kernel
def missing_rope(sheaves, motion, sheave, mass_factor):
    """Residual force (N) on the rope over a bullwheel, and its tangent (N/m) without that of the strands."""
    force = motion.stretch[sheave] * (motion.tension[sheave, 1] - motion.tension[sheave, 0])
    inertia, slipping = sheaves.wrapped[sheave], motion.slipping[sheave]
    if slipping == 0:
        inertia += sheaves.inertia[sheave]
        force += motion.given[sheave]
    else:
        force += friction_on_rope(sheaves, motion, sheave, slipping)
    return force - inertia * motion.rope.acceleration[sheave], inertia * mass_factor


@kernel
def tension_shares(sheaves, motion, sheave):
    """Factors of the incoming and the outgoing tension in the residual force on the rope over a bullwheel."""
    slipping = motion.slipping[sheave]
    on = sheaves.adhesion[sheave] if slipping < 0 and motion.tension[sheave, 0] > 0.0 else 1.0
    off = sheaves.adhesion[sheave] if slipping > 0 and motion.tension[sheave, 1] > 0.0 else 1.0
    return on, off


@kernel
def missing_travel(sheaves, motion, sheave, mass_factor, rate_factor):
    """Residual force (N) on the carriage of a bullwheel's counterweight, and tangent (N/m) without the strands."""
    travel, speed = motion.carriage.position[sheave], motion.carriage.velocity[sheave]
    low, high = sheaves.travel[sheave, 0], sheaves.travel[sheave, 1]
    sign, depth = (1.0, low - travel) if travel < low else (-1.0, travel - high)
    stiffness, damping = sheaves.buffer_stiffness[sheave], sheaves.buffer_damping[sheave]
    buffer, by_depth, by_rate = buffer_force(stiffness, 0.0, damping, depth, -sign * speed)
    force = sheaves.pull[sheave] + sign * buffer - motion.pull[sheave]
    force -= sheaves.mass[sheave] * motion.carriage.acceleration[sheave]
    return force, sheaves.mass[sheave] * mass_factor + by_depth + rate_factor * by_rate


@kernel
def end_bullwheels(sheaves, motion, saturation):
    """End a step: store traction and drive force of all bullwheels, and stop all once one has rolled back too far.

    Args:
        sheaves: all bullwheels.
        motion: theirs.
        saturation: (wheels,) N, limit at which the drive of each was held in this step; 0 of others.
    """
    back = False
    for sheave in range(sheaves.inertia.size):
        pulled = motion.stretch[sheave] * (motion.tension[sheave, 1] - motion.tension[sheave, 0])
        motion.traction[sheave] = sheaves.wrapped[sheave] * motion.rope.acceleration[sheave] - pulled
        if motion.drives.mode[sheave] == SPEED:
            motion.drives.force[sheave] = holding_force(sheaves, motion, sheave)
        hold_again(motion, sheave)
        if way_back(motion, sheave, saturation[sheave] != 0.0) > sheaves.rollback[sheave]:
            motion.rolled_back[sheave] = 1
            back = True
    if back:
        for sheave in range(sheaves.inertia.size):
            stop_wheel(sheaves, motion, sheave)


@kernel
def wheels_gone_back(motion):
    """Number of bullwheels beyond their rollback limit."""
    count = 0
    for sheave in range(motion.rolled_back.size):
        count += motion.rolled_back[sheave]
    return count


@kernel
def hold_again(motion, sheave):
    """Let a slipping rope stick to its bullwheel's rim again at equal speeds."""
    rim, rope = motion.rim, motion.rope
    if (rim.velocity[sheave] - rope.velocity[sheave]) * motion.slipping[sheave] < 0.0:
        motion.slipping[sheave] = 0
        rope.velocity[sheave] = rim.velocity[sheave]
        rope.acceleration[sheave] = rope.algorithmic[sheave] = rim.acceleration[sheave]


@kernel
def way_back(motion, sheave, saturated):
    """Rollback (m) of a bullwheel's rim without speed control; in either direction before any drive has turned it.

    A drive that was held at its limit in this step (`saturated`) controls no speed, but has one as its target.
    """
    mode, place = motion.drives.mode[sheave], motion.rim.position[sheave]
    by_speed = mode == SPEED or saturated
    wanted = motion.drives.target[sheave] if by_speed else motion.drives.force[sheave] if mode == FORCE else 0.0
    if motion.drives.braking[sheave]:
        return 0.0
    if wanted != 0.0:
        motion.sense[sheave] = 1 if wanted > 0.0 else -1
    way = motion.furthest[sheave] - place
    back = way * motion.sense[sheave] if motion.sense[sheave] != 0 else abs(way)
    if mode != FORCE or back < 0.0:
        motion.furthest[sheave], back = place, 0.0
    return back


@kernel
def stop_wheel(sheaves, motion, sheave):
    """Begin the emergency stop of one bullwheel: by its brake, or else by its drive."""
    if not motion.drives.braking[sheave]:
        motion.drives.braking_time[sheave] = 0.0
    motion.drives.braking[sheave], motion.drives.target[sheave] = True, 0.0
    motion.by_forces[sheave] = NOTHING
    if sheaves.driven[sheave]:
        motion.drives.mode[sheave] = SPEED


@kernel
def observe_bullwheels(sheaves, motion, driven, numbers, columns):
    """Fill an output frame's columns for all bullwheels, and for drives `numbers` (n,) at the wheels `driven` (n,)."""
    for sheave in range(sheaves.inertia.size):
        rim, rope = motion.rim, motion.rope
        columns.sheave_position[sheave], columns.sheave_speed[sheave] = rope.position[sheave], rope.velocity[sheave]
        columns.sheave_force[sheave] = motion.drives.force[sheave]
        columns.sheave_tension[sheave, 0] = motion.tension[sheave, 0]
        columns.sheave_tension[sheave, 1] = motion.tension[sheave, 1]
        fixed = sheaves.tensioning[sheave] == FIXED
        columns.sheave_travel[sheave] = nan if fixed else motion.carriage.position[sheave]
        columns.sheave_slip[sheave] = rim.position[sheave] - rope.position[sheave]
        columns.sheave_rolled_back[sheave] = motion.rolled_back[sheave]
    for row in range(driven.size):
        sheave, drive = driven[row], numbers[row]
        mode, place, speed = motion.drives.mode[sheave], motion.rim.position[sheave], motion.rim.velocity[sheave]
        columns.drive_position[drive], columns.drive_speed[drive] = place, speed
        columns.drive_reference_position[drive], columns.drive_reference_speed[drive] = place, speed
        columns.moving_cable_force[drive] = columns.sheave_force[sheave]
        columns.drive_command_kind[drive] = STOPPING if motion.drives.braking[sheave] else mode
        columns.drive_commanded_speed[drive] = motion.drives.target[sheave] if mode == SPEED else 0.0
        columns.drive_commanded_force[drive] = motion.drives.force[sheave] if mode == FORCE else 0.0


@kernel
def holding_force(sheaves, motion, sheave):
    """Force (N) at the rim of a bullwheel with which its drive holds the speed of its reference; 0 under a brake."""
    if motion.drives.braking[sheave] and sheaves.brake_force[sheave] > 0.0:
        return 0.0
    force = motion.traction[sheave] + sheaves.inertia[sheave] * motion.rim.acceleration[sheave]
    speed = motion.rim.velocity[sheave]
    sense = 1.0 if speed > 0.0 else -1.0 if speed < 0.0 else 0.0
    return force + sheaves.resistance[sheave] * sense


@kernel
def find_saturated_wheels(sheaves, motion, moving_before, scratch):
    """Find drives of bullwheels beyond their limits of force and power, as `motion.find_saturated` does of vehicles.

    Args:
        sheaves: all bullwheels.
        motion: theirs at the end of a step.
        moving_before: motion of all couplings at its start.
        scratch: its `saturation` is filled with the limits, and with 0 for drives within them, `asked` with the
            accelerations of the references.

    Returns:
        Whether there is any.
    """
    saturated = False
    for sheave in range(sheaves.inertia.size):
        scratch.saturation[sheave], scratch.asked[sheave] = 0.0, motion.rim.acceleration[sheave]
        if motion.drives.mode[sheave] != SPEED or motion.drives.braking[sheave]:
            continue
        speed = max(abs(moving_before.sheaves.rim.velocity[sheave]), abs(motion.rim.velocity[sheave]))
        limit = drive_limit(sheaves.limits, sheave, speed)
        scratch.saturation[sheave] = saturation_of(motion.drives.force[sheave], limit)
        saturated |= scratch.saturation[sheave] != 0.0
    return saturated


@kernel
def hold_wheels_at_limits(motion, saturation):
    """Switch drives of bullwheels beyond their limits to force mode, at the limit (N) in `saturation` (wheels,)."""
    for sheave in range(saturation.size):
        if saturation[sheave] != 0.0:
            motion.drives.mode[sheave], motion.drives.force[sheave] = FORCE, saturation[sheave]


@kernel
def turn_by_speed_again(motion, scratch):
    """Switch saturated drives of bullwheels back to speed mode, their references going on from the speed reached.

    The acceleration asked for stays that of the reference, as in `motion.follow_again`.
    """
    for sheave in range(scratch.saturation.size):
        if scratch.saturation[sheave] != 0.0:
            motion.drives.mode[sheave], motion.rim.acceleration[sheave] = SPEED, scratch.asked[sheave]


@kernel
def give_ends(bundle, motion, system, state):
    """Prescribe the rope travel at both ends of all strands from their bullwheels."""
    sheaves = bundle.sheaves
    for sheave in range(sheaves.inertia.size):
        for side in range(2):
            here = record_at(bundle.records[sheaves.rope[sheave, side], STATE], state)
            position, speed = motion.rope.position[sheave], motion.rope.velocity[sheave]
            follow(here.rope, 1 - side, position, speed, motion.rope.acceleration[sheave])


@kernel
def place_ends(bundle, motion, system, state):
    """Prescribe position and motion of the end nodes of all strands from the carriages of their bullwheels."""
    sheaves, like = bundle.sheaves, system.cable.gravity
    for sheave in range(sheaves.inertia.size):
        if sheaves.tensioning[sheave] == FIXED:
            continue
        direction = load(sheaves.direction[sheave], like)
        for side in range(2):
            rope = sheaves.rope[sheave, side]
            cable = record_at(bundle.records[rope, SYSTEM], system).cable
            nodes = record_at(bundle.records[rope, STATE], state).nodes
            node = cable.element_count if side == 0 else 0
            place = add_scaled(motion.carriage.position[sheave], direction, load(cable.end_position[1 - side], like))
            store(place, nodes.position[node, 0])
            store(scale(motion.carriage.velocity[sheave], direction), nodes.velocity[node, 0])
            store(scale(motion.carriage.acceleration[sheave], direction), nodes.acceleration[node, 0])
            store(scale(motion.carriage.algorithmic[sheave], direction), nodes.algorithmic[node, 0])


@kernel
def propagate_wheels(bundle, motion, system, state):
    """Update all strands, and all vehicles clamped to them, from the bullwheels of the present iteration."""
    give_ends(bundle, motion, system, state)
    place_ends(bundle, motion, system, state)
    for rope in range(bundle.records.shape[0]):
        own = record_at(bundle.records[rope, SYSTEM], system)
        if own.moving_cable.over_bullwheels:
            here = record_at(bundle.records[rope, STATE], state)
            carry_clamped(own, here)
            prescribe(own, here)


@kernel
def update_end_tensions(bundle, motion, system, state):
    """Update the tension of both strands at each bullwheel, less the momentum flux turned by the wheel."""
    sheaves, like = bundle.sheaves, system.cable.gravity
    for sheave in range(sheaves.inertia.size):
        pull, stretch = 0.0, 1.0
        for side in range(2):
            rope = sheaves.rope[sheave, side]
            own = record_at(bundle.records[rope, SYSTEM], system)
            here = record_at(bundle.records[rope, STATE], state)
            force = end_force(own, here, 1 - side)
            r_x = load(here.nodes.position[own.cable.element_count if side == 0 else 0, 1], like)
            along = dot(force, r_x) / sqrt(dot(r_x, r_x))
            motion.tension[sheave, side] = along if side == 0 else -along
            stretch += 0.5 * motion.tension[sheave, side] / own.cable.axial_stiffness
            stretch += 0.5 * (own.cable.free_stretch - 1.0)
            if sheaves.tensioning[sheave] != FIXED:
                pull += dot(force, load(sheaves.direction[sheave], like))
        motion.pull[sheave], motion.stretch[sheave] = pull, stretch
