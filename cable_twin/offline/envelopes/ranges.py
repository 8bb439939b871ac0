"""Range of tension along each rope, and highest force on each support, over the states and runs of load cases."""

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
    """Ranges of the tensions of ropes, by name, and highest forces (3,) N of ropes on supports, by subject."""

    tensions: Mapping[str, Tensions]
    forces: Mapping[str, FloatArray]

    def plain(self) -> dict[str, Any]:
        """Plain data of the ranges, for JSON."""
        tensions = {
            name: {key: one.tolist() for key, one in tension._asdict().items()}
            for name, tension in self.tensions.items()
        }
        return {"tensions": tensions, "forces": {key: one.tolist() for key, one in self.forces.items()}}


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
    return Ranges(tensions, {key: np.array(one, dtype=np.float64) for key, one in data["forces"].items()})


def united(of_cases: Iterable[Ranges]) -> Ranges:
    """Ranges over several load cases, each tension at the arc lengths of the first case that has the rope."""
    tensions: dict[str, Tensions] = {}
    forces: dict[str, FloatArray] = {}
    for one in of_cases:
        for name, tension in one.tensions.items():
            first = tensions.setdefault(name, tension)
            low, high = tension.along(first.arc_lengths)
            tensions[name] = Tensions(first.arc_lengths, np.minimum(first.lowest, low), np.maximum(first.highest, high))
        for key, force in one.forces.items():
            if key not in forces or np.linalg.norm(force) > np.linalg.norm(forces[key]):
                forces[key] = force
    return Ranges(tensions, forces)


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
        self._forces = np.zeros((len(self._subjects), 3))
        self._loads = np.full(len(self._subjects), -np.inf)

    def take(self, snapshot: Snapshot) -> None:
        """Update the ranges with a snapshot."""
        columns, layout = snapshot.columns, snapshot.layout
        if not self._ropes:
            self._ropes, self._arc_lengths = layout.ropes, layout.arc_lengths
            self._tension = np.array([columns.rope_tension, columns.rope_tension])
        np.fmin(self._tension[0], columns.rope_tension, out=self._tension[0])
        np.fmax(self._tension[1], columns.rope_tension, out=self._tension[1])
        loads = np.linalg.norm(columns.support_force, axis=1)
        higher = loads > self._loads
        self._loads[higher], self._forces[higher] = loads[higher], -columns.support_force[higher]

    def ranges(self) -> Ranges:
        """Ranges over all snapshots so far; empty without one."""
        tensions = {
            name: Tensions(self._arc_lengths[part], *self._tension[:, part]) for name, part in self._ropes.items()
        }
        return Ranges(tensions, dict(zip(self._subjects, self._forces, strict=True)) if tensions else {})
