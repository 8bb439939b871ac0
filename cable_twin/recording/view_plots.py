"""What is plotted of a run: speeds beside those commanded, tensions, swings, drive forces, loads of towers, wind."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import cycle, islice, pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr

from cable_twin.plotted_signals import SIGNALS, Signal, driven_names
from cable_twin.recording.view_geometry import entity_path, time_column
from cable_twin.records import AppliedCommand, Command, FloatArray
from cable_twin.snapshot import Columns, Layout

# readable on a dark ground and on a light one: a contrast of 3 or more with both
PLOT_COLORS = (0x2F8FE3FF, 0xC77C00FF, 0xE0525AFF, 0x2FA06AFF, 0x9A6EE0FF, 0xD05AA0FF)
LEGENDS = "legends"  # entities of the names of lines
LEGEND_GAP = 4  # letters between two of them
LEGEND_ROW = 56  # letters that a row of them has room for
LEGEND_HEIGHT = 0.06  # of a row, per line of the plot that it is wide
Values = Callable[[Columns, FloatArray], FloatArray]


class Plot:
    """The lines of one entity in a plot.

    Args:
        path: Of the entity.
        names: Of the lines.
        values: Takes the columns of so many frames and the commanded speeds (frames, driven) in m/s, and returns
            (frames, lines).
        color: Number of the first line's colour.
    """

    def __init__(self, path: str, names: Sequence[str], values: Values, color: int = 0) -> None:
        self.path = path
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

    Attributes:
        spans: Signal -> lowest and highest value in its plot so far.
    """

    def __init__(self, layout: Layout, carriers: Collection[str], scale: float) -> None:
        self._movers = driven_names(layout)
        self.spans: dict[str, tuple[float, float]] = {}
        self._plots = [
            plot
            for signal in SIGNALS.values()
            if signal.view
            for plot in MAKERS.get(signal.name, _together)(signal, layout, carriers, scale)
        ]

    def __iter__(self) -> Iterator[Plot]:
        return iter(self._plots)

    def begin(self, stream: rr.RecordingStream) -> None:
        """Name and colour the lines."""
        for plot in self._plots:
            colors = np.array(plot.colors, dtype=np.uint32)
            stream.log(plot.path, rr.SeriesLines(names=plot.names, colors=colors, widths=plot.widths), static=True)
        for name in dict.fromkeys(plot.path.split("/")[1] for plot in self._plots):
            self._begin_legend(stream, name)

    def _widen(self, name: str, values: FloatArray) -> None:
        low, high = (float(limit.reduce(values, axis=None)) for limit in (np.fmin, np.fmax))
        if np.isfinite(low):
            before = self.spans.get(name, (low, high))
            self.spans[name] = min(low, before[0]), max(high, before[1])

    def legend(self, name: str) -> list[list[tuple[str, int]]]:
        """Names and colours of all lines of a signal, in rows that they fit into."""
        rows: list[list[tuple[str, int]]] = []
        left = 0
        for plot in self._plots:
            if plot.path.split("/")[1] == name:
                for title, color in zip(plot.names, plot.colors, strict=True):
                    if not rows or len(title) + LEGEND_GAP > left:
                        rows.append([])
                        left = LEGEND_ROW
                    rows[-1].append((title, color))
                    left -= len(title) + LEGEND_GAP
        return rows

    def _begin_legend(self, stream: rr.RecordingStream, name: str) -> None:
        """Name all lines of a signal in a view of their own: rerun's legend would hide them."""
        rows, places = self.legend(name), []
        lines = sum(map(len, rows))
        for number, row in enumerate(rows):
            widths = np.array([len(title) + LEGEND_GAP for title, _ in row])  # a long name takes more of the row
            middles = (np.cumsum(widths) - 0.5 * widths) * lines / widths.sum() - 0.5
            places += [(middle, number * LEGEND_HEIGHT * lines) for middle in middles]
        titles = [title for row in rows for title, _ in row]
        colors = np.array([color for row in rows for _, color in row], dtype=np.uint32)
        names = rr.Points2D(places, colors=colors, radii=[0.0], labels=titles, show_labels=True)
        stream.log(f"{LEGENDS}/{name}", names, static=True)

    def send(self, stream: rr.RecordingStream, c: Columns, commanded: CommandedSpeeds) -> None:
        """Send the values of a batch."""
        times = time_column(c.time[:, 0])
        speeds = commanded.at(c.time[:, 0], self._movers)
        for plot in self._plots:
            scalars = np.ascontiguousarray(plot.values(c, speeds))
            stream.send_columns(plot.path, [times], rr.Scalars.columns(scalars=scalars), strict=True)
            self._widen(plot.path.split("/")[1], scalars)
            time.sleep(0)  # the frame loop may be waiting for the interpreter


class CommandedSpeeds:
    """The speed that each thing is commanded to have, over time."""

    def __init__(self) -> None:
        self._now: dict[str, float] = {}  # m/s by name, NaN for a force
        self._waiting: deque[tuple[float, dict[str, float]]] = deque()  # from a time (s) on: no two of one time

    def note(self, applied: AppliedCommand) -> None:
        """Take a command, from its time on; of those at one time, as while time stands, only what they come to."""
        before = self._waiting[-1][1] if self._waiting else self._now
        if self._waiting and self._waiting[-1][0] == applied.time:
            self._waiting.pop()
        self._waiting.append((applied.time, _obeyed(before, applied.command)))

    def at(self, times: FloatArray, names: Sequence[str]) -> FloatArray:
        """Return (frames, names) m/s at times (frames,) in s, later than those before; NaN where none is commanded."""
        speeds = np.empty((len(times), len(names)))
        first = 0
        while True:
            speeds[first:] = [self._now.get(name, np.nan) for name in names]
            if not self._waiting or self._waiting[0][0] > times[-1]:
                return speeds
            since, self._now = self._waiting.popleft()
            first = max(first, int(np.searchsorted(times, since)))


def _obeyed(speeds: Mapping[str, float], command: Command) -> dict[str, float]:
    """Commanded speeds after a command."""
    if command.kind == "speed":
        return {**speeds, **command.values}
    if command.kind == "force":
        return {**speeds, **dict.fromkeys(command.values, np.nan)}
    if command.kind == "emergency_stop":
        return dict.fromkeys(speeds, 0.0)
    return {} if command.kind in ("release", "reset") else dict(speeds)


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


def _values(signal: Signal, layout: Layout, scale: float, c: Columns, _: FloatArray) -> FloatArray:
    """Values (frames, lines), forces times `scale`."""
    return signal.values(layout, c) * (scale if signal.unit == "N" else 1.0)


def _column(signal: Signal, layout: Layout, scale: float, index: int, c: Columns, none: FloatArray) -> FloatArray:
    return _values(signal, layout, scale, c, none)[:, index, None]


def _speeds(signal: Signal, layout: Layout, _: Collection[str], __: float) -> Iterator[Plot]:
    """Yield the speed of all that is driven, beside what is commanded."""
    names = signal.names(layout)
    for index, name in enumerate(names):
        titles = ["speed", "commanded"] if len(names) == 1 else [name, f"{name} commanded"]
        yield Plot(entity_path("plots/speed", name), titles, partial(_speed, signal, layout, index), 2 * index)


def _speed(signal: Signal, layout: Layout, index: int, c: Columns, commanded: FloatArray) -> FloatArray:
    return np.column_stack([signal.values(layout, c)[:, index], commanded[:, index]])


def _swings(signal: Signal, layout: Layout, carriers: Collection[str], _: float) -> Iterator[Plot]:
    """Yield the swing of each vehicle; of carriers the least and most of those on the rope, and the first one.

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
    """Bodies whose swing is plotted."""

    rows: Sequence[int]
    titles: Sequence[str]


def _titles(layout: Layout, name: str) -> list[str]:
    """Return the titles of a vehicle's bodies, no longer than they must be."""
    bodies = layout.vehicles[name]
    if len(layout.vehicles) == 1:
        return list(bodies)
    return [name] if len(bodies) == 1 else [f"{name} {body}" for body in bodies]


def _swing(signal: Signal, layout: Layout, bodies: _Bodies, c: Columns, _: FloatArray) -> FloatArray:
    """Swing (frames, bodies) of bodies on the rope, NaN of those that hang in a station."""
    return signal.values(layout, c)[:, bodies.rows]


def _spread(
    signal: Signal, layout: Layout, bodies: _Bodies, first: int, c: Columns, commanded: FloatArray
) -> FloatArray:
    """Least and most swing (frames, 2 + first) of all bodies, and that of the `first` ones."""
    swings = _swing(signal, layout, bodies, c, commanded)
    return np.column_stack([np.fmin.reduce(swings, axis=1), np.fmax.reduce(swings, axis=1), swings[:, :first]])


# signals that are drawn otherwise than all together
MAKERS: Mapping[str, Maker] = {
    "speed": _speeds,
    "swing": _swings,
    "roll": _swings,
    "lateral": _swings,
    "drive_force": _one_by_one,
}
