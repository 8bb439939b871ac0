"""Command of the benchmarks: parts, extent of each, and directory of the tables."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from benchmarks import (
    accuracy,
    convergence,
    coupled,
    emergency_stop,
    ensemble,
    envelope,
    exudyn_comparison,
    exudyn_space,
    frame,
    graded,
    learning,
    live,
    loads,
    lockstep,
    outlook,
    ropes,
    scaling,
    space,
    startup,
    study,
    uniform,
)
from benchmarks.measure import BenchmarkError, Effort
from benchmarks.report import merge, print_part, read, write
from cable_twin.scenario import ScenarioError
from cable_twin.terminal.command_line import Filled

FILE_WIDTH = 120  # columns where the output is no terminal
DONE, FAILED = 0, 1  # exit codes; argparse ends with 2
PARTS = {
    "exudyn": (exudyn_comparison.run, "cost of a step, ours and Exudyn's on the same mesh, and how far they are apart"),
    "exudyn_space": (exudyn_space.run, "the same in space, beside Exudyn's ANCFCable: a rope of 1 km pushed sideways"),
    "space": (space.run, "the shipped ropeways in space beside themselves in a plane"),
    "ropes": (ropes.run, "one to eight ropes, alone and coupled, and the pantograph of EN 50318"),
    "scaling": (scaling.run, "cost over 12 to 3200 elements and 1 to 200 carriages, with fitted exponents"),
    "startup": (startup.run, "memory, import, cold and warm start of a fresh process"),
    "frame": (frame.run, "a frame of the twin: solve, sample, serialise, publish, MCAP, rerun"),
    "graded": (graded.run, "graded meshes beside even ones: cost, key figures, shape of the rope"),
    "uniform": (uniform.run, "even meshes, whose model is as it was, beside the unit: cost of the solver alone"),
    "loads": (loads.run, "cost of a step of each shipped ropeway, and its ratio to another checkout (--beside)"),
    "accuracy": (accuracy.run, "wall time to be within 2 mm at 1 s, over elements, step, spectral radius, tolerance"),
    "convergence": (convergence.run, "error of the default scenario, over elements and step"),
    "coupled": (
        coupled.run,
        "iterations and cost of coupled ropes, and the latter's ratio to another checkout (--beside)",
    ),
    "learning": (learning.run, "steps per second of the environment of gymnasium, beside the plain Python API"),
    "ensemble": (ensemble.run, "32 twins side by side beside a plain loop: real time, threads, forks, memory"),
    "outlook": (outlook.run, "processor time of three futures of a minute, ahead of a running twin"),
    "envelope": (envelope.run, "1,000 load cases of 80 towers at rest, the parts of a case, two cores beside one"),
    "study": (study.run, "overhead of a case of a study, two workers beside one, and tables of many cases"),
    "lockstep": (lockstep.run, "frames a second of a twin that is stepped through its service, beside the plain API"),
    "emergency_stop": (
        emergency_stop.run,
        "answers to an emergency stop under floods, bombs and full disks; only when named",
    ),
    "live": (live.run, "frames of the running twin that came late, beside a bare timer; only when named"),
}
BY_DEFAULT = [name for name in PARTS if name not in ("emergency_stop", "live")]  # these want the machine for themselves
EPILOG = """\
examples:
  python -m benchmarks exudyn scaling --output docs
  python -m benchmarks live --minutes 10 --output docs

With --output, DIR/benchmarks.json keeps the parts that were not run as they were, and DIR/benchmarks.md shows them all.

exit codes: 0 measured, and all is as it has to be; 1 a limit was missed, two programs moved apart, or something could
not be measured or written; 2 wrong arguments
"""


def positive(text: str) -> int:
    """Parse an integer above zero."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} given; allowed are whole numbers from 1")
    return int(text)


def duration(text: str) -> float:
    """Parse a finite duration above zero."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text!r} given; allowed are numbers above 0")
    return value


def part_name(text: str) -> str:
    """Parse the name of a part."""
    if text not in PARTS:
        raise argparse.ArgumentTypeError(f"{text!r} is no part; allowed are {', '.join(PARTS)}")
    return text


def main() -> int:
    """Run the requested parts."""
    width = max(map(len, PARTS))
    described = "\n".join(f"  {name:<{width}}  {text}" for name, (_, text) in PARTS.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=f"Measure the solver on one thread, medians of interleaved repetitions.\n\nparts:\n{described}",
        epilog=EPILOG,
        formatter_class=Filled,
    )
    parser.add_argument(
        "parts", nargs="*", type=part_name, metavar="PART", help="which parts; default: all but the last two"
    )
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes: fewer and shorter cases")
    parser.add_argument("--repetitions", type=positive, metavar="N", help="default: 5, 1 with --quick")
    parser.add_argument(
        "--minutes", type=duration, metavar="N", help="of live; default: 2, a tenth of one with --quick"
    )
    parser.add_argument(
        "--scenario",
        action="append",
        metavar="NAME",
        help="of live, name or path; may be given often; default: aerial_tramway",
    )
    parser.add_argument(
        "--beside", type=Path, metavar="PATH", help="of loads and coupled: another checkout, which runs in turn"
    )
    parser.add_argument("--output", type=Path, metavar="DIR", help="write benchmarks.md, .json and pictures there")
    options = parser.parse_args()

    chosen = list(dict.fromkeys(options.parts or BY_DEFAULT))
    for name in ("minutes", "scenario"):
        if getattr(options, name) is not None and "live" not in chosen:
            parser.error(f"--{name} is of the part live, which was not asked for")
    compared = {"loads", "coupled"} & {*chosen}
    if options.beside is not None and not (compared and (options.beside / "cable_twin").is_dir()):
        given = f"given {options.beside}" if compared else "neither loads nor coupled was asked for"
        parser.error(f"--beside: {given}; allowed: with loads or coupled, a directory that has cable_twin in it")
    try:
        earlier = read(options.output) if options.output else {}
    except (OSError, ValueError) as error:  # before minutes are spent
        print(f"{parser.prog}: --output {options.output}: {error}", file=sys.stderr)
        return FAILED
    repetitions = options.repetitions or (1 if options.quick else 5)
    effort = Effort(
        options.quick,
        repetitions,
        options.minutes,
        tuple(options.scenario or ()),
        options.beside and options.beside.resolve(),
    )
    console = Console(width=None if sys.stdout.isatty() else FILE_WIDTH)
    columns = (TextColumn("{task.description:<48}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    faults = []
    parts = {}
    for name in chosen:
        try:
            with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as progress:
                parts[name] = PARTS[name][0](effort, progress)
        except (BenchmarkError, ScenarioError) as error:
            faults.append(f"{name}: {error}")
            continue
        print_part(parts[name], console)
        faults += parts[name].faults
    if options.output is not None:
        try:
            files = write(options.output, merge(earlier, parts, order=list(PARTS)), parts)
        except OSError as error:
            print(f"{parser.prog}: --output {options.output}: {error}", file=sys.stderr)
            return FAILED
        for file in files:
            console.print(f"wrote {file}", highlight=False)
    for fault in faults:
        print(f"{parser.prog}: {fault}", file=sys.stderr)
    return FAILED if faults else DONE
