"""Command of the fuzzers: their names and durations; see `python -m fuzzing --help`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from cable_twin.terminal.command_line import Filled
from fuzzing import DONE, FUZZERS, REFUSED
from fuzzing.harness import FINDINGS, SEEDS, Counts, fuzz, replay

FOUND, INTERRUPTED = 1, 130  # exit codes; argparse ends with 2
FILE_WIDTH = 140  # columns where the output is no terminal
EPILOG = """\
examples:
  python -m fuzzing scenarios --minutes 60 --seed 7
  python -m fuzzing --minutes 1                                       each of them
  python -m fuzzing snapshots --case fuzzing_findings/snapshots/signal_1.npz

Each case runs in a child process with 4 GB of memory and 30 s, in which neither waiting for a core that others have nor
compiling counts. What is found is kept in fuzzing_findings/NAME: the case as a file, and beside it what it caused.

exit codes: 0 nothing was found; 1 something was; 2 wrong arguments; 130 ended by Ctrl-C
"""


def _minutes(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text!r} given; allowed are numbers above 0")
    return value


def _arguments() -> argparse.ArgumentParser:
    width = max(map(len, FUZZERS))
    described = "\n".join(f"  {name:<{width}}  {text}" for name, text in FUZZERS.items())
    parser = argparse.ArgumentParser(
        prog="python -m fuzzing",
        description=f"Feed hostile input to the program and count what comes of it.\n\nfuzzers:\n{described}",
        epilog=EPILOG,
        formatter_class=Filled,
    )
    names = parser.add_argument("names", nargs="*", metavar="NAME")
    names.help = f"which; default: all; of {', '.join(FUZZERS)}"
    parser.add_argument("--minutes", type=_minutes, default=1.0, metavar="M", help="for each; default: 1")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="from which the cases come; default: 1")
    parser.add_argument(
        "--keep", type=Path, default=Path("fuzzing_findings"), metavar="DIR", help="default: fuzzing_findings"
    )
    parser.add_argument("--case", type=Path, metavar="FILE", help="run this one case of a fuzzer, and say what it does")
    return parser


def main() -> int:
    """Run the command line."""
    parser = _arguments()
    options = parser.parse_args()
    if unknown := [name for name in options.names if name not in FUZZERS]:
        parser.error(f"NAME: given {unknown[0]!r}; allowed: {', '.join(FUZZERS)}")
    names = list(dict.fromkeys(options.names or FUZZERS))
    if options.case is not None:
        if len(options.names) != 1 or not options.case.is_file():
            parser.error(f"--case {options.case}: one NAME and a file that exists are needed")
        kind, text = replay(f"fuzzing.{names[0]}", options.case)
        print(f"{kind}\n{text}".strip())
        return FOUND if kind in FINDINGS else 0
    results = {name: _run(name, options) for name in names}
    console = Console(width=None if sys.stdout.isatty() else FILE_WIDTH)
    console.print(_table(results))
    for name, counts in results.items():
        for one in counts.findings:
            console.print(
                f"{name}: {one.kind}: {one.place}: {one.files[0] if one.files else one.text}",
                markup=False,
                highlight=False,
            )
    return FOUND if any(counts.findings for counts in results.values()) else 0


def _run(name: str, options: argparse.Namespace) -> Counts:
    columns = TextColumn("{task.description:<12}"), TimeElapsedColumn(), TextColumn("{task.fields[counts]}")
    with Progress(*columns, console=Console(stderr=True)) as progress:
        bar = progress.add_task(name, total=None, counts="")

        def show(counts: Counts) -> None:
            found = sum(counts.kinds[kind] for kind in FINDINGS)
            text = (
                f"{counts.runs} runs, {counts.kinds[REFUSED]} refused, {found} found at {len(counts.findings)} places"
            )
            progress.update(bar, counts=text)

        return fuzz(
            f"fuzzing.{name}",
            seconds=60.0 * options.minutes,
            number=options.seed,
            keep=options.keep,
            on_case=show,
            seeds=SEEDS / name,
        )


def _table(results: dict[str, Counts]) -> Table:
    table = Table()
    table.add_column("fuzzer")
    for title in ("min", "runs", "done", "refused", *FINDINGS, "places", "peak MB", "slowest s"):
        table.add_column(title, justify="right")
    for name, counts in results.items():
        kinds = (str(counts.kinds[kind]) for kind in (DONE, REFUSED, *FINDINGS))
        rest = f"{len(counts.findings)}", f"{counts.peak / 2**20:.0f}", f"{counts.slowest:.1f}"
        table.add_row(name, f"{counts.seconds / 60.0:.1f}", f"{counts.runs}", *kinds, *rest)
    return table


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
