"""Payload: a point mass in a body, which with it becomes one rigid body of another mass, centre and inertia."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.on_rope.chain import pivot
from cable_twin.mechanics.parameters import Carriages, FloatArray, Payloads
from cable_twin.mechanics.state import State


def centre_offsets(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> FloatArray:
    """Shift (bodies, 2) in m of the centres of mass of the empty `carriages` under payloads (carriages,) in kg."""
    offsets = np.zeros((carriages.mass.size, 2))
    for body, position, mass in zip(payloads.body, payloads.position, masses, strict=True):
        if mass > 0.0:
            offsets[body] = mass / (carriages.mass[body] + mass) * position
    return offsets


def load_bodies(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> Carriages:
    """The empty `carriages` with payloads (carriages,) in kg: mass, inertia about the common centre, pivots from it."""
    offsets = centre_offsets(carriages, payloads, masses)
    mass, inertia = carriages.mass.copy(), carriages.inertia.copy()
    for body, position, load in zip(payloads.body, payloads.position, masses, strict=True):
        if load > 0.0:
            inertia[body] += mass[body] * load / (mass[body] + load) * float(position @ position)
            mass[body] += load
    return carriages._replace(
        mass=mass,
        inertia=inertia,
        upper_pivot=carriages.upper_pivot - offsets,
        lower_pivot=carriages.lower_pivot - offsets,
        centre_offset=offsets,
    )


def shift_centres(state: State, change: FloatArray) -> None:
    """Move the centres of mass of `state` by `change` (bodies, 2) in m in the bodies' axes; no body moves by it."""
    for body in np.flatnonzero(np.any(change != 0.0, axis=1)):
        pitch, spin = float(state.bodies.position[body, 2]), float(state.bodies.velocity[body, 2])
        arm_x, arm_z, turn_x, turn_z = pivot(pitch, change[body])
        state.bodies.position[body, :2] += arm_x, arm_z
        state.bodies.velocity[body, :2] += turn_x * spin, turn_z * spin
        for accelerations in (state.bodies.acceleration, state.bodies.algorithmic):
            turning = float(accelerations[body, 2])
            accelerations[body, 0] += turn_x * turning - arm_x * spin * spin
            accelerations[body, 1] += turn_z * turning - arm_z * spin * spin
