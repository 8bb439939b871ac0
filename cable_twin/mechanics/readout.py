"""What can be read from a state: shape, tension, reactions, energy. Nothing here changes the motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.by_reference import by_reference
from cable_twin.mechanics.compilation import kernel
from cable_twin.mechanics.counterweight import counterweight_energies, counterweight_motion
from cable_twin.mechanics.elastic_models import elastic_energy, mean_tension
from cable_twin.mechanics.equations_of_motion import assemble_cable
from cable_twin.mechanics.haul_rope import haul_energies, rope_force
from cable_twin.mechanics.moving_cable import flow_energy, haul_force
from cable_twin.mechanics.parameters import HAULED, FloatArray, System
from cable_twin.mechanics.shape_functions import MASS, shape_functions
from cable_twin.mechanics.sliding_joint import locate, position_on_cable
from cable_twin.mechanics.support import contact_energy, contact_force, tower_forces
from cable_twin.mechanics.vectors import accumulate, dot, load, scale, store


@by_reference
class Observation(NamedTuple):
    """What a frame shows of a state and has to be computed for it."""

    positions: FloatArray  # (n, dim) m, of the samples along the cable
    tensions: FloatArray  # (n,) N, of the same
    joints: FloatArray  # (carriages, dim) m, places of the joints on the cable
    ends: FloatArray  # (2, dim) N, forces of the supports of start and end on the cable
    towers: FloatArray  # (towers, dim) N, forces of the towers on it
    travels: FloatArray  # (2,) m, of the counterweights at start and end
    rope_forces: FloatArray  # (carriages,) N, of the haul ropes on their carriages
    haul_force: FloatArray  # (1,) N, of the drive of a moving cable


def allocate_observation(system: System, samples: int) -> Observation:
    """Room for what `observe` fills, with a number of samples along the cable."""
    dim, carriages = len(system.cable.gravity), system.carriages.fixed.size
    return Observation(
        positions=np.empty((samples, dim)),
        tensions=np.empty(samples),
        joints=np.empty((carriages, dim)),
        ends=np.empty((2, dim)),
        towers=np.empty((system.supports.top.shape[0], dim)),
        travels=np.zeros(2),
        rope_forces=np.zeros(carriages),
        haul_force=np.zeros(1),
    )


@kernel
def observe(system, state, work, arc_lengths, means, seen):
    """Fill an observation, of the cable at `arc_lengths` (n,) in m; `means` (elements,) is scratch.

    All in one call: to hand a state over from Python takes longer than to read it.
    """
    cable = system.cable
    sample_positions(cable, state, arc_lengths, seen.positions)
    sample_tensions(cable, state, arc_lengths, seen.tensions, means)
    sample_positions(cable, state, state.sliding_coordinate, seen.joints)
    support_forces(system, state, work, seen.ends)
    tower_forces(cable, system.supports, state, seen.towers)
    for end in range(2):
        if system.counterweights.mass[end] > 0.0:
            seen.travels[end], _, _ = counterweight_motion(system.counterweights, cable, state, end)
    for carriage in range(state.drive_mode.size):
        if state.drive_mode[carriage] == HAULED:
            seen.rope_forces[carriage], _, _, _ = rope_force(system, state, carriage)
    if system.moving_cable.moving:
        seen.haul_force[0] = haul_force(system, state)


@kernel
def sample_positions(cable, state, arc_lengths, positions):
    """Fill `positions` (n, dim) in m at `arc_lengths` (n,) in m."""
    for k in range(arc_lengths.size):
        store(position_on_cable(cable, state, arc_lengths[k]), positions[k])


@kernel
def sample_tensions(cable, state, arc_lengths, tensions, means):
    """Fill `tensions` (n,) in N: linear between the means of the elements, placed at their middles.

    `means` (elements,) is scratch. The end elements go on with the slope of their neighbour.
    """
    count = cable.element_count
    for element in range(count):
        means[element] = mean_tension(cable, state, element)
    for k in range(arc_lengths.size):
        if count == 1:
            tensions[k] = means[0]
        else:
            place = arc_lengths[k] / cable.element_length - 0.5
            left = min(max(int(place), 0), count - 2)
            tensions[k] = means[left] + (place - left) * (means[left + 1] - means[left])


@kernel
def support_forces(system, state, work, forces):
    """Fill `forces` (2, dim) in N: what the supports exert on the cable, from the balance of the end nodes.

    Taken with the contact forces as they are, so that a drive that has just been changed does not show in them.
    """
    cable = system.cable
    assemble_cable(system, state, 1.0, 0.0, 0.0, work)
    for carriage in range(system.carriages.fixed.size):
        if not state.attached[carriage]:
            continue
        element, x = locate(cable, state.sliding_coordinate[carriage])
        shape = shape_functions(x, cable.element_length)
        contact = load(state.multipliers[system.carriages.body_offset[carriage]], cable.gravity)
        for i in range(4):
            accumulate(scale(-shape[i], contact), work.right_side[element + i // 2, i % 2])
    for number in range(system.supports.stiffness.size):
        element, x = locate(cable, state.support_arc_length[number])
        shape = shape_functions(x, cable.element_length)
        force, _ = contact_force(cable, system.supports, state, number)
        for i in range(4):
            accumulate(scale(shape[i], force), work.right_side[element + i // 2, i % 2])
    for i in range(forces.shape[1]):
        forces[0, i] = -work.right_side[0, 0, i]
        forces[1, i] = -work.right_side[cable.element_count, 0, i]


@kernel
def energies(system, state):
    """Kinetic, elastic and gravitational energy (J) of the cable, what is on it, supports, drives and haul ropes.

    Gravitational energy is zero at the origin; that of a counterweight, the potential of its force, at travel 0.
    """
    cable, carriages = system.cable, system.carriages
    like = cable.gravity
    length = cable.element_length
    kinetic, elastic = haul_energies(system, state)
    gravitational = 0.0
    for element in range(cable.element_count):
        elastic += elastic_energy(cable, state, element)
        for i in range(4):
            scale_i = length if i % 2 else 1.0
            v_i = load(state.nodal_velocities[element + i // 2, i % 2], like)
            for j in range(4):
                scale_j = length if j % 2 else 1.0
                v_j = load(state.nodal_velocities[element + j // 2, j % 2], like)
                share = cable.mass_per_length * length * MASS[i][j] * scale_i * scale_j
                kinetic += 0.5 * share * dot(v_i, v_j)
            # the position shape functions sum to one, so a row of M applied to g is the weight
            row = cable.mass_per_length * length * scale_i * (MASS[i][0] + MASS[i][2])
            gravitational -= row * dot(like, load(state.nodal_coordinates[element + i // 2, i % 2], like))
    if system.moving_cable.moving:
        kinetic += flow_energy(cable, state)
    for carriage in range(carriages.fixed.size):
        for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
            if not state.attached[carriage]:
                continue
            v = state.body_velocities[body]
            kinetic += 0.5 * carriages.mass[body] * (v[0] * v[0] + v[1] * v[1])
            kinetic += 0.5 * carriages.inertia[body] * v[2] * v[2]
            q = state.body_coordinates[body]
            gravitational -= carriages.mass[body] * (like[0] * q[0] + like[1] * q[1])
    for contact in range(system.supports.stiffness.size):
        elastic += contact_energy(cable, system.supports, state, contact)
    for end in range(2):
        moving, buffers, lifted = counterweight_energies(system.counterweights, cable, state, end)
        kinetic, elastic, gravitational = kinetic + moving, elastic + buffers, gravitational + lifted
    return kinetic, elastic, gravitational
