"""Command `envelope`: load cases of a line at rest, and extremes of key figures with the governing case."""

from __future__ import annotations

import csv
import hashlib
import json
import shlex
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rich.console import Console

from cable_twin.basics.units import counted
from cable_twin.ensemble import usable_cores
from cable_twin.key_figures import FigureId, KeyFigure, compile_figures, figure_from_values, values_of
from cable_twin.key_figures.figure import as_statistic
from cable_twin.key_figures.quantities import BOTH
from cable_twin.key_figures.rules import RuleVerdict, judge, profiles_of
from cable_twin.key_figures.rules.verdicts import NOT_DECIDED, severity, with_place
from cable_twin.offline.envelopes.cases import PLANS, CaseError, LoadCase, case_columns, read_cases
from cable_twin.offline.envelopes.ranges import ranges_of_plain, united
from cable_twin.offline.envelopes.runs import CaseResult, Job, neighbours, run_part, run_side_by_side, uncollected
from cable_twin.offline.envelopes.tensioning import ALLOWED
from cable_twin.offline.export import FIGURE_COLUMNS, STDOUT, figure_columns, opened
from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.lines.at_rest import MOST
from cable_twin.offline.reporting.remarks import scenario_text
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, add_changes, plot_fault
from cable_twin.offline.verdict_table import print_verdicts, verdict_columns
from cable_twin.scenario import ScenarioError, load_scenario, scenario_lines
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import count_shown, start_shown
from cable_twin.terminal.command_line import INTERRUPTED, OneLineParser, fail, left_at_once, tell, whole_number

DONE, FAILED, UNUSABLE = 0, 1, 2
PLACES = 5
FEW = 4  # cases below which other processes would take longer to start
SUFFIX = ".json"  # of the result of a case
EPILOG = f"""\
A file of load cases has a list `cases`, or a mapping `product` of factors whose levels are combined, or both. A case
has `set`, changes by dotted key, `loading`, one of {", ".join(PLANS)},
`tensioning`, one of {ALLOWED},
`worst_place: {{points: N, figures: [ID]}}`, a search for it, and `load_cases` of rule profiles that it models:

  cases:
    - {{id: ice, name: ice of 3 kg/m, set: {{ropes.up.ice: 3.0}}}}
  product:
    load: {{empty: {{loading: empty}}, up: {{loading: up_full}}}}
    air:
      cold: {{set: {{air.temperature: -20}}}}
      hot: {{set: {{air.temperature: 40}}}}

With `dynamic: {{script: FILE, duration: S}}` a case is a run, as of `simulate`; with `stop: {{from: S, to: S, figures:
[ID]}}` within it, the emergency stop at the worst moment for these key figures, found by search.

Each case is calculated at rest for --places places of the vehicle, as `line` does, on all cores. The extremes of all
cases are printed with the case that governs, and the verdicts of the scenario's rule profiles, each of the worst case.

exit codes: 0 done, 1 a case has no equilibrium or a file cannot be written, 2 wrong scenario, file of cases or option,
130 ended by Ctrl-C

examples:
  envelope chairlift --cases examples/load_cases.yaml
  envelope chairlift --cases examples/load_cases.yaml --places 1 \\
           --results cases --csv cases.csv
"""


def parser() -> OneLineParser:
    """Parser of the options of `envelope`."""
    result = OneLineParser("envelope", "Calculate load cases of a line at rest.", EPILOG, failure=UNUSABLE)
    result.add_scenario(f"name of a scenario, or path of its YAML file; default: {DEFAULT_SCENARIO}", scenario_lines)
    result.add_argument("--cases", type=Path, required=True, metavar="FILE", help="YAML file of load cases")
    result.add_argument(
        "--places",
        type=whole_number(1, MOST),
        default=PLACES,
        metavar="N",
        help=f"places of the vehicle in each case, 1 to {MOST}; 1: where the scenario has it; default: {PLACES}",
    )
    add_changes(result)
    result.add_argument(
        "--results",
        type=Path,
        metavar="DIR",
        help="keep each finished case in this directory, and calculate only what is missing or has changed",
    )
    result.add_argument("--csv", metavar="PATH", help="write the figures of all cases, in SI units; '-': to stdout")
    result.add_argument("--json", metavar="PATH", help="write the envelope, in SI units; '-': to stdout")
    result.add_argument(
        "--plot",
        type=Path,
        metavar="PATH",
        help="plot tower loads and sags with the cases that govern, as .png, .pdf or .svg",
    )
    result.add_argument(
        "--parquet", type=Path, metavar="PATH", help="write the figures of all cases as Parquet; needs pyarrow"
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Calculate the load cases of a line and report their extremes; returns the exit code that the help lists."""
    arguments = parser()
    given = sys.argv[1:] if argv is None else list(argv)
    options = arguments.parse_args(given)
    options.source = source = arguments.given_scenario(options) or DEFAULT_SCENARIO
    options.command = shlex.join(["envelope", *given])
    if fault := plot_fault(options.plot):
        arguments.error(fault)
    if options.parquet is not None and find_spec("pyarrow") is None:
        arguments.error("--parquet needs pyarrow, which this Python does not have: pip install pyarrow")
    console = Console(stderr=True)
    try:
        with left_at_once("envelope"), uncollected():
            cases = read_cases(options.cases, source, dict(options.set))
            profiles, *_ = [profiles_of(case.scenario) for case in cases]
        with start_shown("envelope", console), suppress(EquilibriumError):
            Simulation(cases[0].scenario, meanwhile=compile_figures)  # a fault of its case is told with it
        if options.results is not None:
            options.results.mkdir(parents=True, exist_ok=True)
        with uncollected():
            results = _calculated([Job(case, options.places) for case in cases], options.results, console)
        verdicts = worst_verdicts(
            [
                in_case(one.id, judge(one.scenario, result.figures, at_rest=not one.moves))
                for one, result in zip(cases, results, strict=True)
            ]
        )
        extremes = envelope(results)
        with redirect_stdout(sys.stderr if STDOUT in (options.csv, options.json) else sys.stdout):
            print(f"{_title(cases, results)}; {counted(options.places, 'place')} of the vehicle")
            shown = [replace(one, place=", ".join(filter(None, (f"case {case}", one.place)))) for case, one in extremes]
            print_figures(table_console(), [shown], at="vehicle at", unit_at="m")
            print_verdicts(table_console(), profiles, verdicts)
        with uncollected():
            _write(options, cases, results, extremes, verdicts)
    except (ScenarioError, CaseError) as error:
        return fail("envelope", error, UNUSABLE)
    except KeyboardInterrupt:
        tell("envelope", "ended by Ctrl-C; finished cases are kept with --results")
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except OSError as error:
        tell("envelope", f"{error.filename or 'output'}: {error.strerror or error}")
        return FAILED
    faults = [f"{one.id}: {one.fault}" for one in results if one.fault]
    for line in faults:
        tell("envelope", line)
    return FAILED if faults else DONE


def _calculated(jobs: Sequence[Job], kept: Path | None, console: Console) -> list[CaseResult]:
    """Results of all load cases: stored ones are read, the others are calculated in parallel and stored."""
    found = {job.case.id: result for job in jobs if kept is not None and (result := _read(kept, job)) is not None}
    missing = [job for job in jobs if job.case.id not in found]
    if kept is not None and found:
        tell("envelope", f"{len(found)} of {len(jobs)} cases are in {kept} already")
    by_id = {job.case.id: job for job in jobs}
    with count_shown(console, "cases", len(missing)) as show:

        def on_done(result: CaseResult) -> None:
            if kept is not None and not result.fault:
                _keep(kept, by_id[result.id], result)
            found[result.id] = result
            show()

        def on_part(results: Sequence[CaseResult]) -> None:
            for one in results:
                on_done(one)

        parts = neighbours(missing, jobs, usable_cores())
        if len(missing) < FEW:
            for part in parts:
                on_part(run_part(part))
        else:
            run_side_by_side(parts, on_part)
    return [found[job.case.id] for job in jobs]


def _title(cases: Sequence[LoadCase], results: Sequence[CaseResult]) -> str:
    """Name of the scenario, and numbers of its load cases with results, at rest and in motion, and of those without."""
    moves = [case.moves for case, result in zip(cases, results, strict=True) if result.figures]
    counts = {"at rest": moves.count(False), "in motion": moves.count(True)}
    told = " and ".join(f"{counted(count, 'load case')} {how}" for how, count in counts.items() if count)
    lost = len(cases) - len(moves)
    without = f"{counted(lost, 'load case')} without a result" if lost else ""
    return ", ".join(filter(None, (cases[0].scenario.name, told, without)))


def _file(kept: Path, job: Job) -> Path:
    """Path of the stored result of a load case, named by the hash of its scenario, places and program version."""
    scenario = job.case.scenario.resolved()
    for key in ("profile", "installation", "load_cases"):  # judged anew each time
        del scenario["limits"][key]
    own = (job.case.dynamic, job.case.worst_place)
    run = [one.inputs for one in own if one is not None] + ["stops"] * job.case.stops
    text = json.dumps([scenario, job.places, metadata.version("cable_twin"), *run], sort_keys=True)
    return kept / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}{SUFFIX}"


def _keep(kept: Path, job: Job, result: CaseResult) -> None:
    """Store the result of a load case in its file, which is replaced atomically."""
    figures = [{"name": one.name, **values_of(one)} for one in result.figures]
    file = _file(kept, job)
    partial = file.with_suffix(".partial")
    data = {"id": result.id, "figures": figures, "ranges": result.ranges.plain()}
    partial.write_text(json.dumps(data), encoding="utf-8")
    partial.replace(file)


def _read(kept: Path, job: Job) -> CaseResult | None:
    """Read the stored result of a load case; None where missing or unreadable."""
    try:
        data = json.loads(_file(kept, job).read_text(encoding="utf-8"))
        figures = tuple(figure_from_values(one.pop("name"), one) for one in data["figures"])
        ranges = ranges_of_plain(data["ranges"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return CaseResult(job.case.id, figures, ranges=ranges)


def envelope(results: Sequence[CaseResult]) -> list[tuple[str, KeyFigure]]:
    """Extreme of each key figure over load cases, with the id of the governing case (the first, if several tie).

    The mean deceleration of a single stop in a case is its highest and its lowest one.

    Args:
        results: results of all cases.
    """
    found: dict[FigureId, tuple[str, KeyFigure]] = {}
    for result in results:
        had = {one.id for one in result.figures}
        single = (one for one in result.figures if one.id.quantity == "mean_deceleration")
        both = [as_statistic(one, statistic) for one in single for statistic in BOTH]
        for one in (*result.figures, *(one for one in both if one.id not in had)):
            if one.id.statistic not in BOTH:
                continue
            sense = 1.0 if one.id.statistic == "highest" else -1.0
            if one.id not in found or sense * one.value > sense * found[one.id][1].value:
                found[one.id] = result.id, one
    return list(found.values())


def in_case(case: str, verdicts: Sequence[RuleVerdict]) -> list[RuleVerdict]:
    """Copy the rule verdicts of a load case with its id and the vehicle's place in the text of the place of figures.

    Args:
        case: id of the case.
        verdicts: rule verdicts on the figures of the case.
    """

    def told(one: RuleVerdict) -> RuleVerdict:
        if one.figure is None:
            return one
        figure = with_place(one.figure)
        place = ", ".join(filter(None, (f"case {case}", figure.place)))
        return replace(one, figure=replace(figure, place=place))

    return [told(one) for one in verdicts]


def worst_verdicts(of_cases: Sequence[Sequence[RuleVerdict]]) -> list[RuleVerdict]:
    """Worst verdict of each rule check over load cases, of equal ones that with the worst value.

    Verdicts undecided for lack of a figure or case rank last.

    Args:
        of_cases: verdicts of each case, of equal profiles.
    """

    def order(one: RuleVerdict) -> tuple[bool, tuple[int, float]]:
        return one.state == NOT_DECIDED and not one.limits, severity(one)

    return [min(both, key=order) for both in zip(*of_cases, strict=True)]


def _write(
    options: Any,
    cases: Sequence[LoadCase],
    results: Sequence[CaseResult],
    extremes: Sequence[tuple[str, KeyFigure]],
    verdicts: Sequence[RuleVerdict],
) -> None:
    """Write the output files given by options: CSV, JSON, plot, Parquet.

    Raises:
        OSError: a file cannot be written.
    """
    columns = ["case", *FIGURE_COLUMNS]
    rows = [[one.id, *figure_columns(figure).values()] for one in results for figure in one.figures]
    if options.csv is not None:
        with opened(options.csv) as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(rows)
    if options.json is not None:
        still = [got for one, got in zip(cases, results, strict=True) if not one.moves]
        at_rest = envelope(still) if len(still) < len(cases) else []
        data = {
            "scenario": cases[0].scenario.name,
            "file": scenario_text(options.source)._asdict(),
            "resolved": load_scenario(options.source, dict(options.set)).resolved(),
            "version": metadata.version("cable_twin"),
            "command": options.command,
            "places": options.places,
            "cases": [
                {**case_columns(one), "fault": got.fault} for one, got in zip(cases, results, strict=True)
            ],
            "envelope": [{"case": case, **figure_columns(one)} for case, one in extremes],
            "at_rest": [{"case": case, **figure_columns(one)} for case, one in at_rest],
            "ranges": united(one.ranges for one in results).plain(),
            "rules": [verdict_columns(one) for one in verdicts],
        }  # fmt: skip
        with opened(options.json) as file:
            file.write(json.dumps(data, indent=1, allow_nan=False) + "\n")
    if options.plot is not None:
        from cable_twin.offline.envelopes.plot import write_envelope_plot  # noqa: PLC0415 - matplotlib takes a second

        if not write_envelope_plot(_title(cases, results), extremes, options.plot):
            tell("envelope", f"--plot {options.plot}: nothing is drawn, as there is no tower and no sag")
    if options.parquet is not None:
        import pyarrow  # noqa: PLC0415 - not always installed
        from pyarrow import parquet  # noqa: PLC0415 - the same

        parquet.write_table(
            pyarrow.table({name: [row[number] for row in rows] for number, name in enumerate(columns)}), options.parquet
        )


if __name__ == "__main__":
    sys.exit(main())
