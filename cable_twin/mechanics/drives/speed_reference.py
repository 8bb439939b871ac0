"""Reference motion of drives, within limits of acceleration and jerk, and end stops."""

from __future__ import annotations

from math import inf, sqrt

from cable_twin.mechanics.language.compilation import kernel

ROUNDING = 1e-6  # of a step
PASSING = 1.5  # changes of the acceleration in a step, by which it may be above that which lands on the target


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
    acceleration and deceleration differ, a reversal pauses for the rest of the step in which it comes to rest.

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
    if slowing != limit and (target - speed) * speed < 0.0:
        limit = slowing
        if target * speed < 0.0:
            target = 0.0
    ramp(course, axis, target, limit, jerk, duration)


@kernel
def follow(course, number, position, velocity, acceleration):
    """Write a position, velocity and acceleration to row `number` of a reference motion."""
    course.position[number], course.velocity[number] = position, velocity
    course.acceleration[number] = acceleration


@kernel
def ramp(course, number, target, limit, jerk, duration):
    """Advance row `number` of a reference motion by `duration` (s) towards the speed `target` (m/s).

    The speed changes as fast as the acceleration `limit` (m/s²) allows, within the limit of the jerk (m/s³) where that
    is not inf; without one the position is the exact integral of the trapezoid.
    """
    position, speed, acceleration = course.position[number], course.velocity[number], course.acceleration[number]
    gap = target - speed
    direction = 1.0 if gap >= 0.0 else -1.0
    if jerk == inf:
        wanted = direction * limit
    else:
        # the acceleration from which the jerk limit still lands on the target without passing it
        half = 0.5 * jerk * duration
        landing = sqrt(half * half + 2.0 * jerk * abs(gap)) - half
        size = min(limit, landing, abs(gap) / duration)
        wanted = direction * size
        # beyond that acceleration, as after an emergency stop, comfort yields: the target is not passed
        if acceleration * direction <= landing + PASSING * jerk * duration:
            wanted = min(max(wanted, acceleration - jerk * duration), acceleration + jerk * duration)
    reached = abs(wanted) * duration >= abs(gap) and wanted * direction >= 0.0
    if jerk == inf and reached:
        ramping = abs(gap) / limit if limit > 0.0 else 0.0
        position += 0.5 * (speed + target) * ramping + target * (duration - ramping)
        # rounding must not say that it is over where it goes on, as along the way to the end of a track
        acceleration = 0.0 if ramping < (1.0 - ROUNDING) * duration else direction * limit
        speed = target
    else:
        after = speed + wanted * duration
        position += 0.5 * (speed + after) * duration
        acceleration = wanted
        speed = target if reached else after
    follow(course, number, position, speed, acceleration)
