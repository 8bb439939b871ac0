"""Statically condensed vehicle: contact force and driving-point impedance at its joint, rigid or compliant.

F is the force of the cable alone. Where its elements round off the kink under a joint, the pivot is at S(s) e - δ(s, F)
(`rope.joint_compliance`). With the impedance Δ(F, m) = D Δ(x, θ) + b by the displacement x of the pivot, and the
displacement u of the joint on the cable,

    x = u - δ - ∂δ/∂F ΔF  gives  x = A u + B θ + a,

and so the impedance by u.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import no_turn
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    adjugate,
    block,
    determinant,
    linear,
    load,
    outer,
    store,
    subtract,
)
from cable_twin.mechanics.on_rope.buffer import with_neighbours
from cable_twin.mechanics.rope.joint_compliance import has_joint_compliance, joint_compliance


class Impedance(NamedTuple):
    """Contact force on a vehicle and its driving-point impedance at the joint: Δ(F, m) = D Δ(place, θ) + b."""

    force: Any  # F (dim,) N
    by_place: Any  # (dim²) N/m
    by_turn: Any  # (dim turns) N
    left: Any  # b (dim,) N
    moment_by_place: Any  # (turns dim) N
    moment_by_turn: Any  # (turns²) N m
    moment_left: Any  # b (turns,) N m


@inlined_kernel
def contact_force(system, state, carriage):
    """Force (dim,) in N of the cable, and of an own haul rope, on a carriage: λ less the force of a clamp."""
    force = load(state.multipliers[system.carriages.body_offset[carriage]], system.cable.gravity)
    if state.clamp_holds[carriage]:
        force = subtract(force, load(state.clamp_force[carriage], force))
    return force


@inlined_kernel
def impedance_at_pivot(system, state, carriage, work):
    """Contact force of the cable alone, and impedance of a carriage with haul rope and buffers, at its pivot."""
    first, like, still = system.carriages.body_offset[carriage], system.cable.gravity, no_turn(system.cable.gravity)
    force = contact_force(system, state, carriage)
    impedance = load(work.impedance[first], outer(0.0, like, like))
    residual = load(work.impedance_force[first], like)
    if system.haul_ropes.present:
        force, impedance, residual = with_haul_rope(carriage, force, impedance, residual, work)
    if system.buffers.present:
        force, impedance = with_neighbours(system, state, carriage, force, impedance, work)
    return Impedance(
        force,
        impedance,
        load(work.impedance_turning[first], outer(0.0, like, still)),
        residual,
        load(work.impedance_moment[first], outer(0.0, still, like)),
        load(work.impedance_turn[first], outer(0.0, still, still)),
        load(work.impedance_force[first, len(like) :], still),
    )


@kernel
def with_haul_rope(carriage, force, impedance, residual, work):
    """Force F (dim,) in N of the cable alone on a carriage, and D, b of ΔF = D Δp + b, less those of a haul rope.

    The rope is one more impedance at the joint, in its direction: Δ(F d) = (F' d·Δp + change) d.
    """
    d = load(work.haul_direction[carriage], force)
    stiff = -work.haul_by_way[carriage]
    impedance = add_scaled(1.0, outer(stiff, d, d), impedance)
    force = add_scaled(-work.haul_force[carriage], d, force)
    return force, impedance, add_scaled(-work.haul_change[carriage], d, residual)


@inlined_kernel
def impedance_at_joint(cable, state, point, vehicle, r_x, carriage, work):
    """Impedance of a carriage at a `point` of a cable with slope r_x (dim,), with joint compliance if any.

    Returns:
        The carriage by the way of its joint on the cable, the place (dim,) of its pivot by s, the force (N) that pushes
        it back along the cable, and that by s (N/m). Leaves what `pivot_displacement` needs.
    """
    if not has_joint_compliance(cable):
        return vehicle, r_x, 0.0, 0.0
    along, s = load(work.joint_along[carriage], r_x), state.joints.position[carriage]
    bent = joint_compliance(cable, point.element, s, vehicle.force, along, state.slackness[0])
    by_s = subtract(r_x, bent.by_place)
    store(by_s, work.joint_by_s[carriage])
    return with_compliance(vehicle, bent, carriage, work), by_s, bent.along, bent.along_by_place


@inlined_kernel
def with_compliance(vehicle, bent, carriage, work):
    """Impedance of a carriage by the displacement of the cable at a compliant joint."""
    impedance, by_joint, by_turn, right = yielding_impedance(vehicle, bent)
    store(by_joint, work.pivot_by_joint[carriage])
    store(by_turn, work.pivot_by_turn[carriage])
    store(right, work.pivot_right[carriage])
    return impedance


@formula
def yielding_impedance(vehicle, bent):
    """Impedance of a vehicle by the displacement u of a compliant joint; A, B and a of its pivot, x = A u + B θ + a."""
    # F' = F + D x + D_θ θ + b in x = u - δ - ∂δ/∂F (F' - F)
    giving = block(1.0, bent.by_force @ vehicle.by_place, 1.0)  # 1 + ∂δ/∂F D
    by_joint = adjugate(1.0 / determinant(giving), giving)  # A
    soft = by_joint @ bent.by_force
    by_turn = -(soft @ vehicle.by_turn)  # B
    right = -(by_joint @ bent.displacement + soft @ vehicle.left)  # a
    impedance = Impedance(
        vehicle.force,
        vehicle.by_place @ by_joint,
        vehicle.by_place @ by_turn + vehicle.by_turn,
        vehicle.by_place @ right + vehicle.left,
        vehicle.moment_by_place @ by_joint,
        vehicle.moment_by_place @ by_turn + vehicle.moment_by_turn,
        vehicle.moment_by_place @ right + vehicle.moment_left,
    )
    return impedance, by_joint, by_turn, right


@inlined_kernel
def pivot_displacement(carriage, moved, turned, work):
    """Displacement (dim,) in m of the pivot, from displacement and rotation (turns,) of the cable at the joint."""
    like = moved
    by_joint = load(work.pivot_by_joint[carriage], outer(0.0, like, like))
    by_turn = load(work.pivot_by_turn[carriage], outer(0.0, like, turned))
    return linear(by_joint, moved, by_turn, turned, load(work.pivot_right[carriage], like))
