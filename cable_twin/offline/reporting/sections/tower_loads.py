"""Section of a report on tower loads: each at its highest as an arrow, with extremes in a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.key_figures import FigureId, KeyFigure
from cable_twin.offline.reporting.chart import LOOKS, Chart, Mark, span
from cable_twin.offline.reporting.results import Results, TowerLoad
from cable_twin.offline.reporting.sections.section import Row, by_id, row_of
from cable_twin.offline.reporting.texts import Texts

LONGEST = 58.0  # px, of an arrow
MOST_MARKS = 24  # towers of a rope, above which the numbers are in the table alone


class TowerRow(NamedTuple):
    """Row of the table of tower loads: extremes, and components (N) of the highest load, NaN where not known."""

    tower: str
    highest: Row | None
    lowest: Row | None
    along: float
    left: float
    down: float


def tower_loads(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Tower loads: chart of the tower loads of each rope, table; None without towers."""
    figures = by_id(results)
    rows = [_row(one, figures, results, texts) for one in results.towers]
    if not rows:
        return None
    by_rope: dict[str, list[TowerLoad]] = {}
    for one in results.towers:
        by_rope.setdefault(results.scenario.towers[one.tower].rope or "", []).append(one)
    longest = float(np.nanmax([0.0, *(np.linalg.norm(one.force) for one in results.towers)])) or 1.0
    charts = [_chart(rope, towers, figures, longest, texts).svg() for rope, towers in by_rope.items()]
    return {"charts": charts, "rows": rows, "in_space": results.scenario.dim == 3}


def _row(one: TowerLoad, figures: Mapping[FigureId, KeyFigure], results: Results, texts: Texts) -> TowerRow:
    both = [figures.get(FigureId("support_load", one.subject, statistic)) for statistic in ("highest", "lowest")]
    rows = [None if figure is None else row_of(figure, results, texts) for figure in both]
    along, left, up = one.force.tolist()
    return TowerRow(one.tower, rows[0], rows[1], along, left, -up)


def _chart(
    rope: str, towers: Sequence[TowerLoad], figures: Mapping[FigureId, KeyFigure], longest: float, texts: Texts
) -> Chart:
    title = f"{texts('Tower loads')}: {rope}" if rope else texts("Tower loads")
    x = span([one.place[0] for one in towers], margin=0.06)
    rows = {0.0: rope or texts("tower")}
    chart = Chart(title, x, (-1.0, 0.16), (texts("x, along the track [m]"), ""), height=176.0, rows=rows)
    for number, one in enumerate(towers):
        place = float(one.place[0])
        chart.arrow(place, 0.0, LONGEST * one.force[0] / longest, LONGEST * one.force[2] / longest, LOOKS[0])
        figure = figures.get(FigureId("support_load", one.subject, "highest"))
        if figure is not None and len(towers) <= MOST_MARKS:
            down = float(np.nan_to_num(LONGEST * abs(one.force[2]) / longest))
            lower = 12.0 * (number % 2 if len(towers) > 12 else 0)
            chart.mark(Mark(place, 0.0, f"{rounded(1e-3 * figure.value)} kN", up=-down - 14.0 - lower))
            chart.mark(Mark(place, 0.0, one.tower, up=6.0 + lower))
        chart.dot(place, 0.0)
    return chart
