"""Ropes and couplings between them for the mechanics, built from a scenario of several ropes."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf
from typing import Any

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, IntArray, System
from cable_twin.mechanics.solution.bundle.elimination import lines_of, sequence_of
from cable_twin.mechanics.solution.bundle.records import (
    COUNTERWEIGHT,
    FIXED,
    HYDRAULIC,
    Bullwheels,
    Clamps,
    Connectors,
    Pantographs,
)
from cable_twin.scenario.builders import columns, floats
from cable_twin.scenario.builders.system import BUFFER, build_system
from cable_twin.scenario.builders.vehicles import NO_BRAKE, build_limits
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.couplings import Connector, Pantograph, Sheave, Stage
from cable_twin.scenario.sections.drives import Brake, Limits
from cable_twin.scenario.sections.vehicles import Carriage

TENSIONED = ("mass", "pull", "band", "rate", "buffer_stiffness", "buffer_damping")  # numbers of tensioning devices


def build_ropes(scenario: Scenario, meshes: Sequence[FloatArray] | None = None) -> dict[str, System]:
    """Build the constants of each rope with its vehicles, by name, with a mesh node at each connector.

    Args:
        scenario: scenario of all ropes.
        meshes: arc lengths (nodes,) in m of the nodes of each rope, None for those of the scenario.
    """
    marks: dict[str, list[float]] = {name: [] for name in scenario.cables}
    for rod in scenario.connectors.values():
        for rope, place in rod.ends:
            marks[rope].append(place)
    found = {}
    for number, (name, places) in enumerate(marks.items()):
        own = np.array(places) if meshes is None else None
        system = build_system(scenario.of_rope(name), own, None if meshes is None else meshes[number])
        nodes = system.cable.node_arc_length
        system.cable.node_joined[[nearest_node(nodes, place) for place in places]] = True
        found[name] = system
    return found


def nearest_node(nodes: FloatArray, place: float) -> int:
    """Index of the node, of those at arc lengths `nodes` (m), that is nearest to a place (m)."""
    return int(np.argmin(abs(nodes - place)))


def build_connectors(scenario: Scenario, systems: dict[str, System]) -> tuple[Connectors, list[str]]:
    """Build the connectors in their order along the ropes, and return their names in this order.

    Raises:
        ValueError: two connectors cross.
    """
    names, rods, ropes = list(scenario.connectors), list(scenario.connectors.values()), list(systems)
    meshes = {rope: system.cable.node_arc_length for rope, system in systems.items()}
    node = np.array([[nearest_node(meshes[rope], s) for rope, s in rod.ends] for rod in rods], dtype=np.int64)
    rope = np.array([[ropes.index(name) for name, _ in rod.ends] for rod in rods], dtype=np.int64)
    line = lines_of(len(ropes), np.concatenate([rope.reshape(-1, 2), clamped_pairs(scenario)]))
    order = sequence_of(rope.reshape(-1, 2), node.reshape(-1, 2))
    order.sort(key=lambda number: line[rope[number, 0]])
    rods = [rods[number] for number in order]
    connectors = Connectors(
        rope=rope.reshape(-1, 2)[order],
        node=node.reshape(-1, 2)[order],
        rolls=np.array([rod.rolls for rod in rods], dtype=np.int64),
        **columns(Connectors, Connector, rods),
    )
    return connectors, [names[number] for number in order]


def clamped(scenario: Scenario) -> list[tuple[int, int, str, Carriage]]:
    """Carriages clamped to a second rope: index of their own rope, row among all vehicles, name and section."""
    found, rows = [], {name: number for number, name in enumerate(scenario.vehicles)}
    for row, rope in enumerate(scenario.ropes):
        vehicles = scenario.of_rope(rope).vehicles
        found += [(row, rows[name], name, one) for name, one in vehicles.items() if one.clamped_to]
    return found


def clamped_pairs(scenario: Scenario) -> IntArray:
    """Pairs of ropes (n, 2) with a vehicle sliding on the first and clamped to the second."""
    ropes = list(scenario.ropes)
    pairs = {(row, ropes.index(other)) for row, _, _, one in clamped(scenario) for other in one.clamped_to}
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)


def build_clamps(scenario: Scenario) -> Clamps:
    """Build the constants of all clamps of carriages to a second rope."""
    ropes, found = list(scenario.ropes), clamped(scenario)
    vehicles = [one for *_, one in found]
    rides = [scenario.of_rope(ropes[row]).riding for row in range(len(ropes))]
    carriers = set(scenario.vehicles) - set(scenario.carriages)
    loops = [rides[row] if name in carriers else None for row, _, name, _ in found]
    return Clamps(
        rope=np.array([row for row, *_ in found], dtype=np.int64),
        carriage=np.array([number for _, number, *_ in found], dtype=np.int64),
        offset=floats([scenario.vector(one.clamp_offset) for one in vehicles], scenario.dim),
        choice_offset=np.cumsum([0, *(len(one.clamped_to) for one in vehicles)], dtype=np.int64),
        choice=np.array([ropes.index(rope) for one in vehicles for rope in one.clamped_to], dtype=np.int64),
        place=floats([place for one in vehicles for place in one.clamped_to.values()]),
        loop_length=floats([riding.loop_length if riding else 0.0 for riding in loops]),
    )


def build_pantographs(scenario: Scenario) -> Pantographs:
    """Build the pantographs, in the order of the file."""
    given = list(scenario.pantographs.values())
    count = len(given[0].stages) if given else 1
    stages = columns(Pantographs, Stage, [stage for one in given for stage in one.stages])
    stages = {name: column.reshape(-1, count) for name, column in stages.items()}
    # in equilibrium the springs above the last one carry the uplift force; it has the rest of the height
    base = [
        one.uplift_force + float(row[-1]) * (one.height + one.uplift_force * float(np.sum(1.0 / row[:-1])))
        for one, row in zip(given, stages["stiffness"], strict=True)
    ]
    return Pantographs(
        **columns(Pantographs, Pantograph, given),
        **stages,
        rope=np.array([list(scenario.ropes).index(one.rope) for one in given], dtype=np.int64),
        base_force=floats(base),
    )


def build_bullwheels(scenario: Scenario) -> Bullwheels:
    """Build the bullwheels, in the order of the file."""
    given, names = scenario.sheaves.values(), list(scenario.ropes)
    drives = {drive.sheave: drive for drive in scenario.drives.values()}
    turning = [drives.get(name) for name in scenario.sheaves]
    lay = [sheave.wrapped * scenario.ropes[sheave.ropes[0]].mass_per_length for sheave in given]
    tensioning = [_tensioning(scenario, sheave) for sheave in given]
    copied: dict[str, Any] = {
        **columns(Bullwheels, Sheave, list(given)),
        "limits": build_limits([drive.limits if drive else Limits() for drive in turning]),
        **columns(Bullwheels, Brake, [sheave.brake or NO_BRAKE for sheave in given], "brake_{}"),
    }
    own = {
        "rope": np.array([[names.index(rope) for rope in one.ropes] for one in given], dtype=np.int64).reshape(-1, 2),
        "inertia": floats([sheave.inertia / sheave.radius**2 for sheave in given]),
        "wrapped": floats(lay),
        "adhesion": floats([exp(sheave.friction * sheave.wrap) for sheave in given]),
        "resistance": floats([sheave.resistance / sheave.radius for sheave in given]),
        "driven": np.array([drive is not None for drive in turning], dtype=np.int64),
        "way": floats([(drive and drive.travel) or (-inf, inf) for drive in turning], 2),
        "tensioning": np.array([device["tensioning"] for device in tensioning], dtype=np.int64),
        "direction": floats([device["direction"] for device in tensioning], scenario.dim),
        "travel": floats([device["travel"] for device in tensioning], 2),
        **{name: floats([device[name] for device in tensioning]) for name in TENSIONED},
    }
    return Bullwheels(**(copied | own))


def _tensioning(scenario: Scenario, sheave: Sheave) -> dict[str, Any]:
    """Tensioning device of a bullwheel by the fields of `Bullwheels`, with direction (dim,) and travel (2,)."""
    weight, cylinder = sheave.counterweight, sheave.hydraulics
    device = dict.fromkeys(TENSIONED, 0.0) | {"mass": 1.0}
    if weight is None and (cylinder is None or cylinder.locked):
        return {**device, "tensioning": FIXED, "direction": [0.0] * scenario.dim, "travel": (0.0, 0.0)}
    given = scenario.vector((weight or cylinder).direction)  # type: ignore[union-attr]
    direction = [float(part / np.linalg.norm(given)) for part in given]
    if weight is not None:
        pull = weight.force or weight.mass * scenario.gravity
        device |= {"mass": weight.mass + weight.carriage_mass, "pull": pull}
        device |= {"buffer_stiffness": pull / BUFFER, "buffer_damping": weight.buffer_damping}
        return {**device, "tensioning": COUNTERWEIGHT, "direction": direction, "travel": weight.travel}
    assert cylinder is not None
    device |= {"pull": cylinder.force, "band": cylinder.band, "rate": cylinder.rate}
    return {**device, "tensioning": HYDRAULIC, "direction": direction, "travel": cylinder.travel}
