"""Command `study`: cases over ranges of scenario keys and scripts, run on a cluster, with Sobol indices."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cable_twin.basics.units import counted, rounded, shown_unit
from cable_twin.ensemble import usable_cores
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import FigureId, KeyFigures
from cable_twin.offline.figure_table import table_console
from cable_twin.offline.script import ScriptError, read_script
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, DURATION, add_changes
from cable_twin.offline.studies.case import Case, Inputs, hash_of_case, program, scenario_of
from cable_twin.offline.studies.cluster import ClusterError, connected, run_on
from cable_twin.offline.studies.design import (
    METHODS,
    SCRIPT,
    Design,
    DesignError,
    design,
    factor_of,
    faults_of,
    with_kinds,
)
from cable_twin.offline.studies.indices import Indices, indices_of, shown_figures, write_indices
from cable_twin.offline.studies.record import (
    ENDS,
    Kept,
    Results,
    StudyInUseError,
    kept_in,
    write_manifest,
    write_tables,
)
from cable_twin.offline.sweep import is_whole
from cable_twin.scenario import Scenario, ScenarioError, load_scenario, scenario_lines
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import count_shown, start_shown
from cable_twin.terminal.command_line import INTERRUPTED, OneLineParser, fail, left_at_once, number, tell, whole_number

DONE, FAILED, UNUSABLE = 0, 1, 2
CASES, MOST = 64, 2_000_000
SHOWN = 6  # figures of plots and tables
EPILOG = """\
Each case is a run as of `simulate`, with its values of the varied keys. A range is varied by its method; of a list,
each value is a level. `script` is a key, too, whose values are files of commands:

  --vary air.wind.x=-15:15 --vary script=trip.yaml,stop.yaml

grid: all combinations, with equally many levels of each range. latin: a Latin hypercube. sobol: the design of
Saltelli, N (keys + 2) cases with N a power of 2, and Sobol indices of all key figures.

DIR gets results.csv and results.parquet (with pyarrow) with a row each case, indices.csv, plots (with matplotlib),
cases.jsonl with hash, host and key figures of each finished case, and manifest.json. The same command goes on where it
was ended, and runs only cases that are missing or whose inputs or program have changed. Results have the same bits on
any number of workers. Needs dask.distributed.

exit codes: 0 done, 1 a case failed, the cluster was lost or a file cannot be written, 2 wrong scenario, design, script,
scheduler or option, or no case has a key figure of --figure, 130 ended by Ctrl-C

examples:
  study seed_example --vary cable.mass_per_length=1:3 --vary gravity=9:10 \\
        --method sobol --cases 64 --duration 0 --out study
  study chairlift --vary air.temperature=-20:40 --vary air.wind.x=-15:15 \\
        --method grid --cases 49 --duration 0 --out study \\
        --scheduler tcp://host:8786
"""


class Study(NamedTuple):
    """Planned study: common inputs of all cases, design and cases."""

    name: str
    common: Inputs
    design: Design
    cases: Sequence[Case]


def parser() -> OneLineParser:
    """Parser of the options of `study`."""
    result = OneLineParser("study", "Run cases over ranges of keys of a scenario.", EPILOG, failure=UNUSABLE)
    result.add_scenario(f"name of a scenario, or path of its YAML file; default: {DEFAULT_SCENARIO}", scenario_lines)
    result.add_argument(
        "--vary",
        action="append",
        type=factor_of,
        required=True,
        metavar="KEY=LOW:HIGH",
        help="vary a key over a range, or over a list KEY=VALUE,VALUE; can be repeated",
    )
    result.add_argument("--method", choices=METHODS, default="latin", help="design of the cases; default: latin")
    result.add_argument(
        "--cases",
        type=whole_number(1, MOST),
        default=CASES,
        metavar="N",
        help=f"most cases, 1 to {MOST}; default: {CASES}",
    )
    result.add_argument(
        "--seed", type=whole_number(0, 2**63 - 1), default=0, metavar="N", help="of latin and sobol; default: 0"
    )
    add_changes(result)
    result.add_argument("--script", type=Path, metavar="FILE", help="commands of all cases, as of `simulate`")
    result.add_argument(
        "--duration",
        type=number(0.0, math.inf, "s", zero=True),
        metavar="S",
        help=f"simulated time of each case, 0: at rest; default: until {DURATION:g} s after the last command",
    )
    result.add_argument(
        "--frame-rate", type=number(1.0, 1000.0, "Hz"), default=100.0, metavar="HZ", help="default: 100"
    )
    result.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on the workers of a scheduler of Dask, as tcp://host:8786"
    )
    result.add_argument(
        "--workers", type=whole_number(1, MOST), metavar="N", help="processes of the local cluster; default: one a core"
    )
    result.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the study")
    result.add_argument(
        "--figure",
        action="append",
        type=_figure_id,
        default=[],
        metavar="ID",
        help="key figure of table and plots, as rope_tension/ropes.up/highest; can be repeated",
    )
    return result


def _figure_id(text: str) -> str:
    """Id of a key figure as given; refused where there is no such quantity or statistic."""
    try:
        return str(FigureId.of_known(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def main(argv: Sequence[str] | None = None) -> int:
    """Run the cases of a study and report; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    source = arguments.given_scenario(options) or DEFAULT_SCENARIO
    for fault in faults_of(options.vary):
        arguments.error(fault)
    if options.script is not None and any(one.key == SCRIPT for one in options.vary):
        arguments.error("--script, --vary script: given both; allowed: one of them")
    if find_spec("distributed") is None:
        arguments.error("study needs dask.distributed, which this Python does not have: pip install distributed")
    console = Console(stderr=True)
    try:
        with left_at_once("study"):
            study = plan(options, source)
        with start_shown("study", console):
            subjects = _compile(study)
        for id_ in options.figure:
            if fault := _subject_fault(id_, subjects):
                arguments.error(fault)
        with kept_in(options.out) as kept:
            try:
                faults = _run(study, kept, options, console)
            finally:
                shown = _write(study, kept, options)
            return _report(study, kept, shown, faults)
    except (ScenarioError, ScriptError, DesignError, StudyInUseError) as error:
        return fail("study", error, UNUSABLE)
    except ClusterError as error:
        return fail("study", error, UNUSABLE if str(error).startswith("--") else FAILED)
    except KeyboardInterrupt:
        return fail("study", f"ended by Ctrl-C; finished cases are kept in {options.out}", INTERRUPTED)
    except BrokenPipeError:
        raise
    except OSError as error:
        return fail("study", f"{error.filename or 'output'}: {error.strerror or error}", FAILED)


def plan(options: argparse.Namespace, source: str) -> Study:
    """Plan a study from its options: check ends of ranges and scripts, make design and cases.

    Raises:
        ScenarioError, ScriptError, DesignError: scenario, script or design cannot be used.
    """
    base = load_scenario(source, dict(options.set))
    factors = with_kinds(options.vary, partial(is_whole, base))
    files = {str(one): Path(str(one)) for factor in factors if factor.key == SCRIPT for one in factor.values}
    if options.script is not None:
        files = {"": options.script}
    scripts = {name: read_script(file, base) for name, file in files.items()}
    common = Inputs(
        json.dumps(base.resolved(), allow_nan=True), scripts, options.duration, DURATION, options.frame_rate
    )
    for factor in factors:
        for end in factor.ends if factor.key != SCRIPT else ():
            load_scenario(source, {**dict(options.set), factor.key: end})
    made = design(factors, options.method, options.cases, options.seed)
    hashed = hash_of_case(common)
    cases = [Case(id_, values, hashed(values)) for id_, values in made.cases()]
    return Study(base.name, common, made, cases)


def _compile(study: Study) -> set[str]:
    """Compile all kernels of a study once, not in each worker; returns the subjects of the first case's key figures.

    They are empty where that case has no equilibrium.
    """
    found: set[str] = set()

    def begin(scenario: Scenario, first: Snapshot) -> None:
        figures = KeyFigures(scenario)
        figures.update(first)
        found.update(one.id.subject for one in figures.figures())

    try:
        Simulation(scenario_of(study.common, study.cases[0].values), meanwhile=begin)
    except (EquilibriumError, ScenarioError):  # the fault of its case
        found.clear()
    return found


def _subject_fault(id_: str, subjects: Collection[str]) -> str:
    """Error line about the subject of a key figure that no case can have; empty without a fault."""
    subject = FigureId.of_text(id_).subject
    known = {*subjects, "air"}  # wind and pairs of vehicles have figures only later
    if not subjects or subject in known or {*subject.split("+")} <= known:
        return ""
    near = get_close_matches(subject, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"allowed: {', '.join(sorted(known))}"
    return f"--figure: given {id_}; {hint}"


def _run(study: Study, kept: Kept, options: argparse.Namespace, console: Console) -> list[str]:
    """Run the missing cases of a study; returns a line for each case that could not be carried out."""
    missing = list({one.inputs: one for one in study.cases if one.inputs not in kept}.values())
    if there := sum(one.inputs in kept for one in study.cases):
        tell("study", f"{there} of {len(study.cases)} cases are in {options.out} already")
    if not missing:
        return []
    workers = min(options.workers or usable_cores(), len(missing))
    with connected(options.scheduler, workers) as client, count_shown(console, "cases", len(missing)) as show:

        def on_done(finished: Any, names: Any) -> None:
            kept.add(finished, names)
            show()

        return run_on(client, study.common, missing, on_done)


class Shown(NamedTuple):
    """Results of a study for its report.

    Attributes:
        results: of all cases.
        figures: ids of the shown key figures.
        missing: wanted ids that no case has.
        indices: Sobol indices, by id.
        without: ids of figures without indices, as some case lacks them.
    """

    results: Results
    figures: Sequence[str]
    missing: Sequence[str]
    indices: dict[str, Indices]
    without: Sequence[str]


def _write(study: Study, kept: Kept, options: argparse.Namespace) -> Shown:
    """Write tables, Sobol indices, plots and manifest of the finished cases of a study.

    Raises:
        OSError: a file cannot be written.
    """
    results = Results(study.cases, kept)
    files = write_tables(options.out, results)
    wanted = [one for one in options.figure if one in results.figures]
    missing = [one for one in options.figure if one not in results.figures and results.figures]
    for one in missing:
        tell("study", f"--figure: given {one}, which no case has; allowed: ids that results.csv has as columns")
    shown = wanted if options.figure else shown_figures(results, SHOWN)
    found, without = indices_of(study.design, results) if study.design.method == "sobol" else ({}, [])
    if found:
        files.append(options.out / "indices.csv")
        write_indices(files[-1], found)
    files += _plots(study, results, shown, found, options.out)
    described = {
        "scenario": json.loads(study.common.scenario),
        "scripts": {name: [[one.time, repr(one.command), one.at] for one in script]
                    for name, script in study.common.scripts.items()},
        "duration": study.common.duration,
        "frame_rate": study.common.frame_rate,
        "vary": {one.key: dict(zip(ENDS, one.range, strict=True)) if one.range else one.values
                 for one in study.design.factors},
        "method": study.design.method,
        "seed": options.seed,
        "program": json.loads(program()),
    }  # fmt: skip
    write_manifest(options.out, described, results, files)
    return Shown(results, shown, missing, found, without)


def _plots(
    study: Study, results: Results, shown: Sequence[str], found: dict[str, Indices], directory: Path
) -> list[Path]:
    """Draw the shown key figures of a study, and their Sobol indices if any; returns the files."""
    if not shown or find_spec("matplotlib") is None:
        return []
    from cable_twin.offline.studies import plot  # noqa: PLC0415 - matplotlib takes a second

    title = f"{study.name}, {counted(len(study.cases), 'case')}, {study.design.method}"
    files = [directory / "figures.png"]
    plot.write_scatter(title, study.design, results, shown, files[0])
    if drawn := {one: found[one] for one in shown if one in found}:
        files.append(directory / "indices.png")
        names = {key: name for key, (name, _) in results.names.items()}
        plot.write_indices_plot(title, drawn, names, files[-1])
    return files


def _report(study: Study, kept: Kept, shown: Shown, faults: Sequence[str]) -> int:
    """Print the table of the shown key figures of a study, and its errors; returns the exit code."""
    results = shown.results
    print(f"{study.name}: {counted(len(study.cases), 'case')}, {study.design.method}, in {kept.directory}")
    keys = [one.key for one in study.design.factors] if shown.indices else []
    table = Table("key figure", "lowest", "highest", "unit", *[f"{key}\nfirst, total" for key in keys], box=None)
    for one in shown.figures:
        values = results.figures[one]
        there = values[np.isfinite(values)]
        unit, scale = shown_unit(results.names[one][1], float(abs(there).max()))
        row = [rounded(there.min() * scale), rounded(there.max() * scale), unit]
        own = shown.indices.get(one)
        row += [f"{own.first[key].value:.2f}, {own.total[key].value:.2f}" if own else "" for key in keys]
        table.add_row(results.names[one][0], *row)
    if shown.figures:
        table_console().print(table)
    if shown.without:
        print(f"without indices, as some case lacks them: {counted(len(shown.without), 'figure')}")
    bad = [f"{case.id}: {fault}" for case, fault in zip(study.cases, results.faults, strict=True) if fault]
    for line in [*faults, *bad][:SHOWN]:
        tell("study", line)
    if len(bad) > SHOWN:
        tell("study", f"{len(bad)} cases in all have a fault; results.csv has them")
    if refused := sum(map(bool, results.refused)):
        tell("study", f"{counted(refused, 'case')} refused a command; cases.jsonl has the reasons")
    if bad or faults or refused:
        return FAILED
    return UNUSABLE if shown.missing else DONE


if __name__ == "__main__":
    sys.exit(main())
