"""Action of a vehicle's drive on its joint in the equations of motion, which depend on the drive mode here only.

A joint follows a reference, or it is free along the cable under a given force or the pull of a haul rope. The reaction
to a drive on the joint acts on the cable, the reaction to a haul rope on its station.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import Any

import numpy as np

from cable_twin.mechanics.drives.haul_rope import condense_drum, haul_direction, pull_on_carriage, recover_drum
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, store, subtract
from cable_twin.mechanics.on_rope.buffer import push_on
from cable_twin.mechanics.on_rope.load_node import rope_passing
from cable_twin.mechanics.on_rope.presence import vehicles_of
from cable_twin.mechanics.on_rope.rails import force_of_ropes
from cable_twin.mechanics.on_rope.sliding_joint import driven_force, joint_tangent
from cable_twin.mechanics.parameters import DRUM, JOINT, SPEED, IntArray, System
from cable_twin.mechanics.rope.patch import at_node, is_driven


@inlined_kernel
def reference_gap(state, carriage, work):
    """Store the distance (m) from a driven joint to its reference as the increment of the sliding coordinate s."""
    if is_driven(state, carriage):
        work.sliding_increment[carriage] = state.reference.position[carriage] - state.joints.position[carriage]


@inlined_kernel
def reference_acceleration(state, carriage, work):
    """Store the reference acceleration (m/s²) of a driven joint as the increment of the sliding coordinate s."""
    if is_driven(state, carriage):
        work.sliding_increment[carriage] = state.reference.acceleration[carriage]


@inlined_kernel
def condense_drive(system, state, carriage, mass_factor, rate_factor, work):
    """Store what a drive adds to its joint's equation: whether it prescribes the joint, drive force, haul rope pull."""
    work.driven[carriage] = is_driven(state, carriage)
    work.given_force[carriage] = state.drives.force[carriage] if state.axis[carriage] == JOINT else 0.0
    work.haul_force[carriage], work.haul_by_way[carriage], work.haul_change[carriage] = 0.0, 0.0, 0.0
    if state.axis[carriage] == DRUM:
        condense_drum(system, state, carriage, mass_factor, rate_factor, work)
    elif system.haul_ropes.axial_stiffness[carriage] > 0.0:  # held at rest, by its rope
        d = haul_direction(system, state, carriage)
        state.drives.force[carriage] = driven_force(system, state, carriage)
        work.haul_force[carriage] = state.drives.force[carriage] / sqrt(dot(d, d))
        store(d, work.haul_direction[carriage])


@inlined_kernel
def recover_drive(state, carriage, moved, work):
    """Store the increments of a vehicle's haul rope and drum, from the displacement (dim,) of its joint."""
    if state.axis[carriage] == DRUM:
        recover_drum(carriage, moved, work)


@kernel
def way_per_metre(system, state, carriage):
    """Way (-) of a vehicle's drive per metre of its travel: times force (N) and speed (m/s) it is the power (W).

    A drive on the carriage pulls along the stretched rope, and its speed counts unstrained rope: the way is |r_x|, at a
    node the mean of both sides. That of a haul rope pulls with the force that belongs to its travel.
    """
    if state.axis[carriage] == DRUM:
        return 1.0
    if at_node(system.cable, state, carriage):
        return rope_passing(state.nodes.position, state.joint_node[carriage], system.cable.gravity)
    r_x = joint_tangent(system.cable, state, carriage)
    return sqrt(dot(r_x, r_x))


@kernel
def observe_haul(system, state, carriage):
    """Drum travel (m) and speed (m/s) of a haul rope, force (N) of haul rope or clamp on the vehicle; NaN if absent."""
    if state.clamp_holds[carriage]:
        r_x = joint_tangent(system.cable, state, carriage)
        return nan, nan, dot(load(state.clamp_force[carriage], r_x), r_x) / sqrt(dot(r_x, r_x))
    if state.axis[carriage] != DRUM:
        return nan, nan, nan
    d = haul_direction(system, state, carriage)
    force = pull_on_carriage(system, state, carriage) * sqrt(dot(d, d))
    return state.drums.position[carriage], state.drums.velocity[carriage], force


@kernel
def joint_forces(system, state, carriage):
    """Forces (dim,) in N on a vehicle at its joint: of the cable, and of its haul rope or clamp (0 without one)."""
    force = force_of_ropes(system, state, carriage)
    pull = scale(0.0, force)
    if state.axis[carriage] == DRUM:
        pull = scale(pull_on_carriage(system, state, carriage), haul_direction(system, state, carriage))
    elif state.clamp_holds[carriage]:
        pull = load(state.clamp_force[carriage], force)
    if system.buffers.present:
        force = subtract(force, push_on(system, state, carriage))
    return add_scaled(-1.0, pull, force), pull


def hold_all(system: System, state: Any) -> tuple[IntArray, IntArray]:
    """Fix all vehicles of a rope at their arc lengths; return their previous drive axes and modes (vehicles,)."""
    held, own = (state.axis.copy(), state.drives.mode.copy()), vehicles_of(system, state)
    state.axis[own], state.drives.mode[own] = JOINT, SPEED
    state.reference.position[own] = state.joints.position[own]
    return held


def release_joints(system: System, state: Any, axes: IntArray, modes: IntArray) -> None:
    """Restore axes and modes of a rope's drives; driven and hauled vehicles keep their holding force as drive force."""
    own = vehicles_of(system, state)
    state.drives.force[own & (((modes != SPEED) & (axes != DRUM)) | ~state.attached)] = 0.0
    for carriage in np.flatnonzero(own & (axes == DRUM)).tolist():  # along the haul rope, on the arc length
        state.drives.force[carriage] /= np.linalg.norm(haul_direction(system, state, carriage))
    state.axis[own], state.drives.mode[own] = axes[own], modes[own]
