"""Momentum and kinetic energy of a rope that moves axially through its mesh."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.simd import WIDTH, gather, gather_numbers, sum_of_lanes
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import dot, scale, subtract
from cable_twin.mechanics.rope.ale import between_ends, nodal_vectors, rest_stretch
from cable_twin.mechanics.rope.patch import beside_load, motion_at_rest
from cable_twin.mechanics.rope.shape_functions import FLOW_OF_CHORD, SLOPE_OF_CHORD, combine


@kernel
def flow_energy(cable, state):
    """Kinetic energy (J) of axial rope motion beyond ½ ∫ρA λ r_t² ds: ∫ρA (u r_x·r_t + ½ u² r_x·r_x / λ) dx.

    The transport velocity u is that at the middle of each element, as in `flow_factors`.
    """
    like, stretch, found = cable.gravity, rest_stretch(cable, state), 0.0
    for element in range(cable.element_count):
        length = state.mesh.length[element]
        place = nodal_vectors(state.nodes.position, element, like)
        rate = nodal_vectors(state.nodes.velocity, element, like)
        if beside_load(cable, state, element):
            at_rest = motion_at_rest(cable, state, element, state.nodes.acceleration, state.joints.acceleration)
            place, rate = at_rest[0], at_rest[1]
        squared, by_velocity, _ = flow_products(length, place, rate, rate)
        speed = between_ends(cable, state.rope.velocity, state.mesh.arc_length[element] + 0.5 * length)
        found += speed * by_velocity + 0.5 * speed * speed * squared / stretch
    return cable.mass_per_length * found


@kernel
def flow_integrals(cable, state):
    """Integrals of a rope: ∫ρA r_x·r_x dx (kg), ∫ρA r_x·r_tt dx (N), ∫ρA r_x·r_tx dx (kg/s).

    Elements are computed `WIDTH` at a time, and those that are left over, or beside a load, one by one.
    """
    e, e_dot, e_ddot = state.nodes.position, state.nodes.velocity, state.nodes.acceleration
    like = cable.gravity
    grouped = cable.element_count - cable.element_count % WIDTH
    lanes = 0.0 * gather(e, 0, like)[0][0]
    sums = lanes, lanes, lanes
    for first in range(0, grouped, WIDTH):
        length = gather_numbers(state.mesh.length, first)
        products = flow_products(
            length, gather(e, first, like), gather(e_dot, first, like), gather(e_ddot, first, like)
        )
        if cable.load_nodes:
            plain = gather_numbers(state.mesh.plain, first)
            products = plain * products[0], plain * products[1], plain * products[2]
        sums = sums[0] + products[0], sums[1] + products[1], sums[2] + products[2]
    squared, by_acceleration, by_rate = sum_of_lanes(sums[0]), sum_of_lanes(sums[1]), sum_of_lanes(sums[2])
    for element in range(0 if cable.load_nodes else grouped, cable.element_count):
        if element < grouped and not beside_load(cable, state, element):
            continue
        length = state.mesh.length[element]
        if beside_load(cable, state, element):
            place, rate, acceleration = motion_at_rest(cable, state, element, e_ddot, state.joints.acceleration)
        else:
            place, rate = nodal_vectors(e, element, like), nodal_vectors(e_dot, element, like)
            acceleration = nodal_vectors(e_ddot, element, like)
        products = flow_products(length, place, rate, acceleration)
        squared, by_acceleration = squared + products[0], by_acceleration + products[1]
        by_rate += products[2]
    mass = cable.mass_per_length
    return mass * squared, mass * by_acceleration, mass * by_rate


@formula
def flow_products(length, place, rate, acceleration):
    """Integrals ∫r_x·r_x dx, ∫r_x·r_tt dx, ∫r_x·r_tx dx over an element or a group, from nodal vectors."""
    d, a, b = subtract(place[2], place[0]), scale(length, place[1]), scale(length, place[3])
    squared, by_acceleration, by_rate = 0.0 * d[0], 0.0 * d[0], 0.0 * d[0]
    for i in range(4):
        factor = length if i % 2 else 1.0
        flow, slope = combine(FLOW_OF_CHORD[i], d, a, b), combine(SLOPE_OF_CHORD[i], d, a, b)
        by_acceleration += factor * dot(acceleration[i], flow)
        squared += factor / length * dot(place[i], slope)
        by_rate += factor / length * dot(rate[i], slope)
    return squared, by_acceleration, by_rate
