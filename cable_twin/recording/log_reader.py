"""Reading a log of `mcap_log` back, finished or cut short by a kill."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.exceptions import InvalidMagic, McapError
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from rosbags.serde.errors import SerdeError

from cable_twin.command_messages import applied_command_from_message
from cable_twin.messages import APPLIED_COMMANDS, NAMESPACE, SCENARIO, SECOND, full_name, scenario_from_message
from cable_twin.recording.mcap_log import FORMAT_VERSION, METADATA_NAME, SNAPSHOT_NAME
from cable_twin.records import AppliedCommand

RECORD_LIMIT = 2**30  # bytes; a longer record is garbage
UNREADABLE = (McapError, SerdeError, zstandard.ZstdError, struct.error, ValueError, OverflowError, KeyError)


class LogError(ValueError):
    """A file that is no readable log of this package: one line with the file and what is wrong."""


@dataclass(frozen=True)
class Log:
    """A log to read, finished or cut short; every pass over its messages opens the file anew."""

    path: Path  # of the .mcap
    metadata: Mapping[str, str]
    scenario: Mapping[str, Any]
    epoch_ns: int
    complete: bool  # False: the process was killed; everything but about its last second is here
    snapshot: bytes | None = None  # file of the full state from which the run started, if not as its scenario does
    damage: list[str] = field(default_factory=list, compare=False)  # why a finished file was not read to its end

    @cached_property
    def commands(self) -> list[AppliedCommand]:
        """All commands in the order in which they took effect; found with the index, or in one pass without."""
        commands = []
        for _, stamp_ns, data in self.messages([APPLIED_COMMANDS]):
            commands.append(self.command(stamp_ns, data))
        return commands

    def command(self, stamp_ns: int, data: bytes) -> AppliedCommand:
        """Read a message of applied_commands; raises LogError where it is unreadable."""
        try:
            return applied_command_from_message(data, self.epoch_ns)
        except UNREADABLE as error:
            when = f"{(stamp_ns - self.epoch_ns) / SECOND:.6f} s"
            raise LogError(f"{self.path}: command at {when} is unreadable: {one_line(error)}") from error

    @cached_property
    def end(self) -> float:
        """Simulated time (s) of the last message; from the index, or in one pass without."""
        last = self.epoch_ns
        if self.complete:
            with _open(self.path) as stream:
                summary = SeekingReader(stream).get_summary()
                chunks = summary.chunk_indexes if summary is not None else ()
                last = max((chunk.message_end_time for chunk in chunks), default=last)
        else:
            for _, stamp_ns, _ in self.messages():
                last = max(last, stamp_ns)
        return (last - self.epoch_ns) / SECOND

    @property
    def condition(self) -> str:
        """How much of it there is, as far as it has been read."""
        if self.damage:
            return f"damaged, read as far as it goes ({self.damage[0]})"
        return "complete" if self.complete else "cut short, read as far as it goes"

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self.path.stat().st_size

    def messages(
        self, topics: Collection[str] | None = None, on_position: Callable[[int], None] | None = None
    ) -> Iterator[tuple[str, int, bytes]]:
        """Stream messages in the order in which they were written, never more than a chunk in memory.

        Args:
            topics: Names as they were given to `McapLog`; all where None.
            on_position: Called before each message with the bytes of the file read so far, to show progress.

        Yields:
            Topic name as it was given to `McapLog` (relative, or absolute), stamp (ns since 1970), CDR.

        A file cut short just ends, and so does a finished one where it is damaged; `damage` then says so.
        """
        prefix = self.metadata.get("namespace", NAMESPACE).rstrip("/") + "/"
        wanted = None if topics is None else {full_name(topic, prefix) for topic in topics}
        with _open(self.path) as stream:
            try:
                for topic, message in _indexed(stream, wanted) if self.complete else _streamed(stream, wanted):
                    if on_position is not None:
                        on_position(stream.tell())
                    yield topic.removeprefix(prefix), message.log_time, message.data
            except UNREADABLE as error:
                if self.complete and not self.damage:
                    self.damage.append(one_line(error))


def read_log(path: Path | str) -> Log:
    """Open a log: its directory or its .mcap, finished or cut short by a kill.

    Args:
        path: Directory with one .mcap, or the .mcap itself.

    Returns:
        The log, with metadata and scenario read.

    Raises:
        LogError: There is no such file, it is no bag, not one of this package, or it holds nothing.
    """
    file = _find(Path(path))
    with _open(file) as stream:
        metadata, snapshot = _read_origin(file, stream)
        complete = _has_index(stream)
    _check_format(file, metadata)
    for key, unit in (("epoch_ns", "of nanoseconds"), ("sample_count", "of points")):
        if not metadata.get(key, "").isdecimal():
            raise LogError(f"{file}: {key} is {metadata.get(key)!r}, a whole number {unit} is expected")
    log = Log(file, metadata, {}, int(metadata["epoch_ns"]), complete, snapshot)
    empty = True
    for topic, _, data in log.messages():
        empty = False
        if topic == SCENARIO:
            return replace(log, scenario=_read_scenario(file, data))
    if log.damage:
        raise LogError(f"{file}: damaged: {log.damage[0]}")
    raise LogError(f"{file}: " + ("empty: no message was written" if empty else "no scenario in it, cannot be used"))


def _check_format(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a format that this version does not know; a newer one says what to do."""
    given = metadata.get("format_version", "")
    if given == FORMAT_VERSION:
        return
    if given.isdecimal() and int(given) > int(FORMAT_VERSION):
        raise LogError(
            f"{file}: format version {given} is newer than this cable_twin reads ({FORMAT_VERSION}); "
            f"update cable_twin: the log was made by {metadata.get('package_version', 'an unknown version')}"
        )
    raise LogError(f"{file}: format version {given!r}, this package reads {FORMAT_VERSION!r}")


def _read_scenario(file: Path, data: bytes) -> dict[str, Any]:
    try:
        return scenario_from_message(data)
    except UNREADABLE as error:
        raise LogError(f"{file}: scenario is unreadable: {one_line(error)}") from error


def _find(path: Path) -> Path:
    if not path.exists():
        raise LogError(f"{path}: no such file or directory")
    if path.is_file():
        return path
    files = sorted(path.glob("*.mcap"))
    if len(files) != 1:
        raise LogError(f"{path}: not a log: {len(files)} .mcap files in it, one is expected")
    return files[0]


def _open(file: Path) -> IO[bytes]:
    try:
        return file.open("rb")
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error


def _read_origin(file: Path, stream: IO[bytes]) -> tuple[dict[str, str], bytes | None]:
    """Find where the run comes from, and the state it starts from if that is attached: before the first message."""
    metadata: dict[str, str] | None = None
    try:
        for record in StreamReader(stream, record_size_limit=RECORD_LIMIT).records:
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                metadata = record.metadata
                if metadata.get("starts_from") != SNAPSHOT_NAME:
                    return metadata, None
            elif metadata is not None and isinstance(record, Attachment) and record.name == SNAPSHOT_NAME:
                return metadata, record.data
            elif isinstance(record, Message):
                break
    except InvalidMagic as error:
        raise LogError(f"{file}: not a bag: no MCAP file") from error
    except UNREADABLE as error:
        raise LogError(f"{file}: not a bag, or empty: {one_line(error)}") from error
    if metadata is not None:
        raise LogError(f"{file}: the run started from a snapshot, and {SNAPSHOT_NAME} is not attached any more")
    raise LogError(f"{file}: not a bag made by cable_twin: no metadata record {METADATA_NAME!r}")


def _has_index(stream: IO[bytes]) -> bool:
    stream.seek(0, os.SEEK_END)
    if stream.tell() < 2 * len(MCAP0_MAGIC):
        return False
    stream.seek(-len(MCAP0_MAGIC), os.SEEK_END)
    if stream.read() != MCAP0_MAGIC:
        return False
    stream.seek(0)
    try:
        summary = SeekingReader(stream).get_summary()
    except UNREADABLE:
        return False
    return summary is not None and bool(summary.chunk_indexes)


def _indexed(stream: IO[bytes], topics: Collection[str] | None) -> Iterator[tuple[str, Message]]:
    """Read only the chunks that hold the topics; mcap's own reader in this order would load all of them at once."""
    summary = SeekingReader(stream).get_summary()
    if summary is None:
        return
    names = {
        id_: channel.topic for id_, channel in summary.channels.items() if topics is None or channel.topic in topics
    }
    for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
        if names.keys().isdisjoint(index.message_index_offsets):
            continue
        stream.seek(index.chunk_start_offset)
        chunk = next(StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=RECORD_LIMIT).records)
        if not isinstance(chunk, Chunk):
            raise McapError(f"no chunk at byte {index.chunk_start_offset}")
        for record in breakup_chunk(chunk, validate_crc=True):
            if isinstance(record, Message) and record.channel_id in names:
                yield names[record.channel_id], record


def _streamed(stream: IO[bytes], topics: Collection[str] | None) -> Iterator[tuple[str, Message]]:
    names: dict[int, str] = {}
    for record in StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_LIMIT).records:
        if isinstance(record, Channel):
            names[record.id] = record.topic
        elif isinstance(record, Message) and (topics is None or names[record.channel_id] in topics):
            yield names[record.channel_id], record


def one_line(error: BaseException) -> str:
    """Text of an error without line breaks, or the name of its class."""
    return " ".join(str(error).split()) or type(error).__name__
