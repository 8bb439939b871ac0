"""Drives in a step: motion of their references, and force limits."""

from __future__ import annotations

from cable_twin.mechanics.drives.haul_rope import sheave_force
from cable_twin.mechanics.drives.moving_rope import move_rope
from cable_twin.mechanics.drives.reference import advance_reference, follows_reference, force_limit
from cable_twin.mechanics.drives.switching import set_drive_mode, take_over
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.sliding_joint import driven_force
from cable_twin.mechanics.parameters import FORCE, HAULED, SPEED


@kernel
def move_drives(system, state, duration):
    """Advance moving ropes and drive references by `duration` (s)."""
    if system.moving_cable.moving:
        move_rope(system, state, duration)
    for carriage in range(system.carriages.fixed.size):
        if state.drive_braking[carriage]:
            state.braking_time[carriage] += duration
        if follows_reference(state.drive_mode, state.sheave_mode, carriage) and not system.carriages.clamped[carriage]:
            advance_reference(system.carriages, system.cable, state, carriage, duration)


@kernel
def prescribe(state):
    """Set all driven joints and sheaves to their references."""
    reference = state.reference
    for carriage in range(state.drive_mode.size):
        mode = state.drive_mode[carriage]
        driven = state.joints if mode == SPEED else state.sheaves
        if mode == SPEED or (mode == HAULED and state.sheave_mode[carriage] == SPEED):
            driven.position[carriage] = reference.position[carriage]
            driven.velocity[carriage] = reference.velocity[carriage]
            driven.acceleration[carriage] = driven.algorithmic[carriage] = reference.acceleration[carriage]


@kernel
def drive_force(system, state, carriage):
    """Force (N) of a drive following its reference, on its joint or on the sheave of its haul rope."""
    if state.drive_mode[carriage] == HAULED:
        return sheave_force(system, state, carriage)
    return driven_force(system, state, carriage)


@kernel
def find_saturated(system, state, before, work):
    """Find drives beyond their force limit, with the limit (N) in `saturation`, 0 for others; returns whether any."""
    saturated = False
    for carriage in range(system.carriages.fixed.size):
        work.saturation[carriage] = 0.0
        if (
            follows_reference(before.drive_mode, before.sheave_mode, carriage)
            and not system.carriages.clamped[carriage]
        ):
            force = drive_force(system, state, carriage)
            limit = force_limit(system.carriages, state, carriage, before.reference.velocity[carriage])
            if abs(force) > limit:
                work.saturation[carriage] = limit if force > 0.0 else -limit
                saturated = True
    return saturated


@kernel
def hold_at_limits(state, work):
    """Switch saturated drives, found by `find_saturated`, to force mode at their limit."""
    for carriage in range(work.saturation.size):
        if work.saturation[carriage] != 0.0:
            set_drive_mode(state, carriage, FORCE)
            state.drive_force[carriage] = work.saturation[carriage]


@kernel
def follow_again(state, work):
    """Switch saturated drives back to their references, from the speed reached."""
    for carriage in range(work.saturation.size):
        if work.saturation[carriage] != 0.0:
            set_drive_mode(state, carriage, SPEED)
            take_over(state, carriage)


@kernel
def report_forces(system, state):
    """Store in `drive_force` the force of each drive following its reference."""
    for carriage in range(system.carriages.fixed.size):
        if state.attached[carriage] and follows_reference(state.drive_mode, state.sheave_mode, carriage):
            state.drive_force[carriage] = drive_force(system, state, carriage)
