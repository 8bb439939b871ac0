"""Equilibrium of a closed rope loop: distribution of rope among strands, and positions of tensioning devices.

A bullwheel without a drive lets rope through until both its strands pull the same; a counterweight moves until they
pull as much as it does. The unknowns, one displacement of each, are found by Newton's method, in which each strand is
brought to rest by itself. In closed form, by elastic catenaries between the bullwheels, it is the equilibrium of the
bare loop, and nearly that with vehicles if their weight is spread over the strands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.solution.bundle.records import FIXED, BullwheelMotion, Bullwheels
from cable_twin.mechanics.solution.catenary import EquilibriumError, Rest, rest_over_supports

MOST_ITERATIONS = 40
TOLERANCE = 1e-9  # of the largest tension
NUDGE = 1e-5  # m, for the derivatives
LONGEST_MOVE = 0.002  # of the shortest strand: rope that runs through in one iteration
CLOSE = 1e-4  # of the largest tension, by which a bullwheel may be off balance


def settle_loop(
    sheaves: Bullwheels,
    motion: BullwheelMotion,
    lengths: FloatArray,
    relax: Callable[[], None],
    tolerance: float = TOLERANCE,
) -> None:
    """Solve for the equilibrium of all strands over their bullwheels; stores rope and carriage travel in `motion`.

    Args:
        sheaves: the wheels.
        motion: their motion, at rest, from which this goes on.
        lengths: (ropes,) m, of the strands.
        relax: brings all ropes to rest with the ends that `motion` gives them, and stores their tensions and pulls.
        tolerance: of the largest tension, by which a wheel may be off balance.

    Raises:
        EquilibriumError: there is no equilibrium with finite tensions, or the iteration does not find it.
    """
    free = np.flatnonzero(sheaves.driven == 0) if np.any(sheaves.driven) else np.arange(1, sheaves.driven.size)
    pulled = np.flatnonzero(sheaves.tensioning != FIXED)
    ways = [(motion.rope.position, sheave) for sheave in free] + [(motion.carriage.position, one) for one in pulled]

    def residual() -> FloatArray:
        relax()
        tension = motion.tension
        return np.array([*(tension[free, 1] - tension[free, 0]), *(sheaves.pull[pulled] - motion.pull[pulled])])

    left = residual()
    for _ in range(MOST_ITERATIONS):
        largest = float(np.abs(motion.tension).max())
        if not np.isfinite(left).all():
            raise EquilibriumError(
                f"no static equilibrium of the loop: given strands of {', '.join(f'{one:.6g}' for one in lengths)} m, "
                "one of which has no equilibrium of its own; allowed: other unstrained lengths of its ropes"
            )
        if np.abs(left).max(initial=0.0) < tolerance * largest:
            break
        slopes = np.empty((left.size, left.size))
        for column, (array, row) in enumerate(ways):
            array[row] += NUDGE
            slopes[:, column] = (residual() - left) / NUDGE
            array[row] -= NUDGE
        move = np.linalg.lstsq(slopes, -left, rcond=None)[0]
        move *= min(1.0, LONGEST_MOVE * float(lengths.min()) / max(float(np.abs(move).max()), 1e-300))
        for (array, row), way in zip(ways, move, strict=True):
            array[row] += way
        left = residual()
    else:
        raise EquilibriumError(
            f"no static equilibrium of the loop after {MOST_ITERATIONS} iterations: given strands of "
            f"{', '.join(f'{one:.6g}' for one in lengths)} m, with which its bullwheels are "
            f"{with_unit(np.abs(left).max(), 'N', 3)} off balance; allowed: other unstrained lengths of its ropes"
        )


def rest_in_closed_form(sheaves: Bullwheels, motion: BullwheelMotion, strands: Mapping[int, System]) -> None:
    """Move bullwheels and tensioning devices to the equilibrium of the bare strands, starting from `motion`.

    Args:
        sheaves: the wheels.
        motion: takes rope gone by, carriages, tensions and pulls.
        strands: by their number, with ends and lengths as they are before any wheel has moved.

    Raises:
        EquilibriumError: there is no such rest.
    """

    def relax() -> None:
        rests = {row: rest_over_supports(on_bullwheels(sheaves, motion, row, one)) for row, one in strands.items()}
        motion.pull[:] = 0.0
        for sheave, side in np.ndindex(sheaves.rope.shape):
            force = _end_force(rests[int(sheaves.rope[sheave, side])], 1 - side)
            motion.tension[sheave, side] = np.linalg.norm(force)
            motion.pull[sheave] += force @ sheaves.direction[sheave]

    lengths = np.array([system.cable.unstrained_length for system in strands.values()])
    settle_loop(sheaves, motion, lengths, relax, CLOSE)


def on_bullwheels(sheaves: Bullwheels, motion: BullwheelMotion, row: int, system: System) -> System:
    """Parameters of a strand with its ends at its bullwheels, and its length after rope travel over the bullwheels."""
    ends, length = system.cable.end_position.copy(), system.cable.unstrained_length
    for sheave, side in np.argwhere(sheaves.rope == row):
        ends[1 - side] += motion.carriage.position[sheave] * sheaves.direction[sheave]
        length += (2 * side - 1) * motion.rope.position[sheave]
    return system._replace(cable=system.cable._replace(end_position=ends, unstrained_length=float(length)))


def _end_force(rest: Rest, end: int) -> FloatArray:
    """Force (dim,) in N of the support on a cable at its start (0) or end (1)."""
    span = -end
    force = -rest.pull[0] if end == 0 else rest.pull[-1] + np.array([0.0, rest.weight * rest.length[-1]])
    return force @ rest.basis[span]
