"""Command `what_if`: branch of a recorded run at a time, with other commands or values, and comparison of both runs."""

from __future__ import annotations

import argparse
import dataclasses
import math
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from rich.console import Console

from cable_twin import Ensemble
from cable_twin.frame.records import CommandError
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.export import Export, add_export, export_fault
from cable_twin.offline.reading import Reading
from cable_twin.offline.replay import first_start, made_by_other
from cable_twin.offline.review import print_review, write_review_plots
from cable_twin.offline.script import ScriptedCommand, ScriptError, check_script, read_script, script_of_log
from cable_twin.offline.scripted_run import Outcome, simulate
from cable_twin.offline.simulate import run_progress
from cable_twin.offline.simulate_options import UNUSABLE, add_changes, plots_fault
from cable_twin.offline.thinned_series import Comparison, compare
from cable_twin.recording.log_file import LogError, check_gap
from cable_twin.recording.log_reader import Log, read_log
from cable_twin.recording.run import Run, start_run
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError, SolverError
from cable_twin.simulation.snapshot_file import read_full_state
from cable_twin.terminal.bars import start_shown
from cable_twin.terminal.command_line import OneLineParser, number, tell

DONE, FAILED = 0, 1  # exit codes, beside UNUSABLE
SINGLE, IN_SINGLE = 2.0**-24, "tension/"  # rounding of single precision, and the signals that logs hold in it
EPILOG = """\
Up to T the run is repeated from its own log, to the last bit; then commands at T or later are those of the script, in
place of the recorded ones, and values of --set act on the state of T. Times of the script are those of the run. Values
that would need another mesh, other parts or another solver are refused.

a is the recorded run from T on, b the branch, which gets a log of its own: `review` shows both again. Key figures of
both are those of all frames from T on, for which the recorded run is repeated too, up to the end of its log or of the
branch; differences are those of the logged frames.

exit codes: 0 done, 1 the branch failed, refused a command or could not be written, 2 wrong log, script or option, 130
ended by Ctrl-C

examples:
  what_if cable_twin_logs/2026-01-31_09-30-00 --at 60 \\
          --set carriages.cabin.drive.limits.emergency_deceleration=0.6
  what_if run.mcap --at 60 --script other.yaml --duration 90 --plots pictures
"""


class BranchError(ValueError):
    """Error of a branch of a run that cannot be made; each line of the message has the given and the allowed value."""


UNUSABLE_INPUT = (BranchError, LogError, ScriptError, ScenarioError, EquilibriumError, SnapshotError)


@dataclass(frozen=True, slots=True)
class Branch:
    """Prepared branch of a recorded run: simulation at the branching time, script, duration; and the run from there."""

    simulation: Simulation
    script: Sequence[ScriptedCommand]
    run: Simulation  # in the state of the recorded run at the branching time
    rest: Snapshot  # of its scenario
    recorded: Sequence[ScriptedCommand]  # commands of the run from there on
    start: float  # s
    duration: float  # s
    frame_steps: int


def parser() -> OneLineParser:
    """Parser of the options of `what_if`."""
    result = OneLineParser(
        "what_if",
        "Branch a recorded run at a time with other commands or values, and compare both.",
        EPILOG,
        failure=UNUSABLE,
    )
    result.add_argument("log", type=Path, help="directory of a run, or one of its .mcap files")
    result.add_argument(
        "--at",
        type=number(0.0, math.inf, "s", zero=True),
        required=True,
        metavar="T",
        help="simulated time at which the branch begins, to the nearest frame of the log",
    )
    result.add_argument(
        "--script",
        type=Path,
        metavar="FILE",
        help="commands from T on, .yaml or .csv as for `simulate`; default: those of the log",
    )
    add_changes(result)
    result.add_argument(
        "--duration",
        type=number(0.0, math.inf, "s"),
        metavar="S",
        help="simulated time from T on; default: to the end of the log",
    )
    result.add_argument(
        "--output",
        type=Path,
        default=Path("cable_twin_logs"),
        metavar="DIR",
        help="directory in which the branch gets one of its own; default: cable_twin_logs",
    )
    result.add_argument(
        "--record",
        choices=("all", "bag"),
        default="all",
        help="all: MCAP bag and rerun recording; bag: the MCAP bag only; default: all",
    )
    result.add_argument(
        "--plots", type=Path, metavar="DIR", help="write plots of both as PNG files into this directory"
    )
    add_export(result)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Branch a recorded run and compare both runs; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    if fault := export_fault(options) or (plots_fault("--plots") if options.plots is not None else ""):
        arguments.error(fault)
    console = Console(stderr=True)
    try:
        log = read_log(options.log)
        branch = _branch(log, options, console)
    except UNUSABLE_INPUT as error:
        tell("what_if", error)
        return UNUSABLE
    try:
        export = Export(options)
        run = _start(branch, options)
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
        tell(
            "what_if",
            f"{getattr(error, 'filename', None) or options.output}: {getattr(error, 'strerror', None) or error}",
        )
        return FAILED
    figures = KeyFigures(branch.simulation.scenario, branch.rest)
    outcome = _run(branch, run, log.epoch_ns, figures, console)
    lines = [f"refused: {line}" for line in outcome.refused] + [
        f"not carried out: {one}" for one in outcome.not_reached
    ]
    lines += [outcome.fault] if outcome.fault else []
    lines += run.recorder.faults
    for line in lines:
        tell("what_if", line)
    if argv is None:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # the log is closed: `what_if | head` ends without a word
    try:
        own = _figures_of_run(branch, log, console), figures.figures()
        written = _compare((log, read_log(run.directory)), own, branch, options, export, console)
    except LogError as error:
        tell("what_if", error)
        return FAILED
    with export.words():
        print(f"log of the branch: {run.directory}")
    return DONE if written and not lines else FAILED


def _branch(log: Log, options: argparse.Namespace, console: Console) -> Branch:
    """Repeat a recorded run to the branching time, and prepare the branch with its script and values.

    Raises:
        One of UNUSABLE_INPUT: an option, the log or the script cannot be used.
    """
    source = dict(options.set)
    scenario = load_scenario(log.scenario, source)  # what is wrong is said before anything runs
    script = None if options.script is None else read_script(options.script, scenario)
    if made_by_other(log):
        tell("what_if", f"{log.path}: made by other versions or on another machine: last digits may differ")
    if log.damage:
        tell("what_if", f"{log.path}: {log.condition}: what is lost is not repeated")
    if not log.end >= options.at:
        raise BranchError(f"--at: given {options.at:g} s; allowed: up to {log.end:g} s, the end of {log.path}")
    with start_shown("what_if", console):
        part, simulation = first_start(_from_nearest_state(log, options.at))
    period = float(log.metadata["frame_period"])
    frame_steps = max(round(period / simulation.step), 1)
    start = simulation.time + round((options.at - simulation.time) / period) * period
    if start < simulation.time:
        raise BranchError(f"--at: given {options.at:g} s; allowed: from {simulation.time:g} s, the start of {log.path}")
    recorded = script_of_log(part)
    recorded_later = [item for item in recorded if item.time > start - 0.5 * simulation.step]
    later = recorded_later if script is None else script
    if early := [one for one in later if one.at is None and one.time < start - 0.5 * simulation.step]:
        lines = [
            f"{one.place}: time: given {one.time:g} s; allowed: from {start:g} s, the time of --at" for one in early
        ]
        raise ScriptError("\n".join(lines))
    duration = _duration(log, start, period, options.duration)
    _repeat(simulation, recorded, start, console)
    run = Simulation(simulation.scenario, samples=int(log.metadata["sample_count"]), on_demand=True)
    rest = run.snapshot
    run.restore(simulation.capture())
    if source:
        simulation = _changed(simulation, scenario, log, source)
    if script and (faults := check_script(simulation.scenario, script, stopped=simulation.emergency_stopped)):
        raise ScriptError("\n".join(faults))
    return Branch(simulation, later, run, rest, recorded_later, start, duration, frame_steps)


def _duration(log: Log, start: float, period: float, given: float | None) -> float:
    """Duration (s) of a branch in simulated time: given, or to the last frame of the log."""
    duration = math.floor((log.end - start) / period + 1e-6) * period if given is None else given
    if duration < period:
        what = f"--duration: given {given:g} s" if given is not None else f"--at: given {start:g} s, the end of the log"
        raise BranchError(
            f"{what}; allowed: at least one frame of {period:g} s" + ("" if given else "; give --duration")
        )
    return duration


def _from_nearest_state(log: Log, at: float) -> Log:
    """Log from the last file on whose attached full state is at or before a time (s); else the whole log."""
    for first in range(len(log.files) - 1, 0, -1):
        try:
            state = read_full_state(BytesIO(log.files[first].snapshot() or b""), log.files[first].path.name)
        except SnapshotError:
            continue
        if state.time <= at:
            return dataclasses.replace(log, files=log.files[first:])
    return log


def _repeat(simulation: Simulation, recorded: Sequence[ScriptedCommand], until: float, console: Console) -> None:
    """Repeat a recorded run with its commands up to a time (s).

    Raises:
        LogError: the run cannot be repeated.
    """
    before = [item for item in recorded if item.time < until - 0.5 * simulation.step]

    def advance_to(time: float, show: Callable[[float], None]) -> None:
        check_gap(simulation.time, time)
        while simulation.time < time - 0.5 * simulation.step:
            show(simulation.advance_to(min(simulation.time + 1.0, time)).time)

    with run_progress(console, simulation.time, max(until - simulation.time, simulation.step)) as show:
        try:
            for item in before:
                advance_to(item.time, show)
                simulation.apply(item.command, item.source)
            advance_to(until, show)
        except (SolverError, CommandError) as error:
            raise LogError(f"the run cannot be repeated: {error}") from None


def _changed(simulation: Simulation, scenario: Scenario, log: Log, values: dict[str, Any]) -> Simulation:
    """Continue a simulation from its present state with other values of its scenario; returns a new simulation."""
    ensemble = Ensemble(simulation.scenario, 1, samples=int(log.metadata["sample_count"]), threads=1)
    try:
        ensemble.fork(simulation)
        ensemble.change(values)
        return ensemble.simulation(0)
    except ScenarioError:
        raise
    except ValueError as error:
        raise BranchError(f"--set {error}") from None
    finally:
        ensemble.close()


def _start(branch: Branch, options: argparse.Namespace) -> Run:
    """Open the log of a branch in a new directory."""
    return start_run(
        branch.simulation,
        record_directory=options.output.expanduser(),
        frame_period=branch.frame_steps * branch.simulation.step,
        rerun="file" if options.record == "all" else "none",
    )


def _run(branch: Branch, run: Run, epoch_ns: int, figures: KeyFigures, console: Console) -> Outcome:
    """Carry out a branch with a progress bar and a collector of key figures, and close its log."""
    simulation = branch.simulation
    run.begin(epoch_ns)
    try:
        with run_progress(console, simulation.time, branch.duration) as show:
            return simulate(
                simulation,
                branch.script,
                duration=branch.duration,
                frame_steps=branch.frame_steps,
                epoch_ns=epoch_ns,
                run=run,
                figures=figures,
                on_frame=show,
            )
    finally:
        run.close()


def _figures_of_run(branch: Branch, log: Log, console: Console) -> list[KeyFigure]:
    """Key figures of the recorded run from the branching time to the end of its log or of the branch.

    The run is repeated, as a log holds fewer frames than the run had.

    Raises:
        LogError: the run cannot be repeated.
    """
    figures, left = KeyFigures(branch.run.scenario, branch.rest), log.end - branch.start
    period = branch.frame_steps * branch.run.step
    duration = min(branch.duration, math.floor(left / period + 1e-6) * period)
    with run_progress(console, branch.start, max(duration, period)) as show:
        outcome = simulate(
            branch.run,
            branch.recorded,
            duration=duration,
            frame_steps=branch.frame_steps,
            epoch_ns=log.epoch_ns,
            figures=figures,
            on_frame=show,
        )
    if lines := [*outcome.refused, *([outcome.fault] if outcome.fault else [])]:
        raise LogError(f"the run cannot be repeated: {'; '.join(lines)}")
    return figures.figures()


def _compare(
    logs: tuple[Log, Log],
    figures: tuple[Sequence[KeyFigure], Sequence[KeyFigure]],
    branch: Branch,
    options: argparse.Namespace,
    export: Export,
    console: Console,
) -> bool:
    """Compare run and branch from the branching time on: print, plots, tables.

    Args:
        logs: of run and branch.
        figures: key figures of both from the branching time on.
        branch: the branch, at whose end the run is left, too.
        options: of the command line.
        export: tables to write.
        console: for progress.

    Returns:
        Whether all files are written.
    """
    start, end = branch.start, branch.start + branch.duration
    readings = [Reading(log, part=(start, end), figures=own) for log, own in zip(logs, figures, strict=True)]
    for reading in readings:
        reading.table = export.add(str(reading.log.source), reading.scenario.name)
    with console.status("comparing"):
        comparisons = compare(*(reading.values() for reading in readings), loops=readings[0].loops)
    for reading in readings:
        if reading.table is not None:
            reading.table.figures, reading.table.verdicts = reading.figures, reading.verdicts
            reading.table.responses = reading.responses.rows()
    with export.words():
        print(f"both runs from {start:.2f} s on, where the branch begins")
        print_review(readings, comparisons)
        if not differs(comparisons[0]):
            print("no sample differs: the branch has the bits of the run")
        plotted = options.plots is None or write_review_plots(readings, options.plots, console)
    return export.write("what_if") and plotted


def differs(comparison: Comparison) -> bool:
    """Whether any sample of two compared runs differs, or a signal is missing in one run.

    Between complete frames a log holds tensions along the rope in single precision; these are compared to its rounding.
    """
    if any(comparison.only_in):
        return True
    for name, one in comparison.differences.items():
        rounding = SINGLE * max(map(abs, one.values)) if name.startswith(IN_SINGLE) else 0.0
        if one.largest > rounding:
            return True
    return False


if __name__ == "__main__":
    sys.exit(main())
