"""Newmark's prediction and correction with the coefficients of generalized-alpha, for all coordinates of a rope.

The auxiliary acceleration a goes with position and velocity: (1 - α_m) a' + α_m a = (1 - α_f) q_ddot' + α_f q_ddot.
"""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.mechanics.drives.haul_rope import direct_haul, leave_place
from cable_twin.mechanics.drives.motion import prescribe
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import flat
from cable_twin.mechanics.language.rotations import grow_turn, turn_row
from cable_twin.mechanics.language.vectors import load
from cable_twin.mechanics.on_rope.presence import belongs


class Coefficients(NamedTuple):
    """Coefficients of generalized-alpha for one spectral radius (Chung, Hulbert 1993)."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float


@kernel
def coefficients(spectral_radius):
    """Coefficients of generalized-alpha for a `spectral_radius` at infinite frequency and least damping of low ones."""
    alpha_m = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
    alpha_f = spectral_radius / (spectral_radius + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return Coefficients(alpha_m, alpha_f, 0.25 * (0.5 + gamma) * (0.5 + gamma), gamma)


@kernel
def coefficients_of_step(spectral_radius, begun):
    """Coefficients of generalized-alpha, or of Newmark in a step whose initial accelerations are not known.

    At the start of a motion, and where a force sets in at once, accelerations are not those of the step before. With
    these, the error of such a step is of first order, and may be a gain of energy. Without them it is of second order
    (Newmark's formulas with β = 1/2 and γ = 1), as is that of a motion with one step of this kind.
    """
    return coefficients(spectral_radius) if begun else Coefficients(0.0, 0.0, 0.5, 1.0)


@inlined_kernel
def factors(c, h):
    """Tangent factors of generalized-alpha: ∂acceleration/∂coordinate (1/s²) and ∂velocity/∂coordinate (1/s)."""
    return (1.0 - c.alpha_m) / ((1.0 - c.alpha_f) * c.beta * h * h), c.gamma / (c.beta * h)


@kernel
def predict(c, h, kind):
    """Predict positions and rates of one kind of coordinates, with the acceleration of the previous step."""
    x, v = flat(kind.position), flat(kind.velocity)
    q_ddot, a = flat(kind.acceleration), flat(kind.algorithmic)
    for i in range(x.size):
        after = (q_ddot[i] - c.alpha_m * a[i]) / (1.0 - c.alpha_m)
        x[i] += h * (v[i] + h * ((0.5 - c.beta) * a[i] + c.beta * after))
        v[i] += h * ((1.0 - c.gamma) * a[i] + c.gamma * after)
        a[i] = after


@inlined_kernel
def predict_massless(c, h, kind, row):
    """Predict one coordinate without inertia by a constant auxiliary acceleration."""
    a = kind.algorithmic[row]
    kind.position[row] += h * (kind.velocity[row] + 0.5 * h * a)
    kind.velocity[row] += h * a
    kind.acceleration[row] = (a - c.alpha_f * kind.acceleration[row]) / (1.0 - c.alpha_f)


@inlined_kernel
def gains(c, h):
    """Growth of velocity (1/s), algorithmic and true acceleration (1/s²) per increment of a coordinate."""
    by_algorithmic = 1.0 / (c.beta * h * h)
    return c.gamma / (c.beta * h), by_algorithmic, by_algorithmic * (1.0 - c.alpha_m) / (1.0 - c.alpha_f)


@kernel
def correct(c, h, increments, kind):
    """Apply Newton increments (m, rad) to positions and rates of one kind of coordinates."""
    x, v = flat(kind.position), flat(kind.velocity)
    q_ddot, a = flat(kind.acceleration), flat(kind.algorithmic)
    delta = flat(increments)
    by_velocity, by_algorithmic, by_acceleration = gains(c, h)
    for i in range(x.size):
        x[i] += delta[i]
        v[i] += by_velocity * delta[i]
        a[i] += by_algorithmic * delta[i]
        q_ddot[i] += by_acceleration * delta[i]


@inlined_kernel
def predict_one(c, h, kind, row):
    """Predict position and rates of one coordinate, with the acceleration of the previous step, like `predict`."""
    a = kind.algorithmic[row]
    after = (kind.acceleration[row] - c.alpha_m * a) / (1.0 - c.alpha_m)
    kind.position[row] += h * (kind.velocity[row] + h * ((0.5 - c.beta) * a + c.beta * after))
    kind.velocity[row] += h * ((1.0 - c.gamma) * a + c.gamma * after)
    kind.algorithmic[row] = after


@kernel
def predict_vehicles(c, h, system, state, work):
    """Predict the vehicles of one rope: bodies, joints, haul ropes and drums."""
    for vehicle in range(state.vehicle_rope.size):
        if belongs(system, state, vehicle):
            for body in range(system.carriages.body_offset[vehicle], system.carriages.body_offset[vehicle + 1]):
                predict_body(c, h, state.bodies, body, work.turned, system.cable.gravity)
            if system.cable.load_nodes:
                predict_one(c, h, state.joints, vehicle)
            else:
                predict_massless(c, h, state.joints, vehicle)
            predict_massless(c, h, state.hauled, vehicle)
            predict_one(c, h, state.drums, vehicle)


@kernel
def predict_body(c, h, kind, body, turned, like):
    """Predict one body; in space `turned` (bodies, 3) receives the rotation vector Δ of the step.

    Orientations advance by exp(Δ), with Δ by Newmark's formula (Brüls, Cardona, Arnold 2012).
    """
    x, v, q_ddot, a = kind.position, kind.velocity, kind.acceleration, kind.algorithmic
    for axis in range(v.shape[1]):
        after = (q_ddot[body, axis] - c.alpha_m * a[body, axis]) / (1.0 - c.alpha_m)
        moved = h * (v[body, axis] + h * ((0.5 - c.beta) * a[body, axis] + c.beta * after))
        if axis < 3:
            x[body, axis] += moved
        else:
            turned[body, axis - 3] = moved
        v[body, axis] += h * ((1.0 - c.gamma) * a[body, axis] + c.gamma * after)
        a[body, axis] = after
    if len(like) == 3:
        turn_row(x[body], load(turned[body], like))


@kernel
def correct_vehicles(c, h, system, state, work):
    """Apply the Newton increments (m, rad) of the vehicles of one rope: bodies, joints, haul ropes and drums."""
    for vehicle in range(state.vehicle_rope.size):
        if belongs(system, state, vehicle):
            for body in range(system.carriages.body_offset[vehicle], system.carriages.body_offset[vehicle + 1]):
                correct_body(c, h, state.bodies, body, work.body_increment, work.turned, system.cable.gravity)
            correct_one(c, h, state.joints, vehicle, work.sliding_increment[vehicle])
            correct_one(c, h, state.hauled, vehicle, work.haul_increment[vehicle])
            correct_one(c, h, state.drums, vehicle, work.drum_increment[vehicle])


@inlined_kernel
def correct_one(c, h, kind, row, delta):
    """Apply the Newton increment (m) of one coordinate to its position and rates."""
    by_velocity, by_algorithmic, by_acceleration = gains(c, h)
    kind.position[row] += delta
    kind.velocity[row] += by_velocity * delta
    kind.algorithmic[row] += by_algorithmic * delta
    kind.acceleration[row] += by_acceleration * delta


@kernel
def correct_body(c, h, kind, body, increments, turned, like):
    """Apply Newton increments to one body; in space its spin changes by the growth of the rotation vector."""
    x, v, q_ddot, a = kind.position, kind.velocity, kind.acceleration, kind.algorithmic
    by_velocity, by_algorithmic, by_acceleration = gains(c, h)
    delta = like
    if len(like) == 3:
        delta = grow_turn(turned[body], increments[body, 3:])
        turn_row(x[body], load(increments[body, 3:], like))
    for axis in range(v.shape[1]):
        if axis < 3:
            x[body, axis] += increments[body, axis]
            grown = increments[body, axis]
        else:
            grown = delta[axis - 3]
        v[body, axis] += by_velocity * grown
        a[body, axis] += by_algorithmic * grown
        q_ddot[body, axis] += by_acceleration * grown


@inlined_kernel
def predict_rope(c, h, system, state, work):
    """Predict all coordinates of one rope and its vehicles, and set driven joints and haul directions."""
    leave_place(system, state, work)
    predict(c, h, state.nodes)
    predict_vehicles(c, h, system, state, work)
    prescribe(system, state)
    direct_haul(system, state, work)


@inlined_kernel
def correct_rope(c, h, system, state, work):
    """Apply the Newton increments of one rope and its vehicles."""
    correct(c, h, work.right_side, state.nodes)
    correct_vehicles(c, h, system, state, work)
