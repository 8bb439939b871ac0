"""Recording of a cabin with prescribed motion for tests of the view, and readers of the file."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from hand_made_snapshot import body_in_plane, snapshot_of
from rerun.chunk import RrdReader

from cable_twin.frame.records import AppliedCommand, CableSamples, CarriageState, Command, SupportState
from cable_twin.scenario.builders.outlines import outline_from_pivots
from cable_twin.view.rerun_view import RerunView

SPAN, RISE, WEIGHT = 1000.0, 150.0, 60.0  # m, m, N/m
LOAD, HORIZONTAL = 90e3, 420e3  # N of the cabin, N of rope pull
FRAMES, RATE = 1500, 100.0
OUTLINES = {
    "cabin": {
        "hanger": outline_from_pivots((0.0, 2.4), (0.0, -2.6)),
        "cabin": outline_from_pivots((0.0, 1.6), gyration_radius=1.3),
    }
}


def rope_height(x, cabin, pull):
    """Height of a rope between its supports: parabola with a kink at a point load."""
    chord = RISE * x / SPAN
    own = WEIGHT * x * (SPAN - x) / (2.0 * pull)
    point = LOAD / pull * np.where(x < cabin, x * (SPAN - cabin), cabin * (SPAN - x)) / SPAN
    return chord - own - point


def snapshot_at(moment, samples=200, more_supports=None):
    """Snapshot of a cabin accelerating from 150 m to 12 m/s and swinging in two modes, with the pull of its load."""
    ramp = min(moment, 6.0)
    speed = 2.0 * ramp + 0.15 * np.sin(5.0 * moment) * np.exp(-0.2 * moment)
    x = 150.0 + ramp**2 + 12.0 * max(moment - 6.0, 0.0)
    pull = HORIZONTAL * (1.0 + 0.16 * np.sin(np.pi * x / SPAN)) * (1.0 + 0.004 * np.sin(9.0 * moment))
    stations = np.linspace(0.0, SPAN, samples)
    heights = rope_height(stations, x, pull)
    slope = np.gradient(heights, stations)
    tensions = pull * np.sqrt(1.0 + slope**2) + 4e3 * (stations < x)
    joint = np.array([x, rope_height(np.array(x), x, pull)])

    hanger = 0.16 * np.sin(1.1 * moment) * np.exp(-0.04 * moment)
    cabin = hanger + 0.08 * np.sin(3.4 * moment)
    down = lambda angle: np.array([-np.sin(angle), -np.cos(angle)])  # noqa: E731
    hanger_mass = joint + 2.4 * down(hanger)
    cabin_mass = hanger_mass + 2.6 * down(hanger) + 1.6 * down(cabin)
    bodies = {
        "hanger": body_in_plane(*hanger_mass, hanger, speed),
        "cabin": body_in_plane(*cabin_mass, cabin, speed),
    }
    force = 9.0e3 * (moment < 6.0) + 12e3 + 2e3 * np.sin(5.0 * moment) * np.exp(-0.2 * moment)
    carriage = CarriageState(float(x), speed, force, np.array([0.0, -LOAD]), joint, bodies)
    supports = {"start": SupportState(np.array([-pull, 4e4])), "end": SupportState(np.array([pull, 4e4]))}
    cable = CableSamples(stations, np.column_stack([stations, heights]), tensions)
    return snapshot_of(moment, {"cabin": carriage}, supports | (more_supports or {}), cable)


def commands():
    drive = AppliedCommand(0.5, Command("speed", {"cabin": 12.0}), "topic")
    stop = AppliedCommand(13.0, Command("emergency_stop", {}), "service")
    return {0.3: drive, 12.9: stop}


def draw(path, frames=FRAMES, **options):
    """Record the run; returns its snapshots."""
    snapshots = [snapshot_at(index / RATE) for index in range(frames)]
    orders = commands()
    view = RerunView("test ropeway", OUTLINES, path=path, live=False, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # rerun turns mistakes into warnings
        for index, snapshot in enumerate(snapshots):
            if (order := orders.get(snapshot.time)) is not None:
                view.log_command(order)
            view.log(snapshot)
            if index % 40 == 0:
                view.flush()
        view.close()
    return snapshots


def column(path, entity, component):
    """Times (s) and values of one component in a file, in order of time."""
    times, values = [], []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times += batch.column("sim_time").cast(pa.int64()).to_pylist()
                values += batch.column(component).to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order] / 1e9, [values[index] for index in order]


def static(path: Path, entity: str, component: str) -> list[Any]:
    """Values of a static component; empty without any."""
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                return batch.column(component).to_pylist()[0]
    return []
