"""Elastic models of an element: elastic and viscous force, tangent, tension, energy (paper, eq. 7-9).

Inside, an element is its chord d = r_B - r_A and its two slopes times length, A = l r_x(A) and B = l r_x(B): three
vectors in m that describe the shape without its place. With u = x / l, rho = dr/du and chi = d²r/du².
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import formula, square_root
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    dot,
    full,
    load,
    outer,
    scale,
    subtract,
    symmetric,
    symmetric_pair,
)
from cable_twin.mechanics.parameters import ELEMENT_FRAME
from cable_twin.mechanics.rope.ale import rest_length
from cable_twin.mechanics.rope.shape_functions import (
    AXIAL_POINTS,
    AXIAL_SLOPES,
    AXIAL_WEIGHT,
    BENDING_CURVATURES,
    BENDING_POINTS,
    BENDING_SLOPES,
    BENDING_WEIGHT,
    combine,
)


@kernel
def chord_and_slopes(coordinates, element, cable, state):
    """Chord d and end slopes times length A, B (dim,) of an element, from `coordinates` (nodes, 3, dim) or rates."""
    like = cable.gravity
    chord = subtract(load(coordinates[element + 1, 0], like), load(coordinates[element, 0], like))
    slope_a = scale(state.mesh.length[element], load(coordinates[element, 2], like))
    slope_b = scale(state.mesh.length[element], load(coordinates[element + 1, 1], like))
    return chord, slope_a, slope_b


@formula
def add_products(c, matrix, k):
    """Add c cᵀ times a symmetric matrix to the six tangent blocks dd, da, db, aa, ab, bb of chord d and slopes a, b."""
    return (
        add_scaled(c[0] * c[0], matrix, k[0]),
        add_scaled(c[0] * c[1], matrix, k[1]),
        add_scaled(c[0] * c[2], matrix, k[2]),
        add_scaled(c[1] * c[1], matrix, k[3]),
        add_scaled(c[1] * c[2], matrix, k[4]),
        add_scaled(c[2] * c[2], matrix, k[5]),
    )


@inlined_kernel
def continuum(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor):
    """Elastic force and tangent of an element as a continuum, W = ½∫(EA ε² + EI k·k)dx, with Kelvin-Voigt damping.

    ε = |r_x| - 1 - α ΔT, so that the axial force is the tension EA ε of the elastic catenary; k is the derivative
    of the unit tangent along the unstrained cable, the material curvature. The damping follows ε and the part of
    the rate of k that a rotation in the plane of the bend does not make (in space, the spin of a bent cable about its
    own axis would still be damped). The tangent is exact in the axial part; of the bending part it keeps what acts on
    chi (Gauss-Newton), which is all that matters in a cable.

    Args:
        cable: parameters.
        length: of the element, unstrained, m.
        d: chord (dim,) in m.
        a: slope at A times length (dim,) in m.
        b: slope at B times length (dim,) in m.
        d_dot: rate of d (dim,) in m/s.
        a_dot: rate of a (dim,) in m/s.
        b_dot: rate of b (dim,) in m/s.
        rate_factor: ∂velocity/∂coordinate of the integrator, 1/s.
        stiffness_factor: 1, or 0 for no tangent.

    Returns:
        Forces (dim,) N on d, a, b, and the tangents (N/m) dd, da, db, aa, ab, bb: da and db full, the others symmetric
        matrices, for those blocks are.
    """
    zero = scale(0.0, d)
    nothing = symmetric(0.0, 0.0, d)
    force_d, force_a, force_b = zero, zero, zero
    k = (nothing, nothing, nothing, nothing, nothing, nothing)
    damped = cable.damping_time > 0.0
    viscous_stiffening = 1.0 + cable.damping_time * rate_factor
    per_length = 1.0 / length  # a division is as dear as ten products

    for point in range(AXIAL_POINTS):
        slopes = AXIAL_SLOPES[point]
        rho = combine(slopes, d, a, b)
        norm = square_root(dot(rho, rho))
        per_norm = 1.0 / norm
        strain = norm * per_length - cable.free_stretch
        if damped:
            rate = dot(rho, combine(slopes, d_dot, a_dot, b_dot)) * per_norm * per_length
            strain += cable.damping_time * rate
        weight = AXIAL_WEIGHT[point] * cable.axial_stiffness
        stress = weight * strain * per_norm
        s_d, s_a, s_b = slopes[0], slopes[1], slopes[2]
        force_d = add_scaled(s_d * stress, rho, force_d)
        force_a = add_scaled(s_a * stress, rho, force_a)
        force_b = add_scaled(s_b * stress, rho, force_b)
        radial = (weight * viscous_stiffening * per_length - stress) * per_norm * per_norm
        c = symmetric(stiffness_factor * stress, stiffness_factor * radial, rho)
        k = add_products(slopes, c, k)

    for point in range(BENDING_POINTS):
        slopes = BENDING_SLOPES[point]
        curvatures = BENDING_CURVATURES[point]
        rho = combine(slopes, d, a, b)
        chi = combine(curvatures, d, a, b)
        inverse_squared = 1.0 / dot(rho, rho)
        stretch_gradient = dot(rho, chi) * inverse_squared
        bent = add_scaled(-stretch_gradient, rho, chi)  # P χ = k |ρ| l
        weight = BENDING_WEIGHT[point] * cable.bending_stiffness * inverse_squared * per_length
        moment = scale(weight, bent)
        if damped:
            # rate of k |ρ| l seen from the turning tangent: P (χ_dot - (ρ·χ/ρ²) ρ_dot) - P χ (ρ·ρ_dot/ρ²)
            rho_dot = combine(slopes, d_dot, a_dot, b_dot)
            turned = add_scaled(-stretch_gradient, rho_dot, combine(curvatures, d_dot, a_dot, b_dot))
            turned = add_scaled(-dot(rho, turned) * inverse_squared, rho, turned)
            turned = add_scaled(-dot(rho, rho_dot) * inverse_squared, bent, turned)
            moment = add_scaled(weight * cable.damping_time, turned, moment)
        on_rho = add_scaled(-dot(bent, moment) * inverse_squared, rho, scale(-stretch_gradient, moment))
        force_d = add_scaled(slopes[0], on_rho, add_scaled(curvatures[0], moment, force_d))
        force_a = add_scaled(slopes[1], on_rho, add_scaled(curvatures[1], moment, force_a))
        force_b = add_scaled(slopes[2], on_rho, add_scaled(curvatures[2], moment, force_b))
        stiff = stiffness_factor * weight * viscous_stiffening
        c = symmetric(stiff, -stiff * inverse_squared, rho)
        k = add_products(curvatures, c, k)

    k_dd, k_da, k_db, k_aa, k_ab, k_bb = k
    return force_d, force_a, force_b, k_dd, full(1.0, k_da, 0.0), full(1.0, k_db, 0.0), k_aa, k_ab, k_bb


@kernel
def whole_continuum(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor):
    """Elastic force and tangent of an element as in `continuum`, but compiled once for all callers, not inlined."""
    return continuum(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor)


@kernel
def element_frame(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor):
    """Force and tangent of the paper's elastic energy of an element (eq. 7-9), in the frame of its chord.

    With i the unit chord, W = ½∫(EA (r_x·i - 1)² + EI |r_xx - (r_xx·i) i|²)dx: eq. 8 with the strains of eq. 7, whose
    second axis j is any normal of i. Force and tangent are exact, with the turning of i, but for the turning of the
    viscous part. Damping as in `continuum`, of the same strains.

    The slopes at the nodes need not be as long as the chord is stretched, and give way to bending: however fine the
    mesh, its bending energy is that of EI / (1 + 5 EI κ² / EA) (derived in `verification.statics.elastica`). That is
    nothing in a cable, but above κ² = EA / (15 EI) more curvature needs less moment.

    Args and returns are those of `continuum`.
    """
    damping = cable.damping_time
    zero = scale(0.0, d)
    nothing = symmetric(0.0, 0.0, d)
    force_d, force_a, force_b = zero, zero, zero
    k = (nothing, nothing, nothing, nothing, nothing, nothing)
    viscous_stiffening = 1.0 + damping * rate_factor
    chord = square_root(dot(d, d))
    i = scale(1.0 / chord, d)
    i_dot = add_scaled(-dot(i, d_dot) / chord, i, scale(1.0 / chord, d_dot))
    on_i = zero  # ∂W/∂i, N m
    # ∂²W/∂(d, a, b)∂i = i yᵀ + z 1, and ∂²W/∂i² across i, over the square of the chord
    y_d, y_a, y_b = zero, zero, zero
    z_d, z_a, z_b = 0.0, 0.0, 0.0
    k_ii = nothing

    for point in range(AXIAL_POINTS):
        c_d, c_a, c_b = AXIAL_SLOPES[point]
        rho = combine(AXIAL_SLOPES[point], d, a, b)
        strain_rate = (dot(combine(AXIAL_SLOPES[point], d_dot, a_dot, b_dot), i) + dot(rho, i_dot)) / length
        weight = AXIAL_WEIGHT[point] * cable.axial_stiffness
        tension = weight * (dot(rho, i) / length - cable.free_stretch + damping * strain_rate)
        force_d = add_scaled(c_d * tension, i, force_d)
        force_a = add_scaled(c_a * tension, i, force_a)
        force_b = add_scaled(c_b * tension, i, force_b)
        on_i = add_scaled(tension, rho, on_i)
        stiff = weight * viscous_stiffening / length
        along = symmetric(0.0, stiff, i)
        k = add_products(AXIAL_SLOPES[point], along, k)
        y_d = add_scaled(c_d * stiff, rho, y_d)
        y_a = add_scaled(c_a * stiff, rho, y_a)
        y_b = add_scaled(c_b * stiff, rho, y_b)
        z_d, z_a, z_b = z_d + c_d * tension, z_a + c_a * tension, z_b + c_b * tension
        across = add_scaled(-dot(rho, i), i, rho)
        k_ii = add_scaled(1.0, symmetric(0.0, stiff, across), k_ii)

    for point in range(BENDING_POINTS):
        c_d, c_a, c_b = BENDING_CURVATURES[point]
        chi = combine(BENDING_CURVATURES[point], d, a, b)
        chi_dot = combine(BENDING_CURVATURES[point], d_dot, a_dot, b_dot)
        along_i = dot(chi, i)
        bent = add_scaled(-along_i, i, chi)
        # rate seen from the frame: what the turning of i makes of chi along it is taken out
        turned = add_scaled(-along_i, i_dot, chi_dot)
        turned = add_scaled(-dot(turned, i), i, turned)
        weight = BENDING_WEIGHT[point] * cable.bending_stiffness / (length * length * length)
        moment = scale(weight, add_scaled(damping, turned, bent))
        force_d = add_scaled(c_d, moment, force_d)
        force_a = add_scaled(c_a, moment, force_a)
        force_b = add_scaled(c_b, moment, force_b)
        on_i = add_scaled(-along_i, moment, on_i)
        stiff = weight * viscous_stiffening
        normal = symmetric(stiff, -stiff, i)
        k = add_products(BENDING_CURVATURES[point], normal, k)
        y_d = add_scaled(-c_d * weight, chi, y_d)
        y_a = add_scaled(-c_a * weight, chi, y_a)
        y_b = add_scaled(-c_b * weight, chi, y_b)
        z_d, z_a, z_b = z_d - c_d * weight * along_i, z_a - c_a * weight * along_i, z_b - c_b * weight * along_i
        k_ii = add_scaled(-1.0, symmetric(0.0, weight, bent), k_ii)
        by_turning = weight * along_i * along_i
        k_ii = add_scaled(1.0, symmetric(by_turning, -by_turning, i), k_ii)

    k_dd, k_da, k_db, k_aa, k_ab, k_bb = k
    # ∂i/∂d = P / |d| with P = 1 - i iᵀ
    turning = add_scaled(-dot(on_i, i), i, on_i)
    force_d = add_scaled(1.0 / chord, turning, force_d)
    squared = chord * chord
    y_d, y_a, y_b = across_of(i, y_d), across_of(i, y_a), across_of(i, y_b)
    level = 2.0 * z_d / chord - dot(on_i, i) / squared
    k_dd = add_scaled(1.0, symmetric(level, -level, i), k_dd)
    k_dd = add_scaled(1.0, symmetric_pair(1.0 / chord, i, y_d), k_dd)
    k_dd = add_scaled(-1.0, symmetric_pair(1.0 / squared, i, turning), k_dd)
    k_dd = add_scaled(1.0 / squared, k_ii, k_dd)
    f = stiffness_factor
    return (
        force_d,
        force_a,
        force_b,
        add_scaled(f, k_dd, nothing),
        subtract(full(f, k_da, 0.0), turned_block(-f / chord, i, y_a, z_a)),
        subtract(full(f, k_db, 0.0), turned_block(-f / chord, i, y_b, z_b)),
        add_scaled(f, k_aa, nothing),
        add_scaled(f, k_ab, nothing),
        add_scaled(f, k_bb, nothing),
    )


@formula
def across_of(i, vector):
    """Part of a vector normal to the unit vector i."""
    return add_scaled(-dot(vector, i), i, vector)


@formula
def turned_block(c, i, y, z):
    """Tangent block of chord and a slope by rotation of chord direction i: c (y iᵀ + z P), P = I - i iᵀ, y = P y."""
    return subtract(outer(c, y, i), full(-c * z, symmetric(1.0, -1.0, i), 0.0))


@inlined_kernel
def elastic_force(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor):
    """Elastic force and tangent of an element in the cable's elastic model, with arguments of `continuum`."""
    if cable.elastic_model == ELEMENT_FRAME:
        return element_frame(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor)
    return whole_continuum(cable, length, d, a, b, d_dot, a_dot, b_dot, rate_factor, stiffness_factor)


@inlined_kernel
def chord_force(cable, length, d, a, b, d_dot, a_dot, b_dot):
    """Elastic force (dim,) in N on the chord d of an element, in the cable's elastic model."""
    if cable.elastic_model == ELEMENT_FRAME:
        return element_frame(cable, length, d, a, b, d_dot, a_dot, b_dot, 0.0, 0.0)[0]
    return continuum(cable, length, d, a, b, d_dot, a_dot, b_dot, 0.0, 0.0)[0]


@inlined_kernel
def mean_tension(cable, length, d, a, b, d_dot, a_dot, b_dot):
    """Mean tension EA (ε + τ ε_dot) in N of an element, from its chord and slopes (dim,) in m and their rates in m/s.

    Inside an element the axial strain of a cubic oscillates about its mean, which is the accurate value. The strain
    of `element_frame` has the chord's for its mean.
    """
    if cable.elastic_model == ELEMENT_FRAME:
        chord = square_root(dot(d, d))
        stretch = (chord + cable.damping_time * dot(d, d_dot) / chord) / length
        return cable.axial_stiffness * (stretch - cable.free_stretch)
    tension = 0.0 * d[0]
    for point in range(AXIAL_POINTS):
        rho = combine(AXIAL_SLOPES[point], d, a, b)
        norm = square_root(dot(rho, rho))
        strain_rate = dot(rho, combine(AXIAL_SLOPES[point], d_dot, a_dot, b_dot)) / (norm * length)
        strain = norm / length - cable.free_stretch
        tension += AXIAL_WEIGHT[point] * cable.axial_stiffness * (strain + cable.damping_time * strain_rate)
    return tension


@kernel
def tension_of(cable, state, element):
    """Mean tension (N) of an element, without damping."""
    d, a, b = chord_and_slopes(state.nodes.position, element, cable, state)
    still = scale(0.0, d)
    return mean_tension(cable, rest_length(cable, state, element), d, a, b, still, still, still)


@kernel
def elastic_energy(cable, state, element):
    """Strain energy (J) of an element (eq. 8), with the strains of its elastic model."""
    length = rest_length(cable, state, element)
    d, a, b = chord_and_slopes(state.nodes.position, element, cable, state)
    i = scale(1.0 / square_root(dot(d, d)), d)
    energy = 0.0
    for point in range(AXIAL_POINTS):
        rho = combine(AXIAL_SLOPES[point], d, a, b)
        along = dot(rho, i) if cable.elastic_model == ELEMENT_FRAME else square_root(dot(rho, rho))
        strain = along / length - cable.free_stretch
        energy += 0.5 * length * AXIAL_WEIGHT[point] * cable.axial_stiffness * strain * strain
    for point in range(BENDING_POINTS):
        rho = combine(BENDING_SLOPES[point], d, a, b)
        chi = combine(BENDING_CURVATURES[point], d, a, b)
        squared = length * length
        if cable.elastic_model == ELEMENT_FRAME:
            rho = i
        else:
            squared = dot(rho, rho)
        bent = add_scaled(-dot(rho, chi) / dot(rho, rho), rho, chi)
        curvature_squared = dot(bent, bent) / (squared * length * length)
        energy += 0.5 * length * BENDING_WEIGHT[point] * cable.bending_stiffness * curvature_squared
    return energy
