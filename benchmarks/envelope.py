"""Load cases of a long chairlift at rest: cases a second, where the time goes, and two workers beside one."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import pairwise
from math import hypot
from pathlib import Path
from typing import Any, NamedTuple

from rich.progress import Progress

from benchmarks.measure import LEAST_SHARE, Effort, environment_of_user, timed
from benchmarks.report import Part, Table, Value
from cable_twin.key_figures import KeyFigures
from cable_twin.offline.envelope import envelope
from cable_twin.offline.envelopes.cases import LoadCase, read_cases
from cable_twin.offline.envelopes.runs import CaseResult, Job, run_case
from cable_twin.offline.export import figure_columns
from cable_twin.scenario import load_scenario
from cable_twin.simulation.rests import Rests

TOWERS = (40, 80)  # of both strands: twice as many supports
SPACING, SLOPE, BEND = 50.0, 0.2, 0.15  # m, and slope of the line, steeper by so much at its start, gentler at its end
MOST_TIME, CASES = 60.0, 1000  # s, for so many cases of the longest line on two cores
LEAST_GAIN = 1.6  # of two workers beside one; they share a start, which reads all cases, and an end, which writes
WINDS = (-12, -9, -6, -3, 0, 3, 6, 9, 12, 15)  # m/s
WEIGHTS = (31, 32, 33, 34, 35)  # t
TEMPERATURES = (-20, -5, 10, 25, 40)  # degC


def run(effort: Effort, progress: Progress) -> Part:
    """Measure the parts of a case in one process, and whole envelopes by the command on one core and on two."""
    faults: list[str] = []
    shares: list[dict[str, Value]] = []
    gain: list[dict[str, Value]] = []
    whole: list[dict[str, Value]] = []
    task = progress.add_task("load cases", total=3 * len(TOWERS))
    with tempfile.TemporaryDirectory() as directory:
        for towers in TOWERS:
            line, cases = Path(directory) / f"line_{towers}.yaml", Path(directory) / "cases.yaml"
            line.write_text(json.dumps(long_line(towers)), encoding="utf-8")
            cases.write_text(json.dumps(load_cases(2, 1)), encoding="utf-8")
            shares.append(_shares(towers, read_cases(cases, str(line), {})))
            progress.advance(task)
            few = load_cases(4, 1) if effort.quick else load_cases(10, 2)
            cases.write_text(json.dumps(few), encoding="utf-8")
            alone, both = (_command(line, cases, cores) for cores in (1, 2))
            progress.advance(task)
            gain.append(_gain(towers, _count(few), alone, both, faults))
            if not effort.quick:
                cases.write_text(json.dumps(load_cases(10, 5)), encoding="utf-8")
                whole.append(_row(towers, _command(line, cases, 2), faults))
            progress.advance(task)
    notes = [
        "A chairlift like the shipped one, its towers 50 m apart, a chair of each strand in every span; `--places 1`, "
        "CSV of all figures. Processor: that of the command and its workers together, start and imports included. "
        "Share: of two processors that they had; below 1, the machine did other work, and wall times are too long.",
    ]
    tables = [Table("processor time of a case in one process", shares), Table("two cores beside one", gain)]
    tables += [Table(f"{CASES} cases on two cores", whole)] if whole else []
    return Part("Load cases", tables, notes, faults)


def long_line(towers: int) -> dict[str, Any]:
    """Chairlift like the shipped one with so many towers, each of both strands, on a convex slope."""
    data = load_scenario("chairlift").resolved()
    tower = {key: value for key, value in data["towers"]["tower_1_up"].items() if key != "rope"}
    length = (towers + 1) * SPACING

    def height(x: float) -> float:
        return SLOPE * x + BEND * x * (1.0 - x / length)

    places = [(number + 1) * SPACING for number in range(towers)]
    knots = [(x, height(x)) for x in (0.0, *places, length)]
    chords = sum(hypot(x - before, z - below) for (before, below), (x, z) in pairwise(knots))
    data["name"] = f"chairlift_of_{towers}_towers"
    data["towers"] = {
        f"tower_{number}": {**tower, "position": list(knots[number]), "ropes": {"up": {}, "down": {}}}
        for number in range(1, towers + 1)
    }
    data["terrain"] = [[x, z - 10.0] for x, z in ((-20.0, 0.0), *knots[1:], (length + 20.0, height(length)))]
    for rope, end in (("up", "end"), ("down", "start")):
        data["ropes"][rope]["unstrained_length"] = round(chords * (1.0 - 230e3 / 62e6), 1)
        data["ropes"][rope][end]["position"] = [length, height(length)]
    data["carriers"]["count"] = 2 * towers
    data["sheaves"]["return"]["counterweight"]["travel"] = [-30.0, 30.0]
    return data


def load_cases(winds: int, temperatures: int) -> dict[str, Any]:
    """Content of a file of load cases: four loadings, five counterweights, and so many winds and temperatures."""
    plans = {"empty": "empty", "up": "up_full", "down": "down_full", "both": "full"}
    return {
        "product": {
            "temperature": {f"t{one}": {"set": {"air.temperature": one}} for one in TEMPERATURES[:temperatures]},
            "loading": {name: {"loading": plan} for name, plan in plans.items()},
            "wind": {f"w{one}": {"set": {"air.wind.x": one}} for one in WINDS[:winds]},
            "weight": {f"m{one}": {"set": {"sheaves.return.counterweight.mass": 1e3 * one}} for one in WEIGHTS},
        }
    }


def _count(content: dict[str, Any]) -> int:
    count = 1
    for levels in content["product"].values():
        count *= len(levels)
    return count


def _shares(towers: int, cases: Sequence[LoadCase]) -> dict[str, Value]:
    """Processor time (ms) of the parts of a case."""
    first, rest = cases[0], cases[4:24]
    scratch = timed(lambda: Rests(first.scenario)).processor
    rests = Rests(first.scenario)
    read = timed(lambda: [load_scenario(first.scenario.resolved(), {"air.wind.x": 1.0}) for _ in rest]).processor
    run_case(Job(rest[0], 1), first)  # its own rests are made here
    results: list[CaseResult] = []
    whole = timed(lambda: results.extend(run_case(Job(one, 1), first) for one in rest)).processor
    found = timed(lambda: [rests.under(one.scenario) for one in rest]).processor
    snapshot = rests.snapshot

    def figures() -> None:
        for one in rest:
            key_figures = KeyFigures(one.scenario)
            key_figures.update(snapshot)
            key_figures.figures()

    gathered = timed(figures).processor
    written = timed(lambda: [figure_columns(one) for result in results for one in result.figures]).processor
    together = timed(lambda: envelope(results)).processor
    each = 1e3 / len(rest)
    return {
        "towers": towers,
        "figures of a case": len(results[0].figures),
        "from scratch [ms]": 1e3 * scratch,
        "a case [ms]": each * whole,
        "its rest [ms]": each * found,
        "its figures [ms]": each * gathered,
        "reading it [ms]": each * read,
        "rows of it [ms]": each * written,
        "its extremes [ms]": each * together,
    }


class Times(NamedTuple):
    """Times (s) of a command: wall, and processor with all its workers."""

    wall: float
    processor: float


def _command(line: Path, cases: Path, cores: int) -> Times:
    """Times of `envelope` on a number of cores."""
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    text = "import sys; from cable_twin.offline.envelope import main; sys.exit(main())"
    out = line.with_suffix(".csv")
    command = [sys.executable, "-c", text, str(line), "--cases", str(cases), "--places", "1", "--csv", str(out)]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        command,
        check=True,
        capture_output=True,
        env=environment_of_user(),
        preexec_fn=lambda: os.sched_setaffinity(0, allowed),
    )
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Times(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def _gain(towers: int, count: int, alone: Times, both: Times, faults: list[str]) -> dict[str, Value]:
    """Row of two cores beside one; what is missed of what is wanted goes to the faults."""
    gain, shares = alone.wall / both.wall, (alone.processor / alone.wall, both.processor / (2.0 * both.wall))
    if min(shares) > LEAST_SHARE and gain < LEAST_GAIN:
        faults.append(f"{towers} towers: two cores are {gain:.2f} times one; allowed: at least {LEAST_GAIN:g}")
    return {
        "towers": towers,
        "cases": count,
        "one core [s]": alone.wall,
        "two cores [s]": both.wall,
        "gain": gain,
        "processor, one core [s]": alone.processor,
        "two cores, processor [s]": both.processor,
        "share of one core": shares[0],
        "share of two cores": shares[1],
    }


def _row(towers: int, both: Times, faults: list[str]) -> dict[str, Value]:
    """Row of all cases of one line; what is missed of what is wanted goes to the faults."""
    share = both.processor / (2.0 * both.wall)
    if towers == max(TOWERS) and share > LEAST_SHARE and both.wall > MOST_TIME:
        faults.append(f"{CASES} cases of {towers} towers take {both.wall:.0f} s; allowed: {MOST_TIME:g} s")
    return {
        "towers": towers,
        "wall [s]": both.wall,
        "cases a second": CASES / both.wall,
        "processor [s]": both.processor,
        "share of two cores": share,
    }
