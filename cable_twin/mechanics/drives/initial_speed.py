"""Initial motion: equilibrium of the cable with vehicles moving along it at their initial speeds."""

from __future__ import annotations

from cable_twin.mechanics.drives.pull import joint_forces
from cable_twin.mechanics.drives.reference import follow
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, scale
from cable_twin.mechanics.on_rope.chain import move_chain
from cable_twin.mechanics.on_rope.sliding_joint import (
    joint_kink,
    joint_velocity,
    place_joint,
)
from cable_twin.mechanics.parameters import DRUM
from cable_twin.mechanics.rope.kink import has_kinks


@kernel
def set_going(system, state, carriage, speed):
    """Set a carriage at rest in motion along the cable at `speed` (m/s): joint, drum, reference and all bodies."""
    cable = system.cable
    state.joints.velocity[carriage] = speed
    place = state.joints.position[carriage]
    if state.axis[carriage] == DRUM:
        state.drums.velocity[carriage] = state.hauled.velocity[carriage] = speed
        place = state.drums.position[carriage]
    follow(state.reference, carriage, place, speed, 0.0)
    place_joint(cable, state, carriage)
    velocity = joint_velocity(cable, state, carriage)
    if has_kinks(cable):  # what the joint yields changes on the way
        bent = joint_kink(cable, state, carriage, joint_forces(system, state, carriage)[0])
        velocity = add_scaled(-speed, bent.by_place, velocity)
    # the rope is bent there by the vehicle itself, and the bend goes along with it: no v²/r of that
    move_chain(system.carriages, cable.gravity, state, carriage, velocity, scale(0.0, velocity))
