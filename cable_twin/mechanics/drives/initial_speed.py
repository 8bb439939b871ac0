"""A start that is already in motion: the cable as it rests, and what is on it with its speed along it."""

from __future__ import annotations

from cable_twin.mechanics.drives.reference import follow
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.chain import move_chain
from cable_twin.mechanics.on_rope.sliding_joint import joint_velocity, place_joint, velocity_acceleration
from cable_twin.mechanics.parameters import HAULED


@kernel
def set_going(system, state, carriage, speed):
    """Let a carriage at rest move along the cable with `speed` (m/s): joint, sheave, reference and all its bodies."""
    cable = system.cable
    state.joints.velocity[carriage] = speed
    place = state.joints.position[carriage]
    if state.drive_mode[carriage] == HAULED:
        state.sheaves.velocity[carriage] = state.hauled.velocity[carriage] = speed
        place = state.sheaves.position[carriage]
    follow(state.reference, carriage, place, speed, 0.0)
    place_joint(cable, state, carriage)
    velocity = joint_velocity(cable, state, carriage)
    move_chain(
        system.carriages, cable.gravity, state, carriage, velocity, velocity_acceleration(cable, state, carriage)
    )
