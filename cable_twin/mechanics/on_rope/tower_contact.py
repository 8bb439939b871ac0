"""Contact of the rope with a sheave, or with a point of a saddle: its place on the rope, force and tangent.

Geometry, force and tangent are for one contact, or for `WIDTH` of them in SIMD lanes; what has conditions on values,
the laws of the normal force and of friction along the rope, is for one. `tower` has the equations.
"""

from __future__ import annotations

from math import inf
from typing import Any

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import cross
from cable_twin.mechanics.language.simd import larger, magnitude, smaller
from cable_twin.mechanics.language.traced import formula, square_root
from cable_twin.mechanics.language.vectors import Matrix, Vector, add_scaled, dot, outer, scale, subtract
from cable_twin.mechanics.on_rope.buffer import buffer_force
from cable_twin.mechanics.on_rope.friction import mobilise
from cable_twin.mechanics.parameters import IN_GROOVE
from cable_twin.mechanics.rope.ale import nodal_vectors, rope_before
from cable_twin.mechanics.rope.point import element_at, weighted
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x, shape_functions_xx

MAX_MOVES = 30  # Newton iterations for the nearest point
NEAR = 1e-4  # of an element's length: a last move below leaves its square times the share of depth to bend
CREEP = 0.01  # v_0, m/s, at which friction sideways is 0.7 of what it comes to


@formula
def shapes_at(x, length):
    """Shape functions (eq. 2), and their first and second derivatives, of an element of `length` (m) at x (m)."""
    return shape_functions(x, length), shape_functions_x(x, length), shape_functions_xx(x, length)


@kernel
def nearest(cable, state, place, arc_length):
    """Arc length (m) of the point of the rope nearest to `place` (dim,) in m, by Newton's method from `arc_length`.

    Where the rope bends so sharply around the place that the distance is no minimum, which no rope at rest does, the
    slope is kept positive.
    """
    s = arc_length
    for _ in range(MAX_MOVES):
        element = element_at(cable, state, s)
        length = state.mesh.length[element]
        e = nodal_vectors(state.nodes.position, element, place)
        shapes = shapes_at(s - state.mesh.arc_length[element], length)
        _, _, s, move = approach(cable, e, shapes, place, length, s)
        if move <= NEAR:
            break
    return s


@inlined_kernel
def approach(cable, e, shapes, place, length, arc_length):
    """Make one move of Newton's method towards the point of the rope nearest to a place.

    Args:
        cable: of the rope.
        e: nodal vectors of an element.
        shapes: `shapes_at` the point to move from.
        place: (dim,) m.
        length: of the element, m.
        arc_length: of the point, m.

    Returns:
        r - p (dim,) in m and r_x (dim,) before it; the arc length (m) after it; size of the move, in lengths of the
        element.
    """
    r_x, r_xx = weighted(e, shapes[1]), weighted(e, shapes[2])
    apart = subtract(weighted(e, shapes[0]), place)
    squared = dot(r_x, r_x)
    move = -dot(apart, r_x) / larger(squared + dot(apart, r_xx), 0.25 * squared)
    move = smaller(larger(move, -length), length)
    after = smaller(larger(arc_length + move, 0.0), cable.unstrained_length)
    return apart, r_x, after, magnitude(after - arc_length) / length


@inlined_kernel
def shape_at_contact(e, shapes, place, side):
    """Tangent r_x (dim,), offset r - p (dim,) in m, and unit normal (dim,) of a rope at its contact with a tower.

    Args:
        e: nodal vectors of its element.
        shapes: `shapes_at` the contact.
        place: p (dim,) in m.
        side: on which the rope is, (dim,) unit vector.
    """
    r_x = weighted(e, shapes[1])
    apart = subtract(weighted(e, shapes[0]), place)
    return r_x, apart, normal_to(r_x, side)


@inlined_kernel
def normal_to(r_x, side):
    """Unit normal (dim,) of a rope of slope r_x (dim,) towards a `side` (dim,)."""
    across = add_scaled(-dot(side, r_x) / dot(r_x, r_x), r_x, side)
    return scale(1.0 / larger(square_root(dot(across, across)), 1e-12), across)


@inlined_kernel
def normal_force(towers, contact, depth, depth_rate):
    """Normal force (N) of a tower contact and its derivatives by depth (N/m) and by its rate (N s/m)."""
    stiffness, toe, damping = towers.stiffness[contact], towers.toe[contact], towers.damping[contact]
    return buffer_force(stiffness, toe, damping, depth, depth_rate)


@inlined_kernel
def slid(cable, state, arc_length, origin):
    """Sliding displacement (m) of the rope over a tower contact in this step, positive towards the start of the rope.

    It is measured in unstrained rope before the contact, so that rope which runs through the mesh counts as well: now,
    by the `arc_length` (m) of the contact, and at the start of the step, its `origin` (m).
    """
    return rope_before(cable, state, arc_length) - origin


@inlined_kernel
def mobilised(cable, towers, state, contact):
    """Mobilised share z (-1..1) of the friction along the rope at a tower contact."""
    way = slid(cable, state, state.contact_arc_length[contact], state.contact_origin[contact])
    return mobilise(way, state.contact_deflection[contact], towers.presliding[contact])[0]


@inlined_kernel
def force_and_tangent(law, limits, at, rates, rate_factor, stiffness_factor):
    """Force of a tower contact on the rope and its tangent, as `point_load` takes them.

    The normal turns with the rope as n_x = -t (n·t_x), which is exact in a plane. In space the lateral force of a
    groove grows with N as well; that it turns with the rope is left out.

    Args:
        law: normal force (N), its derivatives by depth (N/m) and by its rate (N s/m); mobilised share of friction (-)
            and its derivative by way (1/m).
        limits: per normal force, of the friction along the rope (-), of the groove (1/m), of friction in it (-).
        at: r_x, r - p, n as of `shape_at_contact`, and r_xx (dim,) in 1/m.
        rates: velocity (dim,) of the rope in m/s, and its derivative along the rope (dim,) in 1/s.
        rate_factor: as in `assemble`.
        stiffness_factor: likewise.

    Returns:
        Force (dim,) in N; derivatives (dim²) of the force by r and by r_x; those of the generalized force on r_x;
        growth of friction with sliding over |r_x| (N/m).
    """
    (n, n_by_depth, n_by_rate, z, z_by_way), (coefficient, groove, rub) = law, limits
    (r_x, apart, normal, r_xx), (moving, turning) = at, rates
    norm = square_root(dot(r_x, r_x))
    t = scale(1.0 / norm, r_x)
    friction = coefficient * n * z
    force = add_scaled(friction, t, scale(n, normal))
    whole = with_groove(force, groove * n, rub * n, r_x, normal, apart, moving)
    pivot = norm * norm + dot(apart, r_xx)
    bent = dot(normal, r_xx)
    # ΔN = by_depth n·Δr + by_turn n·(Δr_x + r_xx Δs) + by_way Δs
    by_depth = -(n_by_depth + rate_factor * n_by_rate)
    by_turn = n_by_rate * dot(moving, t) / norm
    by_way = by_turn * bent - n_by_rate * dot(normal, turning)
    pushed = with_groove(add_scaled(coefficient * z, t, normal), groove, rub, r_x, normal, apart, moving)  # ∂force/∂N
    turned = scale(1.0 / norm, add_scaled(friction, normal, scale(-n, t)))  # ∂force/∂(n·r_x)
    slide = coefficient * n * z_by_way
    on_way = add_scaled(by_way, pushed, add_scaled(bent, turned, scale(slide, t)))  # ∂force/∂s
    # Δs = -(r_x·Δr + (r - p)·Δr_x) / pivot
    by_r = add_scaled(1.0, outer(by_depth, pushed, normal), outer(-1.0 / pivot, on_way, r_x))
    by_r_x = outer(1.0, add_scaled(by_turn, pushed, turned), normal)
    by_r_x = add_scaled(1.0, by_r_x, outer(-1.0 / pivot, on_way, apart))
    held = groove_tangent(stiffness_factor * (groove * n), rate_factor * (rub * n), r_x, normal, moving)
    by_place = add_scaled(-stiffness_factor, by_r, held), scale(-stiffness_factor, by_r_x)
    share = stiffness_factor / pivot
    return whole, by_place, (outer(share, force, r_x), outer(share, force, apart)), slide / norm


@inlined_kernel
def with_groove(
    force: Vector, stiffness: float, friction: float, r_x: Vector, normal: Vector, apart: Vector, moving: Vector
) -> Vector:
    """Force (dim,) in N of a tower contact, in space with the lateral force of its groove added.

    Args:
        force: of the contact without it, N.
        stiffness: g N, N/m.
        friction: μ N, N.
        r_x: along the rope (dim,).
        normal: of the contact (dim,).
        apart: r - p (dim,) in m.
        moving: velocity of the rope (dim,) in m/s.
    """
    if len(force) == 2:
        return force
    across = sideways(r_x, normal)
    return add_scaled(side_force(stiffness, friction, dot(apart, across), dot(moving, across)), across, force)


@formula
def side_force(stiffness, friction, aside, speed):
    """Lateral force (N) of a groove on a rope offset by `aside` (m) and moving sideways at `speed` (m/s)."""
    return -stiffness * aside - friction * speed / square_root(speed * speed + CREEP * CREEP)


@formula
def sideways(r_x, normal):
    """Lateral unit vector (3,) of a tower contact, across the rope and the normal."""
    across = cross(r_x, normal)
    return scale(1.0 / square_root(dot(across, across)), across)


@inlined_kernel
def groove_tangent(stiffness: float, damping: float, r_x: Vector, normal: Vector, moving: Vector) -> Matrix:
    """Tangent (dim²) of the lateral force of a groove by the position of the rope; zeros in a plane.

    `damping` (N s/m times the integrator's 1/s) is μ N ∂velocity/∂coordinate; rest as in `with_groove`.
    """
    if len(r_x) == 2:
        return outer(0.0, r_x, r_x)
    across = sideways(r_x, normal)
    speed = dot(moving, across)
    squared = speed * speed + CREEP * CREEP
    return outer(stiffness + damping * CREEP * CREEP / (squared * square_root(squared)), across, across)


@kernel
def depth_in_groove(towers: Any, state: Any, contact: int, depth: float, like: Vector) -> float:
    """Depth (m) of the rope in a tower contact; -inf once the rope has derailed from the tower."""
    if len(like) == 2 or state.derailment[towers.contact_tower[contact], 0] == IN_GROOVE:
        return depth
    return -inf
