"""Batches of frames for rerun: buffer, gaps, thinning, and conversion of places and times.

rerun's plane has its second axis downwards: (x, z) of `cable_twin.frame.records` is drawn at (x, -z), where a
right-handed pitch about the lateral axis is an ordinary rotation from the first axis to the second.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout, Snapshot

TIMELINE = "sim_time"
QUIET = 0x747D8FFF  # colour readable on a dark and on a light background
DOWNWARDS = np.array([1.0, -1.0])
DRAWN = (  # drawn columns that may have gaps
    "arc_length",
    "speed",
    "drive_force",
    "joint_position",
    "attached",
    "body_position",
    "body_angles",
    "support_travel",
    "tower_load",
    "drive_position",
    "drive_speed",
    "moving_cable_force",
    "rope_position",
    "rope_tension",
    "lowest_tension",
    "highest_tension",
    "sheave_tension",
    "sheave_travel",
    "sheave_slip",
)


def planar(vector: FloatArray) -> FloatArray:
    """Return the components x and z (…, 2) of vectors (…, 3), as a view of the array."""
    return vector[..., ::2]


def plane(points: FloatArray) -> FloatArray:
    """Convert points (…, 2), x and z upwards, into rerun's plane with the second axis downwards, or back."""
    return points * DOWNWARDS


def pixels(radius: float) -> list[float]:
    """Return a radius in screen points independent of the zoom, in rerun a negative number."""
    return [-radius]


def entity_path(parent: str, name: str) -> str:
    """Return the rerun path of a child entity, with its name escaped."""
    return f"{parent}/{rr.escape_entity_path_part(name)}"


def time_column(times: Sequence[float] | FloatArray) -> rr.TimeColumn:
    """Return times (s) as a time column of rerun, rounded to the nanosecond."""
    nanoseconds = np.rint(np.asarray(times, dtype=np.float64) * 1e9).astype("timedelta64[ns]")
    return rr.TimeColumn(TIMELINE, duration=nanoseconds)


def send(
    stream: rr.RecordingStream, path: str, times: FloatArray, columns: Iterable[rr.ComponentColumn], count: int = 0
) -> None:
    """Send the columns of a rerun entity at times (frames,) in s, then yield the interpreter lock to other threads.

    Args:
        stream: stream of the recording.
        path: path of the entity.
        times: times (frames,) in s.
        columns: columns with a row, or `count` rows, for each frame.
        count: instances of the entity in each frame; 0 for columns with a row for each.
    """
    rows = [column.partition([count] * len(times)) for column in columns] if count else columns
    stream.send_columns(path, [time_column(times)], rows, strict=True)
    time.sleep(0)


def rows_without_gaps(*arrays: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return a mask (frames,) of the frames in which no array (frames, ...) has a NaN."""
    complete = [~np.isnan(array.reshape(len(array), -1)).any(axis=1) for array in arrays]
    return np.logical_and.reduce(complete)


class Batch:
    """Buffer for the values of several frames, which are sent to rerun together."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._count = 0
        self._numbers: FloatArray = np.empty((0, 0))
        self._last: dict[str, FloatArray] = {}  # last row of each column in the previous batch

    def add(self, snapshot: Snapshot) -> bool:
        """Add the values of a snapshot, with the same layout in all calls; returns whether the batch is full."""
        if not self._numbers.size:
            self._numbers = np.empty((self._frames, snapshot.layout.size))
        self._numbers[self._count] = snapshot.numbers
        self._count += 1
        return self._count == self._frames

    def take(self, layout: Layout) -> Columns:
        """Return the columns of the buffered frames, valid until the next frame is added.

        Missing numbers (NaN) are replaced by the last known ones, if there are any.
        """
        c, self._count = layout.columns(self._numbers[: self._count]), 0
        if len(c.time):
            for name in DRAWN:
                column = getattr(c, name).reshape(len(c.time), -1)  # a view
                _hold(column, self._last.get(name))
                self._last[name] = column[-1].copy()
        return c


def frame_of(c: Columns, row: int) -> Columns:
    """Return the columns of a single frame of a batch."""
    return Columns(*(column[row] for column in c))


def first_known(c: Columns) -> Columns:
    """Return the first frame of a batch, with each NaN replaced by the next valid value of the same quantity."""
    return Columns(*(_first_known(column) for column in c))


def _first_known(column: FloatArray) -> FloatArray:
    missing = np.isnan(column[0])
    if not missing.any():
        return column[0]
    first: FloatArray = column[0].copy()
    part = column[:, missing]
    first[missing] = part[np.argmin(np.isnan(part), axis=0), np.arange(part.shape[1])]
    return first


def _hold(column: FloatArray, before: FloatArray | None) -> None:
    """Fill each NaN in (frames, k) with the last valid value of its column, starting from the row `before` (k,)."""
    with np.errstate(invalid="ignore", over="ignore"):
        gaps = np.flatnonzero(np.isnan(column.sum(axis=0)))
    if not gaps.size:
        return
    part = column[:, gaps]
    if before is not None:
        part[0] = np.where(np.isnan(part[0]), before[gaps], part[0])
    missing = np.isnan(part)
    if missing.all():  # columns that never have values
        return
    rows = np.where(missing, 0, np.arange(len(part))[:, None])
    column[:, gaps] = np.take_along_axis(part, np.maximum.accumulate(rows, axis=0), axis=0)


class Thinning:
    """Selection of the frames that are drawn, at a `rate` (Hz) at most, across batches."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self.restart()

    def restart(self) -> None:
        """Select the next frame regardless of the rate."""
        self._last = np.nan

    def rows(self, times: FloatArray) -> NDArray[np.intp]:
        """Return the selected rows among the times (frames,) in s: the first of each period."""
        periods = np.floor(times * self._rate + 1e-3)  # rounding of the time may not skip one
        new = np.flatnonzero(np.diff(periods, prepend=self._last))
        self._last = periods[-1]
        return new
