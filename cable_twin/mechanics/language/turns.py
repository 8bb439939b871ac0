"""Rotations of bodies: one angle about y in a plane, three in space, distinguished by type as in `vectors`.

A turn is a tuple of 1 or 3 angles in rad about the axes of the world, so are a spin in rad/s and a moment in N m. What
belongs to it in the coordinates of a body is the pitch in a plane, and a unit quaternion x, y, z, w in space.
"""

from __future__ import annotations

from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    Matrix,
    Vector,
    add_scaled,
    product,
    scale,
    unit_matrix,
)

Turn = tuple[float, ...]


@formula
def no_turn(like: Vector) -> Turn:
    """Zero rotation in the space of the vector `like`."""
    return (0.0,) if len(like) == 2 else (0.0, 0.0, 0.0)


@formula
def cross(turn: Turn, arm: Vector) -> Vector:
    """Cross product θ x a of a rotation (or angular velocity) and an arm (dim,)."""
    if len(arm) == 2:
        return turn[0] * arm[1], -turn[0] * arm[0]
    return (
        turn[1] * arm[2] - turn[2] * arm[1],
        turn[2] * arm[0] - turn[0] * arm[2],
        turn[0] * arm[1] - turn[1] * arm[0],
    )


@formula
def moment(arm: Vector, force: Vector) -> Turn:
    """Moment a x F of a force (dim,) at an arm (dim,)."""
    if len(arm) == 2:
        return (arm[1] * force[0] - arm[0] * force[1],)
    return cross(arm, force)


@formula
def by_turn(arm: Vector) -> Matrix:
    """Matrix (dim x turns) of θ x a by the rotation θ; its transpose is the matrix of a x F by F."""
    if len(arm) == 2:
        return arm[1], -arm[0]
    return 0.0, arm[2], -arm[1], -arm[2], 0.0, arm[0], arm[1], -arm[0], 0.0


@formula
def moment_by_turn(arm: Vector, force: Vector) -> Matrix:
    """Matrix (turns x turns) of the moment (θ x a) x F by the rotation θ of the arm: a Fᵀ - (a·F) 1."""
    along = [x * f for x, f in zip(arm, force, strict=True)]
    if len(arm) == 2:
        return (-sum(along),)
    beside = [-(along[1] + along[2]), -(along[0] + along[2]), -(along[0] + along[1])]  # without what would cancel
    return tuple(beside[i] if i == j else arm[i] * force[j] for i in range(3) for j in range(3))


@formula
def gyration(
    inertia: Matrix,
    spin: Turn,
    acceleration: Turn,
    turned: Turn,
    mass_factor: float,
    rate_factor: float,
    stiffness_factor: float,
):
    """Inertia moment J ω_dot + ω x J ω of a body about its centre, and its derivative by a rotation θ.

    Args:
        inertia: J (turns²) about the axes of the world.
        spin: ω (turns,) rad/s.
        acceleration: ω_dot (turns,) rad/s².
        turned: rotation vector (turns,) of the step so far, which the integrator adds to.
        mass_factor: ∂ω_dot by it.
        rate_factor: ∂ω by it.
        stiffness_factor: of the turn itself, 1 or 0.
    """
    if len(spin) == 1:
        return (inertia[0] * acceleration[0],), (mass_factor * inertia[0],)
    return _gyration_in_space(inertia, spin, acceleration, turned, mass_factor, rate_factor, stiffness_factor)


@formula
def _gyration_in_space(inertia, spin, acceleration, turned, mass_factor, rate_factor, stiffness_factor):
    """Inertia moment J ω_dot + ω x J ω of a body in space, and its derivative by a rotation θ (3,).

    A turn θ of the body is the addition T⁻¹ θ to the rotation vector Δ of the step, with
    T⁻¹ = 1 - [Δ]/2 + [Δ]²/12 - ... (Brüls, Cardona, Arnold 2012, in the axes of the world); it turns J as well.
    """
    momentum = product(inertia, spin, spin)
    inert = product(inertia, acceleration, spin)
    total = add_scaled(1.0, inert, cross(spin, momentum))
    # [v] is the matrix of v x ., minus `by_turn`
    by_spin = add_scaled(1.0, by_turn(momentum), scale(-1.0, product(by_turn(spin), inertia, spin)))  # [ω] J - [J ω]
    by_increment = add_scaled(mass_factor, inertia, scale(rate_factor, by_spin))
    cross_turned = scale(-1.0, by_turn(turned))
    squared = product(cross_turned, cross_turned, spin)
    inverse = add_scaled(1.0 / 12.0, squared, add_scaled(-0.5, cross_turned, unit_matrix(spin)))
    # δ(J v) = θ x J v - J (θ x v)
    turning_inert = add_scaled(-1.0, product(inertia, by_turn(acceleration), spin), by_turn(inert))
    turning_momentum = add_scaled(-1.0, product(inertia, by_turn(spin), spin), by_turn(momentum))
    gyroscopic = scale(-1.0, product(by_turn(spin), turning_momentum, spin))
    static = add_scaled(1.0, turning_inert, gyroscopic)
    return total, add_scaled(stiffness_factor, static, product(by_increment, inverse, spin))


@formula
def inverse_of(a: Matrix) -> Matrix:
    """Inverse of a matrix (turns x turns), of one entry in a plane or nine in space."""
    if len(a) == 1:
        return (1.0 / a[0],)
    return _inverse_in_space(a)


@formula
def _inverse_in_space(a):
    """Inverse of a full matrix (9,)."""
    c = a[4] * a[8] - a[5] * a[7], a[5] * a[6] - a[3] * a[8], a[3] * a[7] - a[4] * a[6]
    f = 1.0 / (a[0] * c[0] + a[1] * c[1] + a[2] * c[2])
    return (
        f * c[0],
        f * (a[2] * a[7] - a[1] * a[8]),
        f * (a[1] * a[5] - a[2] * a[4]),
        f * c[1],
        f * (a[0] * a[8] - a[2] * a[6]),
        f * (a[2] * a[3] - a[0] * a[5]),
        f * c[2],
        f * (a[1] * a[6] - a[0] * a[7]),
        f * (a[0] * a[4] - a[1] * a[3]),
    )


@formula
def turn_in_space(turn: Turn) -> Turn:
    """Three components of a rotation, angular velocity or moment."""
    return (0.0, turn[0], 0.0) if len(turn) == 1 else turn


@formula
def along_track(like: Vector) -> Vector:
    """Unit vector along the track, in the space of the vector `like`."""
    return (1.0, 0.0) if len(like) == 2 else (1.0, 0.0, 0.0)
