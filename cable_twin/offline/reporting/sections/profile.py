"""Section of a report on the line profile: terrain, towers, ropes at the start and at lowest, sags, clearances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.key_figures import KeyFigure
from cable_twin.offline.reporting.chart import LOOKS, QUIET, Chart, Look, Mark, span
from cable_twin.offline.reporting.results import Results, RopeCourse
from cable_twin.offline.reporting.sections.section import place_along, row_of
from cable_twin.offline.reporting.texts import Texts

MOST_MARKS, MOST_ROWS = 24, 3  # numbers that have room in a row, and rows
ROW = 13.0  # px
TERRAIN = Look("#5b4636", "", 1.8)
TOWER = Look(QUIET, "", 3.0)
HEIGHT = 350.0  # px
FOOT = 15.0  # m, drawn height of towers without terrain


class LineProfile:
    """Section of a report with the profile of the line and the clearance over the terrain."""

    title = "Line profile"
    template = "profile.html"

    def content(self, results: Results, texts: Texts) -> Mapping[str, Any] | None:
        """Template data of the section: charts, and tables of sags and clearances; None without a rope shape."""
        if not results.ropes:
            return None
        sags = [one for one in results.figures if one.id.quantity == "sag"]
        clearances = [one for one in results.figures if one.id.quantity in ("rope_clearance", "vehicle_clearance")]
        below = results.scenario.terrain and any(np.isfinite(one.clearance).any() for one in results.ropes)
        return {
            "profile": _profile(results, sags, texts).svg(),
            "clearance": _clearance(results, clearances, texts).svg() if below else "",
            "sags": [row_of(one, results, texts) for one in sags],
            "clearances": [row_of(one, results, texts) for one in clearances],
        }


def _profile(results: Results, sags: Sequence[KeyFigure], texts: Texts) -> Chart:
    scenario, ropes = results.scenario, results.ropes
    ground = np.array(scenario.terrain, dtype=np.float64).reshape(
        -1, len(scenario.terrain[0]) if scenario.terrain else 2
    )
    places = list(scenario.tower_places.values())
    x = span([*(one.x for one in ropes), ground[:, 0]], margin=0.01)
    heights = [*(one.shape[:, 2] for one in ropes), *(one.lowest for one in ropes), ground[:, -1]]
    z = span([*heights, *([place[2] - FOOT for place in places] if not scenario.terrain else [])], margin=0.08)
    rows = min(len(ropes), MOST_ROWS) * ROW + 8.0
    z = z[0] - rows / (HEIGHT - rows) * (z[1] - z[0]), z[1]
    chart = Chart(texts("Line profile"), x, z, (texts("x, along the track [m]"), texts("z, height [m]")), height=HEIGHT)
    if scenario.terrain:
        chart.area(ground[:, 0], np.full(len(ground), z[0]), ground[:, -1], TERRAIN.color, 0.16)
        chart.line(ground[:, 0], ground[:, -1], TERRAIN, texts("terrain"))
    feet: dict[float, float] = {}
    for at_x, _, top in places:
        foot = float(np.interp(at_x, ground[:, 0], ground[:, -1])) if scenario.terrain else top - FOOT
        feet[at_x] = min(foot, feet.get(at_x, foot))
        chart.line(np.array([at_x, at_x]), np.array([foot, top]), TOWER)
    if places:
        chart.named(texts("tower"), TOWER)
    for number, rope in enumerate(ropes):
        look = LOOKS[number % len(LOOKS)]._replace(dashes="")
        chart.line(rope.shape[:, 0], rope.shape[:, 2], look, rope.name)
        chart.line(rope.x, rope.lowest, look._replace(dashes="5 2.5", width=1.0))
    chart.named(texts("lowest place"), LOOKS[0]._replace(dashes="5 2.5", width=1.0))
    if len(feet) <= MOST_MARKS:
        for name, (at_x, _, top) in _one_of_each(scenario.tower_places).items():
            chart.mark(Mark(at_x, top, name, up=8.0))
    if len(sags) <= MOST_MARKS * MOST_ROWS:
        _mark_sags(chart, results, sags, z[0])
    return chart


def _one_of_each(places: Mapping[str, tuple[float, float, float]]) -> dict[str, tuple[float, float, float]]:
    """One tower at each x of the line, with the common part of the names where several stand there."""
    by_x: dict[float, list[str]] = {}
    for name, place in places.items():
        by_x.setdefault(place[0], []).append(name)
    return {_common(names): places[names[0]] for names in by_x.values()}


def _common(names: Sequence[str]) -> str:
    """Common beginning of names of towers, without a trailing underscore or space."""
    first, last = min(names), max(names)
    count = next(
        (n for n, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(min(first, last, key=len))
    )
    return first if len(names) == 1 else first[:count].rstrip("_ ") or first


def _mark_sags(chart: Chart, results: Results, sags: Sequence[KeyFigure], bottom: float) -> None:
    """Write the sags at the bottom of the profile chart below their places, in a row for each rope."""
    names = [one.name for one in results.ropes[:MOST_ROWS]]
    for one in sags:
        rope = one.id.subject.removeprefix("ropes.").rpartition(".")[0]
        at = place_along(one, "x")
        if at is not None and rope in names:
            chart.mark(Mark(at, bottom, rounded(one.value), up=6.0 + ROW * (len(names) - 1 - names.index(rope))))
    for row, name in enumerate(names if len(names) > 1 else ()):
        chart.beside(name, bottom, 6.0 + ROW * (len(names) - 1 - row))


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
                chart.mark(Mark(at, one.value, f"{rounded(one.value)} m"))
    return chart


def _clearance_line(chart: Chart, rope: RopeCourse, look: Look, texts: Texts, *, several: bool) -> None:
    label = f"{rope.name}: {texts('rope, least')}" if several else texts("rope, least")
    chart.line(rope.x, rope.clearance, look, label)
