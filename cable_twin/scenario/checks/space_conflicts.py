"""Consistency checks of towers and terrain in space."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, degrees

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.catenary import EquilibriumError, line_over, rest_over_supports
from cable_twin.scenario.builders.system import build_system, tower_axes
from cable_twin.scenario.checks.fault import Fault, KeyPath, refuse, show
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import Tower

MOST_TURN = 60.0  # degrees in plan at a tower; sheaves turn a rope by a few, and stations by more
ALONG = 0.9  # cosine to the rope from which on a groove opens along it


def space_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of towers and terrain in space, and of their keys in a plane."""
    cable = scenario.cable
    places = [cable.start.position, *(tower.position for tower in scenario.towers.values()), cable.end.position]
    corners = [np.array(scenario.vector(place), dtype=np.float64) for place in places]
    for number, (name, tower) in enumerate(scenario.towers.items()):
        if scenario.dim == 2:
            for key in ("groove_direction", "mast_offset", "mast_width"):
                given = getattr(tower, key)
                if given is not None:
                    given = list(given) if isinstance(given, tuple) else given
                    yield refuse(
                        ("towers", name, key), given, "null, as only scenarios in space have it", detail=" in a plane"
                    )
        elif all(map(np.any, np.diff(corners[number : number + 3], axis=0))):
            yield from _tower(scenario, ("towers", name), tower, corners[number : number + 3])
    yield from _sides(scenario)


def _tower(scenario: Scenario, path: KeyPath, tower: Tower, corners: list[np.ndarray]) -> Iterator[Fault]:
    """Faults of a tower: line turning back in plan, groove opening away from the rope, incomplete mast."""
    first, second = np.diff(corners, axis=0)[:, :2]
    turn = degrees(abs(atan2(first[0] * second[1] - first[1] * second[0], first @ second)))
    if turn >= MOST_TURN:
        yield refuse(
            (*path, "position"),
            list(tower.position),
            f"less than {MOST_TURN:g} degrees",
            detail=f", where the line turns by {turn:.3g} degrees in plan, which no rope follows on a tower",
        )
    if (tower.mast_offset is None) != (tower.mast_width is None):
        missing = "mast_offset" if tower.mast_offset is None else "mast_width"
        yield Fault((*path, missing), "not given, but a mast has an offset and a width; allowed: both or none, in m")
    if tower.groove_direction is None:
        return
    path, opening = (*path, "groove_direction"), np.array(scenario.vector(tower.groove_direction))
    given, size = show(list(tower.groove_direction)), float(np.linalg.norm(opening))
    if size == 0.0:
        yield Fault(path, f"given {given}; allowed: a direction, not all numbers zero")
    elif opening[2] * (-1.0 if tower.hold_down else 1.0) <= 0.0:
        where = "below 0, as it holds the rope down" if tower.hold_down else "above 0"
        yield Fault(path, f"given {given}, which points away from the rope; allowed: x, y, z with z {where}")
    elif abs(float(line_over(*corners) @ opening)) > ALONG * size:
        yield Fault(path, f"given {given}, which points along the rope; allowed: a direction across it")


def rest_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of towers in space whose grooves cannot hold the bare ropes in equilibrium.

    Strands of a loop share its tension: `groove_faults` checks them where that tension is known.
    """
    for name in scenario.cables:
        alone = scenario.of_rope(name)
        if name in scenario.strands or alone.dim == 2 or not alone.towers:
            continue
        system = build_system(alone)
        try:
            yield from groove_faults(alone, system)
        except EquilibriumError:
            continue  # which is said where it is to be laid


def groove_faults(scenario: Scenario, system: System) -> Iterator[Fault]:
    """Faults of towers in space whose grooves cannot hold one bare rope in equilibrium.

    Args:
        scenario: of this rope alone.
        system: its parameters, with ends where they are at rest.

    Raises:
        EquilibriumError: there is no rest.
    """
    loads = rest_over_supports(system).load()
    corners = np.concatenate([system.cable.end_position[:1], system.towers.top, system.cable.end_position[1:]])
    sides, _ = tower_axes(scenario)
    for number, (name, tower) in enumerate(scenario.towers.items()):
        load, side, (before, here, after) = loads[number], sides[number], corners[number : number + 3]
        normal = float(load @ side)
        if normal <= 0.0 and tower.groove_direction is not None:
            force = np.round(load / np.linalg.norm(load), 2).tolist()
            yield refuse(
                ("towers", name, "groove_direction"),
                list(tower.groove_direction),
                f"within 90 degrees of the force of the tower on the cable, {force}",
                detail=", which points away from the bare cable at rest: it would have to be pulled into the groove "
                f"with {with_unit(-normal, 'N')}",
            )
        across = np.cross(line_over(before, here, after), side)
        ratio = abs(float(load @ across / np.linalg.norm(across))) / normal if normal > 0.0 else 0.0
        if ratio > tower.derailment_ratio:
            share = (here - before)[:2] @ (after - before)[:2] / np.square((after - before)[:2]).sum()
            straight = float(before[1] + share * (after - before)[1])
            yield refuse(
                ("towers", name, "position"),
                list(tower.position),
                f"at most {tower.derailment_ratio:g} of it (derailment_ratio): move the tower towards "
                f"y = {straight:.4g} m, where the line is straight in plan, or incline its groove_direction",
                detail=f", where the bare cable at rest pushes sideways with {with_unit(ratio * normal, 'N')}, "
                f"{ratio:.3g} of its normal force",
            )


def _sides(scenario: Scenario) -> Iterator[Fault]:
    """Faults of terrain profiles beside the track: in a plane, without terrain, or not in rising x."""
    sides, path = scenario.terrain_sides, ("terrain_sides",)
    if sides is None:
        return
    if scenario.dim == 2:
        yield Fault(path, "given in a plane; allowed: null, as only scenarios in space have it")
    if not scenario.terrain:
        yield Fault(path, "given without terrain; allowed: only beside terrain, the profile under the track")
    for side in ("left", "right"):
        x = [point[0] for point in getattr(sides, side)]
        for number, (before, after) in enumerate(pairwise(x), start=1):
            if after <= before:
                yield Fault((*path, side, number), f"given x = {after!r} after {before!r}; allowed: rising x, in m")


__all__ = ["groove_faults", "rest_faults", "space_faults"]
