"""Ranges of plot axes for which rerun draws tick labels."""

from __future__ import annotations

from collections import deque

import numpy as np

TICKS = 3  # of a plot, wanted at least
TICK_HEIGHT = 24.0  # pixels between two numbers, below which rerun leaves them pale, and from 20 on away
EDGE = 0.12  # of the distance between two ticks: room for the number of the outermost
FITTED = 1.1  # times what it shows, an axis that rerun fits to it; measured
SMALLEST_SPAN = {"m/s": 0.1, "deg": 0.1, "m": 0.01, "N": 1.0, "kN": 0.1}  # less is a line at rest


def with_ticks(low: float, high: float, unit: str, height: float) -> tuple[float, float]:
    """Return an axis range around `low` to `high` with at least `TICKS` tick labels in rerun.

    It writes the multiples of one power of ten, the smallest for which an axis of so many pixels has room.

    Args:
        low: In the unit.
        high: The same.
        unit: In which a span may be too small to be seen.
        height: Of the plot, in pixels.
    """
    span = max(high - low, 1e-3 * max(abs(low), abs(high)), SMALLEST_SPAN.get(unit, 1e-3))
    middle, half = (low + high) / 2.0, 0.52 * span
    step = 10.0 ** np.ceil(np.log10(2.0 * half / _most(height)))
    while True:
        first, last = np.ceil((middle - half) / step), np.floor((middle + half) / step)
        while last - first + 1 < TICKS:  # the nearer one next
            below = middle - half - (first - 1) * step < (last + 1) * step - middle - half
            edge = EDGE * step  # 0 is the end of what has one sign, or hardly two
            below = (below or (last >= 0.0 and low < high <= edge)) and not (first <= 0.0 and high > low >= -edge)
            if below:
                first -= 1
            else:
                last += 1
        axis = min(middle - half, (first - EDGE) * step), max(middle + half, (last + EDGE) * step)
        if _ticks(*axis, height) >= TICKS:
            return float(axis[0]), float(axis[1])
        step *= 10.0


def _most(height: float) -> float:
    """Return the maximum number of tick distances on an axis of a height in pixels."""
    return max(height / TICK_HEIGHT, TICKS)


def _ticks(low: float, high: float, height: float) -> int:
    """Return the number of tick labels of an axis."""
    step = 10.0 ** np.ceil(np.log10((high - low) / _most(height)) - 1e-9)
    return int(np.floor(high / step) - np.ceil(low / step)) + 1


class LiveAxis:
    """Axis of a live plot of the last seconds up to the cursor, fitted by rerun to all data in the plot.

    Args:
        unit: Of its values.
        height: Of the plot, in pixels.
        window: s, how much time it shows.
    """

    def __init__(self, unit: str, height: float, window: float) -> None:
        self._unit, self._height, self._window = unit, height / FITTED, window
        self._values: deque[tuple[float, float, float]] = deque()  # s, lowest and highest
        self._axes: deque[tuple[float, float, float]] = deque()  # those that are still in the plot

    def fitted(self, time: float, low: float, high: float) -> tuple[float, float]:
        """Return the axis from a time (s) on, after adding values from `low` to `high`."""
        self._values.append((time, low, high))
        axis = with_ticks(*self._span(self._values, time), self._unit, self._height)
        self._axes.append((time, *axis))
        both = self._span(self._axes, time)
        if _ticks(*both, self._height) < TICKS:  # an earlier axis that is still in sight is far from the new one
            axis = with_ticks(*both, self._unit, self._height)
            self._axes[-1] = (time, *axis)
        return axis

    def _span(self, kept: deque[tuple[float, float, float]], time: float) -> tuple[float, float]:
        """Return the lowest and the highest number of the last seconds, after dropping older ones."""
        while not time - self._window <= kept[0][0] <= time:
            kept.popleft()
        return min(low for _, low, _ in kept), max(high for _, _, high in kept)


__all__ = ["TICKS", "LiveAxis", "with_ticks"]
