"""Energies of a rope with its vehicles, supports and drives."""

from __future__ import annotations

from cable_twin.mechanics.drives.haul_rope import haul_energies
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.rotations import inertia_of
from cable_twin.mechanics.language.vectors import dot, load, product
from cable_twin.mechanics.on_rope.buffer import buffers_energy
from cable_twin.mechanics.on_rope.chain import axes_of, centre, spin_of
from cable_twin.mechanics.on_rope.counterweight import counterweight_energies
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.on_rope.sliding_joint import spring_energy
from cable_twin.mechanics.on_rope.tower import contact_energy
from cable_twin.mechanics.rope.ale import nodal_vectors, rest_stretch
from cable_twin.mechanics.rope.elastic_models import elastic_energy
from cable_twin.mechanics.rope.flow import flow_energy
from cable_twin.mechanics.rope.patch import beside_load, motion_at_rest
from cable_twin.mechanics.rope.point import coordinate
from cable_twin.mechanics.rope.shape_functions import MASS


@kernel
def energies(system, state):
    """Kinetic, elastic and gravitational energy (J) of cable, vehicles, supports, drives and haul ropes.

    Gravitational energy is zero at the origin; that of a counterweight, the potential of its force, at travel 0.
    """
    cable, carriages = system.cable, system.carriages
    like, mass_per_length = cable.gravity, cable.mass_per_length * rest_stretch(cable, state)
    kinetic, elastic = haul_energies(system, state)
    gravitational = 0.0
    for element in range(cable.element_count):
        elastic += elastic_energy(cable, state, element)
        length = state.mesh.length[element]
        rates = nodal_vectors(state.nodes.velocity, element, like)
        if beside_load(cable, state, element):
            rates = motion_at_rest(cable, state, element, state.nodes.acceleration, state.joints.acceleration)[1]
        for i in range(4):
            scale_i = length if i % 2 else 1.0
            for j in range(4):
                scale_j = length if j % 2 else 1.0
                share = mass_per_length * length * MASS[i][j] * scale_i * scale_j
                kinetic += 0.5 * share * dot(rates[i], rates[j])
            # the position shape functions sum to one, so a row of M applied to g is the weight
            row = mass_per_length * length * scale_i * (MASS[i][0] + MASS[i][2])
            gravitational -= row * dot(like, coordinate(state.nodes.position, element, i, like))
    if system.moving_cable.moving:
        kinetic += flow_energy(cable, state)
    for carriage in range(carriages.fixed.size):
        if not rides(system, state, carriage):
            continue
        for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
            v = state.bodies.velocity[body]
            velocity, spin = load(v, like), spin_of(state.bodies.velocity, body, like)
            kinetic += 0.5 * carriages.mass[body] * dot(velocity, velocity)
            inertia = inertia_of(carriages.inertia, body, axes_of(state, body, like), like)
            kinetic += 0.5 * dot(spin, product(inertia, spin))
            elastic += spring_energy(system, state, carriage, body)
            gravitational -= carriages.mass[body] * dot(like, centre(state, body, like))
        if system.buffers.present:
            elastic += buffers_energy(system, state, carriage)
    for contact in range(system.towers.stiffness.size):
        elastic += contact_energy(cable, system.towers, state, contact)
    for end in range(2):
        moving, buffers, lifted = counterweight_energies(system.counterweights, cable, state, end)
        kinetic, elastic, gravitational = kinetic + moving, elastic + buffers, gravitational + lifted
    return kinetic, elastic, gravitational
