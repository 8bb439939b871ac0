"""What a driven joint or a moving cable follows: a reference that obeys the limits of its drive."""

from __future__ import annotations

from math import inf, sqrt

from cable_twin.mechanics.compilation import kernel


@kernel
def braking_speed(distance, speed, deceleration, duration):
    """Highest speed (m/s) after `duration` (s) from which a constant deceleration still stops within `distance` (m)."""
    half = 0.5 * duration
    room = half * half + 2.0 * (distance - half * speed) / deceleration
    return deceleration * (sqrt(room) - half) if room > half * half else 0.0


@kernel
def advance_reference(carriages, cable, state, carriage, duration):
    """Move the reference (position, speed, acceleration) of a driven joint by `duration` (s).

    It goes to its target speed as `ramp` has it, and brakes in time for the ends of the track.
    """
    reference = state.reference[carriage]
    position, speed = reference[0], reference[1]
    limit = carriages.acceleration_limit[carriage]
    jerk = carriages.jerk_limit[carriage]
    if state.drive_braking[carriage]:
        limit, jerk = carriages.emergency_deceleration[carriage], inf
    target = state.drive_target[carriage]

    stroke = carriages.stop_stroke[carriage]
    ahead = cable.unstrained_length - stroke - position
    behind = position - stroke
    capped = min(target, braking_speed(ahead, speed, limit, duration))
    capped = max(capped, -braking_speed(behind, -speed, limit, duration))
    if capped != target:
        target, jerk = capped, inf  # the end of the track outranks comfort
    ramp(reference, target, limit, jerk, duration)


@kernel
def ramp(reference, target, limit, jerk, duration):
    """Move a reference (3,), in m, m/s and m/s², by `duration` (s) towards the speed `target` (m/s).

    The speed changes as fast as the acceleration `limit` (m/s²) allows, within the limit of the jerk (m/s³) where that
    is not inf; without one the position is the exact integral of the trapezoid.
    """
    position, speed, acceleration = reference[0], reference[1], reference[2]
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
        wanted = min(max(wanted, acceleration - jerk * duration), acceleration + jerk * duration)
    reached = abs(wanted) * duration >= abs(gap) and wanted * direction >= 0.0
    if jerk == inf and reached:
        ramping = abs(gap) / limit if limit > 0.0 else 0.0
        position += 0.5 * (speed + target) * ramping + target * (duration - ramping)
        reference[2] = 0.0 if ramping < duration else direction * limit
        speed = target
    else:
        after = speed + wanted * duration
        position += 0.5 * (speed + after) * duration
        reference[2] = wanted
        speed = target if reached else after
    reference[0], reference[1] = position, speed
