"""What a command changes at a drive, be it on the joint itself or on the sheave of a haul rope."""

from __future__ import annotations

from cable_twin.mechanics.drives.reference import follow
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.parameters import HAULED


@kernel
def set_drive_mode(state, carriage, mode):
    """Put a drive into FREE, FORCE or SPEED, be it on the joint itself or on the sheave of a haul rope."""
    if state.drive_mode[carriage] == HAULED:
        state.sheave_mode[carriage] = mode
    else:
        state.drive_mode[carriage] = mode


@kernel
def take_over(state, carriage):
    """Let the reference go on from the place (m) and speed (m/s) of the joint or sheave that is to follow it."""
    moving = state.joints.position[carriage], state.joints.velocity[carriage]
    if state.drive_mode[carriage] == HAULED:
        moving = state.sheaves.position[carriage], state.sheaves.velocity[carriage]
    follow(state.reference, carriage, moving[0], moving[1], 0.0)
