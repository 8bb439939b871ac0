"""Reading one .mcap of a log of `log_writer`, finished, cut short or damaged."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import IO

import zstandard
from mcap.exceptions import InvalidMagic, McapError
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from rosbags.serde.errors import SerdeError

from cable_twin.messages import TopicNames
from cable_twin.recording.log_versions import LogError, check_format
from cable_twin.recording.log_writer import AFTER_LOSS
from cable_twin.recording.mcap_file import METADATA_NAME, SNAPSHOT_NAME

RECORD_LIMIT = 2**30  # bytes; a longer record is garbage
UNREADABLE = (McapError, SerdeError, zstandard.ZstdError, struct.error, ValueError, OverflowError, KeyError)


@dataclass(frozen=True)
class LogFile:
    """One file of a log; every pass over its messages opens it anew."""

    path: Path
    metadata: Mapping[str, str]
    epoch_ns: int
    damage: list[str] = field(default_factory=list, compare=False)  # why a finished file was not read to its end

    @property
    def number(self) -> int:
        """Which file of the run it is, by its name."""
        return file_number(self.path)

    @property
    def size(self) -> int:
        """Bytes."""
        return self.path.stat().st_size

    @cached_property
    def complete(self) -> bool:
        """Whether it was closed; else the process was killed, and everything but about its last second is here."""
        with _open(self.path) as stream:
            return _has_index(stream)

    @property
    def names(self) -> TopicNames:
        """Full names of its topics."""
        return TopicNames.of(self.metadata)

    @property
    def starts_from_snapshot(self) -> bool:
        """Whether the full state that it starts from is attached; else it starts as the scenario does."""
        return self.metadata.get("starts_from") == SNAPSHOT_NAME

    def follows(self, before: LogFile) -> bool:
        """Whether nothing is missing between a file that has been read and this one."""
        lost = not before.complete or before.damage or AFTER_LOSS in self.metadata
        return not lost and self.number <= before.number + 1

    def snapshot(self) -> bytes | None:
        """Read the file of the full state that it starts from, None where it starts as the scenario does."""
        if not self.starts_from_snapshot:
            return None
        with _open(self.path) as stream:
            return _read_origin(self.path, stream)[1]

    def end_ns(self) -> int:
        """Stamp (ns since 1970) of the last message, the epoch where there is none; from the index, or in a pass."""
        last = self.epoch_ns
        if self.complete:
            with _open(self.path) as stream:
                summary = SeekingReader(stream).get_summary()
                chunks = summary.chunk_indexes if summary is not None else ()
                return max((chunk.message_end_time for chunk in chunks), default=last)
        for _, stamp_ns, _ in self.messages():
            last = max(last, stamp_ns)
        return last

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
        names = self.names
        own = cache(names.own)
        wanted = None if topics is None else {names.full(topic) for topic in topics}
        with _open(self.path) as stream:
            try:
                for topic, message in _indexed(stream, wanted) if self.complete else _streamed(stream, wanted):
                    if on_position is not None:
                        on_position(stream.tell())
                    yield own(topic), message.log_time, message.data
            except UNREADABLE as error:
                if self.complete and not self.damage:
                    self.damage.append(one_line(error))


def file_number(path: Path) -> int:
    """Which file of a run it is, by its name; 0 where that says nothing."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def open_file(path: Path) -> LogFile:
    """Open one file of a log.

    Raises:
        LogError: It is no bag, not one of this package, or of a format that this version does not know.
    """
    with _open(path) as stream:
        metadata, _ = _read_origin(path, stream)
    check_format(path, metadata)
    for key, unit in (("epoch_ns", "of nanoseconds"), ("sample_count", "of points")):
        if not metadata.get(key, "").isdecimal():
            raise LogError(f"{path}: {key} is {metadata.get(key)!r}, a whole number {unit} is expected")
    return LogFile(path, metadata, int(metadata["epoch_ns"]))


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
