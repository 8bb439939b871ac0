"""The elements of the cable: their residual and tangent, with inertia and gravity (paper, eq. 1-10).

Inside, an element is its chord and its two slopes times length, as in `elastic_models`.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.lanes import WIDTH, gather, gather_numbers, spread
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    block,
    full,
    load,
    outer,
    scale,
    store,
    subtract,
    transpose,
)
from cable_twin.mechanics.rope.elastic_models import chord_and_slopes, combine, elastic_force
from cable_twin.mechanics.rope.shape_functions import MASS


@kernel
def inertia(cable, length, r_a, a, r_b, b):
    """Inertia less gravity, M (e_ddot - g) (eq. 5, 6): forces (dim,) N on r_A, r_B and N m / l on the slopes A, B.

    Takes the length (m) and the accelerations (dim,) of the nodal coordinates, those of slopes in 1/s².
    """
    mass = cable.mass_per_length * length
    r_a, r_b = subtract(r_a, cable.gravity), subtract(r_b, cable.gravity)
    a, b = scale(length, a), scale(length, b)
    on_r_a = scale(mass, add_scaled(MASS[0][0], r_a, combine(MASS[0][1:], a, r_b, b)))
    on_a = scale(mass, add_scaled(MASS[1][0], r_a, combine(MASS[1][1:], a, r_b, b)))
    on_r_b = scale(mass, add_scaled(MASS[2][0], r_a, combine(MASS[2][1:], a, r_b, b)))
    on_b = scale(mass, add_scaled(MASS[3][0], r_a, combine(MASS[3][1:], a, r_b, b)))
    return on_r_a, on_a, on_r_b, on_b


@inlined_kernel
def add_cable(cable, state, mass_factor, rate_factor, stiffness_factor, work):
    """Write the residual and tangent of all elements, each with the elastic model of the cable.

    Elements are computed `WIDTH` at a time; in the last group, what is left over repeats the last element.
    """
    e, e_dot, e_ddot = state.nodes.position, state.nodes.velocity, state.nodes.acceleration
    diagonal, upper, lower, right_side, group = work.diagonal, work.upper, work.lower, work.right_side, work.group
    like = cable.gravity
    clear_array(right_side[0])
    clear_array(diagonal[0])
    for first in range(0, cable.element_count, WIDTH):
        length = gather_numbers(cable.element_length, first)
        r_a, slope_a, r_b, slope_b = gather(e, first, like)
        d, a, b = subtract(r_b, r_a), scale(length, slope_a), scale(length, slope_b)
        r_a, slope_a, r_b, slope_b = gather(e_dot, first, like)
        d_dot, a_dot, b_dot = subtract(r_b, r_a), scale(length, slope_a), scale(length, slope_b)
        r_a, slope_a, r_b, slope_b = gather(e_ddot, first, like)
        inert = inertia(cable, length, r_a, slope_a, r_b, slope_b)
        elastic = elastic_force(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor)
        compute_elements(cable, length, elastic, inert, mass_factor, group)
        for lane in range(min(WIDTH, cable.element_count - first)):
            add_element(group, lane, first + lane, diagonal, upper, lower, right_side, like)


@kernel
def end_forces(cable, state, element):
    """Forces (dim,) in N of one element on r_A and r_B, its inertia and weight in them."""
    length = cable.element_length[element]
    d, a, b = chord_and_slopes(state.nodes.position, element, cable)
    d_dot, a_dot, b_dot = chord_and_slopes(state.nodes.velocity, element, cable)
    force, _, _, _, _, _, _, _, _ = elastic_force(cable, length, d, a, b, d_dot, a_dot, b_dot, 0.0, 0.0)
    like, e_ddot = cable.gravity, state.nodes.acceleration
    on_r_a, _, on_r_b, _ = inertia(
        cable,
        length,
        load(e_ddot[element, 0], like),
        load(e_ddot[element, 1], like),
        load(e_ddot[element + 1, 0], like),
        load(e_ddot[element + 1, 1], like),
    )
    return subtract(force, on_r_a), scale(-1.0, add_scaled(1.0, force, on_r_b))


@kernel
def compute_elements(cable, length, elastic, inert, mass_factor, group):
    """Write residual and tangent of `WIDTH` elements to `group`: a row a number, vectors first, then the blocks."""
    force_d, force_a, force_b, k_dd, k_da, k_db, k_aa, k_ab, k_bb = elastic
    on_r_a, on_a, on_r_b, on_b = inert
    dim = len(force_d)
    spread(subtract(force_d, on_r_a), group, 0)
    spread(scale(-length, add_scaled(1.0, force_a, on_a)), group, dim)
    spread(scale(-1.0, add_scaled(1.0, force_d, on_r_b)), group, 2 * dim)
    spread(scale(-length, add_scaled(1.0, force_b, on_b)), group, 3 * dim)

    mass = mass_factor * cable.mass_per_length * length
    first, second = mass * length, mass * length * length  # of slopes: one and two lengths more
    squared = length * length
    row, size = 4 * dim, dim * dim
    spread(full(1.0, k_dd, MASS[0][0] * mass), group, row)
    spread(block(-length, k_da, MASS[0][1] * first), group, row + size)
    spread(full(squared, k_aa, MASS[1][1] * second), group, row + 2 * size)
    spread(full(1.0, k_dd, MASS[2][2] * mass), group, row + 3 * size)
    spread(block(length, k_db, MASS[2][3] * first), group, row + 4 * size)
    spread(full(squared, k_bb, MASS[3][3] * second), group, row + 5 * size)
    spread(full(-1.0, k_dd, MASS[0][2] * mass), group, row + 6 * size)
    spread(block(-length, k_db, MASS[0][3] * first), group, row + 7 * size)
    spread(block(length, k_da, MASS[1][2] * first), group, row + 8 * size)
    spread(full(squared, k_ab, MASS[1][3] * second), group, row + 9 * size)


@kernel
def add_element(group, lane, element, diagonal, upper, lower, right_side, like):
    """Add one element of a group to the residual and tangent of the nodes at its ends.

    The blocks of node B and the coupling are written, those of node A are added to: elements come in their order.
    """
    dim = len(like)
    square = outer(0.0, like, like)
    accumulate(load(group[0:, lane], like), right_side[element, 0])
    accumulate(load(group[dim:, lane], like), right_side[element, 1])
    store(load(group[2 * dim :, lane], like), right_side[element + 1, 0])
    store(load(group[3 * dim :, lane], like), right_side[element + 1, 1])
    row, size = 4 * dim, dim * dim
    cross = load(group[row + size :, lane], square)
    accumulate(load(group[row:, lane], square), diagonal[element, 0, 0])
    accumulate(cross, diagonal[element, 0, 1])
    accumulate(transpose(cross), diagonal[element, 1, 0])
    accumulate(load(group[row + 2 * size :, lane], square), diagonal[element, 1, 1])
    cross = load(group[row + 4 * size :, lane], square)
    store(load(group[row + 3 * size :, lane], square), diagonal[element + 1, 0, 0])
    store(cross, diagonal[element + 1, 0, 1])
    store(transpose(cross), diagonal[element + 1, 1, 0])
    store(load(group[row + 5 * size :, lane], square), diagonal[element + 1, 1, 1])
    coupling = load(group[row + 6 * size :, lane], square)
    store(coupling, upper[element, 0, 0])
    store(coupling, lower[element, 0, 0])
    coupling = load(group[row + 7 * size :, lane], square)
    store(coupling, upper[element, 0, 1])
    store(transpose(coupling), lower[element, 1, 0])
    coupling = load(group[row + 8 * size :, lane], square)
    store(transpose(coupling), upper[element, 1, 0])
    store(coupling, lower[element, 0, 1])
    coupling = load(group[row + 9 * size :, lane], square)
    store(coupling, upper[element, 1, 1])
    store(coupling, lower[element, 1, 1])
