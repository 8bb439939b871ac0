"""Key figure: value, unit, time and place of the extreme, and limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast, get_args

from cable_twin.key_figures.extremes import Extremes
from cable_twin.scenario.sections.limits import Bound

TOLERANCE = 1e-3  # of a limit


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One key figure of a run with its limit."""

    name: str
    value: float
    unit: str
    time: float  # s, when it was reached
    place: str = ""  # where, with unit
    limit: float | None = None
    bound: Bound = "at most"
    source: str = ""  # of the limit
    uncertainty: float | None = None  # difference from a finer mesh and step, where that was run
    band: str = ""  # of what it is an extreme: of means over a time, of frames

    @property
    def kept(self) -> bool | None:
        """True if the limit is kept, to a tolerance of 0.1 % of the limit as for drive speeds; None without a limit."""
        return None if self.limit is None else self._keeps(self.value)

    @property
    def verdict(self) -> str:
        """Compliance with the limit in words, "not decided" within the uncertainty; empty without a limit."""
        if self.limit is None:
            return ""
        off = self.uncertainty or 0.0
        if self._keeps(self.value - off) != self._keeps(self.value + off):
            return "not decided"
        return "kept" if self.kept else "exceeded"

    def _keeps(self, value: float) -> bool:
        assert self.limit is not None
        beyond = value - self.limit if self.bound == "at most" else self.limit - value
        return beyond <= TOLERANCE * abs(self.limit)


def values_of(figure: KeyFigure) -> dict[str, str]:
    """Key figure as the text values of a diagnostic status; inverse of `figure_from_values`, exact to the last bit."""
    values = {"value": repr(float(figure.value)), "unit": figure.unit, "time_s": repr(float(figure.time))}
    values |= {"place": figure.place, "band": figure.band}
    if figure.limit is not None:
        values |= {"limit": repr(float(figure.limit)), "bound": figure.bound, "source": figure.source}
    return values


def figure_from_values(name: str, values: Mapping[str, str]) -> KeyFigure:
    """Key figure of a name from the text values written by `values_of`.

    Raises:
        ValueError: something is missing or no number; one line.
    """
    try:
        figure = KeyFigure(name, float(values["value"]), values["unit"], float(values["time_s"]))
        figure = replace(figure, place=values.get("place", ""), band=values.get("band", ""))
        if "limit" not in values:
            return figure
        bound, limit = values["bound"], float(values["limit"])
        if bound not in get_args(Bound):
            raise ValueError(f"bound {bound!r} is none of {', '.join(get_args(Bound))}")
        return replace(figure, limit=limit, bound=cast(Bound, bound), source=values.get("source", ""))
    except KeyError as error:
        raise ValueError(f"key figure {name!r}: {error.args[0]} is missing") from None
    except ValueError as error:
        raise ValueError(f"key figure {name!r}: {error}") from None


def figure_of(extremes: Extremes, index: int, name: str, unit: str, at: str = "arc length") -> KeyFigure:
    """Key figure of one extreme, without a limit; NaN without a value so far."""
    place = extremes.places[index]
    found = ["" if math.isnan(place) else f"{at} {round(place, 1) + 0.0:.1f} m", wind_at(extremes, index)]
    return KeyFigure(name, extremes.value(index), unit, float(extremes.times[index]), ", ".join(filter(None, found)))


def wind_at(extremes: Extremes, index: int) -> str:
    """Wind at the time of an extreme, as text: speed and heading from the track to its left; empty without a value."""
    x, y, z = extremes.winds[index].tolist()
    speed = math.hypot(x, y, z)
    if math.isnan(speed) or speed == 0.0:
        return "" if math.isnan(speed) else "no wind"
    return f"wind {speed:.1f} m/s to {math.degrees(math.atan2(y, x)):.0f} deg"


def with_limit(figure: KeyFigure, limit: float | None, source: str, bound: Bound = "at most") -> KeyFigure:
    """Key figure with a limit and the source of the limit; unchanged for a limit of None."""
    return figure if limit is None else replace(figure, limit=limit, bound=bound, source=source)


__all__ = ["KeyFigure", "figure_from_values", "figure_of", "values_of", "wind_at", "with_limit"]
