"""Air drag, quadratic in the wind relative to what it blows on: on the rope across itself, on bodies at their centres.

A rope of the velocity ṙ and tangent t has the force q |w_n| w_n per unstrained length, w_n = P (w - ṙ), P = 1 - t tᵀ,
with the uniform wind w and q = density drag_coefficient diameter / 2; so whether it runs along itself does not matter.
A body has q |w_b| w_b with w_b = w - ċ and q = density drag_area / 2, and no moment.
"""

from __future__ import annotations

from math import sqrt

from numpy.polynomial.legendre import leggauss

from cable_twin.mechanics.language.compilation import as_python, inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    block,
    dot,
    full,
    load,
    minus,
    outer,
    scale,
    subtract,
    symmetric,
)
from cable_twin.mechanics.rope.point import Point, add_block, add_force, slope, value
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x

POINTS = 2  # Gauss points of an element: exact for an even drag
PLACES = tuple(float(x + 1.0) / 2.0 for x in leggauss(POINTS)[0])
WEIGHTS = tuple(float(weight) / 2.0 for weight in leggauss(POINTS)[1])
SHAPES = tuple(as_python(shape_functions)(place, 1.0) for place in PLACES)  # on an element of unit length
NOTHING = (0.0, 0.0, 0.0, 0.0)
SLOPES = tuple(as_python(shape_functions_x)(place, 1.0) for place in PLACES)


@kernel
def drag_rope(cable, rope_drag, state, rate_factor, stiffness_factor, work):
    """Add the drag on all elements to residual and tangent of the nodes, exact by places, slopes and their rates."""
    blowing = load(state.wind, cable.gravity)
    for element in range(cable.element_count):
        length = cable.element_length[element]
        per_length = 1.0 / length
        for number in range(POINTS):
            point = gauss_point(element, number, length, per_length)
            shape, shape_x = point.shape, point.shape_x
            norm, t, along, across = blow(state, point, blowing)
            speed = sqrt(dot(across, across))
            if speed == 0.0:
                continue
            q = rope_drag * WEIGHTS[number] * length
            force = scale(q * speed, across)
            # minus the derivatives of the force: q |w_n| (P + n nᵀ) by the velocity, and by the slope what turns t
            both = add_scaled(1.0, symmetric(0.0, 1.0 / (speed * speed), across), symmetric(1.0, -1.0, t))
            by_velocity = full(q * speed, both, 0.0)
            turn = stiffness_factor / norm
            by_turning = outer(q * speed * turn, t, across)
            for j in range(4):
                by_velocity_and_turn = rate_factor * shape[j] + along * turn * shape_x[j]
                column = minus(block(by_velocity_and_turn, by_velocity, 0.0), block(-shape_x[j], by_turning, 0.0))
                for i in range(4):
                    add_block(block(shape[i], column, 0.0), element, i, j, work)
            add_force(force, point, work.right_side)


@inlined_kernel
def gauss_point(element, number, length, per_length):
    """Place of a Gauss point of an element of `length` (m), 1 / length given too; a force there asks for no r_xx."""
    s, s_x = SHAPES[number], SLOPES[number]
    shape = s[0], length * s[1], s[2], length * s[3]
    return Point(element, shape, (s_x[0] * per_length, s_x[1], s_x[2] * per_length, s_x[3]), NOTHING)


@inlined_kernel
def blow(state, point, blowing):
    """What the wind `blowing` (dim,) in m/s is at a place of the rope, relative to it.

    Returns:
        |r_x|; the tangent t (dim,); the part of the relative wind along it in m/s; the part across (dim,) in m/s.
    """
    r_x = slope(state.nodes.position, point, blowing)
    norm = sqrt(dot(r_x, r_x))
    t = scale(1.0 / norm, r_x)
    relative = subtract(blowing, value(state.nodes.velocity, point, blowing))
    along = dot(relative, t)
    return norm, t, along, add_scaled(-along, t, relative)


@kernel
def drag_on_end(cable, rope_drag, state, end):
    """Share (dim,) in N of the drag on the first or last element that the node at that end takes."""
    element, row = (0, 0) if end == 0 else (cable.element_count - 1, 2)
    length = cable.element_length[element]
    per_length = 1.0 / length
    blowing = load(state.wind, cable.gravity)
    total = scale(0.0, blowing)
    for number in range(POINTS):
        point = gauss_point(element, number, length, per_length)
        _, _, _, across = blow(state, point, blowing)
        force = rope_drag * WEIGHTS[number] * length * sqrt(dot(across, across))
        total = add_scaled(point.shape[row] * force, across, total)
    return total


@kernel
def drag_bodies(body_drag, wind, body_velocities, rate_factor, force, tangent):
    """Drag on every body (N), and minus its derivative by the place (N/m), which acts like a mass."""
    for body in range(body_drag.size):
        q = body_drag[body]
        if q > 0.0:
            x = wind[0] - body_velocities[body, 0]
            z = wind[wind.size - 1] - body_velocities[body, 1]
            speed = sqrt(x * x + z * z)
            force[body, 0], force[body, 1] = q * speed * x, q * speed * z
            steep = rate_factor * q / speed if speed > 0.0 else 0.0
            tangent[body, 0] = steep * (speed * speed + x * x)
            tangent[body, 1] = steep * x * z
            tangent[body, 2] = steep * (speed * speed + z * z)
