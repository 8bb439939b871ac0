"""Ropes and couplings between them for the mechanics, built from a scenario of several ropes."""

from __future__ import annotations

from math import exp, inf

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
from cable_twin.scenario.builders.system import BUFFER, build_system
from cable_twin.scenario.builders.vehicles import floats
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.couplings import Sheave
from cable_twin.scenario.sections.drives import Limits
from cable_twin.scenario.sections.quantities import Vector
from cable_twin.scenario.sections.vehicles import Carriage


def build_ropes(scenario: Scenario) -> dict[str, System]:
    """Build the constants of each rope with its vehicles, by name, with a mesh node at each connector."""
    marks: dict[str, list[float]] = {name: [] for name in scenario.cables}
    for rod in scenario.connectors.values():
        for rope, place in rod.ends:
            marks[rope].append(place)
    return {name: build_system(scenario.of_rope(name), np.array(places)) for name, places in marks.items()}


def build_connectors(scenario: Scenario, systems: dict[str, System]) -> tuple[Connectors, list[str]]:
    """Build the connectors in their order along the ropes, and return their names in this order.

    Raises:
        ValueError: two of them cross.
    """
    names, rods, ropes = list(scenario.connectors), list(scenario.connectors.values()), list(systems)
    meshes = {rope: system.cable.node_arc_length for rope, system in systems.items()}
    node = np.array([[np.argmin(abs(meshes[rope] - s)) for rope, s in rod.ends] for rod in rods], dtype=np.int64)
    rope = np.array([[ropes.index(name) for name, _ in rod.ends] for rod in rods], dtype=np.int64)
    line = lines_of(len(ropes), np.concatenate([rope.reshape(-1, 2), clamped_pairs(scenario)]))
    order = sequence_of(rope.reshape(-1, 2), node.reshape(-1, 2))
    order.sort(key=lambda number: line[rope[number, 0]])
    rods = [rods[number] for number in order]
    connectors = Connectors(
        rope=rope.reshape(-1, 2)[order],
        node=node.reshape(-1, 2)[order],
        length=floats([rod.length for rod in rods]),
        stiffness=floats([rod.stiffness for rod in rods]),
        compression=floats([rod.compression for rod in rods]),
        damping=floats([rod.damping for rod in rods]),
    )
    return connectors, [names[number] for number in order]


def clamped(scenario: Scenario) -> list[tuple[int, int, str, Carriage]]:
    """Carriages clamped to a second rope: index of their own rope, index on it, name and section."""
    found = []
    for row, rope in enumerate(scenario.ropes):
        vehicles = scenario.of_rope(rope).vehicles
        found += [(row, number, name, one) for number, (name, one) in enumerate(vehicles.items()) if one.clamped_to]
    return found


def clamped_pairs(scenario: Scenario) -> IntArray:
    """Pairs of ropes (n, 2) with a vehicle sliding on the first and clamped to the second."""
    ropes = list(scenario.ropes)
    pairs = {(row, ropes.index(other)) for row, _, _, one in clamped(scenario) for other in one.clamped_to}
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)


def build_clamps(scenario: Scenario) -> Clamps:
    """Build the clamps of carriages to a second rope, in the order of `clamped`."""
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
    stages = len(given[0].stages) if given else 1

    def column(key: str) -> FloatArray:
        return floats([[getattr(stage, key) for stage in one.stages] for one in given], stages)

    stiffness = column("stiffness")
    # at rest, the springs between head and last stage have yielded, and the last one has what is left
    base = [
        one.uplift_force + float(row[-1]) * (one.height + one.uplift_force * float(np.sum(1.0 / row[:-1])))
        for one, row in zip(given, stiffness, strict=True)
    ]
    return Pantographs(
        rope=np.array([list(scenario.ropes).index(one.rope) for one in given], dtype=np.int64),
        mass=column("mass"),
        stiffness=stiffness,
        damping=column("damping"),
        base_force=floats(base),
        contact_stiffness=floats([one.contact_stiffness for one in given]),
    )


def build_bullwheels(scenario: Scenario) -> Bullwheels:
    """Build the bullwheels, in the order of the file."""
    given, names = list(scenario.sheaves.values()), list(scenario.ropes)
    joined = [[names.index(end.partition(".")[0]) for end in sheave.joins] for sheave in given]
    ropes = [[scenario.ropes[names[rope]] for rope in pair] for pair in joined]
    drives = {drive.sheave: drive for drive in scenario.drives.values()}
    limits = [drives[name].limits if name in drives else Limits() for name in scenario.sheaves]
    ways = [drives[name].travel if name in drives else None for name in scenario.sheaves]
    tensioning = [_tensioning(scenario, sheave) for sheave in given]
    return Bullwheels(
        rope=np.array(joined, dtype=np.int64).reshape(-1, 2),
        inertia=floats([sheave.inertia / sheave.radius**2 for sheave in given]),
        wrapped=floats([sheave.wrapped * pair[0].mass_per_length for sheave, pair in zip(given, ropes, strict=True)]),
        adhesion=floats([exp(sheave.friction * sheave.wrap) for sheave in given]),
        resistance=floats([sheave.resistance / sheave.radius for sheave in given]),
        driven=np.array([name in drives for name in scenario.sheaves], dtype=np.int64),
        way=floats([way or (-inf, inf) for way in ways], 2),
        acceleration_limit=floats([limit.acceleration for limit in limits]),
        emergency_deceleration=floats([limit.emergency_deceleration for limit in limits]),
        jerk_limit=floats([inf if limit.jerk is None else limit.jerk for limit in limits]),
        brake_force=floats([sheave.brake.force if sheave.brake else 0.0 for sheave in given]),
        rollback=floats([inf if sheave.rollback is None else sheave.rollback for sheave in given]),
        brake_rise_time=floats([sheave.brake.rise_time if sheave.brake else 0.0 for sheave in given]),
        tensioning=np.array([kind for kind, *_ in tensioning], dtype=np.int64),
        direction=floats([row[1] for row in tensioning], scenario.dim),
        **{
            name: floats([row[2][number] for row in tensioning])
            for number, name in enumerate(("mass", "pull", "band", "rate", "buffer_stiffness", "buffer_damping"))
        },
        travel=floats([row[3] for row in tensioning], 2),
    )


def _tensioning(scenario: Scenario, sheave: Sheave) -> tuple[int, list[float], tuple[float, ...], Vector]:
    """Kind, direction (dim,), mass, pull, band, rate, buffers, and travel of a bullwheel's tensioning device."""
    weight, cylinder = sheave.counterweight, sheave.hydraulics
    if weight is None and (cylinder is None or cylinder.locked):
        return FIXED, [0.0] * scenario.dim, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0)
    given = scenario.vector((weight or cylinder).direction)  # type: ignore[union-attr]
    direction = [float(part / np.linalg.norm(given)) for part in given]
    if weight is not None:
        pull = weight.force or weight.mass * scenario.gravity
        mass = weight.mass + weight.carriage_mass
        return COUNTERWEIGHT, direction, (mass, pull, 0.0, 0.0, pull / BUFFER, weight.buffer_damping), weight.travel
    assert cylinder is not None
    return HYDRAULIC, direction, (1.0, cylinder.force, cylinder.band, cylinder.rate, 0.0, 0.0), cylinder.travel


__all__ = [
    "build_bullwheels",
    "build_clamps",
    "build_connectors",
    "build_pantographs",
    "build_ropes",
    "clamped",
    "clamped_pairs",
]
