"""What every integrator does around its own step: drives before it, friction, contacts and grips after it."""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.mechanics.drives.haul_rope import take_up
from cable_twin.mechanics.drives.motion import move_drives
from cable_twin.mechanics.drives.stations import attach_carriers
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.friction import settle_friction
from cable_twin.mechanics.on_rope.tower import derail, settle_towers
from cable_twin.mechanics.on_rope.vehicle_buffer import settle_buffers
from cable_twin.mechanics.on_rope.wind import blow
from cable_twin.mechanics.solution.equations_of_motion import largest_gap


class Outcome(NamedTuple):
    """What came of a call: read `converged` before anything else.

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
    """Let all that is driven know where it is to be after `h` (s), and the wind blow as it does then."""
    move_drives(system, state, h)
    if system.air.present:
        blow(system, state, h)


@kernel
def end_step(system, state, work):
    """Keep what friction and contacts have become, and attach what has come onto the rope; the largest gap (m)."""
    gap = largest_gap(system, state, work, True)
    settle(system, state)
    take_up(state)
    if system.moving_cable.moving:
        attach_carriers(system, state)
    return gap


@kernel
def settle(system, state):
    """What friction is mobilised now, and what each tower bears, is where the next step starts from."""
    for carriage in range(system.carriages.fixed.size):
        settle_friction(system.carriages, state, carriage)
    if system.buffers.present:
        settle_buffers(system, state)
    settle_towers(system.cable, system.towers, state)
    derail(system.cable, system.towers, state, system.cable.gravity)
