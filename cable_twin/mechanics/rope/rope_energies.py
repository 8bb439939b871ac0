"""Energies of the elements of a rope."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import dot
from cable_twin.mechanics.rope.ale import nodal_vectors, rest_stretch
from cable_twin.mechanics.rope.elastic_models import elastic_energy
from cable_twin.mechanics.rope.patch import beside_load, motion_at_rest
from cable_twin.mechanics.rope.point import coordinate
from cable_twin.mechanics.rope.shape_functions import MASS


@inlined_kernel
def velocity_of_rope(cable, state, element):
    """Velocities (dim,) of the rope at fixed arc lengths: r_A, slope A, r_B, slope B of an element, per second."""
    if beside_load(cable, state, element):
        return motion_at_rest(cable, state, element, state.nodes.acceleration, state.joints.acceleration)[1]
    return nodal_vectors(state.nodes.velocity, element, cable.gravity)


@inlined_kernel
def mass_of(cable, state, length, i, j):
    """Entry of the mass matrix of an element of a length (m): kg of positions, kg m and kg m² of slopes."""
    scale_i, scale_j = length if i % 2 else 1.0, length if j % 2 else 1.0
    return cable.mass_per_length * rest_stretch(cable, state) * length * MASS[i][j] * scale_i * scale_j


@kernel
def rope_energies(cable, state, first, last):
    """Kinetic, elastic and gravitational energy (J) of the elements from `first` on, before `last`."""
    kinetic, elastic, gravitational = 0.0, 0.0, 0.0
    for element in range(first, last):
        length = state.mesh.length[element]
        elastic += elastic_energy(cable, state, element)
        rates = velocity_of_rope(cable, state, element)
        for i in range(4):
            for j in range(4):
                kinetic += 0.5 * mass_of(cable, state, length, i, j) * dot(rates[i], rates[j])
            # the position shape functions sum to one, so a row of M applied to g is the weight
            row = mass_of(cable, state, length, i, 0) + mass_of(cable, state, length, i, 2)
            gravitational -= row * dot(cable.gravity, coordinate(state.nodes.position, element, i, cable.gravity))
    return kinetic, elastic, gravitational
