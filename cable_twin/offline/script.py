"""Scripts: commands over time for a run, from a YAML or CSV file, or from the log of a run.

Test signals for the identification of a drive, step and chirp, are sequences of commands. Both are added to the
speed or force of their entry, which holds again afterwards. A step lasts for its duration. A chirp is a sine of given
amplitude whose frequency goes from `from` to `to` by equal factors in equal times,

    f(t) = f_0 k^(t / T),  k = f_1 / f_0,  phase(t) = 2 pi f_0 T (k^(t / T) - 1) / ln k,

held from command to command, 20 of them in the shortest period.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from cable_twin.basics.limited_yaml import LARGEST, UnreadableYamlError, limited_text, read_yaml
from cable_twin.basics.separated import separator_of, with_point
from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.recording.log_reader import Log
from cable_twin.scenario import Scenario
from cable_twin.scenario.checks.fault import show
from cable_twin.simulation.command_handlers import check_ahead

BY_NAME = {name: kind for name, kind in KINDS.items() if kind.quantity and not kind.axes}  # numbers by name
BY_AXIS = {name: kind for name, kind in KINDS.items() if kind.axes}
EVENTS = {name: kind for name, kind in KINDS.items() if not kind.quantity}  # no numbers
NUMBERS = [key for kind in (*BY_NAME.values(), *BY_AXIS.values()) for key in kind.keys.values()]

STOPPED_BY = {"emergency_stop": True, "release": False, "reset": False}  # kinds after which drives are stopped, or not
Row = Mapping[str, Any]
LARGEST_CSV = 64 * 2**20  # bytes
AT = ("at_name", "at_position")  # columns of CSV for `at`
SHAPES = ("step", "chirp")  # of test signals
SIGNAL_KEYS = (*SHAPES, "duration", "from", "to")
SAMPLES = 20  # commands in the shortest period of a chirp
HIGHEST = 10.0  # Hz
MOST = 100_000  # commands of one chirp
KEYS = ("time", "at", "name", *NUMBERS, "event", *SIGNAL_KEYS)
ALLOWED = f"allowed: time (s) and either name with {', '.join(BY_NAME)}, or {', '.join(BY_AXIS)}, or event; or at"


PLACE_ALLOWED = "allowed: {name: VEHICLE or DRIVE, position: m along the cable}"
SIGNAL_ALLOWED = (
    "allowed with a time, a name and a speed or force: step and duration (s), or chirp, duration (s), from and to "
    "(Hz); step and chirp have the unit of the speed or force"
)


class ScriptError(ValueError):
    """Errors in a script of commands, one line each, with file and line."""


class Place(NamedTuple):
    """Place that triggers a scripted command when a vehicle's joint, or a drive's cable, passes it in any direction."""

    name: str
    position: float  # m, arc length for a vehicle, cable travel for a drive


@dataclass(frozen=True, slots=True)
class ScriptedCommand:
    """Command of a script with its time, or the place that triggers it."""

    time: float  # s, simulated
    command: Command
    source: str  # for the log, such as "script" or "joint_commands"
    place: str  # for messages: file and line
    at: Place | None = None  # condition besides the time: a passed place


def read_script(file: Path, scenario: Scenario | None = None) -> list[ScriptedCommand]:
    """Read a script of commands from a file; commands of equal time stay in the order of the file.

    Args:
        file: YAML (a list of mappings) or CSV (a header and a line a command), by its suffix.
        scenario: scenario of the run, to find commands that it refuses; None to skip this check.

    Raises:
        ScriptError: all faults, one line each: file, line, given value, allowed values, unit.
    """
    suffix = file.suffix.lower()
    if suffix not in (".yaml", ".yml", ".csv"):
        raise ScriptError(f"{file}: suffix: given {suffix!r}; allowed: .yaml, .yml or .csv")
    try:
        text = limited_text(file, LARGEST_CSV if suffix == ".csv" else LARGEST)
    except UnreadableYamlError as error:
        raise ScriptError(f"{file}: {error}") from None
    except UnicodeDecodeError as error:
        raise ScriptError(f"{file}: not a text in UTF-8 (byte {error.start}); allowed: YAML or CSV in UTF-8") from None
    except OSError as error:
        raise ScriptError(f"{file}: {error.strerror}") from None
    rows = _csv_rows(file, text) if suffix == ".csv" else _yaml_rows(file, text)
    commands: list[ScriptedCommand] = []
    faults: list[tuple[int, str]] = []  # with their lines
    lines: dict[str, int] = {}
    for line, row in rows:
        lines[place := f"{file}:{line}"] = line
        try:
            commands += _commands(row, place)
        except ScriptError as error:
            faults.append((line, str(error)))
    commands.sort(key=lambda item: item.time)
    if scenario is not None:
        faults += [(lines[place], fault) for place, fault in _refused(scenario, commands, stopped=False).items()]
    if faults:
        raise ScriptError("\n".join(fault for _, fault in sorted(faults)))
    return commands


def script_of_log(log: Log) -> list[ScriptedCommand]:
    """Commands of a recorded run, in the order of their effect.

    Raises:
        LogError: The log is damaged.
    """
    return [
        ScriptedCommand(applied.time, applied.command, applied.source, f"{log.path}: command at {applied.time:.3f} s")
        for applied in log.commands
    ]


def commands_ahead(script: Iterable[ScriptedCommand], time: float, step: float) -> list[ScriptedCommand]:
    """Commands of a script at or after a time (s), in whole solver steps (s), and all commands triggered by a place."""
    first = round(time / step)  # solver steps that are done
    return [item for item in script if item.at is not None or round(item.time / step) >= first]


def check_script(scenario: Scenario, script: Iterable[ScriptedCommand], *, stopped: bool = False) -> list[str]:
    """Find scripted commands that a scenario refuses in any state: names, limits, places, emergency stops.

    Args:
        scenario: scenario of the run.
        script: commands.
        stopped: whether the run begins in an emergency stop.

    Returns:
        A line for each entry that would be refused; for a step or chirp about its first refused command.
    """
    return [*_refused(scenario, script, stopped=stopped).values()]


def _refused(scenario: Scenario, script: Iterable[ScriptedCommand], *, stopped: bool) -> dict[str, str]:
    """Error lines about scripted commands that a scenario refuses, by file and line of the commands."""
    faults: dict[str, str] = {}
    at_start = stopped
    for item in sorted(script, key=lambda item: item.at is not None):
        try:
            if item.at is not None:  # whatever has been given till then
                stopped = at_start
                check_place(item.at, scenario)
            check_ahead(scenario, item.command, stopped=stopped)  # where a carriage is then, only the run can tell
        except CommandError as error:  # noqa: PERF203 - every fault is reported
            faults.setdefault(item.place, f"{item.place}: {error}")
        else:
            stopped = STOPPED_BY.get(item.command.kind, stopped)
    return faults


def _csv_rows(file: Path, text: str) -> Iterator[tuple[int, Row | str]]:
    """Line number and values, or an error text, of each CSV row of a script, without empty cells and # comments."""
    lines = text.splitlines()
    separator = separator_of(next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), ""))
    reader = csv.reader(lines, delimiter=separator)
    header: list[str] = []
    for line in _readable(reader, file):
        cells = [cell.strip() for cell in line]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not header:
            header = cells
            if "time" not in header:
                raise ScriptError(
                    f"{file}:{reader.line_num}: header: given {','.join(header)!r}; allowed: one with a column time"
                )
            if len(set(header)) < len(header):
                raise ScriptError(
                    f"{file}:{reader.line_num}: header: given {','.join(header)!r}; allowed: each key once"
                )
            continue
        if len(cells) > len(header):
            yield reader.line_num, f"cells: given {len(cells)}; allowed: {len(header)}, as in the header"
            continue
        named = zip(header, cells, strict=False)
        row: dict[str, Any] = {key: _number(cell, separator) for key, cell in named if cell}
        if at := {key.removeprefix("at_"): row.pop(key) for key in AT if key in row}:
            row["at"] = at
        yield reader.line_num, row


def _readable(reader: Any, file: Path) -> Iterator[list[str]]:
    try:
        yield from reader
    except csv.Error as error:
        raise ScriptError(f"{file}:{reader.line_num}: not CSV ({error})") from None


def _number(cell: str, separator: str) -> float | str:
    try:
        return float(with_point(cell, separator))
    except ValueError:
        return cell


def _yaml_rows(file: Path, text: str) -> Iterator[tuple[int, Row | str]]:
    """Line number and mapping, or an error text, of each item of a YAML script."""
    try:
        content, node, doubles = read_yaml(text)
    except UnreadableYamlError as error:
        raise ScriptError(f"{file}{error.where}: {error}") from None
    if doubles:
        lines = (f"{file}:{one.second}: given {one.path[-1]} twice, first on line {one.first}" for one in doubles)
        raise ScriptError("\n".join(f"{line}; allowed: once" for line in lines))
    if content is None:
        return
    if not isinstance(content, list) or node is None:
        raise ScriptError(f"{file}:1: given {show(content)}; allowed: a list of commands, '- {{time: 1, ...}}'")
    for item, place in zip(content, node.value, strict=True):
        yield place.start_mark.line + 1, item if isinstance(item, Mapping) else f"given {item!r}; {ALLOWED}"


def _commands(row: Row | str, place: str) -> list[ScriptedCommand]:
    """Commands of one row of a script: a single one, or the sequence of a step or chirp."""
    if isinstance(row, str):
        raise ScriptError(f"{place}: {row}")
    if unknown := [str(key) for key in row if key not in KEYS]:
        raise ScriptError(f"{place}: given unknown key {', '.join(unknown)}; {ALLOWED}")
    if "time" not in row and "at" not in row:
        raise ScriptError(f"{place}: time: given none; allowed: zero or more, in s")
    time = row.get("time", 0.0)
    if not _is_finite(time) or time < 0.0:
        raise ScriptError(f"{place}: time: given {time!r}; allowed: zero or more, in s")
    at = _place(row["at"], place) if "at" in row else None
    command = _command(row, place)
    if not any(key in row for key in SIGNAL_KEYS):
        return [ScriptedCommand(float(time), command, "script", place, at)]
    if not KINDS[command.kind].drives:
        raise ScriptError(
            f"{place}: given {command.kind} with {', '.join(k for k in SIGNAL_KEYS if k in row)}; {ALLOWED}"
        )
    ((name, base),) = command.values.items()
    return [
        ScriptedCommand(float(time) + later, Command(command.kind, {name: value}), "script", place)
        for later, value in _signal(row, base, KINDS[command.kind].unit, place)
    ]


def _place(given: Any, place: str) -> Place:
    """Parse the value of the key `at` in a script, the place that triggers a command."""
    if not isinstance(given, dict) or set(given) != {"name", "position"} or not isinstance(given["name"], str):
        raise ScriptError(f"{place}: at: given {dict(given) if isinstance(given, dict) else given!r}; {PLACE_ALLOWED}")
    return Place(given["name"], _finite(given["position"], "at position", "m", place))


def check_place(place: Place, scenario: Scenario) -> None:
    """Refuse a scripted place that no vehicle or drive can pass.

    Raises:
        CommandError: there is no such vehicle or drive, or its cable does not reach there.
    """
    length = scenario.cable.unstrained_length
    if place.name in scenario.drives:
        return
    if place.name not in scenario.vehicles:
        known = ", ".join([*scenario.drives, *scenario.vehicles]) or "none in this scenario"
        raise CommandError(f"at: given name '{place.name}'; allowed: {known}")
    if not 0.0 <= place.position <= length:
        raise CommandError(
            f"at: given {place.position:g} m of '{place.name}'; allowed: 0 to {length:g} m, on the cable"
        )


def _signal(row: Mapping[str, Any], base: float, unit: str, place: str) -> list[tuple[float, float]]:
    """Times (s, from the entry on) and values of a scripted step or chirp on a base value, ending with the base."""
    shapes = [shape for shape in SHAPES if shape in row]
    given = {key for key in SIGNAL_KEYS if key in row}
    needed = {"step", "duration"} if "step" in row else {*SIGNAL_KEYS} - {"step"}
    if "at" in row or len(shapes) != 1 or given != needed:
        found = ", ".join(f"{key} {row[key]!r}" for key in ("at", *SIGNAL_KEYS) if key in row)
        raise ScriptError(f"{place}: given {found}; {SIGNAL_ALLOWED}")
    height, duration = _finite(row[shapes[0]], shapes[0], unit, place), _finite(row["duration"], "duration", "s", place)
    if duration <= 0.0:
        raise ScriptError(f"{place}: duration: given {duration:g} s; allowed: more than 0 s")
    if "step" in row:
        return [(0.0, base), (0.0, base + height), (duration, base)]
    first, last = _finite(row["from"], "from", "Hz", place), _finite(row["to"], "to", "Hz", place)
    for key, frequency in (("from", first), ("to", last)):
        if not 0.0 < frequency <= HIGHEST:
            raise ScriptError(f"{place}: {key}: given {frequency:g} Hz; allowed: more than 0, up to {HIGHEST:g} Hz")
    count = math.ceil(duration * SAMPLES * max(first, last))
    if count > MOST:
        allowed = f"{MOST}, {SAMPLES} in the shortest period"
        raise ScriptError(f"{place}: chirp: given {count} commands; allowed: {allowed}")
    times = [duration * number / count for number in range(count)]
    values = [base + height * math.sin(_phase(time, duration, first, last)) for time in times]
    return [*zip(times, values, strict=True), (duration, base)]


def _phase(time: float, duration: float, first: float, last: float) -> float:
    """Phase (rad) at a time (s) of a chirp of `duration` (s) from frequency `first` (Hz) to `last` (Hz)."""
    growth = math.log(last / first)
    if abs(growth) < 1e-9:
        return 2.0 * math.pi * first * time
    return 2.0 * math.pi * first * duration * math.expm1(growth * time / duration) / growth


def _command(row: Mapping[str, Any], place: str) -> Command:
    """Command of a row of a script: an event, values by axis, or the value for a named object."""
    given = [key for key in NUMBERS if key in row]
    if "event" in row:
        event = str(row["event"])
        if given or "name" in row or event not in EVENTS:
            found = f"event {row['event']!r}" + "".join(f" with {key}" for key in ("name", *given) if key in row)
            raise ScriptError(f"{place}: given {found}; allowed: exactly one of {', '.join(EVENTS)}")
        return Command(event, {})
    if "name" not in row:
        for name, kind in BY_AXIS.items():
            if name in row and set(given) <= set(kind.keys.values()):
                speeds = kind.by_axis(
                    {
                        axis: _finite(row[key], key, kind.unit_of(axis), place)
                        for axis, key in kind.keys.items()
                        if key in row
                    }
                )
                return Command(name, speeds)
    if len(given) != 1 or given[0] not in BY_NAME or not isinstance(row.get("name"), str):
        found = ", ".join(f"{key} {row[key]!r}" for key in ("name", *given) if key in row) or "only a time"
        raise ScriptError(f"{place}: given {found}; {ALLOWED}")
    kind = BY_NAME[given[0]]
    return Command(kind.name, {row["name"]: _finite(row[kind.name], kind.name, kind.unit, place)})


def _finite(value: Any, key: str, unit: str, place: str) -> float:
    if not _is_finite(value):
        raise ScriptError(f"{place}: {key}: given {value!r}; allowed: a finite number, in {unit}")
    return float(value)


def _is_finite(value: Any) -> bool:
    # math.isfinite fails for a whole number of four hundred digits
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
