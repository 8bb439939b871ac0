"""Conversion of places and times for rerun.

rerun's plane has its second axis downwards: what is (x, z) in `cable_twin.frame.records` is drawn at (x, -z), where a
right-handed pitch about the lateral axis is an ordinary rotation from the first axis to the second.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray

TIMELINE = "sim_time"
QUIET = 0x747D8FFF  # readable on dark and on light ground
DOWNWARDS = np.array([1.0, -1.0])


def planar(vector: FloatArray) -> FloatArray:
    """Return a view (…, 2), x and z, of vectors (…, 3)."""
    return vector[..., ::2]


def plane(points: FloatArray) -> FloatArray:
    """Convert (…, 2) x and z into rerun's plane, or back."""
    return points * DOWNWARDS


def pixels(radius: float) -> list[float]:
    """Return a radius in screen points independent of the zoom, in rerun a negative number."""
    return [-radius]


def entity_path(parent: str, name: str) -> str:
    """Return the entity path of a child with any name."""
    return f"{parent}/{rr.escape_entity_path_part(name)}"


def time_column(times: Sequence[float] | FloatArray) -> rr.TimeColumn:
    """Return times in seconds as an index, rounded to the nanosecond."""
    nanoseconds = np.rint(np.asarray(times, dtype=np.float64) * 1e9).astype("timedelta64[ns]")
    return rr.TimeColumn(TIMELINE, duration=nanoseconds)


def rows_without_gaps(*arrays: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return a mask (frames,) of frames with all numbers of arrays (frames, ...) known."""
    complete = [~np.isnan(array.reshape(len(array), -1)).any(axis=1) for array in arrays]
    return np.logical_and.reduce(complete)
