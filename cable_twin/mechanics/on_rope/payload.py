"""Payload: a point mass merged with its body into one rigid body of changed mass, centre and inertia."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.language.orientations import orientation
from cable_twin.mechanics.language.turns import cross
from cable_twin.mechanics.parameters import Carriages, FloatArray, Payloads
from cable_twin.mechanics.state import State


def centre_offsets(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> FloatArray:
    """Shift (bodies, dim) in m of the centres of mass of the empty `carriages` under payloads (carriages,) in kg."""
    offsets = np.zeros(carriages.upper_pivot.shape)
    for body, position, mass in zip(payloads.body, payloads.position, masses, strict=True):
        if mass > 0.0:
            offsets[body] = mass / (carriages.mass[body] + mass) * position
    return offsets


def load_bodies(carriages: Carriages, payloads: Payloads, masses: FloatArray) -> Carriages:
    """Carriages with payloads (carriages,) in kg: mass, inertia about the common centre, pivots from that centre."""
    offsets = centre_offsets(carriages, payloads, masses)
    mass, inertia = carriages.mass.copy(), carriages.inertia.copy()
    for body, position, load in zip(payloads.body, payloads.position, masses, strict=True):
        if load > 0.0:
            reduced = mass[body] * load / (mass[body] + load)
            if inertia.ndim == 1:
                inertia[body] += reduced * float(position @ position)
            else:
                tensor = np.eye(3) * float(position @ position) - np.outer(position, position)
                inertia[body] += reduced * tensor.ravel()
            mass[body] += load
    return carriages._replace(
        mass=mass,
        inertia=inertia,
        upper_pivot=carriages.upper_pivot - offsets,
        lower_pivot=carriages.lower_pivot - offsets,
        centre_offset=offsets,
    )


def shift_centres(state: State, change: FloatArray) -> None:
    """Move the reference centres of mass of `state` by `change` (bodies, dim) in m in body axes, bodies unmoved."""
    for body in np.flatnonzero(np.any(change != 0.0, axis=1)):
        dim = change.shape[1]
        axes = np.array(orientation(state.bodies.position[body], tuple(change[body]))).reshape(dim, dim)
        arm = tuple(axes @ change[body])
        spin = tuple(state.bodies.velocity[body, dim:])
        state.bodies.position[body, :dim] += arm
        state.bodies.velocity[body, :dim] += cross(spin, arm)
        for accelerations in (state.bodies.acceleration, state.bodies.algorithmic):
            turning = cross(tuple(accelerations[body, dim:]), arm)
            accelerations[body, :dim] += np.add(turning, cross(spin, cross(spin, arm)))
