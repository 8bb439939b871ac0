"""Key figures of one rope: extremes of its frames, turned into figures with limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.snapshot import ENDS, Layout, Snapshot
from cable_twin.key_figures.allocation import allocate
from cable_twin.key_figures.buffers import BufferFigures
from cable_twin.key_figures.extremes import Extremes
from cable_twin.key_figures.figure import KeyFigure, figure_of, with_limit
from cable_twin.key_figures.limits import limited
from cable_twin.key_figures.rope_measures import MEAN, DriveExtremes, take_frame
from cable_twin.key_figures.space_figures import LOOKS, SpaceFigures
from cable_twin.key_figures.stops import StopsOf
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.drives import Limits

# assumed: ropeway standards specify no filter; anything shorter than 0.2 s is felt as a shock
MEANS = (
    f"smoothed twice with a moving average over {MEAN:g} s (-3 dB at {0.319 / MEAN:.1f} Hz); assumed, as no ropeway "
    "standard specifies a filter"
)


class FiguresOfRope:
    """Key figures of one rope, its supports, drives and vehicles.

    Args:
        scenario: what runs; its `limits` and the limits of its drives are those of the figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._vehicles, self._drives = list(scenario.vehicles), list(scenario.drives)
        self._supports = [*ENDS, *scenario.towers]
        self._memory = allocate(scenario)
        self._packed_memory = pack(self._memory)
        self._space = SpaceFigures(scenario) if scenario.dim == 3 else None
        self.buffers = BufferFigures(scenario)
        self._last, self._period = math.nan, math.nan  # s, time of the last frame and from one to the next
        self._first_tension = math.nan  # N, highest of the first frame
        driven = [
            name for name, vehicle in scenario.vehicles.items() if vehicle.joint == "sliding" and not vehicle.clamped_to
        ]
        self._stops = StopsOf((*driven, *self._drives), self._motion)
        self._layout: Layout | None = None  # of the frames so far

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        if snapshot.layout is not self._layout:
            self._take_layout(snapshot.layout)
        time = snapshot.time
        passed = time - self._last
        if passed > 0.0 and not passed >= self._period:
            self._period = passed
        self._last = time
        self._numbers[:] = snapshot.numbers
        take_frame(self._packed_memory, self._arc_lengths, self._packed_columns)
        if self._space is not None:
            self._space.update(self._packed_columns)
        self.buffers.update(time, self._columns)
        if math.isnan(self._first_tension):
            self._first_tension = self._memory.tension.value()
        self._stops.update(time)

    def _take_layout(self, layout: Layout) -> None:
        """Allocate the columns that each frame of a layout is copied into.

        Raises:
            ValueError: it is not that of the scenario.
        """
        bodies = {name: tuple(vehicle.bodies) for name, vehicle in self._scenario.vehicles.items()}
        if (layout.vehicles, [*layout.supports], [*layout.drives]) != (bodies, self._supports, self._drives):
            raise ValueError("snapshots of another scenario: its vehicles, supports or drives have other names")
        self._layout, self._arc_lengths = layout, layout.arc_lengths
        self._numbers = np.empty(layout.size)
        self._columns = layout.columns(self._numbers)
        self._packed_columns = pack(self._columns)

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command at the time of its effect."""
        if applied.command.kind == "reset":  # nothing before it is a part of the motion
            self._memory.passed_times[:] = math.nan
        self._stops.command(applied)

    def figures(self) -> list[KeyFigure]:
        """Return all figures of the rope with a value so far."""
        found = [
            *self._of_rope(),
            *self._of_supports(),
            *(figure for name in self._drives for figure in self._of_drive(name)),
            *(figure for name, members in self._groups() for figure in self._of_vehicles(name, members)),
            *self.buffers.figures(),
        ]
        frames = "" if math.isnan(self._period) else f"samples taken every {self._period:.4g} s"
        found = [figure if figure.band else replace(figure, band=frames) for figure in found]
        return [figure for figure in found if not math.isnan(figure.value)]

    def _motion(self, name: str) -> tuple[float, float]:
        """Position (m) and speed (m/s) of a drive or a driven vehicle in the last frame."""
        c = self._columns
        if name in self._drives:
            index = self._drives.index(name)
            return float(c.drive_position[index]), float(c.drive_speed[index])
        index = self._vehicles.index(name)
        return float(c.arc_length[index]), float(c.speed[index])

    def _of_rope(self) -> Iterator[KeyFigure]:
        highest = figure_of(self._memory.tension, 0, "rope tension, highest", "N")
        yield highest
        yield figure_of(self._memory.slackest, 0, "rope tension, lowest", "N")
        breaking_force = self._scenario.cable.breaking_force
        if breaking_force is not None and highest.value > 0.0:
            factor = replace(highest, name="rope safety factor", value=breaking_force / highest.value, unit="-")
            yield self._limited(factor, "rope_safety_factor")
        if self._first_tension > 0.0:
            ratio = highest.value / self._first_tension
            amplified = replace(
                highest, name="dynamic amplification, tension over that at the start", value=ratio, unit="-"
            )
            yield self._limited(amplified, "dynamic_amplification")
        spans = list(pairwise(["start", *self._scenario.towers, "end"]))
        for number, (first, last) in enumerate(spans):
            name = "sag below the chord" if len(spans) == 1 else f"sag below the chord, {first} to {last}"
            yield self._limited(figure_of(self._memory.sag, number, name, "m", "x"), "sag")
        kept = self._memory if self._space is None else self._space.memory
        clearance = figure_of(kept.clearance, 0, "rope clearance over the terrain", "m", "x")
        yield replace(self._limited(clearance, "rope_clearance"), band=LOOKS)

    def _of_supports(self) -> Iterator[KeyFigure]:
        cable, memory = self._scenario.cable, self._memory
        for number, name in enumerate(self._supports):
            load = figure_of(memory.highest_load, number, f"{name}: support load, highest", "N")
            yield self._limited(load, "support_load")
            yield figure_of(memory.lowest_load, number, f"{name}: support load, lowest", "N")
            margin = figure_of(memory.margin, number, f"{name}: deropement margin, load over that at rest", "-")
            if margin.value == 0.0 and load.value == 0.0:
                margin = replace(margin, place="does not touch")
            yield replace(self._limited(margin, "deropement_margin"), band="sampled at every solver step")
            roller = figure_of(memory.roller_load, number, f"{name}: load of a roller, lowest", "N")
            count = int(memory.rollers[number])
            touches = f"mean of {count} rollers" if count > 1 else "one roller"
            roller = replace(roller, place="does not touch" if load.value == 0.0 else touches)
            yield replace(self._limited(roller, "roller_load"), band="sampled at every solver step")
            if self._space is not None and name not in ENDS:
                yield from self._space.of_tower(name, number)
            low, high = None, None
            if name in ENDS:
                low, high = getattr(cable, name).travel or (None, None)
            source = f"scenario: cable.{name}.travel"
            farthest = figure_of(memory.farthest, number, f"{name}: counterweight travel, highest", "m")
            yield with_limit(farthest, high, source)
            nearest = figure_of(memory.nearest, number, f"{name}: counterweight travel, lowest", "m")
            yield with_limit(nearest, low, source, "at least")

    def _of_drive(self, name: str) -> Iterator[KeyFigure]:
        """Figures of the drive of a moving cable."""
        limits = self._scenario.drives[name].limits
        index = self._drives.index(name)
        yield from drive_figures(
            self._memory.drives, name, index, limits, f"scenario: drives.{name}.limits", "rope travel"
        )
        yield from self._stops.figures(name, self._limited)

    def _groups(self) -> list[tuple[str, list[int]]]:
        """Groups of vehicles with common figures: each carriage alone, all carriers together."""
        own = [(name, [number]) for number, name in enumerate(self._scenario.carriages)]
        carriers = self._scenario.carriers
        if carriers is None:
            return own
        return [*own, (carriers.name, list(range(len(own), len(own) + carriers.count)))]

    def _of_vehicles(self, name: str, members: Sequence[int]) -> Iterator[KeyFigure]:
        """Figures of a carriage, or of the worst vehicle of a group."""
        memory, worst = self._memory, self._worst
        kept = memory if self._space is None else self._space.memory  # with the wind at the time
        carriage = self._scenario.carriages.get(name)
        if carriage is None or carriage.joint == "clamped":
            yield worst(memory.vehicle_drives.speed, members, f"{name}: speed", "m/s")
        else:
            source = f"scenario: carriages.{name}.drive.limits"
            yield from drive_figures(memory.vehicle_drives, name, members[0], carriage.drive.limits, source)
        acceleration = worst(memory.acceleration, members, f"{name}: vehicle acceleration", "m/s^2")
        yield replace(self._limited(acceleration, "acceleration"), band=MEANS)
        swing = worst(kept.swing, members, f"{name}: swing along the track", "rad")
        yield self._limited(swing, "swing")
        if self._space is not None:
            yield from self._space.of_vehicles(name, members, worst, self._limited)
        yield worst(memory.contact_force, members, f"{name}: contact force", "N")
        yield worst(memory.haul_force, members, f"{name}: haul force", "N")
        ratio = worst(memory.tension_ratio, members, f"{name}: tension over transverse load", "-")
        clamped = self._scenario.vehicles[self._vehicles[members[0]]].joint == "clamped"
        yield limited(self._scenario, ratio, "tension_per_transverse_load", clamped=clamped)
        height = worst(kept.clearance.after_first(), members, f"{name}: clearance over the terrain", "m", "x")
        yield replace(self._limited(height, "vehicle_clearance"), band=LOOKS)
        yield from self._stops.figures(name, self._limited)

    def _worst(
        self, extremes: Extremes, members: Sequence[int], name: str, unit: str, at: str = "arc length"
    ) -> KeyFigure:
        """Figure of the worst vehicle of a group, with its name in a group of several."""
        worst = extremes.worst(list(members))
        figure = figure_of(extremes, worst, name, unit, at)
        return figure if len(members) == 1 else replace(figure, place=f"{self._vehicles[worst]}, {figure.place}")

    def _limited(self, figure: KeyFigure, key: str) -> KeyFigure:
        """Key figure with the limit of the scenario and the source of the limit."""
        return limited(self._scenario, figure, key)


def drive_figures(
    extremes: DriveExtremes, name: str, index: int, limits: Limits, source: str, at: str = "arc length"
) -> Iterator[KeyFigure]:
    """Figures of one drive against its limits; `source` names the limits, `at` the coordinate of the place."""
    speed = figure_of(extremes.speed, index, f"{name}: speed", "m/s", at)
    yield with_limit(speed, limits.speed, f"{source}.speed")
    force = figure_of(extremes.force, index, f"{name}: drive force", "N", at)
    yield with_limit(force, limits.force, f"{source}.force")
    highest = figure_of(extremes.power, index, f"{name}: drive power, highest", "W", at)
    yield with_limit(highest, limits.power, f"{source}.power")
    lowest = figure_of(extremes.braking_power, index, f"{name}: drive power, lowest", "W", at)
    yield with_limit(lowest, None if limits.power is None else -limits.power, f"{source}.power", "at least")


__all__ = ["FiguresOfRope", "drive_figures"]
