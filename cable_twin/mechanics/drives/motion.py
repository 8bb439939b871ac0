"""Drives within a time step: motion of their references, force limits, initial speeds of vehicles."""

from __future__ import annotations

from cable_twin.mechanics.drives.haul_rope import drum_force, haul_direction
from cable_twin.mechanics.drives.joint_drive import way_per_metre
from cable_twin.mechanics.drives.moving_rope import move_rope
from cable_twin.mechanics.drives.speed_reference import advance_reference, follow
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import dot, scale, store
from cable_twin.mechanics.on_rope.brakes import force_limit, saturation_of
from cable_twin.mechanics.on_rope.chain import move_chain
from cable_twin.mechanics.on_rope.presence import belongs, rides
from cable_twin.mechanics.on_rope.sliding_joint import (
    driven_force,
    joint_velocity,
    place_joint,
)
from cable_twin.mechanics.parameters import DRUM, FORCE, SPEED
from cable_twin.mechanics.rope.patch import at_node, mean_slope
from cable_twin.mechanics.rope.point import R


@kernel
def move_drives(system, state, duration):
    """Advance the moving rope and the drive references of its vehicles by `duration` (s)."""
    if system.moving_cable.moving:
        move_rope(system, state, duration)
    for carriage in range(system.carriages.fixed.size):
        if not belongs(system, state, carriage):
            continue
        if state.drives.braking[carriage]:
            state.drives.braking_time[carriage] += duration
        if state.drives.mode[carriage] == SPEED and not system.carriages.clamped[carriage]:
            advance_reference(system.carriages, system.cable, state, carriage, duration)


@kernel
def prescribe(system, state):
    """Set position, velocity and acceleration of all driven joints and haul drums to their references."""
    reference = state.reference
    for carriage in range(state.axis.size):
        driven = state.drums if state.axis[carriage] == DRUM else state.joints
        if state.drives.mode[carriage] == SPEED and belongs(system, state, carriage):
            driven.position[carriage] = reference.position[carriage]
            driven.velocity[carriage] = reference.velocity[carriage]
            driven.acceleration[carriage] = driven.algorithmic[carriage] = reference.acceleration[carriage]


@kernel
def drive_force(system, state, carriage):
    """Force (N) of a drive following its reference, on its joint or on the drum of its haul rope."""
    if state.axis[carriage] == DRUM:
        return drum_force(system, state, carriage)
    return driven_force(system, state, carriage)


@kernel
def find_saturated(system, state, before, work):
    """Find drives beyond their force limit, store the limit (N) in `saturation`, 0 for others; return whether any."""
    saturated = False
    for carriage in range(system.carriages.fixed.size):
        work.saturation[carriage] = 0.0
        if not belongs(system, before, carriage):
            continue
        if before.drives.mode[carriage] == SPEED and not system.carriages.clamped[carriage]:
            force = drive_force(system, state, carriage)
            speed = max(abs(before.reference.velocity[carriage]), abs(state.reference.velocity[carriage]))
            speed *= way_per_metre(system, before, carriage)  # so that its power is within the limit all the step
            limit = force_limit(system.carriages, state, carriage, speed)
            work.saturation[carriage] = saturation_of(force, limit)
            saturated |= work.saturation[carriage] != 0.0
    return saturated


@kernel
def hold_at_limits(state, work):
    """Switch the drives beyond their force limit, as stored in `saturation`, to force mode at that limit."""
    for carriage in range(work.saturation.size):
        if work.saturation[carriage] != 0.0:
            state.drives.mode[carriage] = FORCE
            state.drives.force[carriage] = work.saturation[carriage]


@kernel
def follow_again(state, work):
    """Switch saturated drives back to speed mode, their references starting at the place and speed reached.

    The acceleration asked for stays: a reference that has to build it up anew within its limit of the jerk would ask
    for less than the drive can give.
    """
    for carriage in range(work.saturation.size):
        if work.saturation[carriage] != 0.0:
            state.drives.mode[carriage] = SPEED
            take_over(state, carriage, state.reference.acceleration[carriage])


@kernel
def take_over(state, carriage, acceleration):
    """Start the reference of a drive at the place and speed of its joint or drum, with an acceleration (m/s²)."""
    driven = state.drums if state.axis[carriage] == DRUM else state.joints
    follow(state.reference, carriage, driven.position[carriage], driven.velocity[carriage], acceleration)


@kernel
def report_forces(system, state):
    """Store the force (N) of each drive that follows its reference in `drives.force`."""
    for carriage in range(system.carriages.fixed.size):
        if rides(system, state, carriage) and state.drives.mode[carriage] == SPEED:
            state.drives.force[carriage] = drive_force(system, state, carriage)


@kernel
def set_going(system, state, carriage, speed):
    """Set a vehicle at rest in motion along the cable at `speed` (m/s): joint, drum, reference and all bodies."""
    cable = system.cable
    state.joints.velocity[carriage] = speed
    place = state.joints.position[carriage]
    if state.axis[carriage] == DRUM:
        state.drums.velocity[carriage] = state.hauled.velocity[carriage] = speed
        place = state.drums.position[carriage]
    follow(state.reference, carriage, place, speed, 0.0)
    place_joint(cable, state, carriage)
    if at_node(cable, state, carriage):  # which goes along, between the velocities of the rope on either side
        node = state.joint_node[carriage]
        r_x = mean_slope(state.nodes.position, node, cable.gravity)
        # so that it passes the rope at `speed`: its path is longer than that, with or without a haul rope
        pace = speed / dot(haul_direction(system, state, carriage), r_x)
        store(scale(pace, r_x), state.nodes.velocity[node, R])
    velocity = joint_velocity(cable, state, carriage)
    # the rope is bent there by the vehicle itself, and the bend goes along with it: no v²/r of that
    move_chain(system.carriages, cable.gravity, state, carriage, velocity, scale(0.0, velocity))
