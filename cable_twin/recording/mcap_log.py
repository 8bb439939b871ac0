"""A run as a rosbag2 directory with one MCAP: written so that a killed process loses less than a second, and read back.

The file has profile ros2, CDR messages, ros2msg schemas with type hashes and QoS as rosbag2 writes them, zstd chunks
of at most half a second. Log time and publish time are the stamp of the message: the epoch of the run plus simulated
time. A metadata record `cable_twin` says where the run came from; with the scenario and the applied commands a log is
enough to repeat the run.
"""

from __future__ import annotations

import os
import platform
import struct
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from io import StringIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.exceptions import InvalidMagic, McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC, CompressionType, Writer
from rosbags.serde.errors import SerdeError
from ruamel.yaml import YAML

from cable_twin.messages import (
    APPLIED_COMMANDS,
    NAMESPACE,
    SCENARIO,
    SECOND,
    TYPESTORE,
    Topic,
    applied_command_from_message,
    full_name,
    scenario_from_message,
)
from cable_twin.records import AppliedCommand

FORMAT_VERSION = "1"
METADATA_NAME = "cable_twin"
FLUSH_PERIOD = 0.5  # s of wall time that a killed process loses at most
RECORD_LIMIT = 2**30  # bytes; a longer record is garbage
INFINITE = {"sec": 9223372036, "nsec": 854775807}  # how rosbag2 writes a duration without end
UNREADABLE = (McapError, SerdeError, zstandard.ZstdError, struct.error, ValueError, OverflowError, KeyError)


class LogError(ValueError):
    """A file that is no readable log of this package: one line with the file and what is wrong."""


def run_metadata(*, scenario: str, epoch_ns: int, frame_period: float, sample_count: int) -> dict[str, str]:
    """Tell where a run comes from.

    Args:
        scenario: Name of the scenario.
        epoch_ns: Wall time (ns since 1970) of simulated time zero.
        frame_period: s of simulated time between frames.
        sample_count: Points of the cable in each frame.

    Returns:
        The metadata for `McapLog`.
    """
    return {
        "package_version": _version("cable_twin"),
        "python_version": platform.python_version(),
        "numpy_version": _version("numpy"),
        "numba_version": _version("numba"),
        "machine": f"{platform.system()} {platform.machine()}",
        "scenario": scenario,
        "epoch_ns": str(epoch_ns),
        "frame_period": repr(frame_period),
        "sample_count": str(sample_count),
    }


class McapLog:
    """A log being written. Not for several threads at once."""

    def __init__(
        self, directory: Path, topics: Iterable[Topic], metadata: Mapping[str, str], *, namespace: str = NAMESPACE
    ) -> None:
        """Create the directory, the file with all its channels, and a metadata.yaml for the time until it is closed.

        Args:
            directory: Made where it does not exist; the file in it is named after it.
            topics: Everything that may be written.
            metadata: Where the run comes from, as `run_metadata` gives it; `epoch_ns` is needed.
            namespace: Full name of the node, in front of relative topic names.

        Raises:
            OSError: The disk refuses, or the log exists.
        """
        int(metadata["epoch_ns"])  # a log without it cannot be read back
        self.directory = directory
        self.path = directory / f"{directory.resolve().name}_0.mcap"
        self._namespace = namespace
        self._topics = {topic.name: topic for topic in topics}
        self._counts = dict.fromkeys(self._topics, 0)
        self._first_ns = 2**63 - 1
        self._last_ns = 0
        self._readable_size = 0  # bytes; where the last complete flush ended
        directory.mkdir(parents=True, exist_ok=True)
        self._stream: IO[bytes] | None = self.path.open("xb")
        try:
            self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
            self._writer.start("ros2", f"cable_twin {_version('cable_twin')}; {LIBRARY_IDENTIFIER}")
            self._writer.add_metadata(
                METADATA_NAME, {"format_version": FORMAT_VERSION, "namespace": namespace, **metadata}
            )
            self._channels = self._register()
            self._write_bag_metadata()
            self.flush()
        except BaseException:
            self._abandon()
            raise

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Append one message.

        Args:
            topic: Name as in the topics given, relative or absolute.
            stamp_ns: Stamp (ns since 1970) of the message.
            data: CDR.

        Raises:
            OSError: The disk refuses; what was flushed before stays readable, and the log only wants to be closed.
        """
        if self._stream is None:
            msg = f"{self.path}: log is closed"
            raise ValueError(msg)
        if topic not in self._channels:
            msg = f"{self.path}: topic {topic!r} was not declared when the log was opened"
            raise ValueError(msg)
        try:
            self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, self._counts[topic])
        except OSError:
            self._abandon()
            raise
        self._counts[topic] += 1
        self._first_ns = min(self._first_ns, stamp_ns)
        self._last_ns = max(self._last_ns, stamp_ns)
        self.flush_if_due()

    def flush_if_due(self) -> None:
        """Flush what has waited for half a second; `write` does it too, call it where messages may stay away."""
        if time.monotonic() - self._flushed >= FLUSH_PERIOD:
            self.flush()

    def flush(self) -> None:
        """Finish the chunk and hand it to the operating system: from now on a kill cannot take it."""
        if self._stream is None:
            return
        try:
            self._writer.flush()
            self._readable_size = self._stream.tell()
        except OSError:
            self._abandon()
            raise
        self._flushed = time.monotonic()

    def close(self) -> None:
        """Write the index and the final metadata.yaml; a second call does nothing.

        Raises:
            OSError: The disk refuses; the file is closed nevertheless, and what was flushed before is readable.
        """
        if self._stream is None:
            return
        try:
            self._writer.flush()
            self._readable_size = self._stream.tell()
            self._write_bag_metadata()
            self._writer.finish()
            self._stream.close()
            self._stream = None
        except OSError:
            self._abandon()
            raise

    def _abandon(self) -> None:
        """Close without an index, cut after the last complete chunk: a piece of one would spoil a later repair."""
        stream, self._stream = self._stream, None
        if stream is None:
            return
        with suppress(OSError):
            stream.close()
        with suppress(OSError):
            os.truncate(self.path, self._readable_size)

    def _register(self) -> dict[str, int]:
        schemas: dict[str, int] = {}
        channels = {}
        for topic in self._topics.values():
            if topic.type not in schemas:
                definition, _ = TYPESTORE.generate_msgdef(topic.type, ros_version=2)
                schemas[topic.type] = self._writer.register_schema(topic.type, "ros2msg", definition.encode())
            metadata = {
                "offered_qos_profiles": _yaml([_qos_profile(topic)]).strip(),
                "topic_type_hash": TYPESTORE.hash_rihs01(topic.type),
            }
            name = full_name(topic.name, self._namespace)
            channels[topic.name] = self._writer.register_channel(name, "cdr", schemas[topic.type], metadata)
        return channels

    def _write_bag_metadata(self) -> None:
        """Write what rosbag2 wants to know into the file and, by rename, into metadata.yaml."""
        count = sum(self._counts.values())
        span = {
            "starting_time": {"nanoseconds_since_epoch": self._first_ns if count else 0},
            "duration": {"nanoseconds": self._last_ns - self._first_ns if count else 0},
            "message_count": count,
        }
        information = {
            "version": 9,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": full_name(topic.name, self._namespace),
                        "type": topic.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": [_qos_profile(topic)],
                        "type_description_hash": TYPESTORE.hash_rihs01(topic.type),
                    },
                    "message_count": self._counts[topic.name],
                }
                for topic in self._topics.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.path.name],
            "files": [{"path": self.path.name, **span}],
            "custom_data": None,
            "ros_distro": os.environ.get("ROS_DISTRO", "unknown"),
        }
        self._writer.add_metadata("rosbag2", {"serialized_metadata": _yaml(information)})
        new = self.directory / "metadata.yaml.new"
        new.write_text(_yaml({"rosbag2_bagfile_information": information}), encoding="utf-8")
        new.replace(self.directory / "metadata.yaml")


@dataclass(frozen=True)
class Log:
    """A log to read, finished or cut short; every pass over its messages opens the file anew."""

    path: Path  # of the .mcap
    metadata: Mapping[str, str]
    scenario: Mapping[str, Any]
    epoch_ns: int
    complete: bool  # False: the process was killed; everything but about its last second is here

    @cached_property
    def commands(self) -> list[AppliedCommand]:
        """All commands in the order in which they took effect; found with the index, or in one pass without."""
        commands = []
        for _, stamp_ns, data in self.messages([APPLIED_COMMANDS]):
            commands.append(self._command(stamp_ns, data))
        return commands

    def _command(self, stamp_ns: int, data: bytes) -> AppliedCommand:
        try:
            return applied_command_from_message(data, self.epoch_ns)
        except UNREADABLE as error:
            when = f"{(stamp_ns - self.epoch_ns) / SECOND:.6f} s"
            raise LogError(f"{self.path}: command at {when} is unreadable: {_one_line(error)}") from error

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """Stream messages in the order in which they were written, never more than a chunk in memory.

        Args:
            topics: Names as they were given to `McapLog`; all where None.

        Yields:
            Topic name as it was given to `McapLog` (relative, or absolute), stamp (ns since 1970), CDR.

        Raises:
            LogError: A finished file is damaged. A file cut short just ends.
        """
        prefix = self.metadata.get("namespace", NAMESPACE).rstrip("/") + "/"
        wanted = None if topics is None else {full_name(topic, prefix) for topic in topics}
        with _open(self.path) as stream:
            try:
                for topic, message in _indexed(stream, wanted) if self.complete else _streamed(stream, wanted):
                    yield topic.removeprefix(prefix), message.log_time, message.data
            except UNREADABLE as error:
                if self.complete:
                    raise LogError(f"{self.path}: damaged: {_one_line(error)}") from error


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
        metadata = _read_metadata(file, stream)
        complete = _has_index(stream)
    if metadata.get("format_version") != FORMAT_VERSION:
        given = metadata.get("format_version")
        raise LogError(f"{file}: format version {given!r}, this package reads {FORMAT_VERSION!r}")
    if not metadata.get("epoch_ns", "").isdecimal():
        raise LogError(f"{file}: epoch_ns is {metadata.get('epoch_ns')!r}, a whole number of nanoseconds is expected")
    log = Log(file, metadata, {}, int(metadata["epoch_ns"]), complete)
    empty = True
    for topic, _, data in log.messages():
        empty = False
        if topic == SCENARIO:
            return replace(log, scenario=_read_scenario(file, data))
    raise LogError(f"{file}: " + ("empty: no message was written" if empty else "no scenario in it, cannot be used"))


def _read_scenario(file: Path, data: bytes) -> dict[str, Any]:
    try:
        return scenario_from_message(data)
    except UNREADABLE as error:
        raise LogError(f"{file}: scenario is unreadable: {_one_line(error)}") from error


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


def _read_metadata(file: Path, stream: IO[bytes]) -> dict[str, str]:
    """Find where the run comes from: the record is before the first message."""
    try:
        for record in StreamReader(stream, record_size_limit=RECORD_LIMIT).records:
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                return record.metadata
            if isinstance(record, Message):
                break
    except InvalidMagic as error:
        raise LogError(f"{file}: not a bag: no MCAP file") from error
    except UNREADABLE as error:
        raise LogError(f"{file}: not a bag, or empty: {_one_line(error)}") from error
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


def _qos_profile(topic: Topic) -> dict[str, Any]:
    return {
        "history": "keep_last",
        "depth": topic.depth,
        "reliability": topic.reliability,
        "durability": topic.durability,
        "deadline": dict(INFINITE),
        "lifespan": dict(INFINITE),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(INFINITE),
        "avoid_ros_namespace_conventions": False,
    }


def _yaml(value: object) -> str:
    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    yaml.width = 10_000  # characters; no folding
    yaml.representer.ignore_aliases = lambda _: True
    text = StringIO()
    yaml.dump(value, text)
    return text.getvalue()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
