"""Command line options of `simulate`, some of them for other commands, too: names, allowed values and help."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cable_twin.frame.rates import EVERY_FRAME, LOGGED
from cable_twin.frame.rates import fault as rate_fault
from cable_twin.key_figures.rules import RuleError, load_profile
from cable_twin.offline.export import add_export
from cable_twin.recording.splitting import HOURLY
from cable_twin.scenario import assignment, full_key, scenario_lines
from cable_twin.scenario.checks.fault import allowed, refuse
from cable_twin.scenario.sections.limits import Installation
from cable_twin.terminal.command_line import OneLineParser, number, typed

UNUSABLE = 2  # exit code for wrong input
DEFAULT_SCENARIO = "aerial_tramway"
DURATION = 60.0  # s, after the last command of a script
DRAWN = (".png", ".pdf", ".svg")
MOST_RUNS = 1000  # of a sweep
FORM = "allowed: KEY=START:STOP:STEP, as in wind.y=0:30:2.5"
SPLITTING = (
    ("split-duration", "S", "begin new log files after so many simulated seconds; 0: never"),
    ("split-size", "MB", "begin new log files when the MCAP file has reached this size; 0: no limit"),
    ("keep-age", "S", "whenever new files begin, delete those that ended longer ago than this; 0: keep all"),
    (
        "keep-size",
        "MB",
        "whenever new files begin, delete the oldest until the run is no larger than this; 0: keep all",
    ),
)
LOG_RATES = {  # group of topics: subject and verb for the help
    "joints": "joint states are",
    "poses": "poses are",
    "forces": "forces are",
    "rope": "the shape of the rope is",
    "path": "the shape of the rope as a nav_msgs/Path, for RViz, is",
}
EPILOG = """\
A script is YAML or CSV, times in seconds of simulated time:

  - {time: 0, name: cabin, speed: 6.0}       time,name,speed,force,wind,event
  - {time: 20, wind: 15.0}                   0,cabin,6.0,,,
  - {time: 25, wind: 0.0}                    20,,,,15.0,
  - {time: 40, event: emergency_stop}        25,,,,0.0,
  - {time: 50, event: release}               40,,,,,emergency_stop
  - {time: 51, name: cabin, force: 30000}    50,,,,,release
  - {time: 90, name: cabin, payload: 3200}   51,cabin,,30000,,

Names are those of carriages, or of the drive of a moving cable as in {name: haul_rope, speed: 2.5}. Units: speed in
m/s, force in N, payload in kg (only while the carriage stands in a station), wind in m/s along the track, wind_z
upwards, wind_y to the left (in space); a wind lasts until the next one, and so does a
temperature (degC, of all ropes). gust and operating_gust have _z, _y and
_duration (s). Events: emergency_stop, release, reset. A command can be given at a place instead of a time; its time,
by default 0, is then the earliest at which it can take effect:

  - {at: {name: cabin, position: 1200}, event: emergency_stop}
    in CSV in columns at_name,at_position

exit codes: 0 done, 1 the run failed, could not be recorded or refused a command, 2 wrong scenario, script or option,
130 ended by Ctrl-C before the run

examples:
  simulate aerial_tramway --script trip.yaml --duration 300
  simulate --from-bag cable_twin_logs/2026-01-31_09-30-00 \\
           --set carriages.cabin.drive.limits.emergency_deceleration=0.6    with a softer brake
  simulate --snapshot snapshot_60.000_s.npz --duration 30                  continue a run
  simulate chairlift --duration 30 --record off --json - \\
           | jq '.runs[0].key_figures[] | select(.kept == false)'
  simulate gondola --set space=3 --sweep wind.y=0:30:2.5 --plot wind.png   limit of side wind
  simulate --list                                                          the scenarios, a line each
  simulate --explain cable.damping_time                                    meaning of a key
"""


@dataclass(frozen=True, slots=True)
class Sweep:
    """Sweep of a scenario's key: its dotted name and all values."""

    key: str
    values: tuple[float, ...]


def parser() -> OneLineParser:
    """Parser of the options of `simulate`."""
    result = OneLineParser(
        "simulate",
        "Run a scenario without ROS, as fast as possible, and log it as `sim` does.",
        EPILOG,
        failure=UNUSABLE,
    )
    result.add_scenario(
        f"name of a shipped scenario, or path of a YAML file; default: the scenario of --from-bag, "
        f"else {DEFAULT_SCENARIO}",
        scenario_lines,
    )
    result.add_argument(
        "--explain",
        metavar="KEY",
        help="explain a key, or a section, of a scenario file (meaning, unit, default, range) and exit",
    )
    result.add_argument(
        "--snapshot",
        type=Path,
        metavar="FILE",
        help="continue from a state that the service ~/save_snapshot or Simulation.save wrote, with "
        "the scenario in it; "
        "simulated time continues from there, also for the times of a script",
    )
    add_changes(result)
    result.add_argument(
        "--duration",
        type=number(0.0, math.inf, "s"),
        metavar="S",
        help=f"simulated time to run; default: as long as the run in --from-bag, else until "
        f"{DURATION:g} s after the last command",
    )
    result.add_argument(
        "--sweep",
        type=sweep_of,
        metavar="KEY=START:STOP:STEP",
        help="run once for each value of one number of the scenario, on all cores and without logs, "
        "and report the range "
        "in which all limits are kept; more runs are added to find its ends. wind.y stands for air.wind.y; --csv and "
        "--json get the key figures of all runs",
    )
    result.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="with --sweep: plot the key figures that first do not keep their limits, as .png, .pdf or .svg",
    )
    source = result.add_mutually_exclusive_group()
    source.add_argument(
        "--script", type=Path, metavar="FILE", help="commands over time, a .yaml or .csv file as described below"
    )
    source.add_argument("--from-bag", type=Path, metavar="BAG", help="repeat the commands of a recorded run")
    _add_recording(result)
    result.add_argument(
        "--check",
        action="store_true",
        help="run a second time with elements and step half as long and contact points of saddles half as far apart "
        "(takes about four times as long) and print how much each key figure changes; a limit that lies within this "
        "change is 'not decided'",
    )
    add_export(result)
    return result


def _add_recording(result: OneLineParser) -> None:
    """Add the options of `simulate` on recording to a parser: formats, directory, rates, splitting and keeping."""
    result.add_argument(
        "--output",
        type=Path,
        default=Path("cable_twin_logs"),
        metavar="DIR",
        help="directory in which the run gets one of its own; default: cable_twin_logs",
    )
    result.add_argument(
        "--frame-rate",
        type=number(1.0, 1000.0, "Hz"),
        default=100.0,
        metavar="HZ",
        help="frames per second of simulated time, from which key figures and logs are taken; a frame is a whole "
        "number of solver steps: for another rate the nearest one is used, with a line that names it; default: 100",
    )
    for group, text in LOG_RATES.items():
        rate = LOGGED.get(group, EVERY_FRAME)
        result.add_argument(
            f"--log-{group.removesuffix('s')}-rate",
            dest=f"rate_{group}",
            type=number(0.0, 1000.0, "Hz", zero=True),  # whether it divides the frame rate is checked later
            metavar="HZ",
            help=f"rate at which {text} recorded; 0: every frame; default: {rate:g}",
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
        help="all: MCAP bag and rerun recording; bag: the MCAP bag only; off: nothing; default: all",
    )


def add_changes(result: OneLineParser) -> None:
    """Add the option `--set`, which changes values of the scenario, to a parser."""
    result.add_argument(
        "--set",
        action="append",
        default=[],
        type=_changed_value,
        metavar="KEY=VALUE",
        help="change a value of the scenario by its dotted key, as in cable.elements=48 or air.wind=[20, 0]; can be "
        "repeated",
    )


def plot_fault(path: Path | None) -> str:
    """Error line about a file of option `--plot` that cannot be drawn; empty for a valid file or None."""
    if path is not None and path.suffix.lower() not in DRAWN:
        return f"--plot: given {path}; allowed: a name that ends with {', '.join(DRAWN)}"
    return "" if path is None else plots_fault("--plot")


def plots_fault(option: str) -> str:
    """Error line about an option that needs matplotlib; empty where that is installed."""
    if find_spec("matplotlib") is not None:
        return ""
    return f"{option} needs matplotlib, which this Python does not have: {typed('pip')} install matplotlib"


def fact(text: str) -> tuple[str, Any]:
    """Parse KEY=VALUE of the option `--fact`, a fact in `limits.installation`.

    Raises:
        argparse.ArgumentTypeError: one line with the given and the allowed form.
    """
    key, value = _changed_value(text)
    if key not in Installation.model_fields:
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: {', '.join(Installation.model_fields)}")
    try:
        Installation.model_validate({key: value})
    except ValidationError:
        refused = refuse(("limits", "installation", key), value, allowed(Installation.model_fields[key]))
        raise argparse.ArgumentTypeError(f"{key}: {refused.text}") from None
    return key, value


def add_rule_options(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add the options `--profile` and `--fact`, by which rules judge runs, to a parser; `more` ends a help text."""
    parser.add_argument(
        "--profile",
        action="append",
        metavar="NAME",
        help="judge the key figures by this rule profile, a name that `rules` lists or a YAML file, in place of those "
        f"of the scenario; can be repeated{more}",
    )
    parser.add_argument(
        "--fact",
        action="append",
        default=[],
        type=fact,
        metavar="KEY=VALUE",
        help="state a fact that rules ask for, a key of limits.installation, as in persons=4; can be repeated",
    )


def profile_fault(profiles: Sequence[str] | None) -> str:
    """Error line about a rule profile of option `--profile` that cannot be read; empty where all can."""
    try:
        for name in profiles or ():
            load_profile(name)
    except RuleError as error:
        return f"--profile: {error}"
    return ""


def _changed_value(text: str) -> tuple[str, Any]:
    try:
        return assignment(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def rates_of(options: argparse.Namespace, frame_rate: float) -> tuple[dict[str, float], list[str]]:
    """Log rates (Hz) by group of topics, and an error line for each rate that does not divide the frame rate (Hz)."""
    given = {group: rate for group in LOG_RATES if (rate := getattr(options, f"rate_{group}")) is not None}
    faults = [rate_fault(f"--log-{group.removesuffix('s')}-rate", rate, frame_rate) for group, rate in given.items()]
    return {**LOGGED, **given}, [line for line in faults if line is not None]


def _limit(text: str) -> float:
    """Parse a number from an option whose range depends on other options and is checked later."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: a number") from None


def sweep_of(text: str) -> Sweep:
    """Parse KEY=START:STOP:STEP of the option `--sweep`; the values are integers where all three numbers are.

    Raises:
        argparse.ArgumentTypeError: one line with the given and the allowed values.
    """
    key, equals, span = text.partition("=")
    parts = span.split(":")
    if not equals or not key.strip() or len(parts) != 3:
        raise argparse.ArgumentTypeError(f"given {text!r}; {FORM}")
    try:
        start, stop, step = (_finite(part) for part in parts)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"given {text!r}, {error} is no finite number; {FORM}") from None
    if step == 0.0 or (stop - start) * step < 0.0:
        given = "0" if step == 0.0 else f"{step:g}, which leads away from {stop:g}"
        raise argparse.ArgumentTypeError(f"given {text!r}, a step of {given}; allowed: one from START towards STOP")
    count = math.floor((stop - start) / step + 1e-9) + 1
    if count > MOST_RUNS:
        raise argparse.ArgumentTypeError(f"given {text!r}, {count} runs; allowed: at most {MOST_RUNS}")
    values = (start + number * step for number in range(count))
    whole = all(isinstance(number, int) for number in (start, stop, step))
    return Sweep(full_key(key.strip()), tuple(value if whole else round(value, 12) for value in values))


def _finite(text: str) -> float:
    try:
        value = int(text)
    except ValueError:
        try:
            value = float(text)  # type: ignore[assignment]
        except ValueError:
            raise ValueError(repr(text)) from None
    if not math.isfinite(value):
        raise ValueError(repr(text))
    return value
