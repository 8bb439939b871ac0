"""Bullwheels: rope runs off one strand, over a wheel, onto another one, by friction; some are driven, some tension.

A wheel counts rope by its unstrained length, of which as much leaves it as comes to it. It and the carriage it may be
on are moved once a step by the forces at the end of the step before and what those were a step earlier
(Adams-Bashforth, of second order): both are heavy beside what a strand takes up within a step, h √(EA ρA). The strands
then have the ends that this gives them.
"""

from __future__ import annotations

from math import inf, sqrt

from cable_twin.mechanics.drives.reference import capped_speed, follow, ramp
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, store
from cable_twin.mechanics.on_rope.buffer import buffer_force
from cable_twin.mechanics.parameters import FORCE, SPEED
from cable_twin.mechanics.readout.columns import end_force
from cable_twin.mechanics.solution.bundle.records import COUNTERWEIGHT, FIXED, STATE, SYSTEM

HYDRAULIC_ACCELERATION = 0.2  # m/s², with which a tensioning cylinder takes up its speed
SLIP_STEPS = 2.0  # steps after which a rope that slips has the speed that its forces give it
RIM, ROPE, CARRIAGE = 0, 1, 2  # rows of `SheaveMotion.gained`


@kernel
def move_sheaves(sheaves, motion, h):
    """Move all wheels and their carriages by `h` (s)."""
    for sheave in range(sheaves.inertia.size):
        turn_wheel(sheaves, motion, sheave, h)
        if sheaves.tensioning[sheave] != FIXED:
            move_carriage(sheaves, motion, sheave, h)
    motion.step[0] = h


@kernel
def turn_wheel(sheaves, motion, sheave, h):
    """Move the rim of one wheel, and the rope with it or over it, by `h` (s)."""
    on, off = motion.tension[sheave, 0], motion.tension[sheave, 1]
    least, most = -on * (sheaves.adhesion[sheave] - 1.0), off * (sheaves.adhesion[sheave] - 1.0)
    slipping, before, place = motion.slipping[sheave] != 0, motion.rim.velocity[sheave], motion.rim.position[sheave]
    lag = before - motion.rope.velocity[sheave]
    by_brake = motion.braking[sheave] != 0 and sheaves.brake_force[sheave] > 0.0
    if motion.mode[sheave] == SPEED and not by_brake:
        limit, jerk = sheaves.acceleration_limit[sheave], sheaves.jerk_limit[sheave]
        if motion.braking[sheave]:
            limit, jerk = sheaves.emergency_deceleration[sheave], inf
        low, high = sheaves.way[sheave, 0], sheaves.way[sheave, 1]
        target = capped_speed(motion.target[sheave], high - place, place - low, before, limit, h)
        if target != motion.target[sheave]:
            jerk = inf  # the end of the way outranks comfort
        ramp(motion.rim, sheave, target, limit, jerk, h)
    else:
        given = motion.force[sheave] if motion.mode[sheave] == FORCE and not by_brake else 0.0
        pull, inertia = off - on, sheaves.inertia[sheave] + sheaves.wrapped[sheave]
        if slipping:
            pull, inertia = -(most if lag > 0.0 else least), sheaves.inertia[sheave]
        rate = coasting(sheaves, motion, sheave, given + pull, inertia, h)
        advance(motion, motion.rim, sheave, RIM, rate, h)
    traction = on - off + sheaves.wrapped[sheave] * (motion.rim.velocity[sheave] - before) / h
    motion.traction[sheave] = min(max(traction, least), most)
    if slipping or not least <= traction <= most:
        if not slipping:
            lag = 1.0 if traction > most else -1.0
        slip(sheaves, motion, sheave, most if lag > 0.0 else least, lag, h)
        return
    speed, rate = motion.rim.velocity[sheave], motion.rim.acceleration[sheave]
    way = motion.rim.position[sheave] - place
    follow(motion.rope, sheave, motion.rope.position[sheave] + way, speed, rate)


@kernel
def slip(sheaves, motion, sheave, traction, lag, h):
    """Move the rope over a wheel on which it slips, by `h` (s), until it has its speed again.

    The rope on the wheel is so light that its speed follows from the forces at once; here, within some steps.
    """
    pull = traction + motion.tension[sheave, 1] - motion.tension[sheave, 0]
    rate = pull / (sheaves.wrapped[sheave] + SLIP_STEPS * h * sheaves.impedance[sheave])
    advance(motion, motion.rope, sheave, ROPE, rate, h)
    motion.slipping[sheave], motion.traction[sheave] = 1, traction
    if (motion.rim.velocity[sheave] - motion.rope.velocity[sheave]) * lag <= 0.0:
        motion.slipping[sheave] = 0
        motion.rope.velocity[sheave] = motion.rim.velocity[sheave]


@kernel
def coasting(sheaves, motion, sheave, net, inertia, h):
    """Acceleration (m/s²) of a wheel under a net force (N), with its brake and its bearings against its motion.

    Where they would turn it back and can hold it, it comes to rest.
    """
    speed, against = motion.rim.velocity[sheave], sheaves.resistance[sheave]
    if motion.braking[sheave] and sheaves.brake_force[sheave] > 0.0:
        motion.braking_time[sheave] += h
        rise = sheaves.brake_rise_time[sheave]
        share = min(motion.braking_time[sheave] / rise, 1.0) if rise > 0.0 else 1.0
        against += share * sheaves.brake_force[sheave]
    if speed == 0.0 and abs(net) <= against:
        return 0.0
    direction = speed if speed != 0.0 else net
    rate = (net - (against if direction > 0.0 else -against)) / inertia
    if speed != 0.0 and (speed + rate * h) * speed <= 0.0 and abs(net) <= against:
        motion.gained[sheave, RIM] = -speed / h  # nothing to go on with
        return -speed / h
    return rate


@kernel
def move_carriage(sheaves, motion, sheave, h):
    """Move what a wheel is on, in the direction in which it tensions: a counterweight pulls it, or a cylinder."""
    travel, speed = motion.carriage.position[sheave], motion.carriage.velocity[sheave]
    low, high = sheaves.travel[sheave, 0], sheaves.travel[sheave, 1]
    if sheaves.tensioning[sheave] == COUNTERWEIGHT:
        sign, depth = (1.0, low - travel) if travel < low else (-1.0, travel - high)
        stiffness, damping = sheaves.buffer_stiffness[sheave], sheaves.buffer_damping[sheave]
        buffer, _, _ = buffer_force(stiffness, 0.0, damping, depth, -sign * speed)
        rate = (sheaves.pull[sheave] + sign * buffer - motion.pull[sheave]) / sheaves.mass[sheave]
        advance(motion, motion.carriage, sheave, CARRIAGE, rate, h)
        return
    missing, wanted = sheaves.pull[sheave] - motion.pull[sheave], 0.0
    if abs(missing) > sheaves.band[sheave]:
        wanted = sheaves.rate[sheave] if missing > 0.0 else -sheaves.rate[sheave]
    most = sqrt(2.0 * HYDRAULIC_ACCELERATION * max(high - travel, 0.0))
    least = -sqrt(2.0 * HYDRAULIC_ACCELERATION * max(travel - low, 0.0))
    ramp(motion.carriage, sheave, min(max(wanted, least), most), HYDRAULIC_ACCELERATION, inf, h)


@kernel
def advance(motion, course, number, kind, rate, h):
    """Go on for `h` (s) with the acceleration (m/s²) now, as it has changed in the step before."""
    before = h / motion.step[0] if motion.step[0] > 0.0 else 0.0
    change = before * (rate - motion.gained[number, kind])
    motion.gained[number, kind] = rate
    speed = course.velocity[number]
    after = speed + (rate + 0.5 * change) * h
    follow(course, number, course.position[number] + 0.5 * (speed + after) * h, after, rate + change)


@kernel
def give_ends(bundle, motion, system, state):
    """Let rope run onto and off all strands as their wheels have it: at once before a step, for all of it."""
    sheaves = bundle.sheaves
    for sheave in range(sheaves.inertia.size):
        for side in range(2):
            here = record_at(bundle.records[sheaves.rope[sheave, side], STATE], state)
            position, speed = motion.rope.position[sheave], motion.rope.velocity[sheave]
            follow(here.rope, 1 - side, position, speed, motion.rope.acceleration[sheave])


@kernel
def place_ends(bundle, motion, system, state):
    """Put the end nodes of all strands where the carriages of their wheels are, and let them move as those do."""
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
            rate = scale(motion.carriage.acceleration[sheave], direction)
            store(rate, nodes.acceleration[node, 0])
            store(rate, nodes.algorithmic[node, 0])


@kernel
def feel_ends(bundle, motion, system, state):
    """Take what both strands of each wheel pull with now: their tensions, less the momentum that the wheel turns."""
    sheaves, like = bundle.sheaves, system.cable.gravity
    for sheave in range(sheaves.inertia.size):
        pull = 0.0
        for side in range(2):
            rope = sheaves.rope[sheave, side]
            own = record_at(bundle.records[rope, SYSTEM], system)
            here = record_at(bundle.records[rope, STATE], state)
            force = end_force(own, here, 1 - side)
            r_x = load(here.nodes.position[own.cable.element_count if side == 0 else 0, 1], like)
            along = dot(force, r_x) / sqrt(dot(r_x, r_x))
            motion.tension[sheave, side] = along if side == 0 else -along
            if sheaves.tensioning[sheave] != FIXED:
                pull += dot(force, load(sheaves.direction[sheave], like))
        motion.pull[sheave] = pull
