"""Command `report`: report of a recorded run, of load cases, or of a study as one HTML page, optionally as PDF."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from rich.console import Console

from cable_twin.offline.reporting.from_envelope import read_envelope
from cable_twin.offline.reporting.from_log import read_results
from cable_twin.offline.reporting.from_study import is_study, read_study
from cable_twin.offline.reporting.page import PrintError, find_printer
from cable_twin.offline.reporting.results import Results, ResultsError
from cable_twin.offline.reporting.texts import LANGUAGES, Texts
from cable_twin.offline.review import RUNS, newest_run
from cable_twin.offline.simulate_options import add_rule_options, profile_fault
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import ScenarioError
from cable_twin.simulation import EquilibriumError
from cable_twin.terminal.bars import count_shown, share_shown
from cable_twin.terminal.command_line import OneLineParser, fail, left_at_once, number, print_line, tell, typed

DONE, NOT_WRITTEN, CANNOT = 0, 1, 2
MOST_TRIPS = 1e7  # in a year
EXTRA = "cable_twin[report]"
EPILOG = """\
The page has everything in it and opens without a network: line profile, rope tension, tower loads, key figures and
rules with clause and verdict, load cases, plots over time, assumptions, inputs with their remarks, versions and the
command that made it. Its numbers are those of `review`, and of
`envelope` for the file of load cases that it writes with --json, of which the states at rest that govern tensions,
sags and tower loads are calculated once more for the drawings.

exit codes: 0 written, 1 a file cannot be written or a rule profile of the log is not there, 2 a log cannot be read or
an option is wrong, 130 ended by Ctrl-C

examples:
  simulate chairlift --duration 20 --output runs --record bag
  report runs/*
  report runs/* --profile france_2009 --profile pennsylvania
  report runs/* --language de --pdf lift.pdf --trips 8000
  envelope chairlift --cases examples/load_cases.yaml --places 1 \\
           --json all.json
  report all.json --profile france_2009 --profile new_zealand_1972
"""


def parser() -> OneLineParser:
    """Parser of the options of `report`."""
    result = OneLineParser(
        "report", "Write a report of a run, load cases or a study as one HTML page.", EPILOG, failure=CANNOT
    )
    result.add_argument(
        "source",
        type=Path,
        nargs="?",
        metavar="SOURCE",
        help="directory of a run, or its .mcap, or a .json of `envelope --json`, or the directory of `study --out`; "
        f"default: the newest run in {RUNS}",
    )
    result.add_argument(
        "--output", type=_page, metavar="PAGE.html", help="the page; default: SCENARIO_report.html in this directory"
    )
    result.add_argument(
        "--pdf",
        type=Path,
        metavar="PAGE.pdf",
        help="write the page as a PDF, too; needs WeasyPrint, or else Chromium",
    )
    result.add_argument("--language", choices=tuple(LANGUAGES), default="en", help="language of the page; default: en")
    add_rule_options(result, more=", and the page then shows where profiles differ")
    result.add_argument(
        "--trips",
        type=number(0.0, MOST_TRIPS),
        metavar="N",
        help="trips in a year, for the bending cycles and cycles of tension of the ropes in a year",
    )
    result.add_argument(
        "--scenario",
        type=Path,
        metavar="FILE",
        help="YAML file of the scenario, whose remarks name sources and assumptions; default: the one that `envelope` "
        "has put into its .json, else the shipped one of its name",
    )
    return result


def _page(text: str) -> Path:
    if Path(text).suffix.lower() not in (".html", ".htm"):
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: a name that ends in .html")
    return Path(text)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the report of a run, load cases or study; returns the exit code that the help lists."""
    given = sys.argv[1:] if argv is None else list(argv)
    arguments = parser()
    options = arguments.parse_args(given)
    if find_spec("jinja2") is None:
        arguments.error(f"this needs jinja2, which this Python does not have: {typed('pip')} install '{EXTRA}'")
    if fault := profile_fault(options.profile):
        arguments.error(fault)
    options.printer = None
    if options.pdf is not None:
        try:
            options.printer = find_printer()
        except PrintError as error:
            arguments.error(f"--pdf: {error}: {typed('pip')} install '{EXTRA}'")
    if options.source is None:
        options.source = next(iter(newest_run(RUNS)), None)
        if options.source is None:
            arguments.error(f"no run in {RUNS}: give the directory of one")
    try:
        results = _read(options, Console(stderr=True))
    except (LogError, ResultsError, ScenarioError, EquilibriumError) as error:
        return fail("report", error, CANNOT)
    results.trips = options.trips
    return _write(options, results, shlex.join(["report", *given]))


def _read(options: argparse.Namespace, console: Console) -> Results:
    """Read the results of the given source: a study, the JSON of an envelope, or the log of a run."""
    if is_study(options.source):
        return read_study(options.source, options.scenario, options.profile, dict(options.fact))
    if options.source.suffix == ".json":
        with left_at_once("report"), ExitStack() as bars:

            def on_state(count: int) -> Callable[[], object]:
                return bars.enter_context(count_shown(console, "states at rest", count))

            return read_envelope(options.source, on_state, options.scenario, options.profile, dict(options.fact))
    log = read_log(options.source)
    with share_shown(console, f"reading {log.path.name}") as show:

        def on_position(position: int) -> None:
            show(min(position / max(log.size, 1), 1.0))

        return read_results(log, on_position, options.profile, dict(options.fact), options.scenario)


def _write(options: argparse.Namespace, results: Results, command: str) -> int:
    """Write the page of a report, and its PDF where wanted; returns the exit code."""
    from cable_twin.offline.reporting.page import write_page  # noqa: PLC0415 - jinja2 is an extra

    page = options.output or Path(f"{results.scenario.name}_report.html")
    text = write_page(results, Texts(options.language), command, metadata.version("cable_twin"))
    try:
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        tell("report", f"--output {page}: {error.strerror or error}")
        return NOT_WRITTEN
    print_line(f"report: {page}")
    if options.printer is not None:
        try:
            options.printer(text, options.pdf)
        except (PrintError, OSError) as error:
            tell("report", f"--pdf {options.pdf}: {getattr(error, 'strerror', None) or error}")
            return NOT_WRITTEN
        print_line(f"PDF: {options.pdf}")
    if not results.inputs.file:
        name = results.scenario.name
        tell("report", "note: inputs count as assumed, as remarks on them are not in the log: --scenario with the file "
             f"of {name!r} has them, if it is at hand")  # fmt: skip
    for fault in results.notes:
        tell("report", f"{options.source}: {fault}")
    return NOT_WRITTEN if results.notes else DONE


if __name__ == "__main__":
    sys.exit(main())
