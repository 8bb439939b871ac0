"""Rotations and orientations of bodies: a tuple of one angle about y in a plane, or of three angles in space.

A rotation is a tuple of 1 or 3 angles in rad about the axes of the world; so are an angular velocity in rad/s and a
moment in N m. The coordinates of a body are its centre of mass and, in a plane, its pitch; in space its unit quaternion
x, y, z, w.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import Any

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.traced import Mat, Vec, formula
from cable_twin.mechanics.language.vectors import (
    Matrix,
    Vector,
    load,
    product,
    transpose,
    unit_matrix,
)

Turn = tuple[float, ...]


@formula
def no_turn(like: Vector) -> Turn:
    """Zero rotation for the dimension of the vector `like`: one angle in a plane, three in space."""
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
def by_turn(arm: Vec) -> Mat:
    """Matrix B (dim x turns) of the cross product θ x a = B θ for an arm a; a x F = Bᵀ F."""
    if len(arm) == 2:
        return Mat((Vec((arm[1],)), Vec((-arm[0],))))
    x, y, z = arm
    return Mat((Vec((0.0, z, -y)), Vec((-z, 0.0, x)), Vec((y, -x, 0.0))))


@formula
def moment_by_turn(arm: Vec, force: Vec) -> Mat:
    """Derivative (turns x turns) of the moment (θ x a) x F by the rotation θ of the arm: a Fᵀ - (a·F) 1."""
    along = [x * f for x, f in zip(arm, force, strict=True)]
    if len(arm) == 2:
        return Mat((Vec((-sum(along),)),))
    beside = [-(along[1] + along[2]), -(along[0] + along[2]), -(along[0] + along[1])]  # without what would cancel
    return Mat(Vec(beside[i] if i == j else arm[i] * force[j] for j in range(3)) for i in range(3))


@formula
def gyration(
    inertia: Mat,
    spin: Vec,
    acceleration: Vec,
    turned: Vec,
    mass_factor: float,
    rate_factor: float,
    stiffness_factor: float,
):
    """Inertia moment J ω_dot + ω x J ω of a body about its centre, and its derivative by a rotation θ.

    Args:
        inertia: J (turns²) about the axes of the world.
        spin: ω (turns,) rad/s.
        acceleration: ω_dot (turns,) rad/s².
        turned: rotation vector Δ (turns,) of the step so far, to which the integrator adds increments.
        mass_factor: ∂ω_dot/∂Δ of the integrator.
        rate_factor: ∂ω/∂Δ of the integrator.
        stiffness_factor: of the rotation itself, 1 or 0.
    """
    if len(spin) == 1:
        return inertia @ acceleration, mass_factor * inertia
    return _gyration_in_space(inertia, spin, acceleration, turned, mass_factor, rate_factor, stiffness_factor)


@formula
def _gyration_in_space(inertia, spin, acceleration, turned, mass_factor, rate_factor, stiffness_factor):
    """Inertia moment J ω_dot + ω x J ω of a body in space, and its derivative by a rotation θ (3,).

    A rotation θ of the body is the addition T⁻¹ θ to the rotation vector Δ of the step, with
    T⁻¹ = 1 - [Δ]/2 + [Δ]²/12 - ... (Brüls, Cardona, Arnold 2012, in the axes of the world); it turns J as well.
    """
    momentum, inert = inertia @ spin, inertia @ acceleration
    total = inert + cross(spin, momentum)
    # [v] is the matrix of v x ., minus `by_turn`
    by_spin = by_turn(momentum) - by_turn(spin) @ inertia  # [ω] J - [J ω]
    by_increment = mass_factor * inertia + rate_factor * by_spin
    delta = -by_turn(turned)  # [Δ]
    inverse = unit_matrix(spin) - 0.5 * delta + (1.0 / 12.0) * (delta @ delta)  # T⁻¹
    # δ(J v) = θ x J v - J (θ x v)
    turning_inert = by_turn(inert) - inertia @ by_turn(acceleration)
    turning_momentum = by_turn(momentum) - inertia @ by_turn(spin)
    static = turning_inert - by_turn(spin) @ turning_momentum
    return total, stiffness_factor * static + by_increment @ inverse


@formula
def inverse_of(a: Mat) -> Mat:
    """Inverse of a matrix (turns x turns), of one entry in a plane or nine in space."""
    if len(a) == 1:
        return Mat((Vec((1.0 / a[0][0],)),))
    (a_0, a_1, a_2), (b_0, b_1, b_2), (c_0, c_1, c_2) = a
    minors = b_1 * c_2 - b_2 * c_1, b_2 * c_0 - b_0 * c_2, b_0 * c_1 - b_1 * c_0
    factor = 1.0 / (a_0 * minors[0] + a_1 * minors[1] + a_2 * minors[2])
    return factor * Mat(
        (
            Vec((minors[0], a_2 * c_1 - a_1 * c_2, a_1 * b_2 - a_2 * b_1)),
            Vec((minors[1], a_0 * c_2 - a_2 * c_0, a_2 * b_0 - a_0 * b_2)),
            Vec((minors[2], a_1 * c_0 - a_0 * c_1, a_0 * b_1 - a_1 * b_0)),
        )
    )


@formula
def turn_in_space(turn: Turn) -> Turn:
    """Three components in space of a rotation, angular velocity or moment, also of one in a plane."""
    return (0.0, turn[0], 0.0) if len(turn) == 1 else turn


@formula
def along_track(like: Vector) -> Vector:
    """Unit vector along the track, for the dimension of the vector `like`."""
    return (1.0, 0.0) if len(like) == 2 else (1.0, 0.0, 0.0)


SMALL = 1e-4  # rad: below, series of sines are taken that are exact to rounding


@kernel
def orientation(row: Any, like: Vector) -> Matrix:
    """Rotation matrix A (dim²) of a body from its coordinates: a vector u of the body is A u in the world."""
    if len(like) == 2:
        c, s = cos(row[2]), sin(row[2])
        return (c, s), (-s, c)
    return _of_quaternion(row[3], row[4], row[5], row[6])


@formula
def _of_quaternion(x, y, z, w):
    """Rotation matrix (3, 3) of a quaternion of any non-zero length."""
    f = 2.0 / (x * x + y * y + z * z + w * w)
    return (
        (1.0 - f * (y * y + z * z), f * (x * y - z * w), f * (x * z + y * w)),
        (f * (x * y + z * w), 1.0 - f * (x * x + z * z), f * (y * z - x * w)),
        (f * (x * z - y * w), f * (y * z + x * w), 1.0 - f * (x * x + y * y)),
    )


@kernel
def turn_row(row, turn):
    """Rotate the quaternion of a body in space by a rotation vector (3,) about the axes of the world."""
    a, b, d, c = _quaternion(turn)
    x, y, z, w = row[3], row[4], row[5], row[6]
    p = c * x + a * w + b * z - d * y
    q = c * y + b * w + d * x - a * z
    r = c * z + d * w + a * y - b * x
    s = c * w - a * x - b * y - d * z
    length = sqrt(p * p + q * q + r * r + s * s)
    row[3], row[4], row[5], row[6] = p / length, q / length, r / length, s / length


@formula
def quaternion_rate(row, spin):
    """Rate (4,) in 1/s of a body's quaternion at an angular velocity (3,) about the axes of the world: ω q / 2."""
    a, b, c = 0.5 * spin[0], 0.5 * spin[1], 0.5 * spin[2]
    x, y, z, w = row[3], row[4], row[5], row[6]
    return a * w + b * z - c * y, b * w + c * x - a * z, c * w + a * y - b * x, -a * x - b * y - c * z


@kernel
def inertia_of(inertia: Any, body: int, axes: Matrix, like: Vector) -> Matrix:
    """Inertia (turns²) in kg m² of a body about the axes of the world; `axes` is its rotation matrix.

    Takes the inertias (bodies,) about y of bodies in a plane, or the tensors (bodies, 9) in the axes of each body.
    """
    if len(like) == 2:
        return ((inertia[body],),)
    return product(product(axes, load(inertia[body], axes)), transpose(axes))


@kernel
def set_upright(row: Any, along: Vector) -> None:
    """Set a body upright: its axes those of the world, in space rotated about z to put x along the cable.

    `along` (dim,) is the direction of the cable; of its two senses, x takes the one in which x of the world rises.
    """
    if len(along) == 2:
        row[2] = 0.0
    else:
        half = _half_heading(along)
        row[3], row[4], row[5], row[6] = 0.0, 0.0, sin(half), cos(half)


@kernel
def _half_heading(along):
    """Half the angle (rad) about z to the direction `along` (3,) or its opposite, whichever has positive x."""
    sign = 1.0 if along[0] >= 0.0 else -1.0
    return 0.5 * atan2(sign * along[1], sign * along[0]) if along[0] != 0.0 or along[1] != 0.0 else 0.0


@kernel
def move_body(position: Any, increment: Any, like: Vector) -> None:
    """Add an increment (dim + turns,) in m and rad to the coordinates of a body."""
    for axis in range(3):
        position[axis] += increment[axis]
    if len(like) == 3:
        turn_row(position, load(increment[3:], like))


@kernel
def make_unit(positions: Any, like: Vector) -> None:
    """Normalise the quaternions of all bodies in space; no-op in a plane."""
    if len(like) == 3:
        for body in range(positions.shape[0]):
            turn_row(positions[body], (0.0, 0.0, 0.0))


@kernel
def grow_turn(turned, turn):
    """Update a rotation vector Δ (3,) by a further rotation θ about the axes of the world; returns the growth of Δ.

    exp(Δ + δ) = exp(θ) exp(Δ): quaternions are multiplied, and the logarithm taken of the product.
    """
    before = (turned[0], turned[1], turned[2])
    a, b = _quaternion(before), _quaternion((turn[0], turn[1], turn[2]))
    w = b[3] * a[3] - b[0] * a[0] - b[1] * a[1] - b[2] * a[2]
    x = b[3] * a[0] + b[0] * a[3] + b[1] * a[2] - b[2] * a[1]
    y = b[3] * a[1] + b[1] * a[3] + b[2] * a[0] - b[0] * a[2]
    z = b[3] * a[2] + b[2] * a[3] + b[0] * a[1] - b[1] * a[0]
    size = sqrt(x * x + y * y + z * z)
    by = 2.0 * atan2(size, w) / size if size > SMALL else 2.0 + size * size / 3.0
    turned[0], turned[1], turned[2] = by * x, by * y, by * z
    return turned[0] - before[0], turned[1] - before[1], turned[2] - before[2]


@kernel
def _quaternion(turn):
    """Unit quaternion x, y, z, w of a rotation vector (3,)."""
    squared = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    angle = sqrt(squared)
    half = sin(0.5 * angle) / angle if angle > SMALL else 0.5 - squared / 48.0
    return half * turn[0], half * turn[1], half * turn[2], cos(0.5 * angle)


@kernel
def orientation_in_space(row: Any, like: Vector) -> tuple[Vector, Vector]:
    """Unit quaternion x, y, z, w of a body from its coordinates, and its angles of roll, pitch and yaw in rad.

    The pitch of a body in a plane is not wrapped after a full turn.
    """
    if len(like) == 2:
        return (0.0, sin(0.5 * row[2]), 0.0, cos(0.5 * row[2])), (0.0, row[2], 0.0)
    return (row[3], row[4], row[5], row[6]), _angles(row)


@kernel
def _angles(row):
    """Roll, pitch and yaw (rad) of a body in space: about z, then about its own y, then about its own x."""
    a = _of_quaternion(row[3], row[4], row[5], row[6])
    x, y, z = a[2]
    return atan2(y, z), atan2(-x, sqrt(y * y + z * z)), atan2(a[1][0], a[0][0])


@kernel
def turn_between(first: Any, last: Any, like: Vector) -> Turn:
    """Rotation (turns,) in rad from the coordinates `first` to `last` of a body, less than half a turn."""
    if len(like) == 2:
        return (last[2] - first[2],)
    return _turn_between(first, last)


@kernel
def _turn_between(first, last):
    """Rotation vector (3,) from body `first` to `last`: logarithm of `last` times the conjugate of `first`."""
    a, b, c, d = first[3], first[4], first[5], first[6]
    x, y, z, w = last[3], last[4], last[5], last[6]
    p = -w * a + x * d - y * c + z * b
    q = -w * b + x * c + y * d - z * a
    r = -w * c - x * b + y * a + z * d
    s = w * d + x * a + y * b + z * c
    size = sqrt(p * p + q * q + r * r)
    by = 2.0 * atan2(size, abs(s)) / size if size > SMALL else 2.0
    by = by if s >= 0.0 else -by
    return by * p, by * q, by * r
