"""Brakes of a vehicle: available force during the rise time."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel


@kernel
def brake_force(carriages, state, carriage, brake):
    """Available force (N) of one brake (SERVICE, EMERGENCY, TRACK_ROPE), rising linearly once applied."""
    full = carriages.brake_force[carriage, brake]
    if full == 0.0 or not state.drives.braking[carriage]:
        return 0.0
    rise, elapsed = carriages.brake_rise_time[carriage, brake], state.drives.braking_time[carriage]
    return full if elapsed >= rise else full * elapsed / rise
