"""Rayleigh damping of wires of EN 50318: C = α M + β K, K of their static tension.

Bending has damping of its own already (`damping_time` of the elastic model); what β adds is the stiffness that a string
has of its tension T, β T ∫S_xᵀS_x dx.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, full, scale, symmetric
from cable_twin.mechanics.rope.point import add_block, add_to, coordinate
from cable_twin.mechanics.rope.shape_functions import MASS, SLOPE


@kernel
def damp_wire(cable, by_mass, tension_time, state, work, rate_factor):
    """Add the Rayleigh damping of one rope.

    Args:
        cable: its parameters.
        by_mass: α, 1/s.
        tension_time: β T, N s.
        state: its motion.
        work: takes the result.
        rate_factor: as in `assemble`.
    """
    like = cable.gravity
    unit = full(1.0, symmetric(1.0, 0.0, like), 0.0)
    for element in range(cable.element_count):
        length = cable.element_length[element]
        mass = by_mass * cable.mass_per_length * length
        for i in range(4):
            scale_i = length if i % 2 else 1.0
            total = scale(0.0, like)
            for j in range(4):
                scale_j = scale_i * (length if j % 2 else 1.0)
                damping = scale_j * (mass * MASS[i][j] + tension_time / length * SLOPE[i][j])
                total = add_scaled(-damping, coordinate(state.nodes.velocity, element, j, like), total)
                add_block(scale(rate_factor * damping, unit), element, i, j, work)
            add_to(total, work.right_side, element, i)
