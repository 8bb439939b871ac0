"""Faults of plants that are followed: how soon a twin gives the alarm, and what it says in hours without any fault.

`python -m verification.alarms` lets a twin follow plants of a scenario with another mesh and noisy sensors, into each
of which a fault is put under way, and prints a table for docs/follow.md: from when on it could be observed, how much
later the alarm came and what it said, and alarms of anything else. Observable is a fault from when on all samples of
all sensors, less those of the plant without it, weigh five standard deviations of their noise together: one who knows
the plant without fault, and how this fault shows, could be sure then. With `--hours` plants without a fault make trips.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import Progress, track

from cable_twin.ensemble.estimate.doubts import Alarm
from cable_twin.ensemble.estimate.quantities import QUANTISED
from cable_twin.ensemble.estimate.tracker import News, Tracker
from cable_twin.frame.records import Command
from cable_twin.frame.sensors import Measurement, standard_sensors
from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification.followed import SCENES, Changed, Plant, Step, measured, news

Found = dict[tuple[str, float], Measurement]  # by sensor and time
LEFT, SPEED = 20.0, 7.0  # s, m/s: when a trip begins, and how fast it is
BOARDED, FAULT = 10.0, 50.0  # s, when payload and other faults set in
WANTED = 10.0  # s after it is observable, for an alarm
WATCHED = 30.0  # s, for which an alarm is waited for
BIAS = 5.0  # standard deviations of the noise of a sensor
OBSERVABLE = 5.0**2  # square of standard deviations
SHARE = 0.15  # of the force of a drive, that is lost between it and the rope
ICE, ICING = 1.0, 60  # kg/m, and s in which it comes, in as many steps
WIND = 3.0  # m/s along the track, of all plants
GUST, GUST_TIME, BLOWN = 1.0, 50.0, 5.0  # m/s, s in which they change, s from one to the next: gusts of trips
SLOWING, JERKING = 0.45, 1.2  # m/s^2 and s, with which a drive stops


class Fault(NamedTuple):
    """Fault of a plant or of its sensors."""

    name: str
    at: float  # s
    said: str  # by the alarm
    steps: Sequence[Step] = ()
    spoils: Callable[[], Changed] = lambda: lambda one: one  # sensors, anew for each run
    start: Mapping[str, Any] = {}  # values of the plant, by key


class Outcome(NamedTuple):
    """Alarms of a twin whose plant has a fault."""

    fault: Fault
    observable: float  # s, infinite if never
    alarm: Alarm | None
    others: list[Alarm]


class Case(NamedTuple):
    """Scenario of twin and plants, with what they have otherwise."""

    planned: Mapping[str, Any]  # of both, by key
    weather: Mapping[str, Any]  # of the plant, by key
    payload: str  # key
    rolling: tuple[str, ...]  # keys
    ice: str  # key; empty where none is estimated
    stuck: Callable[[Snapshot], Mapping[str, Any]]  # values with which a counterweight stays where it is
    sensors: Sequence[str]  # that are spoiled
    vehicle: str  # that goes from station to station
    ends: tuple[float, float]  # m, places there


def _stuck_at_start(snapshot: Snapshot) -> dict[str, Any]:
    """Buffers of the counterweight at the start of the rope, close to where that is."""
    place = float(snapshot.columns.support_travel[snapshot.layout.support_rows["start"]])
    return {"cable.start.travel": [place - 1e-4, place + 1e-4]}


CASES = {
    "aerial_tramway": Case(
        {"carriages.cabin.payload.mass": 6000.0},
        {"air.wind.x": WIND},
        "carriages.cabin.payload.mass",
        ("carriages.cabin.friction.rolling",),
        "cable.ice",
        _stuck_at_start,
        ("encoder_cabin", "force_cabin", "load_start", "load_tower", "load_end", "tilt_cabin"),
        "cabin",
        (12.0, 1030.0),
    ),
}


def value_of(scenario: Scenario, key: str) -> Any:
    """Value of a scenario by its dotted key."""
    value: Any = scenario.resolved()
    for part in key.split("."):
        value = value[part]
    return value


def faults(scenario: Scenario, case: Case, at: float) -> Iterator[Fault]:
    """All faults, most of them from a time (s) under way on."""
    mass, rolling = value_of(scenario, case.payload), value_of(scenario, case.rolling[0])
    yield Fault("payload +5 %", BOARDED, "payload is", [Step(BOARDED, values=lambda _: {case.payload: 1.05 * mass})])
    if case.ice:
        yield Fault(f"ice {ICE:g} kg/m from the start", 0.0, "ice is", start={case.ice: ICE})
        steps = [Step(at + one, values=_constant(case.ice, ICE * (one + 1) / ICING)) for one in range(ICING)]
        yield Fault(f"ice {ICE:g} kg/m, in {ICING} s", at, "ice is", steps)
    rough = dict.fromkeys(case.rolling, 2.0 * rolling)
    yield Fault("rolling friction doubled", at, "rolling is", [Step(at, values=lambda _: rough)])
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
    for first, second in combinations(sorted(sensors), 2):
        if sensors[first].kind == sensors[second].kind:
            said = f"sensors {first} and {second} are swapped"
            yield Fault(f"{first} and {second} swapped", at, said, spoils=partial(swapped, first, second, at))


def _constant(key: str, value: float) -> Callable[[Snapshot], Mapping[str, Any]]:
    return lambda _: {key: value}


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


def observable_at(plain: Found, found: Sequence[Measurement], scenario: Scenario) -> float:
    """Time (s) from when on measurements could tell a fault; infinite for never.

    Args:
        plain: measurements of the plant without it, by sensor and time.
        found: those with it.
        scenario: with the noise of the sensors.
    """
    noise = {name: max(one.noise, QUANTISED * one.quantum) for name, one in scenario.sensors.items()}
    total = 0.0
    for one in sorted(found, key=lambda one: one.time):
        before = plain.get((one.sensor, one.time))
        if before is None:
            continue
        width = 1 if scenario.sensors[one.sensor].kind == "encoder" else None
        sizes = [float(np.linalg.norm(values[:width])) for values in (one.values, before.values)]
        if len(one.values) == 1:
            sizes = [one.values[0], before.values[0]]
        total += ((sizes[0] - sizes[1]) / noise[one.sensor]) ** 2
        if total >= OBSERVABLE:
            return one.time
    return float("inf")


def trial(
    name: str, fault: Fault, seed: int, plain: dict[tuple[str, float], Measurement], took: list[float]
) -> Outcome:
    """Alarms of a twin of a scenario whose plant has a fault, beside measurements of a plant without any.

    Measurements that are still missing there are filled into `plain`.
    """
    case, scene = CASES[name], SCENES[name]
    twin = twin_of(name, seed)
    values = {**scene.mesh, **case.weather}
    trip, end = Step(LEFT, Command("speed", {scene.drive: SPEED})), max(fault.at, LEFT) + WATCHED

    def plant(steps: Sequence[Step], start: Mapping[str, Any]) -> Plant:
        scenario = load_scenario(twin.resolved(), {**values, **start})
        return Plant(scenario, sorted([trip, *steps], key=lambda one: one.time))

    if max((time for _, time in plain), default=0.0) < end - 1.0:
        plain |= {(one.sensor, one.time): one for _, arrived in measured(plant([], {}), end) for one in arrived}
    found: list[Measurement] = []
    spoils = fault.spoils()

    def changed(one: Measurement) -> Measurement:
        found.append(spoiled := spoils(one))
        return spoiled

    tracker = Tracker(twin)
    alarms = [*alarms_of(news(plant(fault.steps, fault.start), tracker, end, took, changed))]
    right = [one for one in alarms if one.time >= fault.at and fault.said in one.reason]
    alarm = right[0] if right else None
    return Outcome(fault, observable_at(plain, found, twin), alarm, [one for one in alarms if one is not alarm])


def alarms_of(told: Iterable[News]) -> Iterator[Alarm]:
    """Alarms of a twin, and lines of other kinds but that it follows its plant."""
    for one in told:
        yield from (Alarm(one.time, line) for line in one.lines if not line.startswith("follows the plant"))
        yield from one.correction.alarms if one.correction else ()


class Shuttle:
    """Driver of trips from station to station, in gusts.

    Args:
        drive: as commands call it.
        vehicle: whose place tells where it is.
        ends: m, places at which it stops.
        wind: m/s along the track, on the average.
        seed: of speeds, stays and gusts.
    """

    def __init__(self, drive: str, vehicle: str, ends: tuple[float, float], wind: float, seed: int) -> None:
        self._drive, self._vehicle, self._ends, self._wind = drive, vehicle, ends, wind
        self._draws, self._until, self._speed, self._gust, self._blown = (
            np.random.default_rng(seed),
            LEFT,
            0.0,
            0.0,
            0.0,
        )
        self.trips = 0

    def __call__(self, snapshot: Snapshot) -> list[Command]:
        """Commands of a frame."""
        time, given = snapshot.time, list[Command]()
        if time >= self._blown:
            self._blown += BLOWN
            kept = float(np.exp(-BLOWN / GUST_TIME))
            self._gust = kept * self._gust + GUST * float(np.sqrt(1.0 - kept**2) * self._draws.standard_normal())
            given.append(Command("wind", {"x": self._wind + self._gust, "z": 0.0}))
        place = float(snapshot.columns.arc_length[snapshot.layout.vehicle_rows[self._vehicle]])
        if self._speed == 0.0 and time >= self._until:
            up = place < 0.5 * sum(self._ends)
            self._speed = float(self._draws.uniform(4.0, 8.0)) * (1.0 if up else -1.0)
            given.append(Command("speed", {self._drive: self._speed}))
            self.trips += 1
        elif self._speed != 0.0:
            left = (self._ends[1] - place) if self._speed > 0.0 else (place - self._ends[0])
            if left <= self._speed**2 / (2.0 * SLOWING) + abs(self._speed) * JERKING:
                self._speed, self._until = (
                    0.0,
                    time + abs(self._speed) / SLOWING + float(self._draws.uniform(30.0, 120.0)),
                )
                given.append(Command("speed", {self._drive: 0.0}))
        return given


def season(name: str, hours: float, seed: int, took: list[float]) -> tuple[int, list[Alarm]]:
    """Trips that a plant without a fault makes in some hours, and the alarms of its twin."""
    case, scene, twin = CASES[name], SCENES[name], twin_of(name, seed)
    driver = Shuttle(scene.drive, case.vehicle, case.ends, WIND, seed)
    plant = Plant(load_scenario(twin.resolved(), {**scene.mesh, **case.weather}), [], driver)
    alarms: list[Alarm] = []
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("trips", total=3600.0 * hours)
        for told in news(plant, Tracker(twin), 3600.0 * hours, took):
            bar.update(task, completed=told.time)
            for one in alarms_of([told]):
                alarms.append(one)
                bar.print(f"{one.time:.1f} s: {one.reason}")
    return driver.trips, alarms


def twin_of(name: str, seed: int) -> Scenario:
    """Scenario of a twin, with the usual sensors of its plant."""
    bare = load_scenario(name, CASES[name].planned)
    return load_scenario(bare.resolved(), {"sensors": standard_sensors(bare, Simulation(bare).snapshot, seed)})


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Table in Markdown, a row for each fault."""
    lines = ["| fault | sets in, s | observable after, s | alarm after that, s | said | besides |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for fault, observable, alarm, others in outcomes:
        seen = "never" if observable == float("inf") else f"{observable - fault.at:.1f}"
        later = "none" if alarm is None else f"{alarm.time - min(observable, alarm.time):.1f}"
        besides = "; ".join(f"{one.time:.1f} s: {one.reason}" for one in others)
        lines.append(
            f"| {fault.name} | {fault.at:g} | {seen} | {later} | {alarm.reason if alarm else ''} | {besides} |"
        )
    return lines


def main() -> int:
    """Follow plants with faults, or without, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m verification.alarms", description=__doc__, formatter_class=Filled)
    parser.add_argument("--scenario", choices=list(CASES), default="aerial_tramway", help="default: aerial_tramway")
    parser.add_argument("--at", type=float, default=FAULT, help=f"s, when a fault sets in; default: {FAULT:g}")
    parser.add_argument("--seed", type=int, default=1, help="of the noise of sensors; default: 1")
    parser.add_argument("--only", default="", help="faults whose name has this text; default: all")
    parser.add_argument("--hours", type=float, default=0.0, help="of trips without a fault, instead; default: none")
    options = parser.parse_args()
    took: list[float] = []
    if options.hours:
        trips, alarms = season(options.scenario, options.hours, options.seed, took)
        print(
            f"{options.hours:g} h without a fault, {trips} trips: {len(alarms)} alarms, "
            f"{len(alarms) / options.hours:.2g} an hour; processor time of the twin "
            f"{sum(took) / options.hours / 36.0:.0f} % of a core",
            *(f"{one.time:.1f} s: {one.reason}" for one in alarms),
            sep="\n",
        )
        return 0
    chosen = [
        one
        for one in faults(twin_of(options.scenario, options.seed), CASES[options.scenario], options.at)
        if options.only in one.name
    ]
    plain: Found = {}
    outcomes = [
        trial(options.scenario, fault, options.seed, plain, took)
        for fault in track(chosen, "faults", console=Console(stderr=True), transient=True)
    ]
    print("\n".join(table(outcomes)))
    soon = sum(one.alarm is not None and one.alarm.time <= one.observable + WANTED for one in outcomes)
    other = sum(len(one.others) for one in outcomes)
    print(f"\n{soon} of {len(outcomes)} alarms within {WANTED:g} s; {other} alarms of something else")
    return 0


if __name__ == "__main__":
    sys.exit(main())
