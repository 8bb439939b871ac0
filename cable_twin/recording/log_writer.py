"""Log of a run as a rosbag2 directory of MCAP files, with less than a second lost by a kill or a power cut.

Files have profile ros2, CDR messages, ros2msg schemas with type hashes and QoS as rosbag2 writes them, zstd chunks
of at most half a second. Log time and publish time are the stamp of the message: the epoch of the run plus simulated
time. A metadata record `cable_twin` at the start of each file has the origin of the run and the number of the file;
with the scenario, the applied commands and, where a file does not start as the scenario does, the attached full
state, each file is enough to repeat its part of the run.
"""

from __future__ import annotations

import json
import platform
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import Any

from cable_twin.basics.arithmetic import arithmetic
from cable_twin.basics.files import sync
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.language.fingerprint import sources
from cable_twin.mechanics.language.target import target
from cable_twin.messages import SECOND, FrameNames, Topic, TopicNames
from cable_twin.messages.columns import columns_metadata
from cable_twin.recording.bag_metadata import BagFile, BagTopics
from cable_twin.recording.mcap_file import SNAPSHOT_NAME, McapFile, package_version
from cable_twin.recording.splitting import ClosedSize, Splitting, size_of_states

FORMAT_VERSION = "5"
PACKAGE = Path(__file__).resolve().parents[1]
OF_RESULTS = ("basics", "mechanics", "scenario", "frame", "geometry", "key_figures", "simulation", "ensemble")
AFTER_LOSS = "after_loss"  # key of the metadata of a file before which something is missing
LOST_FROM = "commands_lost_from"  # stamp (ns since 1970) after which commands are missing, of a file that was repaired
SCENARIO_TEXT, SCENARIO_CHECKSUM = "scenario_text", "scenario_crc32"


def program_metadata() -> dict[str, str]:
    """Log metadata about versions, machine and arithmetic, on which the bits of a result depend."""
    return {
        "package_version": package_version("cable_twin"),
        "python_version": platform.python_version(),
        "numpy_version": package_version("numpy"),
        "numba_version": package_version("numba"),
        "machine": f"{platform.system()} {platform.machine()}",
        "cpu": target().name,  # which the kernels are compiled for: a class of CPUs, or this one
        "arithmetic": arithmetic(),
    }


def program_sources() -> str:
    """Fingerprint of all source files of the package that results depend on, from scenarios to key figures."""
    return sources(*(PACKAGE / room for room in OF_RESULTS)).fingerprint


def run_metadata(
    scenario: Mapping[str, Any], layout: Layout, *, frame_period: float, frames: FrameNames | None = None
) -> dict[str, str]:
    """Log metadata about the origin of a run: versions, scenario, frame period, layout of its frames.

    Args:
        scenario: The whole scenario, resolved; a second copy of it with a checksum is in each file, in case the chunk
            with its message is damaged.
        layout: Of the frames.
        frame_period: s of simulated time between frames.
        frames: Names of coordinate frames; the default names where None.

    Returns:
        The metadata for `McapLog`.
    """
    text = json.dumps(scenario, ensure_ascii=False)
    return {
        **program_metadata(),
        "scenario": str(scenario.get("name", "")),
        "frame_period": repr(frame_period),
        "sample_count": str(layout.arc_lengths.size // len(layout.ropes)),
        **(frames or FrameNames()).metadata,
        **columns_metadata(layout),
        SCENARIO_TEXT: text,
        SCENARIO_CHECKSUM: str(zlib.crc32(text.encode())),
    }


@dataclass(frozen=True, slots=True)
class _Closed:
    number: int
    contents: BagFile


class McapLog:
    """Writer of the log of a run, in one MCAP file after the other; not for several threads at once."""

    def __init__(
        self,
        directory: Path,
        topics: Iterable[Topic],
        metadata: Mapping[str, str],
        *,
        names: TopicNames | None = None,
        number: int = 0,
    ) -> None:
        """Create the directory, the first file with all its channels, and a provisional metadata.yaml.

        Args:
            directory: Of the log, made where it does not exist; the files in it are named after it.
            topics: Everything that may be written.
            metadata: Origin of the run, from `run_metadata`.
            names: Full names of topics; the default names where None.
            number: Of the first file.

        Raises:
            OSError: The disk refuses, or the log exists.
        """
        self.directory = directory
        self._names = names or TopicNames()
        self._topics = BagTopics(tuple(topics), self._names)
        self._metadata = dict(metadata)
        self._epoch_ns: int | None = None  # until it begins
        self._closed: list[_Closed] = []
        self._ended = False
        directory.mkdir(parents=True, exist_ok=True)
        self._number = number
        self._file = McapFile(self.path_of(number), self._topics)
        try:
            self._write_bag_metadata(running=True)
            sync(directory.resolve().parent)
        except BaseException:
            self._abandon()
            raise

    @property
    def path(self) -> Path:
        """Path of the log file being written."""
        return self._file.path

    @property
    def number(self) -> int:
        """Number of the log file being written."""
        return self._number

    @property
    def size(self) -> int:
        """Size (bytes) of the file being written; readable from any thread."""
        return self._file.size

    @property
    def safe_until(self) -> float:
        """Simulated time (s) up to which all data of the log is safe on disk."""
        stamps = (self._file.safe_ns, *(closed.contents.last_ns for closed in self._closed[-1:]))
        return max(max(stamps) - (self._epoch_ns or 0), 0) / SECOND

    def path_of(self, number: int) -> Path:
        """Path of a file of the log by its number; the rerun recording beside it has the suffix .rrd."""
        return self.directory / f"{self.directory.resolve().name}_{number}.mcap"

    def begin(self, epoch_ns: int, snapshot: bytes | None = None, *, lost_from_ns: int | None = None) -> None:
        """Write the metadata of the run into the first file of the log, before the first message.

        Args:
            epoch_ns: Wall time (ns since 1970) of simulated time zero.
            snapshot: Full state from which the run starts, attached; None where it starts as its scenario does.
            lost_from_ns: Stamp (ns since 1970) after which commands are missing in the first file, if any.

        Raises:
            OSError: The disk refuses; the log can only be closed.
        """
        self._epoch_ns = epoch_ns
        try:
            self._begin_file(snapshot, lost_from_ns)
        except OSError:
            self._abandon()
            raise

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Append one message to the log.

        Args:
            topic: Name as in the topics given, relative or absolute.
            stamp_ns: Stamp (ns since 1970) of the message.
            data: CDR.

        Raises:
            OSError: The disk refuses; messages flushed before stay readable, and the log can only be closed.
        """
        if self._epoch_ns is None:
            raise ValueError(f"{self.path}: the log has not begun")
        self._file.write(topic, stamp_ns, data)

    def flush_if_due(self) -> None:
        """Flush messages of the log older than a flush period, as `write` does; to call where messages are rare."""
        self._file.flush_if_due()

    def flush(self) -> None:
        """Flush all messages of the log to disk, safe from a kill or a power cut."""
        self._file.flush()

    def split(
        self,
        snapshot: bytes | None,
        number: int | None = None,
        *,
        after_loss: bool = False,
        lost_from_ns: int | None = None,
    ) -> None:
        """Close the present file of the log and continue in the next one.

        Args:
            snapshot: Full state from which the next file starts, attached.
            number: Of the next file; by default the next number.
            after_loss: Whether its metadata tell that data is missing before it.
            lost_from_ns: Stamp (ns since 1970) in its metadata after which commands are missing in it, if any.

        Raises:
            OSError: The disk refuses; all closed files stay readable, and the log can only be closed.
        """
        if self._ended or not self._file.is_open:
            raise ValueError(f"{self.path}: log is closed")
        self._close_file()
        self._go_on(snapshot, self._number + 1 if number is None else number, lost_from_ns, after_loss=after_loss)

    def move(self, directory: Path, snapshot: bytes | None, number: int) -> None:
        """Continue the log in another directory after the loss of the present one.

        Args:
            directory: Existing directory.
            snapshot: Full state from which the next file starts, attached.
            number: Of the next file.

        Raises:
            OSError: The disk refuses; the log can only be closed.
        """
        self._file.abandon()
        self.directory, self._closed, self._ended = directory, [], False
        self._go_on(snapshot, number, None, after_loss=True)

    @property
    def is_gone(self) -> bool:
        """Whether the log file being written was deleted or moved."""
        return self._file.is_gone

    def _go_on(self, snapshot: bytes | None, number: int, lost_from_ns: int | None, *, after_loss: bool) -> None:
        """Begin the next file of the log."""
        try:
            self._file = McapFile(self.path_of(number), self._topics)
        except OSError:
            self._ended = True
            raise
        self._number = number
        try:
            self._begin_file(snapshot, lost_from_ns, after_loss=after_loss)
            self._write_bag_metadata(running=True)
        except OSError:
            self._abandon()
            with suppress(OSError):
                self.path.unlink()  # nothing is in it, and metadata.yaml does not name it yet
            raise

    def remove_oldest(self, splitting: Splitting, now_ns: int) -> None:
        """Remove the oldest closed files of the log beyond its limits of age and size, with their rerun recordings.

        Args:
            splitting: Limits of age and size.
            now_ns: Present stamp (ns since 1970).

        Raises:
            OSError: The disk refuses; the log can go on.
        """
        if not (splitting.keep_age or splitting.keep_size):
            return
        sizes = [ClosedSize(closed.contents.last_ns, self._size_of(closed.number)) for closed in self._closed]
        others = self._size_of(self._number) + size_of_states(self.directory)
        count = splitting.surplus(sizes, others, now_ns)
        if not count:
            return
        removed, self._closed = self._closed[:count], self._closed[count:]
        try:
            self._write_bag_metadata(running=True)  # which never names a file that is gone
        except OSError:
            self._closed = removed + self._closed
            raise
        for closed in removed:
            for path in self._paths_of(closed.number):
                path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the log: write the index and the final metadata.yaml; a second call does nothing.

        Raises:
            OSError: The disk refuses; the file is closed nevertheless, and messages flushed before are readable.
        """
        if not self._ended and self._file.is_open:
            self._close_file()
        self._ended = True

    def _begin_file(self, snapshot: bytes | None, lost_from_ns: int | None, *, after_loss: bool = False) -> None:
        own = {"format_version": FORMAT_VERSION, "epoch_ns": str(self._epoch_ns), **self._names.metadata}
        which = {"starts_from": "scenario" if snapshot is None else SNAPSHOT_NAME, "file": str(self._number)}
        if after_loss:
            which[AFTER_LOSS] = "true"
        if lost_from_ns is not None:
            which[LOST_FROM] = str(lost_from_ns)
        self._file.begin({**own, **self._metadata, **which}, snapshot)

    def _close_file(self) -> None:
        try:
            self._file.close()
            self._closed.append(_Closed(self._number, self._file.contents))
            self._write_bag_metadata(running=False)
        except OSError:
            self._ended = True
            raise

    def _abandon(self) -> None:
        self._ended = True
        self._file.abandon()

    def _paths_of(self, number: int) -> tuple[Path, Path]:
        bag = self.path_of(number)
        return bag, bag.with_suffix(".rrd")

    def _size_of(self, number: int) -> int:
        """Size (bytes) of a file of the log, by its number, with its rerun recording."""
        size = 0
        for path in self._paths_of(number):
            with suppress(FileNotFoundError):
                size += path.stat().st_size
        return size

    def _write_bag_metadata(self, *, running: bool) -> None:
        """Write metadata.yaml of the log atomically by rename, with all closed files and the one being written."""
        files = [closed.contents for closed in self._closed]
        if running:
            files.append(self._file.contents)
        text = f"rosbag2_bagfile_information:\n{indent(self._topics.information(files), '  ')}"
        new = self.directory / "metadata.yaml.new"
        try:
            new.write_text(text, encoding="utf-8")
            sync(new)  # or a power cut leaves an empty one under the final name
            new.replace(self.directory / "metadata.yaml")
            sync(self.directory)
        except OSError:
            with suppress(OSError):
                new.unlink()
            raise
