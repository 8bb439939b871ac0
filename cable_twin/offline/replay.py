"""Command `replay`: simulate a log again from its own scenario and commands, and compare every sample."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import signal
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from cable_twin.frame.records import AppliedCommand, CommandError
from cable_twin.frame.snapshot import Snapshot
from cable_twin.messages import (
    APPLIED_COMMANDS,
    DERAILMENTS,
    SECOND,
    FrameNames,
    MessageEncoder,
    decode,
    topics,
)
from cable_twin.offline.file_joint import Joint, join
from cable_twin.offline.replay_result import CommandStream, Comparison, Difference
from cable_twin.offline.scripted_run import start_of
from cable_twin.recording.log_file import LONGEST_GAP, UNREADABLE, LogFile
from cable_twin.recording.log_reader import Log, read_log
from cable_twin.recording.log_versions import LogError
from cable_twin.recording.log_writer import run_metadata
from cable_twin.scenario import ScenarioError
from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError, SolverError
from cable_twin.terminal.bars import compilation_shown
from cable_twin.terminal.command_line import OneLineParser, left_at_once, print_line, tell

AGREE, DIFFER, CANNOT = 0, 1, 2  # exit codes
ELSEWHERE = 1e-6  # tolerance for logs that another machine, numpy or numba made
MADE_BY = {  # what the bits of a result depend on: key of the metadata and how it is called
    "package_version": "cable_twin",
    "numba_version": "numba",
    "numpy_version": "numpy",
    "machine": "machine",
    "cpu": "CPU",
}
EPILOG = f"""\
On the machine that made a log, with the same versions, all samples agree to the last bit, and that is the default. A
log made elsewhere is compared to {ELSEWHERE:g}: two numbers a and b agree where |a - b| is at most the tolerance times
the largest of |a|, |b| and 1, each in its own unit.

exit codes: 0 every sample agrees, 1 some differ, 2 the log cannot be read or simulated, 130 ended by Ctrl-C

examples:
  replay cable_twin_logs/2026-01-31_09-30-00
  replay run.mcap --tolerance 1e-9
"""


def replay(log: Log, simulation: Simulation, *, tolerance: float = 0.0, progress: Progress | None = None) -> Comparison:
    """Simulate a log again and compare each message of the twin's motion with the logged one.

    All files are simulated in one go; to the last bit, the state attached to each of them is compared too. Where
    something is lost before a file, it goes on from that state.

    Args:
        log: what to replay.
        simulation: as it was when the run started, with as many samples of the cable (`start_of`).
        tolerance: greatest difference of two numbers that counts as agreement, relative to the greater of them where
            that is above 1; 0 compares to the last bit.
        progress: shows how far it is.

    Raises:
        LogError, CommandError, SolverError: it cannot be simulated to its end.
    """
    # carriers with topics of their own: those that were asked for, and all in logs of format 1
    layout = simulation.layout
    frames = FrameNames.of(log.metadata)
    encoder = MessageEncoder(layout, log.epoch_ns, own=layout.carriers, frames=frames)
    table = topics(layout, own=layout.carriers, tf=True)
    types = {topic.name: topic.type for topic in table if topic.group or topic.name == DERAILMENTS}
    waiting: deque[AppliedCommand] = deque()
    result = Comparison(end=simulation.time)
    task = progress.add_task("replay", total=log.size, simulated="0.0 s") if progress is not None else None
    position = 0

    def note_position(value: int) -> None:
        nonlocal position
        position = value

    def advance(time: float) -> Snapshot:
        if time - simulation.time > LONGEST_GAP:
            raise LogError(
                f"no frame from {simulation.time:g} s to {time:g} s; allowed: a gap of at most {LONGEST_GAP:g} s"
            )
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
            yield from file.messages([*types, APPLIED_COMMANDS], moved, whole=True)
            before = file

    stamp = -1
    snapshot = simulation.snapshot
    for topic, stamp_ns, data in stream():
        if topic == APPLIED_COMMANDS:
            waiting.append(log.command(stamp_ns, data))
            result.commands.add(waiting[-1])
            continue
        if stamp_ns != stamp:
            stamp = stamp_ns
            time = (stamp_ns - log.epoch_ns) / SECOND
            snapshot = advance(time)
            result.end = time
            if progress is not None and task is not None:
                progress.update(task, completed=position, simulated=f"{time:.1f} s")
        result.samples[topic] += 1
        ((_, replayed),) = encoder.frame(snapshot, [topic])
        if replayed == data:
            continue
        for difference in _differences(topic, types[topic], stamp_ns - log.epoch_ns, data, replayed):
            if isinstance(difference.logged, float) and isinstance(difference.replayed, float):
                scale = max(abs(difference.logged), abs(difference.replayed), 1.0)
                size = abs(difference.logged - difference.replayed) / scale
                result.largest = max(result.largest, size if math.isfinite(size) else math.inf)
                if size <= tolerance:
                    continue
            result.first = result.first or difference
            result.differing[topic] += 1
            break
    return result


def _differences(
    topic: str, message_type: str, time_ns: int, logged: bytes, replayed: bytes | None
) -> Iterator[Difference]:
    """Fields that differ between two messages, decoded."""
    time = time_ns / SECOND
    if replayed is None:
        yield Difference(time, topic, "message", "present", "absent")
        return
    try:
        message = decode(logged, message_type)
    except UNREADABLE as error:
        raise LogError(f"{topic} at {time:.6f} s is unreadable: {' '.join(str(error).split())}") from error
    pairs = zip(_leaves(message), _leaves(decode(replayed, message_type)), strict=False)
    for (place, a), (other_place, b) in pairs:
        if place != other_place:
            yield Difference(time, topic, "layout", place, other_place)
            return
        if a != b and not (isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b)):
            yield Difference(time, topic, place, a, b)


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """All plain values of a decoded message, with the path to each."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [item.name for item in dataclasses.fields(value)]
        if "point_step" in names:
            yield from _points(value)
            names.remove("data")
        for name in names:
            yield from _leaves(getattr(value, name), f"{place}.{name}" if place else name)
    elif isinstance(value, (list, tuple, np.ndarray)):
        yield f"{place}.length", len(value)
        for index, item in enumerate(value):
            yield from _leaves(item, f"{place}[{index}]")
    elif isinstance(value, np.generic):
        yield place, value.item()
    else:
        yield place, value


def _points(cloud: Any) -> Iterator[tuple[str, float]]:
    """Values of a PointCloud2 of float32 fields, with their names."""
    points = np.frombuffer(cloud.data, dtype="<f4").reshape(-1, cloud.point_step // 4)
    for (row, column), number in np.ndenumerate(points):
        yield f"point {row}, {cloud.fields[column].name}", float(number)


def origin(log: Log, commands: CommandStream) -> list[str]:
    """Lines about version, scenario and command stream of a log, and about differences of this machine."""
    here = run_metadata(scenario="", frame_period=0.0, sample_count=0)
    made = ", ".join(f"{name} {log.metadata.get(key, 'unknown')}" for key, name in MADE_BY.items())
    other = [f"{name} {here[key]}" for key, name in MADE_BY.items() if log.metadata.get(key) != here[key]]
    scenario = json.dumps(log.scenario, sort_keys=True).encode()
    return [
        f"made by: {made}, format {log.metadata['format_version']}",
        *([f"here:    {', '.join(other)}"] if other else []),
        f"scenario: {log.scenario.get('name')}, sha256 {sha256(scenario).hexdigest()[:12]}",
        *([f"starts from: a snapshot, sha256 {sha256(log.snapshot).hexdigest()[:12]}"] if log.snapshot else []),
        f"commands: {commands}",
    ]


def first_start(log: Log) -> tuple[Log, Simulation]:
    """Build the simulation of a log at its start, or at the start of the first file with an undamaged state.

    Returns:
        The log from that file on, and the simulation.

    Raises:
        SnapshotError: There is no such file.
        ScenarioError, EquilibriumError: It cannot be simulated.
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


def made_here(log: Log) -> bool:
    """Whether identical bits can be expected: equal versions, numba, numpy and kind of CPU."""
    here = run_metadata(scenario="", frame_period=0.0, sample_count=0)
    return all(log.metadata.get(key) == here[key] for key in MADE_BY)


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
    """Number of an option, zero or more."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value >= 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} given, a number of zero or more is needed")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Replay a log and report; 0 agree, 1 differ, 2 cannot read."""
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
            tolerance = 0.0 if made_here(log) else ELSEWHERE
        with left_at_once("replay"), compilation_shown(console, partial(print, file=sys.stderr, flush=True)):
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
        f"scenario {log.scenario.get('name')}, {result.end:.2f} s, {result.commands.kinds.total()} commands"
    )
    for line in (*origin(log, result.commands), *result.restarts):
        print_line(f"  {line}")
    for topic, count in sorted(result.samples.items()):
        print_line(f"  {topic:40} {count:8} samples, {result.differing[topic]:8} differ")
    if result.first is not None:
        print(f"first difference {result.first}")
        print(f"largest difference: {result.largest:.3g}; the tolerance is {tolerance:g}")
        return DIFFER
    if tolerance == 0.0:
        print("every sample agrees to the last bit")
    else:
        print(f"every sample agrees within the tolerance of {tolerance:g}; largest difference: {result.largest:.3g}")
    return AGREE


if __name__ == "__main__":
    sys.exit(main())
