"""What a carriage is to the cable where its joint yields: its pivot is at S(s) e - δ(s, F), not at S(s) e.

F is the force of the cable on the carriage, δ the way of `rope.kink`. With the impedance Δ(F, m) = D Δ(x, θ) + b of the
carriage by the place x of its pivot, and the way u of the joint on the cable,

    x = u - δ - ∂δ/∂F ΔF  gives  x = A u + B θ + a,

and so the impedance by u. Where nothing yields, A = 1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    adjugate,
    apply,
    block,
    determinant,
    load,
    multiply,
    outer,
    product,
    scale,
    store,
    subtract,
)


class Seen(NamedTuple):
    """A carriage as the cable has it: the force on it now, and its impedance Δ(F, m) = D Δ(place, θ) + b."""

    force: Any  # F (dim,) N
    by_place: Any  # (dim²) N/m
    by_turn: Any  # (dim turns) N
    left: Any  # b (dim,) N
    moment_by_place: Any  # (turns dim) N
    moment_by_turn: Any  # (turns²) N m
    moment_left: Any  # b (turns,) N m


@inlined_kernel
def let_yield(seen, kink, carriage, work):
    """The same carriage by the way of its joint on the cable; leaves what `pivot_way` needs."""
    like, still = seen.force, seen.moment_left
    giving = block(1.0, multiply(kink.by_force, seen.by_place), 1.0)
    stiff = adjugate(1.0 / determinant(giving), giving)
    soft = multiply(stiff, kink.by_force)
    by_turn = scale(-1.0, product(soft, seen.by_turn, like))
    right = scale(-1.0, add_scaled(1.0, apply(stiff, kink.way), apply(soft, seen.left)))
    store(stiff, work.pivot_by_joint[carriage])
    store(by_turn, work.pivot_by_turn[carriage])
    store(right, work.pivot_right[carriage])
    return Seen(
        seen.force,
        multiply(seen.by_place, stiff),
        add_scaled(1.0, product(seen.by_place, by_turn, like), seen.by_turn),
        add_scaled(1.0, apply(seen.by_place, right), seen.left),
        product(seen.moment_by_place, stiff, like),
        add_scaled(1.0, product(seen.moment_by_place, by_turn, like), seen.moment_by_turn),
        add_scaled(1.0, product(seen.moment_by_place, right, like), still),
    )


@inlined_kernel
def pivot_way(carriage, moved, turned, work):
    """Way (dim,) in m of the pivot, for that of the joint on the cable and the turn (turns,) of the cable there."""
    like = moved
    by_joint = load(work.pivot_by_joint[carriage], outer(0.0, like, like))
    by_turn = load(work.pivot_by_turn[carriage], outer(0.0, like, turned))
    way = add_scaled(1.0, apply(by_joint, moved), product(by_turn, turned, turned))
    way = add_scaled(1.0, load(work.pivot_right[carriage], like), way)
    store(subtract(moved, way), work.joint_way[carriage])
    return way
