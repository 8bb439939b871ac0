"""Rope elements: residual and tangent with all distributed loads (paper, eq. 1-10).

Inside, an element is its chord and its two slopes times length, as in `elastic_models`.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.simd import (
    WIDTH,
    gather,
    gather_listed,
    gather_numbers,
    gather_numbers_listed,
    gather_vectors,
    gather_vectors_listed,
    spread,
    turn_lanes,
)
from cable_twin.mechanics.language.traced import formula
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
from cable_twin.mechanics.rope.ale import (
    add_flow,
    flow_factors,
    flow_forces,
    flows,
    mesh_dilution_rate,
    nodal_vectors,
    rest_stretch,
)
from cable_twin.mechanics.rope.elastic_models import chord_force, elastic_force, mean_tension, tension_of
from cable_twin.mechanics.rope.rope_drag import add_drag, drag_on
from cable_twin.mechanics.rope.shape_functions import MASS, block_row, combine, vector_row


@kernel
def inertia(cable, length, stretch, r_a, a, r_b, b):
    """Inertia force less weight of an element, M (e_ddot - g) (eq. 5, 6): (dim,) N on r_A, r_B, N m / l on slopes A, B.

    Takes the length (m), λ of `ale`, and the accelerations (dim,) of the nodal coordinates, those of slopes in 1/s².
    """
    mass = cable.mass_per_length * stretch * length
    r_a, r_b = subtract(r_a, cable.gravity), subtract(r_b, cable.gravity)
    a, b = scale(length, a), scale(length, b)
    on_r_a = scale(mass, add_scaled(MASS[0][0], r_a, combine(MASS[0][1:], a, r_b, b)))
    on_a = scale(mass, add_scaled(MASS[1][0], r_a, combine(MASS[1][1:], a, r_b, b)))
    on_r_b = scale(mass, add_scaled(MASS[2][0], r_a, combine(MASS[2][1:], a, r_b, b)))
    on_b = scale(mass, add_scaled(MASS[3][0], r_a, combine(MASS[3][1:], a, r_b, b)))
    return on_r_a, on_a, on_r_b, on_b


@inlined_kernel
def with_damping(cable, accelerations, rates):
    """Accelerations of four nodal vectors plus α times their rates: inertia with mass-proportional damping included."""
    alpha = cable.mass_damping
    return (
        add_scaled(alpha, rates[0], accelerations[0]),
        add_scaled(alpha, rates[1], accelerations[1]),
        add_scaled(alpha, rates[2], accelerations[2]),
        add_scaled(alpha, rates[3], accelerations[3]),
    )


@inlined_kernel
def add_cable(system, state, mass_factor, rate_factor, stiffness_factor, work):
    """Write residual and tangent of all cable elements: elastic forces, inertia, weight, transport terms, air drag.

    Elements are computed `WIDTH` at a time; in the last group, what is left over repeats the last element. Those beside
    loads are cleared here, and added with the patches of their loads.
    """
    cable, group, plain, count = system.cable, work.group, work.plain_elements, work.plain_count[0]
    e, e_dot, e_ddot = state.nodes.position, state.nodes.velocity, state.nodes.acceleration
    like = cable.gravity
    stretch = rest_stretch(cable, state)
    flowing, taken_in = flows(system, state), mesh_dilution_rate(cable, state)
    clear_array(work.right_side[0])
    clear_array(work.diagonal[0])
    for k in range(work.patch_count[0]):
        clear_element(work.patch_elements[k], like, work)
    for first in range(0, count, WIDTH):
        length = gather_numbers_listed(state.mesh.length, plain, first)
        r_a, slope_a, r_b, slope_b = gather_listed(e, plain, first, like)
        shape = subtract(r_b, r_a), scale(length, slope_a), scale(length, slope_b)
        rates = gather_listed(e_dot, plain, first, like)
        shape_rates = subtract(rates[2], rates[0]), scale(length, rates[1]), scale(length, rates[3])
        inert = inertia(cable, length, stretch, *with_damping(cable, gather_listed(e_ddot, plain, first, like), rates))
        strain_rates = rates_of_strain(taken_in, shape, shape_rates)
        at_rest = stretch * length
        elastic = elastic_force(cable, at_rest, *shape, *strain_rates, rate_factor, stiffness_factor)
        write_group(cable, length, elastic, inert, (mass_factor + cable.mass_damping * rate_factor) * stretch, group)
        if system.moving_cable.moving and flowing:
            factors = flow_factors(
                cable, state, gather_numbers_listed(state.mesh.arc_length, plain, first) + 0.5 * length
            )
            add_flow(length, shape, shape_rates, factors, rate_factor, stiffness_factor, group)
        if system.air.present:
            wind = gather_vectors_listed(state.wind_field.along_rope, plain, first, like)
            add_drag(system.air.rope_drag, wind, length, shape, rates, rate_factor, stiffness_factor, group)
        turn_lanes(group, work.elements, like)
        for lane in range(min(WIDTH, count - first)):
            add_element(work.elements[lane], plain[first + lane], like, work)


@inlined_kernel
def group_tension(cable, state, first):
    """Mean tension (N), with damping, of each of `WIDTH` elements from `first` on, as SIMD lanes."""
    length, like = gather_numbers(state.mesh.length, first), cable.gravity
    r_a, slope_a, r_b, slope_b = gather(state.nodes.position, first, like)
    d, a, b = subtract(r_b, r_a), scale(length, slope_a), scale(length, slope_b)
    r_a, slope_a, r_b, slope_b = gather(state.nodes.velocity, first, like)
    rates = subtract(r_b, r_a), scale(length, slope_a), scale(length, slope_b)
    rates = rates_of_strain(mesh_dilution_rate(cable, state), (d, a, b), rates)
    at_rest = rest_stretch(cable, state) * length
    return mean_tension(cable, at_rest, d, a, b, *rates)


@kernel
def element_tensions(cable, state, tensions):
    """Fill `tensions` (groups, WIDTH) in N with mean tensions of all elements; the last one repeats to fill a group."""
    for group in range(tensions.shape[0]):
        spread((group_tension(cable, state, group * WIDTH),), tensions, group)
        for lane in range(min(WIDTH, cable.element_count - group * WIDTH)):
            element = group * WIDTH + lane
            if state.node_load[element] >= 0 or state.node_load[element + 1] >= 0:  # whose nodes pass over the rope
                tensions[group, lane] = tension_of(cable, state, element)


@formula
def rates_of_strain(taken_in, shape, shape_rates):
    """Straining part of the rates of an element's chord and slopes: less growth `taken_in` (1/s) by inflowing rope."""
    return (
        add_scaled(-taken_in, shape[0], shape_rates[0]),
        add_scaled(-taken_in, shape[1], shape_rates[1]),
        add_scaled(-taken_in, shape[2], shape_rates[2]),
    )


@inlined_kernel
def strand_now(system, state):
    """Flow quantities of a whole rope: rest stretch λ of `ale`, mesh dilution rate (1/s), whether the rope moves."""
    flowing = system.moving_cable.moving and flows(system, state)
    return rest_stretch(system.cable, state), mesh_dilution_rate(system.cable, state), flowing


@inlined_kernel
def forces_of_elements(system, state, strand, first, row):
    """Nodal force (dim,) in N of `WIDTH` elements with all distributed loads, on r_A (row 0) or r_B (row 2).

    Takes the `strand_now`.
    """
    like = system.cable.gravity
    wind = gather_vectors(state.wind_field.along_rope, first, like)
    return along_element(
        system,
        state,
        strand,
        gather_numbers(state.mesh.length, first),
        gather_numbers(state.mesh.arc_length, first),
        gather(state.nodes.position, first, like),
        gather(state.nodes.velocity, first, like),
        gather(state.nodes.acceleration, first, like),
        wind,
        row,
    )


@kernel
def force_of_element(system, state, element, row):
    """Nodal force (dim,) in N of one element with all distributed loads, on r_A (row 0) or r_B (row 2)."""
    like = system.cable.gravity
    return along_element(
        system,
        state,
        strand_now(system, state),
        state.mesh.length[element],
        state.mesh.arc_length[element],
        nodal_vectors(state.nodes.position, element, like),
        nodal_vectors(state.nodes.velocity, element, like),
        nodal_vectors(state.nodes.acceleration, element, like),
        load(state.wind_field.along_rope[:, element], like),
        row,
    )


@inlined_kernel
def along_element(system, state, strand, length, place, e, e_dot, e_ddot, wind, row):
    """Nodal force (dim,) in N on r_A (row 0) or r_B (2) of an element: elastic, inertia, weight, transport, air drag.

    Either for one element, or for `WIDTH` elements in lanes.

    Args:
        system: parameters.
        state: of the whole rope.
        strand: `strand_now`.
        length: m.
        place: arc length of the first node, m.
        e: the four nodal vectors, r in m and r_x.
        e_dot: their rates.
        e_ddot: their accelerations.
        wind: (dim,) in m/s.
        row: 0 or 2.
    """
    cable, (stretch, taken_in, flowing) = system.cable, strand
    shape = subtract(e[2], e[0]), scale(length, e[1]), scale(length, e[3])
    rates = subtract(e_dot[2], e_dot[0]), scale(length, e_dot[1]), scale(length, e_dot[3])
    strain_rates = rates_of_strain(taken_in, shape, rates)
    elastic = chord_force(cable, stretch * length, *shape, *strain_rates)
    inert = inertia(cable, length, stretch, *with_damping(cable, e_ddot, e_dot))[row]
    total = subtract(scale(1.0 if row == 0 else -1.0, elastic), inert)
    if system.moving_cable.moving and flowing:
        factors = flow_factors(cable, state, place + 0.5 * length)
        total = subtract(total, flow_forces(length, shape, rates, factors)[row])
    if system.air.present:
        total = add_scaled(1.0, drag_on(system.air.rope_drag, wind, length, shape, e_dot, row), total)
    return total


@kernel
def write_group(cable, length, elastic, inert, mass_factor, group):
    """Write residual and tangent of `WIDTH` elements to `group`, one row per number: vectors first, then the blocks."""
    force_d, force_a, force_b, k_dd, k_da, k_db, k_aa, k_ab, k_bb = elastic
    on_r_a, on_a, on_r_b, on_b = inert
    like = force_d
    spread(subtract(force_d, on_r_a), group, vector_row(0, like))
    spread(scale(-length, add_scaled(1.0, force_a, on_a)), group, vector_row(1, like))
    spread(scale(-1.0, add_scaled(1.0, force_d, on_r_b)), group, vector_row(2, like))
    spread(scale(-length, add_scaled(1.0, force_b, on_b)), group, vector_row(3, like))

    mass = mass_factor * cable.mass_per_length * length
    first, second = mass * length, mass * length * length  # of slopes: one and two lengths more
    squared = length * length
    spread(full(1.0, k_dd, MASS[0][0] * mass), group, block_row(0, 0, like))
    spread(full(squared, k_aa, MASS[1][1] * second), group, block_row(1, 1, like))
    spread(full(1.0, k_dd, MASS[2][2] * mass), group, block_row(2, 2, like))
    spread(full(squared, k_bb, MASS[3][3] * second), group, block_row(3, 3, like))
    write_pair(block(-length, k_da, MASS[0][1] * first), group, 0, 1, like)
    write_pair(full(-1.0, k_dd, MASS[0][2] * mass), group, 0, 2, like)
    write_pair(block(-length, k_db, MASS[0][3] * first), group, 0, 3, like)
    write_pair(transpose(block(length, k_da, MASS[1][2] * first)), group, 1, 2, like)
    write_pair(full(squared, k_ab, MASS[1][3] * second), group, 1, 3, like)
    write_pair(block(length, k_db, MASS[2][3] * first), group, 2, 3, like)


@inlined_kernel
def write_pair(matrix, group, i, j, like):
    """Write the tangent block of nodal coordinates i and j to a group, and its transpose for j and i."""
    spread(matrix, group, block_row(i, j, like))
    spread(transpose(matrix), group, block_row(j, i, like))


@inlined_kernel
def clear_element(element, like, work):
    """Clear residual and tangent of an element in the workspace, before `add_element`."""
    zero = outer(0.0, like, like)
    for i in range(2):
        store(scale(0.0, like), work.right_side[element + 1, i])
        for j in range(2):
            store(zero, work.diagonal[element + 1, i, j])
            store(zero, work.upper[element, i, j])
            store(zero, work.lower[element, i, j])


@inlined_kernel
def add_element(numbers, element, like, work):
    """Add residual and tangent of one element, `numbers` in the row order of an element group, to its two nodes.

    The blocks of node B and the coupling are written, those of node A are added to: elements come in their order.
    """
    square = outer(0.0, like, like)
    for i in range(2):
        accumulate(load(numbers[vector_row(i, like) :], like), work.right_side[element, i])
        store(load(numbers[vector_row(2 + i, like) :], like), work.right_side[element + 1, i])
        for j in range(2):
            accumulate(load(numbers[block_row(i, j, like) :], square), work.diagonal[element, i, j])
            store(load(numbers[block_row(2 + i, 2 + j, like) :], square), work.diagonal[element + 1, i, j])
            store(load(numbers[block_row(i, 2 + j, like) :], square), work.upper[element, i, j])
            store(load(numbers[block_row(2 + i, j, like) :], square), work.lower[element, i, j])
