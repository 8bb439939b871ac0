"""Mesh of a rope, built from a scenario: elements that are short at ends, towers and loads and grow away from them."""

from __future__ import annotations

from itertools import pairwise
from math import log

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.solution.catenary import EquilibriumError, rest_over_supports
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import Grading

MARGIN = 1.0  # short elements on either side of a tower, beyond its outermost contacts
RESOLUTION = 0.05  # of a short element, at which lengths are summed up


def even_nodes(length: float, elements: int) -> FloatArray:
    """Arc lengths (nodes,) in m of a mesh of equal elements on a cable of `length` (m)."""
    return np.linspace(0.0, length, elements + 1, dtype=np.float64)


def nodes_of(scenario: Scenario, system: System) -> FloatArray:
    """Arc lengths (nodes,) in m of the mesh nodes of a scenario's cable.

    Args:
        scenario: scenario with the mesh in `cable.elements`.
        system: its constants on any mesh, from which the equilibrium of the bare cable over its towers follows.
    """
    elements, length = scenario.cable.elements, scenario.cable.unstrained_length
    if not isinstance(elements, Grading):
        return even_nodes(length, elements)
    return graded_nodes(length, elements, short_zones(scenario, system))


def with_marks(nodes: FloatArray, marks: FloatArray) -> FloatArray:
    """Mesh with additional nodes at `marks` (m), each between the ends; elements keep their length or get shorter."""
    numbers = np.arange(nodes.size, dtype=np.float64)
    stops = np.unique(np.interp([nodes[0], *marks, nodes[-1]], nodes, numbers))
    pieces = [nodes[:1]]
    for first, last in pairwise(stops.tolist()):
        count = max(int(np.ceil(last - first - 1e-6)), 1)
        pieces.append(np.interp(np.linspace(first, last, count + 1)[1:], numbers, nodes))
    return np.concatenate(pieces)


def short_zones(scenario: Scenario, system: System) -> FloatArray:
    """First and last arc length (zones, 2) in m of the zones of short elements at ends, towers and loads."""
    elements, length = scenario.cable.elements, scenario.cable.unstrained_length
    assert isinstance(elements, Grading)
    towers = [*scenario.towers.values()]
    half = np.array([0.5 * tower.length for tower in towers]) + MARGIN * elements.at_towers
    middle = _equilibrium_at_towers(system)
    places = np.array([0.0, *(load.arc_length for load in scenario.cable.loads), length])
    points = np.stack([places, places], axis=1)
    return np.concatenate([points[:-1], np.stack([middle - half, middle + half], axis=1), points[-1:]])


def _equilibrium_at_towers(system: System) -> FloatArray:
    """Arc length (towers,) in m of the bare cable at each tower: in equilibrium, else proportional to chords."""
    towers = system.towers.top
    if towers.shape[0] == 0:
        return np.zeros(0)
    try:
        return np.cumsum(rest_over_supports(system).length)[:-1]
    except EquilibriumError:  # whoever starts it will say so
        corners = np.concatenate([system.cable.end_position[:1], towers, system.cable.end_position[1:]])
        way = np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))
        return way[:-1] / way[-1] * system.cable.unstrained_length


def graded_nodes(length: float, elements: Grading, zones: FloatArray) -> FloatArray:
    """Arc lengths (nodes,) in m of a mesh: elements grow with distance from `zones` (zones, 2) in m, up to a target.

    An element at s is as long as l(s) = min(target, at_towers + ln(growth) d), d the distance to the nearest zone, as
    lengths in a geometric series are: node k is where ∫ds/l is k, all stretched to end on a node.
    """
    count = int(np.ceil(length / (RESOLUTION * elements.at_towers)))
    s = np.linspace(0.0, length, count + 1)
    apart = np.full(s.size, np.inf)
    for first, last in zones:
        np.minimum(apart, np.maximum(np.maximum(first - s, s - last), 0.0), out=apart)
    density = 1.0 / np.minimum(elements.target, elements.at_towers + log(elements.growth) * apart)
    passed = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1])) * (length / count)])
    whole = max(round(float(passed[-1])), 1)
    nodes = np.interp(np.arange(whole + 1) * (passed[-1] / whole), passed, s)
    nodes[0], nodes[-1] = 0.0, length
    return nodes
