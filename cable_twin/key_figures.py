"""Key figures of a run, gathered from snapshot to snapshot: live in the node, or afterwards from a log.

Each has its standard name, value, unit, limit and the source of the limit, and says when and where it was reached.
Carriers of one kind share their figures, which are those of the worst of them, named in the place. The cost and the
memory of an update do not grow with the run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from cable_twin.clearance import find_clearance
from cable_twin.extremes import Extremes, Stops
from cable_twin.outlines import body_outlines
from cable_twin.records import AppliedCommand, CableSamples, FloatArray, Place, Snapshot
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Limits

Bound = Literal["at most", "at least"]
CLEARANCE_PERIOD = 0.1  # s of simulated time between two looks at the clearance
TOLERANCE = 1e-3  # of a limit
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


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One figure with its limit."""

    name: str
    value: float
    unit: str
    time: float  # s, when it was reached
    place: str = ""  # where, with unit
    limit: float | None = None
    bound: Bound = "at most"
    source: str = ""  # of the limit

    @property
    def kept(self) -> bool | None:
        """Whether the limit is kept, to a thousandth of it, as a drive keeps its speed; None without a limit."""
        if self.limit is None:
            return None
        beyond = self.value - self.limit if self.bound == "at most" else self.limit - self.value
        return beyond <= TOLERANCE * abs(self.limit)


class KeyFigures:
    """Gathers the key figures of one run.

    Args:
        scenario: what runs; its `limits` and the limits of its drives are those of the figures.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._vehicles = _Vehicles(scenario)
        self._tension, self._slackest = Extremes(), Extremes(sign=-1.0)
        self._first_tension = math.nan  # N, highest of the first snapshot
        self._sag = Extremes(len(scenario.towers) + 1)
        names = ("start", "end", *scenario.towers)
        self._supports = {name: number for number, name in enumerate(names)}
        self._highest_load, self._lowest_load = Extremes(len(names)), Extremes(len(names), -1.0)
        self._margin = Extremes(len(names), -1.0)
        self._farthest, self._nearest = Extremes(len(names)), Extremes(len(names), -1.0)  # of counterweights
        self._drives = list(scenario.drives)
        self._drive = _DriveExtremes(len(self._drives))
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
        highest = _figure(self._tension, 0, "rope tension, highest", "N")
        yield highest
        yield _figure(self._slackest, 0, "rope tension, lowest", "N")
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
            yield self._limited(_figure(self._sag, number, name, "m", "x"), "sag")
        clearance = _figure(self._rope_clearance, 0, "rope clearance over the terrain", "m", "x")
        yield self._limited(clearance, "rope_clearance", "at least")

    def _of_supports(self) -> Iterator[KeyFigure]:
        cable = self._scenario.cable
        for name, number in self._supports.items():
            load = _figure(self._highest_load, number, f"{name}: support load, highest", "N")
            yield self._limited(load, "support_load")
            yield _figure(self._lowest_load, number, f"{name}: support load, lowest", "N")
            margin = _figure(self._margin, number, f"{name}: deropement margin, load over that at rest", "-")
            yield self._limited(margin, "deropement_margin", "at least")
            low, high = None, None
            if name in ("start", "end"):
                low, high = getattr(cable, name).travel or (None, None)
            source = f"scenario: cable.{name}.travel"
            farthest = _figure(self._farthest, number, f"{name}: counterweight travel, highest", "m")
            yield _with_limit(farthest, high, source)
            nearest = _figure(self._nearest, number, f"{name}: counterweight travel, lowest", "m")
            yield _with_limit(nearest, low, source, "at least")

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
        return _with_limit(figure, limit, f"scenario: limits.{key}" if own else SOURCES.get(key, ""), bound)


class _DriveExtremes:
    """Speed, force and power of several drives."""

    def __init__(self, count: int) -> None:
        self.speed, self._force = Extremes(count), Extremes(count)
        self._power, self._braking_power = Extremes(count), Extremes(count, -1.0)

    def update(self, time: float, places: FloatArray, speeds: FloatArray, forces: FloatArray) -> None:
        power = forces * speeds
        self.speed.update(np.abs(speeds), time, places)
        self._force.update(np.abs(forces), time, places)
        self._power.update(power, time, places)
        self._braking_power.update(power, time, places)

    def figures(
        self, name: str, index: int, limits: Limits, source: str, at: str = "arc length"
    ) -> Iterator[KeyFigure]:
        speed = _figure(self.speed, index, f"{name}: speed", "m/s", at)
        yield _with_limit(speed, limits.speed, f"{source}.speed")
        force = _figure(self._force, index, f"{name}: drive force", "N", at)
        yield _with_limit(force, limits.force, f"{source}.force")
        highest = _figure(self._power, index, f"{name}: drive power, highest", "W", at)
        yield _with_limit(highest, limits.power, f"{source}.power")
        lowest = _figure(self._braking_power, index, f"{name}: drive power, lowest", "W", at)
        yield _with_limit(lowest, None if limits.power is None else -limits.power, f"{source}.power", "at least")


class _Vehicles:
    """What is gathered of all vehicles, an entry each; those off the cable do not count.

    Nor do forces and accelerations of a carrier on the first and the last element of a moving cable: the end of the
    model is a point, and a mass that moves over it a singular load, where a ropeway has the rails of a station.
    """

    def __init__(self, scenario: Scenario) -> None:
        cable, self._names = scenario.cable, list(scenario.vehicles)
        clamped = np.array([vehicle.joint == "clamped" for vehicle in scenario.vehicles.values()])
        self._rails = np.where(clamped, cable.unstrained_length / cable.elements, -math.inf)  # m from either end
        self._length = cable.unstrained_length
        count = len(self._names)
        self.drive = _DriveExtremes(count)
        self.swing, self.acceleration, self.contact_force = Extremes(count), Extremes(count), Extremes(count)
        self.tension_ratio, self.clearance = Extremes(count, -1.0), Extremes(count, -1.0)
        self._passed: list[tuple[float, FloatArray]] = []  # time, places of the last bodies (count, 2), two frames

    def forget(self) -> None:
        """The state was put back to the start: nothing before it is a part of the motion."""
        self._passed = []

    def update(self, snapshot: Snapshot) -> None:
        if not self._names:
            return
        time, cable = snapshot.time, snapshot.cable
        states = [snapshot.carriages[name] for name in self._names]
        bodies = [list(state.bodies.values())[-1] for state in states]
        rows = np.array(
            [
                (
                    state.arc_length,
                    state.speed,
                    state.drive_force,
                    state.contact_force[0],
                    state.contact_force[-1],
                    body.x,
                    body.z,
                    body.pitch,
                )
                for state, body in zip(states, bodies, strict=True)
            ]
        )
        rows[[not state.attached for state in states]] = math.nan
        places, speeds, drive_forces, force_x, force_z, body_x, body_z, pitches = rows.T
        self.drive.update(time, places, speeds, drive_forces)
        on_rails = np.minimum(places, self._length - places) < self._rails
        for signal in (force_x, force_z, body_x, body_z):
            signal[on_rails] = math.nan
        self.contact_force.update(np.hypot(force_x, force_z), time, places)
        self.swing.update(np.abs(pitches), time, places)
        self.tension_ratio.update(_tension_ratios(cable, places, force_x, force_z), time, places)
        self._accelerate(time, np.column_stack([body_x, body_z]), places)

    def _accelerate(self, time: float, bodies: FloatArray, places: FloatArray) -> None:
        """Second difference of the places of the last bodies over three frames of equal spacing."""
        if len(self._passed) == 2:
            (first_time, first), (middle_time, middle) = self._passed
            period = time - middle_time
            if period > 0.0 and abs(middle_time - first_time - period) < 1e-6 * period:
                across = bodies - 2.0 * middle + first
                self.acceleration.update(np.hypot(across[:, 0], across[:, 1]) / period**2, middle_time, places)
        self._passed = [*self._passed[-1:], (time, bodies)]

    def update_clearance(self, time: float, found: Mapping[str, Place]) -> None:
        places = [found.get(name) for name in self._names]
        heights = [math.nan if place is None else place.height for place in places]
        self.clearance.update(heights, time, np.array([math.nan if place is None else place.x for place in places]))

    def figure(
        self, extremes: Extremes, members: Sequence[int], name: str, unit: str, at: str = "arc length"
    ) -> KeyFigure:
        """Figure of the worst of some vehicles, which is named where there are several."""
        worst = extremes.worst(list(members))
        figure = _figure(extremes, worst, name, unit, at)
        return figure if len(members) == 1 else replace(figure, place=f"{self._names[worst]}, {figure.place}")


def _tension_ratios(cable: CableSamples, places: FloatArray, force_x: FloatArray, force_z: FloatArray) -> FloatArray:
    """Tension over the part of a force (N) across the rope, at arc lengths (n,) in m; NaN without any."""
    x, z, last = cable.positions[:, 0], cable.positions[:, -1], len(cable.arc_lengths) - 1
    after = np.clip(np.searchsorted(cable.arc_lengths, places), 1, last)
    # beside the kink at the joint, from the sample before to the one after
    before, beyond = after - 1, np.minimum(after + 1, last)
    along_x, along_z = x[beyond] - x[before], z[beyond] - z[before]
    across = np.abs(along_x * force_z - along_z * force_x) / np.hypot(along_x, along_z)
    tensions = np.interp(places, cable.arc_lengths, cable.tensions)
    return np.divide(tensions, across, out=np.full(len(places), math.nan), where=across > 0.0)


def _figure(extremes: Extremes, index: int, name: str, unit: str, at: str = "arc length") -> KeyFigure:
    """The figure without a limit; NaN where there never was a value."""
    place = extremes.places[index]
    return KeyFigure(
        name,
        extremes.value(index),
        unit,
        float(extremes.times[index]),
        "" if math.isnan(place) else f"{at} {place:.1f} m",
    )


def _with_limit(figure: KeyFigure, limit: float | None, source: str, bound: Bound = "at most") -> KeyFigure:
    return figure if limit is None else replace(figure, limit=limit, bound=bound, source=source)


__all__ = ["SOURCES", "KeyFigure", "KeyFigures"]
