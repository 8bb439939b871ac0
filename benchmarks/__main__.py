"""Measure the solver and print tables; see `python -m benchmarks --help`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from benchmarks import accuracy, exudyn_comparison, frame, scaling, startup
from benchmarks.report import merge, print_part, write

FILE_WIDTH = 120  # columns where the output is no terminal
DONE, FAILED, INTERRUPTED = 0, 1, 130  # exit codes; argparse ends with 2
PARTS = {
    "exudyn": (exudyn_comparison.run, "cost of a step, ours and Exudyn's on the same mesh, and how far they are apart"),
    "scaling": (scaling.run, "cost over 12 to 3200 elements and 1 to 200 carriages, with fitted exponents"),
    "startup": (startup.run, "memory, import, cold and warm start of a fresh process"),
    "frame": (frame.run, "a frame of the twin: solve, sample, serialise, publish, MCAP, rerun"),
    "accuracy": (accuracy.run, "wall time to be within 2 mm at 1 s, over elements, step, spectral radius, tolerance"),
}
EPILOG = """\
example: python -m benchmarks exudyn scaling --output docs

With --output, DIR/benchmarks.json keeps the parts that were not run as they were, and DIR/benchmarks.md shows them all.
exit codes: 0 measured, 1 two programs moved apart or a file could not be written, 2 wrong arguments
"""


def positive(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} given; allowed are whole numbers from 1")
    return int(text)


def part_name(text: str) -> str:
    """The name of a part."""
    if text not in PARTS:
        raise argparse.ArgumentTypeError(f"{text!r} is no part; allowed are {', '.join(PARTS)}")
    return text


def main() -> int:
    """Run the parts that were asked for."""
    width = max(map(len, PARTS))
    described = "\n".join(f"  {name:<{width}}  {text}" for name, (_, text) in PARTS.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=f"Measure the solver on one thread, medians of interleaved repetitions.\n\nparts:\n{described}",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", type=part_name, metavar="PART", help="which parts; default: all")
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes: fewer and shorter cases")
    parser.add_argument("--repetitions", type=positive, metavar="N", help="default: 5, 1 with --quick")
    parser.add_argument("--output", type=Path, metavar="DIR", help="write benchmarks.md, .json and accuracy.png there")
    options = parser.parse_args()

    repetitions = options.repetitions or (1 if options.quick else 5)
    console = Console(width=None if sys.stdout.isatty() else FILE_WIDTH)
    columns = (TextColumn("{task.description:<48}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    faults = []
    parts = {}
    for name in dict.fromkeys(options.parts or PARTS):
        with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as progress:
            parts[name] = PARTS[name][0](options.quick, repetitions, progress)
        print_part(parts[name], console)
        faults += parts[name].faults
    if options.output is not None:
        try:
            files = write(options.output, merge(options.output, parts, order=list(PARTS)), parts)
        except (OSError, ValueError) as error:
            print(f"{parser.prog}: --output {options.output}: {error}", file=sys.stderr)
            return FAILED
        for file in files:
            console.print(f"wrote {file}", highlight=False)
    for fault in faults:
        print(f"{parser.prog}: {fault}", file=sys.stderr)
    return FAILED if faults else DONE


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
