"""Aerodynamic force on bodies: quadratic drag at the centre of mass, and vortex-shedding side force; no moment.

w_b = w - ċ with the wind w there. A body that is alike all round has the force q |w_b| w_b, q = density drag_area / 2,
one with a drag area for each of its axes A diag(q) Aᵀ |w_b| w_b. The eddies are those of `wind`; the drag of the rope
is `rope.rope_drag`.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.orientations import orientation
from cable_twin.mechanics.language.turns import by_turn
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    apply,
    block,
    dot,
    flipped,
    full,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    symmetric,
)


@kernel
def drag_bodies(air, state, like, rate_factor, stiffness_factor, work):
    """Aerodynamic force on every body (N), and its negative derivatives by position and rotation."""
    dim = len(like)
    for body in range(air.body_drag.shape[0]):
        q, even = air.body_drag[body, 0], True
        for axis in range(1, dim):
            even = even and air.body_drag[body, axis * (dim + 1)] == q
        relative = subtract(load(state.wind_field.at_bodies[body], like), load(state.bodies.velocity[body], like))
        speed = sqrt(dot(relative, relative))
        if not even:
            drag_by_axes(air, state, body, relative, (speed, rate_factor, stiffness_factor), work)
        elif q > 0.0:
            store(scale(q * speed, relative), work.body_drag[body])
            steep = rate_factor * q / speed if speed > 0.0 else 0.0
            store(full(1.0, symmetric(steep * speed * speed, steep, relative), 0.0), work.body_drag_tangent[body])
        if air.wind.shedding.shape[0] > 0:
            if even and q == 0.0:
                store(scale(0.0, like), work.body_drag[body])
            accumulate(load(state.wind_field.shedding_force[body], like), work.body_drag[body])


@inlined_kernel
def drag_by_axes(air, state, body, relative, factors, work):
    """Drag on a body with different areas along its axes: K |w| w, K = A diag(q) Aᵀ rotating with the body."""
    speed, rate_factor, stiffness_factor = factors
    axes = orientation(state.bodies.position[body], relative)
    k = product(product(axes, load(air.body_drag[body], axes), relative), flipped(axes, relative), relative)
    drag = apply(k, relative)
    store(scale(speed, drag), work.body_drag[body])
    steep = rate_factor / speed if speed > 0.0 else 0.0
    by_place = add_scaled(1.0, outer(steep, drag, relative), block(rate_factor * speed, k, 0.0))
    store(by_place, work.body_drag_tangent[body])
    by_angle = subtract(product(k, by_turn(relative), relative), by_turn(drag))
    store(scale(stiffness_factor * speed, by_angle), work.body_drag_turning[body])
