"""Sweep of `simulate --sweep`: runs over values of a scenario key, and windows of values with all limits kept."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from cable_twin.key_figures import compile_figures
from cable_twin.offline.export import STDOUT
from cable_twin.offline.figure_table import table_console
from cable_twin.offline.runs_side_by_side import Job, run_side_by_side
from cable_twin.offline.script import ScriptError, read_script
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, DURATION, UNUSABLE, Sweep
from cable_twin.offline.sweep_limits import SweptRun, limited_figures, unsure_gaps, windows_of
from cable_twin.offline.sweep_report import print_sweep, window_lines, write_csv, write_json
from cable_twin.scenario import Scenario, ScenarioError, load_scenario, scenario_keys, value_at
from cable_twin.scenario.reference import explained
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import share_shown, start_shown
from cable_twin.terminal.command_line import INTERRUPTED, fail, tell

DONE, FAILED = 0, 1
PRECISION, TURNS = 0.01, 12  # share of a step to which ends of windows are sought, and most rounds of the search


def sweep(options: argparse.Namespace) -> int:
    """Carry out all runs of `--sweep` and report; returns an exit code of `simulate`."""
    console = Console(stderr=True)
    try:
        if fault := _fault(options):
            raise ScriptError(fault)
        jobs = _jobs(options, console)
    except (ScenarioError, ScriptError, EquilibriumError) as error:
        return fail("simulate", error, UNUSABLE)
    try:
        for path in (options.csv, options.json, options.plot):
            if path not in (None, STDOUT):
                Path(path).touch()  # files that cannot be written are reported before any run
        with share_shown(console, f"{len(jobs)} runs") as show:
            runs = run_side_by_side(jobs, show)
        with share_shown(console, "runs between") as show:
            runs = _refined(options, jobs[0], runs, lambda more: run_side_by_side(more, show))
        return _report(options, jobs[0].scenario.name, runs)
    except KeyboardInterrupt:
        tell("simulate", "ended by Ctrl-C")
        return INTERRUPTED
    except OSError as error:
        tell("simulate", f"{error.filename or 'output'}: {error.strerror or error}")
        return FAILED


def _fault(options: argparse.Namespace) -> str:
    """Error line about an option that cannot be combined with `--sweep`; empty if all can."""
    for name in ("snapshot", "from_bag", "check"):
        if getattr(options, name):
            return f"--sweep cannot be combined with --{name.replace('_', '-')}: a sweep starts every run from rest"
    return ""


def _jobs(options: argparse.Namespace, console: Console) -> list[Job]:
    """Jobs of all runs of a sweep; the first simulation is built here to compile kernels once.

    Raises:
        ScenarioError, ScriptError, EquilibriumError: scenario or script cannot be used.
    """
    scenarios = swept_scenarios(options.sweep, _source(options), dict(options.set))
    script = read_script(options.script, scenarios[0]) if options.script is not None else []
    with start_shown("simulate", console):
        Simulation(scenarios[0], meanwhile=compile_figures)
    duration = options.duration or (script[-1].time if script else 0.0) + DURATION
    values = zip(options.sweep.values, scenarios, strict=True)
    steps = [max(round(1.0 / (options.frame_rate * scenario.solver.step)), 1) for scenario in scenarios]
    return [
        Job(value, scenario, script, duration, frame_steps)
        for (value, scenario), frame_steps in zip(values, steps, strict=True)
    ]


def _refined(
    options: argparse.Namespace, like: Job, runs: list[SweptRun], run_all: Callable[[Sequence[Job]], list[SweptRun]]
) -> list[SweptRun]:
    """Add runs between those of a sweep until the ends of all windows are known precisely; returns all in order."""
    values, whole = options.sweep.values, is_whole(like.scenario, options.sweep.key)
    if len(values) < 2:
        return runs
    least = 1.0 if whole else PRECISION * abs(values[1] - values[0])
    sense = 1.0 if values[1] > values[0] else -1.0
    for turn in range(TURNS):
        tried = []
        for gap, expected in unsure_gaps(runs, limited_figures(runs), least):
            low, high = sorted((runs[gap].value, runs[gap + 1].value))
            jumps = turn % 3 == 2 or not low < expected < high  # bisection for figures on no smooth curve
            value = 0.5 * (low + high) if jumps else expected
            tried.append(min(max(round(value), low + 1), high - 1) if whole else value)
        if not tried:
            break
        between = replace(options.sweep, values=tuple(tried))
        scenarios = swept_scenarios(between, _source(options), dict(options.set))
        jobs = [replace(like, value=value, scenario=one) for value, one in zip(tried, scenarios, strict=True)]
        runs = sorted([*runs, *run_all(jobs)], key=lambda run: sense * run.value)
    return runs


def _source(options: argparse.Namespace) -> str:
    return DEFAULT_SCENARIO if options.scenario is None else options.scenario


def _report(options: argparse.Namespace, name: str, runs: Sequence[SweptRun]) -> int:
    """Print and write the results of a sweep; returns the exit code.

    Raises:
        OSError: a file cannot be written.
    """
    key, unit = options.sweep.key, _unit(options.sweep.key)
    swept = f"{key} [{unit}]" if unit not in ("", "-") else key
    figures = limited_figures(runs)
    windows = windows_of(runs, figures)
    ends = [end.run for window in windows for end in (window.low, window.high)]
    asked = [run for run in runs if run.value in options.sweep.values]
    with redirect_stdout(sys.stderr if STDOUT in (options.csv, options.json) else sys.stdout):
        if figures:
            print_sweep(table_console(), swept, runs, figures, {*options.sweep.values, *ends})
        for line in window_lines(key, unit, runs, figures, windows):
            print(f"{name}: {line}")
    faults = [f"{key} {run.value:g}: {line}" for run in asked for line in (run.fault, *run.refused[:2]) if line]
    for line in faults:
        tell("simulate", line)
    if options.csv is not None:
        write_csv(options.csv, key, runs)
    if options.json is not None:
        head = {"scenario": name, "key": key, "unit": unit, "values": list(options.sweep.values)}
        write_json(options.json, head, runs, windows)
    if options.plot is not None and figures:
        from cable_twin.offline.sweep_plot import write_sweep_plot  # noqa: PLC0415 - matplotlib takes a second

        write_sweep_plot(f"{name}: {key}", swept, figures, windows, Path(options.plot))
    return FAILED if faults else DONE


def _unit(key: str) -> str:
    """Unit of a scenario key; of an axis or element of a list the unit of the list."""
    try:
        return explained(key)[0].unit
    except KeyError:
        return _unit(key.rpartition(".")[0]) if "." in key else ""


def swept_scenarios(sweep: Sweep, source: Any, changes: Mapping[str, Any]) -> list[Scenario]:
    """Scenarios at all values of the key of a sweep.

    Args:
        sweep: key and values; a part of the key may be an axis, or a number in a list.
        source: name, path or data of a scenario, as for `load_scenario`.
        changes: changes of other values, by dotted key.

    Raises:
        ScenarioError: the scenario at a value is invalid; one line for each fault at the first such value.
    """
    return [load_scenario(source, {**changes, sweep.key: value}) for value in sweep.values]


def is_whole(scenario: Scenario, key: str) -> bool:
    """Whether a scenario key takes integers only."""
    resolved = scenario.resolved()
    return isinstance(value_at(resolved, scenario_keys(resolved, key)[0]), int)
