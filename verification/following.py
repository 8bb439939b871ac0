"""Twins that follow random plants of known truth: error, claimed deviation, coverage and normalised error.

`python -m verification.following` runs plants of `aerial_tramway`, or of another scenario with carriages, with another
mesh, other values and noisy sensors, and prints a table for docs/follow.md. Truth is drawn from the priors of the
filter, within their bounds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from cable_twin.ensemble.estimate.follower import Correction, Follower
from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.frame.sensors import Measurement, Sensors, standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled

PLANTS, DURATION, FRAME = 20, 120.0, 0.02  # -, s, s
START, FIRST = 2.0, 30.0  # s: of the motion, and from which on estimates count
TRAMWAY = {"cable.elements.target": 7.0, "cable.elements.at_towers": 1.0}
ROPES = {
    f"ropes.{kind}_{number}.elements": {"target": target, "at_towers": at_towers, "growth": 2.0}
    for kind, target, at_towers in (("track", 9.0, 0.5), ("haul", 5.0, 1.5))
    for number in (1, 2)
}
NORMAL_95 = 1.959964
HEAVIER, SOFTER, ROUGHER = 1.05, 0.9, 2.0  # times rope mass, stiffness and rolling friction, of plants modelled wrong
MARGIN = 0.05  # of a bound, within which truth is not drawn


class Scene(NamedTuple):
    """Scenario with what its plants have otherwise."""

    mesh: Mapping[str, Any]  # by key
    drive: str  # as commands call it
    speeds: tuple[float, float]  # m/s, from which the speed of a trip is drawn


SCENES = {
    "aerial_tramway": Scene(TRAMWAY, "cabin", (6.0, 9.0)),
    "windy_tramway": Scene(TRAMWAY, "cabin", (5.0, 8.0)),
    "jig_back": Scene(ROPES, "haul_rope", (6.0, 9.0)),
}


class Score(NamedTuple):
    """Error of an estimate beside its deviation, at one time of one plant."""

    plant: int
    time: float  # s
    name: str
    unit: str
    truth: float
    error: float
    deviation: float


def truth_of(follower: Follower, seed: int) -> dict[str, float]:
    """Values of a plant by key, drawn from the priors."""
    draws = np.random.default_rng(seed)
    found = {}
    for one in follower.slow:
        low, high = one.low + MARGIN * (one.high - one.low), one.high - MARGIN * (one.high - one.low)
        value = float("nan")
        while not low <= value <= high:
            value = one.mean + one.deviation * float(draws.standard_normal())
        found[one.key] = value
    return found


def wrong(scenario: str, values: dict[str, float]) -> dict[str, float]:
    """Values by key of a plant with heavier and softer ropes than its twin; rolling friction among `values` grows."""
    bare, found = load_scenario(scenario), {}
    for rope, cable in bare.cables.items():
        key = bare.rope_key(rope)
        found[f"{key}.mass_per_length"] = HEAVIER * cable.mass_per_length
        found[f"{key}.axial_stiffness"] = SOFTER * cable.axial_stiffness
    for key in values:
        if key.endswith(".rolling"):
            values[key] *= ROUGHER
    return found


def follow(
    scenario: str, seed: int, duration: float, said: list[str], took: list[float], *, modelled_wrong: bool = False
) -> Iterator[Score]:
    """Scores of all estimates of a plant with a seed; sensors that are left out or contradict are `said`.

    Processor time (s) of the twin is added to what it `took`.
    """
    bare, scene = load_scenario(scenario), SCENES[scenario]
    usual = standard_sensors(bare, Simulation(bare).snapshot, seed)
    follower = Follower(load_scenario(scenario, {"sensors": usual}), threads=1)
    values = truth_of(follower, seed)
    others = wrong(scenario, values) if modelled_wrong else {}
    everywhere = {key: values[one.key] for one in follower.slow for key in (one.key, *one.also)}
    plant = Simulation(load_scenario(scenario, {**scene.mesh, **others, **everywhere, "sensors": usual}), samples=2)
    sensors = Sensors(plant.scenario, plant.layout)
    speed, started = float(np.random.default_rng(seed + 1000).uniform(*scene.speeds)), False
    waiting: list[Measurement] = []
    plant_at: dict[float, np.ndarray] = {}
    for frame in range(round(duration / FRAME) + 1):
        time = round(frame * FRAME, 9)
        snapshot = plant.advance_to(time)
        if time >= START and not started:
            started, command = True, Command("speed", {scene.drive: speed})
            plant.apply(command)
            follower.command(AppliedCommand(time, command, "plant"))
        waiting += sensors.take(snapshot)  # in the order of arrival: all of a time have come 0.1 s later
        due = [one for one in waiting if one.time <= time - 0.1]
        for stamp in sorted({one.time for one in due}):
            begun = process_time()
            correction = follower.take(stamp, [one for one in due if one.time == stamp])
            took.append(process_time() - begun)
            if correction is not None:
                said += [f"{one.time:.0f} s: {one.reason}" for one in correction.alarms if "sensor" in one.reason]
            if correction is not None and stamp >= FIRST:
                yield from scores(seed, correction, follower, values, plant_at[stamp])
        waiting = [one for one in waiting if one.time > time - 0.1]
        plant_at = {key: row for key, row in plant_at.items() if key > time - 0.5}
        plant_at[snapshot.time] = snapshot.numbers.copy()
    follower.close()


def scores(
    plant: int, correction: Correction, follower: Follower, values: dict[str, float], numbers: np.ndarray
) -> Iterator[Score]:
    """Scores of one correction against the values of a plant and the numbers of its frame at that time."""
    for one in follower.slow:
        got = correction.slow[one.name]
        error = got.value - values[one.key]
        yield Score(plant, correction.time, one.name, one.unit, values[one.key], error, got.deviation)
    for hidden in follower.hidden:
        components = numbers[hidden.places]
        truth = float(components[0]) if components.size == 1 else float(np.linalg.norm(components))
        got = correction.hidden[hidden.name]
        yield Score(plant, correction.time, hidden.name, hidden.unit, truth, got.value - truth, got.deviation)


def table(found: list[Score]) -> list[str]:
    """Table in Markdown: for each estimate its error, claimed deviation, coverage and normalised error squared."""
    lines = ["| estimate | unit | rms error | claimed deviation | 95 % coverage, % | normalised error squared |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for name in dict.fromkeys(one.name for one in found):
        own = [one for one in found if one.name == name]
        errors, deviations = (np.array([getattr(one, field) for one in own]) for field in ("error", "deviation"))
        scale, unit = (180.0 / np.pi, "deg") if own[0].unit == "rad" else (1.0, own[0].unit)
        rms, claimed = scale * np.sqrt(np.mean(errors**2)), scale * np.sqrt(np.mean(deviations**2))
        inside = 100.0 * np.mean(np.abs(errors) <= NORMAL_95 * deviations)
        square = np.mean((errors / deviations) ** 2)
        lines.append(f"| {name} | {unit} | {rms:.3g} | {claimed:.3g} | {inside:.1f} | {square:.2f} |")
    return lines


def _share(one: Score) -> float:
    """Error of a force as a share of it; 0 of any other quantity."""
    return abs(one.error / one.truth) if one.unit == "N" else 0.0


def main() -> int:
    """Follow some plants and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.following", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--plants", type=int, default=PLANTS, help=f"default: {PLANTS}")
    parser.add_argument("--duration", type=float, default=DURATION, help=f"s; default: {DURATION:g}")
    parser.add_argument("--first", type=int, default=1, help="seed of the first plant; default: 1")
    parser.add_argument("--scenario", choices=list(SCENES), default="aerial_tramway", help="default: aerial_tramway")
    parser.add_argument(
        "--wrong",
        action="store_true",
        help=f"plants with {HEAVIER:g} times the rope mass, {SOFTER:g} times its stiffness, and "
        f"{ROUGHER:g} times the rolling friction that was drawn",
    )
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.plants)
    said: list[str] = []
    took: list[float] = []
    found = [
        score
        for seed in track(seeds, "plants", console=Console(stderr=True), transient=True)
        for score in follow(options.scenario, seed, options.duration, said, took, modelled_wrong=options.wrong)
    ]
    print("\n".join(table(found)))
    shares = {one.name: 100.0 * _share(one) for one in sorted(found, key=_share) if _share(one)}
    print("\nlargest error of a force, % of it: " + ", ".join(f"{name} {share:.2f}" for name, share in shares.items()))
    print(
        f"\n{len(seeds)} plants of {options.duration:g} s, {'modelled wrong' if options.wrong else 'without a fault'}: "
        f"{len(said)} alarms of sensors",
        f"processor time of the twin: {100.0 * sum(took) / len(seeds) / options.duration:.0f} % of a core",
        *said,
        sep="\n",
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
