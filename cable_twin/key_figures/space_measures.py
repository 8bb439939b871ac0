"""Extremes of a rope in space, each with the wind at its time: lateral swing, grooves and clearances."""

from __future__ import annotations

from math import inf, nan
from typing import NamedTuple

import numpy as np

from cable_twin.key_figures.extremes import Extremes, highest, lowest, take_in_wind
from cable_twin.key_figures.rope_measures import CLEARANCE_PERIOD
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.readout.clearances import Surroundings, look_around


@by_reference
class Across(NamedTuple):
    """Extremes of lateral swing, grooves and clearances between frames."""

    around: Surroundings
    roll: Extremes  # (vehicles,) rad, either way
    swing: Extremes  # (vehicles,) rad, along the track
    lateral: Extremes  # (supports,) N, either way
    lateral_ratio: Extremes  # (supports,) -, of that to the normal force, of all solver steps
    derailed: Extremes  # (supports,) how the rope came out
    clearance: Extremes  # (1 + vehicles,) m, over the ground, of the rope and of the vehicles
    to_masts: Extremes  # (vehicles,) m, with the number of the mast as place
    next_look: FloatArray  # (1,) s, when the clearances are due


def allocate_across(around: Surroundings, vehicles: int, supports: int) -> Across:
    """Memory of the extremes of a rope in space, empty before the first frame."""
    return Across(
        around=around,
        roll=highest(vehicles),
        swing=highest(vehicles),
        lateral=highest(supports),
        lateral_ratio=highest(supports),
        derailed=highest(supports),
        clearance=lowest(1 + vehicles),
        to_masts=lowest(vehicles),
        next_look=np.full(1, -inf),
    )


@kernel
def take_across(memory, columns):
    """Take in the columns of a frame for the extremes of a rope in space, in order of time."""
    time, wind, around = columns.time[0], columns.wind, memory.around
    for vehicle in range(columns.arc_length.size):
        if columns.attached[vehicle] != 0.0:
            angles, place = columns.body_angles[around.first_body[vehicle + 1] - 1], columns.arc_length[vehicle]
            take_in_wind(memory.roll, vehicle, abs(angles[0]), time, place, wind)
            take_in_wind(memory.swing, vehicle, abs(angles[1]), time, place, wind)
    for support in range(columns.tower_lateral.size):
        take_in_wind(memory.lateral, support, abs(columns.tower_lateral[support]), time, nan, wind)
        take_in_wind(memory.lateral_ratio, support, columns.tower_lateral_ratio[support], time, nan, wind)
        if columns.tower_derailed[support] > 0.0:
            out = columns.tower_derailed_time[support]
            take_in_wind(memory.derailed, support, columns.tower_derailed[support], out, nan, wind)
    if time >= memory.next_look[0]:
        memory.next_look[0] = time + CLEARANCE_PERIOD * (1.0 - 1e-9)
        look_around(around, columns.rope_position, columns.attached, columns.body_position, columns.body_orientation)
        for row in range(around.lowest.shape[0]):
            take_in_wind(memory.clearance, row, around.lowest[row, 0], time, around.lowest[row, 1], wind)
        for vehicle in range(around.nearest.shape[0]):
            take_in_wind(memory.to_masts, vehicle, around.nearest[vehicle, 0], time, around.nearest[vehicle, 1], wind)


__all__ = ["Across", "allocate_across", "take_across"]
