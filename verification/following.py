"""Twins that follow random plants of known truth: error, claimed deviation, coverage and normalised error.

`python -m verification.following` runs plants of `aerial_tramway`, or of another scenario with carriages, with another
mesh, other values and noisy sensors, and prints a table for docs/follow.md. Truth is drawn from the priors of the
filter, within their bounds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from cable_twin.basics.units import NORMAL_95
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.follower import Follower
from cable_twin.frame.records import Command
from cable_twin.frame.sensors import standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification.followed import SCENES, Plant, Step, corrections

PLANTS, DURATION = 20, 120.0  # -, s
START, FIRST = 2.0, 30.0  # s: of the motion, and from which on estimates count
HEAVIER, SOFTER, ROUGHER = 1.05, 0.9, 2.0  # times rope mass, stiffness and rolling friction, of plants modelled wrong
MARGIN = 0.05  # of a bound, within which truth is not drawn


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
    speed = float(np.random.default_rng(seed + 1000).uniform(*scene.speeds))
    plant = Plant(
        load_scenario(scenario, {**scene.mesh, **others, **everywhere, "sensors": usual}),
        [Step(START, Command("speed", {scene.drive: speed}))],
    )
    for correction, numbers in corrections(plant, follower, duration, took):
        said += [f"{one.time:.0f} s: {one.reason}" for one in correction.alarms if "sensor" in one.reason]
        if correction.time >= FIRST:
            yield from scores(seed, correction, follower, values, numbers)


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
