"""What a sweep shows: each figure that has a limit over the swept value, and from where on it passes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cable_twin.key_figures import KeyFigure
from cable_twin.offline.sweep_runs import SweptRun


@dataclass(frozen=True, slots=True)
class SweptFigure:
    """One key figure with a limit, at all values; None where a run has no such figure."""

    name: str
    unit: str
    limit: float
    bound: str
    source: str
    values: Sequence[float]
    figures: Sequence[KeyFigure | None]

    @property
    def passed_at(self) -> float | None:
        """Value at which the limit is passed, between the runs before and after; None where it is kept throughout."""
        for number, figure in enumerate(self.figures):
            if figure is None or figure.kept is not False:
                continue
            before = self.figures[number - 1] if number else None
            if before is None:
                return self.values[number]
            share = (self.limit - before.value) / (figure.value - before.value)
            share = min(max(share, 0.0), 1.0) if math.isfinite(share) else 1.0
            return self.values[number - 1] + share * (self.values[number] - self.values[number - 1])
        return None

    @property
    def use(self) -> float:
        """How much of the limit is used where it is most, 1 at the limit."""
        return max(use_of(figure) for figure in self.figures if figure is not None)


@dataclass(frozen=True, slots=True)
class OperatingLimit:
    """The value at which the first limit is passed."""

    value: float
    figure: SweptFigure


def use_of(figure: KeyFigure) -> float:
    """How much of its limit a figure uses, 1 at the limit; a limit of 0 is used by what passes it."""
    limit = figure.limit
    assert limit is not None
    top, below = (figure.value, limit) if figure.bound == "at most" else (limit, figure.value)
    if limit < 0.0:  # least powers and travels: more of it is more use
        top, below = below, top
    if below <= 0.0 or top < 0.0:
        return math.inf if figure.kept is False else 0.0
    return top / below


def limited_figures(runs: Sequence[SweptRun]) -> list[SweptFigure]:
    """All figures with a limit, those that come nearest to theirs first."""
    values = [run.value for run in runs]
    by_run = [{figure.name: figure for figure in run.figures if figure.limit is not None} for run in runs]
    found = []
    for name in dict.fromkeys(name for run in by_run for name in run):
        figures = [run.get(name) for run in by_run]
        one = next(figure for figure in figures if figure is not None)
        assert one.limit is not None
        found.append(SweptFigure(name, one.unit, one.limit, one.bound, one.source, values, figures))
    return sorted(found, key=lambda figure: -figure.use)


def operating_limit(figures: Sequence[SweptFigure], rising: bool) -> OperatingLimit | None:
    """The first limit that is passed on the way; None where all are kept."""
    passed = [OperatingLimit(figure.passed_at, figure) for figure in figures if figure.passed_at is not None]
    return min(passed, key=lambda limit: limit.value if rising else -limit.value, default=None)


__all__ = ["OperatingLimit", "SweptFigure", "limited_figures", "operating_limit", "use_of"]
