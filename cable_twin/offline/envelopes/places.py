"""Search for the worst place of a vehicle at rest: a coarse grid over all of its places, then bounded searches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cable_twin.key_figures import KeyFigure
from cable_twin.offline.envelopes.motion import DynamicError, read_figures
from cable_twin.offline.envelopes.search import Search
from cable_twin.offline.lines.at_rest import Find, Line, calculate, plan_line
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.checks.fault import show

KEYS = ("points", "figures")
POINTS, LEAST, MOST = 40, 3, 2000  # of the coarse grid
FINEST = 0.01  # m, between two places


class WorstPlace(NamedTuple):
    """Settings of the search for the worst place of the vehicle of a load case at rest.

    Attributes:
        points: places of the coarse grid.
        figures: ids of the key figures whose worst place is sought.
        one: whether a single carrier of many is loaded, which may be anywhere on its loop.
    """

    points: int
    figures: tuple[str, ...]
    one: bool

    @property
    def inputs(self) -> list[Any]:
        """Settings of the search for the worst place, for the hash that identifies a load case's stored result."""
        return ["worst_place", *self]


def read_worst_place(given: Any, scenario: Scenario, *, one: bool) -> WorstPlace:
    """Read the settings of the search for the worst place from the mapping `worst_place` of a load case file.

    Args:
        given: the mapping.
        scenario: of the case.
        one: whether the loading of the case is that of a single vehicle.

    Raises:
        DynamicError: the mapping is not valid; one line.
    """
    key = "worst_place"
    if not isinstance(given, Mapping) or not isinstance(given.get("figures"), list) or not given["figures"]:
        raise DynamicError(f"{key}: given {show(given)}; allowed: a mapping with figures, a list of their ids")
    if unknown := [name for name in given if name not in KEYS]:
        raise DynamicError(f"{key}.{unknown[0]}: this key does not exist; allowed: {', '.join(KEYS)}")
    points = given.get("points", POINTS)
    if not isinstance(points, int) or isinstance(points, bool) or not LEAST <= points <= MOST:
        raise DynamicError(f"{key}.points: given {show(points)}; allowed: a whole number from {LEAST} to {MOST}")
    if not plan_line(scenario, 2, None).moved:
        raise DynamicError(f"{key}: given {show(given)}; allowed: no such key, as no vehicle of this scenario moves")
    return WorstPlace(points, read_figures(f"{key}.figures", given["figures"]), one and scenario.carriers is not None)


def search_places(scenario: Scenario, wanted: WorstPlace, find: Find) -> Search:
    """Search all places of the vehicle of a line at rest for the worst value of each wanted key figure.

    A carrier that alone is loaded goes along its whole loop; else all carriers together go over one spacing.

    Args:
        scenario: of the case.
        wanted: grid and key figures of the search.
        find: simulation at the rest of a scenario, with the vehicle at a place (m).

    Raises:
        EquilibriumError: no equilibrium at a place.
        ValueError: a wanted figure exists at no place; one line.
    """
    moved, carriers = plan_line(scenario, 2, None), scenario.carriers
    first, last = moved.places.tolist()
    if carriers is not None and moved.moved == carriers.name:
        first, last = 0.0, scenario.spacing * (carriers.count if wanted.one else 1)

    def at(place: float) -> Mapping[str, KeyFigure]:
        line = line_at(scenario, place, one=wanted.one)
        calculate(line, find=find, rows=False)
        return {str(one.id): one for one in line.figures}

    search = Search(at, FINEST, "worst_place")
    grid = np.linspace(first, last, wanted.points).tolist()
    for place in grid:
        search.at(place)
    for figure in wanted.figures:
        search.refine(figure, grid)
    return search


def line_at(scenario: Scenario, place: float, *, one: bool) -> Line:
    """Line to be calculated at rest with its vehicle at one place, in a search for the worst place.

    Args:
        scenario: of the case.
        place: of the vehicle, in m.
        one: whether a single carrier of many is loaded, the one that is there.
    """
    moved, carriers = plan_line(scenario, 2, None).moved, scenario.carriers
    if one and carriers is not None:
        begin = 0.5 * scenario.spacing if carriers.first is None else carriers.first
        number = int((begin + place) // scenario.spacing) % carriers.count
        scenario = load_scenario(scenario.resolved(), {"carriers.loaded": [number + 1]})
    return Line(scenario, moved, np.array([place]))
