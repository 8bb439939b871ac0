"""Presence of vehicles on a rope, or in a station of it."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.parameters import ALONE


@inlined_kernel
def belongs(system, state, vehicle):
    """Return whether a vehicle is on a rope, or in a station of that rope."""
    return system.number == ALONE or state.vehicle_rope[vehicle] == system.number


@inlined_kernel
def rides(system, state, vehicle):
    """Return whether a vehicle is attached to a rope."""
    return state.attached[vehicle] and belongs(system, state, vehicle)
