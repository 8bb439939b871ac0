"""Section of a report on rope tension: lowest and highest tension along each rope, limit by its safety factor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.key_figures import FigureId
from cable_twin.offline.reporting.chart import LOOKS, Chart, Mark, span
from cable_twin.offline.reporting.results import Results, RopeCourse
from cable_twin.offline.reporting.sections.section import by_id, place_along, row_of
from cable_twin.offline.reporting.texts import Texts

QUANTITIES = "rope_tension", "rope_safety_factor", "dynamic_amplification"


def tension_diagram(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Rope tension: tension chart of each rope, table of tensions; None without tensions.

    None for a study, too, whose ranges have them.
    """
    if results.ranges:
        return None
    rows = [row_of(one, results, texts) for one in results.figures if one.id.quantity in QUANTITIES]
    if not rows:
        return None
    charts = [_chart(one, results, texts).svg() for one in results.ropes if np.isfinite(one.tension).any()]
    return {"charts": charts, "rows": rows}


def _chart(rope: RopeCourse, results: Results, texts: Texts) -> Chart:
    figures, subject = by_id(results), f"ropes.{rope.name}"
    tension = 1e-3 * rope.tension
    factor = figures.get(FigureId("rope_safety_factor", subject, "lowest"))
    breaking = results.scenario.cables[rope.name].breaking_force
    limit = None
    if factor is not None and factor.limit and breaking is not None:
        limit = 1e-3 * breaking / factor.limit
    extremes = {one: figures.get(FigureId("rope_tension", subject, one)) for one in ("lowest", "highest")}
    levels = [1e-3 * one.value for one in extremes.values() if one is not None]
    y = span([tension, *levels, *([limit] if limit is not None else [])], margin=0.16)
    title = f"{texts('Tension')}: {rope.name}"
    labels = texts("arc length of the rope, unstrained [m]"), texts("tension [kN]")
    chart = Chart(title, span([rope.arc_lengths], margin=0.01), y, labels, height=220.0)
    if limit is not None and factor is not None and factor.limit:
        chart.level(limit, f"{texts('safety factor of')} {rounded(factor.limit)}: {rounded(limit)} kN")
    chart.area(rope.arc_lengths, tension[0], tension[1])
    for row, (statistic, look) in enumerate((("lowest", LOOKS[1]), ("highest", LOOKS[0]))):
        chart.line(rope.arc_lengths, tension[row], look, f"{rope.name}, {texts(statistic)}")
        one = extremes[statistic]
        if one is not None:
            at = place_along(one, "arc length")
            if at is None:
                index = int(np.nanargmin(tension[0]) if statistic == "lowest" else np.nanargmax(tension[1]))
                at = float(rope.arc_lengths[index])
            chart.dot(at, 1e-3 * one.value)
            middle = 0.5 * (rope.arc_lengths[0] + rope.arc_lengths[-1])
            up = 7.0 if statistic == "highest" else -14.0
            anchor = "end" if at > middle else "start"
            chart.mark(Mark(at, 1e-3 * one.value, f"{rounded(1e-3 * one.value)} kN", anchor, up))
    return chart
