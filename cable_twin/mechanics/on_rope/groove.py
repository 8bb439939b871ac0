"""Groove of tower contacts in space: lateral stiffness and friction on the rope until derailment.

With n the normal of a contact, t the direction of the rope and b = t x n, the force sideways is -g N y b with
y = (r - p)·b, so that g y is the ratio of the forces, and nothing is held that does not lie on it. Friction adds
-μ N v / √(v² + v_0²) b, v the speed sideways: Coulomb's law but for a creep below v_0. All of it is nothing in a plane,
where no code is made for it.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import formula, square_root
from cable_twin.mechanics.language.turns import cross
from cable_twin.mechanics.language.vectors import Vector, add_scaled, dot, outer, scale
from cable_twin.mechanics.parameters import IN_GROOVE
from cable_twin.mechanics.rope.point import add_block

CREEP = 0.01  # v_0, m/s, at which friction sideways is 0.7 of what it comes to


@kernel
def depth_in_groove(towers: Any, state: Any, contact: int, depth: float, like: Vector) -> float:
    """Contact depth (m) of the rope on its tower; -inf once derailed."""
    if len(like) == 2 or state.derailment[towers.contact_tower[contact], 0] == IN_GROOVE:
        return depth
    return -inf


@kernel
def with_groove(
    force: Vector, stiffness: float, friction: float, r_x: Vector, normal: Vector, apart: Vector, moving: Vector
) -> Vector:
    """Force (dim,) in N of a contact with the lateral force of its groove; without groove in a plane.

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
    """Unit vector (3,) across the rope and the normal of a contact."""
    across = cross(r_x, normal)
    return scale(1.0 / square_root(dot(across, across)), across)


@inlined_kernel
def to_that_side(across, side):
    """Vector `across` (3,), reversed if it points away from `side` (3,)."""
    return scale(-1.0 if dot(across, side) < 0.0 else 1.0, across)


@inlined_kernel
def add_groove(
    stiffness: float, damping: float, r_x: Vector, normal: Vector, moving: Vector, point: Any, work: Any
) -> None:
    """Add the lateral tangent of a groove to the element in contact; no-op in a plane.

    `damping` (N s/m times the integrator's 1/s) is μ N ∂velocity/∂coordinate; rest as in `with_groove`.
    """
    if len(r_x) == 2:
        return
    across = sideways(r_x, normal)
    speed = dot(moving, across)
    squared = speed * speed + CREEP * CREEP
    stiffness += damping * CREEP * CREEP / (squared * sqrt(squared))
    for i in range(4):
        for j in range(4):
            matrix = outer(stiffness * point.shape[i] * point.shape[j], across, across)
            add_block(matrix, point.element, i, j, work)
