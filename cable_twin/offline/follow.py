"""Command `follow`: a twin that follows a recorded plant and estimates quantities that no sensor measures."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Console

from cable_twin.basics.units import NORMAL_95, decimals, shown_unit
from cable_twin.ensemble.ensemble import usable_cores
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.followers import AnyFollower, follower_of, unfollowable
from cable_twin.ensemble.estimate.quantities import Estimate
from cable_twin.ensemble.estimate.tracker import LISTENING, WAITING, Tracker
from cable_twin.frame.records import AppliedCommand, CommandError
from cable_twin.frame.sensors import Measurement
from cable_twin.messages import ESTIMATE, SCENARIO, Topic, nanoseconds, scenario_message
from cable_twin.messages.figure_messages import estimate_message
from cable_twin.messages.topics import DiagnosticArray, String
from cable_twin.offline.following.plant_log import (
    Item,
    PlantLog,
    Readmission,
    at_rest_with_sensors,
    read_plant_log,
)
from cable_twin.offline.following.truth import Truth, true_values
from cable_twin.offline.simulate import run_progress
from cable_twin.offline.simulate_options import UNUSABLE, add_changes, plots_fault
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import Log
from cable_twin.recording.run import Run, start_run
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import start_shown
from cable_twin.terminal.command_line import OneLineParser, number, tell

DONE, FAILED = 0, 1  # exit codes, beside UNUSABLE
LONGEST_SILENCE = 60.0  # s, after which the twin says that it goes on by its model
Progress = tuple[float, Correction | None, list[str]]  # time (s), correction, and lines to print
EPILOG = """\
The twin gets the commands of the plant and corrects payloads, rolling friction, wind and counterweights by what its
sensors measure. It prints the estimates of the end with their bands of 95 %, beside the true values where the bag has
them, and each alarm with its time and reason: a sensor that contradicts the others and is left out, and quantities that
are not those of the scenario.

Sensors are those of SCENARIO, else those of the log, else the usual ones of `plant`.

exit codes: 0 done, 1 the twin failed or something could not be written, 2 wrong log, scenario or option, 130 ended by
Ctrl-C

examples:
  plant aerial_tramway --set carriages.cabin.payload.mass=4200 \\
        --script trip.yaml --log plants
  follow plants/* --scenario aerial_tramway --plots pictures
"""


class FollowError(ValueError):
    """Error of a recorded plant that the twin cannot follow; the message is one line."""


UNUSABLE_INPUT = (FollowError, LogError, ScenarioError, EquilibriumError)


def parser() -> OneLineParser:
    """Parser of the options of `follow`."""
    result = OneLineParser(
        "follow", "Follow a recorded plant by its sensors, and estimate what is hidden.", EPILOG, failure=UNUSABLE
    )
    result.add_argument("log", type=Path, help="directory of the plant's bag, or one of its .mcap files")
    result.add_argument(
        "--scenario", metavar="SCENARIO", help="scenario of the twin, name or path; default: that of the log"
    )
    add_changes(result)
    result.add_argument(
        "--duration", type=number(0.0, math.inf, "s"), metavar="S", help="simulated time to follow; default: all"
    )
    result.add_argument(
        "--output",
        type=Path,
        default=Path("cable_twin_logs"),
        metavar="DIR",
        help="directory in which the estimates get a log of their own; default: cable_twin_logs",
    )
    result.add_argument("--plots", type=Path, metavar="DIR", help="write estimates.png into this directory")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Follow a recorded plant by its sensors and report estimates; returns the exit code that the help lists."""
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    if fault := plots_fault("--plots") if options.plots is not None else "":
        arguments.error(fault)
    console = Console(stderr=True)
    try:
        log = read_plant_log(options.log, options.scenario)
        with start_shown("follow", console):
            simulation = twin_of(log, options.scenario, dict(options.set))
            plant = PlantLog(log, simulation.scenario.sensors)
            live = plant.real or not plant.begins_with(simulation.scenario)
            tracker = Tracker(simulation.scenario, usable_cores()) if live else None
            follower = follower_of(simulation.scenario) if tracker is None else tracker.follower
    except UNUSABLE_INPUT as error:
        tell("follow", error)
        return UNUSABLE
    try:
        run = start_run(
            simulation,
            (Topic(SCENARIO, String.__msgtype__), Topic(ESTIMATE, DiagnosticArray.__msgtype__)),
            record_directory=options.output.expanduser(),
            frame_period=simulation.step,
            rerun="none",
        )
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
        tell("follow", f"--output {options.output}: {getattr(error, 'strerror', None) or error}")
        return FAILED
    try:
        end = min(log.end, options.duration or math.inf)
        corrections = _follow(log, plant, tracker or follower, run, end, console)
    except UNUSABLE_INPUT as error:
        tell("follow", error)
        return UNUSABLE
    except CommandError as error:
        tell("follow", f"the twin refuses a command of the plant: {error}")
        return FAILED
    finally:
        run.close()
        follower.close()
    return _report(log, follower, corrections, run, options)


def twin_of(log: Log, source: str | None, values: dict[str, Any]) -> Simulation:
    """Simulation of the twin at rest, with the sensors of the plant.

    Args:
        log: of the plant.
        source: scenario, or None for that of the log.
        values: changes of the scenario by dotted key.

    Raises:
        ScenarioError, EquilibriumError: the scenario cannot be simulated.
        FollowError: the scenario is of a kind that cannot be followed yet.
        LogError: the log is of another scenario.
    """
    scenario: Scenario = load_scenario(log.scenario if source is None else source, values)
    if fault := unfollowable(scenario):
        raise FollowError(fault)
    return at_rest_with_sensors(scenario, log)


def _follow(
    log: Log, plant: PlantLog, twin: AnyFollower | Tracker, run: Run, end: float, console: Console
) -> list[Correction]:
    """Follow a recorded plant to a time (s), show progress and record the estimates; returns all corrections."""
    run.recorder.begin(log.epoch_ns, 0.0, scenario_message(run.simulation.scenario.resolved()))
    corrections: list[Correction] = []
    with run_progress(console, 0.0, end) as show:
        steps = _as_live(plant, twin, end) if isinstance(twin, Tracker) else _from_rest(plant, twin, end)
        for time, correction, lines in steps:
            show(time)
            for line in lines:
                console.print(line, highlight=False, markup=False, soft_wrap=True)
            if correction is not None:
                corrections.append(correction)
                stamp_ns = log.epoch_ns + nanoseconds(correction.time)
                run.recorder.record([(ESTIMATE, _message(correction, stamp_ns))], stamp_ns)
    for line in plant.left_out():
        tell("follow", line)
    if not corrections:
        if isinstance(twin, Tracker) and twin.arrivals.started and twin.state == WAITING:
            raise FollowError(_never_begun(log, twin))
        raise FollowError(plant.nothing((twin.follower if isinstance(twin, Tracker) else twin).readings))
    return corrections


def _never_begun(log: Log, tracker: Tracker) -> str:
    """Reason, in a line, why a log has no moment at which following it can begin."""
    return (
        f"{log.path}: given a plant that never {tracker.wanted} for {LISTENING:g} s; allowed: a log in which it "
        "does, or that begins where its scenario does"
    )


def _from_rest(plant: PlantLog, follower: AnyFollower, end: float) -> Iterator[Progress]:
    """Follow a plant that begins as its scenario does."""
    last = 0.0
    for time, group in groupby(plant.items(), key=_time):
        if time > end:
            break
        items, lines = list(group), list[str]()
        if time - last > LONGEST_SILENCE:
            lines.append(f"{time:.1f} s: nothing from {last:.1f} s on: the twin went on by its model")
        last = time
        for item in items:
            if isinstance(item, AppliedCommand):
                follower.command(item)
        measured = [item for item in items if not isinstance(item, AppliedCommand)]
        correction = follower.take(time, measured) if measured else None
        yield time, correction, [*lines, *_alarms(correction)]


def _as_live(plant: PlantLog, tracker: Tracker, end: float) -> Iterator[Progress]:
    """Follow a plant from where its log begins, as a twin does that runs beside it from then on."""
    for time, items in plant.arrivals():
        if time > end:
            break
        tracker.measure([item for item in items if isinstance(item, Measurement)], time)
        for item in items:
            if isinstance(item, Readmission):
                tracker.readmit(item.sensor)
            elif isinstance(item, AppliedCommand) and item.command.kind == "speed":
                tracker.command(item.command.values, time)
        for news in tracker.advance(time):
            lines = [f"{news.time:.1f} s: {line}" for line in news.lines]
            yield time, news.correction, [*lines, *_alarms(news.correction)]


def _alarms(correction: Correction | None) -> list[str]:
    """Alarms of a correction, a line each."""
    if correction is None:
        return []
    return [*correction.said(of_payloads=False), *correction.said(of_payloads=True)]


def _message(correction: Correction, stamp_ns: int) -> bytes:
    """Encode the estimates and alarms of a correction as a message with a stamp (ns)."""
    alarms, of_payloads = correction.said(of_payloads=False), correction.said(of_payloads=True)
    return estimate_message({**correction.slow, **correction.hidden}, alarms, stamp_ns, of_payloads=of_payloads)


def _time(item: Item) -> float:
    """Time (s) of a command or measurement of a plant, to the microsecond."""
    return round(item.time, 6)


def _report(
    log: Log, follower: AnyFollower, corrections: Sequence[Correction], run: Run, options: argparse.Namespace
) -> int:
    """Print the last estimates of a followed plant, and draw all; returns the exit code."""
    last = corrections[-1]
    try:
        truth = true_values(log, follower, last, run.simulation.scenario)
    except LogError as error:
        tell("follow", error)
        truth = {}
    wide = max(map(len, (*last.slow, *last.hidden))) + 4
    print(f"{f'estimate at {last.time:.1f} s':{wide}} {'value':>12}    95 % band" + (f"{'plant':>18}" if truth else ""))
    for name, one in (last.slow | last.hidden).items():
        print(_row(name, one, truth.get(name), wide))
    for sensor in follower.left_out:
        print(f"left out: {sensor}")
    print(f"estimates: {run.directory}")
    if options.plots is not None:
        from cable_twin.offline.following.plot import write_estimates  # noqa: PLC0415 - matplotlib is an extra

        try:
            options.plots.mkdir(parents=True, exist_ok=True)
            title = f"{run.simulation.scenario.name} follows its plant"
            write_estimates(title, corrections, truth, options.plots / "estimates.png")
        except OSError as error:
            tell("follow", f"--plots {options.plots}: {error.strerror or error}")
            return FAILED
        print(f"plot: {options.plots / 'estimates.png'}")
    for fault in run.recorder.faults:
        tell("follow", fault)
    return FAILED if run.recorder.faults else DONE


def _row(name: str, one: Estimate, true: Truth | None, wide: int) -> str:
    """Row of a table of estimates, with as many decimals as make two digits of the band of 95 %."""
    unit, scale = shown_unit(one.unit, max(abs(one.value), 0.0 if true is None else abs(true.last)))
    band = NORMAL_95 * one.deviation * scale
    digits = decimals(band)
    known = "" if true is None else f"{true.last * scale:13.{digits}f}"
    value = f"{one.value * scale + 0.0:12.{digits}f}"
    return f"{name:{wide}} {value} +- {f'{band:.{digits}f}':<9} {unit:4}{known}".rstrip()


if __name__ == "__main__":
    sys.exit(main())
