"""Derivatives of the forces of rope elements by the length of rope that runs over one end of their mesh (`rope.ale`).

A coordinate u of rope that has run onto the mesh at its start, or off it at its end, moves with the tangent factors of
the integrator, so that rest stretch, dilution rate, transport velocity and its rate all change with it. Everything else
of the elements, shape and its rates, stays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import WIDTH, gather_listed, gather_numbers_listed, spread
from cable_twin.mechanics.language.traced import formula, square_root
from cable_twin.mechanics.language.vectors import accumulate, add_scaled, dot, load, scale, subtract
from cable_twin.mechanics.parameters import ELEMENT_FRAME
from cable_twin.mechanics.rope.ale import (
    between_ends,
    flow_forces,
    mesh_dilution_rate,
    rest_stretch,
)
from cable_twin.mechanics.rope.elastic_models import continuum, element_frame
from cable_twin.mechanics.rope.element import inertia, rates_of_strain, with_damping
from cable_twin.mechanics.rope.shape_functions import AXIAL_POINTS, AXIAL_SLOPES, AXIAL_WEIGHT, combine, vector_row

PART = 1e-6  # of a length, for the difference that stands for the derivative of `element_frame`


class Change(NamedTuple):
    """Derivatives of a strand's transport quantities by the length (m) of rope that runs over one of its ends."""

    stretch: Any  # of λ, 1/m
    dilution: Any  # of λ_t / λ, 1/(s m)
    speed: Any  # of the transport velocity at that end, 1/s
    rate: Any  # of its rate, 1/s²


@inlined_kernel
def change_by_end(cable, state, end, mass_factor, rate_factor):
    """Derivatives (`Change`) of a strand's transport quantities by rope that runs over its start (0) or end (1)."""
    sign = 1.0 if end == 0 else -1.0
    stretch, by_length = rest_stretch(cable, state), sign / cable.unstrained_length
    dilution = (rate_factor * by_length - mesh_dilution_rate(cable, state) * by_length) / stretch
    return Change(by_length, dilution, rate_factor, mass_factor)


@inlined_kernel
def share_of_end(cable, end, arc_length):
    """Share (-) of the rope run over one end that passes an arc length of the mesh."""
    share = arc_length / cable.unstrained_length
    return 1.0 - share if end == 0 else share


@inlined_kernel
def place_by_flow(cable, state, end, arc_length):
    """Displacement (m) along the mesh of a point clamped to the rope, per metre of rope run over one end."""
    return share_of_end(cable, end, arc_length) / rest_stretch(cable, state)


@kernel
def elastic_change(cable, length, d, a, b, d_dot, a_dot, b_dot, longer, dilution):
    """Change of elastic and viscous forces (dim,) in N on chord and slopes for changes of rest length and dilution.

    Takes the arguments of `continuum`, and the changes of its length, relative, and of the dilution rate, in 1/s: that
    of strains is -(longer + damping time · dilution) of the stretch; the curvature does not depend on the dilution.
    """
    if cable.elastic_model == ELEMENT_FRAME:
        rates = add_scaled(-dilution * PART, d, d_dot), add_scaled(-dilution * PART, a, a_dot)
        after = element_frame(
            cable, length * (1.0 + PART * longer), d, a, b, *rates, add_scaled(-dilution * PART, b, b_dot), 0.0, 0.0
        )
        rates = add_scaled(dilution * PART, d, d_dot), add_scaled(dilution * PART, a, a_dot)
        before = element_frame(
            cable, length * (1.0 - PART * longer), d, a, b, *rates, add_scaled(dilution * PART, b, b_dot), 0.0, 0.0
        )
        per = 0.5 / PART
        return (
            scale(per, subtract(after[0], before[0])),
            scale(per, subtract(after[1], before[1])),
            scale(per, subtract(after[2], before[2])),
        )
    forces = continuum(cable, length, d, a, b, d_dot, a_dot, b_dot, 0.0, 0.0)
    on_d, on_a, on_b = scale(-longer, forces[0]), scale(-longer, forces[1]), scale(-longer, forces[2])
    for point in range(AXIAL_POINTS):
        slopes = AXIAL_SLOPES[point]
        rho = combine(slopes, d, a, b)
        norm = square_root(dot(rho, rho))
        strain = longer / norm + cable.damping_time * dilution / length  # over |rho|
        stress = -AXIAL_WEIGHT[point] * cable.axial_stiffness * strain
        on_d = add_scaled(slopes[0] * stress, rho, on_d)
        on_a = add_scaled(slopes[1] * stress, rho, on_a)
        on_b = add_scaled(slopes[2] * stress, rho, on_b)
    return on_d, on_a, on_b


@formula
def factors_change(mass, stretch, speed, change, share):
    """Derivatives of transport force coefficients by rope over an end, where its `share` passes at `speed` (m/s)."""
    by_stretch, _, by_speed, by_rate = change
    on_slope = speed * (speed * by_stretch / stretch - 2.0 * by_speed * share)
    return 2.0 * mass * by_speed * share, mass * by_rate * share, mass / stretch * on_slope


@kernel
def add_flow_tangent(system, state, end, mass_factor, rate_factor, wheel_columns, slot, work):
    """Add the derivative of the residual of all elements by rope over one end to a column of right sides of the nodes.

    Elements beside loads have their derivative in the columns of patches.

    Args:
        system: parameters.
        state: of the rope.
        end: 0 or 1.
        mass_factor: as in `assemble`.
        rate_factor: as in `assemble`.
        wheel_columns: (nodes, slots, 2, dim²), of which column 0 of the block is added to.
        slot: number of the block.
        work: of the rope.
    """
    cable, like, group = system.cable, system.cable.gravity, work.group
    plain, count = work.plain_elements, work.plain_count[0]
    stretch, taken_in = rest_stretch(cable, state), mesh_dilution_rate(cable, state)
    change = change_by_end(cable, state, end, mass_factor, rate_factor)
    for first in range(0, count, WIDTH):
        length = gather_numbers_listed(state.mesh.length, plain, first)
        middle = gather_numbers_listed(state.mesh.arc_length, plain, first) + 0.5 * length
        r_a, slope_a, r_b, slope_b = gather_listed(state.nodes.position, plain, first, like)
        shape = subtract(r_b, r_a), scale(length, slope_a), scale(length, slope_b)
        rates = gather_listed(state.nodes.velocity, plain, first, like)
        shape_rates = subtract(rates[2], rates[0]), scale(length, rates[1]), scale(length, rates[3])
        at_rest = stretch * length
        longer = change.stretch * length / at_rest
        strain_rates = rates_of_strain(taken_in, shape, shape_rates)
        elastic = elastic_change(cable, at_rest, *shape, *strain_rates, longer, change.dilution + 0.0 * length)
        accelerations = with_damping(cable, gather_listed(state.nodes.acceleration, plain, first, like), rates)
        inert = inertia(cable, length, change.stretch, *accelerations)
        speed = between_ends(cable, state.rope.velocity, middle)
        share = share_of_end(cable, end, middle)
        factors = factors_change(cable.mass_per_length, stretch, speed, change, share)
        flow = flow_forces(length, shape, shape_rates, factors)
        spread(subtract(add_scaled(1.0, inert[0], flow[0]), elastic[0]), group, vector_row(0, like))
        on_a = add_scaled(1.0, elastic[1], add_scaled(1.0, inert[1], flow[1]))
        spread(scale(length, on_a), group, vector_row(1, like))
        spread(add_scaled(1.0, elastic[0], add_scaled(1.0, inert[2], flow[2])), group, vector_row(2, like))
        on_b = add_scaled(1.0, elastic[2], add_scaled(1.0, inert[3], flow[3]))
        spread(scale(length, on_b), group, vector_row(3, like))
        for lane in range(min(WIDTH, count - first)):
            element = plain[first + lane]
            for i in range(4):
                force = load(group[vector_row(i, like) :, lane], like)
                accumulate(force, wheel_columns[element + i // 2, slot, i % 2, :: len(like)])
