"""Extremes of closed loops from one frame, in a single kernel call."""

from __future__ import annotations

from math import log, nan
from typing import NamedTuple

from cable_twin.key_figures.extremes import Extremes, take
from cable_twin.key_figures.rope_measures import DriveExtremes, take_drive
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.parameters import FloatArray

SLACK = 1.0  # N, of a strand that has less: so that the ratio of both is a number


@by_reference
class LoopMemory(NamedTuple):
    """Extremes of bullwheels, drives and strand loads between frames, with the constants of the scenario."""

    drives: DriveExtremes
    radii: FloatArray  # (sheaves,) m
    available: FloatArray  # (sheaves,) friction times wrap, of the logarithm of the ratio of tensions
    tight: Extremes  # (2 sheaves,) N, of the strand that comes to it and of that which leaves it
    slack: Extremes  # (2 sheaves,) N
    adhesion: Extremes  # (sheaves,) used of available
    torque: Extremes  # (sheaves,) N m, of its drive, either way
    slip: Extremes  # (sheaves,) m, either way
    rolled_back: Extremes  # (sheaves,) 1 where it has stopped the lift for going back
    farthest: Extremes  # (sheaves,) m, travel of what tensions it
    nearest: Extremes  # (sheaves,) m
    empty: FloatArray  # (vehicles,) kg
    load: Extremes  # (ropes,) kg, of all that is attached to it
    loads: FloatArray  # (ropes,) kg, in the last frame


@kernel
def take_loop(memory, columns):
    """Take in the columns of a frame for the extremes of closed loops, in order of time."""
    time = columns.time[0]
    for drive in range(columns.drive_position.size):
        place, speed = columns.drive_position[drive], columns.drive_speed[drive]
        take_drive(memory.drives, drive, time, place, speed, columns.moving_cable_force[drive])
    for sheave in range(memory.radii.size):
        for side in range(2):
            tension = columns.sheave_tension[sheave, side]
            take(memory.tight, 2 * sheave + side, tension, time, nan)
            take(memory.slack, 2 * sheave + side, tension, time, nan)
        on, off = max(columns.sheave_tension[sheave, 0], SLACK), max(columns.sheave_tension[sheave, 1], SLACK)
        take(memory.adhesion, sheave, abs(log(on / off)) / memory.available[sheave], time, nan)
        take(memory.torque, sheave, abs(columns.sheave_force[sheave]) * memory.radii[sheave], time, nan)
        take(memory.slip, sheave, abs(columns.sheave_slip[sheave]), time, nan)
        take(memory.rolled_back, sheave, columns.sheave_rolled_back[sheave], time, nan)
        take(memory.farthest, sheave, columns.sheave_travel[sheave], time, nan)
        take(memory.nearest, sheave, columns.sheave_travel[sheave], time, nan)
    memory.loads[:] = 0.0
    for vehicle in range(memory.empty.size):
        if columns.attached[vehicle] == 1.0:
            memory.loads[int(columns.vehicle_rope[vehicle])] += memory.empty[vehicle] + columns.payload[vehicle]
    for rope in range(memory.loads.size):
        take(memory.load, rope, memory.loads[rope], time, nan)


__all__ = ["LoopMemory", "take_loop"]
