"""Command `replay`: simulate a log again from its own scenario and commands, and compare every sample."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import signal
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from cable_twin.basics.units import counted
from cable_twin.frame.records import AppliedCommand, CommandError
from cable_twin.frame.snapshot import Snapshot
from cable_twin.messages import APPLIED_COMMANDS, CLOCK, SECOND, FrameNames, MessageEncoder
from cable_twin.messages.columns import COLUMNS, Row, RowDecoder
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.offline.scripted_run import start_of
from cable_twin.recording.log_file import UNREADABLE, LogError, LogFile, check_gap, one_line
from cable_twin.recording.log_reader import Log, read_log
from cable_twin.recording.log_writer import program_metadata
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.scenario import ScenarioError
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError, SolverError
from cable_twin.simulation.snapshot_file import FullState, read_full_state
from cable_twin.terminal.bars import start_shown
from cable_twin.terminal.command_line import OneLineParser, print_line, tell

AGREE, DIFFER, CANNOT = 0, 1, 2  # exit codes
ELSEWHERE = 1e-6  # tolerance for logs that another machine, numpy or numba made
MADE_BY = {  # what the bits of a result depend on: key of the metadata and how it is called
    "package_version": "cable_twin",
    "numba_version": "numba",
    "numpy_version": "numpy",
    "machine": "machine",
    "cpu": "CPU",
    "arithmetic": "arithmetic",
}
GROWS = "rounding grows where parts touch or slip and in what is estimated, for which a larger --tolerance allows"
EPILOG = f"""\
Where versions, target and arithmetic are those that made a log, as on another machine of the kind, all samples agree to
the last bit, and that is the default. Any other log is compared to {ELSEWHERE:g}: two numbers a and b agree where
|a - b| is at most the tolerance times the largest of |a|, |b| and 1, each in its own unit.

exit codes: 0 every sample agrees, 1 some differ, 2 the log cannot be read or simulated, 130 ended by Ctrl-C

examples:
  replay cable_twin_logs/2026-01-31_09-30-00
  replay run.mcap --tolerance 1e-9
"""


@dataclass(slots=True)
class Difference:
    """Difference between log and replay in one sample: time, topic, place in the message, both values."""

    time: float  # s
    topic: str
    place: str
    logged: Any
    replayed: Any

    def __str__(self) -> str:
        return f"at {self.time:.6f} s on {self.topic}, {self.place}: logged {self.logged!r}, replayed {self.replayed!r}"


@dataclass(slots=True)
class CommandStream:
    """Commands of a log, counted by kind and source, with a checksum of all."""

    kinds: Counter[str] = field(default_factory=Counter)
    sources: Counter[str] = field(default_factory=Counter)
    digest: Any = field(default_factory=sha256)

    def add(self, applied: AppliedCommand) -> None:
        """Add one command of a log to counts and checksum."""
        self.kinds[applied.command.kind] += 1
        self.sources[applied.source] += 1
        self.digest.update(applied_command_message(applied, 0))

    def __str__(self) -> str:
        sources = f" from {_counted(self.sources)}" if self.sources else ""
        return f"{_counted(self.kinds)}{sources}, sha256 {self.digest.hexdigest()[:12]}"


@dataclass(slots=True)
class Comparison:
    """Result of the comparison of a replay with its log: counts of samples by topic, largest difference, restarts."""

    samples: Counter[str] = field(default_factory=Counter)
    differing: Counter[str] = field(default_factory=Counter)
    first: Difference | None = None
    largest: float = 0.0  # largest difference of two numbers, relative above 1
    commands: CommandStream = field(default_factory=CommandStream)
    restarts: list[str] = field(default_factory=list)  # files simulated from their attached state, a line each
    end: float = 0.0  # s, of the last compared sample
    tolerance: float = 0.0  # largest difference that counts as equal

    def differ(self, difference: Difference) -> None:
        """Count a sample that differs between log and replay."""
        self.first = self.first or difference
        self.differing[difference.topic] += 1


def _counted(counts: Counter[Any]) -> str:
    """Text of counted words, such as "3 wind, 1 reset"."""
    return ", ".join(f"{count} {word}" for word, count in counts.items()) or "none"


class Joint(Enum):
    """Transition of a replay to the next log file: continue, restart from its attached state, or skip the file."""

    GOES_ON = auto()
    FROM_ITS_STATE = auto()
    LEFT_OUT = auto()


def join(
    before: LogFile,
    file: LogFile,
    simulation: Simulation,
    advance: Callable[[float], Snapshot],
    result: Comparison,
    *,
    exactly: bool,
) -> Joint:
    """Continue a replay in the next file of a log: compare its attached state with the present one, or adopt it.

    A damaged state is reported; where it is needed, the file is left out.

    Args:
        before: Last read file.
        file: Next file.
        simulation: At the end of the file before.
        advance: Advances the simulation to a time (s), with the commands until then.
        result: Takes differences of the states, and lines about an adopted or damaged state.
        exactly: Whether the states are compared to the last bit, or not at all.

    Returns:
        Whether the simulation goes on without a break, or from the state of the file, or leaves the file out.
    """
    whole, name = file.follows(before), f"{file.path.name}: {SNAPSHOT_NAME}"
    try:
        full = read_full_state(BytesIO(file.snapshot() or b""), name)
        if not whole:
            simulation.restore(full)
    except SnapshotError as error:
        if not whole:
            result.restarts.append(
                f"{file.path.name}: left out, because the data before it is lost and "
                f"its own state cannot be used: {error}"
            )
            return Joint.LEFT_OUT
        if exactly:
            result.restarts.append(f"{error}; its state is not compared")
        return Joint.GOES_ON  # of another version, or damaged, and not needed
    if not whole:
        result.end = full.time
        result.restarts.append(
            f"{file.path.name}: data before {full.time:.2f} s is lost; the replay continues from the state "
            "at the start of this file"
        )
        return Joint.FROM_ITS_STATE
    if exactly:
        advance(full.time)
        result.samples[SNAPSHOT_NAME] += 1
        difference = next(_state_differences(full, simulation.capture()), None)
        if difference is not None:
            result.differ(difference)
    return Joint.GOES_ON


def _state_differences(logged: FullState, replayed: FullState) -> Iterator[Difference]:
    """Bitwise differences of the full states of a log and its replay."""
    for part in ("state", "start"):
        others = replayed.arrays(part)
        for name, array in logged.arrays(part).items():
            other = others[name]
            if array.tobytes() != other.tobytes():
                same = np.array([a.tobytes() == b.tobytes() for a, b in zip(array.flat, other.flat, strict=True)])
                place = int(np.argmin(same))
                values = array.flat[place].item(), other.flat[place].item()
                yield Difference(logged.time, SNAPSHOT_NAME, f"{part}/{name}[{place}]", *values)
    if (logged.emergency_stopped, logged.commands) != (replayed.emergency_stopped, replayed.commands):
        yield Difference(logged.time, SNAPSHOT_NAME, "commands in force", logged.commands, replayed.commands)


def replay(log: Log, simulation: Simulation, *, tolerance: float = 0.0, progress: Progress | None = None) -> Comparison:
    """Simulate a log again and compare all values of each frame with the logged ones.

    With tolerance 0, all other messages of a frame and the state attached to each file are compared, too. All files
    are simulated in one go; where data is lost before a file, the simulation goes on from the state attached to it.

    Args:
        log: log to replay.
        simulation: at the start of the run, with as many samples of the cable as the log (`start_of`).
        tolerance: greatest difference of two numbers that counts as agreement, relative to the greater of them where
            that is above 1; 0 compares to the last bit.
        progress: progress bar of the replay, or None.

    Raises:
        LogError, CommandError, SolverError: the log cannot be simulated to its end.
    """
    layout = simulation.layout  # any carrier may have topics of its own
    encoder = MessageEncoder(layout, log.epoch_ns, own=layout.carriers, frames=FrameNames.of(log.metadata))
    decoder = log.row_decoder(layout)
    exact = [topic for topic in encoder.topics if topic != CLOCK] if tolerance == 0.0 else []
    waiting: deque[AppliedCommand] = deque()
    result = Comparison(end=simulation.time, tolerance=tolerance)
    task = progress.add_task("replay", total=log.size, simulated="0.0 s") if progress is not None else None
    position = 0

    def note_position(value: int) -> None:
        nonlocal position
        position = value

    def advance(time: float) -> Snapshot:
        check_gap(simulation.time, time)
        while waiting and waiting[0].time < time:
            simulation.advance_to(max(waiting[0].time, simulation.time))  # what is damaged may go back
            simulation.apply(waiting.popleft().command, "replay")
        return simulation.advance_to(max(time, simulation.time))

    def stream() -> Iterator[tuple[str, int, bytes]]:
        before: LogFile | None = None
        for file, moved in log.files_in_turn(note_position):
            if before is not None:
                how = join(before, file, simulation, advance, result, exactly=tolerance == 0.0)
                if how is Joint.LEFT_OUT:
                    continue
                if how is Joint.FROM_ITS_STATE:
                    waiting.clear()
            yield from file.messages([COLUMNS, APPLIED_COMMANDS, *exact], moved, whole=True)
            before = file

    stamp = -1
    snapshot = simulation.snapshot
    for topic, stamp_ns, data in stream():
        if topic == APPLIED_COMMANDS:
            waiting.append(log.command(stamp_ns, data))
            result.commands.add(waiting[-1])
            continue
        if stamp_ns != stamp:
            stamp, time = stamp_ns, (stamp_ns - log.epoch_ns) / SECOND
            snapshot = advance(time)
            result.end = time
            if progress is not None and task is not None:
                progress.update(task, completed=position, simulated=f"{time:.1f} s")
        result.samples[topic] += 1
        if topic == COLUMNS:
            try:
                row = decoder.decode(data)
            except UNREADABLE as error:
                raise LogError(f"{COLUMNS} at {result.end:.6f} s is unreadable: {one_line(error)}") from error
            _compare_columns(result, row, snapshot, decoder)
            continue
        ((_, replayed),) = encoder.frame(snapshot, [topic])
        if replayed != data:
            result.differ(Difference(result.end, topic, "message", _digest(data), _digest(replayed)))
    return result


def _compare_columns(result: Comparison, row: Row, snapshot: Snapshot, decoder: RowDecoder) -> None:
    """Compare the values of a logged frame with those of the replayed snapshot; differences go to the result."""
    logged, replayed = row.numbers[row.places], snapshot.numbers[row.places]
    differs = ~((logged == replayed) | (np.isnan(logged) & np.isnan(replayed)))
    if not differs.any():
        return
    with np.errstate(invalid="ignore"):
        sizes = np.abs(logged - replayed) / np.maximum(np.maximum(np.abs(logged), np.abs(replayed)), 1.0)
    sizes[~np.isfinite(sizes)] = math.inf
    result.largest = max(result.largest, float(sizes[differs].max()))
    for first in np.flatnonzero(differs & (sizes > result.tolerance))[:1]:
        place, values = decoder.name(int(row.places[first])), (logged[first].item(), replayed[first].item())
        result.differ(Difference(result.end, COLUMNS, place, *values))


def _digest(data: bytes) -> str:
    return f"sha256 {sha256(data).hexdigest()[:12]}"


def origin(log: Log, commands: CommandStream) -> list[str]:
    """Lines about versions, scenario and commands of a log, and about versions that differ on this machine."""
    here = program_metadata()
    made = ", ".join(f"{name} {log.metadata.get(key, 'unknown')}" for key, name in MADE_BY.items())
    other = [f"{name} {here[key]}" for key, name in MADE_BY.items() if name in made_by_other(log)]
    scenario = json.dumps(log.scenario, sort_keys=True).encode()
    return [
        f"made by: {made}, format {log.metadata['format_version']}",
        *([f"here:    {', '.join(other)}"] if other else []),
        f"scenario: {log.scenario.get('name')}, sha256 {sha256(scenario).hexdigest()[:12]}",
        *([f"starts from: a snapshot, sha256 {sha256(log.snapshot).hexdigest()[:12]}"] if log.snapshot else []),
        f"commands: {commands}",
    ]


def first_start(log: Log) -> tuple[Log, Simulation]:
    """Build the simulation of a log at its start, or at the start of its first file with an undamaged state.

    Returns:
        The log from that file on, and the simulation.

    Raises:
        SnapshotError: No file has an undamaged state.
        ScenarioError, EquilibriumError: The scenario cannot be simulated.
    """
    first = log
    while True:
        try:
            return log, start_of(log, samples=int(log.metadata["sample_count"]))
        except SnapshotError as error:  # noqa: PERF203 - of each file
            if len(log.files) == 1:
                raise
            lost = str(error).replace(str(log.path), log.files[0].path.name)
            log = dataclasses.replace(first, files=log.files[1:], lost=(*log.lost, lost))


def made_by_other(log: Log) -> list[str]:
    """Names of what keeps a replay here from being bit-identical to its log: other versions, machine or arithmetic."""
    here = program_metadata()
    return [name for key, name in MADE_BY.items() if log.metadata.get(key) != here[key]]


def parser() -> OneLineParser:
    """Parser of the options of `replay`."""
    result = OneLineParser(
        "replay",
        "Simulate a log again from its own scenario and commands, and compare every sample.",
        EPILOG,
        failure=CANNOT,
    )
    result.add_argument("log", type=Path, help="directory of a run, or one of its .mcap files")
    result.add_argument(
        "--tolerance",
        type=_tolerance,
        metavar="NUMBER",
        help=f"largest relative difference that counts as equal (see below); default: 0 for a log "
        f"made here, else {ELSEWHERE:g}",
    )
    return result


def _tolerance(text: str) -> float:
    """Parse the option `--tolerance`: a number, zero or more."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value >= 0.0:
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: a number of zero or more")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Replay a log and report differences; returns exit code 0 all samples agree, 1 some differ, 2 cannot read."""
    if argv is None:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `replay BAG | head` ends without a word
    options = parser().parse_args(sys.argv[1:] if argv is None else list(argv))
    console = Console(stderr=True)
    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[simulated]}"), TimeRemainingColumn())
    try:
        log = read_log(options.log)
        # a file gets nothing of it, not even the empty line in the end
        visible = console.is_terminal
        tolerance = options.tolerance
        if tolerance is None:
            tolerance = ELSEWHERE if made_by_other(log) else 0.0
        with start_shown("replay", console):
            log, simulation = first_start(log)
        with Progress(TextColumn("replay"), *columns, console=console, transient=True, disable=not visible) as progress:
            result = replay(log, simulation, tolerance=tolerance, progress=progress)
    except (LogError, ScenarioError, EquilibriumError, SnapshotError, CommandError, SolverError) as error:
        for line in str(error).splitlines():
            named = line if line.startswith(str(options.log)) else f"{options.log}: {line}"
            tell("replay", named)
        return CANNOT
    if not result.samples:
        tell("replay", f"{log.path}: it contains no frame of the twin")
        return CANNOT
    print_line(
        f"{log.path}: {log.condition}, cable_twin {log.metadata.get('package_version')}, "
        f"scenario {log.scenario.get('name')}, {result.end:.2f} s, {counted(result.commands.kinds.total(), 'command')}"
    )
    for line in (*origin(log, result.commands), *result.restarts):
        print_line(f"  {line}")
    for topic, count in sorted(result.samples.items()):
        print_line(f"  {topic:40} {count:8} samples, {result.differing[topic]:8} differ")
    if result.first is not None:
        print(f"first difference {result.first}")
        print(f"largest difference: {result.largest:.3g}; the tolerance is {tolerance:g}")
        if other := made_by_other(log):
            print(f"it was made with another {', '.join(other)}: {GROWS}")
        return DIFFER
    if tolerance == 0.0:
        print("every sample agrees to the last bit")
    else:
        print(f"every sample agrees within the tolerance of {tolerance:g}; largest difference: {result.largest:.3g}")
    return AGREE


if __name__ == "__main__":
    sys.exit(main())
