"""Statically condensed vehicle: contact force and driving-point impedance at its joint."""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import no_turn
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    load,
    outer,
    scale,
    subtract,
)
from cable_twin.mechanics.on_rope.buffer import with_neighbours
from cable_twin.mechanics.on_rope.rails import force_of_ropes, share_on_rope


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
    """Force (dim,) in N of cable and own haul rope on a vehicle: its joint's multiplier λ less the force of a clamp.

    Of a vehicle on station rails it is what the rails leave to the cable.
    """
    force = force_of_ropes(system, state, carriage)
    if state.clamp_holds[carriage]:
        force = subtract(force, load(state.clamp_force[carriage], force))
    return force


@inlined_kernel
def impedance_at_pivot(system, state, carriage, work):
    """Contact force of the cable alone on a vehicle, and its impedance at the joint with haul rope and buffers.

    Of a vehicle on station rails, the part of force and its impedance that the rails leave to the cable; moments of its
    hinge are on the cable as a whole.
    """
    first, like, still = system.carriages.body_offset[carriage], system.cable.gravity, no_turn(system.cable.gravity)
    force = contact_force(system, state, carriage)
    impedance = load(work.impedance[first], outer(0.0, like, like))
    residual = load(work.impedance_force[first], like)
    if system.haul_ropes.present:
        force, impedance, residual = with_haul_rope(carriage, force, impedance, residual, work)
    if system.buffers.present:
        force, impedance = with_neighbours(system, state, carriage, force, impedance, work)
    turning, moment = load(work.impedance_turning[first], outer(0.0, like, still)), outer(0.0, still, like)
    if system.carriages.rails[carriage] > 0.0:
        borne = share_on_rope(system, state, carriage)
        impedance, residual, turning = scale(borne, impedance), scale(borne, residual), scale(borne, turning)
    return Impedance(
        force,
        impedance,
        turning,
        residual,
        load(work.impedance_moment[first], moment),
        load(work.impedance_turn[first], outer(0.0, still, still)),
        load(work.impedance_force[first, len(like) :], still),
    )


@kernel
def with_haul_rope(carriage, force, impedance, residual, work):
    """Force F (dim,) in N of the cable alone on a vehicle, and D, b of ΔF = D Δp + b, less those of its haul rope.

    The rope is one more impedance at the joint, in its direction: Δ(F d) = (F' d·Δp + change) d.
    """
    d = load(work.haul_direction[carriage], force)
    stiff = -work.haul_by_way[carriage]
    impedance = add_scaled(1.0, outer(stiff, d, d), impedance)
    force = add_scaled(-work.haul_force[carriage], d, force)
    return force, impedance, add_scaled(-work.haul_change[carriage], d, residual)
