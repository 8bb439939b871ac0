"""Vectors and matrices of the working space as tuples: the dimension is part of their type.

So kernels are written once for every dimension, yet their loops over it are unrolled and live in registers. A
vector has `dim` entries (2 or 3), a matrix dim² row by row, a symmetric one its upper half, dim (dim + 1) / 2; what is
asked for a length takes any. Each function is plain Python, used as it stands when the JIT is off; `overload` gives
numba the same as one expression.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

from numba.extending import overload

from cable_twin.mechanics.language.compilation import OVERLOAD, inlined_kernel, kernel

Vector = tuple[float, ...]
Matrix = tuple[float, ...]
OPTIONS: Any = OVERLOAD  # of what `overload` gives to numba


def formula(arguments: str, entries: list[str]) -> Callable[..., Any]:
    """The function that gives a tuple of these expressions: what numba compiles for one length of vectors."""
    source = f"lambda {arguments}: ({', '.join(entries)},)"
    function = eval(source)
    # a name of its own: what is compiled is kept by name and types, and the numbers in a formula count for neither
    name = f"formula_{hashlib.sha256(source.encode()).hexdigest()[:16]}"
    function.__code__ = function.__code__.replace(co_name=name)
    function.__name__ = function.__qualname__ = name
    return function


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


@overload(load, jit_options=OPTIONS)
def _load(row, like):
    return formula("row, like", [f"row[{i}]" for i in range(like.count)])


def scale(c: float, a: Vector) -> Vector:
    """Product c a."""
    return tuple(c * value for value in a)


@overload(scale, jit_options=OPTIONS)
def _scale(c, a):
    return formula("c, a", [f"c * a[{i}]" for i in range(a.count)])


def subtract(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@overload(subtract, jit_options=OPTIONS)
def _subtract(a, b):
    return formula("a, b", [f"a[{i}] - b[{i}]" for i in range(a.count)])


def add_scaled(c: float, a: Vector, b: Vector) -> Vector:
    """Sum c a + b, of vectors or of symmetric matrices."""
    return tuple(c * x + y for x, y in zip(a, b, strict=True))


@overload(add_scaled, jit_options=OPTIONS)
def _add_scaled(c, a, b):
    return formula("c, a, b", [f"c * a[{i}] + b[{i}]" for i in range(a.count)])


def symmetric(c: float, d: float, a: Vector) -> Matrix:
    """Symmetric matrix c I + d a aᵀ."""
    dim = len(a)
    return tuple(c * (i == j) + d * a[i] * a[j] for i in range(dim) for j in range(i, dim))


@overload(symmetric, jit_options=OPTIONS)
def _symmetric(c, d, a):
    upper = [(i, j) for i in range(a.count) for j in range(i, a.count)]
    return formula("c, d, a", [f"{'c + ' if i == j else ''}d * a[{i}] * a[{j}]" for i, j in upper])


def full(c: float, a: Matrix, d: float) -> Matrix:
    """Full matrix c a + d I of a symmetric matrix `a`."""
    if len(a) == 3:
        return (c * a[0] + d, c * a[1], c * a[1], c * a[2] + d)
    x, y, z = c * a[1], c * a[2], c * a[4]
    return (c * a[0] + d, x, y, x, c * a[3] + d, z, y, z, c * a[5] + d)


@overload(full, jit_options=OPTIONS)
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


@overload(outer, jit_options=OPTIONS)
def _outer(c, a, b):
    return formula("c, a, b", [f"c * a[{i}] * b[{j}]" for i in range(a.count) for j in range(b.count)])


def product(a: Matrix, b: Matrix, inner: Vector) -> Matrix:
    """Product of two matrices of any shapes, row by row; a row of `a` is as long as `inner`."""
    count = len(inner)
    rows, columns = len(a) // count, len(b) // count
    return tuple(
        sum(a[i * count + k] * b[k * columns + j] for k in range(count)) for i in range(rows) for j in range(columns)
    )


@overload(product, jit_options=OPTIONS)
def _product(a, b, inner):
    count = inner.count
    rows, columns = a.count // count, b.count // count
    entries = [
        " + ".join(f"a[{i * count + k}] * b[{k * columns + j}]" for k in range(count))
        for i in range(rows)
        for j in range(columns)
    ]
    return formula("a, b, inner", entries)


@inlined_kernel
def apply(a, v):
    """Product a v of a full matrix and a vector."""
    return product(a, v, v)


def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Product a b of two full matrices."""
    return product(a, b, a[: 2 if len(a) == 4 else 3])


@overload(multiply, jit_options=OPTIONS)
def _multiply(a, b):
    return {
        4: lambda a, b: product(a, b, (a[0], a[1])),
        9: lambda a, b: product(a, b, (a[0], a[1], a[2])),
    }[a.count]


def minus(a: Matrix, b: Matrix) -> Matrix:
    """Difference a - b of two matrices of one shape."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@overload(minus, jit_options=OPTIONS)
def _minus(a, b):
    return formula("a, b", [f"a[{i}] - b[{i}]" for i in range(a.count)])


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


@overload(adjugate, jit_options=OPTIONS)
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
    return flipped(a, a[: 2 if len(a) == 4 else 3])


@overload(transpose, jit_options=OPTIONS)
def _transpose(a):
    return {4: lambda a: (a[0], a[2], a[1], a[3]), 9: lambda a: flipped(a, (a[0], a[1], a[2]))}[a.count]


def flipped(a: Matrix, row: Vector) -> Matrix:
    """Transpose of a matrix of any shape whose rows are as long as `row`."""
    columns = len(row)
    return tuple(a[i * columns + j] for j in range(columns) for i in range(len(a) // columns))


@overload(flipped, jit_options=OPTIONS)
def _flipped(a, row):
    columns = row.count
    return formula("a, row", [f"a[{i * columns + j}]" for j in range(columns) for i in range(a.count // columns)])


@kernel
def symmetric_pair(c, a, b):
    """Symmetric matrix c (a bᵀ + b aᵀ)."""
    both = symmetric(0.0, c, add_scaled(1.0, a, b))
    return add_scaled(-1.0, symmetric(0.0, c, a), add_scaled(-1.0, symmetric(0.0, c, b), both))


def block(c: float, a: Matrix, d: float) -> Matrix:
    """Matrix c a + d I of a full matrix `a`."""
    step = 3 if len(a) == 4 else 4
    return tuple(c * value + (d if k % step == 0 else 0.0) for k, value in enumerate(a))


@overload(block, jit_options=OPTIONS)
def _block(c, a, d):
    step = 3 if a.count == 4 else 4
    return formula("c, a, d", [f"c * a[{k}]{' + d' if k % step == 0 else ''}" for k in range(a.count)])


def unit_matrix(row: Vector) -> Matrix:
    """The unit matrix whose rows are as long as `row`."""
    count = len(row)
    return tuple(1.0 if i == j else 0.0 for i in range(count) for j in range(count))


@overload(unit_matrix, jit_options=OPTIONS)
def _unit_matrix(row):
    return formula("row", ["1.0" if i == j else "0.0" for i in range(row.count) for j in range(row.count)])
