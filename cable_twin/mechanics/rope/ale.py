"""Axially moving rope on a fixed mesh: arbitrary Lagrangian-Eulerian (ALE) kinematics and forces.

Rope runs onto the mesh at its start with V_0 and off it at its end with V_1 (m/s of unstrained length), and is spread
evenly over it: an arc length s of the mesh holds λ s of rope, where λ = 1 + (surplus + P_0 - P_1) / L, with P_0 and P_1
the rope transported over either end. At s the rope has the transport velocity u = V_0 + (V_1 - V_0) s / L, on the mesh
w = u / λ: a point of it has the velocity r_t + w r_s, the acceleration r_tt + 2 w r_ts + w² r_ss + (w_t + w w_s) r_s,
and the mass ρA λ per arc length of the mesh. Of a rope that ends in its supports λ is 1 and u is 0; of one that moves
as a whole, λ is 1 and u even.

The rate of a strain |r_s| / λ - 1 is that of |r_s| less λ_t / λ of it, which damping follows.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import add_spread
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import add_scaled, load, scale
from cable_twin.mechanics.rope.shape_functions import (
    FLOW,
    FLOW_OF_CHORD,
    SLOPE,
    SLOPE_OF_CHORD,
    block_row,
    combine,
    vector_row,
)


@inlined_kernel
def rest_stretch(cable, state):
    """Rest stretch λ (-): unstrained length of the rope on the mesh over the length of the mesh."""
    gone = state.rope.position
    return 1.0 + (state.surplus[0] + gone[0] - gone[1]) / cable.unstrained_length


@inlined_kernel
def rest_length(cable, state, element):
    """Unstrained length (m) of the rope on an element."""
    return rest_stretch(cable, state) * state.mesh.length[element]


@inlined_kernel
def mesh_dilution_rate(cable, state):
    """Mesh dilution rate λ_t / λ (1/s): relative growth rate of the rope between any two points of the mesh."""
    speed = state.rope.velocity
    return (speed[0] - speed[1]) / (cable.unstrained_length * rest_stretch(cable, state))


@inlined_kernel
def between_ends(cable, values, arc_length):
    """Linear interpolation at an arc length (m) between `values[0]` at the start and `values[1]` at the end."""
    return values[0] + (values[1] - values[0]) * (arc_length / cable.unstrained_length)


@kernel
def transport_velocity(cable, state, arc_length):
    """Transport velocity w (m/s) along the mesh of a point clamped to the rope at an arc length (m), and its rate."""
    stretch, speed = rest_stretch(cable, state), state.rope.velocity
    rate = (speed[0] - speed[1]) / cable.unstrained_length
    on_mesh = between_ends(cable, speed, arc_length) / stretch
    return on_mesh, (between_ends(cable, state.rope.acceleration, arc_length) - 2.0 * on_mesh * rate) / stretch


@inlined_kernel
def flow_on_mesh(cable, state, arc_length):
    """Transport velocity w (m/s) on the mesh at an arc length (m), and its derivatives w_s (1/s) and w_t (m/s²)."""
    stretch, speed = rest_stretch(cable, state), state.rope.velocity
    along = (speed[1] - speed[0]) / (cable.unstrained_length * stretch)
    on_mesh = between_ends(cable, speed, arc_length) / stretch
    return on_mesh, along, between_ends(cable, state.rope.acceleration, arc_length) / stretch + on_mesh * along


@kernel
def rope_before(cable, state, arc_length):
    """Unstrained length (m) of rope before an arc length (m), counted from the initial start of the mesh."""
    return rest_stretch(cable, state) * arc_length - state.rope.position[0]


@inlined_kernel
def flows(system, state):
    """Return whether a rope moves axially through its mesh, by speed or acceleration."""
    if not system.moving_cable.moving:
        return False
    speed, rate = state.rope.velocity, state.rope.acceleration
    return speed[0] != 0.0 or speed[1] != 0.0 or rate[0] != 0.0 or rate[1] != 0.0


@inlined_kernel
def flow_factors(cable, state, middle):
    """Coefficients of an element's transport forces by rates (kg/s), positions (N/m) and slopes (N), at `middle` (m).

    2 ρA u ∫SᵀS_s ds of ė, and ρA u_t ∫SᵀS_s ds - ρA u² / λ ∫S_sᵀS_s ds of e. The last one is SᵀS_ss integrated by
    parts; the terms with w w_s, w_t and λ_t cancel but for u_t. The boundary term of that integration acts on the held
    ends only and is left out: so the force of a support contains the momentum that its sheave takes over, and is
    smaller than the tension by ρA u² |r_s| / λ. FLOW is by rates (kg/s) and by positions (N/m).
    """
    speed, mass = between_ends(cable, state.rope.velocity, middle), cable.mass_per_length
    rate = between_ends(cable, state.rope.acceleration, middle)
    return 2.0 * mass * speed, mass * rate, -mass * speed * speed / rest_stretch(cable, state)


@inlined_kernel
def add_flow(length, shape, shape_rates, factors, rate_factor, stiffness_factor, group):
    """Add the transport terms of axial rope motion to residual and tangent of a group of elements.

    Args:
        length: of the elements, m.
        shape: d, A, B (dim,) in m.
        shape_rates: their rates in m/s.
        factors: `flow_factors`.
        rate_factor: as in `assemble`.
        stiffness_factor: as in `assemble`.
        group: is added to.
    """
    like = shape[0]
    by_velocity, by_place, by_slope = factors
    forces = flow_forces(length, shape, shape_rates, factors)
    on_flow, on_slope = rate_factor * by_velocity + stiffness_factor * by_place, stiffness_factor * by_slope
    # of positions, of a position and a slope, of slopes
    flow = on_flow + 0.0 * length, on_flow * length, on_flow * length * length
    stretch = on_slope / length, on_slope + 0.0 * length, on_slope * length
    for i in range(4):
        add_spread(scale(-length if i % 2 else -1.0, forces[i]), group, vector_row(i, like))
        for j in range(4):
            slopes = i % 2 + j % 2
            stiff = FLOW[i][j] * flow[slopes] + SLOPE[i][j] * stretch[slopes]
            for axis in range(len(like)):
                add_spread((stiff,), group, block_row(i, j, like) + axis * (len(like) + 1))


@formula
def flow_forces(length, shape, shape_rates, factors):
    """Transport forces (dim,) in N on r_A, slope A, r_B, slope B of a moving rope element; on slopes per its length."""
    d, a, b = shape
    by_velocity, by_place, by_slope = factors[0], factors[1], factors[2] / length
    d_flow = add_scaled(by_velocity, shape_rates[0], scale(by_place, d))
    a_flow = add_scaled(by_velocity, shape_rates[1], scale(by_place, a))
    b_flow = add_scaled(by_velocity, shape_rates[2], scale(by_place, b))
    return (
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[0], d, a, b), combine(FLOW_OF_CHORD[0], d_flow, a_flow, b_flow)),
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[1], d, a, b), combine(FLOW_OF_CHORD[1], d_flow, a_flow, b_flow)),
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[2], d, a, b), combine(FLOW_OF_CHORD[2], d_flow, a_flow, b_flow)),
        add_scaled(by_slope, combine(SLOPE_OF_CHORD[3], d, a, b), combine(FLOW_OF_CHORD[3], d_flow, a_flow, b_flow)),
    )


@formula
def nodal_vectors(coordinates, element, like):
    """Positions and slopes (dim,) at both nodes of an element, or their rates: r_A, slope A, r_B, slope B."""
    return (
        load(coordinates[element, 0], like),
        load(coordinates[element, 2], like),
        load(coordinates[element + 1, 0], like),
        load(coordinates[element + 1, 1], like),
    )
