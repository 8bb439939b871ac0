"""Brakes of a vehicle and of its drive: available force, from the moment at which an emergency stop applies them.

A brake on the drive is a deceleration with a limited force: the drive's reference stops within the step, but the drive
force is limited to the force of the brake (`generalized_alpha.step`). At rest the brake holds with up to that force.
The brake of a bullwheel is in `solution/bundle/bullwheels`.
"""

from __future__ import annotations

from math import inf

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.parameters import EMERGENCY, SERVICE


@kernel
def brake_force(carriages, state, carriage, brake):
    """Available force (N) of one brake of a vehicle (SERVICE, EMERGENCY, TRACK_ROPE), rising linearly once applied."""
    full = carriages.brake_force[carriage, brake]
    if full == 0.0 or not state.drives.braking[carriage]:
        return 0.0
    rise, elapsed = carriages.brake_rise_time[carriage, brake], state.drives.braking_time[carriage]
    return full if elapsed >= rise else full * elapsed / rise


@kernel
def force_limit(carriages, state, carriage, speed):
    """Available force (N) of a vehicle's drive at a speed (m/s) of its way, or of its brakes in an emergency stop."""
    if carriages.fixed[carriage]:
        return inf
    if state.drives.braking[carriage]:
        if carriages.drive_stops[carriage]:
            return inf
        return brake_force(carriages, state, carriage, SERVICE) + brake_force(carriages, state, carriage, EMERGENCY)
    return drive_limit(carriages.limits, carriage, speed)


@inlined_kernel
def drive_limit(limits, axis, speed):
    """Available force (N) of the drive of one axis, vehicle or bullwheel, at a speed (m/s): by force and by power."""
    by_power = limits.power[axis] / abs(speed) if speed != 0.0 else inf
    return min(limits.force[axis], by_power)


@inlined_kernel
def saturation_of(force, limit):
    """Limit (N), in the direction of a drive force (N), at which a drive beyond its limit is held; 0 within it."""
    if abs(force) > limit:
        return limit if force > 0.0 else -limit
    return 0.0
