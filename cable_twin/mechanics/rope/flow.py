"""A rope that goes by along itself on a mesh that stands still: what that adds to its equations of motion.

The description is arbitrary Lagrangian-Eulerian: the arc length of the mesh stays between the held ends, and the rope
goes by at v (m/s of unstrained length, the same everywhere). A point of the rope has the velocity r_t + v r_x and the
acceleration r_tt + 2 v r_tx + v² r_xx + v_t r_x.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.lanes import WIDTH, gather, gather_numbers, sum_of_lanes
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, subtract
from cable_twin.mechanics.rope.elastic_models import chord_and_slopes, combine
from cable_twin.mechanics.rope.point import add_to
from cable_twin.mechanics.rope.shape_functions import FLOW, FLOW_OF_CHORD, SLOPE, SLOPE_OF_CHORD


@kernel
def add_flow(cable, state, rate_factor, stiffness_factor, work):
    """Add to residual and tangent of the nodes what the motion of the cable along itself makes.

    2 v ∫ρA SᵀS_x dx of ė, and v_t ∫ρA SᵀS_x dx - v² ∫ρA S_xᵀS_x dx of e: the last one is SᵀS_xx integrated by parts.
    Its boundary term acts on the ends only, which are held; left out, a support's force has the momentum in it that
    its sheave takes over, and is smaller than the tension by ρA v² |r_x|.
    """
    speed, rate = state.rope.velocity[0], state.rope.acceleration[0]
    if speed == 0.0 and rate == 0.0:
        return
    mass = cable.mass_per_length
    by_velocity, by_place, by_slope = 2.0 * mass * speed, mass * rate, -mass * speed * speed
    on_flow, on_slope = rate_factor * by_velocity + stiffness_factor * by_place, stiffness_factor * by_slope
    for element in range(cable.element_count):
        length = cable.element_length[element]
        forces = flow_forces(cable, state, element, by_velocity, by_place, by_slope)
        for i in range(4):
            add_to(scale(-length if i % 2 else -1.0, forces[i]), work.right_side, element, i)
    for i in range(4):
        for j in range(4):
            add_flow_block(cable, on_flow * FLOW[i][j], on_slope * SLOPE[i][j], i, j, work)


@inlined_kernel
def add_flow_block(cable, on_flow, on_slope, i, j, work):
    """Add one entry of the tangents of all elements: that by the place per length, that by the rate not."""
    if i // 2 == j // 2:
        blocks = work.diagonal[i // 2 : cable.element_count + i // 2]
    elif i < j:
        blocks = work.upper
    else:
        blocks = work.lower
    dim, slopes = work.right_side.shape[2], i % 2 + j % 2
    for element in range(cable.element_count):
        length = cable.element_length[element]
        if slopes == 0:
            stiff = on_flow + on_slope / length
        else:
            stiff = on_flow * length + on_slope
            if slopes == 2:
                stiff *= length
        for axis in range(dim):
            blocks[element, i % 2, j % 2, axis * (dim + 1)] += stiff


@inlined_kernel
def flow_forces(cable, state, element, by_velocity, by_place, by_slope):
    """What the flow takes (dim,) in N at r_A, slope A, r_B, slope B of an element, those of slopes per length.

    Takes the factors of FLOW of the rates (kg/s), of FLOW of the places (N/m) and of SLOPE (N).
    """
    d, a, b = chord_and_slopes(state.nodes.position, element, cable)
    d_dot, a_dot, b_dot = chord_and_slopes(state.nodes.velocity, element, cable)
    by_slope = by_slope / cable.element_length[element]
    d_flow = add_scaled(by_velocity, d_dot, scale(by_place, d))
    a_flow = add_scaled(by_velocity, a_dot, scale(by_place, a))
    b_flow = add_scaled(by_velocity, b_dot, scale(by_place, b))
    return (
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[0], d, a, b), combine(FLOW_OF_CHORD[0], d_flow, a_flow, b_flow)),
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[1], d, a, b), combine(FLOW_OF_CHORD[1], d_flow, a_flow, b_flow)),
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[2], d, a, b), combine(FLOW_OF_CHORD[2], d_flow, a_flow, b_flow)),
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[3], d, a, b), combine(FLOW_OF_CHORD[3], d_flow, a_flow, b_flow)),
    )


@kernel
def end_flow(cable, state, end):
    """What the flow takes (dim,) in N at the node at `end`, as `add_flow` has it."""
    element, row = (0, 0) if end == 0 else (cable.element_count - 1, 2)
    speed, mass = state.rope.velocity[0], cable.mass_per_length
    by_velocity, by_place = 2.0 * mass * speed, mass * state.rope.acceleration[0]
    return flow_forces(cable, state, element, by_velocity, by_place, -mass * speed * speed)[row]


@kernel
def flow_energy(cable, state):
    """Kinetic energy (J) that the motion of the cable along itself adds to ½ ∫ρA r_t² dx."""
    along, squared, _, _ = flow_integrals(cable, state)
    speed = state.rope.velocity[0]
    return speed * along + 0.5 * speed * speed * squared


@kernel
def flow_integrals(cable, state):
    """∫ρA r_x·r_t dx (kg m/s), ∫ρA r_x·r_x dx (kg), ∫ρA r_x·r_tt dx (N) and ∫ρA r_x·r_tx dx (kg/s).

    Elements are computed `WIDTH` at a time, and those that are left over one by one.
    """
    e, e_dot, e_ddot = state.nodes.position, state.nodes.velocity, state.nodes.acceleration
    like = cable.gravity
    grouped = cable.element_count - cable.element_count % WIDTH
    lanes = 0.0 * gather(e, 0, like)[0][0]
    sums = lanes, lanes, lanes, lanes
    for first in range(0, grouped, WIDTH):
        length = gather_numbers(cable.element_length, first)
        products = flow_products(
            length, gather(e, first, like), gather(e_dot, first, like), gather(e_ddot, first, like)
        )
        sums = (sums[0] + products[0], sums[1] + products[1], sums[2] + products[2], sums[3] + products[3])
    by_velocity, squared = sum_of_lanes(sums[0]), sum_of_lanes(sums[1])
    by_acceleration, by_rate = sum_of_lanes(sums[2]), sum_of_lanes(sums[3])
    for element in range(grouped, cable.element_count):
        place, rate = nodal_vectors(e, element, like), nodal_vectors(e_dot, element, like)
        length = cable.element_length[element]
        products = flow_products(length, place, rate, nodal_vectors(e_ddot, element, like))
        by_velocity, squared = by_velocity + products[0], squared + products[1]
        by_acceleration, by_rate = by_acceleration + products[2], by_rate + products[3]
    mass = cable.mass_per_length
    return mass * by_velocity, mass * squared, mass * by_acceleration, mass * by_rate


@inlined_kernel
def nodal_vectors(coordinates, element, like):
    """r_A, slope A, r_B, slope B (dim,) of an element, or their rates."""
    return (
        load(coordinates[element, 0], like),
        load(coordinates[element, 1], like),
        load(coordinates[element + 1, 0], like),
        load(coordinates[element + 1, 1], like),
    )


@inlined_kernel
def flow_products(length, place, rate, acceleration):
    """The integrals of `flow_integrals` over elements, without ρA, from their nodal vectors and the rates of those."""
    d, a, b = subtract(place[2], place[0]), scale(length, place[1]), scale(length, place[3])
    by_velocity, squared, by_acceleration, by_rate = 0.0 * d[0], 0.0 * d[0], 0.0 * d[0], 0.0 * d[0]
    for i in range(4):
        factor = length if i % 2 else 1.0
        flow, slope = combine(FLOW_OF_CHORD[i], d, a, b), combine(SLOPE_OF_CHORD[i], d, a, b)
        by_velocity += factor * dot(rate[i], flow)
        by_acceleration += factor * dot(acceleration[i], flow)
        squared += factor / length * dot(place[i], slope)
        by_rate += factor / length * dot(rate[i], slope)
    return by_velocity, squared, by_acceleration, by_rate
