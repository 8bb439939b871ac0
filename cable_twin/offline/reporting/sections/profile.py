"""Section of a report on the line profile: terrain, towers, ropes at the start and at lowest, sags, clearances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.geometry.ground import tower_foot
from cable_twin.key_figures import KeyFigure
from cable_twin.offline.reporting.chart import LOOKS, QUIET, Chart, Look, Mark, span
from cable_twin.offline.reporting.results import Results, RopeCourse
from cable_twin.offline.reporting.sections.section import place_along, row_of
from cable_twin.offline.reporting.texts import Texts
from cable_twin.view.labels import highest_line, shared_names

MOST_MARKS = 24  # numbers that have room in a row, and names of towers
TERRAIN = Look("#5b4636", "", 1.8)
TOWER = Look(QUIET, "", 3.0)
HEIGHT = 330.0  # px, without rows of numbers


def line_profile(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Line profile: charts, and tables of sags and clearances; None without a rope shape."""
    if not results.ropes:
        return None
    sags = [one for one in results.figures if one.id.quantity == "sag"]
    clearances = [one for one in results.figures if one.id.quantity in ("rope_clearance", "vehicle_clearance")]
    below = results.scenario.terrain and any(np.isfinite(one.clearance).any() for one in results.ropes)
    return {
        "profile": _profile(results, sags, texts).svg(),
        "clearance": _clearance(results, clearances, texts).svg() if below else "",
        "moving": any(one.moves for one in results.cases),
        "sags": [row_of(one, results, texts) for one in sags],
        "clearances": [row_of(one, results, texts) for one in clearances],
    }


def _profile(results: Results, sags: Sequence[KeyFigure], texts: Texts) -> Chart:
    scenario, ropes = results.scenario, results.ropes
    ground = np.array(scenario.terrain, dtype=np.float64).reshape(
        -1, len(scenario.terrain[0]) if scenario.terrain else 2
    )
    heights = np.concatenate([*(one.shape[:, 2] for one in ropes), *(one.lowest for one in ropes)])
    feet = {
        name: (x, tower_foot(scenario, x, top, heights), top) for name, (x, _, top) in scenario.tower_places.items()
    }
    x = span([*(one.x for one in ropes), ground[:, 0]], margin=0.01)
    z = span([heights, ground[:, -1], *(foot for _, foot, _ in feet.values())], margin=0.08)
    z = z[0], z[1] + 0.05 * (z[1] - z[0])  # for two lines of a name
    numbered = len(sags) <= MOST_MARKS * len(ropes)
    rows = [one.name if len(ropes) > 1 else "" for one in ropes if numbered]
    labels = texts("x, along the track [m]"), texts("z, height [m]")
    chart = Chart(texts("Line profile"), x, z, labels, height=HEIGHT, below=rows)
    if scenario.terrain:
        chart.area(ground[:, 0], np.full(len(ground), chart.floor), ground[:, -1], TERRAIN.color, 0.16)
        chart.line(ground[:, 0], ground[:, -1], TERRAIN, texts("terrain"))
    for at_x, foot, top in feet.values():
        chart.line(np.array([at_x, at_x]), np.array([foot, top]), TOWER)
    if feet:
        chart.named(texts("tower"), TOWER)
    for number, rope in enumerate(ropes):
        look = LOOKS[number % len(LOOKS)]._replace(dashes="")
        chart.line(rope.shape[:, 0], rope.shape[:, 2], look, rope.name)
        chart.line(rope.x, rope.lowest, look._replace(dashes="5 2.5", width=1.0))
    chart.named(texts("lowest place"), LOOKS[0]._replace(dashes="5 2.5", width=1.0))
    names = shared_names({name: (at_x,) for name, (at_x, _, _) in feet.items()}, {}, list(scenario.cables))
    if len(names) <= MOST_MARKS:
        upper = highest_line([one.shape[:, [0, 2]] for one in ropes])
        for name, (at_x,) in names.items():
            chart.name(at_x, max(top for other, _, top in feet.values() if other == at_x), name, upper)
    for one in sags if numbered else ():
        rope_name = one.id.subject.removeprefix("ropes.").rpartition(".")[0]
        if (at := place_along(one, "x")) is not None:
            chart.note(at, rope_name if len(ropes) > 1 else "", rounded(one.value))
    return chart


def _clearance(results: Results, figures: Sequence[KeyFigure], texts: Texts) -> Chart:
    ropes, limits = results.ropes, results.scenario.limits
    y = span([*(one.clearance for one in ropes), np.array([one.value for one in figures])], zero=True)
    x = span([one.x for one in ropes], margin=0.01)
    labels = texts("x, along the track [m]"), texts("clearance [m]")
    chart = Chart(texts("Clearance over the terrain"), x, y, labels, height=210.0)
    for number, rope in enumerate(ropes):
        _clearance_line(chart, rope, LOOKS[number % len(LOOKS)], texts, several=len(ropes) > 1)
    for key, called in (("rope_clearance", "limit of the rope"), ("vehicle_clearance", "limit of vehicles")):
        limit = getattr(limits, key)
        same = key == "vehicle_clearance" and limit == limits.rope_clearance
        if limit is not None and not same:
            both = limits.rope_clearance == limits.vehicle_clearance
            chart.level(limit, f"{texts('limit' if both else called)} {rounded(limit)} m")
    least = min(figures, key=lambda one: one.value, default=None)
    for one in figures:
        if (at := place_along(one, "x")) is not None:
            chart.dot(at, one.value)
            if one is least:
                anchor = "end" if at > sum(x) / 2.0 else "start"
                chart.mark(Mark(at, one.value, f"{rounded(one.value)} m", anchor, up=-14.0))
    return chart


def _clearance_line(chart: Chart, rope: RopeCourse, look: Look, texts: Texts, *, several: bool) -> None:
    label = f"{rope.name}: {texts('rope, least')}" if several else texts("rope, least")
    chart.line(rope.x, rope.clearance, look, label)
