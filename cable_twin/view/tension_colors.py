"""Colour scales of rope tension, common to rerun and RViz."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray

COLOR_COUNT = 24  # colours between low and high tension; neighbours of one colour share one line
# visible on a dark and on a light background
COLOR_STOPS = (0x3B8BFFFF, 0x1FAFC8FF, 0x45BB66FF, 0xCCA40AFF, 0xF08324FF, 0xF03E34FF)
_PLACES = np.linspace(0.0, 1.0, len(COLOR_STOPS))
_CHANNELS = np.array([[stop >> shift & 0xFF for stop in COLOR_STOPS] for shift in (24, 16, 8, 0)]) / 255.0


class TensionColors:
    """Tension range of the colour scale of one rope: starts around the first tensions and only ever widens."""

    def __init__(self) -> None:
        self.low = 0.0
        self.high = 1.0
        self.lowest = 0.0  # lowest tension so far, without outliers

    def start(self, tensions: FloatArray) -> None:
        """Set the range from the tensions of the first snapshot, with margin for a moving carriage."""
        low, high = float(tensions.min()), float(tensions.max())
        self.lowest = low
        room = max(0.5 * (high - low), 0.03 * max(abs(low), abs(high)))
        self._span(low - room, high + room)

    def widen(self, tensions: FloatArray) -> bool:
        """Widen the range to a batch of tensions, except for few outliers; returns whether the range has changed."""
        if tensions.min() >= self.low and tensions.max() <= self.high:
            return False
        low, high = (float(value) for value in np.percentile(tensions, (2.0, 98.0)))
        if low >= self.low and high <= self.high:
            return False
        self.lowest = min(self.lowest, low)
        room = 0.25 * (max(high, self.high) - min(low, self.low))
        self._span(low - room if low < self.low else self.low, high + room if high > self.high else self.high)
        return True

    def _span(self, low: float, high: float) -> None:
        """Set the tensions (N) at both ends of the colour scale, rounded outwards to round numbers."""
        slack = low < 0.0 and self.lowest >= 0.0  # no range for tensions that do not occur
        low = 0.0 if slack else low
        width = max(high - low, 0.1)
        step = 10.0 ** np.floor(np.log10(width / 4.0))
        step *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if width / (step * factor) <= 8.0)
        self.low = float(step * np.floor(low / step))
        self.high = float(step * np.ceil(high / step))


class RopeColors:
    """Colour scales of the tensions of several ropes, each with its own range.

    Args:
        ropes: name -> samples of the rope among those of all ropes.

    Attributes:
        scales: name -> colour scale of the rope.
    """

    def __init__(self, ropes: Mapping[str, slice]) -> None:
        self._parts = dict(ropes)
        self._started: set[str] = set()
        self.scales = {name: TensionColors() for name in ropes}

    def widen(self, tensions: FloatArray) -> bool:
        """Widen ranges to tensions (samples,) or (frames, samples), NaN ignored; returns whether any has changed."""
        changed = False
        for name, part in self._parts.items():
            own = tensions[..., part]
            known = own[~np.isnan(own)]
            if not known.size:
                continue
            if name not in self._started:
                self._started.add(name)
                self.scales[name].start(known[: own.shape[-1]])
                changed = True
            changed |= self.scales[name].widen(known)
        return changed

    def bins(self, tensions: FloatArray, ropes: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the colour of each stretch of rope between two points, as index into the table of colours.

        Args:
            tensions: (frames, n).
            ropes: (frames, n - 1) number of the rope of each stretch.
        """
        low, width = (part[ropes] for part in self._ranges())
        middle = (tensions[:, 1:] + tensions[:, :-1]) / 2.0
        scaled = (middle - low) * (COLOR_COUNT / width)
        # fmax gives an unknown tension the lowest colour
        return np.fmin(np.fmax(scaled, 0.0), COLOR_COUNT - 1.0).astype(np.intp)

    def rgba(self, tensions: FloatArray, ropes: NDArray[np.intp]) -> FloatArray:
        """Return the colour (n, 4), channels from 0 to 1, of points with tensions (n,) on the ropes of indices (n,)."""
        low, width = (part[ropes] for part in self._ranges())
        share = np.fmin(np.fmax((tensions - low) / width, 0.0), 1.0)
        return np.column_stack([np.interp(share, _PLACES, channel) for channel in _CHANNELS])

    def captions(self, unit: str, scale: float = 1.0) -> list[str]:
        """Return texts with name and tension range of each rope, converted from N to `unit` by the factor `scale`."""
        return [f"{name}: {one.low * scale:g} to {one.high * scale:g} {unit}" for name, one in self.scales.items()]

    def _ranges(self) -> tuple[FloatArray, FloatArray]:
        """Lowest tension and width of the range of each rope (ropes,)."""
        low, high = np.array([(one.low, one.high) for one in self.scales.values()]).T
        return low, high - low


def color_table() -> NDArray[np.uint32]:
    """Return the colours from low to high tension as RGBA."""
    where = np.linspace(0.0, 1.0, COLOR_COUNT)
    red, green, blue = (np.interp(where, _PLACES, 255.0 * channel).astype(np.uint32) for channel in _CHANNELS[:3])
    return red << 24 | green << 16 | blue << 8 | np.uint32(255)


COLOR_TABLE = color_table()
