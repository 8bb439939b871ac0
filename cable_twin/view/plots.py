"""Plots of a run: speeds beside their commands and references, tensions, swings, forces, loads, wind."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import cycle, islice, pairwise

import numpy as np
import rerun as rr

from cable_twin.frame.plotted_signals import SIGNALS, Signal
from cable_twin.frame.records import FloatArray, TensionAhead
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.view.batch import entity_path, time_column
from cable_twin.view.labels import label_sizes

TICKS = 3  # smallest number of tick labels of a plot
TICK_HEIGHT = 24.0  # pixels between two tick labels, below which rerun draws them pale, and below 20 not at all
EDGE = 0.12  # room for the outermost tick label over the distance between two ticks
FITTED = 1.1  # range of an axis that rerun fits to its data over the range of the data; measured
SMALLEST_SPAN = {"m/s": 0.1, "deg": 0.1, "m": 0.01, "N": 1.0, "kN": 0.1}  # a smaller one is drawn as a straight line
LEGEND_ROW = 22  # pixels, height of a row of a legend
TIME_LABELS = 17  # pixels, height of the time axis below a plot
# readable on a dark ground and on a light one: a contrast of 3 or more with both
PLOT_COLORS = (0x2F8FE3FF, 0xC77C00FF, 0xE0525AFF, 0x2FA06AFF, 0x9A6EE0FF, 0xD05AA0FF)
LEGENDS = "legends"  # root of the entities of legends
LEGEND_GAP = 1.0  # pixels between two names
LEGEND_SHARE = 0.45  # largest height of a legend over that of its plot
INVISIBLE = 0x00000001  # colour; rerun replaces one without any opacity
TENSION, AHEAD = "tension", "ahead"  # signal beside whose lines the outlook is drawn, and its entity
AXIS = "(axis)"  # entity of an invisible line that sets the range of a live plot


def with_ticks(low: float, high: float, unit: str, height: float) -> tuple[float, float]:
    """Return an axis range around `low` to `high` with at least `TICKS` tick labels in rerun.

    rerun labels the multiples of one power of ten, the smallest for which the axis has room.

    Args:
        low: lowest value.
        high: highest value.
        unit: unit of the values, which has a smallest span.
        height: height of the axis in pixels.
    """
    span = max(high - low, 1e-3 * max(abs(low), abs(high)), SMALLEST_SPAN.get(unit, 1e-3))
    middle, half = (low + high) / 2.0, 0.52 * span
    step = 10.0 ** np.ceil(np.log10(2.0 * half / _most(height)))
    while True:
        first, last = np.ceil((middle - half) / step), np.floor((middle + half) / step)
        while last - first + 1 < TICKS:  # add the nearer tick
            below = middle - half - (first - 1) * step < (last + 1) * step - middle - half
            edge = EDGE * step  # an axis of values of one sign, or hardly two, ends at 0
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
    """Return the maximum number of intervals between ticks on a vertical axis of a height in pixels."""
    return max(height / TICK_HEIGHT, TICKS)


def _ticks(low: float, high: float, height: float) -> int:
    """Return the number of tick labels on an axis of a plot."""
    step = 10.0 ** np.ceil(np.log10((high - low) / _most(height)) - 1e-9)
    return int(np.floor(high / step) - np.ceil(low / step)) + 1


class LiveAxis:
    """Axis of a live plot of the last seconds before the cursor, fitted by rerun to all data in the plot.

    Args:
        unit: unit of the values.
        height: height of the axis in pixels.
        window: shown time (s).
    """

    def __init__(self, unit: str, height: float, window: float) -> None:
        self._unit, self._height, self._window = unit, height / FITTED, window
        self._values: deque[tuple[float, float, float]] = deque()  # time (s), lowest and highest value
        self._axes: deque[tuple[float, float, float]] = deque()  # time (s) and range of axes in the plot

    def fitted(self, time: float, low: float, high: float) -> tuple[float, float]:
        """Return the axis range from a time (s) on, after adding values from `low` to `high`."""
        self._values.append((time, low, high))
        axis = with_ticks(*self._span(self._values, time), self._unit, self._height)
        self._axes.append((time, *axis))
        both = self._span(self._axes, time)
        if _ticks(*both, self._height) < TICKS:  # an earlier axis that is still in sight is far from the new one
            axis = with_ticks(*both, self._unit, self._height)
            self._axes[-1] = (time, *axis)
        return axis

    def _span(self, kept: deque[tuple[float, float, float]], time: float) -> tuple[float, float]:
        """Return the lowest and the highest kept value within the displayed time window, after dropping older ones."""
        while not time - self._window <= kept[0][0] <= time:
            kept.popleft()
        return min(low for _, low, _ in kept), max(high for _, _, high in kept)


Values = Callable[[Columns], FloatArray]


class Plot:
    """Lines of one rerun entity in a plot.

    Args:
        path: path of the entity.
        names: names of the lines.
        values: takes the columns of a batch, returns values (frames, lines).
        color: number of the first line's colour.
    """

    def __init__(self, path: str, names: Sequence[str], values: Values, color: int = 0) -> None:
        self.path = path
        self.signal = path.split("/")[1]
        self.names = list(names)
        self.values = values
        self.colors = list(islice(cycle(PLOT_COLORS), color, color + len(self.names)))
        # wider lines below narrower ones, so that coinciding lines stay visible
        self.widths = np.linspace(3.0, 1.5, len(names)) if 1 < len(names) <= 3 else np.full(len(names), 1.5)


class Plots:
    """All plots of signals of a run.

    Args:
        layout: layout of the frames.
        carriers: names of vehicles that are plotted together.
        scale: factor from N to the unit of forces.
        unit: unit of forces.

    Attributes:
        signals: names of the plotted signals, in the order of their plots.
        spans: signal -> lowest and highest value in its plot so far.
    """

    def __init__(self, layout: Layout, carriers: Collection[str], scale: float, unit: str) -> None:
        self._unit, self._ropes = unit, [*layout.ropes]
        self._live: dict[str, LiveAxis] = {}
        self.spans: dict[str, tuple[float, float]] = {}
        self._plots = [
            plot
            for signal in SIGNALS.values()
            if signal.view
            for plot in MAKERS.get(signal.name, _together)(signal, layout, carriers, scale)
        ]

        self.signals = tuple(dict.fromkeys(plot.signal for plot in self._plots))

    def begin(
        self, stream: rr.RecordingStream, cells: Sequence[tuple[float, float]], window: float | None = None
    ) -> None:
        """Log names and colours of all plotted lines.

        Args:
            stream: stream of the recording.
            cells: width and height in pixels of each signal's plot, legend included.
            window: time (s) shown before the cursor; None for the whole run.
        """
        for plot in self._plots:
            colors = np.array(plot.colors, dtype=np.uint32)
            stream.log(plot.path, rr.SeriesLines(names=plot.names, colors=colors, widths=plot.widths), static=True)
        for name, cell in zip(self.signals, cells, strict=True):
            self._begin_legend(stream, name, cell)
        if window is not None:
            units = self._heights(cells)
            self._live = {name: LiveAxis(*units[name], window) for name in self.signals}
            for name in self.signals:
                invisible = rr.SeriesLines(names=[AXIS] * 2, colors=[INVISIBLE] * 2, widths=[0.01] * 2)
                stream.log(entity_path(f"plots/{name}", AXIS), invisible, static=True)

    def axes(self, cells: Sequence[tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """Return the axis range of each signal for all recorded values; `cells` are widths and heights in pixels."""
        units = self._heights(cells)
        return {name: with_ticks(*span, *units[name]) for name, span in self.spans.items()}

    def _heights(self, cells: Sequence[tuple[float, float]]) -> dict[str, tuple[str, float]]:
        """Return unit and axis height in pixels by signal."""
        return {
            name: (
                shown_unit(SIGNALS[name], self._unit),
                cell[1] - LEGEND_ROW * len(self.legend_rows(name, cell)) - TIME_LABELS,
            )
            for name, cell in zip(self.signals, cells, strict=True)
        }

    def legend_rows(self, name: str, cell: tuple[float, float]) -> list[range]:
        """Return the legend rows of a signal as ranges of its lines, for a cell in pixels; empty without a legend."""
        names = [title for plot in self._plots if plot.signal == name for title in plot.names]
        rows = _shown_names(names, cell[0])
        return rows if len(names) > 1 and len(rows) * LEGEND_ROW <= LEGEND_SHARE * cell[1] else []

    def _begin_legend(self, stream: rr.RecordingStream, name: str, cell: tuple[float, float]) -> None:
        """Log the legend of a signal in a separate view, as rerun's own legend would hide the lines."""
        titles, colors = zip(
            *(
                (t, c)
                for plot in self._plots
                if plot.signal == name
                for t, c in zip(plot.names, plot.colors, strict=True)
            ),
            strict=True,
        )
        wide, places = label_sizes(titles)[:, 0], []
        rows = self.legend_rows(name, cell)
        for number, row in enumerate(rows):
            free = (cell[0] - wide[row].sum()) / len(row)  # pixels, half of it on both sides of each name
            middles = np.cumsum(wide[row] + free) - 0.5 * (wide[row] + free)
            places += [(middle, number * LEGEND_ROW) for middle in middles]
        if rows:
            names = rr.Points2D(
                places, colors=np.array(colors, dtype=np.uint32), radii=[0.0], labels=titles, show_labels=True
            )
            stream.log(f"{LEGENDS}/{name}", names, static=True)

    def send(self, stream: rr.RecordingStream, c: Columns) -> None:
        """Send the values of all plotted signals in a batch."""
        times = time_column(c.time[:, 0])
        spans: dict[str, tuple[float, float]] = {}
        for plot in self._plots:
            scalars = np.ascontiguousarray(plot.values(c))
            stream.send_columns(plot.path, [times], rr.Scalars.columns(scalars=scalars), strict=True)
            _widen(spans, plot.signal, scalars)
            time.sleep(0)  # lets the frame loop have the interpreter

        last = c.time[-1:, 0]
        for name, span in spans.items():
            _widen(self.spans, name, np.array(span))
            if name in self._live:
                axis = np.array([self._live[name].fitted(float(last[0]), *span)])
                columns = rr.Scalars.columns(scalars=axis)
                stream.send_columns(entity_path(f"plots/{name}", AXIS), [time_column(last)], columns, strict=True)

    def send_ahead(self, stream: rr.RecordingStream, ahead: Sequence[TensionAhead], scale: float) -> None:
        """Send the lowest and highest tensions that outlooks foresee, as a band around the plotted tensions.

        Args:
            stream: stream of the recording.
            ahead: foreseen tensions of each outlook, in order of time.
            scale: factor from N to the unit of forces.
        """
        path, values = f"plots/{TENSION}/{AHEAD}", np.array([(*one.lowest, *one.highest) for one in ahead]) * scale
        if TENSION not in self.signals:
            return
        ropes = self._ropes if len(self._ropes) > 1 else [""]
        names = [f"{rope} {side} ahead".lstrip() for side in ("lowest", "highest") for rope in ropes]
        colors = np.array([*islice(cycle(PLOT_COLORS), len(ropes))] * 2, dtype=np.uint32) & 0xFFFFFF80 | 0x80
        lines = rr.SeriesLines(names=names, colors=colors, widths=[0.8] * len(names))
        stream.log(path, lines, static=True)
        times = time_column(np.array([one.time for one in ahead]))
        stream.send_columns(path, [times], rr.Scalars.columns(scalars=values), strict=True)
        _widen(self.spans, TENSION, values)


def _widen(spans: dict[str, tuple[float, float]], name: str, values: FloatArray) -> None:
    """Widen the span of a signal by values, missing ones (NaN) ignored."""
    low, high = (float(limit.reduce(values, axis=None)) for limit in (np.fmin, np.fmax))
    if np.isfinite(low):
        before = spans.get(name, (low, high))
        spans[name] = min(low, before[0]), max(high, before[1])


def shown_unit(signal: Signal, forces: str) -> str:
    """Return the unit of a signal's plot, with the given unit for forces."""
    return forces if signal.unit == "N" else signal.unit


def _shown_names(names: Sequence[str], width: float) -> list[range]:
    """Return the rows of a legend as ranges of its names, with as many names in each row as fit."""
    rows: list[range] = []
    left = 0.0
    for number, wide in enumerate(label_sizes(names)[:, 0] + LEGEND_GAP):
        if not rows or wide > left:
            rows.append(range(number, number))
            left = width
        rows[-1] = range(rows[-1].start, number + 1)
        left -= wide
    return rows


Maker = Callable[[Signal, Layout, Collection[str], float], Iterator[Plot]]


def _together(signal: Signal, layout: Layout, _: Collection[str], scale: float) -> Iterator[Plot]:
    """Yield one plot with all lines of a signal."""
    if names := signal.names(layout):
        titles = [signal.words(name) for name in names]
        yield Plot(f"plots/{signal.name}", titles, partial(_values, signal, layout, scale, slice(None)))


def _one_by_one(signal: Signal, layout: Layout, _: Collection[str], scale: float) -> Iterator[Plot]:
    """Yield a plot for each line of a signal."""
    for index, name in enumerate(signal.names(layout)):
        values = partial(_values, signal, layout, scale, [index])
        yield Plot(entity_path(f"plots/{signal.name}", name), [name], values, index)


def _values(signal: Signal, layout: Layout, scale: float, lines: Sequence[int] | slice, c: Columns) -> FloatArray:
    """Values (frames, lines) of some lines of a signal, forces times `scale`."""
    return signal.values(layout, c)[:, lines] * (scale if signal.unit == "N" else 1.0)


def _speeds(signal: Signal, layout: Layout, _: Collection[str], __: float) -> Iterator[Plot]:
    """Yield the speed plot of each driven object, with command and reference where commanded."""
    names = signal.names(layout)
    beside = [other for other in SIGNALS.values() if other.beside == signal.name]
    color = 0
    for name in names:
        shown = [one for one in (signal, *beside) if name in one.names(layout)]
        titles = [one.label if len(names) == 1 else f"{name} {one.label}" for one in shown]
        yield Plot(entity_path("plots/speed", name), titles, partial(_of_name, shown, layout, name), color)
        color += len(shown)


def _of_name(signals: Sequence[Signal], layout: Layout, name: str, c: Columns) -> FloatArray:
    """Values (frames, signals) of several signals of one named object."""
    return np.stack([one.values(layout, c)[:, one.names(layout).index(name)] for one in signals], axis=1)


def _swings(signal: Signal, layout: Layout, carriers: Collection[str], _: float) -> Iterator[Plot]:
    """Yield a swing plot for each vehicle but carriers, and one for all carriers: range, and the first carrier's swing.

    Roll and lateral swing of bodies are plotted in this way too.
    """
    if not signal.names(layout):
        return
    path, color = f"plots/{signal.name}", 0
    together: list[int] = []  # bodies of carriers
    first: list[str] = []  # titles of the bodies of the first one
    for name, ends in zip(layout.vehicles, pairwise(layout.first_body), strict=True):
        rows, titles = range(*ends), _titles(layout, name)
        if name in carriers:
            first = first or titles
            together += rows
        elif rows:
            yield Plot(entity_path(path, name), titles, partial(_values, signal, layout, 1.0, rows), color)
            color += len(rows)
    if together:
        values = partial(_spread, signal, layout, together, len(first))
        yield Plot(f"{path}/carriers", ["least", "most", *first], values, color)


def _titles(layout: Layout, name: str) -> list[str]:
    """Return the shortest distinct titles of a vehicle's bodies."""
    bodies = layout.vehicles[name]
    if len(layout.vehicles) == 1:
        return list(bodies)
    return [name] if len(bodies) == 1 else [f"{name} {body}" for body in bodies]


def _spread(signal: Signal, layout: Layout, rows: Sequence[int], first: int, c: Columns) -> FloatArray:
    """Lowest and highest swing of bodies on the rope, then swings of the `first` bodies: (frames, 2 + first)."""
    swings = signal.values(layout, c)[:, rows]
    return np.column_stack([np.fmin.reduce(swings, axis=1), np.fmax.reduce(swings, axis=1), swings[:, :first]])


# makers of the plots of signals that are not drawn all together
MAKERS: Mapping[str, Maker] = {
    "speed": _speeds,
    "swing": _swings,
    "roll": _swings,
    "lateral": _swings,
    "drive_force": _one_by_one,
}
