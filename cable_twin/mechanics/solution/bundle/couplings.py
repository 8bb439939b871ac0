"""Couplings of ropes in a step of generalized-alpha: bullwheels, clamps, connectors, pantographs."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.solution.bundle.bullwheels import (
    correct_bullwheels,
    end_bullwheels,
    move_bullwheels,
)
from cable_twin.mechanics.solution.bundle.clamp import add_clamps, find_clamps, follow_clamps, worst_clamp_gap
from cable_twin.mechanics.solution.bundle.connector import add_connectors
from cable_twin.mechanics.solution.bundle.pantograph import add_pantographs
from cable_twin.mechanics.solution.bundle.records import rope_of
from cable_twin.mechanics.solution.bundle.riders import ride_tracks
from cable_twin.mechanics.solution.bundle.strand_ends import carry_on, feel_ends, give_ends, place_ends
from cable_twin.mechanics.solution.bundle.wires import damp_wire
from cable_twin.mechanics.solution.newmark import correct, predict


@kernel
def move_couplings(bundle, moving, system, state, c, h):
    """Move bullwheels by `h` (s), and let rope run onto and off the strands: before the ropes themselves move."""
    move_bullwheels(bundle.sheaves, moving.sheaves, c, h)
    give_ends(bundle, moving.sheaves, system, state)


@kernel
def place_couplings(bundle, moving, scratch, system, state, c, h):
    """Predict the motion of all couplings, after the prediction of their ropes."""
    place_ends(bundle, moving.sheaves, system, state)
    find_clamps(bundle, moving, system, state, h)
    predict(c, h, moving.stages)
    for pantograph in range(moving.place.position.size):
        moving.place.position[pantograph] += h * moving.place.velocity[pantograph]
    scratch.wheel_stiffness[:] = 0.0


@kernel
def add_couplings(bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor):
    """Add all couplings to the residuals and tangents of the ropes; returns the number of changed contacts."""
    like, wires = system.cable.gravity, bundle.wires
    if wires.present and rate_factor > 0.0:
        for rope in range(bundle.records.shape[0]):
            own, here, room = rope_of(bundle, rope, system, state, work)
            tension_time = wires.by_stiffness[rope] * wires.tension[rope]
            damp_wire(own.cable, wires.by_mass[rope], tension_time, here, room, rate_factor)
    changed = add_connectors(bundle, moving, scratch, state, work, rate_factor, stiffness_factor, like)
    changed += add_pantographs(
        bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor, like
    )
    add_clamps(bundle, moving, scratch, system, state, work, like)
    return changed


@kernel
def correct_couplings(bundle, moving, scratch, system, state, c, h, iteration):
    """Apply the Newton increments of all couplings; returns the largest increment of a bullwheel (m)."""
    correct(c, h, scratch.increment, moving.stages)
    if bundle.sheaves.inertia.size == 0:
        return 0.0
    feel_ends(bundle, moving.sheaves, system, state)
    if iteration == 1:
        scratch.wheel_increment[:] = 0.0
    turned = correct_bullwheels(bundle, moving.sheaves, scratch, system, c, h, iteration)
    carry_on(bundle, moving.sheaves, system, state)
    follow_clamps(bundle, moving, system, state)
    return turned


@kernel
def worst_coupling_gap(bundle, moving, system, state):
    """Largest gap (m) of all constraints between two ropes."""
    return worst_clamp_gap(bundle, moving, system, state, system.cable.gravity)


@kernel
def end_couplings(bundle, moving, system, state):
    """End a step: store the traction of bullwheels, and transfer carriages between tracks and stations."""
    end_bullwheels(bundle.sheaves, moving.sheaves)
    ride_tracks(bundle, system, state)
