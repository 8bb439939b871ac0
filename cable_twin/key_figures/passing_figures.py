"""Key figures of passing vehicles on different ropes in space: least clearance of each pair."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.geometry.bodies import body_box, body_outline
from cable_twin.key_figures.extremes import lowest
from cable_twin.key_figures.figure import KeyFigure, figure_of
from cable_twin.key_figures.limits import limited
from cable_twin.key_figures.passing_measures import Passing, take_passing
from cable_twin.key_figures.space_figures import LOOKS
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.vehicles import Body


class Hull(NamedTuple):
    """Bounding box of a body in its axes, from the centre of mass without payload."""

    middle: FloatArray  # (3,) m
    half: FloatArray  # (3,) m


def hull_of(body: Body) -> Hull:
    """Bounding box of a body; for a bar, a box of width 0."""
    box = body_box(body)
    if box is not None:
        return Hull(np.zeros(3), 0.5 * box)
    line = body_outline(body)
    low, high = line.min(axis=0), line.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return Hull(np.array([middle[0], 0.0, middle[1]]), np.array([half[0], 0.0, half[1]]))


class PassingFigures:
    """Least clearance between vehicles on different ropes.

    Args:
        scenario: what runs, of several ropes in space.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, self._vehicles = scenario, list(scenario.vehicles)
        self._groups = [*scenario.carriages, *([scenario.carriers.name] if scenario.carriers else [])]
        hulls = [hull_of(body) for one in scenario.vehicles.values() for body in one.bodies.values()]
        count, last = len(self._groups), len(self._groups) - 1
        self.memory = Passing(
            group=np.minimum(np.arange(len(self._vehicles)), last),
            first_body=np.cumsum([0, *(len(one.bodies) for one in scenario.vehicles.values())]),
            middle=np.array([hull.middle for hull in hulls]).reshape(-1, 3),
            body_half=np.array([hull.half for hull in hulls]).reshape(-1, 3),
            clearance=lowest(count * count),
            pair=np.zeros((count * count, 2), np.int64),
            next_look=np.full(1, -np.inf),
            centre=np.zeros((2, 3)),
            axes=np.zeros((2, 3, 3)),
            half=np.zeros((2, 3)),
            corners=np.zeros((2, 8, 3)),
        )
        self._packed = pack(self.memory)
        self._layout: Layout | None = None  # of the frames so far

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        if snapshot.layout is not self._layout:
            self._layout = snapshot.layout
            self._numbers = np.empty(self._layout.size)
            self._columns = pack(self._layout.columns(self._numbers))
        self._numbers[:] = snapshot.numbers
        take_passing(self._packed, self._columns)

    def figures(self) -> list[KeyFigure]:
        """Return one clearance figure for each pair of groups of vehicles that came near each other."""
        found = []
        for one, other in combinations_with_replacement(range(len(self._groups)), 2):
            row = one * len(self._groups) + other
            if self.memory.clearance.value(row) >= 0.0:
                names = f"{self._groups[one]} and {self._groups[other]}" if one != other else self._groups[one]
                figure = figure_of(self.memory.clearance, row, f"clearance between {names}, least", "m")
                who, beside = (self._vehicles[number] for number in self.memory.pair[row].tolist())
                place = f"{who} at {figure.place}" if one != other else f"{who} and {beside}, {figure.place}"
                figure = limited(self._scenario, replace(figure, place=place), "vehicle_separation")
                found.append(replace(figure, band=LOOKS))
        return found


__all__ = ["PassingFigures", "hull_of"]
