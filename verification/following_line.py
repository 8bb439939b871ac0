"""Twins of a lift that follow random plants of known truth: the payload of each carrier, and the towers' friction.

`python -m verification.following_line` runs plants of `chairlift`, or of another scenario with carriers, with another
mesh and step, another friction of all towers, and people of their own on each carrier, and prints a table for
docs/follow.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from cable_twin.basics.units import NORMAL_95
from cable_twin.ensemble.estimate.line_follower import LineFollower
from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.frame.sensors import Measurement, Sensors, standard_sensors
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.builders.system import tower_friction
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification.followed import LIFTS

PLANTS, DURATION, FRAME = 4, 120.0, 0.05  # -, s, s
START = 2.0  # s
PERSON = 75.0  # kg
NEAR = 10.0  # m from a station, where the twin may change people a moment before or after the plant


class Score(NamedTuple):
    """Error of an estimate beside its deviation; of a payload also how many load cells the chair has passed with it."""

    time: float  # s
    name: str
    cells: int
    truth: float
    error: float
    deviation: float


def seats_of(scenario: Scenario) -> int:
    """Number of people for whom a carrier has room."""
    assert scenario.carriers is not None
    assert scenario.carriers.payload is not None
    return round(scenario.carriers.payload.capacity / PERSON)


def with_people(scenario: Scenario, people: list[int]) -> dict[str, Any]:
    """Content of a scenario whose carriers take so many people each when they go up, and none down."""
    content = scenario.resolved()
    carriers = content["carriers"]
    kinds = {}
    for number in range(seats_of(scenario) + 1):
        payload = {**carriers["payload"], "leaving": {**carriers["payload"]["leaving"], "return": PERSON * number}}
        kinds[f"people_{number}"] = {"bodies": carriers["bodies"], "payload": payload}
    order = [f"people_{number}" for number in people]
    return {**content, "carriers": {**carriers, "bodies": {}, "payload": None, "kinds": kinds, "order": order}}


def follow(scenario: str, seed: int, duration: float, said: list[str], took: list[float]) -> Iterator[Score]:
    """Scores of a plant with a seed, once a second; lines of alarms are `said`.

    Processor time (s) of the twin is added to what it `took`.
    """
    draws = np.random.default_rng(seed)
    bare, scene = load_scenario(scenario), LIFTS[scenario]
    plan = Simulation(bare)
    usual = standard_sensors(bare, plan.snapshot, seed)
    follower = LineFollower(load_scenario(scenario, {"sensors": usual}))
    factor = float(draws.uniform(0.7, 1.4))
    towers = {name: one for rope in bare.cables for name, one in bare.of_rope(rope).towers.items()}
    usually = {name: tower_friction(one) for name, one in towers.items()}
    friction = {f"towers.{name}.friction": factor * one for name, one in usually.items()}
    people = draws.integers(0, seats_of(bare) + 1, len(follower.carriers)).tolist()
    plant = Simulation(
        load_scenario(with_people(bare, people), {**scene.mesh, **friction, "sensors": usual}), samples=2
    )
    sensors, waiting = Sensors(plant.scenario, plant.layout), list[Measurement]()
    passed = np.zeros(len(follower.carriers), dtype=int)
    before = plant.snapshot.columns.joint_position[:, 0].copy()
    loads = plant.snapshot.columns.payload.copy()
    places = sorted({float(one.position[0]) for one in towers.values()})
    ends = [float(one.ends["start"].position[0]) for one in bare.cables.values()]
    for frame in range(1, round(duration / FRAME) + 1):
        time = round(frame * FRAME, 9)
        snapshot = plant.advance_to(time)
        if abs(time - START) < 0.5 * FRAME:
            command = Command("speed", {scene.drive: scene.speeds[0]})
            plant.apply(command)
            follower.command(AppliedCommand(time, command, "plant"))
        here = snapshot.columns.joint_position[:, 0]
        passed += [sum((a - x) * (b - x) <= 0.0 for x in places) for a, b in zip(before, here, strict=True)]
        within = (here > min(ends) + NEAR) & (here < max(ends) - NEAR)
        passed[(snapshot.columns.payload != loads) | ~within] = 0  # since it was filled or emptied, or may have been
        before, loads = here.copy(), snapshot.columns.payload.copy()
        waiting += sensors.take(snapshot)
        due = [one for one in waiting if one.time <= time - 0.1]
        waiting = [one for one in waiting if one.time > time - 0.1]
        for stamp in sorted({one.time for one in due}):
            begun = process_time()
            correction = follower.take(stamp, [one for one in due if one.time == stamp])
            took.append(process_time() - begun)
            if correction is None:
                continue
            said += [f"{seed}: {one.time:.0f} s: {one.reason}" for one in correction.alarms]
            for row, name in enumerate(follower.carriers):
                if not within[row]:
                    continue
                got, true = correction.slow[f"{name}/payload"], float(snapshot.columns.payload[row])
                yield Score(stamp, "payload", int(passed[row]), true, got.value - true, got.deviation)
            got = correction.slow["towers/friction"]
            yield Score(stamp, "friction", 9, factor, got.value - factor, got.deviation)
    follower.close()


def table(found: list[Score]) -> list[str]:
    """Table in Markdown: payloads by passed load cells, and friction in the last ten seconds."""
    lines = ["| estimate | rms error | largest | claimed deviation | 95 % coverage, % | normalised error squared |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    last = max(one.time for one in found) - 10.0
    payloads = [one for one in found if one.name == "payload"]
    rows = {
        f"payload, {cells} load cells passed, kg": [one for one in payloads if one.cells == cells] for cells in range(3)
    }
    rows["payload, more, kg"] = [one for one in payloads if one.cells > 2]
    rows["friction of towers, share"] = [one for one in found if one.name == "friction" and one.time > last]
    for name, own in rows.items():
        if not own:
            continue
        errors, deviations = (np.array([getattr(one, field) for one in own]) for field in ("error", "deviation"))
        inside = 100.0 * np.mean(np.abs(errors) <= NORMAL_95 * deviations)
        square = np.mean((errors / deviations) ** 2)
        rms, claimed = np.sqrt(np.mean(errors**2)), np.sqrt(np.mean(deviations**2))
        largest = np.abs(errors).max()
        lines.append(f"| {name} | {rms:.3g} | {largest:.3g} | {claimed:.3g} | {inside:.1f} | {square:.2f} |")
    return lines


def main() -> int:
    """Follow some plants and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.following_line", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--plants", type=int, default=PLANTS, help=f"default: {PLANTS}")
    parser.add_argument("--duration", type=float, default=DURATION, help=f"s; default: {DURATION:g}")
    parser.add_argument("--first", type=int, default=1, help="seed of the first plant; default: 1")
    parser.add_argument("--scenario", choices=list(LIFTS), default="chairlift", help="default: chairlift")
    options = parser.parse_args()
    seeds, said, took = range(options.first, options.first + options.plants), list[str](), list[float]()
    found = [
        score
        for seed in track(seeds, "plants", console=Console(stderr=True), transient=True)
        for score in follow(options.scenario, seed, options.duration, said, took)
    ]
    print("\n".join(table(found)))
    lying = [line for line in said if "sensor" in line]
    print(
        f"\n{len(seeds)} plants of {options.duration:g} s: {len(said)} alarms, {len(lying)} of sensors",
        f"processor time of the twin: {100.0 * sum(took) / len(seeds) / options.duration:.0f} % of a core",
        *lying,
        sep="\n",
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
