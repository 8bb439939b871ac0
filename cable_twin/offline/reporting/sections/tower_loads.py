"""Section of a report on tower loads: each at its highest as an arrow, with extremes in a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.key_figures import FigureId, KeyFigure
from cable_twin.offline.reporting.chart import BOTTOM, LETTER, LOOKS, TOP, Chart, span
from cable_twin.offline.reporting.results import Results, TowerLoad
from cable_twin.offline.reporting.sections.section import Row, by_id, row_of
from cable_twin.offline.reporting.texts import Texts

LONGEST = 58.0  # px, of an arrow
NEGLIGIBLE = 1e-6  # of a force, below which a component is a rounding error
ROOM = 400.0  # px above and below towers, more than their texts take
MOST_MARKS = 24  # towers of a rope, above which the numbers are in the table alone


class TowerRow(NamedTuple):
    """Row of the table of tower loads: an extreme, and its components (N), NaN where not known."""

    tower: str
    load: str  # highest or lowest
    figure: Row | None
    along: float
    left: float
    down: float


def tower_loads(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Tower loads: chart of the tower loads of each rope, table; None without towers."""
    figures = by_id(results)
    rows = [row for one in results.towers for row in _rows(one, figures, results, texts)]
    if not rows:
        return None
    by_rope: dict[str, list[TowerLoad]] = {}
    for one in results.towers:
        by_rope.setdefault(results.scenario.towers[one.tower].rope or "", []).append(one)
    x = span([*(one.x for one in results.ropes), *(one.place[0] for one in results.towers)], margin=0.01)
    charts = [_chart(rope, towers, figures, x, texts).svg() for rope, towers in by_rope.items()]
    return {"charts": charts, "rows": rows, "in_space": results.scenario.dim == 3}


def _rows(one: TowerLoad, figures: Mapping[FigureId, KeyFigure], results: Results, texts: Texts) -> Iterator[TowerRow]:
    for statistic, force in (("highest", one.force), ("lowest", one.least)):
        figure = figures.get(FigureId("support_load", one.subject, statistic))
        negligible = NEGLIGIBLE * np.linalg.norm(one.force)
        along, left, up = np.where(np.abs(force) < negligible, 0.0, force).tolist()
        row = None if figure is None else row_of(figure, results, texts)
        yield TowerRow(one.tower, statistic, row, along, left, 0.0 - up)


def _chart(
    rope: str, towers: Sequence[TowerLoad], figures: Mapping[FigureId, KeyFigure], x: tuple[float, float], texts: Texts
) -> Chart:
    """Chart with the loads of the towers of a rope as arrows, a px for each unit of its vertical axis."""
    title = f"{texts('Tower loads')}: {rope}" if rope else texts("Tower loads")

    def empty(low: float, high: float) -> Chart:
        labels = texts("x, along the track [m]"), rope
        return Chart(title, x, (low, high), labels, height=high - low + TOP + BOTTOM, rows={0.0: ""})

    low, high = _draw(empty(-ROOM, ROOM), towers, figures)  # what texts that stand above each other take
    chart = empty(min(low, high - LETTER * len(rope)), high)
    _draw(chart, towers, figures)
    return chart


def _draw(chart: Chart, towers: Sequence[TowerLoad], figures: Mapping[FigureId, KeyFigure]) -> tuple[float, float]:
    """Draw arrows, names and loads of towers into a chart; returns the range (px) that they take about the towers."""
    scale = LONGEST / (float(np.nanmax([0.0, *(np.linalg.norm(one.force) for one in towers)])) or 1.0)
    taken = [0.0]
    for one in towers:
        chart.arrow(float(one.place[0]), 0.0, scale * one.force[0], scale * one.force[2], LOOKS[0])
        chart.dot(float(one.place[0]), 0.0)
    for one in towers if len(towers) <= MOST_MARKS else ():
        place, up = float(one.place[0]), float(np.nan_to_num(scale * one.force[2]))
        name_at, load_at = (-14.0, up + 6.0) if up > 0.0 else (6.0, up - 14.0)  # the load is at the tip of the arrow
        taken.append(chart.stacked(place, 0.0, one.tower, name_at))
        figure = figures.get(FigureId("support_load", one.subject, "highest"))
        if figure is not None:
            taken.append(chart.stacked(place, 0.0, f"{rounded(1e-3 * figure.value)} kN", load_at))
    taken += [float(np.nan_to_num(scale * one.force[2])) for one in towers]
    return min(taken) - 6.0, max(taken) + 12.0
