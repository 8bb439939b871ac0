"""Reader of one MCAP file of a log of `log_writer`, complete, cut short or damaged."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from rosbags.serde.errors import SerdeError

from cable_twin.messages import APPLIED_COMMANDS, SECOND, TopicNames
from cable_twin.recording import mcap_records
from cable_twin.recording.log_writer import (
    AFTER_LOSS,
    FORMAT_VERSION,
    LOST_FROM,
    SCENARIO_CHECKSUM,
    SCENARIO_TEXT,
)
from cable_twin.recording.mcap_file import METADATA_NAME, SNAPSHOT_NAME
from cable_twin.recording.mcap_records import (
    CHUNK,
    CHUNK_LIMIT,
    RATIO_LIMIT,
    ChunkPlace,
    Index,
    chunk_messages,
    declared,
    has_messages,
    parsed,
    read_index,
    record_at,
    unpacked,
    unpacked_size,
    walk,
)

LONGEST_GAP = 86400.0  # s of simulated time from one message to the next: a disk that stood still has no more
MOST_TOLD = 5  # pieces of a file that are lost, each in words
# what a message raises that is not what it says
UNREADABLE = (*mcap_records.UNREADABLE, SerdeError, AssertionError, IndexError, TypeError, RecursionError)

LATEST = 2**31 * SECOND  # ns since 1970, what the stamp of a message has room for
NUMBERS = {  # key: lowest and highest, what it is a number of, and whether it may be left out
    "epoch_ns": (0, LATEST - 1, "nanoseconds", False),
    "sample_count": (2, 100_000, "points", False),
    LOST_FROM: (0, LATEST - 1, "nanoseconds", True),
}
DIGITS = 19
SHOWN = 40  # characters of what is given


class LogError(ValueError):
    """Error of a file that is not a readable log of this package: one line with the file and the reason."""


class ForeignError(LogError):
    """Error of a bag that another program has made: it has messages, but no metadata of this package."""


class _Piece(NamedTuple):
    """Chunk of an MCAP log file: its unpacked data, or the reason of its loss."""

    place: ChunkPlace | None  # none without an index
    data: bytes
    fault: str  # reason of a loss


@dataclass(frozen=True)
class LogFile:
    """One MCAP file of a log, opened anew for every pass over its messages."""

    path: Path
    metadata: Mapping[str, str]
    epoch_ns: int
    damage: list[str] = field(default_factory=list, compare=False)  # unread data with reasons, a line each
    _lost_from: list[int] = field(
        default_factory=list, compare=False, repr=False
    )  # stamps after which commands may miss

    @property
    def number(self) -> int:
        """Number of the log file within the run, from its name."""
        return file_number(self.path)

    @property
    def size(self) -> int:
        """Size of a log file in bytes."""
        return self.path.stat().st_size

    @cached_property
    def index(self) -> Index | None:
        """MCAP index at the end of a closed log file, None where missing or damaged."""
        with _open(self.path) as stream:
            return read_index(stream)

    @property
    def complete(self) -> bool:
        """Whether the log file was closed; a killed process leaves an open file without about its last second."""
        return self.index is not None and bool(self.index.chunks)

    @property
    def names(self) -> TopicNames:
        """Full names of the topics in a log file."""
        return TopicNames.of(self.metadata)

    @property
    def topics(self) -> set[str]:
        """Topics that the log file declares, by their names in the table of topics where they are of this package."""
        return {self.names.own(channel.topic) for channel in self.declared()[0].values()}

    @property
    def starts_from_snapshot(self) -> bool:
        """Whether the log file starts from an attached full state, else from the start of the scenario."""
        return self.metadata.get("starts_from") == SNAPSHOT_NAME

    @property
    def commands_lost(self) -> bool:
        """Whether commands may be missing in the log file, as far as read."""
        return bool(self._lost_from) or LOST_FROM in self.metadata

    @property
    def lost_from_ns(self) -> int | None:
        """Stamp (ns since 1970) after which commands may be missing in the log file, as far as read; None if none."""
        given = [int(self.metadata[LOST_FROM])] if LOST_FROM in self.metadata else []
        return min((*given, *self._lost_from), default=None)

    def follows(self, before: LogFile) -> bool:
        """Whether no command is missing between a previous, fully read log file and this one."""
        lost = not before.complete or before.commands_lost or AFTER_LOSS in self.metadata
        return not lost and self.number <= before.number + 1

    @property
    def scenario(self) -> dict[str, Any] | None:
        """Scenario from the metadata of the log file; None where missing or damaged, by its checksum."""
        text = self.metadata.get(SCENARIO_TEXT, "")
        if self.metadata.get(SCENARIO_CHECKSUM) != str(zlib.crc32(text.encode())):
            return None
        try:
            scenario = json.loads(text)
        except (ValueError, RecursionError):
            return None
        return scenario if isinstance(scenario, dict) else None

    def snapshot(self) -> bytes | None:
        """Read the attached full state from which the file starts; None where the file starts with the scenario.

        A damaged state is returned as it is in the file; empty bytes where it is not found.
        """
        if not self.starts_from_snapshot:
            return None
        with _open(self.path) as stream:
            return _attached(stream, self.index)

    def declared(self) -> tuple[dict[int, Channel], dict[int, Schema]]:
        """MCAP channels and schemas of the log file by ID, from the index or else in one pass over the file."""
        if self.index is not None and self.index.channels:
            return dict(self.index.channels), dict(self.index.schemas)
        channels: dict[int, Channel] = {}
        schemas: dict[int, Schema] = {}
        with _open(self.path) as stream:
            for piece in self._pieces(stream, None):
                with suppress(*UNREADABLE):  # what is lost is told where messages are read
                    for one in declared(piece.data):
                        if isinstance(one, Channel):
                            channels.setdefault(one.id, one)
                        else:
                            schemas.setdefault(one.id, one)
        return channels, schemas

    def end_ns(self) -> int:
        """Stamp (ns since 1970) of the last message of the log file, from the index or a pass; epoch if empty."""
        last = self.epoch_ns
        ends = [chunk.last_ns for chunk in self.index.chunks if chunk.last_ns] if self.index and self.complete else []
        for before, end in zip([None if self.starts_from_snapshot else last, *ends], ends, strict=False):
            if not self._may_follow(end, before):  # a stamp of no run, or a gap, in which a pass tells what is what
                ends = []
                break
        for end in ends or (stamp_ns for _, stamp_ns, _ in self.messages()):
            last = max(last, end)
        return last

    def messages(
        self,
        topics: Collection[str] | None = None,
        on_position: Callable[[int], None] | None = None,
        *,
        whole: bool = False,
    ) -> Iterator[tuple[str, int, bytes]]:
        """Stream the messages of the log file in the order of their writing, with at most one chunk in memory.

        Args:
            topics: Names as they were given to `McapLog`; all where None.
            on_position: Called before each message with the bytes of the file read so far, to show progress.
            whole: End where a command may be missing.

        Yields:
            Topic name as it was given to `McapLog` (relative, or absolute), stamp (ns since 1970), CDR.

        A file cut short just ends. Damaged chunks are left out and listed in `damage`.
        """
        own = cache(self.names.own)
        wanted = None if topics is None else {self.names.full(topic) for topic in topics}
        names = {} if self.index is None else {id_: channel.topic for id_, channel in self.index.channels.items()}
        lost_from, last = self.lost_from_ns, None if self.starts_from_snapshot else self.epoch_ns
        with _open(self.path) as stream:
            for piece in self._pieces(stream, wanted):
                try:
                    if piece.fault:
                        raise McapError(piece.fault)
                    for channel, stamp_ns, data in chunk_messages(piece.data, names):
                        if not self._may_follow(stamp_ns, last):
                            self._lose(
                                f"its stamp of {stamp_ns} ns does not belong to this run; later data is left out",
                                last,
                            )
                            return
                        if whole and lost_from is not None and stamp_ns > lost_from:
                            self._lose("commands after it are lost", lost_from)
                            return
                        last = stamp_ns
                        if (topic := names.get(channel)) is None:
                            raise McapError(f"channel {channel} is not declared")
                        if wanted is None or topic in wanted:
                            if on_position is not None:
                                on_position(stream.tell())
                            yield own(topic), stamp_ns, data
                except UNREADABLE as error:  # noqa: PERF203 - of each chunk
                    self._lose(one_line(error), last, piece.place)
                    if whole and self.commands_lost:
                        return

    def _pieces(self, stream: IO[bytes], wanted: Collection[str] | None) -> Iterator[_Piece]:
        """Unpacked chunks of the file in order: those with wanted topics if there is an index, else all."""
        total, allowed = 0, CHUNK_LIMIT + RATIO_LIMIT * self.size
        for place, record in self._chunk_records(stream, wanted):
            try:
                if isinstance(record, Exception):
                    raise record
                total += unpacked_size(record)
                if total > allowed:
                    yield _Piece(
                        place, b"", f"it unpacks to more than {RATIO_LIMIT} times its size; the rest is left out"
                    )
                    return
                yield _Piece(place, unpacked(record), "")
            except UNREADABLE as error:  # noqa: PERF203 - of each chunk
                if isinstance(record, Exception) or has_messages(record):  # else it declares what the next one does too
                    yield _Piece(place, b"", one_line(error))

    def _chunk_records(
        self, stream: IO[bytes], wanted: Collection[str] | None
    ) -> Iterator[tuple[ChunkPlace | None, bytes | Exception]]:
        """Packed record of each chunk with wanted topics, or the error in its place."""
        if self.index is None or not self.complete:
            for record in walk(stream):
                if isinstance(record, McapError):
                    yield None, record
                elif record.opcode == CHUNK:
                    yield None, record.content
            return
        numbers = {id_ for id_, channel in self.index.channels.items() if wanted is None or channel.topic in wanted}
        for place in self.index.chunks:
            if numbers.isdisjoint(place.channels) and (place.channels or not place.last_ns):
                continue  # nothing that is wanted, or no message at all
            try:
                found = record_at(stream, place.offset)
                if found.opcode != CHUNK:
                    raise McapError(f"no chunk at byte {place.offset}")
                yield place, found.content
            except UNREADABLE as error:
                yield place, error

    def _may_follow(self, stamp_ns: int, last: int | None) -> bool:
        """Whether the stamp (ns since 1970) of a message is plausible after the stamp `last` of the one before."""
        return 0 <= stamp_ns < LATEST and (last is None or stamp_ns - last <= LONGEST_GAP * SECOND)

    def _lose(self, why: str, last: int | None, place: ChunkPlace | None = None) -> None:
        """Record a loss of data: add a line to `damage`, and the stamp after which commands may be missing."""
        commands = self.names.full(APPLIED_COMMANDS)
        channels = self.index.channels if self.index is not None else {}
        if (
            place is None
            or not place.channels
            or any(id_ not in channels or channels[id_].topic == commands for id_ in place.channels)
        ):
            since = last if last is not None else self.epoch_ns
            self._lost_from.append(since if place is None or not place.first_ns else min(since, place.first_ns))
        if place is not None and place.last_ns:
            first, end = ((stamp - self.epoch_ns) / SECOND for stamp in (place.first_ns, place.last_ns))
            line = f"{first:.2f} to {end:.2f} s are lost: {why}"
        else:
            line = f"a part after {((last or self.epoch_ns) - self.epoch_ns) / SECOND:.2f} s is lost: {why}"
        if line in self.damage or len(self.damage) > MOST_TOLD:
            return
        self.damage.append(line if len(self.damage) < MOST_TOLD else "and more")


def file_number(path: Path) -> int:
    """Number of a log file within its run, from its name; 0 for a name without a number."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def open_file(path: Path) -> LogFile:
    """Open one MCAP file of a log and check its metadata.

    Raises:
        LogError: The file is no bag, not one of this package, or of a format that this version does not know.
    """
    with _open(path) as stream:
        metadata = _metadata(path, stream)
    _check_metadata(path, metadata)
    return LogFile(path, metadata, int(metadata["epoch_ns"]))


def open_foreign(path: Path) -> LogFile:
    """Open one MCAP file of a bag of another program; its time zero is the stamp of its first message.

    Raises:
        LogError: the file has no message that can be read.
    """
    file = LogFile(path, {}, 0)
    channels, _ = file.declared()
    names = {id_: channel.topic for id_, channel in channels.items()}
    with _open(path) as stream:
        for piece in file._pieces(stream, None):
            with suppress(*UNREADABLE):
                for _, stamp_ns, _ in chunk_messages(piece.data, names):
                    return LogFile(path, {}, stamp_ns)
    raise LogError(f"{path}: empty: no message was written")


def _check_metadata(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a bag with metadata that do not belong to a run.

    Raises:
        LogError: a value is invalid; one line with the given and the allowed values.
    """
    version = metadata.get("format_version", "")
    if len(version) > DIGITS:
        raise LogError(f"{file}: format version: given {_shown(version)}; allowed: a number of {DIGITS} digits at most")
    _check_format(file, metadata)
    for key, (low, high, unit, optional) in NUMBERS.items():
        if optional and key not in metadata:
            continue
        given = metadata.get(key, "")
        sound = len(given) <= DIGITS and given.isascii() and given.isdecimal()
        if not (sound and low <= int(given) <= high):
            raise LogError(f"{file}: {key}: given {_shown(given)}; allowed: a whole number of {unit}, {low} to {high}")
    try:
        remapped = json.loads(metadata.get("remapped", "{}"))
    except (ValueError, RecursionError):
        remapped = None
    if not isinstance(remapped, dict) or not all(isinstance(name, str) for name in remapped.values()):
        raise LogError(
            f"{file}: remapped: given {_shown(metadata['remapped'])}; allowed: a mapping of topics to full names"
        )


def _check_format(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a log file of an unknown format version, with advice for a newer one.

    Raises:
        LogError: one line with the version of the file and the readable one.
    """
    given = metadata.get("format_version", "")
    if given == FORMAT_VERSION:
        return
    if given.isdecimal() and int(given) > int(FORMAT_VERSION):
        raise LogError(
            f"{file}: format version {given} is newer than this cable_twin reads ({FORMAT_VERSION}); "
            f"update cable_twin: the log was made by {metadata.get('package_version', 'an unknown version')}"
        )
    raise LogError(
        f"{file}: format version {given!r}, this cable_twin reads {FORMAT_VERSION}; "
        f"made by cable_twin {metadata.get('package_version', '(unknown)')}, which replays it"
    )


def _shown(given: str) -> str:
    return repr(given if len(given) <= SHOWN else f"{given[:SHOWN]}...")


def _open(file: Path) -> IO[bytes]:
    if file.exists() and not file.is_file():  # one that never ends, or never begins
        raise LogError(f"{file}: not a regular file")
    try:
        return file.open("rb")
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error


def _metadata(file: Path, stream: IO[bytes]) -> dict[str, str]:
    """Find the metadata of the run in a log file: before the first message, or by the index."""
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise LogError(f"{file}: not a bag: no MCAP file")
    fault = ""
    for content in (*_of_kind(stream, None, Opcode.METADATA), *_of_kind(stream, read_index(stream), Opcode.METADATA)):
        try:
            record = parsed(Metadata, content)
        except UNREADABLE as error:
            fault = one_line(error)
            continue
        if record.name == METADATA_NAME:
            return dict(record.metadata)
    try:
        record_at(stream, len(MCAP0_MAGIC))
    except McapError as error:
        fault = one_line(error)
    if fault:
        raise LogError(f"{file}: not a bag, or empty: {fault}")
    raise ForeignError(f"{file}: not a bag made by cable_twin: no metadata record {METADATA_NAME!r}")


def _attached(stream: IO[bytes], index: Index | None) -> bytes:
    """Full state attached to a log file, damaged or not; empty where not found."""
    for content in (*_of_kind(stream, None, Opcode.ATTACHMENT), *_of_kind(stream, index, Opcode.ATTACHMENT)):
        try:
            record = parsed(Attachment, content)
        except UNREADABLE:
            continue
        if record.name == SNAPSHOT_NAME:
            return bytes(record.data)
    return b""


def _of_kind(stream: IO[bytes], index: Index | None, opcode: Opcode) -> list[bytes]:
    """Contents of the MCAP records of a kind, found by the index or before the second chunk."""
    found: list[bytes] = []
    if index is not None:
        for offset in index.others:
            try:
                record = record_at(stream, offset)
            except UNREADABLE:
                continue
            found += [record.content] if record.opcode == opcode else []
        return found
    chunks = 0
    for one in walk(stream):
        if isinstance(one, McapError) or (chunks := chunks + (one.opcode == CHUNK)) > 1:
            break
        found += [one.content] if one.opcode == opcode else []
    return found


def check_gap(before: float, after: float) -> None:
    """Raise an error if a log has no frame between two simulated times (s) for longer than a run can be repeated.

    Raises:
        LogError: the gap is longer than `LONGEST_GAP`; one line.
    """
    if after - before > LONGEST_GAP:
        raise LogError(f"frames: given none from {before:g} to {after:g} s; allowed: gaps of at most {LONGEST_GAP:g} s")


def one_line(error: BaseException) -> str:
    """Text of an error without line breaks; for an empty text the name of its class."""
    return " ".join(str(error).split()) or type(error).__name__
