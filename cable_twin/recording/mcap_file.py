"""Writer of one MCAP file, with less than a second lost by a kill or a power cut."""

from __future__ import annotations

import os
import time
import zlib
from array import array
from collections.abc import Collection, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from cable_twin.basics.files import sync
from cable_twin.recording.bag_metadata import BagFile, BagTopics

METADATA_NAME = "cable_twin"
SNAPSHOT_NAME = "snapshot.npz"
FLUSH_PERIOD = 0.4  # s of wall time that a kill or a power cut takes at most; a cut through a chunk takes two


class _PackedIndex:
    """Chunk index as packed bytes, a sixth of the size of the original object."""

    __slots__ = ("_record",)

    def __init__(self, index: ChunkIndex) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._record = builder.end()

    def write(self, builder: RecordBuilder) -> None:
        builder.write(self._record)


class _PackedIndexes(list[_PackedIndex]):
    """List of chunk indexes of an MCAP writer, each packed into bytes."""

    def append(self, index: Any) -> None:
        super().append(_PackedIndex(index))


class _Writer(Writer):
    """MCAP writer with packed chunk indexes, for runs of days: plain ones take 10 MB an hour at two chunks a second."""

    def __init__(self, stream: IO[bytes], compression: CompressionType) -> None:
        super().__init__(stream, compression=compression)
        self.packed = _PackedIndexes()
        self._Writer__chunk_indices = self.packed  # mcap has no door to it

    @property
    def schemas(self) -> Collection[Schema]:
        """All schemas registered with the MCAP writer."""
        return self._Writer__schemas.values()  # type: ignore[attr-defined, no-any-return]

    @property
    def channels(self) -> Collection[Channel]:
        """All channels registered with the MCAP writer."""
        return self._Writer__channels.values()  # type: ignore[attr-defined, no-any-return]


class GoneError(FileNotFoundError):
    """Deletion or replacement of an MCAP file being written, or of its directory."""


class McapFile:
    """MCAP file being written, flushed to disk at least every flush period.

    Attributes:
        path: Of the file.
        size: Bytes written so far, without the chunk that is being gathered.
        safe_ns: Stamp (ns since 1970) up to which all messages are safe on disk; 0 where nothing is written.
    """

    def __init__(self, path: Path, topics: BagTopics) -> None:
        """Create an MCAP file with all its channels.

        Args:
            path: Of the file, which must not exist.
            topics: Everything that may be written.

        Raises:
            OSError: The disk refuses, and no file is left; or the file exists.
        """
        self.path = path
        self.size = 0
        self.safe_ns = 0
        self._topics = topics
        self._counts = dict.fromkeys((channel.topic for channel in topics.channels), 0)
        self._first_ns = 2**63 - 1
        self._last_ns = 0
        self._readable_size = 0  # bytes; where the last complete flush ended
        self._flushed = time.monotonic()
        self._stream: IO[bytes] | None = path.open("xb")
        try:
            self._writer = _Writer(self._stream, compression=CompressionType.ZSTD)
            self._writer.start("ros2", f"cable_twin {package_version('cable_twin')}; {LIBRARY_IDENTIFIER}")
            self._channels = self._register()
            self.flush()
            sync(path.resolve().parent)
        except OSError:
            self.abandon()
            with suppress(OSError):
                path.unlink()  # nothing is in it, and a reader would take it for a damaged part of the run
            raise

    @property
    def is_open(self) -> bool:
        """Whether the MCAP file is neither closed nor given up."""
        return self._stream is not None

    @property
    def is_gone(self) -> bool:
        """Whether the open MCAP file was deleted or moved; the check takes some microseconds."""
        if self._stream is None:
            return False
        own = os.fstat(self._stream.fileno())
        try:
            found = self.path.stat()
        except (FileNotFoundError, NotADirectoryError):
            return True
        except OSError:  # a disk that fails is another matter
            return False
        return (found.st_dev, found.st_ino) != (own.st_dev, own.st_ino)

    @property
    def contents(self) -> BagFile:
        """Name, time span and message counts of the MCAP file up to now."""
        return BagFile(self.path.name, self._first_ns, self._last_ns, array("Q", self._counts.values()))

    def begin(self, metadata: Mapping[str, str], snapshot: bytes | None) -> None:
        """Write metadata and full state of a run to the MCAP file, before the first message.

        Args:
            metadata: The record `cable_twin`.
            snapshot: The full state to attach, or None.

        Raises:
            OSError: The disk refuses; the file is given up.
        """
        try:
            self._writer.add_metadata(METADATA_NAME, dict(metadata))
            if snapshot is not None:
                now = time.time_ns()
                self._writer.add_attachment(now, now, SNAPSHOT_NAME, "application/octet-stream", snapshot)
            self._writer.flush()
            self._declare()
        except OSError:
            self.abandon()
            raise
        self.flush()

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Append a message to the MCAP file; raises OSError if the disk fails, flushed messages stay readable."""
        if self._stream is None:
            raise ValueError(f"{self.path}: log is closed")
        if topic not in self._channels:
            raise ValueError(f"{self.path}: topic {topic!r} was not declared when the log was opened")
        try:
            self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, self._counts[topic])
            self.size = self._stream.tell()
        except OSError:
            self.abandon()
            raise
        self._counts[topic] += 1
        self._first_ns = min(self._first_ns, stamp_ns)
        self._last_ns = max(self._last_ns, stamp_ns)
        self.flush_if_due()

    def flush_if_due(self) -> None:
        """Flush messages of the MCAP file older than a flush period."""
        if time.monotonic() - self._flushed >= FLUSH_PERIOD:
            self.flush()

    def flush(self) -> None:
        """Finish the current chunk of the MCAP file and flush it to disk, safe from a kill or a power cut.

        Raises:
            GoneError: The file on the disk was deleted or replaced; it is given up.
            OSError: The disk refuses; the file is given up.
        """
        if self._stream is None:
            return
        try:
            self._writer.flush()
            os.fdatasync(self._stream.fileno())
            self.size = self._readable_size = self._stream.tell()
            if self.is_gone:
                raise GoneError(f"{self.path.parent} is gone with all files in it")
        except OSError:
            self.abandon()
            raise
        self.safe_ns = self._last_ns
        self._flushed = time.monotonic()

    def close(self) -> None:
        """Close the MCAP file with remaining data, rosbag2's metadata and the index; a second call does nothing.

        Raises:
            OSError: The disk refuses; the file is closed nevertheless, and messages flushed before are readable.
        """
        if self._stream is None:
            return
        if self.is_gone:
            self.abandon()
            raise GoneError(f"{self.path.parent} is gone with all files in it")
        try:
            self._writer.flush()
            self._readable_size = self._stream.tell()
            self._writer.add_metadata("rosbag2", {"serialized_metadata": self._topics.information([self.contents])})
            self._writer.finish()
            self._stream.flush()
            os.fdatasync(self._stream.fileno())
            self.size = self._stream.tell()
            self._stream.close()
        except OSError:
            self.abandon()
            raise
        self._stream = None
        self.safe_ns = self._last_ns

    def abandon(self) -> None:
        """Close the MCAP file without an index, cut after its last complete chunk, as a partial one spoils a repair."""
        gone = self.is_gone  # of a file that is none of ours nothing is cut
        stream, self._stream = self._stream, None
        if stream is None:
            return
        with suppress(OSError):
            stream.close()
        with suppress(OSError):
            if not gone:
                os.truncate(self.path, self._readable_size)

    def _declare(self) -> None:
        """Write all MCAP channels again in a separate chunk, as the first chunk with messages may be damaged."""
        builder = RecordBuilder()
        for record in (*self._writer.schemas, *self._writer.channels):
            record.write(builder)
        records = builder.end()
        packed = zstandard.compress(records)
        Chunk("zstd", packed, 0, 0, zlib.crc32(records), len(records)).write(builder)
        assert self._stream is not None
        self._stream.write(builder.end())

    def _register(self) -> dict[str, int]:
        schemas: dict[str, int] = {}
        numbers = {}
        for channel in self._topics.channels:
            if channel.type not in schemas:
                schemas[channel.type] = self._writer.register_schema(channel.type, "ros2msg", channel.definition)
            schema = schemas[channel.type]
            numbers[channel.topic] = self._writer.register_channel(channel.name, "cdr", schema, channel.metadata)
        return numbers


def package_version(package: str) -> str:
    """Version of an installed Python package; "unknown" where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
