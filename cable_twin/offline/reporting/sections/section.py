"""Interface of the sections of a report, and cells and rows of tables of key figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from math import isnan
from typing import Any, NamedTuple

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.key_figures import FigureId, KeyFigure
from cable_twin.key_figures.shown import digits_of, shown
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.texts import Texts


class Section(NamedTuple):
    """Section of a report.

    Attributes:
        title: in English.
        template: name of its file in `templates`.
        content: names and values for the template; None where the results have nothing for it.
    """

    title: str
    template: str
    content: Callable[[Results, Texts], Mapping[str, Any] | None]


class Cell(NamedTuple):
    """Number in a table of a report: text in a readable unit, and the value in SI units."""

    text: str
    unit: str
    value: float
    id: str = ""  # of the figure


class Row(NamedTuple):
    """Row of a table of key figures in a report: value, limit, verdict, time, place, case."""

    name: str
    value: Cell
    limit: str
    source: str  # of the limit: document and clause
    verdict: str
    state: str  # the verdict in English
    when: str
    place: str
    case: str  # that governs
    note: str  # how it is sampled


def cell_of(figure: KeyFigure) -> Cell:
    """Table cell with the value of a key figure, in the digits and unit in which `review` prints it."""
    sizes = [abs(number) for number in (figure.value, figure.limit) if number is not None]
    unit, scale = shown_unit(figure.unit, max(sizes))
    digits = digits_of(figure, scale)
    return Cell(shown(figure.value, scale, digits), "" if unit == "-" else unit, figure.value, str(figure.id))


def row_of(figure: KeyFigure, results: Results, texts: Texts) -> Row:
    """Table row of a key figure in a report, with limit, source and verdict."""
    sizes = [abs(number) for number in (figure.value, figure.limit) if number is not None]
    unit, scale = shown_unit(figure.unit, max(sizes))
    limit = ""
    if figure.limit is not None:
        most = rounded(figure.limit * scale, digits_of(figure, scale))
        limit = with_units_kept(f"{texts(figure.bound)} {most}{'' if unit == '-' else f' {unit}'}")
    word, unit_at = results.at
    when = ""
    if not isnan(figure.time):
        when = f"{figure.time:.2f} {unit_at}" if word == "at" else f"{texts(word)} {figure.time:.2f} {unit_at}"
    return Row(
        texts.figure(figure),
        cell_of(figure),
        limit,
        texts.phrase(figure.source),
        texts(figure.verdict),
        figure.verdict,
        with_units_kept(when),
        with_units_kept(texts.phrase(figure.place)),
        results.governing.get(figure.id, ""),
        texts.phrase(figure.band),
    )


def with_units_kept(text: str) -> str:
    """Text whose lines do not break between a number and its unit, nor between x and its number."""
    return re.sub(r"(?<=\d) (?=[^\W\d]|%)|(?<=\bx) (?=-?\d)", "\u00a0", text)


def by_id(results: Results) -> dict[FigureId, KeyFigure]:
    """Key figures of the results of a report, by id."""
    return {one.id: one for one in results.figures}


def place_along(figure: KeyFigure, coordinate: str) -> float | None:
    """Place (m) of a key figure along `x` or `arc length`, parsed from the text of its place; None if not in it."""
    found = re.search(rf"\b{coordinate} (-?\d+(?:\.\d+)?) m", figure.place)
    return float(found[1]) if found else None
