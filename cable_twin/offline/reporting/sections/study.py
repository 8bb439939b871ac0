"""Section of a report on a study: varied keys, range of each key figure over all cases, Sobol indices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from cable_twin.basics.units import shown_unit
from cable_twin.key_figures.shown import shown
from cable_twin.offline.reporting.results import Results, StudyRange
from cable_twin.offline.reporting.sections.section import Cell
from cable_twin.offline.reporting.texts import Texts


class RangeRow(NamedTuple):
    """Row of the table of ranges of a study: range of a key figure in a readable unit, and its extreme cases."""

    name: str
    low: Cell
    low_case: str
    high: Cell
    high_case: str
    having: int


def study(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Study: varied keys, ranges and Sobol indices; None without a study."""
    if not results.factors:
        return None
    by_id = {str(one.extreme.id): texts.figure(one.extreme) for one in results.ranges}
    return {
        "factors": results.factors,
        "ranges": [_row(one, texts) for one in results.ranges],
        "indices": [(by_id.get(one.figure, one.name), one) for one in results.indices],
    }


def _row(one: StudyRange, texts: Texts) -> RangeRow:
    unit, scale = shown_unit(one.extreme.unit, max(abs(one.low[0]), abs(one.high[0])))
    unit = "" if unit == "-" else unit
    low, high = (
        Cell(shown(value, scale), unit, value, str(one.extreme.id) if value == one.extreme.value else "")
        for value, _ in (one.low, one.high)
    )
    return RangeRow(texts.figure(one.extreme), low, one.low[1], high, one.high[1], one.having)
