"""Common parts of a step of every integrator: drives and wind before it; friction, contacts and stations after it."""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.mechanics.drives.haul_rope import take_up
from cable_twin.mechanics.drives.motion import move_drives
from cable_twin.mechanics.drives.stations import attach_carriers
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.friction import settle_friction
from cable_twin.mechanics.on_rope.tower import derail, settle_towers
from cable_twin.mechanics.on_rope.vehicle_buffer import settle_buffers
from cable_twin.mechanics.on_rope.wind import update_wind
from cable_twin.mechanics.solution.equations_of_motion import largest_gap


class Outcome(NamedTuple):
    """Result of an integrator call, to be checked for `converged` first.

    An integrator gives the fields alone: numba makes a named tuple by Python code of its own, which a Ctrl-C crashes.
    """

    converged: bool
    steps: int  # whole steps taken
    iterations: int  # Newton iterations in all
    halvings: int  # failed tries that were repeated with half the step
    gap: float  # m, largest gap of a joint at the end of a step
    increment: float  # m, largest of the last Newton iteration
    element: int  # where that was
    lost: float  # J, by the integrator alone, see `dissipation`
    moved: float  # J, sum of the changes of kinetic energy, either way


@kernel
def begin_step(system, state, h):
    """Advance the references of all drives, and the wind, to the end of a step of `h` (s)."""
    move_drives(system, state, h)
    if system.air.present:
        update_wind(system, state, h)


@kernel
def end_step(system, state, work):
    """End a step: store friction and contacts, attach carriers entering the rope; returns the largest gap (m)."""
    gap = largest_gap(system, state, work, True)
    settle(system, state)
    take_up(state)
    if system.moving_cable.moving:
        attach_carriers(system, state)
    return gap


@kernel
def settle(system, state):
    """Store the mobilised friction, buffer contacts and tower loads as the start of the next step."""
    for carriage in range(system.carriages.fixed.size):
        settle_friction(system.carriages, state, carriage)
    if system.buffers.present:
        settle_buffers(system, state)
    settle_towers(system.cable, system.towers, state)
    derail(system.cable, system.towers, state, system.cable.gravity)
