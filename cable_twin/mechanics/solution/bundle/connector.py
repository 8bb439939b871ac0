"""Connectors between two ropes, and Rayleigh damping of ropes, as in EN 50318.

A connector is massless: a dropper, or a slack carrier. The damping is C = α M + β K, K of the static tension: bending
has damping of its own already (`damping_time` of the elastic model); β adds the stiffness that a string has by its
tension T, β T ∫S_xᵀS_x dx.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    dot,
    full,
    load,
    outer,
    scale,
    store,
    subtract,
    symmetric,
)
from cable_twin.mechanics.rope.ale import nodal_vectors
from cable_twin.mechanics.rope.shape_functions import MASS, SLOPE
from cable_twin.mechanics.solution.bundle.records import STATE, WORK


@inlined_kernel
def connector_force(bundle, connector, state, like):
    """Pull (N) of a connector, its tangent, its direction from first to second end, and its length (m).

    Returns:
        Pull, its derivatives by distance (N/m) and by the rate of that (N s/m), unit vector (dim,), distance, and the
        part (dim,) across of the velocity of the second end, as the first one sees it, in m/s.
    """
    connectors = bundle.connectors
    first = record_at(bundle.records[connectors.rope[connector, 0], STATE], state).nodes
    second = record_at(bundle.records[connectors.rope[connector, 1], STATE], state).nodes
    a, b = connectors.node[connector, 0], connectors.node[connector, 1]
    apart = subtract(load(second.position[b, 0], like), load(first.position[a, 0], like))
    distance = sqrt(dot(apart, apart))
    along = scale(1.0 / distance, apart)
    moving = subtract(load(second.velocity[b, 0], like), load(first.velocity[a, 0], like))
    rate = dot(along, moving)
    across = add_scaled(-rate, along, moving)
    longer = distance - connectors.length[connector]
    if longer > 0.0:
        stiffness, damping = connectors.stiffness[connector], connectors.damping[connector]
        return stiffness * longer + damping * rate, stiffness, damping, along, distance, across
    stiffness = connectors.compression[connector]
    return stiffness * longer, stiffness, 0.0, along, distance, across


@kernel
def add_connectors(bundle, moving, scratch, state, work, rate_factor, stiffness_factor, like):
    """Add force and tangent of all connectors to their end nodes, the coupling of both nodes to `cross`.

    Returns:
        Number of connectors that have begun or ceased to pull since the last call.
    """
    connectors, changed = bundle.connectors, 0
    for connector in range(connectors.length.size):
        pull, stiffness, damping, along, distance, across = connector_force(bundle, connector, state, like)
        radial = stiffness_factor * stiffness + rate_factor * damping
        turned = stiffness_factor * pull / distance
        matrix = full(1.0, symmetric(turned, radial - turned, along), 0.0)
        matrix = add_scaled(1.0, outer(stiffness_factor * damping / distance, along, across), matrix)
        store(scale(-1.0, matrix), scratch.cross[connector])
        for end in range(2):
            own = record_at(bundle.records[connectors.rope[connector, end], WORK], work)
            node = connectors.node[connector, end]
            accumulate(scale(pull if end == 0 else -pull, along), own.right_side[node, 0])
            accumulate(matrix, own.diagonal[node, 0, 0])
        tight = 1 if distance > connectors.length[connector] else 0
        changed += abs(tight - moving.tight[connector])
        moving.tight[connector] = tight
    return changed


@kernel
def connector_forces(bundle, state, like, forces):
    """Write the pull (connectors,) in N of all connectors into an array."""
    for connector in range(bundle.connectors.length.size):
        forces[connector] = connector_force(bundle, connector, state, like)[0]


@kernel
def damp_rope(cable, by_mass, tension_time, state, work, rate_factor):
    """Add the Rayleigh damping of one rope to its residual and tangent.

    Args:
        cable: its parameters.
        by_mass: α, 1/s.
        tension_time: β T, N s.
        state: its motion.
        work: takes the result.
        rate_factor: as in `assemble`.
    """
    for element in range(cable.element_count):
        length = state.mesh.length[element]
        mass = by_mass * cable.mass_per_length * length
        rates = nodal_vectors(state.nodes.velocity, element, cable.gravity)
        matrices = work.diagonal, work.upper, work.lower
        damp_element(element, length, mass, tension_time / length, rates, rate_factor, *matrices, work.right_side)


@formula
def damp_element(element, length, mass, tension, rates, rate_factor, diagonal, upper, lower, right_side):
    """Add the Rayleigh damping of an element beside no load: α times its mass (kg/s), β T over its length (N s/m)."""
    for i in range(4):
        total = 0.0 * rates[i]
        for j in range(4):
            damping = mass * MASS[i][j] + tension * SLOPE[i][j]
            for _ in range(i % 2 + j % 2):
                damping = length * damping
            total = total - damping * rates[j]
            array = diagonal if i // 2 == j // 2 else upper if i // 2 == 0 else lower
            node = element + (i // 2 if i // 2 == j // 2 else 0)
            for axis in range(len(total)):
                entry = axis * (len(total) + 1)
                known = array[node, i % 2, j % 2, entry]
                array[node, i % 2, j % 2, entry] = known + rate_factor * damping
        accumulate(total, right_side[element + i // 2, i % 2])
