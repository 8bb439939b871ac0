"""A run as a rosbag2 directory with one MCAP: written so that a kill or a power cut loses less than a second.

The file has profile ros2, CDR messages, ros2msg schemas with type hashes and QoS as rosbag2 writes them, zstd chunks
of at most half a second. Log time and publish time are the stamp of the message: the epoch of the run plus simulated
time. A metadata record `cable_twin` says where the run came from; with the scenario and the applied commands a log is
enough to repeat the run.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from io import StringIO
from pathlib import Path
from typing import IO, Any

from llvmlite.binding import get_host_cpu_name
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer
from ruamel.yaml import YAML

from cable_twin.messages import (
    NAMESPACE,
    SECOND,
    TYPESTORE,
    Topic,
    full_name,
)

FORMAT_VERSION = "1"
METADATA_NAME = "cable_twin"
SNAPSHOT_NAME = "snapshot.npz"
FLUSH_PERIOD = 0.4  # s of wall time that a kill or a power cut takes at most; a cut through a chunk takes two
INFINITE = {"sec": 9223372036, "nsec": 854775807}  # how rosbag2 writes a duration without end


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
        "cpu": get_host_cpu_name(),  # what the kernels were compiled for
        "scenario": scenario,
        "epoch_ns": str(epoch_ns),
        "frame_period": repr(frame_period),
        "sample_count": str(sample_count),
    }


class _PackedIndex:
    """The index of a chunk as the bytes that end up in the file, a sixth of the object that they are made from."""

    __slots__ = ("_record",)

    def __init__(self, index: ChunkIndex) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._record = builder.end()

    def write(self, builder: RecordBuilder) -> None:
        builder.write(self._record)


class _PackedIndexes(list[_PackedIndex]):
    """What a writer keeps of each chunk until it is closed."""

    def append(self, index: Any) -> None:
        super().append(_PackedIndex(index))


class _Writer(Writer):
    """A writer for days: at two chunks a second, the indexes of chunks would take 10 MB of memory an hour."""

    def __init__(self, stream: IO[bytes], compression: CompressionType) -> None:
        super().__init__(stream, compression=compression)
        self.packed = _PackedIndexes()
        self._Writer__chunk_indices = self.packed  # mcap has no door to it


class McapLog:
    """A log being written. Not for several threads at once."""

    def __init__(
        self,
        directory: Path,
        topics: Iterable[Topic],
        metadata: Mapping[str, str],
        *,
        namespace: str = NAMESPACE,
        snapshot: bytes | None = None,
    ) -> None:
        """Create the directory, the file with all its channels, and a metadata.yaml for the time until it is closed.

        Args:
            directory: Made where it does not exist; the file in it is named after it.
            topics: Everything that may be written.
            metadata: Where the run comes from, as `run_metadata` gives it; `epoch_ns` is needed.
            namespace: Full name of the node, in front of relative topic names.
            snapshot: Full state from which the run starts, attached; none where it starts as its scenario does.

        Raises:
            OSError: The disk refuses, or the log exists.
        """
        self.directory = directory
        self.path = directory / f"{directory.resolve().name}_0.mcap"
        self._namespace = namespace
        self._topics = {topic.name: topic for topic in topics}
        self._counts = dict.fromkeys(self._topics, 0)
        self._first_ns = 2**63 - 1
        self._last_ns = 0
        self._safe_ns = self._epoch_ns = int(metadata["epoch_ns"])
        self._readable_size = 0  # bytes; where the last complete flush ended
        directory.mkdir(parents=True, exist_ok=True)
        self._stream: IO[bytes] | None = self.path.open("xb")
        try:
            self._writer = _Writer(self._stream, compression=CompressionType.ZSTD)
            self._writer.start("ros2", f"cable_twin {_version('cable_twin')}; {LIBRARY_IDENTIFIER}")
            self._writer.add_metadata(
                METADATA_NAME,
                {
                    "format_version": FORMAT_VERSION,
                    "namespace": namespace,
                    "starts_from": SNAPSHOT_NAME if snapshot is not None else "scenario",
                    **metadata,
                },
            )
            if snapshot is not None:
                now = time.time_ns()
                self._writer.add_attachment(now, now, SNAPSHOT_NAME, "application/octet-stream", snapshot)
            self._channels = self._register()
            self._write_bag_metadata()
            self.flush()
            sync(directory)
            sync(directory.resolve().parent)
        except BaseException:
            self._abandon()
            raise

    @property
    def safe_until(self) -> float:
        """Simulated time (s) up to which nothing can be lost any more."""
        return (self._safe_ns - self._epoch_ns) / SECOND

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
        """Flush what has waited for a flush period; `write` does it too, call it where messages may stay away."""
        if time.monotonic() - self._flushed >= FLUSH_PERIOD:
            self.flush()

    def flush(self) -> None:
        """Finish the chunk and have it on the disk: from now on neither a kill nor a power cut can take it."""
        if self._stream is None:
            return
        try:
            self._writer.flush()
            os.fdatasync(self._stream.fileno())
            self._readable_size = self._stream.tell()
        except OSError:
            self._abandon()
            raise
        self._safe_ns = max(self._last_ns, self._epoch_ns)
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
            self._stream.flush()
            os.fdatasync(self._stream.fileno())
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
        try:
            new.write_text(_yaml({"rosbag2_bagfile_information": information}), encoding="utf-8")
            sync(new)  # or a power cut leaves an empty one under the final name
            new.replace(self.directory / "metadata.yaml")
        except OSError:
            with suppress(OSError):
                new.unlink()
            raise


def sync(path: Path) -> None:
    """Have a file, or the names in a directory, on the disk; raises OSError where the disk refuses."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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
