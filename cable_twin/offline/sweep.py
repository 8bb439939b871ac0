"""`simulate --sweep`: the runs over the values of a key, their figures beside their limits, and the operating limit."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from cable_twin.command_line import INTERRUPTED, left_at_once
from cable_twin.compilation_bar import compilation_shown
from cable_twin.key_figures import compile_figures
from cable_twin.offline.export import STDOUT
from cable_twin.offline.figure_table import table_console
from cable_twin.offline.script import ScriptError, check_script, read_script
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, DURATION, UNUSABLE, plots_fault
from cable_twin.offline.sweep_limits import limited_figures, operating_limit
from cable_twin.offline.sweep_report import limit_line, print_sweep, write_csv, write_json
from cable_twin.offline.sweep_runs import Job, SweptRun, run_all, swept_scenarios
from cable_twin.scenario import ScenarioError
from cable_twin.scenario.reference import explained
from cable_twin.simulation import EquilibriumError, Simulation

DONE, FAILED = 0, 1
DRAWN = (".png", ".pdf", ".svg")


def sweep(options: argparse.Namespace) -> int:
    """Do all runs of `--sweep` and report; the exit code is that of `simulate`."""
    console = Console(stderr=True)
    try:
        if fault := _fault(options):
            raise ScriptError(fault)
        jobs = _jobs(options, console)
    except (ScenarioError, ScriptError, EquilibriumError) as error:
        for line in str(error).splitlines():
            print(f"simulate: {line}", file=sys.stderr)
        return UNUSABLE
    try:
        for path in (options.csv, options.json, options.plot):
            if path not in (None, STDOUT):
                Path(path).touch()  # what cannot be written is said before anything runs
        with _progress(console, len(jobs)) as on_run:
            runs = run_all(jobs, on_run)
        return _report(options, jobs[0].scenario.name, runs)
    except KeyboardInterrupt:
        print("simulate: ended by Ctrl-C", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        print(f"simulate: {error.filename or 'output'}: {error.strerror or error}", file=sys.stderr)
        return FAILED


def _fault(options: argparse.Namespace) -> str:
    """What does not go together with a sweep, in a line."""
    for name in ("snapshot", "from_bag", "check"):
        if getattr(options, name):
            return f"--sweep with --{name.replace('_', '-')}; allowed: runs from the start of a scenario"
    return ""


def plot_fault(options: argparse.Namespace) -> str:
    """What is wrong with `--plot`, in a line."""
    if options.plot is None:
        return ""
    if options.sweep is None:
        return f"--plot {options.plot} without --sweep, of which it is; of one run: review LOG --plots DIR"
    if options.plot.suffix.lower() not in DRAWN:
        return f"--plot {options.plot}: allowed: a name that ends with {', '.join(DRAWN)}"
    return plots_fault("--plot")


def _jobs(options: argparse.Namespace, console: Console) -> list[Job]:
    """All runs; the first one is built here, so that kernels are compiled once and the script is checked.

    Raises:
        ScenarioError, ScriptError, EquilibriumError: something cannot be used.
    """
    script = read_script(options.script) if options.script is not None else []
    source = DEFAULT_SCENARIO if options.scenario is None else options.scenario
    scenarios = swept_scenarios(options.sweep, source, dict(options.set))
    with left_at_once("simulate"), compilation_shown(console, partial(print, file=sys.stderr, flush=True)):
        first = Simulation(scenarios[0], meanwhile=compile_figures)
    if faults := check_script(first, script):
        raise ScriptError("\n".join(faults))
    duration = options.duration or (script[-1].time if script else 0.0) + DURATION
    values = zip(options.sweep.values, scenarios, strict=True)
    steps = [max(round(1.0 / (options.frame_rate * scenario.solver.step)), 1) for scenario in scenarios]
    return [
        Job(value, scenario, script, duration, frame_steps)
        for (value, scenario), frame_steps in zip(values, steps, strict=True)
    ]


def _report(options: argparse.Namespace, name: str, runs: Sequence[SweptRun]) -> int:
    """Say what came of the runs.

    Raises:
        OSError: a file cannot be written.
    """
    key, unit = options.sweep.key, _unit(options.sweep.key)
    swept = f"{key} [{unit}]" if unit not in ("", "-") else key
    figures = limited_figures(runs)
    limit = operating_limit(figures, rising=runs[-1].value >= runs[0].value)
    with redirect_stdout(sys.stderr if STDOUT in (options.csv, options.json) else sys.stdout):
        if figures:
            print_sweep(table_console(), swept, runs, figures)
        print(f"{name}: {limit_line(key, unit, runs, limit)}")
    faults = [f"{key} {run.value:g}: {line}" for run in runs for line in (run.fault, *run.refused[:2]) if line]
    for line in faults:
        print(f"simulate: {line}", file=sys.stderr)
    if options.csv is not None:
        write_csv(options.csv, key, runs)
    if options.json is not None:
        head = {"scenario": name, "key": key, "unit": unit, "values": list(options.sweep.values)}
        write_json(options.json, head, runs, limit)
    if options.plot is not None and figures:
        from cable_twin.offline.sweep_plot import write_sweep_plot  # noqa: PLC0415 - matplotlib takes a second

        write_sweep_plot(f"{name}: {key}", swept, figures, limit, Path(options.plot))
    return FAILED if faults else DONE


def _unit(key: str) -> str:
    """Unit of a key of a scenario, or of the list in which it stands."""
    try:
        return explained(key)[0].unit
    except KeyError:
        return _unit(key.rpartition(".")[0]) if "." in key else ""


@contextmanager
def _progress(console: Console, count: int) -> Iterator[Callable[[SweptRun], None]]:
    """A bar over the runs, on a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("runs", total=count)
        yield lambda _: progress.advance(task)


__all__ = ["plot_fault", "sweep"]
