"""The rope as lines coloured by tension."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from cable_twin.recording.view_geometry import DOWNWARDS
from cable_twin.records import FloatArray

COLOR_COUNT = 24  # colours between low and high tension; neighbours of one colour share one line
COLOR_STOPS = (0x3B8BFFFF, 0x35C9E0FF, 0x6FE08AFF, 0xF4E04DFF, 0xFF9838FF, 0xFF4338FF)


class TensionColors:
    """The range of tensions that the colours span: it starts around the first rope and only ever widens."""

    def __init__(self) -> None:
        self.low = 0.0
        self.high = 1.0
        self.lowest = 0.0  # of the tensions so far, outliers aside

    def start(self, tensions: FloatArray) -> None:
        """Span the tensions of the first snapshot, with room for what a moving carriage adds."""
        low, high = float(tensions.min()), float(tensions.max())
        self.lowest = low
        room = max(0.5 * (high - low), 0.03 * max(abs(low), abs(high)))
        self._span(low - room, high + room)

    def widen(self, tensions: NDArray[np.float32]) -> bool:
        """Widen the range where a batch leaves it, a few single samples aside; say whether it did."""
        low, high = (float(value) for value in np.percentile(tensions, (2.0, 98.0)))
        if low >= self.low and high <= self.high:
            return False
        self.lowest = min(self.lowest, low)
        room = 0.25 * (max(high, self.high) - min(low, self.low))
        self._span(low - room if low < self.low else self.low, high + room if high > self.high else self.high)
        return True

    def bins(self, tensions: NDArray[np.float32]) -> NDArray[np.intp]:
        """Return the colour of each stretch of rope between two samples, as index into the table of colours."""
        middle = (tensions[:, 1:] + tensions[:, :-1]) / 2.0
        scaled = (middle - self.low) * (COLOR_COUNT / (self.high - self.low))
        return np.clip(scaled, 0, COLOR_COUNT - 1).astype(np.intp)

    def _span(self, low: float, high: float) -> None:
        """Set the range, rounded outwards to numbers that read well."""
        slack = low < 0.0 and self.lowest >= 0.0  # a colour for tensions that do not occur
        low = 0.0 if slack else low
        width = max(high - low, 0.1)
        step = 10.0 ** np.floor(np.log10(width / 4.0))
        step *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if width / (step * factor) <= 8.0)
        self.low = float(step * np.floor(low / step))
        self.high = float(step * np.ceil(high / step))


def rope_columns(points: NDArray[np.float32], bins: NDArray[np.intp]) -> list[rr.ComponentColumn]:
    """Return the rope of several frames as lines of one colour each.

    Args:
        points: (frames, n, 2) m, in x and z.
        bins: (frames, n - 1) colour of each stretch.
    """
    frames, count = bins.shape
    starts = np.ones((frames, count), dtype=bool)
    starts[:, 1:] = bins[:, 1:] != bins[:, :-1]
    # A sample between two colours ends one line and starts the next.
    copies = np.ones((frames, count + 1), dtype=np.intp)
    copies[:, 1:-1] += starts[:, 1:]
    flat = np.repeat(points.reshape(-1, 2) * np.float32(DOWNWARDS), copies.ravel(), axis=0)
    first = np.flatnonzero(starts)
    lengths = np.diff(first, append=starts.size) + 1
    offsets = np.concatenate(([0], np.cumsum(lengths))).astype(np.int32)
    lines = pa.ListArray.from_arrays(offsets, rr.components.Position2DBatch(flat).as_arrow_array(), type=_LINES_TYPE)
    columns = rr.LineStrips2D.columns(strips=lines, colors=COLOR_TABLE[bins.ravel()[first]])
    return [column.partition(starts.sum(axis=1)) for column in columns]


def color_table() -> NDArray[np.uint32]:
    """Return the colours from low to high tension as RGBA."""
    stops = np.array([[stop >> shift & 0xFF for shift in (24, 16, 8)] for stop in COLOR_STOPS], dtype=np.float64)
    where = np.linspace(0.0, len(stops) - 1.0, COLOR_COUNT)
    red, green, blue = (np.interp(where, np.arange(len(stops)), channel).astype(np.uint32) for channel in stops.T)
    return red << 24 | green << 16 | blue << 8 | np.uint32(255)


COLOR_TABLE = color_table()
_LINES_TYPE = rr.components.LineStrip2DBatch([]).as_arrow_array().type
