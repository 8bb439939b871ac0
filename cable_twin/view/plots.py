"""Plots of a run: speeds beside their commands and references, tensions, swings, forces, loads, wind."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import cycle, islice, pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr

from cable_twin.frame.plotted_signals import SIGNALS, Signal
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.view.axes import LiveAxis, with_ticks
from cable_twin.view.geometry import entity_path, time_column
from cable_twin.view.labels import label_sizes
from cable_twin.view.sizes import LEGEND_ROW, TIME_LABELS

# readable on a dark ground and on a light one: a contrast of 3 or more with both
PLOT_COLORS = (0x2F8FE3FF, 0xC77C00FF, 0xE0525AFF, 0x2FA06AFF, 0x9A6EE0FF, 0xD05AA0FF)
LEGENDS = "legends"  # entities of the names of lines
LEGEND_GAP = 1.0  # pixels between two of them
LEGEND_SHARE = 0.45  # of the height of a plot, up to which it has a legend
UNSEEN = 0x00000001  # a colour that is not seen; one without any opacity would be drawn in another
AXIS = "(axis)"  # entity in a plot that makes it reach as far as numbers are wanted beside it
Values = Callable[[Columns], FloatArray]


class Plot:
    """Lines of one entity in a plot.

    Args:
        path: Of the entity.
        names: Of the lines.
        values: Takes the columns of so many frames and returns (frames, lines).
        color: Number of the first line's colour.
    """

    def __init__(self, path: str, names: Sequence[str], values: Values, color: int = 0) -> None:
        self.path = path
        self.signal = path.split("/")[1]
        self.names = list(names)
        self.values = values
        self.colors = list(islice(cycle(PLOT_COLORS), color, color + len(self.names)))
        # Wider below narrower: a few lines that coincide stay visible.
        self.widths = np.linspace(3.0, 1.5, len(names)) if 1 < len(names) <= 3 else np.full(len(names), 1.5)


class Plots:
    """All plots of a run.

    Args:
        layout: What is plotted.
        carriers: Names of vehicles that are plotted together.
        scale: That forces are drawn with.
        unit: Of forces.

    Attributes:
        signals: Those that are plotted, by name, in the order of their plots.
        spans: Signal -> lowest and highest value in its plot so far.
    """

    def __init__(self, layout: Layout, carriers: Collection[str], scale: float, unit: str) -> None:
        self._unit = unit
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
        """Log names and colours of the lines.

        Args:
            stream: Takes it.
            cells: Width and height in pixels of each signal's plot, its legend included.
            window: s, how much time up to the cursor is shown; None shows the whole run.
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
                unseen = rr.SeriesLines(names=[AXIS] * 2, colors=[UNSEEN] * 2, widths=[0.01] * 2)
                stream.log(entity_path(f"plots/{name}", AXIS), unseen, static=True)

    def axes(self, cells: Sequence[tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """Return the axis range of each signal for all values so far, with `cells` as in `begin`."""
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
        """Send the signal values of a batch."""
        times = time_column(c.time[:, 0])
        spans: dict[str, tuple[float, float]] = {}
        for plot in self._plots:
            scalars = np.ascontiguousarray(plot.values(c))
            stream.send_columns(plot.path, [times], rr.Scalars.columns(scalars=scalars), strict=True)
            _widen(spans, plot.signal, scalars)
            time.sleep(0)  # the frame loop may be waiting for the interpreter

        last = c.time[-1:, 0]
        for name, span in spans.items():
            _widen(self.spans, name, np.array(span))
            if name in self._live:
                axis = np.array([self._live[name].fitted(float(last[0]), *span)])
                columns = rr.Scalars.columns(scalars=axis)
                stream.send_columns(entity_path(f"plots/{name}", AXIS), [time_column(last)], columns, strict=True)


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
    """Return rows of names, with as many names in each as fit."""
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
    """Yield all lines of a signal in one plot."""
    if names := signal.names(layout):
        titles = signal.legend if len(signal.legend) == len(names) and len(layout.ropes) == 1 else names
        titles = signal.legend if signal.legend and signal.whose != "rope" else titles
        yield Plot(f"plots/{signal.name}", titles, partial(_values, signal, layout, scale))


def _one_by_one(signal: Signal, layout: Layout, _: Collection[str], scale: float) -> Iterator[Plot]:
    """Yield a plot for each line of a signal."""
    for index, name in enumerate(signal.names(layout)):
        values = partial(_column, signal, layout, scale, index)
        yield Plot(entity_path(f"plots/{signal.name}", name), [name], values, index)


def _values(signal: Signal, layout: Layout, scale: float, c: Columns) -> FloatArray:
    """Values (frames, lines) of a signal, forces times `scale`."""
    return signal.values(layout, c) * (scale if signal.unit == "N" else 1.0)


def _column(signal: Signal, layout: Layout, scale: float, index: int, c: Columns) -> FloatArray:
    return _values(signal, layout, scale, c)[:, index, None]


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
    """Yield the swing plot of each vehicle; for carriers least and most on the rope, and the first carrier.

    What else bodies have is drawn alike.
    """
    if not signal.names(layout):
        return
    color = 0
    together: list[_Bodies] = []
    for name, (first, last) in zip(layout.vehicles, pairwise(layout.first_body), strict=True):
        bodies = _Bodies(range(first, last), _titles(layout, name))
        if name in carriers:
            together.append(bodies)
        elif bodies.rows:
            yield Plot(
                entity_path(f"plots/{signal.name}", name), bodies.titles, partial(_swing, signal, layout, bodies), color
            )
            color += len(bodies.rows)
    if together:
        every = _Bodies(
            [row for bodies in together for row in bodies.rows],
            [title for bodies in together for title in bodies.titles],
        )
        if every.rows:
            titles = ["least", "most", *together[0].titles]
            yield Plot(
                f"plots/{signal.name}/carriers",
                titles,
                partial(_spread, signal, layout, every, len(together[0].rows)),
                color,
            )


class _Bodies(NamedTuple):
    """Bodies with a plotted swing."""

    rows: Sequence[int]
    titles: Sequence[str]


def _titles(layout: Layout, name: str) -> list[str]:
    """Return the shortest distinct titles of a vehicle's bodies."""
    bodies = layout.vehicles[name]
    if len(layout.vehicles) == 1:
        return list(bodies)
    return [name] if len(bodies) == 1 else [f"{name} {body}" for body in bodies]


def _swing(signal: Signal, layout: Layout, bodies: _Bodies, c: Columns) -> FloatArray:
    """Swing (frames, bodies) of bodies on the rope, NaN in a station."""
    return signal.values(layout, c)[:, bodies.rows]


def _spread(signal: Signal, layout: Layout, bodies: _Bodies, first: int, c: Columns) -> FloatArray:
    """Least and most swing (frames, 2 + first) of all bodies, and the swing of the `first` ones."""
    swings = _swing(signal, layout, bodies, c)
    return np.column_stack([np.fmin.reduce(swings, axis=1), np.fmax.reduce(swings, axis=1), swings[:, :first]])


# signals that are drawn otherwise than all together
MAKERS: Mapping[str, Maker] = {
    "speed": _speeds,
    "swing": _swings,
    "roll": _swings,
    "lateral": _swings,
    "drive_force": _one_by_one,
}
