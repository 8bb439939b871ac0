"""Static start of a bundle: each rope is laid by itself, then all are relaxed together until all forces balance."""

from __future__ import annotations

from math import isfinite
from typing import Any

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.memory import combine_arrays, copy_record
from cable_twin.mechanics.language.orientations import move_bodies
from cable_twin.mechanics.solution.bundle.clamp import find_clamps, worst_clamp_gap
from cable_twin.mechanics.solution.bundle.equations import solve_increments
from cable_twin.mechanics.solution.bundle.generalized_alpha import copy_ropes
from cable_twin.mechanics.solution.bundle.records import GOOD, LONGEST_GAP, STATE, SYSTEM, WORK
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.solution.kinks import hold_kinks
from cable_twin.mechanics.solution.relaxation import LAST, MAX_RELAXATIONS, relax_in_parts

FIRST_STEP = 1e-2  # s, of the pseudo-transient
CLOSED = 1e-6  # m, gap of a clamp
LONGEST_WAY = 0.2  # m, that a point goes in an iteration


@kernel
def relax_bundle(bundle, moving, moving_good, scratch, system, state, work, tolerance, mass_factor, iterations):
    """Pseudo-transient continuation of all ropes together, as `equilibrium.relax`.

    Returns:
        Number of iterations, the last increment (m), and the mass factor to go on with, where it begins with 0; 0 at
        rest.
    """
    like = system.cable.gravity
    first = 1.0 / (FIRST_STEP * FIRST_STEP)
    if mass_factor == 0.0:
        mass_factor = first
    smallest, increment = LAST * first, 0.0
    for iteration in range(iterations):
        find_clamps(bundle, moving, system, state, 0.0)  # what rails carry depends on where a rider comes to stand
        copy_ropes(bundle, STATE, GOOD, state)
        copy_record(moving, moving_good)
        for rope in range(bundle.records.shape[0]):
            own, here = record_at(bundle.records[rope, SYSTEM], system), record_at(bundle.records[rope, STATE], state)
            hold_kinks(own, here, record_at(bundle.records[rope, WORK], work))
        solvable, increment, changed = solve_increments(
            bundle, moving, scratch, system, state, work, mass_factor, 0.0, 1.0
        )
        if not solvable or not isfinite(increment) or increment > 3.0 * LONGEST_WAY:
            copy_ropes(bundle, GOOD, STATE, state)
            copy_record(moving_good, moving)
            mass_factor *= 8.0
            scratch.closing[0] *= 0.5
            continue
        for rope in range(bundle.records.shape[0]):
            here, own = record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
            combine_arrays(here.nodes.position, 1.0, own.right_side, here.nodes.position)
            combine_arrays(here.joints.position, 1.0, own.sliding_increment, here.joints.position)
            move_bodies(here.bodies.position, own.body_increment, like)
        combine_arrays(moving.stages.position, 1.0, scratch.increment, moving.stages.position)
        closed = worst_clamp_gap(bundle, moving, system, state, like) < CLOSED
        if increment < tolerance and mass_factor <= smallest and changed == 0 and closed:
            return iteration + 1, increment, 0.0
        if increment < LONGEST_WAY:
            scratch.closing[0] = min(1.5 * scratch.closing[0], LONGEST_GAP)
            mass_factor = max(0.25 * mass_factor, smallest)
    return iterations, increment, mass_factor


def settle_bundle(parts: tuple[Any, ...], tolerance: float, elements: int) -> None:
    """Bring a bundle, of which each rope is at rest by itself, to rest as a whole.

    Args:
        parts: the first arguments of `relax_bundle`, up to the scratch of a rope.
        tolerance: last increment (m) that is allowed.
        elements: of all ropes.

    Raises:
        EquilibriumError: it finds no rest.
    """
    used, increment = relax_in_parts(lambda *how: relax_bundle(*parts, tolerance, *how), elements)
    if used >= MAX_RELAXATIONS:
        raise EquilibriumError(
            f"no static equilibrium of the ropes together after {used} iterations: the last one moved a point by "
            f"{increment:.3g} m, allowed are {tolerance:.3g} m"
        )


__all__ = ["relax_bundle", "settle_bundle"]
