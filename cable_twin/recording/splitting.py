"""Rules for splitting the logs of a run into files and for removing the oldest files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

SECOND = 10**9  # ns; not that of messages, which loads numpy: options are understood without
MEGABYTE = 10**6  # bytes
SHORTEST = 1.0  # s
SMALLEST = 1.0  # MB, the size of a chunk
STATES = "snapshot_"  # with which the names of saved states begin, beside the files of a run
STATES_SHARE = 0.5  # of `keep_size`, that saved states may have; the files of the run get what they leave


class ClosedSize(NamedTuple):
    """Age and size of a closed log file, from which its removal is decided."""

    last_ns: int  # stamp (ns since 1970) of its last message
    size: int  # bytes, with the rerun recording of the same number


@dataclass(frozen=True, slots=True)
class Splitting:
    """Options for splitting a log into files and for keeping these files; 0 means no limit."""

    split_duration: float = 3600.0  # s of simulated time in a file
    split_size: float = 0.0  # MB of the MCAP file
    keep_age: float = 0.0  # s, highest age of the end of a closed file
    keep_size: float = 0.0  # MB of all files of a run and its saved states after a split

    def faults(self, called: Callable[[str], str] = str) -> list[str]:
        """Find contradictory limits for splitting and removing log files.

        Args:
            called: Name of an option in messages, by its name here.

        Returns:
            A line for each fault, with the given value and the allowed ones.
        """
        lowest = {"split_duration": (SHORTEST, "s"), "split_size": (SMALLEST, "MB")}
        faults = []
        for field in fields(self):
            value = getattr(self, field.name)
            low, unit = lowest.get(field.name, (0.0, "s" if field.name == "keep_age" else "MB"))
            if not (value == 0.0 or low <= value < float("inf")):
                allowed = f"0, or {low:g} {unit} and more" if low else f"0 {unit} and more"
                faults.append(f"{called(field.name)}: given {value:g} {unit}; allowed: {allowed}")
        if faults:
            return faults
        given = [called(name) for name in ("keep_age", "keep_size") if getattr(self, name)]
        if given and not (self.split_duration or self.split_size):
            both = f"{called('split_duration')} or {called('split_size')}"
            return [f"{' and '.join(given)}: given without splitting; allowed: with {both} above 0"]
        if 0.0 < self.keep_age < self.split_duration:
            faults.append(
                f"{called('keep_age')}: given {self.keep_age:g} s, less than a file; allowed: 0, or "
                f"{called('split_duration')} of {self.split_duration:g} s and more"
            )
        if 0.0 < self.keep_size < 2.0 * self.split_size:
            faults.append(
                f"{called('keep_size')}: given {self.keep_size:g} MB, less than two files; allowed: 0, or "
                f"twice {called('split_size')}, {2.0 * self.split_size:g} MB, and more"
            )
        return faults

    def surplus(self, closed: Sequence[ClosedSize], running: int, now_ns: int) -> int:
        """Number of log files to remove, from the oldest on, to keep the limits of age and size.

        Args:
            closed: All closed files, the oldest first.
            running: Bytes of the files that are being written, and of saved states.
            now_ns: Present stamp (ns since 1970).
        """
        oldest_ns = now_ns - round(self.keep_age * SECOND)
        allowed = self.keep_size * MEGABYTE
        total = running + sum(file.size for file in closed)
        for count, file in enumerate(closed):
            if not (self.keep_age and file.last_ns < oldest_ns) and not (allowed and total > allowed):
                return count
            total -= file.size
        return len(closed)


def size_of_states(directory: Path) -> int:
    """Size (bytes) of the full states saved in the directory of a run."""
    size = 0
    for file in directory.glob(f"{STATES}*"):
        with suppress(FileNotFoundError):
            size += file.stat().st_size
    return size


HOURLY = Splitting()
UNSPLIT = Splitting(split_duration=0.0)
