"""Places at which vehicles of a line at rest pass masts and each other, found between places where it is calculated."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns
from cable_twin.key_figures.extremes import passes
from cable_twin.scenario import Scenario, masts

NEAR = 0.2  # m, from a calculated place, within which a passing is found; clearances are looked at every 0.1 m
MOST_ROUNDS = 5  # of searches by straight lines, of which two or three are needed


class Passings:
    """Search for the passings of a scenario: vehicles of a rope at its masts, vehicles of different ropes side by side.

    Args:
        scenario: scenario of the line; in a plane nothing passes.
    """

    def __init__(self, scenario: Scenario) -> None:
        ropes = [list(masts(scenario.of_rope(name)).values()) for name in scenario.cables] if scenario.dim == 3 else []
        self._masts = np.array([mast[0] for own in ropes for mast in own])  # m, x
        self._rope_of_mast = np.repeat(np.arange(len(ropes)), [len(own) for own in ropes])
        self._meet, carriers = passes(scenario), scenario.carriers
        self._carriers = [
            row for row, name in enumerate(scenario.vehicles) if carriers is not None and name not in scenario.carriages
        ]

    def search(self, at: Callable[[float], Columns], places: FloatArray, again: float | None) -> None:
        """Calculate the line at all passings between places at which it is calculated already.

        Args:
            at: columns of a frame of the line at a place (m) of its vehicle, calculated once.
            places: (n,) m, rising.
            again: m, place at which each carrier is where the next one was at the first place; None without one.
        """
        if not (self._meet or self._masts.size):
            return
        apart = {place: self._apart(at(place)) for place in places.tolist()}
        if again is not None:
            first = at(float(places[0]))
            ahead = dict(zip(self._carriers, self._carriers[1:] + self._carriers[:1], strict=True))
            apart[again] = self._apart(first, [ahead.get(row, row) for row in range(first.attached.size)])
        for _ in range(MOST_ROUNDS):
            wanted = [place for low, high in pairwise(sorted(apart)) for place in _between(low, high, apart)]
            if not wanted:
                return
            apart |= {place: self._apart(at(place)) for place in wanted}

    def _apart(self, columns: Columns, rows: list[int] | slice = slice(None)) -> FloatArray:
        """Distances (m) in x of vehicles, in an order `rows`, from masts and each other; NaN if they cannot pass."""
        x, rope = columns.joint_position[rows, 0], columns.vehicle_rope[rows]
        x = np.where(columns.attached[rows] != 0.0, x, np.nan)
        of_masts = np.where(rope[:, None] == self._rope_of_mast, x[:, None] - self._masts, np.nan)
        if not self._meet:
            return of_masts.ravel()
        one, other = np.triu_indices(x.size, 1)
        return np.concatenate([of_masts.ravel(), np.where(rope[one] != rope[other], x[one] - x[other], np.nan)])


def _between(low: float, high: float, apart: dict[float, FloatArray]) -> list[float]:
    """Places (m) of passings between two places and not near them, by straight lines, each near to no other of them."""
    before, after = apart[low], apart[high]
    passing = before * after < 0.0
    found: list[float] = []
    for place in np.sort(low + (high - low) * before[passing] / (before - after)[passing]).tolist():
        if min(place - (found[-1] if found else low), high - place) > NEAR:
            found.append(round(place, 2))
    return found
