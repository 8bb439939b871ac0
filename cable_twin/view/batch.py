"""Buffer of the numbers of many frames, drawn together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout, Snapshot

DRAWN = (  # columns that may have gaps, and are drawn
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


class Batch:
    """Buffer for a number of frames; a snapshot costs one copy of its numbers."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._count = 0
        self._numbers: FloatArray = np.empty((0, 0))
        self._last: dict[str, FloatArray] = {}  # row of each column in the batch before

    def add(self, snapshot: Snapshot) -> bool:
        """Add the numbers of a snapshot, always of one layout; returns whether the batch is full."""
        if not self._numbers.size:
            self._numbers = np.empty((self._frames, snapshot.layout.size))
        self._numbers[self._count] = snapshot.numbers
        self._count += 1
        return self._count == self._frames

    def take(self, layout: Layout) -> Columns:
        """Return the columns of the buffered frames, to be drawn before the next frame is added.

        Where a number is missing (NaN) it is the last one known; it stays missing until there is one.
        """
        c, self._count = layout.columns(self._numbers[: self._count]), 0
        if len(c.time):
            for name in DRAWN:
                column = getattr(c, name).reshape(len(c.time), -1)  # a view
                _hold(column, self._last.get(name))
                self._last[name] = column[-1].copy()
        return c


def frame(c: Columns, row: int) -> Columns:
    """Return the columns of one frame of a batch."""
    return Columns(*(column[row] for column in c))


def first_known(c: Columns) -> Columns:
    """Return the first frame of a batch, with each missing number (NaN) replaced by its first known one."""
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
    """Fill missing numbers (NaN) in (frames, k) with the last known one, starting from the row `before` (k,)."""
    with np.errstate(invalid="ignore", over="ignore"):
        gaps = np.flatnonzero(np.isnan(column.sum(axis=0)))
    if not gaps.size:
        return
    part = column[:, gaps]
    if before is not None:
        part[0] = np.where(np.isnan(part[0]), before[gaps], part[0])
    missing = np.isnan(part)
    if missing.all():  # what something never has
        return
    rows = np.where(missing, 0, np.arange(len(part))[:, None])
    column[:, gaps] = np.take_along_axis(part, np.maximum.accumulate(rows, axis=0), axis=0)


class Thinning:
    """Selection of frames at a `rate` (Hz) at most, across batches."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self.restart()

    def restart(self) -> None:
        """Select the next frame in any case."""
        self._last = np.nan

    def rows(self, times: FloatArray) -> NDArray[np.intp]:
        """Return the selected rows among the times (frames,) in s: the first of each period."""
        periods = np.floor(times * self._rate + 1e-3)  # rounding of the time may not skip one
        new = np.flatnonzero(np.diff(periods, prepend=self._last))
        self._last = periods[-1]
        return new
