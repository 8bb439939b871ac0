"""One linear solution of a bundle: each rope as ever (`solution.equations_of_motion`), and what couples them."""

from __future__ import annotations

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.solution.bundle.clamp import add_clamps, recover_clamps
from cable_twin.mechanics.solution.bundle.connector import add_connectors
from cable_twin.mechanics.solution.bundle.elimination import solve_bundle
from cable_twin.mechanics.solution.bundle.pantograph import add_pantographs, recover_pantographs
from cable_twin.mechanics.solution.bundle.records import STATE, SYSTEM, WORK
from cable_twin.mechanics.solution.bundle.wires import damp_wire
from cable_twin.mechanics.solution.equations_of_motion import (
    assemble_unheld,
    hold_ends,
    measure_gaps,
    recover,
)
from cable_twin.mechanics.solution.increments import largest_increment


@kernel
def linearise_rope(system, state, work, mass_factor, rate_factor, stiffness_factor):
    """Residual and tangent of one rope with what is on it, before its supports hold it."""
    measure_gaps(system, state, work, True)
    assemble_unheld(system, state, mass_factor, rate_factor, stiffness_factor, work)


@kernel
def recover_rope(system, state, work):
    """What was eliminated of one rope; its largest increment (m)."""
    recover(system, state, work)
    return largest_increment(system, work)


@kernel
def solve_increments(bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor):
    """Newton increments of everything, each in its own scratch.

    `system`, `state` and `work` are those of any of the ropes, for their types; factors as in `assemble`.

    Returns:
        Whether there is a solution, the largest increment (m), and how many contacts have changed.
    """
    like, wires = system.cable.gravity, bundle.wires
    for rope in range(bundle.records.shape[0]):
        own = record_at(bundle.records[rope, SYSTEM], system)
        here, scratch_of = record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
        linearise_rope(own, here, scratch_of, mass_factor, rate_factor, stiffness_factor)
        if wires.present and rate_factor > 0.0:
            tension_time = wires.by_stiffness[rope] * wires.tension[rope]
            damp_wire(own.cable, wires.by_mass[rope], tension_time, here, scratch_of, rate_factor)
    changed = add_connectors(bundle, moving, scratch, state, work, rate_factor, stiffness_factor, like)
    changed += add_pantographs(
        bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor, like
    )
    add_clamps(bundle, moving, scratch, system, state, work, like)
    for rope in range(bundle.records.shape[0]):
        hold_ends(record_at(bundle.records[rope, SYSTEM], system).cable, record_at(bundle.records[rope, WORK], work))
    if not solve_bundle(bundle, scratch, work, like):
        return False, 0.0, changed
    recover_clamps(bundle, moving, scratch, state, work, like)
    largest = recover_pantographs(bundle, moving, scratch, state, system, work, stiffness_factor, like)
    for rope in range(bundle.records.shape[0]):
        own = record_at(bundle.records[rope, SYSTEM], system)
        here, scratch_of = record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
        increment = recover_rope(own, here, scratch_of)
        largest = largest if increment <= largest else increment  # what is no number stays
    return True, largest, changed
