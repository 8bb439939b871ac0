"""The gathering: each snapshot goes to what keeps its extremes, and figures are made of those with their limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cable_twin.clearance import find_clearance
from cable_twin.key_figures.extremes import Extremes, Stops
from cable_twin.key_figures.figure import Bound, KeyFigure, figure_of, with_limit
from cable_twin.key_figures.vehicles import DriveExtremes, Vehicles
from cable_twin.outlines import body_outlines
from cable_twin.records import AppliedCommand, CableSamples, Snapshot
from cable_twin.scenario import Scenario

CLEARANCE_PERIOD = 0.1  # s of simulated time between two looks at the clearance
HAUL_ROPE_SAFETY_FACTOR = 4.5  # -, instead of that of a track rope where the cable moves and the scenario gives none
SOURCES = {  # of the default limits
    "rope_safety_factor": "EN 12927 and CEN practice: 3.15 to 3.5 track rope, 4.5 to 5 haul rope",
    "tension_per_transverse_load": "CEN practice for carriages on a track rope, at least 10",
    "swing": "assumed: clearance usually allows for 0.35 rad (20 deg)",
    "acceleration": "assumed: emergency stops usually have 1 to 1.5 m/s^2",
    "rope_clearance": "assumed: nothing may touch the ground",
    "vehicle_clearance": "assumed: nothing may touch the ground",
    "deropement_margin": "assumed: a tenth of the load at rest, the cable lifts off at 0",
}


class KeyFigures:
    """Gathers the key figures of one run.

    Args:
        scenario: what runs; its `limits` and the limits of its drives are those of the figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._vehicles = Vehicles(scenario)
        self._tension, self._slackest = Extremes(), Extremes(sign=-1.0)
        self._first_tension = math.nan  # N, highest of the first snapshot
        self._sag = Extremes(len(scenario.towers) + 1)
        names = ("start", "end", *scenario.towers)
        self._supports = {name: number for number, name in enumerate(names)}
        self._highest_load, self._lowest_load = Extremes(len(names)), Extremes(len(names), -1.0)
        self._margin = Extremes(len(names), -1.0)
        self._farthest, self._nearest = Extremes(len(names)), Extremes(len(names), -1.0)  # of counterweights
        self._drives = list(scenario.drives)
        self._drive = DriveExtremes(len(self._drives))
        driven = [name for name, vehicle in scenario.vehicles.items() if vehicle.joint == "sliding"]
        self._stops = {name: Stops() for name in (*driven, *self._drives)}
        self._terrain = np.array(scenario.terrain, dtype=np.float64)
        self._outlines = body_outlines(scenario)
        self._rope_clearance = Extremes(sign=-1.0)
        self._next_clearance = -math.inf  # s
        self._snapshot: Snapshot | None = None

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot; they come in the order of time."""
        time, cable = snapshot.time, snapshot.cable
        highest, lowest = int(cable.tensions.argmax()), int(cable.tensions.argmin())
        self._tension.update(cable.tensions[highest : highest + 1], time, cable.arc_lengths[highest])
        self._slackest.update(cable.tensions[lowest : lowest + 1], time, cable.arc_lengths[lowest])
        if self._snapshot is None:
            self._first_tension = float(cable.tensions[highest])
        self._snapshot = snapshot
        self._update_sag(time, cable)
        self._update_supports(snapshot)
        self._vehicles.update(snapshot)
        if self._drives:
            drives = [snapshot.drives[name] for name in self._drives]
            self._drive.update(time, *np.array([(drive.position, drive.speed, drive.force) for drive in drives]).T)
        for name, stops in self._stops.items():
            stops.update(time, *self._motion(name))
        if len(self._terrain) and time >= self._next_clearance:
            self._next_clearance = time + CLEARANCE_PERIOD * (1.0 - 1e-9)
            self._update_clearance(snapshot)

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command where it took effect."""
        kind, values = applied.command.kind, applied.command.values
        if kind == "reset":
            self._vehicles.forget()
        for name, stops in self._stops.items():
            if kind == "reset":
                stops.cancel()
            elif self._snapshot is not None and kind == "emergency_stop":
                stops.begin("emergency stop", applied.time, *self._motion_at(name, applied.time))
            elif self._snapshot is not None and kind == "speed" and values.get(name) == 0.0:
                stops.begin("stop", applied.time, *self._motion_at(name, applied.time))
            elif kind in ("speed", "force") and name in values:
                stops.cancel()

    def figures(self) -> list[KeyFigure]:
        """All figures that have a value so far."""
        found = [
            *self._of_rope(),
            *self._of_supports(),
            *(figure for name in self._drives for figure in self._of_drive(name)),
            *(figure for name, members in self._groups() for figure in self._of_vehicles(name, members)),
        ]
        return [figure for figure in found if not math.isnan(figure.value)]

    def _motion(self, name: str) -> tuple[float, float]:
        """Place (m) and speed (m/s) of what is driven."""
        assert self._snapshot is not None
        if name in self._snapshot.drives:
            drive = self._snapshot.drives[name]
            return drive.position, drive.speed
        state = self._snapshot.carriages[name]
        return state.arc_length, state.speed

    def _motion_at(self, name: str, time: float) -> tuple[float, float]:
        """Place (m) and speed (m/s) at a time (s) shortly after the last frame, which goes on as it was."""
        assert self._snapshot is not None
        place, speed = self._motion(name)
        return place + speed * (time - self._snapshot.time), speed

    def _update_sag(self, time: float, cable: CableSamples) -> None:
        """Depth below the chord of each span, from support to support."""
        x, z = cable.positions[:, 0], cable.positions[:, -1]
        way = 1.0 if x[-1] > x[0] else -1.0
        tops = [tower.position for tower in self._scenario.towers.values()]
        corners = np.array([(x[0], z[0]), *tops, (x[-1], z[-1])])
        if x[-1] == x[0]:
            return
        depths = np.interp(way * x, way * corners[:, 0], corners[:, 1]) - z
        bounds = [0, *np.searchsorted(way * x, way * corners[1:-1, 0]).tolist(), len(x)]
        deepest = [first + int(depths[first : max(last, first + 1)].argmax()) for first, last in pairwise(bounds)]
        self._sag.update(depths[deepest], time, x[deepest])

    def _update_supports(self, snapshot: Snapshot) -> None:
        """Loads and margins of all supports, travel of the counterweight."""
        rows = []
        for name in self._supports:
            state = snapshot.supports[name]
            tower, travel = state.tower, state.travel
            margin = tower.lowest_load / tower.rest_load if tower is not None and tower.rest_load > 0.0 else math.nan
            load = math.hypot(state.force[0], state.force[-1])
            rows.append((load, margin, math.nan if travel is None else travel))
        loads, margins, travels = np.array(rows).T
        self._highest_load.update(loads, snapshot.time)
        self._lowest_load.update(loads, snapshot.time)
        self._margin.update(margins, snapshot.time)
        self._farthest.update(travels, snapshot.time)
        self._nearest.update(travels, snapshot.time)

    def _update_clearance(self, snapshot: Snapshot) -> None:
        rope = snapshot.cable.positions[:, [0, -1]]
        found = find_clearance(self._terrain, rope, snapshot.carriages, self._outlines)
        self._rope_clearance.update([found.rope.height], snapshot.time, found.rope.x)
        self._vehicles.update_clearance(snapshot.time, found.vehicles)

    def _of_rope(self) -> Iterator[KeyFigure]:
        highest = figure_of(self._tension, 0, "rope tension, highest", "N")
        yield highest
        yield figure_of(self._slackest, 0, "rope tension, lowest", "N")
        breaking_force = self._scenario.cable.breaking_force
        if breaking_force is not None and highest.value > 0.0:
            factor = replace(highest, name="rope safety factor", value=breaking_force / highest.value, unit="-")
            yield self._limited(factor, "rope_safety_factor", "at least")
        if self._first_tension > 0.0:
            ratio = highest.value / self._first_tension
            amplified = replace(
                highest, name="dynamic amplification, tension over that at the start", value=ratio, unit="-"
            )
            yield self._limited(amplified, "dynamic_amplification")
        spans = list(pairwise(["start", *self._scenario.towers, "end"]))
        for number, (first, last) in enumerate(spans):
            name = "sag below the chord" if len(spans) == 1 else f"sag below the chord, {first} to {last}"
            yield self._limited(figure_of(self._sag, number, name, "m", "x"), "sag")
        clearance = figure_of(self._rope_clearance, 0, "rope clearance over the terrain", "m", "x")
        yield self._limited(clearance, "rope_clearance", "at least")

    def _of_supports(self) -> Iterator[KeyFigure]:
        cable = self._scenario.cable
        for name, number in self._supports.items():
            load = figure_of(self._highest_load, number, f"{name}: support load, highest", "N")
            yield self._limited(load, "support_load")
            yield figure_of(self._lowest_load, number, f"{name}: support load, lowest", "N")
            margin = figure_of(self._margin, number, f"{name}: deropement margin, load over that at rest", "-")
            yield self._limited(margin, "deropement_margin", "at least")
            low, high = None, None
            if name in ("start", "end"):
                low, high = getattr(cable, name).travel or (None, None)
            source = f"scenario: cable.{name}.travel"
            farthest = figure_of(self._farthest, number, f"{name}: counterweight travel, highest", "m")
            yield with_limit(farthest, high, source)
            nearest = figure_of(self._nearest, number, f"{name}: counterweight travel, lowest", "m")
            yield with_limit(nearest, low, source, "at least")

    def _of_drive(self, name: str) -> Iterator[KeyFigure]:
        """Figures of the drive of a moving cable."""
        limits = self._scenario.drives[name].limits
        index = self._drives.index(name)
        yield from self._drive.figures(name, index, limits, f"scenario: drives.{name}.limits", "rope gone by")
        yield from self._of_stop(name)

    def _of_stop(self, name: str) -> Iterator[KeyFigure]:
        stop = self._stops[name].stop if name in self._stops else None
        if stop is not None:
            place = f"{stop.kind} from {abs(stop.speed):.2f} m/s at {stop.start:.1f} m"
            distance = KeyFigure(f"{name}: stopping distance", stop.distance, "m", stop.time, place)
            yield self._limited(distance, "stopping_distance")
            time = KeyFigure(f"{name}: stopping time", stop.end - stop.time, "s", stop.time, place)
            yield self._limited(time, "stopping_time")

    def _groups(self) -> list[tuple[str, list[int]]]:
        """Vehicles that share their figures: each carriage alone, all carriers together."""
        own = [(name, [number]) for number, name in enumerate(self._scenario.carriages)]
        carriers = self._scenario.carriers
        if carriers is None:
            return own
        return [*own, (carriers.name, list(range(len(own), len(own) + carriers.count)))]

    def _of_vehicles(self, name: str, members: Sequence[int]) -> Iterator[KeyFigure]:
        """Figures of a carriage, or of the worst of several."""
        vehicles = self._vehicles
        carriage = self._scenario.carriages.get(name)
        if carriage is None or carriage.joint == "clamped":
            yield vehicles.figure(vehicles.drive.speed, members, f"{name}: speed", "m/s")
        else:
            source = f"scenario: carriages.{name}.drive.limits"
            yield from vehicles.drive.figures(name, members[0], carriage.drive.limits, source)
        acceleration = vehicles.figure(vehicles.acceleration, members, f"{name}: vehicle acceleration", "m/s^2")
        yield self._limited(acceleration, "acceleration")
        swing = vehicles.figure(vehicles.swing, members, f"{name}: swing along the track", "rad")
        yield self._limited(swing, "swing")
        yield vehicles.figure(vehicles.contact_force, members, f"{name}: contact force", "N")
        ratio = vehicles.figure(vehicles.tension_ratio, members, f"{name}: tension over transverse load", "-")
        yield self._limited(ratio, "tension_per_transverse_load", "at least")
        height = vehicles.figure(vehicles.clearance, members, f"{name}: clearance over the terrain", "m", "x")
        yield self._limited(height, "vehicle_clearance", "at least")
        yield from self._of_stop(name)

    def _limited(self, figure: KeyFigure, key: str, bound: Bound = "at most") -> KeyFigure:
        """The figure with the limit of the scenario, and where that comes from."""
        limits = self._scenario.limits
        limit = getattr(limits, key)
        own = limit != type(limits).model_fields[key].default
        if key == "rope_safety_factor" and self._scenario.drives and not own:
            limit = HAUL_ROPE_SAFETY_FACTOR
        return with_limit(figure, limit, f"scenario: limits.{key}" if own else SOURCES.get(key, ""), bound)


__all__ = ["SOURCES", "KeyFigures"]
