"""A twin that follows a plant in Exudyn: errors of tension and swing beside what is claimed.

`python -m verification.following_exudyn` records `verification.exudyn_plant` on a trip, follows its bag as `follow`
does, and prints a table for docs/follow.md. Truth is what the plant writes beside its bag. Needs Exudyn, which is in
the extra `bench`.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from cable_twin.messages import ESTIMATE, statuses_of_message
from cable_twin.offline import follow
from cable_twin.recording.log_reader import read_log
from cable_twin.terminal.command_line import Filled
from verification import exudyn_plant

SCRIPT = "- {time: 4, name: cabin, speed: 6.0}\n"
ELEMENTS, DURATION, FIRST = 144, 90.0, 15.0  # -, s, s: from which on estimates count
BODIES = ("running_carriage", "hanger", "cabin")  # whose pitch the plant writes
DEGREE = np.pi / 180.0


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


def table(truth: dict[str, np.ndarray], found: dict[str, np.ndarray]) -> list[str]:
    """Table in Markdown: rms and largest error, the latter of a force also as a share, and the claimed deviation."""
    lines = [
        "| estimate | unit | rms error | largest | of it, % | claimed deviation |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name in [name for name in truth if name != "time"]:
        time, value, deviation = found[name][found[name][:, 0] > FIRST].T
        true = np.interp(time, truth["time"], truth[name])
        angle = name.endswith("pitch")
        scale, unit = (DEGREE, "deg") if angle else (1.0, "N")
        error = (value - true) / scale
        rms, claimed = np.sqrt(np.mean(error**2)), np.sqrt(np.mean(deviation**2)) / scale
        share = "" if angle else f"{100.0 * np.abs(error / true).max():.2f}"
        lines.append(f"| {name} | {unit} | {rms:.3g} | {np.abs(error).max():.3g} | {share} | {claimed:.3g} |")
    return lines


def main() -> int:
    """Record a plant, follow it, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.following_exudyn", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--elements", type=int, default=ELEMENTS, help=f"of the plant's rope; default: {ELEMENTS}")
    parser.add_argument("--duration", type=float, default=DURATION, help=f"s; default: {DURATION:g}")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        script, plants, twins = (Path(name) / part for part in ("trip.yaml", "plants", "twins"))
        script.write_text(SCRIPT, encoding="utf-8")
        values = {"script": script, "duration": options.duration, "elements": options.elements, "log": plants}
        if code := exudyn_plant.main([word for key, value in values.items() for word in (f"--{key}", str(value))]):
            return code
        (bag,) = plants.iterdir()
        if code := follow.main([str(bag), "--output", str(twins)]):
            return code
        (log,) = twins.iterdir()
        print("\n".join(table(true_values(bag), estimates(log))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
