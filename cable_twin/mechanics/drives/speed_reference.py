"""Reference motion of drives, within limits of acceleration and jerk, and end stops."""

from __future__ import annotations

from math import inf, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel

ROUNDING = 1e-6  # of a step


@kernel
def braking_speed(distance, speed, deceleration, duration):
    """Highest speed (m/s) after `duration` (s) that allows a stop within `distance` (m) at a constant deceleration."""
    half = 0.5 * duration
    room = half * half + 2.0 * (distance - half * speed) / deceleration
    return deceleration * (sqrt(room) - half) if room > half * half else 0.0


@kernel
def capped_speed(target, ahead, behind, speed, deceleration, duration):
    """Speed (m/s) nearest to `target` from which `deceleration` can stop within distances (m) `ahead` and `behind`."""
    most = braking_speed(ahead, speed, deceleration, duration)
    return max(min(target, most), -braking_speed(behind, -speed, deceleration, duration))


@kernel
def advance_reference(carriages, cable, state, carriage, duration):
    """Advance the reference (position, speed, acceleration) of a driven joint or haul drum by `duration` (s).

    Brakes that an emergency stop applies instead of the drive stop the reference by the end of the step, unless that
    takes more than they can (`motion.find_saturated`). Otherwise it brakes in time for the ends of the track.
    """
    reference = state.reference
    position, speed = reference.position[carriage], reference.velocity[carriage]
    if state.drives.braking[carriage] and not carriages.drive_stops[carriage]:
        follow(reference, carriage, position + 0.5 * speed * duration, 0.0, -speed / duration)
        return
    stroke = carriages.stop_stroke[carriage]
    ahead, behind = cable.unstrained_length - stroke - position, position - stroke
    approach_target(carriages.limits, state.drives, carriage, reference, ahead, behind, duration)


@kernel
def approach_target(limits, drives, axis, course, ahead, behind, duration):
    """Advance the reference motion of a drive by `duration` (s) towards its target speed, within its limits.

    The drive stops within the distances `ahead` and `behind` (m); the speed changes as in `ramp`. Where the limits of
    acceleration and deceleration differ, a reversal comes to rest with one and starts with the other.

    Args:
        limits: of drives.
        drives: their commands.
        axis: row of the drive in both, and in its course.
        course: position, velocity, acceleration of the axis.
        ahead: m.
        behind: m.
        duration: s.
    """
    speed, target = course.velocity[axis], drives.target[axis]
    limit, slowing, jerk = limits.acceleration[axis], limits.deceleration[axis], limits.jerk[axis]
    if drives.braking[axis]:
        limit, slowing, jerk = limits.emergency_deceleration[axis], limits.emergency_deceleration[axis], inf
    capped = capped_speed(target, ahead, behind, speed, slowing, duration)
    if capped != target:
        target, jerk = capped, inf  # the end of the track outranks comfort
    stop = False
    if slowing != limit and (target - speed) * speed < 0.0:
        limit, stop = slowing, target * speed < 0.0
    left = ramp(course, axis, 0.0 if stop else target, limit, jerk, duration)
    if stop and left > 0.0:
        ramp(course, axis, target, limits.acceleration[axis], jerk, left)


@kernel
def follow(course, number, position, velocity, acceleration):
    """Write a position, velocity and acceleration to row `number` of a reference motion."""
    course.position[number], course.velocity[number] = position, velocity
    course.acceleration[number] = acceleration


@kernel
def ramp(course, number, target, limit, jerk, duration):
    """Advance row `number` of a reference motion by `duration` (s) towards the speed `target` (m/s), and then at it.

    The speed changes as fast as the acceleration `limit` (m/s²) allows, within the limit of the jerk (m/s³) where that
    is not inf. Place, speed and acceleration are those of the exact motion at the end, whatever the duration.

    Returns:
        Time (s) that the motion has been at the target.
    """
    if jerk != inf:
        return curve(course, number, target, limit, jerk, duration)
    position, speed = course.position[number], course.velocity[number]
    gap = target - speed
    direction = 1.0 if gap >= 0.0 else -1.0
    if limit * duration < abs(gap):
        after = speed + direction * limit * duration
        follow(course, number, position + 0.5 * (speed + after) * duration, after, direction * limit)
        return 0.0
    ramping = abs(gap) / limit if limit > 0.0 else 0.0
    position += 0.5 * (speed + target) * ramping + target * (duration - ramping)
    # rounding must not say that it is over where it goes on, as along the way to the end of a track
    over = ramping < (1.0 - ROUNDING) * duration
    follow(course, number, position, target, 0.0 if over else direction * limit)
    return duration - ramping if over else 0.0


@kernel
def curve(course, number, target, limit, jerk, duration):
    """Do the same as `ramp` within a limit of the jerk (m/s³), in the shortest time: cubic pieces of the place.

    The acceleration goes to its peak, stays there where that is the limit, and falls to zero as the target is reached.
    An acceleration too high for that, as after an emergency stop, falls at once: the target is not passed.
    """
    position, speed, gap = course.position[number], course.velocity[number], target - course.velocity[number]
    direction = 1.0 if gap >= 0.0 else -1.0
    size = abs(gap)
    rate = min(direction * course.acceleration[number], sqrt(2.0 * jerk * size))  # towards the target
    peak = min(limit, sqrt(jerk * size + 0.5 * rate * rate))
    change = jerk if peak >= rate else -jerk
    gained = 0.5 * (peak * peak - rate * rate) / change + 0.5 * peak * peak / jerk  # before and after the peak
    before, after = (peak - rate) / change, peak / jerk
    at_peak = max(size - gained, 0.0) / peak if peak == limit and peak > 0.0 else 0.0

    time, left = min(duration, before), duration - min(duration, before)
    position, speed, rate = cubic(position, speed, direction * rate, direction * change, time)
    if left > 0.0:
        time, left = min(left, at_peak), left - min(left, at_peak)
        position, speed, rate = cubic(position, speed, direction * peak, 0.0, time)
    if left > 0.0:
        time, left = min(left, after), left - min(left, after)
        position, _, _ = cubic(position, speed, rate, -direction * jerk, time)
        rate = direction * jerk * (after - time)
        speed = target - 0.5 * rate * (after - time)  # from the target, which rounding must not pass
    follow(course, number, position + target * left, speed, rate)
    return left


@inlined_kernel
def cubic(position, speed, acceleration, jerk, time):
    """Place (m), speed (m/s) and acceleration (m/s²) after a `time` (s) of constant jerk (m/s³)."""
    way = time * (speed + time * (0.5 * acceleration + time * jerk / 6.0))
    return position + way, speed + time * (acceleration + 0.5 * time * jerk), acceleration + time * jerk
