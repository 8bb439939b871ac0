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
from cable_twin.mechanics.rope.flow import flow_energy
from cable_twin.mechanics.rope.rope_energies import rope_energies


@kernel
def energies(system, state):
    """Kinetic, elastic and gravitational energy (J) of cable, vehicles, supports, drives and haul ropes.

    Gravitational energy is zero at the origin; that of a counterweight, the potential of its force, at travel 0.
    """
    cable, carriages = system.cable, system.carriages
    like = cable.gravity
    kinetic, elastic, gravitational = rope_energies(cable, state, 0, cable.element_count)
    of_hauls = haul_energies(system, state)
    kinetic, elastic = kinetic + of_hauls[0], elastic + of_hauls[1]
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
