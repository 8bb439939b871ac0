"""Presence of vehicles on a rope, or in one of its stations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.parameters import ALONE, System


@inlined_kernel
def belongs(system, state, vehicle):
    """Return whether a vehicle is on a rope, or in one of its stations."""
    return system.number == ALONE or state.vehicle_rope[vehicle] == system.number


@inlined_kernel
def rides(system, state, vehicle):
    """Return whether a vehicle is attached to a rope."""
    return state.attached[vehicle] and belongs(system, state, vehicle)


@inlined_kernel
def keep_on(system, state, vehicle):
    """Record in the state that a vehicle is on a rope, or in one of its stations."""
    if system.number != ALONE:
        state.vehicle_rope[vehicle] = system.number


def vehicles_of(system: System, state: Any) -> NDArray[np.bool_]:
    """Mask (vehicles,) of the vehicles on a rope, or in one of its stations."""
    if system.number == ALONE:
        return np.ones(state.attached.size, dtype=np.bool_)
    return np.asarray(state.vehicle_rope == system.number, dtype=np.bool_)


def bodies_of(system: System, state: Any) -> NDArray[np.bool_]:
    """Mask (bodies,) of the bodies of vehicles on a rope, or in one of its stations."""
    return np.repeat(vehicles_of(system, state), np.diff(system.carriages.body_offset))
