"""Switching of drive modes and references, on the joint itself or on the sheave of a haul rope."""

from __future__ import annotations

from cable_twin.mechanics.drives.reference import follow
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.parameters import HAULED


@kernel
def set_drive_mode(state, carriage, mode):
    """Set the mode FREE, FORCE or SPEED of a drive, on the joint itself or on the sheave of a haul rope."""
    if state.drive_mode[carriage] == HAULED:
        state.sheave_mode[carriage] = mode
    else:
        state.drive_mode[carriage] = mode


@kernel
def take_over(state, carriage):
    """Start the reference of a drive from the present place (m) and speed (m/s) of its joint or sheave."""
    moving = state.joints.position[carriage], state.joints.velocity[carriage]
    if state.drive_mode[carriage] == HAULED:
        moving = state.sheaves.position[carriage], state.sheaves.velocity[carriage]
    follow(state.reference, carriage, moving[0], moving[1], 0.0)
