"""Extremes of one rope from a frame, in a single kernel call of a few microseconds."""

from __future__ import annotations

from math import isnan, nan, sqrt
from typing import NamedTuple

from cable_twin.key_figures.extremes import Extremes, take
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.readout.clearances import Ground, look_at_ground

CLEARANCE_PERIOD = 0.1  # s of simulated time between two looks at the clearance
MEAN = 0.2  # s over which accelerations are means of means: what is shorter is a shock, and of the mesh
LOOK = 0.05  # s between two places of which that is made, in frames that come oftener
PLACES = 12  # that are kept: more than 2 MEAN / LOOK


@by_reference
class DriveExtremes(NamedTuple):
    """Speed, force and power of several drives."""

    speed: Extremes  # m/s, either way
    force: Extremes  # N, either way
    power: Extremes  # W
    braking_power: Extremes  # W, the least


@by_reference
class Memory(NamedTuple):
    """Extremes of one rope between frames, with the constants of the scenario.

    Vehicles that are off the cable do not count. Nor do forces and accelerations of a carrier on the first and the last
    element of a moving cable: the end of the model is a point, and a mass that moves over it a singular load, where a
    ropeway has the rails of a station.
    """

    length: float  # m, of the cable, unstrained
    corners: FloatArray  # (spans + 1, 2) m, ends of the chords: tops of the towers, and the ends of the rope now
    rails: FloatArray  # (vehicles,) m from either end in which forces do not count
    ground: Ground
    tension: Extremes  # N
    slackest: Extremes  # N
    sag: Extremes  # (spans,) m
    highest_load: Extremes  # (supports,) N
    lowest_load: Extremes  # (supports,) N
    margin: Extremes  # (supports,) load of a tower over that at rest
    rollers: FloatArray  # (supports,) how many a tower has; 0 of a saddle and of an end
    roller_load: Extremes  # (supports,) N, mean over the rollers of a tower
    farthest: Extremes  # (supports,) m, travel of a counterweight
    nearest: Extremes  # (supports,) m
    drives: DriveExtremes  # of moving cables
    vehicle_drives: DriveExtremes  # (vehicles,)
    swing: Extremes  # (vehicles,) rad
    acceleration: Extremes  # (vehicles,) m/s^2
    contact_force: Extremes  # (vehicles,) N
    haul_force: Extremes  # (vehicles,) N
    tension_ratio: Extremes  # (vehicles,) tension over the load across the rope
    clearance: Extremes  # (1 + vehicles,) m, of the rope and of the vehicles
    next_look: FloatArray  # (1,) s, when the clearance is due
    passed_times: FloatArray  # (PLACES,) s, of frames with places; NaN where the motion does not go back so far
    passed: FloatArray  # (PLACES, vehicles, 4) m, places of the last bodies there, and of their vehicles on the cable
    passed_last: IntArray  # (1,) the newest of them


@kernel
def take_frame(memory, arc_lengths, columns):
    """Take in the columns of a frame for the extremes of a rope, in order of time.

    Args:
        memory: takes it.
        arc_lengths: (samples,) m, where the frame shows the cable.
        columns: the frame.
    """
    time = columns.time[0]
    take(memory.tension, 0, columns.highest_tension[0, 0], time, columns.highest_tension[0, 1])
    take(memory.slackest, 0, columns.lowest_tension[0, 0], time, columns.lowest_tension[0, 1])
    take_sag(memory, time, columns)
    take_supports(memory, time, columns)
    for drive in range(columns.drive_position.size):
        place, speed = columns.drive_position[drive], columns.drive_speed[drive]
        take_drive(memory.drives, drive, time, place, speed, columns.moving_cable_force[drive])
    take_vehicles(memory, time, arc_lengths, columns)
    ground = memory.ground
    if ground.terrain.shape[0] > 0 and time >= memory.next_look[0]:
        memory.next_look[0] = time + CLEARANCE_PERIOD * (1.0 - 1e-9)
        look_at_ground(ground, columns.rope_position, columns.attached, columns.body_position, columns.body_angles)
        for row in range(ground.lowest.shape[0]):
            take(memory.clearance, row, ground.lowest[row, 0], time, ground.lowest[row, 1])


@kernel
def take_sag(memory, time, columns):
    """Take in the sag below the chord of each span between supports; an upright rope has no sag.

    Deepest of all is where a vehicle hangs, which is between points. A span without a point takes the next one, so that
    no span goes without.
    """
    rope = columns.rope_position
    corners, last, span, seen = memory.corners, rope.shape[0] - 1, 0, 0  # `seen`: spans with a point so far
    spans = corners.shape[0] - 1
    corners[0, 0], corners[0, 1] = rope[0, 0], rope[0, 2]
    corners[spans, 0], corners[spans, 1] = rope[last, 0], rope[last, 2]
    way = corners[spans, 0] - corners[0, 0]
    for point in range(rope.shape[0] if abs(way) > 0.0 else 0):
        x = rope[point, 0]
        while span + 1 < spans and way * (x - corners[span + 1, 0]) >= 0.0:
            span += 1
        depth = below_chord(corners, span, x, rope[point, 2])
        for above in range(min(seen, span), span + 1):
            take(memory.sag, above, depth, time, x)
        seen = span + 1
    for vehicle in range(columns.attached.size if abs(way) > 0.0 else 0):
        if columns.attached[vehicle] != 0.0:
            x, z, span = columns.joint_position[vehicle, 0], columns.joint_position[vehicle, 2], 0
            while span + 1 < spans and way * (x - corners[span + 1, 0]) >= 0.0:
                span += 1
            take(memory.sag, span, below_chord(corners, span, x, z), time, x)


@inlined_kernel
def below_chord(corners, span, x, z):
    """Depth (m) of a point below the chord of a span."""
    rise = (corners[span + 1, 1] - corners[span, 1]) / (corners[span + 1, 0] - corners[span, 0])
    return corners[span, 1] + rise * (x - corners[span, 0]) - z


@kernel
def take_supports(memory, time, columns):
    """Take in loads and margins of all supports, and the travel of counterweights."""
    for support in range(columns.support_travel.size):
        load, travel = size(columns.support_force[support]), columns.support_travel[support]
        take(memory.highest_load, support, load, time, nan)
        take(memory.lowest_load, support, load, time, nan)
        if columns.tower_rest_load[support] > 0.0:
            margin = columns.tower_lowest_load[support] / columns.tower_rest_load[support]
            take(memory.margin, support, margin, time, nan)
        elif columns.tower_rest_load[support] == 0.0:  # not of an end, which has none
            take(memory.margin, support, 0.0, time, nan)
        if memory.rollers[support] > 0.0:
            take(memory.roller_load, support, columns.tower_lowest_load[support] / memory.rollers[support], time, nan)
        take(memory.farthest, support, travel, time, nan)
        take(memory.nearest, support, travel, time, nan)


@inlined_kernel
def take_drive(extremes, index, time, place, speed, force):
    """Take in place (m), speed (m/s) and force (N) of one drive."""
    take(extremes.speed, index, abs(speed), time, place)
    take(extremes.force, index, abs(force), time, place)
    take(extremes.power, index, force * speed, time, place)
    take(extremes.braking_power, index, force * speed, time, place)


@kernel
def take_vehicles(memory, time, arc_lengths, columns):
    """Take in speed, swing, forces and acceleration of all vehicles."""
    looks = begin_look(memory, time, columns)
    for vehicle in range(columns.arc_length.size):
        body = memory.ground.first_body[vehicle + 1] - 1  # the last one
        place, counts = columns.arc_length[vehicle], False
        if columns.attached[vehicle] != 0.0:
            take_drive(
                memory.vehicle_drives, vehicle, time, place, columns.speed[vehicle], columns.drive_force[vehicle]
            )
            take(memory.swing, vehicle, abs(columns.body_angles[body, 1]), time, place)
            rails = memory.rails[vehicle]
            counts = not (place < rails or memory.length - place < rails)
        if counts:
            force = columns.contact_force[vehicle]
            take(memory.contact_force, vehicle, size(force), time, place)
            take(memory.haul_force, vehicle, size(columns.haul_pull[vehicle]), time, place)
            if not isnan(place):
                ratio = tension_ratio(arc_lengths, columns.rope_position, columns.rope_tension, place, force)
                take(memory.tension_ratio, vehicle, ratio, time, place)
        if looks:
            here = memory.passed[memory.passed_last[0], vehicle]
            for axis in range(3):
                here[axis] = columns.body_position[body, axis] if counts else nan
            here[3] = place
            take_acceleration(memory, vehicle)


@kernel
def begin_look(memory, time, columns):
    """Store the time of a frame with positions as the newest of `passed` once a look is due; returns whether it did."""
    newest = memory.passed_last[0]
    if time < memory.passed_times[newest] + LOOK * (1.0 - 1e-6):
        return False
    for body in range(columns.body_position.shape[0]):
        if not isnan(columns.body_position[body, 0]):
            newest = (newest + 1) % PLACES
            memory.passed_last[0], memory.passed_times[newest] = newest, time
            return True
    return False


@kernel
def take_acceleration(memory, vehicle):
    """Take in the acceleration of a vehicle: difference of mean velocities over two successive times `MEAN`."""
    newest = memory.passed_last[0]
    middle = latest(memory, memory.passed_times[newest] - MEAN)
    if middle < 0:
        return
    first = latest(memory, memory.passed_times[middle] - MEAN)
    if first < 0:
        return
    after = memory.passed_times[newest] - memory.passed_times[middle]
    before = memory.passed_times[middle] - memory.passed_times[first]
    if max(after, before) > 1.5 * MEAN:
        return
    here, there, start = memory.passed[newest, vehicle], memory.passed[middle, vehicle], memory.passed[first, vehicle]
    square = 0.0
    for axis in range(3):
        change = (here[axis] - there[axis]) / after - (there[axis] - start[axis]) / before
        square += change * change
    value = sqrt(square) / (0.5 * (after + before))
    take(memory.acceleration, vehicle, value, memory.passed_times[middle], there[3])


@kernel
def latest(memory, time):
    """Index of the newest stored position up to a time (s); -1 without one."""
    found = -1
    for number in range(PLACES):
        at = memory.passed_times[number]
        if at <= time + 1e-6 * MEAN and (found < 0 or at > memory.passed_times[found]):
            found = number
    return found


@kernel
def tension_ratio(arc_lengths, rope, tensions, place, force):
    """Tension over the transverse part of a force (3,) in N on the rope at an arc length (m); NaN without a force.

    The tension is that of the slacker side, as the points beside it have it: it jumps where a load is.
    """
    last = arc_lengths.size - 1
    after = int(place / arc_lengths[last] * last)  # a guess, right where they are equally spaced
    after = last if after > last else 1 if after < 1 else after
    while after < last and arc_lengths[after] < place:
        after += 1
    while after > 1 and arc_lengths[after - 1] >= place:
        after -= 1
    # beside the kink at the joint, from the point before to the one after
    start, end = rope[after - 1], rope[after + 1 if after < last else last]
    along, square = 0.0, 0.0
    for axis in range(3):
        part = end[axis] - start[axis]
        along += part * force[axis]
        square += part * part
    rest = 0.0
    for axis in range(3):
        part = force[axis] - along / square * (end[axis] - start[axis])
        rest += part * part
    tension = min(tensions[after - 1], tensions[after])
    return tension / sqrt(rest) if rest > 0.0 else nan


@inlined_kernel
def size(vector):
    """Length of a vector (3,)."""
    return sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


__all__ = ["CLEARANCE_PERIOD", "MEAN", "PLACES", "DriveExtremes", "Memory", "take_frame"]
