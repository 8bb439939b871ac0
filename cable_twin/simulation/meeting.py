"""Vehicles that meet on one rope: what they would do to each other is not simulated, so the run ends there."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cable_twin.geometry.outlines import body_outline
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Carriage


class Meeting:
    """Watches that vehicles which move on a rope keep their order and their distance along it.

    Their bodies count as they hang upright; two points, of a `size` of 0, may pass each other. What is clamped to a
    moving cable keeps its distance anyway.

    Attributes:
        possible: whether there are vehicles that could meet.

    Args:
        scenario: what runs.

    Raises:
        EquilibriumError: two of them start within each other; the line has the key.
    """

    def __init__(self, scenario: Scenario) -> None:
        on_rope = [
            (c.arc_length, row)
            for row, c in enumerate(scenario.vehicles.values())
            if c.joint != "clamped" and not c.clamped_to
        ]
        self._rows = np.array([row for _, row in sorted(on_rope)], dtype=np.int64)
        self._names = [list(scenario.vehicles)[row] for row in self._rows]
        reach = [_reach(scenario.vehicles[name]) for name in self._names]
        room = np.array([before[1] + after[0] for before, after in pairwise(reach)], dtype=np.float64)
        self._room = np.where(room > 0.0, room, -np.inf)
        self.possible = bool(np.any(room > 0.0))
        for number, (before, after) in enumerate(pairwise(sorted(on_rope))):
            if after[0] - before[0] < self._room[number]:
                raise EquilibriumError(
                    f"carriages.{self._names[number + 1]}.arc_length: given {after[0]!r}, within "
                    f"'{self._names[number]}' at {before[0]!r}; allowed: {self._room[number]:.3g} m apart at least"
                )

    def found(self, state: State) -> str:
        """The line about two vehicles that have met, or nothing."""
        if not self.possible:
            return ""
        places = state.joints.position[self._rows]
        for number in np.flatnonzero(np.diff(places) < self._room).tolist():
            one, other = self._names[number : number + 2]
            return (
                f"'{one}' and '{other}' have met at {places[number]:.2f} and {places[number + 1]:.2f} m of the cable; "
                f"their bodies need {self._room[number]:.3g} m, and contact of vehicles is not simulated"
            )
        return ""


def _reach(carriage: Carriage) -> tuple[float, float]:
    """How far (m) its bodies reach from the joint, towards the start and the end of the track."""
    low, high, pin = 0.0, 0.0, 0.0
    for body in carriage.bodies.values():
        centre = pin - body.upper_pivot[0]
        outline = centre + body_outline(body)[:, 0]
        low, high = min(low, float(outline.min())), max(high, float(outline.max()))
        pin = centre + (body.lower_pivot or (0.0, 0.0))[0]
    return -low, high


__all__ = ["Meeting"]
