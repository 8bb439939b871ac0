"""Faults of plants that are followed: how soon a twin gives the alarm, and what it says.

`python -m verification.alarms` lets a twin follow plants of a scenario with another mesh and noisy sensors, into each
of which a fault is put under way, and prints a table for docs/follow.md: from when on it could be told from the sensors
(`verification.observability`; for lifts from when on it is there), how much later the alarm came and what it said, and
alarms of anything else.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.stats import chi2

from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.detectors.departures import CERTAIN
from cable_twin.ensemble.estimate.detectors.windows import SURE
from cable_twin.ensemble.estimate.quantities import QUANTISED, slow_quantities
from cable_twin.ensemble.estimate.tracker import Tracker
from cable_twin.frame.records import Command
from cable_twin.frame.sensors import LOAD_CELL, Measurement, standard_sensors
from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.builders.system import tower_friction
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification.followed import LIFTS, SCENES, Changed, Plant, Scene, Step, alarms_of, news
from verification.observability import Observable, Readings

LEFT, SPEED = 20.0, 7.0  # s, m/s: when a trip begins, and how fast it is
BOARDED, FAULT = 10.0, 50.0  # s, when payload and other faults set in
WANTED = 10.0  # s after it is observable, for an alarm
WATCHED = 35.0  # s, for which an alarm is waited for
BIAS = 5.0  # standard deviations of the noise of a sensor
LOAD = 0.05  # of the load of a lift's tower at rest, by which its load cell is wrong
SHARE = 0.15  # of the force of a drive, that is lost between it and the rope
ICE, ICING = 1.0, 60  # kg/m, and s in which it comes, in as many steps
WIND = 3.0  # m/s along the track, of all plants


class Fault(NamedTuple):
    """Fault of a plant or of its sensors."""

    name: str
    at: float  # s
    said: str  # by the alarm
    steps: Sequence[Step] = ()
    spoils: Callable[[], Changed] = lambda: lambda one: one  # sensors, anew for each run
    start: Mapping[str, Any] = {}  # values of the plant, by key
    about: str = ""  # how the estimate that tells it ends
    tolerated: Sequence[Step] = ()  # instead of `steps`: as much of it as gives no alarm
    tolerated_start: Mapping[str, Any] = {}  # likewise

    @property
    def limit(self) -> float:
        """Square of the standard deviations beyond which its alarm is given."""
        return CERTAIN**2 if self.about else float(chi2.isf(SURE, 1))


class Outcome(NamedTuple):
    """Alarms of a twin whose plant has a fault."""

    fault: Fault
    observable: Observable
    alarm: Alarm | None
    others: list[Alarm]


class Case(NamedTuple):
    """Scenario of twin and plants, with what they have otherwise."""

    planned: Mapping[str, Any]  # of both, by key
    weather: Mapping[str, Any]  # of the plant, by key
    rolling: tuple[str, ...]  # keys, of carriages or towers
    sensors: Sequence[str]  # that are spoiled
    payload: str = ""  # key; empty where that of one vehicle is no key
    ice: tuple[str, ...] = ()  # keys; empty where none is estimated
    stuck: Callable[[Snapshot], Mapping[str, Any]] | None = None  # values with which a counterweight stays where it is


def _stuck_at_start(snapshot: Snapshot) -> dict[str, Any]:
    """Buffers of the counterweight at the start of the rope, close to where that is."""
    place = float(snapshot.columns.support_travel[snapshot.layout.support_rows["start"]])
    return {"cable.start.travel": [place - 1e-4, place + 1e-4]}


def _of_lift(towers: int, *cells: str) -> Case:
    """Case of a lift with so many towers, of whose load cells some are spoiled."""
    friction = tuple(f"towers.tower_{row}_{rope}.friction" for row in range(1, towers + 1) for rope in ("up", "down"))
    ice = "ropes.up.ice", "ropes.down.ice"
    return Case({}, {}, friction, ("encoder_haul_rope", "force_haul_rope", *cells), ice=ice)


CASES = {
    "aerial_tramway": Case(
        {"carriages.cabin.payload.mass": 6000.0},
        {"air.wind.x": WIND},
        ("carriages.cabin.friction.rolling",),
        ("encoder_cabin", "force_cabin", "load_start", "load_tower", "load_end", "tilt_cabin"),
        "carriages.cabin.payload.mass",
        ("cable.ice",),
        _stuck_at_start,
    ),
    "jig_back": Case(
        {"carriages.cabin_1.payload.mass": 6000.0},
        {"air.wind.x": WIND},
        tuple(f"carriages.cabin_{number}.friction.rolling" for number in (1, 2)),
        ("encoder_haul_rope", "force_haul_rope", "load_track_1_start", "load_track_1_end", "tilt_cabin_1"),
        "carriages.cabin_1.payload.mass",
    ),
    "chairlift": _of_lift(6, "load_tower_3_up", "load_tower_2_down", "load_up_start"),
    "gondola": _of_lift(7, "load_tower_3_up", "load_tower_2_down", "load_up_start"),
}


def value_of(scenario: Scenario, key: str) -> Any:
    """Value of a scenario by its dotted key."""
    value: Any = scenario.resolved()
    for part in key.split("."):
        value = value[part]
    return value


def faults(scenario: Scenario, case: Case, at: float) -> Iterator[Fault]:
    """All faults, most of them from a time (s) under way on."""
    tolerance = defaultdict(float, {one.key: one.tolerance for one in slow_quantities(scenario)})

    def values(key: str, value: float, time: float, *also: str) -> Step:
        return Step(time, values=lambda _: dict.fromkeys((key, *also), value))

    if case.payload:
        mass = value_of(scenario, case.payload)
        heavy, borne = (values(case.payload, mass + more, BOARDED) for more in (0.05 * mass, tolerance[case.payload]))
        yield Fault("payload +5 %", BOARDED, "payload is", [heavy], about="/payload", tolerated=[borne])
    if case.ice:
        most_ice = tolerance[case.ice[0]]
        start, most = dict.fromkeys(case.ice, ICE), dict.fromkeys(case.ice, most_ice)
        name = f"ice {ICE:g} kg/m from the start"
        yield Fault(name, 0.0, "ice is", start=start, about="ice", tolerated_start=most)
        grown = [(at + one, ICE * (one + 1) / ICING) for one in range(ICING)]
        steps = [values(case.ice[0], ice, time, *case.ice[1:]) for time, ice in grown]
        less = [values(case.ice[0], min(ice, most_ice), time, *case.ice[1:]) for time, ice in grown]
        yield Fault(f"ice {ICE:g} kg/m, in {ICING} s", at, "ice is", steps, about="ice", tolerated=less)
    of_towers = scenario.carriers is not None
    rolling = tower_friction(next(iter(scenario.towers.values()))) if of_towers else value_of(scenario, case.rolling[0])
    rough, borne = (
        values(case.rolling[0], rolling + more, at, *case.rolling[1:]) for more in (rolling, tolerance[case.rolling[0]])
    )
    said = "more force than payload and friction need" if scenario.carriers else "rolling is"
    yield Fault("rolling friction doubled", at, said, [rough], about="/rolling", tolerated=[borne])
    if case.stuck is not None:
        yield Fault("counterweight stuck", at, "counterweight", [Step(at, values=case.stuck)])
    sensors = {name: one for name, one in scenario.sensors.items() if name in case.sensors}
    for name, one in sensors.items():
        if one.kind == "drive_force":
            lossy = partial(lossy_drive, name, at)
            yield Fault(f"drive needs {100 * SHARE:.0f} % more force", at, f"drive of {one.of}", spoils=lossy)
    for name, one in sensors.items():
        sigma = max(one.noise, QUANTISED * one.quantum)
        yield Fault(f"{name} stuck", at, f"sensor {name} ", spoils=partial(stuck, name, at))
        yield Fault(f"{name} +5 sigma", at, f"sensor {name} ", spoils=partial(biased, name, at, BIAS * sigma))
        if one.of in scenario.towers and of_towers:
            wrong = partial(biased, name, at, LOAD * one.noise / LOAD_CELL)
            yield Fault(f"{name} +{100 * LOAD:.0f} %", at, f"sensor {name} ", spoils=wrong)
    for first, second in combinations(sorted(sensors), 2):
        if sensors[first].kind == sensors[second].kind:
            said = f"sensors {first} and {second} are swapped"
            yield Fault(f"{first} and {second} swapped", at, said, spoils=partial(swapped, first, second, at))


def lossy_drive(sensor: str, at: float) -> Changed:
    """Drive that needs more force than its rope, by a share of that."""
    return lambda one: scaled(one, 1.0 + SHARE) if one.sensor == sensor and one.time >= at else one


def scaled(one: Measurement, share: float, more: float = 0.0) -> Measurement:
    """Measurement whose size is a share of that of another one, and `more` in its unit."""
    if len(one.values) == 3:
        size = float(np.linalg.norm(one.values))
        share += more / size
        return replace(one, values=tuple(share * value for value in one.values))
    return replace(one, values=(share * one.values[0] + more, *one.values[1:]))


def biased(sensor: str, at: float, bias: float) -> Changed:
    """Sensor that reads too much by a bias in its unit."""
    return lambda one: scaled(one, 1.0, bias) if one.sensor == sensor and one.time >= at else one


def stuck(sensor: str, at: float) -> Changed:
    """Sensor that repeats its last value."""
    last: list[Measurement] = []

    def changed(one: Measurement) -> Measurement:
        if one.sensor != sensor:
            return one
        if one.time < at or not last:
            last[:] = [one]
        return replace(one, values=last[0].values)

    return changed


def swapped(first: str, second: str, at: float) -> Changed:
    """Two sensors, of which each has the name of the other one."""
    to = {first: second, second: first}
    return lambda one: replace(one, sensor=to.get(one.sensor, one.sensor)) if one.time >= at else one


def readings_of(name: str, at: float, seed: int) -> Readings:
    """Readings of plants of a scenario without noise, with faults at a time (s)."""
    values = {**scene_of(name).mesh, **CASES[name].weather}
    return Readings(twin_of(name, seed), values, _trip(name), max(at, LEFT) + WATCHED)


def scene_of(name: str) -> Scene:
    """Scene of plants of a scenario, with carriages or carriers."""
    return {**SCENES, **LIFTS}[name]


def _trip(name: str) -> Step:
    scene = scene_of(name)
    return Step(LEFT, Command("speed", {scene.drive: min(SPEED, scene.speeds[1])}))


def observable(fault: Fault, plain: Readings) -> Observable:
    """Times (s) from when on a fault can be told."""
    tolerated = plain.of(fault.tolerated, fault.tolerated_start)
    spoils = fault.spoils() if not fault.about else None
    signal = plain.of(fault.steps, fault.start, spoils) - tolerated
    rolls = plain.rolls(fault.at) if fault.about == "/payload" else 0.0
    doubted = plain.time_of(signal, plain.effects(fault.about, fault.at), fault.limit, rolls)
    return Observable(plain.time_of(signal, [], fault.limit), doubted)


def trial(name: str, fault: Fault, seed: int, took: list[float], plain: Readings | None = None) -> Outcome:
    """Alarms of a twin of a scenario whose plant has a fault, beside readings of plants without noise."""
    case, twin, end = CASES[name], twin_of(name, seed), max(fault.at, LEFT) + WATCHED
    scenario = load_scenario(twin.resolved(), {**scene_of(name).mesh, **case.weather, **fault.start})
    plant = Plant(scenario, sorted([_trip(name), *fault.steps], key=lambda one: one.time))
    alarms = [*alarms_of(news(plant, Tracker(twin), end, took, fault.spoils()))]
    right = [one for one in alarms if one.time >= fault.at and fault.said in one.reason]
    alarm = right[0] if right else None
    seen = observable(fault, plain) if plain else Observable(fault.at, fault.at)
    return Outcome(fault, seen, alarm, [one for one in alarms if one is not alarm])


def twin_of(name: str, seed: int) -> Scenario:
    """Scenario of a twin, with the usual sensors of its plant."""
    bare = load_scenario(name, CASES[name].planned)
    return load_scenario(bare.resolved(), {"sensors": standard_sensors(bare, Simulation(bare).snapshot, seed)})


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Table in Markdown, a row for each fault; times after it set in."""
    lines = [
        "| fault | sets in, s | all else known, s | in doubt, s | alarm, s | later than in doubt | said | besides |"
    ]
    lines.append("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for fault, seen, alarm, others in outcomes:
        known, doubted = ("never" if time == float("inf") else f"{time - fault.at:.1f}" for time in seen)
        came = "none" if alarm is None else f"{alarm.time - fault.at:.1f}"
        later = "" if alarm is None else f"{max(alarm.time - seen.doubted, 0.0):.1f}"
        besides = "; ".join(f"{one.time:.1f} s: {one.reason}" for one in others)
        said = alarm.reason if alarm else ""
        lines.append(f"| {fault.name} | {fault.at:g} | {known} | {doubted} | {came} | {later} | {said} | {besides} |")
    return lines


def main() -> int:
    """Follow plants with faults, or without, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m verification.alarms", description=__doc__, formatter_class=Filled)
    parser.add_argument("--scenario", choices=list(CASES), default="aerial_tramway", help="default: aerial_tramway")
    parser.add_argument("--at", type=float, default=FAULT, help=f"s, when a fault sets in; default: {FAULT:g}")
    parser.add_argument("--seed", type=int, default=1, help="of the noise of sensors; default: 1")
    parser.add_argument("--only", default="", help="faults whose name has this text; default: all")
    options = parser.parse_args()
    took: list[float] = []
    chosen = [
        one
        for one in faults(twin_of(options.scenario, options.seed), CASES[options.scenario], options.at)
        if options.only in one.name
    ]
    plain = None if options.scenario in LIFTS else readings_of(options.scenario, options.at, options.seed)
    outcomes = [
        trial(options.scenario, fault, options.seed, took, plain)
        for fault in track(chosen, "faults", console=Console(stderr=True), transient=True)
    ]
    print("\n".join(table(outcomes)))
    for which in Observable._fields:
        soon = sum(
            one.alarm is not None and one.alarm.time <= getattr(one.observable, which) + WANTED for one in outcomes
        )
        print(f"\n{soon} of {len(outcomes)} alarms within {WANTED:g} s of when it is observable, all else {which}")
    other = sum(len(one.others) for one in outcomes)
    share = sum(took) / sum(max(one.at, LEFT) + WATCHED for one in chosen)
    print(f"\n{other} alarms of something else; the twin took {share:.0%} of a core")
    return 0


if __name__ == "__main__":
    sys.exit(main())
