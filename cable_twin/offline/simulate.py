"""Command `simulate`: scripted run of a scenario without ROS, as fast as possible, with the logs of the node."""

from __future__ import annotations

import argparse
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from textwrap import wrap

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from cable_twin.basics.units import counted
from cable_twin.frame.layout import COMMANDED
from cable_twin.key_figures import KeyFigure, KeyFigures, compile_figures, not_judged
from cable_twin.key_figures.rules import judge, profiles_of
from cable_twin.messages import nanoseconds
from cable_twin.messages.figure_messages import describe
from cable_twin.offline.check import checked
from cable_twin.offline.export import Export, RunTable, export_fault
from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.script import (
    ScriptedCommand,
    ScriptError,
    check_script,
    commands_ahead,
    read_script,
    script_of_log,
)
from cable_twin.offline.scripted_run import Outcome, simulate, start_of
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, DURATION, UNUSABLE, parser, plot_fault, rates_of
from cable_twin.offline.sweep import sweep
from cable_twin.offline.verdict_table import print_verdicts
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import Log, read_log
from cable_twin.recording.run import Run, start_run
from cable_twin.recording.splitting import Splitting
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.scenario.command_limits import unbraked
from cable_twin.scenario.reference import Entry, explained
from cable_twin.scenario.schema import Solver
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError
from cable_twin.terminal.bars import start_shown
from cable_twin.terminal.command_line import ending_signals, tell, typed

DEFAULT_STEP: float = Solver().step  # s
DONE, FAILED = 0, 1  # exit codes, beside UNUSABLE


class OptionError(Exception):
    """Errors in the options of `simulate`, one line each."""


UNUSABLE_INPUT = (OptionError, LogError, ScriptError, ScenarioError, EquilibriumError, SnapshotError)


@dataclass(frozen=True, slots=True)
class Plan:
    """Planned run of `simulate`: simulation, script, duration, frames, log rates, splitting."""

    simulation: Simulation
    script: Sequence[ScriptedCommand]
    duration: float  # s
    frame_steps: int
    rates: dict[str, float]  # Hz, by group of topics
    splitting: Splitting


def main(argv: Sequence[str] | None = None) -> int:
    """Run a scenario and report key figures; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    options.scenario = arguments.given_scenario(options)
    if fault := export_fault(options) or _plot_fault(options):
        arguments.error(fault)
    if options.sweep is not None:
        return sweep(options)
    console = Console(stderr=True)
    try:
        if options.explain is not None:
            _explain(options.explain)
            return DONE
        plan = _plan(options, console)
    except UNUSABLE_INPUT as error:
        tell("simulate", error)
        return UNUSABLE
    with _signals(last=argv is None) as ended:  # until the logs are closed and the report is printed
        try:
            export = Export(options)
        except OSError as error:
            tell("simulate", f"{error.filename}: {error.strerror}")
            return FAILED
        try:
            run = _start(plan, options)
        except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
            tell("simulate", f"--output {options.output}: {getattr(error, 'strerror', None) or error}")
            return FAILED
        started = plan.simulation.time
        figures = KeyFigures(plan.simulation.scenario)
        name = plan.simulation.scenario.name
        table = export.add(name if run is None else str(run.directory), name)
        outcome = _run(plan, run, figures, table, console, ended)
        faults = [outcome.fault] if outcome.fault else []
        faults += run.recorder.faults if run is not None else []
        if argv is None:
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # the log is closed: `simulate | head` ends without a word
        shown = figures.figures()
        with export.words():
            if options.check and not faults:
                scenario, frames = plan.simulation.scenario, plan.frame_steps
                shown = checked(shown, scenario, plan.script, duration=plan.duration, frame_steps=frames)
            code = FAILED if report(plan.simulation.scenario, started, outcome, shown, run, faults) else DONE
        if table is not None:
            table.figures, table.verdicts = shown, judge(plan.simulation.scenario, shown)
        return code if export.write("simulate") else FAILED


def _plot_fault(options: argparse.Namespace) -> str:
    """Error line about an unusable option `--plot` of `simulate`; empty for a usable one."""
    if options.plot is not None and options.sweep is None:
        return f"--plot {options.plot} without --sweep; plots of a single run are made by: review LOG --plots DIR"
    return plot_fault(options.plot)


def _explain(key: str) -> None:
    try:
        print_entries(key)
    except KeyError as error:
        raise OptionError(f"--explain {error.args[0]}") from None


def _plan(options: argparse.Namespace, console: Console) -> Plan:
    """Plan a run of `simulate` from its options: read scenario, script and log, and check all of them.

    Raises:
        One of UNUSABLE_INPUT: an option or a file cannot be used.
    """
    splitting = Splitting(options.split_duration, options.split_size, options.keep_age, options.keep_size)
    if faults := splitting.faults(lambda name: f"--{name.replace('_', '-')}"):
        raise OptionError("\n".join(faults))
    log = read_log(options.from_bag) if options.from_bag is not None else None
    if options.check and (options.snapshot is not None or (log is not None and log.snapshot is not None)):
        raise OptionError("--check: given with a snapshot, whose mesh cannot be refined; allowed: a run from the start")
    scenario = _scenario(options, log)
    script = read_script(options.script, scenario) if options.script is not None else []
    if log is not None:
        script = script_of_log(log)
        if log.damage:
            which = "later commands" if len(log.files) == 1 else "commands"
            tell("simulate", f"{log.path}: {log.condition}: {which} are lost")
    simulation = _simulation(options, log, scenario, console)
    profiles_of(simulation.scenario)
    ahead = commands_ahead(script, simulation.time, simulation.step)
    faults = check_script(simulation.scenario, ahead, stopped=simulation.emergency_stopped)
    if faults and log is None:
        raise ScriptError("\n".join(faults))
    if faults and len(faults) == len(ahead):
        raise ScriptError(f"{faults[0]} (and so for all {len(ahead)} commands of the bag)")
    if _unheard_stop(simulation, ahead):
        tell(
            "simulate", "emergency_stop: nothing obeys it: the drives are free, and have no brake in an emergency stop"
        )
    duration = _duration(options.duration, script, log, simulation.time)
    frame_steps = max(round(1.0 / (options.frame_rate * simulation.step)), 1)
    rate = 1.0 / (frame_steps * simulation.step)
    if abs(rate - options.frame_rate) > 1e-6 * rate:
        print(
            f"simulate: --frame-rate {options.frame_rate:g} Hz is no whole number of solver steps of "
            f"{simulation.step:g} s: {rate:g} Hz is used",
            file=sys.stderr,
        )
    rates, faults = rates_of(options, rate)
    if faults:
        raise OptionError("\n".join(faults))
    if round(duration / simulation.step) == 0:
        raise OptionError(f"--duration: given {duration:g} s; allowed: a solver step of {simulation.step:g} s or more")
    return Plan(simulation, script, duration, frame_steps, rates, splitting)


def _unheard_stop(simulation: Simulation, ahead: Sequence[ScriptedCommand]) -> bool:
    """Whether a script has an emergency stop that no drive or brake obeys: all drives are free up to then."""
    scenario, kinds = simulation.scenario, [one.command.kind for one in ahead]
    if "emergency_stop" not in kinds or scenario.drives or unbraked(scenario) != scenario.carriages.keys():
        return False
    driven = bool((simulation.snapshot.columns.command_kind > COMMANDED.index("nothing")).any())
    return not driven and not {"speed", "force"} & set(kinds[: kinds.index("emergency_stop")])


def _run(
    plan: Plan,
    run: Run | None,
    figures: KeyFigures,
    table: RunTable | None,
    console: Console,
    ended: threading.Event,
) -> Outcome:
    """Carry out a planned run with a progress bar, and close its logs."""
    simulation = plan.simulation
    epoch_ns = time.time_ns() - nanoseconds(simulation.time)
    if run is not None:
        run.begin(epoch_ns)
    try:
        with run_progress(console, simulation.time, plan.duration) as show:

            def on_frame(time: float) -> None:
                show(time)
                if table is not None:
                    table.take(simulation.snapshot)

            return simulate(
                simulation,
                plan.script,
                duration=plan.duration,
                frame_steps=plan.frame_steps,
                epoch_ns=epoch_ns,
                run=run,
                figures=figures,
                on_frame=on_frame,
                ended=ended.is_set,
                rates=plan.rates,
            )
    finally:
        if run is not None:
            run.close()


def _scenario(options: argparse.Namespace, log: Log | None) -> Scenario | None:
    """Load the requested scenario, or that of the bag with changes; None where log or snapshot is used as it is.

    Raises:
        SnapshotError: a scenario or change is given beside a snapshot, which has a scenario.
        ScenarioError: the scenario is invalid.
    """
    changed = options.scenario is not None or bool(options.set)
    if changed and options.snapshot is not None:
        raise SnapshotError(
            f"{options.snapshot}: a snapshot contains its scenario: neither SCENARIO nor --set is allowed"
        )
    if changed and log is not None and log.snapshot is not None:
        raise SnapshotError(f"{log.path}: started from a snapshot: neither SCENARIO nor --set is allowed")
    if options.snapshot is not None or (log is not None and not changed):
        return None
    source = options.scenario if options.scenario is not None else log.scenario if log else DEFAULT_SCENARIO
    return load_scenario(source, dict(options.set))


def _simulation(
    options: argparse.Namespace, log: Log | None, scenario: Scenario | None, console: Console
) -> Simulation:
    """Build the simulation of the requested scenario, or of the snapshot, or of the start of the bag."""
    with start_shown("simulate", console):
        if scenario is not None:
            return Simulation(scenario, meanwhile=compile_figures)
        if options.snapshot is not None:
            return Simulation.load(options.snapshot, meanwhile=compile_figures)
        assert log is not None
        return start_of(log, meanwhile=compile_figures)


def _duration(given: float | None, script: Sequence[ScriptedCommand], log: Log | None, start: float) -> float:
    """Duration (s) of a run in simulated time: given, else that of the log or script from `start` (s) on."""
    if given is not None:
        return given
    if log is not None:
        if log.end <= start:
            raise SnapshotError(
                f"{log.path}: ends at {log.end:g} s, before the snapshot of {start:g} s; give --duration"
            )
        return log.end - start
    return max(script[-1].time - start, 0.0) + DURATION if script else DURATION


def _start(plan: Plan, options: argparse.Namespace) -> Run | None:
    if options.record == "off":
        return None
    return start_run(
        plan.simulation,
        record_directory=options.output.expanduser(),
        frame_period=plan.frame_steps * plan.simulation.step,
        rerun="file" if options.record == "all" else "none",
        splitting=plan.splitting,
    )


@contextmanager
def _signals(*, last: bool) -> Iterator[threading.Event]:
    """Turn signals that end a process into a flag, so that the logs are closed; yields the flag.

    With `last`, before the process ends, further signals are ignored after the first one: Python would be killed while
    it ends, with another exit code.
    """
    flag = threading.Event()
    before = {number: signal.signal(number, lambda *_: flag.set()) for number in ending_signals()}
    try:
        yield flag
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if last and flag.is_set() else handler)


@contextmanager
def run_progress(console: Console, start: float, duration: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar of a run: simulated time, real-time factor, remaining time; yields a callback for frames."""
    columns = (
        TextColumn("simulate"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s, {task.fields[factor]:.1f} times real time, remaining"),
        TimeRemainingColumn(),
    )
    # disabled on a file, which would get an empty line at the end
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulate", total=duration, factor=0.0)
        began = time.monotonic()

        def on_frame(simulated: float) -> None:
            elapsed = max(time.monotonic() - began, 1e-3)
            done = simulated - start
            progress.update(task, completed=min(done, duration), factor=done / elapsed)

        yield on_frame


def report(
    scenario: Scenario,
    start: float,
    outcome: Outcome,
    figures: Sequence[KeyFigure],
    run: Run | None,
    faults: Sequence[str],
) -> bool:
    """Print the results of a run; returns whether the run failed or refused a command.

    Args:
        scenario: scenario of the run.
        start: simulated time (s) at its start.
        outcome: outcome of the run.
        figures: key figures of the run, which the rule profiles of the scenario judge.
        run: log of the run, or None.
        faults: failures, a line each.
    """
    print_figures(table_console(), [figures], ended=f"{outcome.time:.2f} s" if outcome.fault else "")
    print_verdicts(table_console(), profiles_of(scenario), judge(scenario, figures), scenario)
    warned = [one for one in figures if one.kept is False and one.id.quantity in ("energy_lost", "derailed")]
    met = [one for one in figures if one.id.quantity in ("buffer_force", "end_stop_speed")]
    met += [one for one in figures if one.id.quantity == "stopping_distance" and one.unfinished]
    lines = [f"warning: {figure.name}: {describe(figure)}" for figure in (*met, *warned)]
    lines += [one.told() for one in not_judged(scenario, figures)]
    lines += [f"refused: {line}" for line in outcome.refused[:5]]
    lines += [f"{len(outcome.refused) - 5} more refused"] if len(outcome.refused) > 5 else []
    lines += [*faults]
    lines += (
        [f"not carried out, because their time is at or after the end of the run: {counted(outcome.left, 'command')}"]
        if outcome.left
        else []
    )
    lines += [f"not carried out: {line}" for line in outcome.not_reached]
    lines += (
        [f"not carried out, because their time is before that of the snapshot: {counted(outcome.past, 'command')}"]
        if outcome.past
        else []
    )
    simulated, since = outcome.time - start, f" from {start:.2f} s on" if start else ""
    factor = simulated / max(outcome.wall_time, 1e-9)
    if factor < 1.0 and scenario.solver.step == DEFAULT_STEP and not _needs_step(scenario):
        lines.append(
            f"slower than real time with solver.step at its default of {DEFAULT_STEP:g} s; ropeways usually do with "
            "0.005 to 0.01 s: --set solver.step=0.005, and --check says what that changes"
        )
    for line in lines:
        tell("simulate", line)
    print(
        f"{scenario.name}: {simulated:.2f} s{since} in {outcome.wall_time:.2f} s, {factor:.1f} times real time; "
        + counted(outcome.applied, "command")
        + (f", {len(outcome.refused)} refused" if outcome.refused else "")
    )
    if not start and _idle(scenario, outcome):  # a snapshot has commands of its own
        print("no drive was commanded: give commands with --script FILE")
    if run is not None:
        print(f"log: {run.directory}\nto view it: {typed('review')} {shlex.quote(str(run.directory))}")
    return bool(faults or outcome.refused)


def _needs_step(scenario: Scenario) -> bool:
    """Whether a scenario needs short solver steps: pantographs for their contact, Runge-Kutta for its stability."""
    return bool(scenario.pantographs) or scenario.solver.integrator == "runge_kutta"


def _idle(scenario: Scenario, outcome: Outcome) -> bool:
    """Whether all drives of a run stood still for lack of a command."""
    carriages = scenario.carriages.values()
    drives = [one.speed for one in scenario.drives.values()]
    drives += [one.speed for one in carriages if one.drive.mode == "speed"]
    given = outcome.applied or outcome.refused or outcome.past or outcome.left or outcome.not_reached
    return bool(drives) and not any(drives) and not given


WIDE = 120  # characters below which a table has too narrow columns to be read


def print_entries(key: str) -> None:
    """Print the entry of a key of a scenario file, or a table of a section.

    Args:
        key: dotted, as for `simulate --set`; carriages and towers may have any name.

    Raises:
        KeyError: there is no such key; one line with the nearest keys.
    """
    found = explained(key)
    console = table_console()
    if len(found) == 1:
        _print_entry(console, found[0])
        return
    if console.width < WIDE:
        for entry in found:
            _print_block(console, entry)
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in Entry._fields:
        table.add_column(title, no_wrap=title in ("key", "unit"))
    for entry in found:
        table.add_row(*map(Text, entry))
    console.print(table)


def _print_block(console: Console, entry: Entry) -> None:
    """Print the entry of a scenario key as a filled block: key with unit, meaning, default and allowed values."""
    unit = f" [{entry.unit}]" if entry.unit else ""
    rest = "; ".join(f"{title}: {text}" for title, text in zip(("default", "allowed"), entry[2:4], strict=True) if text)
    lines = [f"{entry.key}{unit}"]
    for text in (entry.meaning, rest):
        lines += wrap(text, console.width - 1, initial_indent="    ", subsequent_indent="    ")
    console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)


def _print_entry(console: Console, entry: Entry) -> None:
    unit = f" ({entry.unit})" if entry.unit else ""
    lines = f"{entry.key}{unit}: {entry.meaning}", f"default: {entry.default}", f"allowed: {entry.allowed}"
    console.print("\n  ".join(lines), markup=False, highlight=False)


if __name__ == "__main__":
    sys.exit(main())
