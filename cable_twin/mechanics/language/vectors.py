"""Vectors and matrices of the working space as tuples: the dimension is part of their type.

So kernels are written once for every dimension, yet their loops over it are unrolled and live in registers. A
vector has `dim` entries (2 or 3), a matrix dim² row by row, a symmetric one its upper half, dim (dim + 1) / 2; what is
asked for a length takes any.
"""

from __future__ import annotations

from typing import Any

from cable_twin.mechanics.language.traced import formula

Vector = tuple[float, ...]
Matrix = tuple[float, ...]


@formula
def dot(a: Vector, b: Vector) -> float:
    """Scalar product of two vectors."""
    return sum(x * y for x, y in zip(a, b, strict=True))


@formula
def store(a: Vector, row: Any) -> None:
    """Write the entries of `a` into the array `row`."""
    for i in range(len(a)):
        row[i] = a[i]


@formula
def accumulate(a: Vector, row: Any) -> None:
    """Add the entries of `a` to the array `row`."""
    for i in range(len(a)):
        row[i] += a[i]


@formula
def load(row: Any, like: Vector) -> Vector:
    """First entries of the array `row` as a tuple of the length of `like`."""
    return tuple(row[i] for i in range(len(like)))


@formula
def scale(c: float, a: Vector) -> Vector:
    """Product c a."""
    return tuple(c * x for x in a)


@formula
def subtract(a: Vector, b: Vector) -> Vector:
    """Difference a - b, of vectors or of matrices."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@formula
def add_scaled(c: float, a: Vector, b: Vector) -> Vector:
    """Sum c a + b, of vectors or of symmetric matrices."""
    return tuple(c * x + y for x, y in zip(a, b, strict=True))


@formula
def symmetric(c: float, d: float, a: Vector) -> Matrix:
    """Symmetric matrix c I + d a aᵀ."""
    dim = len(a)
    upper = [(i, j) for i in range(dim) for j in range(i, dim)]
    return tuple(c + d * a[i] * a[j] if i == j else d * a[i] * a[j] for i, j in upper)


@formula
def full(c: float, a: Matrix, d: float) -> Matrix:
    """Full matrix c a + d I of a symmetric matrix `a`."""
    if len(a) == 3:
        return c * a[0] + d, c * a[1], c * a[1], c * a[2] + d
    x, y, z = c * a[1], c * a[2], c * a[4]
    return c * a[0] + d, x, y, x, c * a[3] + d, z, y, z, c * a[5] + d


@formula
def outer(c: float, a: Vector, b: Vector) -> Matrix:
    """Matrix c a bᵀ."""
    return tuple(c * x * y for x in a for y in b)


@formula
def product(a: Matrix, b: Matrix, inner: Vector) -> Matrix:
    """Product of two matrices of any shapes, row by row; rows of `a` have the length of `inner`."""
    count = len(inner)
    rows, columns = len(a) // count, len(b) // count
    return tuple(
        sum(a[i * count + k] * b[k * columns + j] for k in range(count)) for i in range(rows) for j in range(columns)
    )


@formula
def apply(a: Matrix, v: Vector) -> Vector:
    """Product a v of a full matrix and a vector."""
    return product(a, v, v)


@formula
def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Product a b of two full matrices."""
    return product(a, b, a[: 2 if len(a) == 4 else 3])


@formula
def determinant(a: Matrix) -> float:
    """Determinant of a full matrix."""
    if len(a) == 4:
        return a[0] * a[3] - a[1] * a[2]
    return a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6])


@formula
def adjugate(c: float, a: Matrix) -> Matrix:
    """Adjugate of a full matrix times c: its inverse when c is 1 / determinant."""
    if len(a) == 4:
        return c * a[3], -c * a[1], -c * a[2], c * a[0]
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


@formula
def transpose(a: Matrix) -> Matrix:
    """Transpose of a full matrix."""
    return flipped(a, a[: 2 if len(a) == 4 else 3])


@formula
def flipped(a: Matrix, row: Vector) -> Matrix:
    """Transpose of a matrix of any shape, with rows of the length of `row`."""
    columns = len(row)
    return tuple(a[i * columns + j] for j in range(columns) for i in range(len(a) // columns))


@formula
def symmetric_pair(c: float, a: Vector, b: Vector) -> Matrix:
    """Symmetric matrix c (a bᵀ + b aᵀ)."""
    both = symmetric(0.0, c, add_scaled(1.0, a, b))
    return add_scaled(-1.0, symmetric(0.0, c, a), add_scaled(-1.0, symmetric(0.0, c, b), both))


@formula
def block(c: float, a: Matrix, d: float) -> Matrix:
    """Matrix c a + d I of a full matrix `a`."""
    step = 3 if len(a) == 4 else 4
    return tuple(c * x + d if k % step == 0 else c * x for k, x in enumerate(a))


@formula
def unit_matrix(row: Vector) -> Matrix:
    """Unit matrix of the size of the vector `row`."""
    count = len(row)
    return tuple(1.0 if i == j else 0.0 for i in range(count) for j in range(count))
