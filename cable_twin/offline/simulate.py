"""The command `simulate`: run a scenario without ROS, as fast as it goes, scripted, with the logs of the node."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from cable_twin.command_line import OneLineParser, left_at_once
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import nanoseconds, topics
from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.script import (
    ScriptedCommand,
    ScriptError,
    check_script,
    commands_ahead,
    read_script,
    script_of_log,
)
from cable_twin.offline.scripted_run import Outcome, simulate
from cable_twin.offline.start import start_of
from cable_twin.rates import EVERY_FRAME, LOGGED
from cable_twin.rates import fault as rate_fault
from cable_twin.recording.log_reader import Log, LogError, read_log
from cable_twin.recording.run import Run, start_run
from cable_twin.recording.splitting import HOURLY, Splitting
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError

DONE, FAILED, UNUSABLE = 0, 1, 2  # exit codes
DEFAULT_SCENARIO = "aerial_tramway"
DURATION = 60.0  # s, after the last command of a script
SPLITTING = (
    ("split-duration", "S", "simulated seconds after which the logs go on in new files, 0 for never"),
    ("split-size", "MB", "size of the bag's file from which on they do so as well, 0 for any"),
    ("keep-age", "S", "remove files at a split that ended so many seconds ago, 0 for none"),
    ("keep-size", "MB", "remove the oldest files at a split until the run has this size, 0 for none"),
)
LOG_RATES = {  # group of topics: what they are
    "joints": "joint states are",
    "poses": "poses are",
    "forces": "forces are",
    "rope": "the shape of the rope is",
    "path": "the same as a path for RViz is",
}
EPILOG = """\
A script is YAML or CSV, times in seconds of simulated time:

  - {time: 0, name: cabin, speed: 6.0}           time,name,speed,force,payload,wind,event
  - {time: 20, wind: 15.0}                       0,cabin,6.0,,,,
  - {time: 25, wind: 0.0}                        20,,,,,15.0,
  - {time: 40, event: emergency_stop}            25,,,,,0.0,
  - {time: 50, event: release}                   40,,,,,,emergency_stop
  - {time: 51, name: cabin, force: 30000}        50,,,,,,release
  - {time: 90, name: cabin, payload: 3200}       51,cabin,,30000,,,

Names are carriages, or the drive of a moving cable as in {name: haul_rope, speed: 2.5}. Units: speed m/s, force N,
payload kg, of carriages that stand in a station; wind m/s along the track until the next one, wind_z upwards; events:
emergency_stop, release, reset.

exit codes: 0 done, 1 the run failed, could not be recorded or refused a command, 2 wrong scenario, script or option,
130 ended by Ctrl-C before the run

examples:
  simulate aerial_tramway --script trip.yaml --duration 300
  simulate --from-bag cable_twin_logs/2026-01-31_09-30-00 \\
           --set carriages.cabin.drive.limits.emergency_deceleration=0.6    what if the brake were softer?
  simulate --snapshot snapshot_60.000_s.npz --duration 30                  go on from there
"""


def parser() -> OneLineParser:
    """Options of `simulate`."""
    result = OneLineParser(
        "simulate",
        "Run a scenario without ROS, as fast as it goes, and log it as `sim` does.",
        EPILOG,
        failure=UNUSABLE,
    )
    result.add_argument(
        "scenario",
        nargs="?",
        help=f"name of a scenario, or path of its YAML file; default: that of the bag, else {DEFAULT_SCENARIO}",
    )
    result.add_argument(
        "--snapshot",
        type=Path,
        metavar="FILE",
        help="go on from the state, and with the scenario, that ~/save_snapshot or Simulation.save wrote; "
        "times of commands stay simulated time, which goes on as well",
    )
    result.add_argument(
        "--set",
        action="append",
        default=[],
        type=_assignment,
        metavar="KEY=VALUE",
        help="change a value of the scenario by its dotted key, as in cable.elements=48; may be given often",
    )
    result.add_argument(
        "--duration",
        type=_number(0.0, math.inf, "s"),
        metavar="S",
        help=f"simulated seconds; default: that of the bag, else {DURATION:g} s after the last command",
    )
    source = result.add_mutually_exclusive_group()
    source.add_argument("--script", type=Path, metavar="FILE", help="commands, .yaml or .csv, see below")
    source.add_argument("--from-bag", type=Path, metavar="BAG", help="take the commands of a recorded run")
    result.add_argument(
        "--output", type=Path, default=Path("cable_twin_logs"), metavar="DIR", help="default: cable_twin_logs"
    )
    result.add_argument(
        "--frame-rate",
        type=_number(1.0, 1000.0, "Hz"),
        default=100.0,
        metavar="HZ",
        help="frames recorded in a second of simulated time; default: 100",
    )
    for group, text in LOG_RATES.items():
        rate = LOGGED.get(group, EVERY_FRAME)
        result.add_argument(
            f"--log-{group.removesuffix('s')}-rate",
            dest=f"rate_{group}",
            type=_rate,
            metavar="HZ",
            help=f"how often {text} recorded, 0 for every frame; default: {rate:g}",
        )
    for name, metavar, text in SPLITTING:
        result.add_argument(
            f"--{name}",
            type=_limit,
            default=getattr(HOURLY, name.replace("-", "_")),
            metavar=metavar,
            help=f"{text}; default: %(default)g",
        )
    result.add_argument(
        "--record",
        choices=("all", "bag", "off"),
        default="all",
        help="MCAP bag and rerun recording, the bag alone, or nothing; default: all",
    )
    return result


def _assignment(text: str) -> tuple[str, Any]:
    """Key and value of KEY=VALUE, the value as YAML has it."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise argparse.ArgumentTypeError(f"{text!r} given, KEY=VALUE is needed")
    try:
        return key.strip(), YAML(typ="safe", pure=True).load(value)
    except (YAMLError, ValueError):
        raise argparse.ArgumentTypeError(f"{text!r} given, the value is not YAML") from None


def _number(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Type of an option that is above 0 and within bounds."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (low <= value <= high and 0.0 < value < math.inf):
            allowed = f"more than 0 {unit} is" if high == math.inf else f"{low:g} to {high:g} {unit} are"
            raise argparse.ArgumentTypeError(f"{text!r} given, {allowed} allowed")
        return value

    return convert


def _rate(text: str) -> float:
    """Rate in Hz; whether it divides the frame rate depends on that."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f"{text!r} given, 0 to 1000 Hz are allowed")
    return value


def _rates(options: argparse.Namespace, frame_rate: float) -> tuple[dict[str, float], list[str]]:
    """Rates (Hz) by group of topics, and a line for each that is asked for and does not divide the frame rate (Hz)."""
    given = {group: rate for group in LOG_RATES if (rate := getattr(options, f"rate_{group}")) is not None}
    faults = [rate_fault(f"--log-{group.removesuffix('s')}-rate", rate, frame_rate) for group, rate in given.items()]
    return {**LOGGED, **given}, [line for line in faults if line is not None]


def _limit(text: str) -> float:
    """Number; whether it is allowed depends on the other options."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} given, a number is needed") from None


def main(argv: Sequence[str] | None = None) -> int:
    """Run a scenario and report; see the exit codes above."""
    options = parser().parse_args(sys.argv[1:] if argv is None else list(argv))
    console = Console(stderr=True)
    splitting = Splitting(options.split_duration, options.split_size, options.keep_age, options.keep_size)
    if faults := splitting.faults(lambda name: f"--{name.replace('_', '-')}"):
        for line in faults:
            print(f"simulate: {line}", file=sys.stderr)
        return UNUSABLE
    try:
        log = read_log(options.from_bag) if options.from_bag is not None else None
        script = read_script(options.script) if options.script is not None else []
        if log is not None:
            script = script_of_log(log)
            if log.damage:
                which = "later commands" if len(log.files) == 1 else "commands"
                print(f"simulate: {log.path}: {log.condition}: {which} are lost", file=sys.stderr)
        simulation = _simulation(options, log, console)
        ahead = commands_ahead(simulation, script)
        faults = check_script(simulation, ahead)
        if faults and log is None:
            raise ScriptError("\n".join(faults))
        if faults and len(faults) == len(ahead):
            raise ScriptError(f"{faults[0]} (and so for all {len(ahead)} commands of the bag)")
        duration = _duration(options.duration, script, log, simulation.time)
    except (LogError, ScriptError, ScenarioError, EquilibriumError, SnapshotError) as error:
        for line in str(error).splitlines():
            print(f"simulate: {line}", file=sys.stderr)
        return UNUSABLE
    frame_steps = max(round(1.0 / (options.frame_rate * simulation.step)), 1)
    rate = 1.0 / (frame_steps * simulation.step)
    if abs(rate - options.frame_rate) > 1e-6 * rate:
        print(
            f"simulate: --frame-rate {options.frame_rate:g} Hz is no whole number of solver steps of "
            f"{simulation.step:g} s: {rate:g} Hz is used",
            file=sys.stderr,
        )
    rates, faults = _rates(options, rate)
    for line in faults:
        print(f"simulate: {line}", file=sys.stderr)
    if faults:
        return UNUSABLE
    if round(duration / simulation.step) == 0:
        print(f"simulate: --duration {duration:g} s given; a solver step takes {simulation.step:g} s", file=sys.stderr)
        return UNUSABLE
    with _signals(last=argv is None) as ended:  # until all is closed and told, however impatient somebody is
        try:
            run = _start(simulation, options, splitting, frame_steps)
        except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
            print(f"simulate: --output {options.output}: {getattr(error, 'strerror', None) or error}", file=sys.stderr)
            return FAILED
        epoch_ns = time.time_ns() - nanoseconds(simulation.time)
        if run is not None:
            run.begin(epoch_ns)
        started = simulation.time
        figures = KeyFigures(simulation.scenario)
        try:
            with _progress(console, started, duration) as on_frame:
                outcome = simulate(
                    simulation,
                    script,
                    duration=duration,
                    frame_steps=frame_steps,
                    epoch_ns=epoch_ns,
                    run=run,
                    figures=figures,
                    on_frame=on_frame,
                    ended=ended.is_set,
                    rates=rates,
                )
        finally:
            if run is not None:
                run.recorder.close()
        faults = [outcome.fault] if outcome.fault else []
        faults += run.recorder.faults if run is not None else []
        if argv is None:
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # the log is closed: `simulate | head` ends without a word
        return _report(simulation.scenario, started, outcome, figures, run, faults)


def _simulation(options: argparse.Namespace, log: Log | None, console: Console) -> Simulation:
    """The snapshot or the scenario that is asked for, or that of the bag, with what is changed in it."""
    changed = options.scenario is not None or bool(options.set)
    if changed and options.snapshot is not None:
        raise SnapshotError(f"{options.snapshot}: a snapshot has its scenario: neither SCENARIO nor --set is allowed")
    if changed and log is not None and log.snapshot is not None:
        raise SnapshotError(f"{log.path}: started from a snapshot: neither SCENARIO nor --set is allowed")
    with (
        left_at_once("simulate"),
        console.status("the cable settles; the first time on a machine the solver is compiled: half a minute"),
    ):
        if options.snapshot is not None:
            return Simulation.load(options.snapshot)
        if log is not None and not changed:
            return start_of(log)
        own = log.scenario if log is not None else DEFAULT_SCENARIO
        return Simulation(load_scenario(own if options.scenario is None else options.scenario, dict(options.set)))


def _duration(given: float | None, script: Sequence[ScriptedCommand], log: Log | None, start: float) -> float:
    """Simulated time (s) to run from `start` (s) on."""
    if given is not None:
        return given
    if log is not None:
        if log.end <= start:
            raise SnapshotError(
                f"{log.path}: ends at {log.end:g} s, before the snapshot of {start:g} s; give --duration"
            )
        return log.end - start
    return max(script[-1].time - start, 0.0) + DURATION if script else DURATION


def _start(simulation: Simulation, options: argparse.Namespace, splitting: Splitting, frame_steps: int) -> Run | None:
    if options.record == "off":
        return None
    return start_run(
        simulation,
        topics(simulation.layout),
        record_directory=options.output.expanduser(),
        frame_period=frame_steps * simulation.step,
        rerun="file" if options.record == "all" else "off",
        splitting=splitting,
    )


@contextmanager
def _progress(console: Console, start: float, duration: float) -> Iterator[Callable[[float], None]]:
    """A bar with simulated time, speed in times real time, and the time that remains."""
    columns = (
        TextColumn("simulate"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s, {task.fields[factor]:.1f} times real time, remaining"),
        TimeRemainingColumn(),
    )
    # a file gets nothing of it, not even the empty line in the end
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulate", total=duration, factor=0.0)
        began = time.monotonic()

        def on_frame(simulated: float) -> None:
            elapsed = max(time.monotonic() - began, 1e-3)
            done = simulated - start
            progress.update(task, completed=min(done, duration), factor=done / elapsed)

        yield on_frame


@contextmanager
def _signals(*, last: bool) -> Iterator[threading.Event]:
    """SIGINT and SIGTERM as a flag, so that the logs are closed.

    Where this is the last that a process does, and one of them has come, it takes no more: Python would have it killed
    while it leaves, and the exit code would be another one.
    """
    flag = threading.Event()
    before = {number: signal.signal(number, lambda *_: flag.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield flag
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if last and flag.is_set() else handler)


def _report(
    scenario: Scenario, start: float, outcome: Outcome, figures: KeyFigures, run: Run | None, faults: Sequence[str]
) -> int:
    """Say what was done and what it showed."""
    print_figures(table_console(), [figures.figures()])
    for line in outcome.refused[:5]:
        print(f"simulate: refused: {line}", file=sys.stderr)
    if len(outcome.refused) > 5:
        print(f"simulate: {len(outcome.refused) - 5} more refused", file=sys.stderr)
    for fault in faults:
        print(f"simulate: {fault}", file=sys.stderr)
    if outcome.left:
        print(f"simulate: not given, at or after the end: {_count(outcome.left)}", file=sys.stderr)
    if outcome.past:
        print(f"simulate: not given, before the snapshot: {_count(outcome.past)}", file=sys.stderr)
    simulated = outcome.time - start
    factor = simulated / max(outcome.wall_time, 1e-9)
    since = f" from {start:.2f} s on" if start else ""
    print(
        f"{scenario.name}: {simulated:.2f} s{since} in {outcome.wall_time:.2f} s, {factor:.1f} times real time; "
        f"{_count(outcome.applied)}" + (f", {len(outcome.refused)} refused" if outcome.refused else "")
    )
    if run is not None:
        print(f"log: {run.directory}\nlook at it: review {run.directory}")
    return FAILED if faults or outcome.refused else DONE


def _count(commands: int) -> str:
    return f"{commands} command{'' if commands == 1 else 's'}"


if __name__ == "__main__":
    sys.exit(main())
