"""Couplings of ropes in a step of generalized-alpha: bullwheels, clamps, connectors, pantographs.

Also forces between ropes as input to the readout of section forces, `readout.sections`.
"""

from __future__ import annotations

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, load, scale
from cable_twin.mechanics.readout.sections import give
from cable_twin.mechanics.rope.point import point_at
from cable_twin.mechanics.solution.bundle.bullwheels import (
    correct_bullwheels,
    end_bullwheels,
    give_ends,
    move_bullwheels,
    place_ends,
    propagate_wheels,
    update_end_tensions,
)
from cable_twin.mechanics.solution.bundle.clamp import (
    add_clamp_gaps,
    add_clamps,
    find_clamps,
    follow_clamps,
    ride_tracks,
    worst_clamp_gap,
)
from cable_twin.mechanics.solution.bundle.connector import add_connectors, connector_force, damp_rope
from cable_twin.mechanics.solution.bundle.pantograph import add_pantographs, push_direction
from cable_twin.mechanics.solution.bundle.records import SECTIONS, STATE, SYSTEM, rope_of
from cable_twin.mechanics.solution.bundle.wheel_tangent import add_travel, add_wheels
from cable_twin.mechanics.solution.prediction import correct, predict


@kernel
def move_couplings(bundle, moving, system, state, c, h):
    """Move bullwheels by `h` (s), and let rope run onto and off the strands: before the ropes themselves move."""
    move_bullwheels(bundle.sheaves, moving.sheaves, c, h)
    give_ends(bundle, moving.sheaves, system, state)


@kernel
def place_couplings(bundle, moving, system, state, c, h):
    """Predict the motion of all couplings, after the prediction of their ropes."""
    place_ends(bundle, moving.sheaves, system, state)
    find_clamps(bundle, moving, system, state, h)
    predict(c, h, moving.stages)
    for pantograph in range(moving.place.position.size):
        moving.place.position[pantograph] += h * moving.place.velocity[pantograph]


@kernel
def add_to_patches(bundle, moving, scratch, system, state, work, rate_factor, stiffness_factor):
    """Add couplings to the equations of moving loads (patches), before condensation; returns count of changed contacts.

    These are gaps of clamps and connectors.
    """
    add_clamp_gaps(bundle, moving, scratch, system, state, work)
    like = system.cable.gravity
    return add_connectors(bundle, moving, scratch, system, state, work, rate_factor, stiffness_factor, like)


@kernel
def add_couplings(bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor):
    """Add all other couplings to the residuals and tangents of the ropes; returns the number of changed contacts.

    Bullwheels take part in time integration only, with a rate factor above 0.
    """
    like, wires = system.cable.gravity, bundle.wires
    wheels = bundle.sheaves.inertia.size > 0 and rate_factor > 0.0
    if wheels:
        add_wheels(bundle, moving, scratch, system, state, work, mass_factor, rate_factor)
    if wires.present and rate_factor > 0.0:
        for rope in range(bundle.records.shape[0]):
            own, here, room = rope_of(bundle, rope, system, state, work)
            damp_rope(own.cable, wires.by_stiffness[rope] * wires.tension[rope], here, room, rate_factor)
    changed = add_pantographs(
        bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor, like
    )
    add_clamps(bundle, moving, scratch, system, state, work, like)
    if wheels:
        add_travel(bundle, moving, scratch, system, state, work)
    return changed


@kernel
def correct_couplings(bundle, moving, scratch, system, state, c, h):
    """Apply the Newton increments of all couplings."""
    correct(c, h, scratch.increment, moving.stages)
    if bundle.sheaves.inertia.size > 0:
        correct_bullwheels(bundle.sheaves, moving.sheaves, scratch.wheel_increment, c, h)
        propagate_wheels(bundle, moving.sheaves, system, state)
        follow_clamps(bundle, moving, system, state)


@kernel
def worst_coupling_gap(bundle, moving, system, state):
    """Largest gap (m) of all position constraints between two ropes."""
    return worst_clamp_gap(bundle, moving, system, state, system.cable.gravity)


@kernel
def end_couplings(bundle, moving, scratch, system, state):
    """End a step: store tensions and traction at bullwheels, and transfer vehicles between tracks and stations."""
    update_end_tensions(bundle, moving.sheaves, system, state)
    end_bullwheels(bundle.sheaves, moving.sheaves, scratch.saturation)
    ride_tracks(bundle, system, state)


@kernel
def give_forces(bundle, moving, system, state, sections):
    """Register the present forces of clamps, connectors and pantographs as point loads in the sections of each rope."""
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
        pull, _, _, along, _, _, places = connector_force(bundle, connector, system, state, like)
        for end in range(2):
            rope = bundle.connectors.rope[connector, end]
            sign = 1.0 if end == 0 else -1.0
            give(record_at(bundle.records[rope, SECTIONS], sections), places[end], scale(sign * pull, along))
    for pantograph in range(bundle.pantographs.rope.size):
        rope, place = bundle.pantographs.rope[pantograph], moving.arc_length[pantograph]
        cable = record_at(bundle.records[rope, SYSTEM], system).cable
        here = record_at(bundle.records[rope, STATE], state)
        push = push_direction(here.nodes, point_at(cable, here, place), load(bundle.up, like), like)
        give(record_at(bundle.records[rope, SECTIONS], sections), place, scale(moving.contact_force[pantograph], push))
