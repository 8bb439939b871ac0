"""Forces between ropes as input to the readout of section forces, `readout.sections`."""

from __future__ import annotations

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, load, scale
from cable_twin.mechanics.readout.sections import give
from cable_twin.mechanics.rope.point import point_at
from cable_twin.mechanics.solution.bundle.connector import connector_force
from cable_twin.mechanics.solution.bundle.pantograph import push_direction
from cable_twin.mechanics.solution.bundle.records import SECTIONS, STATE, SYSTEM


@kernel
def give_forces(bundle, moving, system, state, sections):
    """Add the present forces of clamps, connectors and pantographs to the sections of each rope."""
    like = system.cable.gravity
    for rope in range(bundle.records.shape[0]):
        record_at(bundle.records[rope, SECTIONS], sections).given[0] = 0
    for clamp in range(bundle.clamps.rope.size):
        other = moving.clamp_rope[clamp]
        if other >= 0:
            carriage = record_at(bundle.records[bundle.clamps.rope[clamp], STATE], state)
            force = load(carriage.clamp_force[bundle.clamps.carriage[clamp]], like)
            pull = scale(-1.0, add_scaled(moving.rail_mass[clamp], like, force))  # as `add_clamps` has it
            give(record_at(bundle.records[other, SECTIONS], sections), moving.clamp_place[clamp], pull)
    for connector in range(bundle.connectors.length.size):
        pull, _, _, along, _ = connector_force(bundle, connector, state, like)
        for end in range(2):
            rope = bundle.connectors.rope[connector, end]
            cable = record_at(bundle.records[rope, SYSTEM], system).cable
            place = cable.node_arc_length[bundle.connectors.node[connector, end]]
            sign = 1.0 if end == 0 else -1.0
            give(record_at(bundle.records[rope, SECTIONS], sections), place, scale(sign * pull, along))
    for pantograph in range(bundle.pantographs.rope.size):
        rope, place = bundle.pantographs.rope[pantograph], moving.arc_length[pantograph]
        cable = record_at(bundle.records[rope, SYSTEM], system).cable
        nodes = record_at(bundle.records[rope, STATE], state).nodes
        push = push_direction(nodes, point_at(cable, place), load(bundle.up, like), like)
        give(record_at(bundle.records[rope, SECTIONS], sections), place, scale(moving.contact_force[pantograph], push))


__all__ = ["give_forces"]
