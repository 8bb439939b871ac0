"""Vectors and matrices of the working space as tuples: the dimension is part of their type.

So kernels are written once for every dimension, yet their loops over it are unrolled and live in registers. A
vector has `dim` entries (2 or 3), a matrix dim² row by row, a symmetric one its upper half, dim (dim + 1) / 2. Each
function is plain Python, used as it stands when the JIT is off; `overload` gives numba the same as one expression.
"""

from __future__ import annotations

from typing import Any

from numba.extending import overload

from cable_twin.mechanics.language.compilation import OVERLOAD, inlined_kernel, kernel

Vector = tuple[float, ...]
Matrix = tuple[float, ...]


@inlined_kernel
def dot(a, b):
    """Scalar product of two vectors."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@inlined_kernel
def store(a, row):
    """Write the entries of `a` into the array `row`."""
    for i in range(len(a)):
        row[i] = a[i]


@inlined_kernel
def accumulate(a, row):
    """Add the entries of `a` to the array `row`."""
    for i in range(len(a)):
        row[i] += a[i]


def load(row: Any, like: Vector) -> Vector:
    """First entries of the array `row` as a tuple of the length of `like`."""
    return tuple(float(value) for value in row[: len(like)])


@overload(load, jit_options=OVERLOAD)
def _load(row, like):
    return {
        2: lambda row, like: (row[0], row[1]),
        3: lambda row, like: (row[0], row[1], row[2]),
        4: lambda row, like: (row[0], row[1], row[2], row[3]),
        9: lambda row, like: (row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8]),
    }[like.count]


def scale(c: float, a: Vector) -> Vector:
    """Product c a."""
    return tuple(c * value for value in a)


@overload(scale, jit_options=OVERLOAD)
def _scale(c, a):
    return {
        2: lambda c, a: (c * a[0], c * a[1]),
        3: lambda c, a: (c * a[0], c * a[1], c * a[2]),
    }[a.count]


def subtract(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@overload(subtract, jit_options=OVERLOAD)
def _subtract(a, b):
    return {
        2: lambda a, b: (a[0] - b[0], a[1] - b[1]),
        3: lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2]),
    }[a.count]


def add_scaled(c: float, a: Vector, b: Vector) -> Vector:
    """Sum c a + b, of vectors or of symmetric matrices."""
    return tuple(c * x + y for x, y in zip(a, b, strict=True))


@overload(add_scaled, jit_options=OVERLOAD)
def _add_scaled(c, a, b):
    return {
        2: lambda c, a, b: (c * a[0] + b[0], c * a[1] + b[1]),
        3: lambda c, a, b: (c * a[0] + b[0], c * a[1] + b[1], c * a[2] + b[2]),
        6: lambda c, a, b: (
            c * a[0] + b[0],
            c * a[1] + b[1],
            c * a[2] + b[2],
            c * a[3] + b[3],
            c * a[4] + b[4],
            c * a[5] + b[5],
        ),
    }[a.count]


def quarter_turn(c: float, a: Vector) -> Vector:
    """Vector `a` times c, turned by a quarter about y: z becomes x, x becomes -z, what is across the plane goes."""
    return (c * a[-1], *(0.0,) * (len(a) - 2), -c * a[0])


@overload(quarter_turn, jit_options=OVERLOAD)
def _quarter_turn(c, a):
    return {
        2: lambda c, a: (c * a[1], -c * a[0]),
        3: lambda c, a: (c * a[2], 0.0, -c * a[0]),
    }[a.count]


def symmetric(c: float, d: float, a: Vector) -> Matrix:
    """Symmetric matrix c I + d a aᵀ."""
    dim = len(a)
    return tuple(c * (i == j) + d * a[i] * a[j] for i in range(dim) for j in range(i, dim))


@overload(symmetric, jit_options=OVERLOAD)
def _symmetric(c, d, a):
    return {
        2: lambda c, d, a: (c + d * a[0] * a[0], d * a[0] * a[1], c + d * a[1] * a[1]),
        3: lambda c, d, a: (
            c + d * a[0] * a[0],
            d * a[0] * a[1],
            d * a[0] * a[2],
            c + d * a[1] * a[1],
            d * a[1] * a[2],
            c + d * a[2] * a[2],
        ),
    }[a.count]


def full(c: float, a: Matrix, d: float) -> Matrix:
    """Full matrix c a + d I of a symmetric matrix `a`."""
    if len(a) == 3:
        return (c * a[0] + d, c * a[1], c * a[1], c * a[2] + d)
    x, y, z = c * a[1], c * a[2], c * a[4]
    return (c * a[0] + d, x, y, x, c * a[3] + d, z, y, z, c * a[5] + d)


@overload(full, jit_options=OVERLOAD)
def _full(c, a, d):
    return {
        3: lambda c, a, d: (c * a[0] + d, c * a[1], c * a[1], c * a[2] + d),
        6: lambda c, a, d: (
            c * a[0] + d,
            c * a[1],
            c * a[2],
            c * a[1],
            c * a[3] + d,
            c * a[4],
            c * a[2],
            c * a[4],
            c * a[5] + d,
        ),
    }[a.count]


def outer(c: float, a: Vector, b: Vector) -> Matrix:
    """Matrix c a bᵀ."""
    return tuple(c * x * y for x in a for y in b)


@overload(outer, jit_options=OVERLOAD)
def _outer(c, a, b):
    return {
        2: lambda c, a, b: (c * a[0] * b[0], c * a[0] * b[1], c * a[1] * b[0], c * a[1] * b[1]),
        3: lambda c, a, b: (
            c * a[0] * b[0],
            c * a[0] * b[1],
            c * a[0] * b[2],
            c * a[1] * b[0],
            c * a[1] * b[1],
            c * a[1] * b[2],
            c * a[2] * b[0],
            c * a[2] * b[1],
            c * a[2] * b[2],
        ),
    }[a.count]


def apply(a: Matrix, v: Vector) -> Vector:
    """Product a v of a full matrix and a vector."""
    dim = len(v)
    return tuple(sum(a[i * dim + j] * v[j] for j in range(dim)) for i in range(dim))


@overload(apply, jit_options=OVERLOAD)
def _apply(a, v):
    return {
        2: lambda a, v: (a[0] * v[0] + a[1] * v[1], a[2] * v[0] + a[3] * v[1]),
        3: lambda a, v: (
            a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
            a[3] * v[0] + a[4] * v[1] + a[5] * v[2],
            a[6] * v[0] + a[7] * v[1] + a[8] * v[2],
        ),
    }[v.count]


def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Product a b of two full matrices."""
    dim = 2 if len(a) == 4 else 3
    return tuple(sum(a[i * dim + m] * b[m * dim + j] for m in range(dim)) for i in range(dim) for j in range(dim))


@overload(multiply, jit_options=OVERLOAD)
def _multiply(a, b):
    return {
        4: lambda a, b: (
            a[0] * b[0] + a[1] * b[2],
            a[0] * b[1] + a[1] * b[3],
            a[2] * b[0] + a[3] * b[2],
            a[2] * b[1] + a[3] * b[3],
        ),
        9: lambda a, b: (
            a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
            a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
            a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
            a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
            a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
            a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
            a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
        ),
    }[a.count]


def minus(a: Matrix, b: Matrix) -> Matrix:
    """Difference a - b of two full matrices."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@overload(minus, jit_options=OVERLOAD)
def _minus(a, b):
    return {
        4: lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]),
        9: lambda a, b: (
            a[0] - b[0],
            a[1] - b[1],
            a[2] - b[2],
            a[3] - b[3],
            a[4] - b[4],
            a[5] - b[5],
            a[6] - b[6],
            a[7] - b[7],
            a[8] - b[8],
        ),
    }[a.count]


@kernel
def determinant(a):
    """Determinant of a full matrix."""
    if len(a) == 4:
        return a[0] * a[3] - a[1] * a[2]
    return a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6])


def adjugate(c: float, a: Matrix) -> Matrix:
    """Adjugate of a full matrix times c: its inverse when c is 1 / determinant."""
    if len(a) == 4:
        return (c * a[3], -c * a[1], -c * a[2], c * a[0])
    return (
        c * (a[4] * a[8] - a[5] * a[7]),
        c * (a[2] * a[7] - a[1] * a[8]),
        c * (a[1] * a[5] - a[2] * a[4]),
        c * (a[5] * a[6] - a[3] * a[8]),
        c * (a[0] * a[8] - a[2] * a[6]),
        c * (a[2] * a[3] - a[0] * a[5]),
        c * (a[3] * a[7] - a[4] * a[6]),
        c * (a[1] * a[6] - a[0] * a[7]),
        c * (a[0] * a[4] - a[1] * a[3]),
    )


@overload(adjugate, jit_options=OVERLOAD)
def _adjugate(c, a):
    return {
        4: lambda c, a: (c * a[3], -c * a[1], -c * a[2], c * a[0]),
        9: lambda c, a: (
            c * (a[4] * a[8] - a[5] * a[7]),
            c * (a[2] * a[7] - a[1] * a[8]),
            c * (a[1] * a[5] - a[2] * a[4]),
            c * (a[5] * a[6] - a[3] * a[8]),
            c * (a[0] * a[8] - a[2] * a[6]),
            c * (a[2] * a[3] - a[0] * a[5]),
            c * (a[3] * a[7] - a[4] * a[6]),
            c * (a[1] * a[6] - a[0] * a[7]),
            c * (a[0] * a[4] - a[1] * a[3]),
        ),
    }[a.count]


def transpose(a: Matrix) -> Matrix:
    """Transpose of a full matrix."""
    dim = 2 if len(a) == 4 else 3
    return tuple(a[j * dim + i] for i in range(dim) for j in range(dim))


@overload(transpose, jit_options=OVERLOAD)
def _transpose(a):
    return {
        4: lambda a: (a[0], a[2], a[1], a[3]),
        9: lambda a: (a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]),
    }[a.count]


@kernel
def symmetric_pair(c, a, b):
    """Symmetric matrix c (a bᵀ + b aᵀ)."""
    both = symmetric(0.0, c, add_scaled(1.0, a, b))
    return add_scaled(-1.0, symmetric(0.0, c, a), add_scaled(-1.0, symmetric(0.0, c, b), both))


def block(c: float, a: Matrix, d: float) -> Matrix:
    """Matrix c a + d I of a full matrix `a`."""
    step = 3 if len(a) == 4 else 4
    return tuple(c * value + (d if k % step == 0 else 0.0) for k, value in enumerate(a))


@overload(block, jit_options=OVERLOAD)
def _block(c, a, d):
    return {
        4: lambda c, a, d: (c * a[0] + d, c * a[1], c * a[2], c * a[3] + d),
        9: lambda c, a, d: (
            c * a[0] + d,
            c * a[1],
            c * a[2],
            c * a[3],
            c * a[4] + d,
            c * a[5],
            c * a[6],
            c * a[7],
            c * a[8] + d,
        ),
    }[a.count]
