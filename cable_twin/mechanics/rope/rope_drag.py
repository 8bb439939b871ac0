"""Air drag on the rope, quadratic in the transverse relative wind; no drag along the rope.

A rope of the velocity ṙ and tangent t has the force q |w_n| w_n per unstrained length, w_n = P (w - ṙ), P = 1 - t tᵀ,
with the wind w of its element and q = density drag_coefficient diameter / 2.
"""

from __future__ import annotations

from numpy.polynomial.legendre import leggauss

from cable_twin.mechanics.language.compilation import as_python, inlined_kernel
from cable_twin.mechanics.language.simd import add_spread
from cable_twin.mechanics.language.traced import square_root
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    block,
    dot,
    full,
    outer,
    scale,
    subtract,
    symmetric,
)
from cable_twin.mechanics.rope.shape_functions import block_row, combine, shape_functions, shape_functions_x, vector_row

POINTS = 2  # Gauss points of an element: exact for an even drag
PLACES = tuple(float(x + 1.0) / 2.0 for x in leggauss(POINTS)[0])
WEIGHTS = tuple(float(weight) / 2.0 for weight in leggauss(POINTS)[1])
SHAPES = tuple(as_python(shape_functions)(place, 1.0) for place in PLACES)  # on an element of unit length
SLOPES = tuple(as_python(shape_functions_x)(place, 1.0) for place in PLACES)
SLOPES_OF_CHORD = tuple(slopes[1:] for slopes in ((s[2], s[2], s[1], s[3]) for s in SLOPES))
CALM = 1e-200  # m²/s², below which the square of a relative wind is none


@inlined_kernel
def add_drag(rope_drag, wind, length, shape, rates, rate_factor, stiffness_factor, group):
    """Add the air drag on a group of elements to residual and tangent, exact by positions, slopes and rates.

    Args:
        rope_drag: q in kg/m².
        wind: of the elements (dim,), m/s.
        length: of the elements, m.
        shape: d, A, B (dim,) in m.
        rates: of the four nodal coordinates (dim,), m/s and 1/s.
        rate_factor: as in `assemble`.
        stiffness_factor: as in `assemble`.
        group: is added to.
    """
    per_length = 1.0 / length
    for number in range(POINTS):
        s, s_x = SHAPES[number], SLOPES[number]
        weights = s[0] + 0.0 * length, length * s[1], s[2] + 0.0 * length, length * s[3]
        slopes = s_x[0] * per_length, s_x[1] + 0.0 * length, s_x[2] * per_length, s_x[3] + 0.0 * length
        norm, t, along, across = wind_across(number, length, shape, rates, wind)
        squared = dot(across, across)
        speed = square_root(squared)
        q = rope_drag * WEIGHTS[number] * length * speed
        # minus the derivatives of the force: q |w_n| (P + n nᵀ) by the velocity, and by the slope what turns t
        both = add_scaled(1.0, symmetric(0.0, 1.0 / (squared + CALM), across), symmetric(1.0, -1.0, t))
        by_velocity = full(q, both, 0.0)
        turn = stiffness_factor / norm
        by_turning = outer(q * turn, t, across)
        force = scale(q, across)
        for i in range(4):
            add_spread(scale(weights[i], force), group, vector_row(i, wind))
        for j in range(4):
            by_velocity_and_turn = rate_factor * weights[j] + along * turn * slopes[j]
            column = subtract(block(by_velocity_and_turn, by_velocity, 0.0), block(-slopes[j], by_turning, 0.0))
            for i in range(4):
                add_spread(block(weights[i], column, 0.0), group, block_row(i, j, wind))


@inlined_kernel
def wind_across(number, length, shape, rates, wind):
    """Relative wind at a Gauss point of a rope element, split along and across the rope.

    Returns:
        |r_x|; the tangent t (dim,); the part of the relative wind along it in m/s; the part across (dim,) in m/s.
    """
    s = SHAPES[number]
    rho = combine(SLOPES_OF_CHORD[number], *shape)
    norm = square_root(dot(rho, rho))
    t = scale(1.0 / norm, rho)
    moving = add_scaled(s[0], rates[0], add_scaled(length * s[1], rates[1], scale(length * s[3], rates[3])))
    relative = subtract(wind, add_scaled(s[2], rates[2], moving))
    along = dot(relative, t)
    return norm / length, t, along, add_scaled(-along, t, relative)


@inlined_kernel
def drag_on(rope_drag, wind, length, shape, rates, row):
    """Nodal air drag (dim,) in N on rope elements, at r_A (row 0) or r_B (row 2), consistent with `add_drag`."""
    total = scale(0.0, wind)
    for number in range(POINTS):
        _, _, _, across = wind_across(number, length, shape, rates, wind)
        force = rope_drag * WEIGHTS[number] * length * square_root(dot(across, across))
        total = add_scaled(SHAPES[number][row] * force, across, total)
    return total
