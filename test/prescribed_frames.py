"""Frames with prescribed motion and tension, so that their key figures are known."""

from __future__ import annotations

import functools
import math

import numpy as np

from cable_twin.frame.records import SolverReport
from cable_twin.frame.snapshot import ENDS, Layout, Snapshot
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.scenario import load_scenario

PERIOD = 0.01  # s
LENGTH, SAG = 1000.0, 40.0  # m, of a parabola between ends of one height


CABIN = {
    "arc_length": 60.0,
    "drive": {"mode": "speed", "limits": {"speed": 10.0, "force": 150e3, "power": 250e3}},
    "bodies": {"cabin": {"mass": 12e3, "inertia": 24e3, "upper_pivot": [0.0, 4.0], "size": [4.0, 3.0]}},
}
SCENARIO = {
    "cable": {
        "unstrained_length": 1003.0,
        "mass_per_length": 20.0,
        "axial_stiffness": 4e8,
        "bending_stiffness": 0.0,
        "elements": 10,
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [1000.0, 0.0]},
    },
    "carriages": {"cabin": CABIN},
}
TOWERS = {"lower": {"position": [250.0, -20.0]}, "upper": {"position": [600.0, -30.0]}}
WEIGHT = {"support": "counterweight", "direction": [1.0, 0.0], "mass": 1e5, "travel": [-2.0, 3.0]}
LIFT = {
    **SCENARIO,
    "carriages": {},
    "drives": {"haul_rope": {"kind": "moving_cable", "limits": {"speed": 5.0}}},
    "carriers": {"name": "chair", "count": 3, "spacing": 500.0, "bodies": CABIN["bodies"]},
}


def scenario(**overrides):
    return load_scenario(SCENARIO, {key.replace("__", "."): value for key, value in overrides.items()})


@functools.cache
def layout(vehicles, towers, drives) -> Layout:
    x = np.linspace(0.0, LENGTH, 201)
    return Layout(dict.fromkeys(vehicles, ("cabin",)), (*ENDS, *towers), drives, x)


def frame(moment: float, vehicles=("cabin",), towers=(), drives=(), *, tension=1e6) -> Snapshot:
    """Frame of a rope alone; numbers that are not filled in are NaN, no value."""
    shape = layout(vehicles, towers, drives)
    one = Snapshot(shape, np.full(shape.size, math.nan), SolverReport(1, 1, 0, 0.0))
    columns, x = writable(one), shape.arc_lengths
    columns.time[0] = moment
    columns.rope_position[:] = np.column_stack([x, 0.0 * x, height(x)])
    columns.rope_tension[:] = tension * (1.0 + 0.1 * x / LENGTH)  # highest at the end, lowest at the start
    columns.lowest_tension[0], columns.highest_tension[0] = (tension, 0.0), (1.1 * tension, LENGTH)
    return one


def writable(one: Snapshot):
    """Writable columns of a snapshot's array."""
    return one.layout.columns(one.numbers.base)


def height(x):
    return -4.0 * SAG * x / LENGTH * (1.0 - x / LENGTH)


def put(
    one: Snapshot, row=0, *, place=500.0, speed=0.0, drive_force=0.0, pitch=0.0, body=None, weight=1e5, attached=1.0
) -> None:
    """Fill in the numbers of a vehicle in a frame."""
    c = writable(one)
    c.arc_length[row], c.speed[row], c.drive_force[row] = place, speed, drive_force
    c.drive_power[row] = drive_force * speed
    c.contact_force[row] = 0.0, 0.0, weight
    c.attached[row] = attached
    c.body_position[row] = (place, 0.0, height(min(place, LENGTH)) - 5.0) if body is None else (body[0], 0.0, body[1])
    c.body_angles[row] = 0.0, pitch, 0.0
    c.body_orientation[row] = 0.0, math.sin(0.5 * pitch), 0.0, math.cos(0.5 * pitch)


def snapshot(moment: float, *, tension=1e6, **vehicle) -> Snapshot:
    one = frame(moment, tension=tension)
    put(one, **vehicle)
    return one


def gathered(figures: KeyFigures) -> dict[str, KeyFigure]:
    return {figure.name: figure for figure in figures.figures()}


def supported(moment: float, *, loads=(2e5, 2e5), lowest=(2e5, 2e5), travel=math.nan) -> Snapshot:
    one = frame(moment, towers=("lower", "upper"))
    columns = writable(one)
    columns.support_force[:] = [(-9e5, 0.0, 1e5), (9e5, 0.0, 1e5), *((0.0, 0.0, load) for load in loads)]
    columns.support_travel[1] = travel
    columns.tower_load[2:], columns.tower_lowest_load[2:], columns.tower_rest_load[2:] = loads, lowest, 2e5
    return one


def chairs(moment: float, *, speed: float, force: float, swings: tuple[float, ...], gone=None) -> Snapshot:
    """Frame of three chairs: at 100 m, at 300 m, and off the cable at its end."""
    one = frame(moment, ("chair_1", "chair_2", "chair_3"), drives=("haul_rope",))
    for row, place, swing in zip(range(3), (100.0, 300.0, 1003.0), swings, strict=True):
        put(one, row, place=place, speed=speed, pitch=swing, attached=float(row < 2))
    columns = writable(one)
    columns.drive_position[0], columns.drive_speed[0] = moment * speed if gone is None else gone, speed
    columns.moving_cable_force[0] = force
    return one
