"""Consistency checks of ropes, ends, towers, loads and terrain."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, copysign, degrees, dist, hypot, nan

import numpy as np

from cable_twin.basics.units import rounded, with_unit
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.catenary import EquilibriumError, line_over, rest_over_supports
from cable_twin.scenario.builders.system import build_system, tower_axes
from cable_twin.scenario.checks.fault import Fault, KeyPath, name_faults, refuse, show
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import MOST_ELEMENTS, Cable, EndSupport, Grading, Tower

LARGEST_STRAIN = 0.05  # to reach the far end; no rope survives more
HELD = {"pinned", "clamped", "hydraulic", "counterweight"}  # supports of an end that has a place


def cable_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of the cable with its ends, towers, loads and terrain."""
    yield from _dimensions(scenario)
    yield from _elements(scenario.cable)
    yield from _kinks(scenario)
    yield from _supports(scenario)
    yield from _span(scenario)
    yield from _towers(scenario)
    yield from _loads(scenario.cable)
    yield from _terrain(scenario)


def _dimensions(scenario: Scenario) -> Iterator[Fault]:
    """Faults of plane vectors in a scenario in space, and vice versa."""
    cable, dim = scenario.cable, scenario.dim
    places: dict[KeyPath, tuple[float, ...] | None] = {}
    for name, end in (("start", cable.start), ("end", cable.end)):
        places[("cable", name, "position")] = end.position
        places[("cable", name, "direction")] = end.direction
    places |= {("towers", name, "position"): tower.position for name, tower in scenario.towers.items()}
    for path, given in places.items():
        if given is not None and len(given) == 2 < dim and scenario.space is None:
            yield refuse(path, list(given), f"x, y, z{_unit(path)}", detail=" while other positions have three numbers")
    places |= {("cable", "loads", number, "force"): load.force for number, load in enumerate(cable.loads)}
    places[("air", "wind")] = scenario.air.wind
    for path, given in places.items():
        if given is not None and len(given) > dim:
            space = "space: 3 or positions x, y, z"
            yield refuse(path, list(given), f"x, z{_unit(path)}, or {space} throughout", detail=" in a plane")
    if dim == 3 and any(load.moment != 0.0 for load in cable.loads):
        yield Fault(("cable", "loads"), "given a moment in space; allowed: moments on a cable in a plane, in N m")


def _unit(path: KeyPath) -> str:
    """Unit of a vector for a fault; empty for a direction."""
    return {"position": " in m", "force": " in N", "wind": " in m/s"}.get(str(path[-1]), "")


def _elements(cable: Cable) -> Iterator[Fault]:
    """Faults of a mesh grading: no growth towards the target, or too many elements."""
    if isinstance(cable.elements, Grading):
        at_towers, target = cable.elements.at_towers, cable.elements.target
        if at_towers > target:
            yield refuse(("cable", "elements", "at_towers"), at_towers, f"at most target, {show(target)} m")
        least = cable.unstrained_length / MOST_ELEMENTS
        if at_towers < least:
            yield refuse(
                ("cable", "elements", "at_towers"),
                at_towers,
                f"at least {least:g} m for {show(cable.unstrained_length)} m of rope",
            )


def _kinks(scenario: Scenario) -> Iterator[Fault]:
    """Faults of sharp kinks at joints without compliance, or without tension."""
    cable = scenario.cable
    if cable.kinks == "rounded":
        return
    clamped = next((name for name, vehicle in scenario.vehicles.items() if vehicle.clamped_to), None)
    beside = {
        f"elastic_model {cable.elastic_model}": cable.elastic_model != "continuum",
        f"integrator {scenario.solver.integrator}": scenario.solver.integrator != "generalized_alpha",
        f"initial_shape {cable.initial_shape}, which has no tension": cable.initial_shape != "equilibrium",
        "an end that is free": "free" in (cable.start.support, cable.end.support),
        f"{clamped!r}, which is clamped to another rope": clamped is not None,
    }
    for what, found in beside.items():
        if found:
            yield refuse(("cable", "kinks"), cable.kinks, "rounded", detail=f" beside {what}")
            return


def _supports(scenario: Scenario) -> Iterator[Fault]:
    cable = scenario.cable
    for name in ("start", "end"):
        end = getattr(cable, name)
        path = ("cable", name, "direction")
        if end.support in ("clamped", "counterweight"):
            if end.direction is None:
                yield Fault(path, f"nothing given, but {_kind(end)} needs it; allowed: a list of 2 finite numbers")
            elif hypot(*end.direction) == 0.0:
                yield refuse(path, list(end.direction), "a direction, not all numbers zero")
        elif end.support is not None and end.direction is not None:
            yield refuse(
                path,
                list(end.direction),
                "only where clamped or at a counterweight",
                detail=f" where support is {end.support}",
            )
    if cable.start.support == cable.end.support == "free" and cable.initial_shape != "straight":
        yield Fault(
            ("cable", "end", "support"),
            "given 'free' at both ends; allowed: pinned or clamped at one at least, or initial_shape: straight",
        )
    if cable.start.support == cable.end.support == "counterweight":
        yield Fault(("cable", "end", "support"), "given 'counterweight' at both ends; allowed: at one of them")
    for name in ("start", "end"):
        if getattr(cable, name).support is not None:
            yield from _counterweight(scenario, name)


def _kind(end: EndSupport) -> str:
    """Kind of an end support, in words."""
    return "a counterweight" if end.support == "counterweight" else f"a {end.support} end"


def _counterweight(scenario: Scenario, name: str) -> Iterator[Fault]:
    """Faults of missing keys of a counterweight, and of its keys at other supports."""
    cable = scenario.cable
    end = getattr(cable, name)
    path = ("cable", name)
    if end.support != "counterweight":
        for key, unit in (("mass", "kg"), ("force", "N"), ("travel", "m"), ("buffer_stiffness", "N/m")):
            given = getattr(end, key)
            if given is not None:
                given = list(given) if isinstance(given, tuple) else given
                yield refuse(
                    (*path, key),
                    given,
                    f"only at a counterweight, in {unit}",
                    detail=f" where support is {end.support}",
                )
        return
    if end.mass is None:
        yield Fault((*path, "mass"), "nothing given, but a counterweight needs it; allowed: a number above 0, in kg")
    pull = (end.mass or nan) * scenario.gravity if end.force is None else end.force
    if pull == 0.0:
        yield Fault((*path, "force"), "nothing given, and no weight without gravity; allowed: a number above 0, in N")
    if pull > LARGEST_STRAIN * cable.axial_stiffness:
        yield Fault(
            (*path, "mass" if end.force is None else "force"),
            f"given a pull of {with_unit(pull, 'N', 6)}, a strain of "
            f"{rounded(100.0 * pull / cable.axial_stiffness, 3)} %; "
            "allowed: at most "
            f"{with_unit(LARGEST_STRAIN * cable.axial_stiffness, 'N', 6)}, for a strain of "
            f"{rounded(100.0 * LARGEST_STRAIN, 3)} %",
        )
    if end.travel is not None and end.travel[0] >= end.travel[1]:
        yield refuse((*path, "travel"), list(end.travel), "the least travel, then a greater one, in m")
    if end.direction is not None:
        corners = [cable.start.position, *(tower.position for tower in scenario.towers.values()), cable.end.position]
        inner = corners[-2] if name == "end" else corners[1]
        here, before, pull = (scenario.vector(v) for v in (end.position, inner, end.direction))
        if sum((a - b) * c for a, b, c in zip(here, before, pull, strict=True)) <= 0.0 < hypot(*pull):
            yield refuse(
                (*path, "direction"),
                list(end.direction),
                f"one that pulls it away from {show(list(inner))}",
                detail=", which lets the cable go slack",
            )


def _span(scenario: Scenario) -> Iterator[Fault]:
    cable = scenario.cable
    start, end = cable.start, cable.end
    if not {start.support, end.support} <= HELD:
        return
    if dist(scenario.vector(end.position), scenario.vector(start.position)) <= 1e-6 * cable.unstrained_length:
        yield refuse(
            ("cable", "end", "position"), list(end.position), "another place, in m", detail=", the place of the start"
        )
    corners = [start.position, *(tower.position for tower in scenario.towers.values()), end.position]
    way = sum(dist(scenario.vector(a), scenario.vector(b)) for a, b in pairwise(corners))
    strain = way / cable.unstrained_length - 1.0
    over = " apart" if not scenario.towers else " apart over the towers"
    if "counterweight" in (start.support, end.support):
        if cable.initial_shape == "straight":
            yield Fault(("cable", "initial_shape"), "given 'straight' with a counterweight; allowed: equilibrium")
        return
    if cable.initial_shape == "straight" and abs(strain) > 1e-9:
        yield Fault(
            ("cable", "initial_shape"),
            f"given 'straight', unstrained, between held ends {way:.9g} m apart with a cable of "
            f"{cable.unstrained_length:.9g} m; allowed: equilibrium, or a free end",
        )
    if strain > LARGEST_STRAIN:
        yield refuse(
            ("cable", "unstrained_length"),
            cable.unstrained_length,
            f"at least {way / (1.0 + LARGEST_STRAIN):.6g} m, for a strain of {rounded(100.0 * LARGEST_STRAIN, 3)} %",
            detail=f" for ends that are {way:.6g} m{over}, which needs a strain of {rounded(100.0 * strain, 3)} % "
            f"and a tension of {with_unit(cable.axial_stiffness * strain, 'N', 3)}",
        )


def _towers(scenario: Scenario) -> Iterator[Fault]:
    cable = scenario.cable
    start, end = cable.start, cable.end
    if scenario.towers and "free" in (start.support, end.support):
        yield Fault(("towers",), "given with a free end of the cable; allowed: only where both ends are held")
    weighted = "counterweight" in (start.support, end.support)
    if scenario.towers and cable.initial_shape == "straight" and not weighted:
        yield Fault(("cable", "initial_shape"), "given 'straight' over towers; allowed: equilibrium")
    way = copysign(1.0, end.position[0] - start.position[0])
    before, passed = "the start", start.position[0]
    for name, tower in scenario.towers.items():
        path = ("towers", name)
        yield from name_faults(path)
        if name in ("start", "end"):
            yield Fault(path, f"given the name {name!r}, that of an end of the cable; allowed: another one")
        x = tower.position[0]
        if way * (x - passed) <= 0.0 or way * (end.position[0] - x) <= 0.0:
            yield refuse(
                (*path, "position"),
                list(tower.position),
                f"x between {passed:g} m of {before} and {end.position[0]:g} m of the end, in order along the cable",
            )
        before, passed = f"tower {name!r}", x
        if tower.contacts > 1 and tower.length == 0.0:
            yield Fault((*path, "length"), f"given 0.0 for {tower.contacts} contacts; allowed: a number above 0, in m")
        if tower.contacts == 1 and tower.length > 0.0:
            yield refuse((*path, "length"), tower.length, "0, or more contacts", detail=" for one contact")
        if tower.radius is not None and tower.length > tower.radius:
            yield refuse(
                (*path, "length"),
                tower.length,
                f"at most {tower.radius:g} m",
                detail=f", more than one radian of a circle of {tower.radius:g} m",
            )


def _loads(cable: Cable) -> Iterator[Fault]:
    length = cable.unstrained_length
    for number, load in enumerate(cable.loads):
        path: KeyPath = ("cable", "loads", number)
        if load.arc_length > length:
            yield refuse((*path, "arc_length"), load.arc_length, f"0 to {length:.9g} m, on the cable")
        elif load.moment != 0.0 and 0.0 < load.arc_length < length:
            yield refuse((*path, "moment"), load.moment, "only at its ends, in N m", detail=" within the cable")


def _terrain(scenario: Scenario) -> Iterator[Fault]:
    terrain = scenario.terrain
    if not terrain:
        return
    x = [point[0] for point in terrain]
    if len(x) < 2:
        yield Fault(("terrain",), f"given {len(x)} point; allowed: at least 2 points x, z, in m")
        return
    for number, (before, after) in enumerate(pairwise(x), start=1):
        if after <= before:
            yield Fault(("terrain", number), f"given x = {after!r} after {before!r}; allowed: rising x, in m")
    low, high = sorted((scenario.cable.start.position[0], scenario.cable.end.position[0]))
    if x[0] > low or x[-1] < high:
        yield Fault(
            ("terrain",),
            f"given from x = {x[0]:g} to {x[-1]:g} m; allowed: at least the whole track, {low:g} to {high:g} m",
        )


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
