"""Least clearance between vehicles on different ropes in space, with the wind at its time.

A vehicle is the boxes of its bodies, as they are drawn; one without a box is the bar between its pins. Distances of
boxes are exact; between two looks, `CLEARANCE_PERIOD` apart, nothing is seen.
"""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.key_figures.extremes import Extremes, take_in_wind
from cable_twin.key_figures.rope_measures import CLEARANCE_PERIOD
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.readout.clearances import box_distance

NEAR = 30.0  # m between two joints, from which on a pair is looked at


@by_reference
class Passing(NamedTuple):
    """Least clearances between frames, boxes of the bodies, and scratch arrays."""

    group: IntArray  # (vehicles,) all carriers are one
    first_body: IntArray  # (vehicles + 1,)
    middle: FloatArray  # (bodies, 3) m, of its box in its axes
    body_half: FloatArray  # (bodies, 3) m, half the length of that along its axes
    clearance: Extremes  # (groups²,) m, of the pair first * groups + second, with the arc length of one of both
    pair: IntArray  # (groups², 2) vehicles at that time
    next_look: FloatArray  # (1,) s
    centre: FloatArray  # (2, 3) m, scratch
    axes: FloatArray  # (2, 3, 3), scratch
    half: FloatArray  # (2, 3) m, scratch
    corners: FloatArray  # (2, 8, 3) m, scratch


@kernel
def take_passing(memory, columns):
    """Take in the columns of a frame for the clearances of passing vehicles, in order of time."""
    time = columns.time[0]
    if time < memory.next_look[0]:
        return
    memory.next_look[0] = time + CLEARANCE_PERIOD * (1.0 - 1e-9)
    joints, groups = columns.joint_position, memory.group[-1] + 1
    for one in range(columns.attached.size):
        for other in range(one + 1, columns.attached.size):
            if columns.vehicle_rope[one] == columns.vehicle_rope[other]:
                continue
            if columns.attached[one] == 0.0 or columns.attached[other] == 0.0:
                continue
            square = 0.0
            for axis in range(3):
                square += (joints[one, axis] - joints[other, axis]) ** 2
            if not square < NEAR * NEAR:
                continue
            row = memory.group[one] * groups + memory.group[other]
            before = -memory.clearance.best[row]
            found = vehicle_distance(memory, columns, one, other, before)
            if found < before:
                take_in_wind(memory.clearance, row, found, time, columns.arc_length[one], columns.wind)
                memory.pair[row, 0], memory.pair[row, 1] = one, other


@kernel
def vehicle_distance(memory, columns, one, other, least):
    """Distance (m) between two vehicles, capped at `least` (m)."""
    for body in range(memory.first_body[one], memory.first_body[one + 1]):
        place_box(memory, columns, body, 0)
        for beside in range(memory.first_body[other], memory.first_body[other + 1]):
            place_box(memory, columns, beside, 1)
            apart, reach, others_reach = 0.0, 0.0, 0.0
            for axis in range(3):
                apart += (memory.centre[0, axis] - memory.centre[1, axis]) ** 2
                reach += memory.half[0, axis] ** 2
                others_reach += memory.half[1, axis] ** 2
            if apart**0.5 - reach**0.5 - others_reach**0.5 < least:
                least = min(least, box_distance(memory.centre, memory.axes, memory.half, memory.corners))
    return least


@kernel
def place_box(memory, columns, body, side):
    """Place the bounding box of one body at its position and orientation in the frame."""
    turn, axes = columns.body_orientation[body], memory.axes[side]
    i, j, k, w = turn[0], turn[1], turn[2], turn[3]
    axes[0, 0], axes[0, 1], axes[0, 2] = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j - k * w), 2.0 * (i * k + j * w)
    axes[1, 0], axes[1, 1], axes[1, 2] = 2.0 * (i * j + k * w), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k - i * w)
    axes[2, 0], axes[2, 1], axes[2, 2] = 2.0 * (i * k - j * w), 2.0 * (j * k + i * w), 1.0 - 2.0 * (i * i + j * j)
    for row in range(3):
        place = columns.body_position[body, row]
        for axis in range(3):
            place += axes[row, axis] * memory.middle[body, axis]
        memory.centre[side, row], memory.half[side, row] = place, memory.body_half[body, row]


__all__ = ["Passing", "take_passing"]
