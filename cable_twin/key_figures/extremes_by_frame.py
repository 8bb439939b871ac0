"""Kernels that update the extremes of a run by a frame: all in one call, clearances in another one, less often."""

from __future__ import annotations

from math import inf, isnan, log, nan, sqrt

from cable_twin.key_figures.extremes import NO_ROPE, PLACE, PLACES, ROPE, TIME, VALUE, WIND
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import copy_array
from cable_twin.mechanics.readout.clearances import box_distance, find_least, look_around_vehicle
from cable_twin.mechanics.readout.columns import STOPPING

CLEARANCE_PERIOD = 0.1  # s of simulated time between two looks at clearances
MEAN = 0.2  # s over which velocities are averaged for accelerations: shorter changes are shocks, and of the mesh
LOOK = 0.05  # s at least between two positions for accelerations
NEAR = 30.0  # m between the joints of two vehicles, below which their distance is taken
LEANS = 0.01  # m/s, up to which a carriage leans on an end stop
SLACK = 1.0  # N, least tension of a strand in the ratio of both, so that it is finite


@inlined_kernel
def store(extremes, index, value, time, place, rope):
    """Write an extreme into its row: value, time (s), place and index of the rope."""
    row = extremes[index]
    row[VALUE], row[TIME], row[PLACE], row[ROPE] = value, time, place, rope


@inlined_kernel
def highest(extremes, index, value, time, place, rope):
    """Update the highest value of an object by a value; the first of equal values is kept, NaN is ignored."""
    if value > extremes[index, VALUE] or (isnan(extremes[index, VALUE]) and not isnan(value)):
        store(extremes, index, value, time, place, rope)


@inlined_kernel
def lowest(extremes, index, value, time, place, rope):
    """Update the lowest value of an object by a value; the first of equal values is kept, NaN is ignored."""
    if value < extremes[index, VALUE] or (isnan(extremes[index, VALUE]) and not isnan(value)):
        store(extremes, index, value, time, place, rope)


@kernel
def highest_in_wind(extremes, index, value, time, place, rope, wind):
    """Update the highest value of an object by a value, with the wind (3,) in m/s at that time; NaN in a plane."""
    if value > extremes[index, VALUE] or (isnan(extremes[index, VALUE]) and not isnan(value)):
        store(extremes, index, value, time, place, rope)
        for axis in range(3):
            extremes[index, WIND + axis] = wind[axis]


@kernel
def lowest_in_wind(extremes, index, value, time, place, rope, wind):
    """Update the lowest value of an object by a value, with the wind (3,) in m/s at that time; NaN in a plane."""
    if value < extremes[index, VALUE] or (isnan(extremes[index, VALUE]) and not isnan(value)):
        store(extremes, index, value, time, place, rope)
        for axis in range(3):
            extremes[index, WIND + axis] = wind[axis]


@kernel
def take_frame(extremes, constants, columns):
    """Update the extremes of a run by the columns of a frame, in order of time.

    Args:
        extremes: extremes of the run, which are updated.
        constants: constants of the scenario.
        columns: columns of the frame.
    """
    time = columns.time[0]
    if constants.in_space:
        copy_array(columns.wind, extremes.wind)
    for rope in range(constants.length.size):
        high, low = columns.highest_tension[rope], columns.lowest_tension[rope]
        highest(extremes.tension, rope, high[0], time, high[1], rope)
        lowest(extremes.lowest_tension, rope, low[0], time, low[1], rope)
        if isnan(extremes.first_tension[rope]):
            extremes.first_tension[rope] = extremes.tension[rope, VALUE]
        take_sag(extremes, constants, time, rope, columns)
    take_supports(extremes, constants, time, columns)
    vehicles = columns.arc_length.size
    for drive in range(columns.drive_position.size):
        position, speed = columns.drive_position[drive], columns.drive_speed[drive]
        force = columns.moving_cable_force[drive]
        highest(extremes.speed, vehicles + drive, abs(speed), time, position, NO_ROPE)
        take_drive(extremes, vehicles + drive, time, position, NO_ROPE, force, force * speed)
    take_vehicles(extremes, constants, time, columns)
    take_sheaves(extremes, constants, time, columns)
    take_couplings(extremes, time, columns)
    extremes.last_time[0] = time


@inlined_kernel
def rope_of(constants, columns, vehicle):
    """Index of the rope on which a vehicle is; NO_ROPE if it is unknown from scenario and frame."""
    rope = constants.vehicle_rope[vehicle]
    if rope != NO_ROPE or isnan(columns.vehicle_rope[vehicle]):
        return rope
    return int(columns.vehicle_rope[vehicle])


@kernel
def take_sag(extremes, constants, time, rope, columns):
    """Update the sag of one rope below the chord of each span between supports; an upright rope has no sag.

    The sag is largest at a vehicle, between sample points. A span without a sample point takes the next point.
    """
    points, corner = columns.rope_position, extremes.corner
    first, last = constants.first_sample[rope], constants.first_sample[rope + 1] - 1
    start, end = constants.first_support[rope], constants.first_support[rope + 1] - 1  # corners of the rope
    corner[start, 0], corner[start, 1] = points[first, 0], points[first, 2]
    corner[end, 0], corner[end, 1] = points[last, 0], points[last, 2]
    along = corner[end, 0] - corner[start, 0]  # m, in x
    if not abs(along) > 0.0:
        return
    span, seen = start, start  # `seen`: first span without a point so far
    for point in range(first, last + 1):
        x = points[point, 0]
        while span + 1 < end and along * (x - corner[span + 1, 0]) >= 0.0:
            span += 1
        depth = below_chord(corner, span, x, points[point, 2])
        for above in range(min(seen, span), span + 1):
            highest(extremes.sag, above, depth, time, x, rope)
        seen = span + 1
    for vehicle in range(columns.attached.size):
        if columns.attached[vehicle] != 0.0 and rope_of(constants, columns, vehicle) == rope:
            x, z, span = columns.joint_position[vehicle, 0], columns.joint_position[vehicle, 2], start
            while span + 1 < end and along * (x - corner[span + 1, 0]) >= 0.0:
                span += 1
            highest(extremes.sag, span, below_chord(corner, span, x, z), time, x, rope)


@inlined_kernel
def below_chord(corner, span, x, z):
    """Depth (m) of a point x, z (m) of a rope below the chord of a span."""
    rise = (corner[span + 1, 1] - corner[span, 1]) / (corner[span + 1, 0] - corner[span, 0])
    return corner[span, 1] + rise * (x - corner[span, 0]) - z


@kernel
def take_supports(extremes, constants, time, columns):
    """Update loads and margins of all supports, travel of counterweights, and lateral forces in space."""
    for support in range(columns.support_travel.size):
        load, travel = size(columns.support_force[support]), columns.support_travel[support]
        highest(extremes.load, support, load, time, nan, NO_ROPE)
        lowest(extremes.lowest_load, support, load, time, nan, NO_ROPE)
        at_rest, least = columns.tower_rest_load[support], columns.tower_lowest_load[support]
        if at_rest > 0.0:
            lowest(extremes.margin, support, least / at_rest, time, nan, NO_ROPE)
        elif at_rest == 0.0:  # not of an end, which has none
            lowest(extremes.margin, support, 0.0, time, nan, NO_ROPE)
        if constants.rollers[support] > 0.0:
            lowest(extremes.roller_load, support, least / constants.rollers[support], time, nan, NO_ROPE)
        highest(extremes.travel, support, travel, time, nan, NO_ROPE)
        lowest(extremes.lowest_travel, support, travel, time, nan, NO_ROPE)
        if constants.in_space:
            wind, ratio = extremes.wind, columns.tower_lateral_ratio[support]
            highest_in_wind(extremes.lateral, support, abs(columns.tower_lateral[support]), time, nan, NO_ROPE, wind)
            highest_in_wind(extremes.lateral_ratio, support, ratio, time, nan, NO_ROPE, wind)
            kind, out = columns.tower_derailed[support], columns.tower_derailed_time[support]
            if kind > 0.0:
                highest_in_wind(extremes.derailed, support, kind, out, nan, NO_ROPE, wind)


@inlined_kernel
def drive_speed_of(columns, vehicle):
    """Speed (m/s) of the drive of a vehicle: that of its haul drum, or of the vehicle itself."""
    return columns.speed[vehicle] if isnan(columns.haul_speed[vehicle]) else columns.haul_speed[vehicle]


@inlined_kernel
def take_drive(extremes, index, time, place, rope, force, power):
    """Update force (N) and power (W) of the drive of a vehicle or of ropes at its place (m)."""
    highest(extremes.force, index, abs(force), time, place, rope)
    highest(extremes.power, index, power, time, place, rope)
    lowest(extremes.lowest_power, index, power, time, place, rope)


@inlined_kernel
def take_end_stop(extremes, vehicle, time, place, rope, speed, constants):
    """Update the speed (m/s) at which a carriage at a place (m) of its rope has run into an end stop."""
    stroke, before = constants.stroke[vehicle], extremes.approach[vehicle]
    there = place < stroke or constants.length[rope] - place < stroke
    if there and before > LEANS:
        highest(extremes.end_stop_speed, vehicle, before, time, place, rope)
    extremes.approach[vehicle] = 0.0 if there else abs(speed)


@kernel
def take_vehicles(extremes, constants, time, columns):
    """Update speed, swing, forces, acceleration and contacts of all vehicles by a frame."""
    looks, wind = begin_look(extremes, time, columns), extremes.wind
    for vehicle in range(columns.arc_length.size):
        body, place = constants.first_body[vehicle + 1] - 1, columns.arc_length[vehicle]  # the last body
        rope, counts = rope_of(constants, columns, vehicle), False
        if columns.attached[vehicle] != 0.0 and rope != NO_ROPE:
            force, speed = columns.drive_force[vehicle], columns.speed[vehicle]
            highest(extremes.speed, vehicle, abs(speed), time, place, rope)
            at_drive = drive_speed_of(columns, vehicle)
            highest(extremes.drive_speed, vehicle, abs(at_drive), time, place, rope)
            if constants.braked[vehicle] and columns.command_kind[vehicle] == STOPPING:
                highest(extremes.brake_force, vehicle, abs(force), time, place, rope)
            else:
                take_drive(extremes, vehicle, time, place, rope, force, columns.drive_power[vehicle])
            if constants.stroke[vehicle] > 0.0:
                take_end_stop(extremes, vehicle, time, place, rope, speed, constants)
            angles = columns.body_angles[body]
            highest_in_wind(extremes.swing, vehicle, abs(angles[1]), time, place, rope, wind)
            if constants.in_space:
                highest_in_wind(extremes.roll, vehicle, abs(angles[0]), time, place, rope, wind)
            rails = constants.end_element[rope] if constants.clamped[vehicle] else -inf
            counts = not (place < rails or constants.length[rope] - place < rails)
        if counts:
            highest(extremes.contact_force, vehicle, size(columns.contact_force[vehicle]), time, place, rope)
            highest(extremes.haul_force, vehicle, size(columns.haul_pull[vehicle]), time, place, rope)
            highest(extremes.haul_tension, vehicle, columns.haul_tension[vehicle], time, place, rope)
            lowest(extremes.tension_over_load, vehicle, columns.tension_over_load[vehicle], time, place, rope)
        if looks:
            here = extremes.passed[extremes.passed_last[0], vehicle]
            for axis in range(3):
                here[axis] = columns.body_position[body, axis] if counts else nan
            here[3], here[4] = place, rope
            take_acceleration(extremes, vehicle)
        if columns.touched[vehicle] > 0.0:
            take_touch(extremes, vehicle, time, columns)


@kernel
def take_touch(extremes, vehicle, time, columns):
    """Update the last contact of a vehicle with the one after it, and the highest force between their buffers."""
    touch = extremes.touch[vehicle]
    touch[0], touch[1] = columns.touched[vehicle] - 1.0, columns.touch_place[vehicle]
    touch[2], touch[3] = columns.touch_speed[vehicle], columns.touch_time[vehicle]
    push = columns.push_highest[vehicle]
    if push > 0.0 and not push <= extremes.push[vehicle, VALUE]:
        store(extremes.push, vehicle, push, time, nan, NO_ROPE)
        copy_array(touch, extremes.push_touch[vehicle])


@kernel
def begin_look(extremes, time, columns):
    """Store the time of a frame for accelerations if a measuring period has passed; returns whether it was stored."""
    newest = extremes.passed_last[0]
    if time < extremes.passed_time[newest] + LOOK * (1.0 - 1e-6):
        return False
    for body in range(columns.body_position.shape[0]):
        if not isnan(columns.body_position[body, 0]):
            newest = (newest + 1) % PLACES
            extremes.passed_last[0], extremes.passed_time[newest] = newest, time
            return True
    return False


@kernel
def take_acceleration(extremes, vehicle):
    """Update a vehicle's acceleration: difference of its mean velocities in two successive periods of `MEAN` (s)."""
    newest = extremes.passed_last[0]
    middle = latest(extremes, extremes.passed_time[newest] - MEAN)
    if middle < 0:
        return
    first = latest(extremes, extremes.passed_time[middle] - MEAN)
    if first < 0:
        return
    after = extremes.passed_time[newest] - extremes.passed_time[middle]
    before = extremes.passed_time[middle] - extremes.passed_time[first]
    if max(after, before) > 1.5 * MEAN:
        return
    passed = extremes.passed
    here, there, start = passed[newest, vehicle], passed[middle, vehicle], passed[first, vehicle]
    if here[4] != there[4] or there[4] != start[4]:  # it has changed ropes
        return
    square = 0.0
    for axis in range(3):
        change = (here[axis] - there[axis]) / after - (there[axis] - start[axis]) / before
        square += change * change
    value = sqrt(square) / (0.5 * (after + before))
    highest(extremes.acceleration, vehicle, value, extremes.passed_time[middle], there[3], there[4])


@kernel
def latest(extremes, time):
    """Index of the newest stored frame of positions up to a time (s); -1 without one."""
    found = -1
    for number in range(PLACES):
        at = extremes.passed_time[number]
        if at <= time + 1e-6 * MEAN and (found < 0 or at > extremes.passed_time[found]):
            found = number
    return found


@kernel
def take_sheaves(extremes, constants, time, columns):
    """Update tensions, adhesion, slip and travel of all bullwheels, and the load of carriers on each strand."""
    for sheave in range(constants.radius.size):
        tensions, travel = columns.sheave_tension[sheave], columns.sheave_travel[sheave]
        for side in range(2):
            highest(extremes.side_tension[sheave], side, tensions[side], time, nan, NO_ROPE)
            lowest(extremes.lowest_side_tension[sheave], side, tensions[side], time, nan, NO_ROPE)
        used = abs(log(max(tensions[0], SLACK) / max(tensions[1], SLACK))) / constants.available[sheave]
        highest(extremes.adhesion, sheave, used, time, nan, NO_ROPE)
        torque = abs(columns.sheave_force[sheave]) * constants.radius[sheave]
        highest(extremes.torque, sheave, torque, time, nan, NO_ROPE)
        highest(extremes.slip, sheave, abs(columns.sheave_slip[sheave]), time, nan, NO_ROPE)
        highest(extremes.rolled_back, sheave, columns.sheave_rolled_back[sheave], time, nan, NO_ROPE)
        highest(extremes.sheave_travel, sheave, travel, time, nan, NO_ROPE)
        lowest(extremes.lowest_sheave_travel, sheave, travel, time, nan, NO_ROPE)
        pull = 0.0
        for side in range(2):
            for axis in range(3):
                force = columns.support_force[constants.strand_ends[sheave, side], axis]
                pull += constants.pulled_along[sheave, axis] * force
        highest(extremes.sheave_pull, sheave, pull, time, nan, NO_ROPE)
        lowest(extremes.lowest_sheave_pull, sheave, pull, time, nan, NO_ROPE)
    if constants.radius.size > 0:
        extremes.carried_now[:] = 0.0
        for vehicle in range(constants.empty.size):
            rope = rope_of(constants, columns, vehicle)
            if columns.attached[vehicle] == 1.0 and rope != NO_ROPE:
                extremes.carried_now[rope] += constants.empty[vehicle] + columns.payload[vehicle]
        for rope in range(extremes.carried_now.size):
            highest(extremes.carried, rope, extremes.carried_now[rope], time, nan, NO_ROPE)


@kernel
def take_couplings(extremes, time, columns):
    """Update forces of pantographs and connectors, loss of contact and slack, by a frame."""
    elapsed = time - extremes.last_time[0]
    for number in range(columns.pantograph_force.size):
        force, x = columns.pantograph_force[number], columns.pantograph_position[number, 0]
        if isnan(force):
            if isnan(extremes.left[number]) and not isnan(x):  # a frame of a log without joints has neither
                extremes.left[number] = time
            continue
        extremes.last_force[number], extremes.left[number] = time, nan
        extremes.frames[number] += 1.0
        apart = force - extremes.mean_force[number]
        extremes.mean_force[number] += apart / extremes.frames[number]  # Welford 1962
        extremes.square_force[number] += apart * (force - extremes.mean_force[number])
        if force <= 0.0:
            extremes.lost[number] += 1.0
        highest(extremes.pantograph_force, number, force, time, x, NO_ROPE)
        lowest(extremes.lowest_pantograph_force, number, force, time, x, NO_ROPE)
    for number in range(columns.connector_force.size):
        highest(extremes.pull, number, columns.connector_force[number], time, nan, NO_ROPE)
        if elapsed > 0.0 and columns.connector_force[number] <= 0.0:
            extremes.slack[number] += elapsed


@kernel
def take_surroundings(extremes, constants, around, columns):
    """Update the clearances of ropes and vehicles above the ground, and in space also from the masts of towers."""
    time, least, wind = columns.time[0], around.lowest[0], extremes.wind
    for rope in range(constants.length.size if around.middle.shape[0] > 0 else 0):
        first, last = constants.first_sample[rope], constants.first_sample[rope + 1]
        least[0] = nan
        find_least(around, columns.rope_position[first:last], last - first, least)
        lowest_in_wind(extremes.rope_clearance, rope, least[0], time, least[1], rope, wind)
    for vehicle in range(columns.attached.size):
        rope = rope_of(constants, columns, vehicle)
        if columns.attached[vehicle] != 0.0 and rope != NO_ROPE:
            first, last = constants.first_mast[rope], constants.first_mast[rope + 1]
            masts = around.masts[first:last]
            look_around_vehicle(around, vehicle, masts, columns.body_position, columns.body_orientation)
            height, mast = around.lowest[1 + vehicle], around.nearest[vehicle]
            lowest_in_wind(extremes.clearance, vehicle, height[0], time, height[1], rope, wind)
            lowest_in_wind(extremes.mast_clearance, vehicle, mast[0], time, first + mast[1], rope, wind)


@kernel
def take_passing(extremes, boxes, columns):
    """Update the least clearances of passing vehicles by the columns of a frame, in order of time."""
    time = columns.time[0]
    joints, groups = columns.joint_position, boxes.group[-1] + 1
    for one in range(columns.attached.size):
        for other in range(one + 1, columns.attached.size):
            if columns.vehicle_rope[one] == columns.vehicle_rope[other]:
                continue
            if columns.attached[one] == 0.0 or columns.attached[other] == 0.0:
                continue
            square = 0.0
            for axis in range(3):
                square += (joints[one, axis] - joints[other, axis]) ** 2
            if not square < NEAR * NEAR:
                continue
            row = boxes.group[one] * groups + boxes.group[other]
            before = extremes.separation[row, VALUE]
            before = inf if isnan(before) else before
            found, place = vehicle_distance(boxes, columns, one, other, before), columns.arc_length[one]
            if found < before:
                lowest_in_wind(extremes.separation, row, found, time, place, NO_ROPE, columns.wind)
                extremes.separated[row, 0], extremes.separated[row, 1] = one, other


@kernel
def vehicle_distance(boxes, columns, one, other, least):
    """Distance (m) between two vehicles, capped at `least` (m)."""
    for body in range(boxes.first_body[one], boxes.first_body[one + 1]):
        place_box(boxes, columns, body, 0)
        for beside in range(boxes.first_body[other], boxes.first_body[other + 1]):
            place_box(boxes, columns, beside, 1)
            apart, reach, others_reach = 0.0, 0.0, 0.0
            for axis in range(3):
                apart += (boxes.centre[0, axis] - boxes.centre[1, axis]) ** 2
                reach += boxes.half[0, axis] ** 2
                others_reach += boxes.half[1, axis] ** 2
            if apart**0.5 - reach**0.5 - others_reach**0.5 < least:
                least = min(least, box_distance(boxes.centre, boxes.axes, boxes.half, boxes.corners))
    return least


@kernel
def place_box(boxes, columns, body, side):
    """Place the bounding box of one body at its position and orientation in the frame."""
    turn, axes = columns.body_orientation[body], boxes.axes[side]
    i, j, k, w = turn[0], turn[1], turn[2], turn[3]
    axes[0, 0], axes[0, 1], axes[0, 2] = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j - k * w), 2.0 * (i * k + j * w)
    axes[1, 0], axes[1, 1], axes[1, 2] = 2.0 * (i * j + k * w), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k - i * w)
    axes[2, 0], axes[2, 1], axes[2, 2] = 2.0 * (i * k - j * w), 2.0 * (j * k + i * w), 1.0 - 2.0 * (i * i + j * j)
    for row in range(3):
        place = columns.body_position[body, row]
        for axis in range(3):
            place += axes[row, axis] * boxes.middle[body, axis]
        boxes.centre[side, row], boxes.half[side, row] = place, boxes.body_half[body, row]


@inlined_kernel
def size(vector):
    """Length of a vector (3,)."""
    return sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
