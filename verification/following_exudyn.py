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
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cable_twin.messages import ESTIMATE, statuses_of_message
from cable_twin.offline import follow
from cable_twin.recording.log_reader import read_log
from cable_twin.terminal.command_line import Filled
from verification import exudyn_plant
from verification.following import Score, table

SCRIPT = "- {{time: {start:g}, name: cabin, speed: {speed:g}}}\n"
TRIPS = (4.0, 6.0), (3.0, 4.5), (3.0, 7.5)  # s, m/s: start and speed of each plant
ELEMENTS, DURATION, FIRST = 216, 90.0, 15.0  # -, s, s: from which on estimates count
BODIES = ("running_carriage", "hanger", "cabin")  # whose pitch the plant writes
SLOW = {  # truth of slow quantities, with their units
    "cabin/payload": (exudyn_plant.TRUTH["carriages.cabin.payload.mass"], "kg"),
    "cabin/rolling": (exudyn_plant.TRUTH["carriages.cabin.friction.rolling"], "-"),
    "wind/x": (0.0, "m/s"),
    "ice": (0.0, "kg/m"),
    "start/counterweight": (exudyn_plant.TRUTH["cable.start.mass"], "kg"),
}


def true_values(bag: Path) -> dict[str, np.ndarray]:
    """Times and true forces of the ends (N) and pitches (rad) of a plant."""
    truth = json.loads((bag / exudyn_plant.TRUTH_FILE).read_text(encoding="utf-8"))
    found = {"time": np.array(truth["time"])}
    found |= {f"{end}/force": np.linalg.norm(np.array(truth[end]), axis=1) for end in ("start", "end")}
    pitches = np.array(truth["pitches"])
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


def scores(plant: int, truth: dict[str, np.ndarray], found: dict[str, np.ndarray]) -> Iterator[Score]:
    """Scores of all estimates of a plant with known truth, from `FIRST` on."""
    for name, rows in found.items():
        if name not in truth and name not in SLOW:
            continue
        value, unit = SLOW.get(name, (0.0, "rad" if name.endswith("pitch") else "N"))
        for time, got, deviation in rows[rows[:, 0] > FIRST]:
            true = float(np.interp(time, truth["time"], truth[name])) if name in truth else value
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


def main() -> int:
    """Record a plant, follow it, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.following_exudyn", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--elements", type=int, default=ELEMENTS, help=f"of the plant's rope; default: {ELEMENTS}")
    parser.add_argument("--duration", type=float, default=DURATION, help=f"s; default: {DURATION:g}")
    parser.add_argument("--plants", type=int, choices=range(1, len(TRIPS) + 1), default=len(TRIPS), help="trips")
    options = parser.parse_args()
    found: list[Score] = []
    for plant, (start, speed) in enumerate(TRIPS[: options.plants]):
        with tempfile.TemporaryDirectory() as name:
            script, plants, twins = (Path(name) / part for part in ("trip.yaml", "plants", "twins"))
            script.write_text(SCRIPT.format(start=start, speed=speed), encoding="utf-8")
            values = {"script": script, "duration": options.duration, "elements": options.elements, "log": plants}
            values["seed"] = 1 + plant
            if code := exudyn_plant.main([word for key, value in values.items() for word in (f"--{key}", str(value))]):
                return code
            (bag,) = plants.iterdir()
            if code := follow.main([str(bag), "--output", str(twins)]):
                return code
            (log,) = twins.iterdir()
            found += scores(plant, true_values(bag), estimates(log))
    print("\n".join([*table(found), "", *largest(found)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
