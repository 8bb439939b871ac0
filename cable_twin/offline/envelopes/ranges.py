"""Range of tension along each rope, and highest and least force on supports, over states and runs of load cases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import supports_of
from cable_twin.scenario import Scenario


class Tensions(NamedTuple):
    """Range of tension along a rope.

    Attributes:
        arc_lengths: (n,) m, unstrained.
        lowest: (n,) N, at each arc length.
        highest: (n,) N.
    """

    arc_lengths: FloatArray
    lowest: FloatArray
    highest: FloatArray

    def along(self, arc_lengths: FloatArray) -> FloatArray:
        """Lowest and highest tension (2, m) in N at other arc lengths (m,) in m, interpolated."""
        return np.array([np.interp(arc_lengths, self.arc_lengths, one) for one in (self.lowest, self.highest)])


class Ranges(NamedTuple):
    """Ranges of tensions of ropes, by name, and highest and least forces (3,) N of ropes on supports, by subject."""

    tensions: Mapping[str, Tensions]
    forces: Mapping[str, FloatArray]
    least_forces: Mapping[str, FloatArray]

    def plain(self) -> dict[str, Any]:
        """Plain data of the ranges, for JSON."""
        tensions = {
            name: {key: one.tolist() for key, one in tension._asdict().items()}
            for name, tension in self.tensions.items()
        }
        forces, least = (
            {key: one.tolist() for key, one in found.items()} for found in (self.forces, self.least_forces)
        )
        return {"tensions": tensions, "forces": forces, "least_forces": least}


def ranges_of_plain(data: Mapping[str, Any]) -> Ranges:
    """Ranges from their plain data.

    Raises:
        KeyError: a part is missing.
        ValueError: a part is no list of numbers.
        TypeError: the same.
    """
    tensions = {
        name: Tensions(*(np.array(one[key], dtype=np.float64) for key in Tensions._fields))
        for name, one in data["tensions"].items()
    }
    forces, least = (
        {key: np.array(one, dtype=np.float64) for key, one in found.items()}
        for found in (data["forces"], data.get("least_forces", {}))  # not of earlier versions
    )
    return Ranges(tensions, forces, least)


def united(of_cases: Iterable[Ranges]) -> Ranges:
    """Ranges over several load cases, each tension at the arc lengths of the first case that has the rope."""
    tensions: dict[str, Tensions] = {}
    forces: dict[str, FloatArray] = {}
    least: dict[str, FloatArray] = {}
    for one in of_cases:
        for name, tension in one.tensions.items():
            first = tensions.setdefault(name, tension)
            low, high = tension.along(first.arc_lengths)
            tensions[name] = Tensions(first.arc_lengths, np.minimum(first.lowest, low), np.maximum(first.highest, high))
        for key, force in one.forces.items():
            if key not in forces or np.linalg.norm(force) > np.linalg.norm(forces[key]):
                forces[key] = force
        for key, force in one.least_forces.items():
            if key not in least or np.linalg.norm(force) < np.linalg.norm(least[key]):
                least[key] = force
    return Ranges(tensions, forces, least)


class SupportForces:
    """Collector of the highest and the least force of ropes on supports.

    Args:
        count: number of supports.

    Attributes:
        most: (supports, 3) N, each with the highest load so far; NaN without one.
        least: (supports, 3) N, each with the least load so far.
    """

    def __init__(self, count: int) -> None:
        self.most, self.least = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        self._high, self._low = np.full(count, -np.inf), np.full(count, np.inf)

    def take(self, on_ropes: FloatArray) -> None:
        """Update the forces with those (supports, 3) in N of supports on ropes; NaN is ignored."""
        loads = np.linalg.norm(on_ropes, axis=1)
        higher, lower = loads > self._high, loads < self._low
        self._high[higher], self.most[higher] = loads[higher], -on_ropes[higher]
        self._low[lower], self.least[lower] = loads[lower], -on_ropes[lower]


class RangeCollector:
    """Collector of the ranges of one load case from its states at rest, or from the frames of its runs.

    Args:
        scenario: of the case.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._subjects = [one.key for one in supports_of(scenario)]
        self._ropes: Mapping[str, slice] = {}
        self._arc_lengths = np.zeros(0)
        self._tension = np.zeros((2, 0))
        self._forces = SupportForces(len(self._subjects))

    def take(self, snapshot: Snapshot) -> None:
        """Update the ranges with a snapshot."""
        columns, layout = snapshot.columns, snapshot.layout
        if not self._ropes:
            self._ropes, self._arc_lengths = layout.ropes, layout.arc_lengths
            self._tension = np.array([columns.rope_tension, columns.rope_tension])
        np.fmin(self._tension[0], columns.rope_tension, out=self._tension[0])
        np.fmax(self._tension[1], columns.rope_tension, out=self._tension[1])
        self._forces.take(columns.support_force)

    def ranges(self) -> Ranges:
        """Ranges over all snapshots so far; empty without one."""
        tensions = {
            name: Tensions(self._arc_lengths[part], *self._tension[:, part]) for name, part in self._ropes.items()
        }
        if not tensions:
            return Ranges({}, {}, {})
        highest, least = (
            dict(zip(self._subjects, one, strict=True)) for one in (self._forces.most, self._forces.least)
        )
        return Ranges(tensions, highest, least)
