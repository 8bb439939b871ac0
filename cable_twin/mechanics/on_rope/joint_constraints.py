"""Rotational constraints of joints in space: one equation and one moment per axis, eliminated with the body below.

In a plane nothing is held, and all of this is left out as kernels are compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.turns import cross
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    dot,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    unit_matrix,
)
from cable_twin.mechanics.on_rope.hinge import joint_axes


class Held(NamedTuple):
    """Increment of a constraint moment: derivatives by pivot position and upper rotation, and constant part."""

    by_place: Any
    by_above: Any
    least: Any


@kernel
def measure_held(carriages, state, body, first, direction, gap):
    """Write the rotational constraints Φ = a·c of a joint into `gap` (2,); no-op in a plane."""
    if len(direction.spin) == 1:
        return
    a, c, other, _ = joint_axes(state, body, first, direction.orientation)
    gap[0], gap[1] = dot(a, c), dot(a, other)


@kernel
def accelerate_held(state, body, first, above, turning, feedback, gap):
    """Write Φ_ddot of the rotational constraints at zero accelerations into `gap` (2,); no-op in a plane.

    With q = c x a, Φ_dot = q·(ω - Ω). `turning` (turns,) in rad/s² is what velocities alone make of the rate of the
    spin Ω above the first body of a chain; gaps and rates are fed back with `feedback` (1/s) squared and doubled.
    """
    if len(above.spin) == 1:
        return
    a, c, other, _ = joint_axes(state, body, first, above.orientation)
    spin, over, rate = load(state.bodies.velocity[body, 3:], a), above.spin, turning
    if not first:
        over, rate = load(state.bodies.velocity[body - 1, 3:], a), scale(0.0, turning)
    relative = subtract(spin, over)
    for number in range(2):
        mine = c if number == 0 else other
        axis = cross(mine, a)
        axis_rate = add_scaled(1.0, cross(cross(spin, mine), a), cross(mine, cross(over, a)))
        left = dot(axis_rate, relative) - dot(axis, rate)
        gap[number] = left + feedback * (2.0 * dot(axis, relative) + feedback * dot(a, mine))


@inlined_kernel
def hold(joint, inverse, by_place, by_above, least, gap):
    """Constrained rotation of a body, from the free rotation -(by_place p + by_above θ + least).

    Takes the inverse of what stiffens the turn, and the gaps Φ (2,). Each axis q that holds is one equation
    q·(turn - θ) = -Φ with one moment λ q.

    Returns:
        The three coefficients, and those of the moment that holds (`Held`).
    """
    if len(joint.moment) == 1:
        return by_place, by_above, least, Held((), (), ())
    nothing = scale(0.0, by_place)
    on_place, on_above, on = nothing, nothing, scale(0.0, least)
    through = unit_matrix(least)  # what a moment is with those that the axes before it then need
    for number in range(joint.holding):
        axis = joint.held[number]
        yields = product(inverse, axis, axis)
        weight = 1.0 / dot(axis, yields)
        push = scale(weight, product(through, axis, axis))
        place, above = product(axis, by_place, axis), add_scaled(1.0, product(axis, by_above, axis), axis)
        rest = dot(axis, least) - gap[number]
        on_place = add_scaled(1.0, outer(1.0, push, place), on_place)
        on_above = add_scaled(1.0, outer(1.0, push, above), on_above)
        on = add_scaled(rest, push, on)
        by_place = subtract(by_place, outer(weight, yields, place))
        by_above = subtract(by_above, outer(weight, yields, above))
        least = add_scaled(-rest * weight, yields, least)
        back = product(axis, inverse, axis)
        inverse = subtract(inverse, outer(weight, yields, back))
        through = subtract(through, outer(1.0, push, back))
    return by_place, by_above, least, Held(on_place, on_above, on)


@formula
def add_held(a, held):
    """Sum of a matrix and the contribution of rotational constraints; in a plane the matrix alone."""
    return add_scaled(1.0, held, a) if held else a


@inlined_kernel
def keep_held(held, body, work):
    """Store the coefficients of a constraint moment for `recover_held`."""
    store(held.by_place, work.held_by_place[body])
    store(held.by_above, work.held_by_above[body])
    store(held.least, work.held_right[body])


@kernel
def recover_held(state, body, moved, turned, work):
    """Update the constraint moment of a joint, from the increments of pivot and upper rotation."""
    if len(turned) == 1:
        return
    square = outer(0.0, moved, moved)
    change = product(load(work.held_by_place[body], square), moved, moved)
    change = add_scaled(1.0, product(load(work.held_by_above[body], square), turned, turned), change)
    accumulate(add_scaled(1.0, load(work.held_right[body], moved), change), state.moments[body])
