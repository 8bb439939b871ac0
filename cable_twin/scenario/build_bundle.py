"""From a scenario of several ropes to what couples them in the mechanics."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.solution.bundle.records import Clamps, Connectors, Pantographs, sequence_of
from cable_twin.scenario.build import build_system
from cable_twin.scenario.build_vehicles import floats
from cable_twin.scenario.schema import Scenario


def build_ropes(scenario: Scenario) -> dict[str, System]:
    """The constants of each rope with what is on it, by name; its mesh has a node at each connector."""
    marks: dict[str, list[float]] = {name: [] for name in scenario.ropes}
    for rod in scenario.connectors.values():
        for rope, place in rod.ends:
            marks[rope].append(place)
    return {name: build_system(scenario.of_rope(name), np.array(places)) for name, places in marks.items()}


def build_connectors(scenario: Scenario, systems: dict[str, System]) -> tuple[Connectors, list[str]]:
    """The connectors in an order in which they follow each other along the ropes, and their names in that order.

    Raises:
        ValueError: two of them cross.
    """
    names, rods, ropes = list(scenario.connectors), list(scenario.connectors.values()), list(systems)
    meshes = {rope: system.cable.node_arc_length for rope, system in systems.items()}
    node = np.array([[np.argmin(abs(meshes[rope] - s)) for rope, s in rod.ends] for rod in rods], dtype=np.int64)
    rope = np.array([[ropes.index(name) for name, _ in rod.ends] for rod in rods], dtype=np.int64)
    order = sequence_of(rope.reshape(-1, 2), node.reshape(-1, 2))
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


def first_places(scenario: Scenario) -> dict[str, tuple[str, float]]:
    """To which rope each clamped vehicle is clamped at the start, and at what arc length (m), by name."""
    found = {}
    for name, one in scenario.vehicles.items():
        for rope, place in one.clamped_to.items():
            if 0.0 < place < scenario.ropes[rope].unstrained_length:
                found[name] = rope, place
    return found


def build_clamps(scenario: Scenario) -> Clamps:
    """The carriages that are clamped to another rope, in the order of all vehicles."""
    ropes = list(scenario.ropes)
    numbers = {name: list(scenario.of_rope(name).vehicles) for name in ropes}
    clamped = {name: one for name, one in scenario.vehicles.items() if one.clamped_to}
    own = [one.rope or ropes[0] for one in clamped.values()]
    return Clamps(
        rope=np.array([ropes.index(name) for name in own], dtype=np.int64),
        carriage=np.array([numbers[rope].index(name) for name, rope in zip(clamped, own, strict=True)], dtype=np.int64),
        offset=floats([scenario.vector(one.clamp_offset) for one in clamped.values()], scenario.dim),
        choice_offset=np.cumsum([0, *(len(one.clamped_to) for one in clamped.values())], dtype=np.int64),
        choice=np.array([ropes.index(rope) for one in clamped.values() for rope in one.clamped_to], dtype=np.int64),
        place=floats([place for one in clamped.values() for place in one.clamped_to.values()]),
    )


def build_pantographs(scenario: Scenario) -> Pantographs:
    """The pantographs, in the order of the file."""
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


__all__ = ["build_clamps", "build_connectors", "build_pantographs", "build_ropes", "first_places"]
