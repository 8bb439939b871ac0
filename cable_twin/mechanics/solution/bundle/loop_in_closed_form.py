"""Equilibrium of a loop in closed form: elastic catenaries between bullwheels in balance.

That is where the bare loop rests, and nearly where it rests with vehicles, if their weight is spread over its strands.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.solution.bundle.loop_rest import settle_loop
from cable_twin.mechanics.solution.bundle.records import BullwheelMotion, Bullwheels
from cable_twin.mechanics.solution.catenary import Rest, rest_over_supports

CLOSE = 1e-4  # of the largest tension, by which a bullwheel may be off balance


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


__all__ = ["on_bullwheels", "rest_in_closed_form"]
