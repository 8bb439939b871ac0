"""Common parts of a step of every integrator, and the integrators by name.

Drives and wind are moved before the step; friction, contacts and stations after it.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

from cable_twin.mechanics.drives.haul_rope import take_up
from cable_twin.mechanics.drives.motion import move_drives
from cable_twin.mechanics.drives.stations import attach_carriers, detach_carriers
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.buffer import settle_buffers
from cable_twin.mechanics.on_rope.friction import settle_friction
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.on_rope.tower import derail, settle_towers
from cable_twin.mechanics.on_rope.wind import update_wind
from cable_twin.mechanics.parameters import INTEGRATORS
from cable_twin.mechanics.solution.equations_of_motion import largest_gap


class Outcome(NamedTuple):
    """Result of an integrator call, to be checked for `converged` first.

    An integrator returns the fields as a plain tuple: numba makes a named tuple by Python code, which Ctrl-C crashes.
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
    """End a step: store friction and contacts, detach and attach carriers; return the largest constraint gap (m)."""
    gap = largest_gap(system, state, work, True)
    settle(system, state, work)
    take_up(system, state)
    if system.moving_cable.moving:
        detach_carriers(system, state)
        attach_carriers(system, state)
    return gap


@kernel
def settle(system, state, work):
    """Store a rope's mobilised friction, buffer contacts and tower loads as the start of the next step."""
    for carriage in range(system.carriages.fixed.size):
        if belongs(system, state, carriage):
            settle_friction(system.carriages, state, carriage)
    if system.buffers.present:
        settle_buffers(system, state)
    settle_towers(system.cable, system.towers, state, work)
    derail(system.cable, system.towers, state, system.cable.gravity)


def integrator_named(name: str) -> Callable[..., Any]:
    """Kernel `advance` of the integrator `name`, with arguments and results of `generalized_alpha.advance`.

    Raises:
        KeyError: there is no integrator of that name.
    """
    if name not in INTEGRATORS:
        raise KeyError(f"integrator: given {name}; allowed: {', '.join(INTEGRATORS)}")
    return import_module(f"cable_twin.mechanics.solution.{name}").advance  # type: ignore[no-any-return]
