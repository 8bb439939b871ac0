"""Signals of a run over time in bounded memory, for plots and for the comparison of runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Snapshot

POINTS = 4000  # a signal is kept at; more are joined to pairs of lowest and highest
SHAPES = 24  # ropes that are kept
SAME = 5e-4  # s within which frames of two runs are of one time


def signal_values(snapshot: Snapshot) -> dict[str, float]:
    """Values of all plotted signals of a snapshot, by name QUANTITY/OBJECT.

    Signals that the log does not hold at this time are left out, as are partial signals of objects without them. NaN
    is a gap, as of a vehicle off the cable, or of a command of another kind.
    """
    c, layout = snapshot.columns, snapshot.layout
    found: dict[str, float] = {}
    told = bool(np.isfinite(layout.of_commanded(c.command_kind, c.drive_command_kind)).any())
    for signal in SIGNALS.values():
        values = signal.values(layout, c)
        gaps = told and signal.whose == "commanded"
        if not signal.plot or (np.isnan(values).all() and not gaps):
            continue
        names, everywhere = zip(signal.names(layout), values.tolist(), strict=True), signal.everywhere or gaps
        found |= {f"{signal.name}/{name}": value for name, value in names if everywhere or not math.isnan(value)}
    return found


def unit_of(signal: str) -> str:
    """Unit of a plotted signal from its name QUANTITY/OBJECT."""
    return SIGNALS[signal.partition("/")[0]].unit


class Series:
    """One signal of a run over time, in at most `POINTS` intervals with their lowest and highest value."""

    def __init__(self) -> None:
        self._times = np.empty(POINTS)
        self._low, self._high = np.empty(POINTS), np.empty(POINTS)
        self._count = 0
        self._stride = 1  # frames in a full stretch
        self._filled = 0  # frames in the last one

    def append(self, time: float, value: float) -> None:
        """Add one value of the signal at a time (s); times must increase."""
        if self._filled in (0, self._stride):
            if self._count == POINTS:
                self._halve()
            self._times[self._count], self._low[self._count], self._high[self._count] = time, value, value
            self._count += 1
            self._filled = 1
            return
        last = self._count - 1
        if value < self._low[last] or math.isnan(self._low[last]):
            self._low[last] = value
        if value > self._high[last] or math.isnan(self._high[last]):
            self._high[last] = value
        self._filled += 1

    def _halve(self) -> None:
        """Halve the number of intervals of the signal by merging neighbours in pairs."""
        half = POINTS // 2
        self._times[:half] = self._times[::2]
        self._low[:half] = np.fmin(self._low[::2], self._low[1::2])
        self._high[:half] = np.fmax(self._high[::2], self._high[1::2])
        self._count, self._stride = half, 2 * self._stride

    def line(self) -> tuple[FloatArray, FloatArray]:
        """Times (s) and values of the signal as a line to draw: original values, or low to high in each interval."""
        times, low, high = (array[: self._count] for array in (self._times, self._low, self._high))
        if self._stride == 1:
            return times.copy(), low.copy()
        return np.repeat(times, 2), np.column_stack([low, high]).ravel()


@dataclass(frozen=True, slots=True)
class Shape:
    """Rope shape and places of the carriages of a run at one time."""

    time: float  # s
    positions: FloatArray  # (n, 3) m
    carriages: Mapping[str, FloatArray]  # (3,) m, of the joint


class Signals:
    """All plotted signals of one run over time, and its rope shape at evenly spaced times."""

    def __init__(self) -> None:
        self.series: dict[str, Series] = {}
        self._shapes: list[Shape] = []
        self._stride = 1
        self._frames = 0

    def update(self, snapshot: Snapshot, values: Mapping[str, float]) -> None:
        """Add one snapshot of the run and the values of its signals."""
        for name, value in values.items():
            if name not in self.series:
                if math.isnan(value):
                    continue  # no line begins with a gap
                self.series[name] = Series()
            self.series[name].append(snapshot.time, value)
        if np.isnan(snapshot.columns.rope_position[0, 0]):
            return  # the log did not hold the rope at this time
        if self._frames % self._stride == 0:
            if len(self._shapes) == 2 * SHAPES:
                self._shapes = self._shapes[::2]
                self._stride *= 2
            if self._frames % self._stride == 0:
                self._shapes.append(_shape(snapshot))
        self._frames += 1

    def shapes(self) -> list[Shape]:
        """At most `SHAPES` rope shapes of the run, evenly spaced from the first to about the last."""
        return self._shapes[:: -(-len(self._shapes) // SHAPES) or 1]


def _shape(snapshot: Snapshot) -> Shape:
    c = snapshot.columns
    rows = [(name, row) for row, name in enumerate(snapshot.layout.vehicles) if c.attached[row] == 1.0]
    joints = {name: c.joint_position[row].copy() for name, row in rows if not np.isnan(c.joint_position[row, 0])}
    gap = np.full((1, 3), np.nan)  # between ropes
    ropes = [row for part in snapshot.layout.ropes.values() for row in (c.rope_position[part], gap)][:-1]
    return Shape(snapshot.time, np.concatenate(ropes), joints)


@dataclass(slots=True)
class Difference:
    """Difference of one signal between two runs, round the loop for places on one: largest, root mean square."""

    loop: float = math.inf  # length of the loop in the unit of the signal, for a place on one
    largest: float = 0.0  # in the unit of the signal
    time: float = math.nan  # s, of the largest
    values: tuple[float, float] = (math.nan, math.nan)  # of both runs there
    squares: float = 0.0
    count: int = 0

    @property
    def rms(self) -> float:
        """Root mean square of the difference of the signal between both runs."""
        return math.sqrt(self.squares / self.count) if self.count else math.nan

    def update(self, time: float, first: float, second: float) -> None:
        """Add the values of the signal in both runs at one time (s)."""
        difference = first - second
        if math.isnan(difference):
            return
        if self.loop < math.inf:
            difference -= self.loop * round(difference / self.loop)
        self.squares += difference * difference
        self.count += 1
        if abs(difference) > self.largest or math.isnan(self.time):
            self.largest, self.time, self.values = abs(difference), time, (first, second)


@dataclass(slots=True)
class Comparison:
    """Comparison of the signals of two runs at common frames: differences by signal, signals of one run only."""

    differences: dict[str, Difference] = field(default_factory=dict)
    frames: int = 0
    only_in: tuple[set[str], set[str]] = field(default_factory=lambda: (set(), set()))
    loops: Mapping[str, float] = field(default_factory=dict)  # length of the loop by signal, of places on one

    def take(self, time: float, first: Mapping[str, float], second: Mapping[str, float]) -> None:
        """Add the signals of a frame that both runs have at one time (s)."""
        self.frames += 1
        for name, value in first.items():
            if name in second and not math.isnan(value - second[name]):
                if name not in self.differences:
                    self.differences[name] = Difference(loop=self.loops.get(name, math.inf))
                self.differences[name].update(time, value, second[name])


Frames = Iterator[tuple[float, Mapping[str, float]]]


def compare(first: Frames, *others: Frames, loops: Mapping[str, float] | None = None) -> list[Comparison]:
    """Compare the signals of a run with those of other runs at frames of equal time, within the tolerance `SAME`.

    Args:
        first: Time (s) and values by signal of each frame of the run.
        others: Times and values of the other runs; all are read side by side to their ends.
        loops: Length of the loop by signal, of places on one; other places are on none.

    Returns:
        A comparison with the first run for each other run.
    """
    results = [Comparison(loops=loops or {}) for _ in others]
    named: list[set[str]] = [set() for _ in others]
    own: set[str] = set()
    runs = [_noting(run, names) for run, names in zip(others, named, strict=True)]
    heads = [next(run, None) for run in runs]
    for time, values in _noting(first, own):
        for index, run in enumerate(runs):
            head = heads[index]
            while head is not None and head[0] <= time - SAME:
                head = next(run, None)
            if head is not None and head[0] < time + SAME:
                results[index].take(time, values, head[1])
                head = next(run, None)
            heads[index] = head
    for run, names, result in zip(runs, named, results, strict=True):
        for _ in run:
            pass
        result.only_in = (own - names, names - own)
    return results


def _noting(frames: Frames, names: set[str]) -> Frames:
    """Pass on frames and add the names of their signals to a set, as a log may hold signals at a few frames only."""
    for frame in frames:
        names.update(frame[1])
        yield frame
