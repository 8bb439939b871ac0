"""One key figure: value, unit, when and where it was reached, and its limit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from cable_twin.key_figures.extremes import Extremes

Bound = Literal["at most", "at least"]
TOLERANCE = 1e-3  # of a limit


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One figure with its limit."""

    name: str
    value: float
    unit: str
    time: float  # s, when it was reached
    place: str = ""  # where, with unit
    limit: float | None = None
    bound: Bound = "at most"
    source: str = ""  # of the limit

    @property
    def kept(self) -> bool | None:
        """Whether the limit is kept, to a thousandth of it, as a drive keeps its speed; None without a limit."""
        if self.limit is None:
            return None
        beyond = self.value - self.limit if self.bound == "at most" else self.limit - self.value
        return beyond <= TOLERANCE * abs(self.limit)


def figure_of(extremes: Extremes, index: int, name: str, unit: str, at: str = "arc length") -> KeyFigure:
    """The figure without a limit; NaN where there never was a value."""
    place = extremes.places[index]
    return KeyFigure(
        name,
        extremes.value(index),
        unit,
        float(extremes.times[index]),
        "" if math.isnan(place) else f"{at} {place:.1f} m",
    )


def with_limit(figure: KeyFigure, limit: float | None, source: str, bound: Bound = "at most") -> KeyFigure:
    """The figure with a limit and where that comes from; as it is where there is none."""
    return figure if limit is None else replace(figure, limit=limit, bound=bound, source=source)


__all__ = ["Bound", "KeyFigure", "figure_of", "with_limit"]
