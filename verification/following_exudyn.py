"""A twin that follows a plant in Exudyn: errors of tension and swing beside what is claimed.

`python -m verification.following_exudyn` records `verification.exudyn_plant` on some trips, follows each bag as
`follow` does, and prints a table for docs/follow.md. Truth is what the plant writes beside its bag. Needs Exudyn, which
is in the extra `bench`.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.exudyn_model import load_exudyn
from cable_twin.messages import ESTIMATE, statuses_of_message
from cable_twin.offline import follow
from cable_twin.recording.log_reader import read_log
from cable_twin.terminal.command_line import Filled
from verification.exudyn_plant import ELEMENT, FREE_SPAN, MISSING, TRUTH, TRUTH_FILE, Plan, Trip, record, travel
from verification.following import HEAVIER, ROUGHER, SOFTER, Score, table

SCRIPT = "- {{time: {start:g}, name: cabin, speed: {speed:g}}}\n"
TRIPS = (4.0, 6.0), (3.0, 4.5), (3.0, 7.5)  # s, m/s: start and speed of each plant
DURATION, FIRST = 90.0, 15.0  # s, s: from which on estimates count
SEEDS = 1  # of the noise, for each trip
BODIES = ("running_carriage", "hanger", "cabin")  # whose pitch the plant writes
WRONG = {
    "cable.mass_per_length": HEAVIER,
    "cable.axial_stiffness": SOFTER,
    "carriages.cabin.friction.rolling": ROUGHER,
}
SLOW = {  # keys of slow quantities, with their units
    "cabin/payload": ("carriages.cabin.payload.mass", "kg"),
    "cabin/rolling": ("carriages.cabin.friction.rolling", "-"),
    "wind/x": ("", "m/s"),
    "ice": ("", "kg/m"),
    "start/counterweight": ("cable.start.mass", "kg"),
}


def true_values(bag: Path) -> dict[str, np.ndarray]:
    """Times and true forces of the ends and tensions (N), and pitches (rad) of a plant."""
    truth = json.loads((bag / TRUTH_FILE).read_text(encoding="utf-8"))
    found = {"time": np.array(truth["time"])}
    found |= {f"{end}/force": np.linalg.norm(np.array(truth[end]), axis=1) for end in ("start", "end")}
    pitches, tensions = np.array(truth["pitches"]), np.array(truth["tensions"])
    found |= {f"cable/{which} tension": tensions[:, row] for row, which in enumerate(("lowest", "highest"))}
    return found | {f"cabin/{body}/pitch": pitches[:, row] for row, body in enumerate(BODIES)}


def estimates(directory: Path) -> dict[str, np.ndarray]:
    """Times (s), values and deviations (n, 3) of what `follow` has estimated, by name."""
    log, found = read_log(directory), dict[str, list[tuple[float, float, float]]]()
    for _, stamp, data in log.messages([ESTIMATE]):
        for status in statuses_of_message(data):
            if "value" in status.values:
                value, deviation = (float(status.values[key]) for key in ("value", "standard_deviation"))
                row = (stamp - log.epoch_ns) * 1e-9, value, deviation
                found.setdefault(status.name, []).append(row)
    return {name: np.array(rows) for name, rows in found.items()}


def scores(
    plant: int, values: Mapping[str, float], truth: dict[str, np.ndarray], found: dict[str, np.ndarray]
) -> Iterator[Score]:
    """Scores of all estimates of a plant, with values by key and true values over time, from `FIRST` on."""
    for name, rows in found.items():
        if name not in truth and name not in SLOW:
            continue
        key, unit = SLOW.get(name, ("", "rad" if name.endswith("pitch") else "N"))
        for time, got, deviation in rows[rows[:, 0] > FIRST]:
            true = float(np.interp(time, truth["time"], truth[name])) if name in truth else values.get(key, 0.0)
            yield Score(plant, float(time), name, unit, true, float(got) - true, float(deviation))


def largest(found: list[Score]) -> list[str]:
    """Lines with the largest error of each hidden quantity: of a force as a share of it, of an angle in degrees."""
    lines = []
    for name in dict.fromkeys(one.name for one in found if one.name not in SLOW):
        own = [one for one in found if one.name == name]
        if own[0].unit == "N":
            lines.append(f"{name}: at most {100.0 * max(abs(one.error / one.truth) for one in own):.2f} % off")
        else:
            angles = np.degrees([one.error for one in own])
            lines.append(f"{name}: {np.sqrt(np.mean(angles**2)):.2f} deg off, at most {np.abs(angles).max():.2f} deg")
    return lines


def trip_of(exudyn: Any, number: int, options: argparse.Namespace) -> Trip:
    """One of the `TRIPS` in Exudyn."""
    start, speed = TRIPS[number]
    values = {key: value * WRONG.get(key, 1.0) if options.wrong else value for key, value in TRUTH.items()}
    with tempfile.TemporaryDirectory() as name:
        script = Path(name) / "trip.yaml"
        script.write_text(SCRIPT.format(start=start, speed=speed), encoding="utf-8")
        return travel(exudyn, Plan(script, options.duration, options.element, values))


def followed(trip: Trip, seed: int, *, inclinometer: bool = True) -> list[Score]:
    """Scores of a trip whose sensors have the noise of a seed, by a twin with the values of `TRUTH`.

    Raises:
        RuntimeError: the plant could not be followed.
    """
    twin = [word for key, value in {**FREE_SPAN, **TRUTH}.items() for word in ("--set", f"{key}={json.dumps(value)}")]
    with tempfile.TemporaryDirectory() as name:
        plants, twins = Path(name) / "plants", Path(name) / "twins"
        bag = record(trip, plants, seed, inclinometer=inclinometer)
        if follow.main([str(bag), "--scenario", "aerial_tramway", *twin, "--output", str(twins)]):
            raise RuntimeError(f"the trip with seed {seed} could not be followed")
        (log,) = twins.iterdir()
        return list(scores(seed, trip.values, true_values(bag), estimates(log)))


def main() -> int:
    """Record plants, follow them, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.following_exudyn", description=__doc__, formatter_class=Filled
    )
    text = f"m, of the plant's rope where its carriage goes; default: {ELEMENT:g}"
    parser.add_argument("--element", type=float, default=ELEMENT, help=text)
    parser.add_argument("--duration", type=float, default=DURATION, help=f"s; default: {DURATION:g}")
    parser.add_argument("--trips", type=int, choices=range(1, len(TRIPS) + 1), default=len(TRIPS), help="of Exudyn")
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"of the noise, for each trip; default: {SEEDS}")
    text = f"plants with {HEAVIER:g} times the rope mass, {SOFTER:g} times its stiffness, and {ROUGHER:g} times the "
    parser.add_argument("--wrong", action="store_true", help=text + "rolling friction of their twins")
    options = parser.parse_args()
    exudyn = load_exudyn()
    if exudyn is None:
        print(f"following_exudyn: {MISSING}", file=sys.stderr)
        return 2
    found, blind, number = [], [], 0
    for one in range(options.trips):
        trip = trip_of(exudyn, one, options)
        for _ in range(options.seeds):
            number += 1
            found += followed(trip, number)
        blind += followed(trip, number, inclinometer=False)
    swings = largest([one for one in blind if one.unit == "rad"])
    print("\n".join([*table(found), "", *largest(found), "", "without an inclinometer:", *swings]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
