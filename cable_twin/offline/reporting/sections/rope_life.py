"""Section of a report on rope life: bending cycles over sheaves and bullwheels, tension cycles in classes of range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.offline.reporting.chart import ticks
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.rope_life import BULLWHEEL, Cycle, RopeLife
from cable_twin.offline.reporting.texts import Texts


class ClassRow(NamedTuple):
    """Row of the table of tension cycles: a class of ranges (kN), and the counts of cycles in it."""

    range: str
    per_trip: float
    in_run: float


class RopePart(NamedTuple):
    """Part of the rope life section about one loop or rope: bending cycles of a trip, tension cycles by class."""

    life: RopeLife
    bullwheels: int  # bending cycles of a trip over bullwheels
    rollers: int  # the same, over the sheaves of towers
    classes: Sequence[ClassRow]


def rope_life_counts(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Rope life: bends and tension cycles of each rope; None where nothing was counted."""
    parts = [_part(one) for one in results.lives]
    return {"parts": parts, "trips": results.trips, "diameters": _diameters(results)} if parts else None


def _part(life: RopeLife) -> RopePart:
    bullwheels = sum(one.cycles for one in life.bends if one.kind == BULLWHEEL)
    rollers = sum(one.cycles for one in life.bends) - bullwheels
    return RopePart(life, bullwheels, rollers, classes_of(life.per_trip, life.in_run))


def _diameters(results: Results) -> dict[str, float | None]:
    """Rope diameter (m) of each loop or rope of the section, by name; None where not given."""
    return {one.name: results.scenario.cables[one.name.partition(" and ")[0]].diameter for one in results.lives}


def classes_of(per_trip: Sequence[Cycle], in_run: Sequence[Cycle]) -> list[ClassRow]:
    """Counts of tension cycles in about six classes of equal width of their range, in kN."""
    largest = 1e-3 * max((one.range for one in (*per_trip, *in_run)), default=0.0)
    if largest <= 0.0:
        return []
    edges = ticks(0.0, largest)
    step = edges[1] - edges[0]
    edges = [number * step for number in range(int(np.ceil(largest / step - 1e-9)) + 1)]
    counts = [
        np.histogram([1e-3 * one.range for one in cycles], edges, weights=[one.weight for one in cycles])[0]
        for cycles in (per_trip, in_run)
    ]
    rows = zip(edges[:-1], edges[1:], *(one.tolist() for one in counts), strict=True)
    return [ClassRow(f"{rounded(low)} to {rounded(high)}", trip, run) for low, high, trip, run in rows]
