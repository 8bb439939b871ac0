"""Scenario of a lift with a moving haul rope from a surveyed line: fixed-grip chairs or detachable cabins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey.marked import Marked, assumed, derived, given_number
from cable_twin.offline.survey.profile import Survey, SurveyError
from cable_twin.offline.survey.stations import Ends, bends, given_rope, lower_first, rope_keys, tower_keys
from cable_twin.scenario.spans import SpanError, Spans, spans_under_tension

GRAVITY = 9.81  # m/s^2
FACTOR, MARGIN = 4.5, 1.1  # rope safety factor, and how far above it the tension is chosen
PER_SHEAVE = 0.0225  # rad, by which the rope bends on one
LEAST_LOAD, LEAST_BARE = 500.0, 200.0  # N on each sheave with empty vehicles, on a tower with the bare rope; assumed
LEAST_SHARE, TRIED = 0.4, 61  # of the tension that the rope can bear
PLACED = 41  # places of the vehicles, of which the worst for a tower is taken


@dataclass(frozen=True, slots=True)
class LiftKind:
    """Usual, assumed properties of a kind of lift: rope, bullwheels, speed, vehicles, sheaves."""

    what: str
    vehicle: str  # as commands call it
    grip: str
    rope: Mapping[str, float]
    rope_why: str
    wheel: float  # m, radius of bullwheels
    inertia: tuple[float, float]  # kg m^2, of the driven bullwheel and the other
    speed: float  # m/s
    acceleration: float  # m/s^2
    interval: float  # s, between vehicles
    bodies: Mapping[str, Any]
    empty: float  # kg
    capacity: float  # kg
    capacity_why: str
    sheaves: tuple[int, float, float]  # least number on a tower, m between them, m radius of their circle
    elements: Mapping[str, float]
    clearance: float  # m, least of vehicles over the ground
    extra: Mapping[str, Any] = field(default_factory=dict)


CHAIRLIFT = LiftKind(
    what="Fixed-grip chairlift",
    vehicle="chair",
    grip="fixed",
    rope={
        "mass_per_length": 6.1,
        "axial_stiffness": 62.0e6,
        "bending_stiffness": 3.0e3,
        "breaking_force": 0.96e6,
        "diameter": 0.040,
    },
    rope_why="40 mm, six strands, 620 mm^2, E = 100 GPa, wires of 1770 N/mm^2 less 12.5 %",
    wheel=2.1,
    inertia=(40.0e3, 8.0e3),
    speed=2.3,
    acceleration=0.15,
    interval=12.0,
    bodies={
        "chair": {
            "mass": 250.0,
            "inertia": 250.0,
            "upper_pivot": [0.0, 2.6],
            "size": [0.8, 1.6],
            "drag_area": 2.1,
            "damping": 210.0,
        }
    },
    empty=250.0,
    capacity=300.0,
    capacity_why="four people of 75 kg",
    sheaves=(8, 0.5625, 25.0),
    elements={"target": 12.0, "at_towers": 0.75, "growth": 4.0},
    clearance=2.5,
)
GONDOLA = LiftKind(
    what="Detachable gondola lift",
    vehicle="cabin",
    grip="detachable",
    rope={
        "mass_per_length": 9.4,
        "axial_stiffness": 97.0e6,
        "bending_stiffness": 7.5e3,
        "breaking_force": 1.58e6,
        "diameter": 0.050,
    },
    rope_why="50 mm, six strands, 970 mm^2, E = 100 GPa, wires of 1860 N/mm^2 less 12.5 %",
    wheel=2.5,
    inertia=(90.0e3, 20.0e3),
    speed=6.0,
    acceleration=0.25,
    interval=20.0,
    bodies={
        "hanger": {"mass": 250.0, "inertia": 213.0, "upper_pivot": [0.0, 1.6], "lower_pivot": [0.0, -1.6]},
        "cabin": {"mass": 600.0, "inertia": 442.0, "upper_pivot": [0.0, 1.1], "size": [2.0, 2.2], "drag_area": 4.4},
    },
    empty=850.0,
    capacity=750.0,
    capacity_why="ten people of 75 kg",
    sheaves=(16, 0.625, 40.0),
    elements={"target": 20.0, "at_towers": 0.4, "growth": 3.0},
    clearance=2.5,
)


def lift_scenario(survey: Survey, ends: Ends, kind: LiftKind, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Make the scenario of a lift from a survey, as nested mappings with notes on value origins.

    Args:
        survey: terrain and towers.
        ends: where the rope leaves both stations.
        kind: usual figures of the kind of lift.
        changes: given values by dotted key, used where other values are derived from them.

    Raises:
        SurveyError: a given value is no number above 0, or the rope of the kind cannot carry the lift; one line.
    """
    upwards = ends.end[1] >= ends.start[1]
    corner = lower_first(survey, ends)
    speed = given_number(changes, "sheaves.drive.drive.limits.speed", kind.speed)
    rough = 2.0 * float(np.hypot(*np.diff(corner, axis=0).T).sum() + np.pi * kind.wheel)
    usual = max(2, round(rough / (speed * kind.interval)))
    count = max(1, int(given_number(changes, "carriers.count", usual)))
    rope = given_rope(kind.rope, "ropes.up", changes)
    loads = (count / rough * (kind.empty + kind.capacity), count / rough * kind.empty, 0.0)
    weights = [GRAVITY * (rope["mass_per_length"] + load) for load in loads]
    holds = [tower.hold_down for tower in survey.towers][:: 1 if upwards else -1]
    sheaves = [tower.contacts or kind.sheaves[0] for tower in survey.towers][:: 1 if upwards else -1]
    names = [tower.name for tower in survey.towers][:: 1 if upwards else -1]
    heavy = GRAVITY * (kind.empty + kind.capacity), GRAVITY * kind.empty
    towers = Assemblies(names, holds, sheaves, rough / count, *heavy)
    try:
        mass, ways, strands = _tensioned(corner, rope, weights, towers, changes)
    except SpanError as error:
        raise SurveyError(f"{kind.what}: {error}") from None
    length = derived(
        round(float(np.mean([one.length.sum() for one in strands])), 2),
        "closed form: the counterweight is then near the middle of its travel, full up and empty down",
    )
    travel = round(max(4.0, 0.004 * length.value), 1)
    outwards = -ways / np.hypot(*ways) * [1.0 if upwards else -1.0, 1.0]
    per_hour = round(3600.0 * count * speed / rough * kind.capacity / 75.0, -1)
    tree: dict[str, Any] = {
        "description": f"{kind.what} from a survey: {rough / 2:.0f} m, {len(survey.towers)} towers, {count} "
        f"{kind.vehicle}s, about {per_hour:.0f} people an hour",
        "gravity": GRAVITY,
        "ropes": {
            name: _rope(kind, rope, length, 1.0 if name == "up" else -1.0, ends, upwards == (name == "up"))
            for name in ("up", "down")
        },
        "sheaves": _sheaves(kind, speed, mass, [round(float(one), 3) for one in outwards], travel),
        "towers": _towers(survey, kind, corner, strands, upwards),
        "terrain": survey.terrain.tolist(),
        "air": {"density": assumed(1.1, "kg/m^3, at 1000 m of altitude (standard atmosphere)")},
        "carriers": {
            "name": kind.vehicle,
            "count": derived(count, "given")
            if "carriers.count" in changes
            else assumed(count, f"one every {kind.interval:g} s at {speed:g} m/s"),
            **(
                {"station_rails": assumed(12.0, "m, over which the rope takes a cabin over")}
                if kind.grip == "detachable"
                else {}
            ),
            "bodies": {
                name: {key: assumed(value, f"usual {kind.vehicle}") for key, value in body.items()}
                for name, body in kind.bodies.items()
            },
            "payload": {
                "capacity": assumed(kind.capacity, f"kg, {kind.capacity_why}"),
                "leaving": assumed({"return": kind.capacity, "drive": 0.0}, "kg, full up, empty down"),
            },
        },
        "limits": {
            "rope_safety_factor": assumed(FACTOR, "haul rope: 4.5 to 5"),
            "swing": assumed(0.35, "rad"),
            "vehicle_clearance": assumed(kind.clearance, "m, over the ground"),
        },
        "solver": {"step": assumed(0.01, "s"), "tolerance": assumed(3e-6, "m")},
    }
    return tree


def tension_for(corner: FloatArray, rope: Mapping[str, float], weight: float, factor: float = FACTOR * MARGIN) -> float:
    """Tension (N) at the lower end of a rope at which its largest tension has exactly the given safety factor.

    Args:
        corner: (spans + 1, 2) m, supports from the lower end on.
        rope: `breaking_force` and `axial_stiffness` in N.
        weight: N/m, with the vehicles on it.
        factor: safety factor.

    Raises:
        SpanError: the rope would have to be in compression.
    """
    most = rope["breaking_force"] / factor
    tension = most - weight * float(corner[:, 1].max() - corner[0, 1])
    for _ in range(3):
        if tension <= 0.0:
            text = f"a rope of {rope['breaking_force'] / 1e3:.0f} kN does not carry {weight:.0f} N/m up"
            raise SpanError(
                f"{text} {corner[:, 1].max() - corner[0, 1]:.0f} m with a safety factor of {factor:.3g}; "
                "allowed: a stronger rope, fewer vehicles, or `--units ft` if the survey is in feet"
            )
        spans = spans_under_tension(corner, tension, weight, rope["axial_stiffness"])
        tension += most - float(spans.tension.max())
    return tension


class Assemblies(NamedTuple):
    """Sheave assemblies of the towers of a lift, from the lower station on, with spacing and weights of vehicles."""

    names: Sequence[str]
    hold_down: Sequence[bool | None]  # None: not known
    sheaves: Sequence[int]
    spacing: float = 0.0  # m, of the vehicles; 0: their weight is taken as even
    full: float = 0.0  # N, weight of a full vehicle
    empty: float = 0.0  # N, of an empty one

    def excess(self, corner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Highest and lowest tower loads (towers,) by passing vehicles of unit weight, minus those of an even load."""
        if self.spacing == 0.0:
            return np.zeros(len(self.names)), np.zeros(len(self.names))
        lengths = np.linalg.norm(np.diff(corner, axis=0), axis=1).tolist()
        spans = pairwise([round(length, 1) for length in lengths])
        pairs = [_excess(before, after, self.spacing) for before, after in spans]
        most, least = np.array(pairs).T
        return most, least


class Chosen(NamedTuple):
    """Tension chosen for the rope of a lift.

    Attributes:
        tension: N, at the lower end.
        why: deciding condition, or what no tension keeps, and by how much this one misses it.
        misses: name of the tower that misses most; empty if all conditions are kept.
    """

    tension: float
    why: str
    misses: str


def choose_tension(
    corner: FloatArray,
    rope: Mapping[str, float],
    weights: Sequence[float],
    towers: Assemblies,
    factor: float = FACTOR * MARGIN,
) -> Chosen:
    """Choose the highest tension of a lift's rope that keeps its safety factor and the minimum loads on all towers.

    If none keeps all, it is the highest of those that hold the rope on most towers, of them with least loads on most.

    Args:
        corner: (spans + 1, 2) m, supports from the lower end on.
        rope: `breaking_force` and `axial_stiffness` in N.
        weights: N/m, of the rope with full vehicles, with empty ones, and bare.
        towers: sheave assemblies.
        factor: safety factor of the rope.

    Raises:
        SpanError: the rope is too weak.
    """
    most = tension_for(corner, rope, weights[0], factor)
    by_strength = f"safety factor {factor:.3g} of {rope['breaking_force'] / 1e3:.0f} kN, full up"
    if not towers.names:
        return Chosen(most, by_strength, "")
    tried: list[Tried] = []
    for share in np.linspace(1.0, LEAST_SHARE, TRIED):
        try:
            loads = tower_margins(corner, share * most, rope["axial_stiffness"], weights, towers)
        except SpanError:
            break
        tried.append(Tried(float(share * most), loads))
        if np.min(loads) >= 0.0:
            break
    if not tried:
        return Chosen(most, by_strength, "")
    best = max(range(len(tried)), key=lambda row: (*_kept(tried[row].loads), -row))
    if np.min(tried[best].loads) < 0.0:
        return _least_missed(tried, best, towers.names)
    if best == 0:
        return Chosen(most, by_strength, "")
    touches, presses = tried[best - 1].loads  # with a little more
    name = towers.names[int((touches if touches.min() < 0.0 else presses).argmin())]
    return Chosen(tried[best].tension, f"least load of {name}: with more it would not be kept", "")


class Tried(NamedTuple):
    """Tension tried (N), and margins of tower loads with it as of `tower_margins`."""

    tension: float
    loads: tuple[FloatArray, FloatArray]


def _kept(loads: tuple[FloatArray, FloatArray]) -> tuple[int, int, int]:
    """Numbers of towers with the rope on them at all, with its least load, and with the least load of their sheaves."""
    touches, presses = loads
    on = touches >= 0.0
    return int((touches >= -LEAST_BARE).sum()), int(on.sum()), int((on & (presses >= 0.0)).sum())


def _least_missed(tried: Sequence[Tried], best: int, names: Sequence[str]) -> Chosen:
    """Tension in row `best` of tensions none of which keeps all towers, with the one of `names` that misses most."""
    loads = tried[best].loads
    off = loads[0].min() < 0.0
    row = 0 if off else 1
    worst, kept = int(loads[row].argmin()), _kept(loads)[1 + row]
    never = max(float(one.loads[row][worst]) for one in tried) < 0.0
    what = "the rope on" if off else f"{with_unit(LEAST_LOAD, 'N')} on each sheave of"
    missed = f"{-loads[row][worst]:.0f} N" + ("" if never else f" on {names[worst]}")
    none = f"no tension keeps {what} {names[worst] if never else 'all towers'}"
    why = f"{none}, this keeps {kept} of {len(names)} towers and misses by {missed}"
    return Chosen(tried[best].tension, why, names[worst])


@lru_cache(maxsize=4096)
def _excess(before: float, after: float, spacing: float) -> tuple[float, float]:
    """Extreme loads on a tower by unit loads, at a spacing (m), passing both its spans (m), minus the mean load."""
    first = np.linspace(0.0, spacing, PLACED)[:, None] - spacing * ceil(before / spacing)
    places = first + spacing * np.arange(ceil(before / spacing) + ceil(after / spacing) + 1)
    shares = np.where(places < 0.0, 1.0 + places / before, 1.0 - places / after).clip(min=0.0).sum(axis=1)
    mean = 0.5 * (before + after) / spacing
    return float(shares.max() - mean), float(shares.min() - mean)


class Margin(NamedTuple):
    """Least margins (N) of tower loads over required ones, in order of importance, and the tower with the least."""

    touches: float  # over what keeps the rope on the tower: bare on supports, with full vehicles below hold-downs; or 0
    presses: float  # over the least load of all its sheaves
    name: str


def tower_margin(
    corner: FloatArray, tension: float, stiffness: float, weights: Sequence[float], towers: Assemblies
) -> Margin:
    """Least margins of the loads of all towers of a lift, with the tower that has the least.

    Args:
        corner: (spans + 1, 2) m, supports from the lower end on.
        tension: N, at the lower end.
        stiffness: N, EA.
        weights: N/m, of the rope with full vehicles, with empty ones, and bare.
        towers: sheave assemblies.

    Raises:
        SpanError: the rope does not reach.
    """
    if not towers.names:
        return Margin(0.0, 0.0, "")
    touches, presses = tower_margins(corner, tension, stiffness, weights, towers)
    worst = int((touches if touches.min() < 0.0 else presses).argmin())
    return Margin(min(0.0, float(touches.min())), float(presses.min()), towers.names[worst])


def tower_margins(
    corner: FloatArray, tension: float, stiffness: float, weights: Sequence[float], towers: Assemblies
) -> tuple[FloatArray, FloatArray]:
    """Margins (towers,) in N of tower loads: over the load that keeps the rope on, and over least sheave loads.

    Args:
        corner: (spans + 1, 2) m, supports from the tensioned end on.
        tension: N, at the tensioned end.
        stiffness: N, EA.
        weights: N/m, of the rope with full vehicles, with empty ones, and bare.
        towers: sheave assemblies.

    Raises:
        SpanError: the rope does not reach.
    """
    full, empty, bare = (-spans_under_tension(corner, tension, weight, stiffness).loads()[:, 1] for weight in weights)
    most, least = towers.excess(corner)
    full, empty = full + towers.full * most, empty + towers.empty * least
    holds = np.array([load < 0.0 if one is None else one for one, load in zip(towers.hold_down, full, strict=True)])
    touches = np.where(holds, -full, bare) - LEAST_BARE
    presses = np.where(holds, -full, empty) - LEAST_LOAD * np.array(towers.sheaves)
    return touches, presses


def _tensioned(
    corner: FloatArray,
    rope: Mapping[str, float],
    weights: Sequence[float],
    towers: Assemblies,
    changes: Mapping[str, Any],
) -> tuple[Marked, FloatArray, list[Spans]]:
    """Counterweight (kg) of a lift, sum (2,) of the unit vectors of both strands from its sheave, and their spans.

    Args: as of `choose_tension`, and given values by dotted key.

    Raises:
        SurveyError: the given mass is no number above 0; one line.
        SpanError: the rope is too weak, or does not reach.
    """
    key = "sheaves.return.counterweight.mass"
    chosen = choose_tension(corner, rope, weights, towers)
    given = given_number(changes, key, 0.0) if key in changes else None
    tension = chosen.tension if given is None else 0.5 * GRAVITY * given

    def strands(tension: float) -> tuple[list[Spans], FloatArray]:
        found = [spans_under_tension(corner, tension, weight, rope["axial_stiffness"]) for weight in weights[:2]]
        return found, np.sum([one.pull[0] / np.hypot(*one.pull[0]) for one in found], axis=0)

    _, ways = strands(tension)
    mass = round(float(np.hypot(*ways)) * tension / GRAVITY, -2) if given is None else given
    tension = mass * GRAVITY / float(np.hypot(*ways))
    found, ways = strands(tension)
    if given is not None:
        return derived(mass, "given"), ways, found
    if not chosen.misses:
        return derived(mass, f"kg, both strands: {chosen.why}"), ways, found
    helps = f"{chosen.misses} at another height (design --for towers), or another tension (--set {key}=KG)"
    why = f"kg, both strands, {with_unit(tension, 'N')} in the rope: {chosen.why}; allowed: {helps}"
    return Marked(mass, why, assumed=False, misses=True), ways, found


def _rope(
    kind: LiftKind, rope: Mapping[str, float], length: Marked, side: float, ends: Ends, forward: bool
) -> dict[str, Any]:
    first, last = (ends.start, ends.end) if forward else (ends.end, ends.start)
    whys = (ends.start_why, ends.end_why) if forward else (ends.end_why, ends.start_why)
    return {
        **rope_keys(rope, kind.rope, kind.rope_why),
        "unstrained_length": length,
        "lateral": derived(side * kind.wheel, "m, radius of the bullwheels: for the pictures"),
        "elements": assumed(dict(kind.elements), "lengths in m, short on trains of sheaves"),
        "damping_time": assumed(0.004, "s, a damping ratio of 0.4 % at 2 rad/s"),
        "start": {"position": Marked(list(first), *whys[0])},
        "end": {"position": Marked(list(last), *whys[1])},
    }


def _sheaves(kind: LiftKind, speed: float, mass: Marked, direction: list[float], travel: float) -> dict[str, Any]:
    wheel = assumed(kind.wheel, f"m, {2 * kind.wheel / kind.rope['diameter']:.0f} diameters of the rope across")
    lining = assumed(0.22, "lining of rubber")
    return {
        "drive": {
            "radius": wheel,
            "joins": assumed(["up.end", "down.start"], "driven in the upper station"),
            "friction": lining,
            "inertia": assumed(kind.inertia[0], "kg m^2, wheel, motor and gear"),
            "rollback": assumed(0.5, "m, so far back, and an emergency stop begins"),
            "drive": {
                "name": "haul_rope",
                "limits": {
                    "speed": assumed(speed, f"m/s, usual with {kind.grip} grips"),
                    "acceleration": assumed(kind.acceleration, "m/s^2, 0.1 to 0.3 are common"),
                    "jerk": assumed(0.3, "m/s^3"),
                    "emergency_deceleration": assumed(1.2, "m/s^2, 1 to 1.5 are common"),
                },
            },
        },
        "return": {
            "radius": wheel,
            "joins": assumed(["down.end", "up.start"], "tensioned in the lower station"),
            "friction": lining,
            "inertia": assumed(kind.inertia[1], "kg m^2"),
            "counterweight": {
                "direction": derived(direction, "along the rope, in the mean of both strands"),
                "mass": mass,
                "travel": assumed([-travel, travel], "m"),
            },
        },
    }


def _towers(survey: Survey, kind: LiftKind, corner: FloatArray, strands: list[Spans], upwards: bool) -> dict[str, Any]:
    """Scenario section of the towers of a lift: sheaves by the bend of the loaded rope, hold-downs against lift-off."""
    loads = np.array([-one.loads()[:, 1] for one in strands])[:, :: 1 if upwards else -1]
    turns = np.max([bends(one) for one in strands], axis=0)[:: 1 if upwards else -1]
    found: dict[str, Any] = {}
    least, pitch, radius = kind.sheaves
    for tower, load, turn in zip(survey.towers, loads.T, turns, strict=True):
        own = tower_keys(tower, max(least, 2 * ceil(0.6 * turn / PER_SHEAVE)), pitch, radius)
        own["stiffness"] = assumed(0.3e6, "N/m, liners and rockers yield")
        own["ropes"] = {"up": {}, "down": {}}
        pressed = bool(load.max() < 0.0)
        if tower.hold_down or (tower.hold_down is None and pressed):
            why = "the rope would lift off otherwise" if tower.hold_down is None else "survey"
            own["hold_down"] = Marked(True, why, assumed=tower.hold_down is None)
        found[tower.name] = own
    return found
