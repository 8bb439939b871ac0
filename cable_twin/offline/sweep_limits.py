"""Limits in a sweep: first swept value at which each is not kept, and windows with all limits kept."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy  # loads `interpolate` where it is used: a fifth of a second, not of each command

from cable_twin.key_figures import FigureId, KeyFigure
from cable_twin.key_figures.figure import TOLERANCE


@dataclass(frozen=True, slots=True)
class SweptRun:
    """Result of the run at one swept value: key figures, error, refused commands."""

    value: float
    figures: Sequence[KeyFigure]
    fault: str = ""  # reason of an early end or a failed start
    refused: Sequence[str] = ()  # commands, a line each


@dataclass(frozen=True, slots=True)
class SweptFigure:
    """Key figure with a limit at all swept values, in the order of the sweep; None for runs without the figure."""

    id: FigureId
    name: str
    unit: str
    bound: str
    source: str
    values: Sequence[float]
    figures: Sequence[KeyFigure | None]

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest limit of the key figure, which differ where the limit itself is swept."""
        limits = [one.limit for one in self.figures if one is not None and one.limit is not None]
        return min(limits), max(limits)

    @property
    def use(self) -> float:
        """Largest utilisation of the limit of the key figure over the sweep, 1 at the limit."""
        return max(use_of(figure) for figure in self.figures if figure is not None)

    @property
    def worst(self) -> tuple[float, KeyFigure]:
        """First swept value with the largest utilisation of the limit, and the key figure there."""
        there = [(value, one) for value, one in zip(self.values, self.figures, strict=True) if one is not None]
        return max(there, key=lambda item: use_of(item[1]))

    @property
    def passed_at(self) -> float | None:
        """First swept value at which the limit is not kept; None where it is kept throughout."""
        for place, figure in enumerate(self.figures):
            if figure is not None and figure.kept is False:
                before = self.figures[place - 1] if place else None
                return self.values[place] if before is None else self.crossing(place - 1)
        return None

    def passed(self) -> Iterator[tuple[float, float]]:
        """Ranges of swept values (least, most) with a limit not kept; infinite where the sweep ends in a range."""
        first, last = None, len(self.values) - 1
        for place, figure in enumerate(self.figures):
            broken = figure is not None and figure.kept is False
            if broken and first is None:
                first = place
            if first is not None and (not broken or place == last):
                beyond = math.copysign(math.inf, self.values[-1] - self.values[0])
                start = self.crossing(first - 1) if first else -beyond
                end = beyond if broken else self.crossing(place - 1)
                yield (start, end) if start < end else (end, start)
                first = None

    def crossing(self, gap: int) -> float:
        """Interpolated swept value at which the key figure meets its limit, between run `gap` and the next one.

        The curve through all runs is a monotone cubic, as wind loads grow with the square of the speed. Where a run
        beside the gap lacks the figure, the value of the run that keeps the limit is returned.
        """
        before, after = self.figures[gap], self.figures[gap + 1]
        ends = self.values[gap], self.values[gap + 1]
        if before is None or after is None:
            return ends[0] if after is not None and after.kept is False else ends[1]
        points = sorted(
            (value, beyond)
            for value, one in zip(self.values, self.figures, strict=True)
            if one is not None and math.isfinite(beyond := beyond_limit(one))
        )
        low, high = sorted(ends)
        through = scipy.interpolate.PchipInterpolator(*np.array(points).T) if len(points) > 1 else None
        found = [root for root in through.roots(extrapolate=False) if low <= root <= high] if through else []
        if found:
            return float(found[0])
        here, there = beyond_limit(before), beyond_limit(after)  # a limit is kept to a thousandth: none in between
        return ends[0] if abs(here) < abs(there) else ends[1]


@dataclass(frozen=True, slots=True)
class Edge:
    """End of a window of a sweep, a range of swept values with all limits kept.

    Attributes:
        value: swept value.
        figure: figure whose limit is not kept beyond the end; None where the sweep ends there, or a run failed.
        run: value of the outermost run within the window.
    """

    value: float
    figure: SweptFigure | None
    run: float


@dataclass(frozen=True, slots=True)
class Window:
    """Window of a sweep: range of swept values with all limits kept."""

    low: Edge
    high: Edge


def beyond_limit(figure: KeyFigure) -> float:
    """Excess of a key figure over its limit, in the unit of the figure; negative where the limit is kept."""
    assert figure.limit is not None
    return figure.value - figure.limit if figure.bound == "at most" else figure.limit - figure.value


def use_of(figure: KeyFigure) -> float:
    """Utilisation of the limit of a key figure, 1 at the limit; infinite for any excess over a limit of 0."""
    limit = figure.limit
    assert limit is not None
    top, below = (figure.value, limit) if figure.bound == "at most" else (limit, figure.value)
    if limit < 0.0:  # lowest powers and travels: utilisation grows downwards
        top, below = below, top
    if below <= 0.0 or top < 0.0:
        return math.inf if figure.kept is False else 0.0
    return top / below


def keeps_all(run: SweptRun) -> bool:
    """Whether a run of a sweep has reached its end with all limits kept."""
    return not run.fault and not any(figure.kept is False for figure in run.figures)


def limited_figures(runs: Sequence[SweptRun]) -> list[SweptFigure]:
    """Key figures of a sweep with a limit: those not kept in the order of the sweep, then by decreasing utilisation.

    Of limits that are not kept from the first run on, the one not kept longest comes first.
    """
    values = [run.value for run in runs]
    by_run = [{figure.id: figure for figure in run.figures if figure.limit is not None} for run in runs]
    found = []
    for key in dict.fromkeys(key for run in by_run for key in run):
        figures = [run.get(key) for run in by_run]
        one = next(figure for figure in figures if figure is not None)
        found.append(SweptFigure(key, one.name, one.unit, one.bound, one.source, values, figures))
    sense = 1.0 if values[-1] >= values[0] else -1.0

    def order(figure: SweptFigure) -> tuple[float, ...]:
        at = figure.passed_at
        broken = sum(one is not None and one.kept is False for one in figure.figures)
        return (math.inf, 0, -figure.use) if at is None else (sense * at, -broken, -figure.use)

    return sorted(found, key=order)


def windows_of(runs: Sequence[SweptRun], figures: Sequence[SweptFigure]) -> list[Window]:
    """All windows of a sweep with all limits kept, in the order of the sweep."""
    found: list[Window] = []
    first = 0
    for last, run in enumerate(runs):
        if not keeps_all(run):
            first = last + 1
            continue
        if last + 1 == len(runs) or not keeps_all(runs[last + 1]):
            edges = edge(runs, figures, first, first - 1), edge(runs, figures, last, last + 1)
            low, high = sorted(edges, key=lambda one: one.value)
            found.append(Window(low, high))
    return found


def edge(runs: Sequence[SweptRun], figures: Sequence[SweptFigure], inside: int, outside: int) -> Edge:
    """End of a window of a sweep between a run inside and its neighbour outside, both given by index."""
    value = runs[inside].value
    if not 0 <= outside < len(runs) or runs[outside].fault:
        return Edge(value, None, value)
    gap = min(inside, outside)
    broken = [figure for figure in figures if (one := figure.figures[outside]) is not None and one.kept is False]
    found = [Edge(figure.crossing(gap), figure, value) for figure in broken]
    return min(found, key=lambda one: abs(one.value - value))


def unsure_gaps(runs: Sequence[SweptRun], figures: Sequence[SweptFigure], least: float) -> Iterator[tuple[int, float]]:
    """Gaps between runs of a sweep with an imprecisely known window end, each with the next value to try.

    Args:
        runs: in the order of the sweep.
        figures: key figures of the runs with limits.
        least: smallest gap to refine.
    """
    for gap, (one, other) in enumerate(pairwise(runs)):
        if one.fault or other.fault or abs(other.value - one.value) <= least:
            continue
        kept = keeps_all(one), keeps_all(other)
        if all(kept):
            continue
        if any(kept):
            inside, outside = (gap, gap + 1) if kept[0] else (gap + 1, gap)
            end = edge(runs, figures, inside, outside)
            assert end.figure is not None
            last = end.figure.figures[inside]
            sure = last is not None and abs(beyond_limit(last)) <= TOLERANCE * abs(last.limit or 0.0)
            if not sure:
                yield gap, end.value
            continue
        broken = [
            {figure.id: figure for figure in figures if (it := figure.figures[row]) is not None and it.kept is False}
            for row in (gap, gap + 1)
        ]
        if broken[0].keys() & broken[1].keys():
            continue
        # limits not kept in the first run may be kept before those of the second one are not
        again = max(abs(figure.crossing(gap) - one.value) for figure in broken[0].values())
        until = min(abs(figure.crossing(gap) - one.value) for figure in broken[1].values())
        if again < until:
            yield gap, one.value + math.copysign(0.5 * (again + until), other.value - one.value)
