"""Static effects of payloads, friction, ice and counterweights on tower and drive forces of a line with carriers.

A weight between two supports rests on both by the law of the lever, as a counterweight keeps the tension constant. Its
component along the rope is carried by all that is farther from the tensioned end, taken to be the lower one: by the
drive, and by towers as far as the line bends there.

Carriers on a track rope hang from two ropes that have one shape: the weight across it is borne by track rope (1) and
haul rope (2) in the ratio of their tensions T, and that along it by the haul rope. A tower bends rope k by
β_k = R_k / T_k, R_k its load there. Weights Q on both ropes, and tensions that grow by ΔT_k, bend both by Δβ more,

    (T_1 + T_2) Δβ = Q + b (ΔT_1 + ΔT_2) - β_1 ΔT_1 - β_2 ΔT_2 ,    ΔR_k = β_k ΔT_k + T_k Δβ ,

b the bend of the line from support to support. On one rope this is ΔR = Q + b ΔT.

How large the effect of all payloads is on each tower and drive, and what ice and counterweights do, is taken from rests
of the model: as planned, with other payloads, with ice, and with each counterweight heavier. The laws above say how it
is divided among the carriers, wherever they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.on_rope.rails import share_on_rails
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.solution.bundle.clamp import rail_share
from cable_twin.scenario import Scenario, command_limits, load_scenario
from cable_twin.scenario.builders.system import tower_friction
from cable_twin.simulation import Simulation

ICE, HEAVIER = 1.0, 0.01  # kg/m, and share of a counterweight, with which a rest is compared
PAYLOAD, EMPTY = 0.4, 0.15  # of the capacity, standard deviation of a payload from the plan, and of one that is empty
LEAST = 0.3  # of effects that do not cancel each other, from which on they are compared with a rest
SIZES = 0.8, 1.25  # least and most that a rest counts for more or less than the laws
ERROR, ERROR_OF_TWO = 0.03, 0.1  # share of an effect by which it is wrong; of towers beside those of another rope
BESIDE = 6.0  # m along the track, within which towers of two ropes stand at one place

Place = tuple[float, float]  # m, along the track and up


class _Tower(NamedTuple):
    """Tower of a rope with its friction and the places of the supports before and after it."""

    rope: int
    before: Place  # of the support with the lesser place along the track
    place: Place
    after: Place
    friction: float
    half_length: float  # m, of its sheaves or saddle

    @property
    def bend(self) -> float:
        """Angle (rad) by which the line from support to support bends downwards over the tower."""
        (x0, z0), (x1, z1), (x2, z2) = self.before, self.place, self.after
        return float(np.arctan2(z1 - z0, x1 - x0) - np.arctan2(z2 - z1, x2 - x1))


class _Rope(NamedTuple):
    """Rope of a line: its supports and the carriers that it bears or pulls."""

    profile: list[Place]  # m, of its supports
    length: float  # m, unstrained
    ends: tuple[int, int]  # rows of the supports at its ends
    carriers_of: int  # rope along which carriers that this one bears or pulls are counted: itself, or a track rope
    is_track: bool  # it lies still, and bears weights only across itself
    rolling: float  # -, rolling friction of carriers on it

    def slopes(self, along: FloatArray) -> FloatArray:
        """Sines (n,) of its slope from support to support at places (m) along the track."""
        places = sorted(self.profile)
        spans = np.diff(np.array(places), axis=0)
        number = np.clip(np.searchsorted([place[0] for place in places], along) - 1, 0, len(spans) - 1)
        slopes: FloatArray = spans[number, 1] / np.hypot(spans[number, 0], spans[number, 1])
        return slopes


class Carried(NamedTuple):
    """Static effects of payloads, friction and ice on one sensor's value."""

    payloads: FloatArray  # (carriers,) N/kg
    friction: float  # N, of the friction of all towers as a share of that of the scenario
    rolling: float  # N, of the rolling friction of carriers on track ropes, a coefficient
    ice: float  # N m/kg, of ice on all ropes
    counterweights: FloatArray  # (counterweights,) N/kg


class LineStatics:
    """Static effects of payloads, friction and ice on the towers and drives of a line with carriers.

    Attributes:
        towers: names of the towers of all ropes.
        counterweights: mass (kg) of each by name of its sheave.
        errors: error of the effect of a payload on each of them in a window of a second, as a share of the effect.

    Args:
        scenario: with carriers.
        start: snapshot of the scenario at its start.
    """

    def __init__(self, scenario: Scenario, start: Snapshot) -> None:
        layout = start.layout
        self._gravity = scenario.gravity
        self._rows = np.array([layout.vehicle_rows[name] for name in layout.carriers])
        self._supports = layout.support_rows
        self._drives = layout.drive_rows
        self._rails = 0.0 if scenario.carriers is None else scenario.carriers.station_rails
        self._towers: dict[str, _Tower] = {}
        self._ropes: list[_Rope] = []
        for row, rope in enumerate(scenario.cables):
            self._add(scenario, rope, row)
        self.towers = tuple(self._towers)
        self._beside = {name: self._partner(name) for name in self.towers}
        keys = counterweight_keys(scenario)
        self.counterweights = {name: mass for name, (_, mass) in keys.items()}
        self.errors = {name: ERROR if beside is None else ERROR_OF_TWO for name, beside in self._beside.items()}
        self._measure(scenario, start, keys)

    def _measure(self, scenario: Scenario, start: Snapshot, counterweights: Mapping[str, tuple[str, float]]) -> None:
        """Compare the effects of payloads, ice and counterweights, by key and mass (kg), with rests of the model."""
        sensors = (*self.towers, *self._drives)
        self._sizes, self._ice = dict.fromkeys(sensors, 1.0), dict.fromkeys(sensors, 0.0)
        self._heavier: dict[str, FloatArray] = {}
        ropes = [scenario.rope_key(name) for name in scenario.cables]
        more = {f"{key}.ice": one.ice + ICE for key, one in zip(ropes, scenario.cables.values(), strict=True)}
        heavier = [{key: (1.0 + HEAVIER) * mass} for key, mass in counterweights.values()]
        other, iced, *tightened = (
            Simulation(load_scenario(scenario.resolved(), values), samples=2).snapshot
            for values in (_other_payloads(scenario), more, *heavier)
        )
        added = HEAVIER * np.array([mass for _, mass in counterweights.values()])
        change = (other.columns.payload - start.columns.payload)[self._rows]
        for name in sensors:
            before, loaded, with_ice = (self._force(name, one) for one in (start, other, iced))
            self._ice[name] = (with_ice - before) / ICE
            self._heavier[name] = (np.array([self._force(name, one) for one in tightened]) - before) / added
            effects = self.of_tower(name, start).payloads if name in self._towers else self._along(start)
            expected = float(effects @ change)  # without friction, as a rest has none
            if abs(expected) > LEAST * float(np.abs(effects) @ np.abs(change)):
                self._sizes[name] = float(np.clip((loaded - before) / expected, *SIZES))

    def _force(self, name: str, snapshot: Snapshot) -> float:
        """Load (N) of a tower by a rope, or force of a drive."""
        if name in self._towers:
            return self._load(name, snapshot)[0]
        return float(snapshot.columns.moving_cable_force[self._drives[name]])

    def _add(self, scenario: Scenario, name: str, row: int) -> None:
        """Add a rope with its towers."""
        alone: Any = scenario.of_rope(name)
        ends = scenario.end_names(name)
        named = [(ends[0], alone.cable.start), *alone.towers.items(), (ends[1], alone.cable.end)]
        places = [(float(one.position[0]), float(one.position[-1])) for _, one in named]
        for number, (tower, one) in enumerate(named[1:-1], start=1):
            before, after = sorted((places[number - 1], places[number + 1]))
            if tower in self._supports:
                self._towers[tower] = _Tower(
                    row, before, places[number], after, tower_friction(one), 0.5 * (one.length or 0.0)
                )
        tracks: Any = scenario.carriers and scenario.carriers.tracks
        is_track = name in tracks.values()
        self._ropes.append(
            _Rope(
                places,
                float(alone.cable.unstrained_length),
                (self._supports[ends[0]], self._supports[ends[1]]),
                list(scenario.cables).index(tracks.get(name, name)),
                is_track=is_track,
                rolling=scenario.carriers.friction.rolling if is_track and scenario.carriers else 0.0,
            )
        )

    def _partner(self, name: str) -> str | None:
        """Tower beside a given one for the other rope of the same carriers; None without one."""
        one = self._towers[name]
        for other, two in self._towers.items():
            pair = self._ropes[one.rope].carriers_of == self._ropes[two.rope].carriers_of
            if pair and one.rope != two.rope and abs(one.place[0] - two.place[0]) < BESIDE:
                return other
        return None

    def clear(self, tower: str, snapshot: Snapshot, near: float) -> bool:
        """Whether no carrier is within a distance (m) along the track from a tower, nor on its sheaves or saddle."""
        one = self._towers[tower]
        here, places = self._on(one.rope, snapshot)
        return bool((np.abs(places[here > 0.0, 0] - one.place[0]) > max(near, one.half_length)).all())

    def of_tower(self, name: str, snapshot: Snapshot) -> Carried:
        """Static effects of payloads, friction and ice on the force of a tower."""
        one, beside = self._towers[name], self._beside[name]
        here, places = self._on(one.rope, snapshot)
        _, upright = self._load(name, snapshot)
        share = np.interp(places[:, 0], [one.before[0], one.place[0], one.after[0]], [0.0, 1.0, 0.0])
        weights = here * self._gravity * share * upright
        if beside is None:
            payloads = weights + one.bend * self._tightened(name, here, places)
        else:
            both = (name, beside)
            pulled = [self._tightened(tower, here, places) for tower in both]
            tensions = [self._tension(tower, snapshot) for tower in both]
            bends = [self._load(tower, snapshot)[0] / tension for tower, tension in zip(both, tensions, strict=True)]
            more = sum((one.bend - bend) * grown for bend, grown in zip(bends, pulled, strict=True))
            payloads = bends[0] * pulled[0] + tensions[0] / sum(tensions) * (weights + more)
        return Carried(self._sizes[name] * payloads, 0.0, 0.0, self._ice[name], self._heavier[name])

    def of_drive(self, name: str, snapshot: Snapshot) -> Carried:
        """Static effects on the force of a drive: weights along the rope, friction of towers and of carriers."""
        payloads, friction, rolling, ice = self._sizes[name] * self._along(snapshot), 0.0, 0.0, self._ice[name]
        heavier = self._heavier[name].copy()
        sense = float(np.sign(snapshot.columns.drive_speed[self._drives[name]]))
        contact = snapshot.columns.contact_force[self._rows]
        for number, rope in enumerate(self._ropes):
            if rope.is_track:
                here, places = self._on(number, snapshot)
                payloads += here * sense * rope.rolling * self._gravity * np.sqrt(1.0 - rope.slopes(places[:, 0]) ** 2)
                rolling += sense * float(np.linalg.norm(contact[here > 0.0], axis=1).sum())
        loads = np.linalg.norm(snapshot.columns.support_force, axis=1)
        for tower, one in self._towers.items():
            if not self._ropes[one.rope].is_track:
                own = self.of_tower(tower, snapshot)
                payloads += sense * one.friction * own.payloads
                ice += sense * one.friction * own.ice
                heavier += sense * one.friction * own.counterweights
                friction += sense * one.friction * float(loads[self._supports[tower]])
        return Carried(payloads, friction, rolling, ice, heavier)

    def _along(self, snapshot: Snapshot) -> FloatArray:
        """Effects (carriers,) in N/kg of payloads on the force of a drive by their weight along the rope."""
        payloads = np.zeros(self._rows.size)
        for number, rope in enumerate(self._ropes):
            if number == rope.carriers_of:  # not the haul rope of a track rope
                here, places = self._on(number, snapshot)
                rising = 1.0 if rope.profile[-1][1] > rope.profile[0][1] else -1.0
                payloads += here * rising * self._gravity * np.abs(rope.slopes(places[:, 0]))
        return payloads

    def _load(self, tower: str, snapshot: Snapshot) -> tuple[float, float]:
        """Load (N) of a tower by a rope, and the cosine of its direction to the vertical."""
        force = snapshot.columns.support_force[self._supports[tower]]
        load = max(float(np.linalg.norm(force)), 1.0)
        return load, abs(float(force[2])) / load

    def _tension(self, tower: str, snapshot: Snapshot) -> float:
        """Tension (N) of the rope at a tower, in proportion to height between those at its ends."""
        one = self._towers[tower]
        rope = self._ropes[one.rope]
        ends = [float(np.linalg.norm(snapshot.columns.support_force[row])) for row in rope.ends]
        heights = [rope.profile[0][1], rope.profile[-1][1]]
        (low, at_low), (high, at_high) = sorted(zip(heights, ends, strict=True))
        return at_low + (at_high - at_low) * (one.place[1] - low) / max(high - low, 1.0)

    def _tightened(self, tower: str, here: FloatArray, places: FloatArray) -> FloatArray:
        """Growth (carriers,) of a rope's tension at a tower by payloads, N/kg; none of a track rope."""
        one = self._towers[tower]
        rope = self._ropes[one.rope]
        below = places[:, 2] < one.place[1]
        tightened: FloatArray = here * below * self._gravity * np.abs(rope.slopes(places[:, 0])) * (not rope.is_track)
        return tightened

    def _on(self, rope: int, snapshot: Snapshot) -> tuple[FloatArray, FloatArray]:
        """Shares (carriers,) of the weight of each carrier that a rope bears or pulls; positions (carriers, 3) in m.

        Rails of the stations at the ends of a rope bear the rest.
        """
        columns, one = snapshot.columns, self._ropes[self._ropes[rope].carriers_of]
        here = (columns.vehicle_rope[self._rows] == self._ropes[rope].carriers_of) & (
            columns.attached[self._rows] == 1.0
        )
        shares = here * 1.0
        for row in np.flatnonzero(here) if one.is_track or self._rails else ():
            place = columns.arc_length[self._rows[row]]
            if one.is_track:
                shares[row] -= rail_share(one.length, place)
            else:
                shares[row] -= share_on_rails(min(place, one.length - place), self._rails)
        return shares, columns.joint_position[self._rows]


def drag_of_wind(scenario: Scenario, wind: float) -> float:
    """Force (N) that wind along the track adds to that of the drive at full speed, by the drag of the carriers.

    Half of them move with the wind w, half against it. With the speed v, and a drag K u² of all at the speed u through
    the air, they need K ((v + w) |v + w| + (v - w) |v - w|) / 2, which is K v² in still air.

    Args:
        scenario: with carriers.
        wind: m/s.
    """
    assert scenario.carriers is not None
    kinds = scenario.carriers.kinds_by_path.values()
    area = max(sum(body.drag_areas[0] for body in kind.bodies.values()) for kind in kinds)
    drag = 0.5 * scenario.air.density * area * scenario.carriers.count
    speed = max(one.speed for one in command_limits(scenario).values())
    meeting = [one * abs(one) for one in (speed + wind, speed - wind)]
    return float(drag * (0.5 * sum(meeting) - speed**2))


def counterweight_keys(scenario: Scenario) -> dict[str, tuple[str, float]]:
    """Key and mass (kg) of each counterweight of the moving ropes of a scenario, by the name of its sheave."""
    found = {}
    for name, sheave in scenario.sheaves.items():
        if sheave.counterweight is not None and sheave.counterweight.mass is not None:
            found[name] = f"sheaves.{name}.counterweight.mass", float(sheave.counterweight.mass)
    return found


def _other_payloads(scenario: Scenario) -> dict[str, float]:
    """Values of a scenario by dotted key with other payloads than planned of all carriers, by as much as is usual."""
    assert scenario.carriers is not None
    found: dict[str, float] = {}
    for path, kind in scenario.carriers.kinds_by_path.items():
        if (payload := kind.payload) is None:
            continue
        planned = {f"leaving.{name}": payload.leaving.get(name, 0.0) for name in scenario.sheaves}
        planned = planned or {"from_start": payload.from_start or 0.0, "from_end": payload.from_end or 0.0}
        for key, plan in planned.items():
            doubt = (-PAYLOAD if plan > 0.0 else EMPTY) * payload.capacity
            found[".".join((*path, "payload", key))] = max(plan + doubt, 0.0)
    return found
