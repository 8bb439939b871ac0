"""Consistency checks of the line of a rope: ends, mesh, towers, loads and terrain."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, copysign, degrees, dist, hypot, nan

import numpy as np

from cable_twin.basics.units import rounded, with_unit
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.catenary import EquilibriumError, line_over, rest_over_supports
from cable_twin.scenario.builders.system import build_system, tower_axes
from cable_twin.scenario.checks.fault import NOTHING, Fault, KeyPath, Phrase, name_faults, of_space, refuse, show
from cable_twin.scenario.checks.wrong_units import rope_faults
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import MOST_ELEMENTS, Cable, EndSupport, Grading, Tower
from cable_twin.scenario.sections.quantities import Vector

LARGEST_STRAIN = 0.05  # to reach the far end; no rope survives more
HELD = {"pinned", "clamped", "hydraulic", "counterweight"}  # supports of an end that has a position
MOST_TURN = 60.0  # degrees in plan at a tower; sheave assemblies deflect a rope by a few, and stations by more
ALONG = 0.9  # cosine to the rope from which on a groove opens along it
IN_GROOVE = ("groove", "groove_friction", "groove_height", "derailment_ratio")  # of a tower, sideways
DIRECTION = "a direction, not all numbers zero"
ONLY_SPACE = "null; for scenarios in space only"


def line_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario of one rope: ends, mesh, towers, loads and terrain; key paths start with `cable`."""
    yield from _dimensions(scenario)
    yield from rope_faults(scenario.cable)
    yield from _grading(scenario.cable)
    yield from _joint(scenario)
    yield from _supports(scenario)
    yield from _span(scenario)
    yield from _towers(scenario)
    yield from _loads(scenario.cable)
    yield from _terrain(scenario)
    yield from _grooves_and_masts(scenario)
    yield from _terrain_sides(scenario)


def _dimensions(scenario: Scenario) -> Iterator[Fault]:
    """Errors of vectors with two numbers in a scenario in space, or with three numbers in a plane."""
    cable, dim = scenario.cable, scenario.dim
    vectors: dict[KeyPath, tuple[float, ...] | None] = {}
    for name, end in cable.ends.items():
        vectors[("cable", name, "position")] = end.position
        vectors[("cable", name, "direction")] = end.direction
    vectors |= {("towers", name, "position"): tower.position for name, tower in scenario.towers.items()}
    for path, given in vectors.items():
        if given is not None and len(given) == 2 < dim and scenario.space is None:
            yield refuse(path, given, f"x, y, z{_unit(path)}", "other positions have three numbers")
    vectors |= {("cable", "loads", number, "force"): load.force for number, load in enumerate(cable.loads)}
    vectors[("air", "wind")] = scenario.air.wind
    for path, given in vectors.items():
        if given is not None and len(given) > dim:
            allowed = f"x, z{_unit(path)}; x, y, z only with `space: 3` or if all positions have x, y, z"
            yield refuse(path, given, allowed, "three numbers in a plane")
    if dim == 3 and any(load.moment != 0.0 for load in cable.loads):
        yield refuse(
            ("cable", "loads"), Phrase("a moment in space"), "0 N m in space; other moments only on a cable in a plane"
        )


def _unit(path: KeyPath) -> str:
    """Unit of a vector for an error message, such as " in m"; empty for a direction."""
    return {"position": " in m", "force": " in N", "wind": " in m/s"}.get(str(path[-1]), "")


def _grading(cable: Cable) -> Iterator[Fault]:
    """Errors in a rope's graded mesh: no growth of elements towards the target length, or too many elements."""
    if isinstance(cable.elements, Grading):
        path: KeyPath = ("cable", "elements", "at_towers")
        at_towers, target, length = cable.elements.at_towers, cable.elements.target, cable.unstrained_length
        if at_towers > target:
            yield refuse(path, at_towers, f"at most target, {show(target)} m")
        if at_towers < (least := length / MOST_ELEMENTS):
            yield refuse(path, at_towers, f"at least {least:g} m for {show(length)} m of rope")


def _joint(scenario: Scenario) -> Iterator[Fault]:
    """Error of `cable.joint: node` in a scenario whose vehicles cannot be at nodes of the mesh."""
    if scenario.cable.joint == "node" and (reason := scenario.paper_reason):
        yield refuse(("cable", "joint"), "node", "paper, or null", reason)


def _supports(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a rope's end supports: directions, combinations that are impossible, and counterweights."""
    cable = scenario.cable
    for name, end in cable.ends.items():
        path = ("cable", name, "direction")
        if end.support in ("clamped", "counterweight"):
            if end.direction is None:
                kind = "a counterweight" if end.support == "counterweight" else "a clamped end"
                yield refuse(path, NOTHING, "a list of 2 finite numbers, 3 in space", f"{kind} needs it")
            elif hypot(*end.direction) == 0.0:
                yield refuse(path, end.direction, DIRECTION)
        elif end.support is not None and end.direction is not None:
            yield refuse(path, end.direction, "null; only of a clamped end or a counterweight", _where(end))
    path = ("cable", "end", "support")
    if cable.start.support == cable.end.support == "free" and cable.initial_shape != "straight":
        allowed = "pinned or clamped at one at least, or initial_shape: straight"
        yield refuse(path, cable.end.support, allowed, "at both ends")
    if cable.start.support == cable.end.support == "counterweight":
        yield refuse(path, cable.end.support, "a counterweight at one end only", "at both ends")
    for name, end in cable.ends.items():
        if end.support == "counterweight":
            yield from _counterweight(scenario, name, end)
        elif end.support is not None:
            for key, unit in (("mass", "kg"), ("force", "N"), ("travel", "m"), ("buffer_stiffness", "N/m")):
                if (given := getattr(end, key)) is not None:
                    yield refuse(
                        ("cable", name, key),
                        given,
                        f"null, or a value in {unit} with support: counterweight",
                        _where(end),
                    )


def _where(end: EndSupport) -> str:
    """Reason in words for refusing a key: another kind of end support."""
    return f"where support is {end.support}"


def _counterweight(scenario: Scenario, name: str, end: EndSupport) -> Iterator[Fault]:
    """Errors in a counterweight at a rope's end: missing keys, pull, travel, and direction."""
    path, stiffness = ("cable", name), scenario.cable.axial_stiffness
    if end.mass is None:
        yield refuse((*path, "mass"), NOTHING, "a number above 0, in kg", "a counterweight needs it")
    pull = (end.mass or nan) * scenario.gravity if end.force is None else end.force
    if pull == 0.0:
        yield refuse((*path, "force"), NOTHING, "a number above 0, in N", "there is no weight without gravity")
    if pull > LARGEST_STRAIN * stiffness:
        key = "mass" if end.force is None else "force"
        yield refuse(
            (*path, key),
            getattr(end, key),
            f"a pull of at most {with_unit(LARGEST_STRAIN * stiffness, 'N', 6)}, "
            f"for a strain of {rounded(100.0 * LARGEST_STRAIN, 3)} %",
            f"a pull of {with_unit(pull, 'N', 6)}, a strain of {rounded(100.0 * pull / stiffness, 3)} %",
        )
    if end.travel is not None and end.travel[0] >= end.travel[1]:
        yield refuse((*path, "travel"), end.travel, "the least travel, then a greater one, in m")
    if end.direction is not None:
        inner = scenario.corners[-2 if name == "end" else 1]
        here, before, direction = (scenario.vector(v) for v in (end.position, inner, end.direction))
        if sum((a - b) * c for a, b, c in zip(here, before, direction, strict=True)) <= 0.0 < hypot(*direction):
            allowed = f"a direction that pulls the cable away from {show(inner, 'm')}"
            yield refuse((*path, "direction"), end.direction, allowed, "this direction lets the cable go slack")


def _span(scenario: Scenario) -> Iterator[Fault]:
    """Errors in the distance of a rope's end supports: zero, or not consistent with the length of the rope."""
    cable = scenario.cable
    start, end, length = cable.start, cable.end, cable.unstrained_length
    if not cable.supports <= HELD:
        return
    if dist(scenario.vector(end.position), scenario.vector(start.position)) <= 1e-6 * length:
        yield refuse(("cable", "end", "position"), end.position, "another place, in m", "it is the place of the start")
    low, high = sorted((start.position[0], end.position[0]))
    towers = [place for place in scenario.corners[1:-1] if low < place[0] < high]  # others are a fault of their own
    corners = [scenario.vector(corner) for corner in (start.position, *towers, end.position)]
    for name, place in (("start", 0), ("end", -1)):
        if cable.ends[name].support == "counterweight":
            corners[place] = _innermost(scenario, cable.ends[name], corners[1 if place == 0 else -2])
    distance = sum(dist(a, b) for a, b in pairwise(corners))
    strain = distance / length - 1.0
    path = ("cable", "initial_shape")
    weighted = "counterweight" in cable.supports
    if weighted and cable.initial_shape == "straight":
        yield refuse(path, cable.initial_shape, "equilibrium", "with a counterweight")
    elif cable.initial_shape == "straight" and abs(strain) > 1e-9:
        why = f"an unstrained cable of {length:.9g} m is not straight between held ends {distance:.9g} m apart"
        yield refuse(path, cable.initial_shape, "equilibrium, or a free end", why)
    if strain > LARGEST_STRAIN:
        over = " over the towers" if scenario.towers else ""
        over += " with the counterweight as far in as it goes" if weighted else ""
        yield refuse(
            ("cable", "unstrained_length"),
            length,
            f"at least {distance / (1.0 + LARGEST_STRAIN):.6g} m, "
            f"for a strain of {rounded(100.0 * LARGEST_STRAIN, 3)} %",
            f"its ends are {distance:.6g} m apart{over}, which needs a strain of {rounded(100.0 * strain, 3)} % "
            f"and a tension of {with_unit(cable.axial_stiffness * strain, 'N', 3)}",
        )


def _innermost(scenario: Scenario, end: EndSupport, inner: tuple[float, ...]) -> tuple[float, ...]:
    """Place (m) of an end with its counterweight as near to the next corner as travel lets it; without limits there."""
    if end.travel is None or not end.direction:
        return inner
    place, direction = scenario.vector(end.position), scenario.vector(end.direction)
    size = hypot(*direction) or nan
    nearest = sum((a - b) * c / size for a, b, c in zip(inner, place, direction, strict=False))
    travel = min(max(nearest, end.travel[0]), end.travel[1])
    return tuple(a + travel * b / size for a, b in zip(place, direction, strict=False))


def _towers(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a rope's towers: a free rope end, wrong order along the rope, or inconsistent contacts."""
    cable = scenario.cable
    start, end = cable.start.position[0], cable.end.position[0]
    if scenario.towers and "free" in cable.supports:
        yield refuse(("towers",), scenario.towers, "only where both ends of the rope are held", "an end is free")
    if scenario.towers and cable.initial_shape == "straight" and "counterweight" not in cable.supports:
        yield refuse(("cable", "initial_shape"), cable.initial_shape, "equilibrium", "over towers")
    sense = copysign(1.0, end - start)
    before, passed = "the start", start
    for name, tower in scenario.towers.items():
        path = ("towers", name)
        yield from name_faults(path)
        if name in ("start", "end"):
            yield refuse(path, Phrase(f"the name {name!r}"), "another name", "an end of the cable has this name")
        x = tower.position[0]
        if sense * (x - passed) <= 0.0 or sense * (end - x) <= 0.0:
            allowed = f"x between {passed:g} m ({before}) and {end:g} m (the end), in order along the cable"
            yield refuse((*path, "position"), tower.position, allowed)
        before, passed = f"tower {name!r}", x
        yield from _contacts((*path, "length"), tower)
    yield from _room(scenario)


def _room(scenario: Scenario) -> Iterator[Fault]:
    """Errors in the length of a rope's towers: contacts that reach over an end or over a shorter neighbour."""
    cable, towers = scenario.cable, scenario.towers
    names = ["the start", *towers, "the end"]
    corners = [scenario.vector(place) for place in (cable.start.position, *scenario.corners[1:-1], cable.end.position)]
    lengths = [0.0, *(tower.length for tower in towers.values()), 0.0]
    for number, (name, tower) in enumerate(towers.items(), start=1):
        away = {other: dist(corners[number], corners[other]) for other in (number - 1, number + 1)}
        over = [
            other
            for other, distance in away.items()
            if (lengths[other], other) < (tower.length, number)  # of two that are equally long told once
            and 0.0 < distance < 0.5 * (lengths[other] + tower.length)
        ]
        if over:
            other = min(over, key=lambda one: away[one])
            length = f", {lengths[other]:g} m long" if lengths[other] else ""
            why = f"it reaches over {names[other]}, {rounded(away[other], 3)} m away{length}"
            allowed = f"at least {rounded(0.5 * (lengths[other] + tower.length), 3)} m between them, or less length"
            yield refuse(("towers", name, "length"), tower.length, allowed, why)


def _contacts(path: KeyPath, tower: Tower) -> Iterator[Fault]:
    """Errors in a tower's length: too short for its number of contacts, or too long for its radius."""
    if tower.contacts > 1 and tower.length == 0.0:
        yield refuse(path, tower.length, "a number above 0, in m", f"for {tower.contacts} contacts")
    if tower.contacts == 1 and tower.length > 0.0:
        yield refuse(path, tower.length, "0 m, or more contacts", "for one contact")
    if tower.radius is not None and tower.length > tower.radius:
        why = f"more than one radian of a circle of {tower.radius:g} m"
        yield refuse(path, tower.length, f"at most {tower.radius:g} m", why)


def _loads(cable: Cable) -> Iterator[Fault]:
    """Errors in a scenario's loads on a rope: places beyond the rope, or moments between the ends."""
    length = cable.unstrained_length
    for number, load in enumerate(cable.loads):
        path: KeyPath = ("cable", "loads", number)
        if load.arc_length > length:
            yield refuse((*path, "arc_length"), load.arc_length, f"0 to {length:.9g} m, on the cable")
        elif load.moment != 0.0 and 0.0 < load.arc_length < length:
            yield refuse(
                (*path, "moment"),
                load.moment,
                "0 N m, or arc_length at an end of the cable",
                "between the ends of the cable",
            )


def _terrain(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's terrain: too few points, x that does not rise, or track without ground below."""
    path, terrain = ("terrain",), scenario.terrain
    if len(terrain) == 1:
        yield refuse(path, Phrase("1 point"), "at least 2 points x, z, in m")
    if len(terrain) < 2:
        return
    yield from _rising(path, terrain)
    first, last = terrain[0][0], terrain[-1][0]
    low, high = sorted((scenario.cable.start.position[0], scenario.cable.end.position[0]))
    if first > low or last < high:
        allowed = f"at least the whole track, {low:g} to {high:g} m"
        yield refuse(path, Phrase(f"x from {first:g} to {last:g} m"), allowed)


def _rising(path: KeyPath, points: tuple[Vector, ...]) -> Iterator[Fault]:
    """Errors in the points x, z of a terrain profile: x that does not rise from point to point."""
    for number, ((before, _), (after, _)) in enumerate(pairwise(points), start=1):
        if after <= before:
            yield refuse((*path, number), Phrase(f"x = {after!r} m after {before!r} m"), "rising x, in m")


def _grooves_and_masts(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's towers: grooves and masts in space, and keys that are not allowed in a plane."""
    corners = [np.array(scenario.vector(place), dtype=np.float64) for place in scenario.corners]
    for number, (name, tower) in enumerate(scenario.towers.items()):
        if scenario.dim == 2:
            for key in ("groove_direction", "mast_offset", "mast_width"):
                if (given := getattr(tower, key)) is not None:
                    yield refuse(("towers", name, key), given, ONLY_SPACE, "in a plane")
            yield from of_space(("towers", name), tower, IN_GROOVE)
        elif all(map(np.any, np.diff(corners[number : number + 3], axis=0))):
            yield from _tower_in_space(scenario, ("towers", name), tower, corners[number : number + 3])


def _tower_in_space(scenario: Scenario, path: KeyPath, tower: Tower, corners: list[np.ndarray]) -> Iterator[Fault]:
    """Errors in a tower in space: sharp turn of the line in plan, groove away from the rope, incomplete mast."""
    first, second = np.diff(corners, axis=0)[:, :2]
    turn = degrees(abs(atan2(first[0] * second[1] - first[1] * second[0], first @ second)))
    if turn >= MOST_TURN:
        why = f"there the line turns by {turn:.3g} degrees in plan, which no rope follows on a tower"
        yield refuse((*path, "position"), tower.position, f"a turn of less than {MOST_TURN:g} degrees", why)
    if (tower.mast_offset is None) != (tower.mast_width is None):
        missing = "mast_offset" if tower.mast_offset is None else "mast_width"
        yield refuse((*path, missing), NOTHING, "both or none, in m", "a mast has an offset and a width")
    if tower.groove_direction is None:
        return
    path, given, opening = (*path, "groove_direction"), tower.groove_direction, scenario.vector(tower.groove_direction)
    if (size := hypot(*opening)) == 0.0:
        yield refuse(path, given, DIRECTION)
    elif opening[2] * (-1.0 if tower.hold_down else 1.0) <= 0.0:
        where = "below 0, as it holds the rope down" if tower.hold_down else "above 0"
        yield refuse(path, given, f"x, y, z with z {where}", "it points away from the rope")
    elif abs(float(line_over(*corners) @ np.array(opening))) > ALONG * size:
        yield refuse(path, given, "a direction across the rope", "it points along the rope")


def _terrain_sides(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's terrain profiles beside the track: in a plane, without terrain, or x not rising."""
    sides, path = scenario.terrain_sides, ("terrain_sides",)
    if sides is None:
        return
    if scenario.dim == 2:
        yield refuse(path, sides, ONLY_SPACE, "in a plane")
    if not scenario.terrain:
        yield refuse(path, sides, "null; only with `terrain`, the profile under the track", "without terrain")
    yield from _rising((*path, "left"), sides.left)
    yield from _rising((*path, "right"), sides.right)


def equilibrium_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's towers in space whose grooves cannot hold the ropes without vehicles in equilibrium.

    Strands of a loop share its tension: `groove_faults` checks them where that tension is known.
    """
    for name in scenario.cables:
        alone = scenario.of_rope(name)
        if name in scenario.strands or alone.dim == 2 or not alone.towers:
            continue
        try:
            yield from groove_faults(alone, build_system(alone))
        except EquilibriumError:
            continue  # a fault of the static start


def groove_faults(scenario: Scenario, system: System) -> Iterator[Fault]:
    """Errors in towers in space whose grooves cannot hold one rope without vehicles in equilibrium.

    Args:
        scenario: scenario of this rope alone.
        system: its parameters, with ends where they are in equilibrium.

    Raises:
        EquilibriumError: there is no equilibrium.
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
                tower.groove_direction,
                f"within 90 degrees of the force of the tower on the cable, {force}",
                "it points away from the bare cable at rest, which would have to be pulled into the groove "
                f"with {with_unit(-normal, 'N')}",
            )
        across = np.cross(line_over(before, here, after), side)
        ratio = abs(float(load @ across / np.linalg.norm(across))) / normal if normal > 0.0 else 0.0
        if ratio > tower.derailment_ratio:
            share = (here - before)[:2] @ (after - before)[:2] / np.square((after - before)[:2]).sum()
            straight = float(before[1] + share * (after - before)[1])
            yield refuse(
                ("towers", name, "position"),
                tower.position,
                f"at most {tower.derailment_ratio:g} of it (derailment_ratio): move the tower towards "
                f"y = {straight:.4g} m, where the line is straight in plan, or incline its groove_direction",
                f"there the bare cable at rest pushes sideways with {with_unit(ratio * normal, 'N')}, "
                f"{ratio:.3g} of its normal force",
            )
