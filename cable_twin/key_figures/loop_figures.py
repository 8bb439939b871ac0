"""Key figures of closed loops: bullwheels, their drives, and the load on each strand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import isnan, nan

import numpy as np

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures.allocation import drive_extremes
from cable_twin.key_figures.extremes import highest, lowest
from cable_twin.key_figures.figure import KeyFigure, figure_of, with_limit
from cable_twin.key_figures.limits import limited
from cable_twin.key_figures.loop_measures import LoopMemory, take_loop
from cable_twin.key_figures.rope_figures import drive_figures
from cable_twin.key_figures.stops import StopsOf
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.scenario import Scenario

SIDES = ("onto it", "off it")  # of the strand that comes to a bullwheel, and of that which leaves it
BEYOND = "above 1 the rope slips on the wheel; from 1 mm on, `slip of the rope` says how far"
RIM = "of the rim of its bullwheel"
STILL = 1e-3  # m, of slip, below which there was none


class LoopFigures:
    """Extremes at the bullwheels of closed loops, in memory independent of the length of the run.

    Args:
        scenario: what runs; without bullwheels it has none of these figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, self._drives = scenario, list(scenario.drives)
        sheaves, vehicles = list(scenario.sheaves.values()), scenario.vehicles.values()
        names, count = list(scenario.sheaves), len(sheaves)
        driven = [str(drive.sheave) for drive in scenario.drives.values()]
        self._memory = LoopMemory(
            drives=drive_extremes(len(self._drives) if sheaves else 0),
            radii=np.array([sheave.radius for sheave in sheaves], dtype=np.float64),
            available=np.array([sheave.friction * sheave.wrap for sheave in sheaves], dtype=np.float64),
            tight=highest(2 * count),
            slack=lowest(2 * count),
            adhesion=highest(count),
            torque=highest(count),
            slip=highest(count),
            rolled_back=highest(count),
            farthest=highest(count),
            nearest=lowest(count),
            empty=np.array([sum(body.mass for body in one.bodies.values()) for one in vehicles], dtype=np.float64),
            load=highest(len(scenario.ropes)),
            loads=np.zeros(len(scenario.ropes)),
        )
        self._packed = pack(self._memory)
        self._layout: Layout | None = None  # of the frames so far
        self._sheaves, self._rows = names, {name: names.index(name) for name in driven if name in names}
        self._motions: dict[str, tuple[float, float]] = dict.fromkeys(self._drives, (nan, nan))
        self._stops = StopsOf(self._drives if sheaves else (), self._motions.__getitem__, RIM)

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        if not self._sheaves:
            return
        if self._layout is not snapshot.layout:  # each frame is copied into the same columns
            self._layout, self._numbers = snapshot.layout, np.empty(snapshot.layout.size)
            self._columns = snapshot.layout.columns(self._numbers)
            self._packed_columns = pack(self._columns)
        self._numbers[:] = snapshot.numbers
        take_loop(self._packed, self._packed_columns)
        c = self._columns
        for name, place, speed in zip(self._drives, c.drive_position.tolist(), c.drive_speed.tolist(), strict=True):
            self._motions[name] = place, speed
        self._stops.update(snapshot.time)

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command at the time of its effect."""
        self._stops.command(applied)

    def figures(self) -> list[KeyFigure]:
        """Return all figures of bullwheels, drives and strands with a value so far."""
        if not self._sheaves:
            return []
        found = [figure for name in self._drives for figure in self._of_drive(name)]
        found += [figure for row, name in enumerate(self._sheaves) for figure in self._of_sheave(row, name)]
        if self._scenario.carriers is not None:
            for row, rope in enumerate(self._scenario.ropes):
                if rope in self._scenario.carriers.tracks:  # they hang from its track
                    continue
                load = figure_of(self._memory.load, row, f"{rope}: load of carriers, highest", "kg")
                found.append(replace(load, place="carriers and payload"))
        return [figure for figure in found if not isnan(figure.value)]

    def _of_drive(self, name: str) -> Iterator[KeyFigure]:
        drive = self._scenario.drives[name]
        source = f"scenario: drives.{name}.limits"
        yield from drive_figures(
            self._memory.drives, name, self._drives.index(name), drive.limits, source, "rope travel"
        )
        yield from self._stops.figures(name, lambda figure, key: limited(self._scenario, figure, key))

    def _of_sheave(self, row: int, name: str) -> Iterator[KeyFigure]:
        memory, sheave = self._memory, self._scenario.sheaves[name]
        for side, (joined, where) in enumerate(zip(sheave.joins, SIDES, strict=True)):
            rope = joined.partition(".")[0]
            for extremes, which in ((memory.tight, "highest"), (memory.slack, "lowest")):
                figure = figure_of(extremes, 2 * row + side, f"{name}: tension of '{rope}', {which}", "N")
                yield replace(figure, place=f"runs {where}")
        adhesion = figure_of(memory.adhesion, row, f"{name}: adhesion used of available", "-")
        source = f"scenario: sheaves.{name}, friction {sheave.friction:g} times wrap {sheave.wrap:.4g} rad: {BEYOND}"
        yield with_limit(adhesion, 1.0, source)
        slip = figure_of(memory.slip, row, f"{name}: slip of the rope", "m")
        if slip.value > STILL:
            yield slip
        if sheave.rollback is not None:
            figure = figure_of(memory.rolled_back, row, f"{name}: rollback device triggered", "-")
            source = f"scenario: sheaves.{name}.rollback of {sheave.rollback:g} m"
            yield with_limit(replace(figure, place="1 stands for yes, 0 for no"), 0.0, source)
        if name in self._rows:
            yield figure_of(memory.torque, row, f"{name}: drive torque, highest", "N m")
        if sheave.tensioning is not None:
            low, high = sheave.tensioning.travel
            kind = "counterweight" if sheave.counterweight else "hydraulics"
            source = f"scenario: sheaves.{name}.{kind}.travel"
            farthest = figure_of(memory.farthest, row, f"{name}: {kind} travel, highest", "m")
            yield with_limit(farthest, high, source)
            nearest = figure_of(memory.nearest, row, f"{name}: {kind} travel, lowest", "m")
            yield with_limit(nearest, low, source, "at least")


__all__ = ["LoopFigures"]
