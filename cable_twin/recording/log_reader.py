"""Reader of a log of `log_writer`: one file or all of a run, complete, cut short by a kill, or damaged.

A log holds each group of columns at its own rate; numbers that it does not hold at a time are NaN in the snapshot of
that time. All others are those of the run, bit for bit, but for the shape and tension of the rope: between complete
frames, usually one a second, these come from the topic `cable`, in single precision.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

from cable_twin.frame.records import AppliedCommand, RefusedCommand
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.messages import (
    APPLIED_COMMANDS,
    CABLE,
    KEY_FIGURES,
    REFUSED_COMMANDS,
    SCENARIO,
    SECOND,
    Status,
    read_rope,
    refused_command_from_message,
    scenario_from_message,
    statuses_of_message,
)
from cable_twin.messages.columns import COLUMNS, Row, RowDecoder
from cable_twin.messages.command_messages import applied_command_from_message
from cable_twin.recording.log_file import UNREADABLE, LogError, LogFile, file_number, one_line, open_file, open_foreign
from cable_twin.scenario import ScenarioError, load_scenario

STAMPS_APART = 1e-3  # s that a command may lie from the stamp of its message: they are one, but for rounding


@dataclass(frozen=True)
class Log:
    """Log of a run to read, complete or cut short; files are opened anew for every pass over messages."""

    path: Path  # .mcap file, or directory of several
    files: tuple[LogFile, ...]  # readable files in order
    scenario: Mapping[str, Any]
    lost: tuple[str, ...] = field(default=(), compare=False)  # unreadable files, a line each

    @property
    def source(self) -> Path:
        """Path from which copies get their names: directory of the run, or one of several files, without suffix."""
        path = self.path.resolve()
        if path.is_dir():
            return path
        parent = path.parent
        alone = (parent / "metadata.yaml").exists() and len(list(parent.glob("*.mcap"))) == 1
        return parent if alone else path.with_suffix("")

    @property
    def metadata(self) -> Mapping[str, str]:
        """Metadata of the log about the origin of its run, from its first file."""
        return self.files[0].metadata

    @property
    def epoch_ns(self) -> int:
        """Wall time (ns since 1970) of simulated time zero."""
        return self.files[0].epoch_ns

    @cached_property
    def snapshot(self) -> bytes | None:
        """Full state from which the log starts; None where it starts from the start of its scenario."""
        return self.files[0].snapshot()

    @cached_property
    def topics(self) -> frozenset[str]:
        """Topics that the files of the log declare, by names as of `messages`."""
        return frozenset().union(*(file.topics for file in self.files))

    @property
    def complete(self) -> bool:
        """Whether every file of the log was closed; else the process was killed, or data is lost."""
        return not self.lost and all(file.complete for file in self.files)

    @property
    def damage(self) -> list[str]:
        """Lines about data of the log that cannot be read, as far as read; a last file cut short is no damage."""
        several = len(self.files) + len(self.lost) > 1
        named = "{0.path.name}: {1}".format if several else "{1}".format
        damage = [named(file, line) for file in self.files for line in file.damage]
        damage += [f"{file.path.name}: cut short" for file in self.files[:-1] if not file.complete]
        return [*damage, *self.lost]

    @cached_property
    def commands(self) -> list[AppliedCommand]:
        """All applied commands of the log in the order of their effect, found by the index or else in one pass."""
        return [self.command(stamp_ns, data) for _, stamp_ns, data in self.messages([APPLIED_COMMANDS])]

    def command(self, stamp_ns: int, data: bytes) -> AppliedCommand:
        """Decode a message of topic applied_commands of the log; raises LogError where unreadable."""
        when = (stamp_ns - self.epoch_ns) / SECOND
        try:
            applied = applied_command_from_message(data, self.epoch_ns)
            if abs(applied.time - when) > STAMPS_APART:
                raise ValueError(f"its message gives {applied.time:.6f} s as its time")
        except UNREADABLE as error:
            raise LogError(f"{self.path}: command at {when:.6f} s is unreadable: {one_line(error)}") from error
        return applied

    @cached_property
    def end(self) -> float:
        """Simulated time (s) of the last message of the log, from the index or else in one pass."""
        ends = (file.end_ns() for file in reversed(self.files))
        return (next((end for end in ends if end > self.epoch_ns), self.epoch_ns) - self.epoch_ns) / SECOND

    @property
    def condition(self) -> str:
        """Completeness and damage of the log in a line, as far as read."""
        numbers = [file.number for file in self.files]
        which = f"files {numbers[0]} to {numbers[-1]}, " if len(self.files) > 1 else ""
        if damage := self.damage:
            return f"{which}damaged, all else is read ({'; '.join(damage)})"
        return f"{which}{'complete' if self.complete else 'cut short, read as far as it goes'}"

    @property
    def size(self) -> int:
        """Size of all files of a log in bytes."""
        return sum(file.size for file in self.files)

    def messages(
        self, topics: Collection[str] | None = None, on_position: Callable[[int], None] | None = None
    ) -> Iterator[tuple[str, int, bytes]]:
        """Stream the messages of all files of the log in the order of their writing, with at most one chunk in memory.

        Args:
            topics: Names as they were given to `McapLog`; all where None.
            on_position: Called before each message with the bytes read so far, to show progress.

        Yields:
            Topic name as it was given to `McapLog` (relative, or absolute), stamp (ns since 1970), CDR.

        After a file that is cut short the next one follows; of a damaged file all readable data is streamed, and
        `damage` lists the rest.
        """
        for file, moved in self.files_in_turn(on_position):
            yield from file.messages(topics, moved)

    def files_in_turn(
        self, on_position: Callable[[int], None] | None = None
    ) -> Iterator[tuple[LogFile, Callable[[int], None] | None]]:
        """Yield each file of the log with a progress callback that adds the size (bytes) of the previous files."""
        before = 0
        for file in self.files:
            yield file, None if on_position is None else partial(_add_and_tell, on_position, before)
            before += file.size

    def row_decoder(self, layout: Layout) -> RowDecoder:
        """Decoder of the messages `columns` of the log; raises LogError where its columns differ from the layout's."""
        try:
            return RowDecoder(self.metadata, layout)
        except ValueError as error:
            raise LogError(f"{self.path}: {error}") from error


def _add_and_tell(on_position: Callable[[int], None], before: int, position: int) -> None:
    on_position(before + position)


def read_log(path: Path | str) -> Log:
    """Open a log: the directory of a run or one .mcap, finished or cut short by a kill.

    Args:
        path: Directory with the .mcap files of one run, or one of them.

    Returns:
        The log, with metadata and scenario read. It begins with the first file that can be read.

    Raises:
        LogError: The file does not exist, is no bag, is not one of this package, or holds nothing.
    """
    path = Path(path)
    found = _find(path)
    files: list[LogFile] = []
    lost: list[str] = []
    faults: list[LogError] = []
    for before, file in zip([None, *found], found, strict=False):
        if before is not None and file_number(file) > file_number(before) + 1:
            lost.append(f"files are missing between {before.name} and {file.name}")
        try:
            opened = open_file(file)
        except LogError as error:
            faults.append(error)
            lost.append(str(error).removeprefix(f"{file.parent}/"))
            continue
        if files and opened.epoch_ns != files[0].epoch_ns:
            raise LogError(f"{file}: belongs to another run than {files[0].path.name} beside it")
        files.append(opened)
    for opened in files:
        try:
            scenario = _read_scenario(opened)
        except LogError as error:  # noqa: PERF203 - every file has it
            faults.append(error)
        else:
            return Log(path if len(found) > 1 else found[0], tuple(files), scenario, tuple(lost))
    raise faults[0]


def read_foreign(path: Path | str) -> Log:
    """Open a bag of another program, such as `ros2 bag record`: a directory or one .mcap; its scenario is empty.

    Raises:
        LogError: the file does not exist, or has no message.
    """
    path = Path(path)
    found = _find(path)
    files = [open_foreign(file) for file in found]
    first = files[0].epoch_ns
    return Log(path if len(found) > 1 else found[0], tuple(replace(file, epoch_ns=first) for file in files), {})


def _find(path: Path) -> list[Path]:
    """Find the MCAP files of a log in the order of their numbers."""
    if not path.exists():
        raise LogError(f"{path}: no such file or directory")
    if path.is_file():
        return [path]
    files = sorted(path.glob("*.mcap"), key=lambda file: (file_number(file), file.name))
    if not files:
        raise LogError(f"{path}: not a log: given 0 .mcap files; allowed: those of one run")
    runs = sorted({file.stem.rpartition("_")[0] if len(files) > 1 else "" for file in files})
    if len(runs) > 1:
        raise LogError(f"{path}: not a log: given .mcap files of several runs: {', '.join(runs)}; allowed: one run")
    return files


def _read_scenario(file: LogFile) -> dict[str, Any]:
    empty = True
    for topic, _, data in file.messages():
        empty = False
        if topic == SCENARIO:
            try:
                return scenario_from_message(data)
            except UNREADABLE as error:
                raise LogError(f"{file.path}: scenario is unreadable: {one_line(error)}") from error
    if file.scenario is not None and not (empty and not file.damage):
        return file.scenario
    if file.damage:
        raise LogError(f"{file.path}: damaged: {file.damage[0]}")
    raise LogError(
        f"{file.path}: " + ("empty: no message was written" if empty else "no scenario in it, cannot be used")
    )


TOPICS = (COLUMNS, CABLE, APPLIED_COMMANDS, REFUSED_COMMANDS, KEY_FIGURES)


class RecordedFigures(NamedTuple):
    """Key figures that a run has recorded in its log, with their time."""

    time: float  # s
    statuses: list[Status]


Item = Snapshot | AppliedCommand | RefusedCommand | RecordedFigures


def read_snapshots(log: Log, *, on_position: Callable[[int], None] | None = None) -> Iterator[Item]:
    """Stream snapshots, commands and key figures of a log in its order, with one frame in memory.

    Args:
        log: Finished, or cut short: the last frame then may be missing.
        on_position: Called with the bytes of the file read so far.

    Yields:
        Snapshots, each command where it took effect or was refused, and key figures where they were recorded, in the
        order of the log.

    Raises:
        LogError: The scenario or a message is unreadable; the line names topic and time.
    """
    try:
        layout = Layout.of(load_scenario(log.scenario), int(log.metadata["sample_count"]))
    except ScenarioError as error:
        raise LogError("\n".join(f"{log.path}: {fault}" for fault in error.faults)) from error
    decoder = log.row_decoder(layout)
    frame: Row | None = None  # the last one, which may still get its rope
    frame_ns = -1
    for topic, stamp_ns, data in log.messages(TOPICS, on_position):
        time = (stamp_ns - log.epoch_ns) / SECOND
        try:
            if topic == CABLE:
                if frame is not None and stamp_ns == frame_ns:
                    read_rope(data, layout, frame.numbers)
                continue
            if frame is not None:
                yield Snapshot(layout, frame.numbers, frame.report)
                frame = None
            if topic == COLUMNS:
                frame, frame_ns = decoder.decode(data), stamp_ns
            elif topic == APPLIED_COMMANDS:
                yield log.command(stamp_ns, data)
            elif topic == REFUSED_COMMANDS:
                yield refused_command_from_message(data, time)
            else:
                yield RecordedFigures(time, statuses_of_message(data))
        except UNREADABLE as error:
            if isinstance(error, LogError):
                raise
            raise LogError(f"{log.path}: {topic} at {time:.6f} s is unreadable: {one_line(error)}") from error
    if frame is not None:
        yield Snapshot(layout, frame.numbers, frame.report)
