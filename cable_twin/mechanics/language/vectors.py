"""Vectors and matrices of the working space as tuples: the dimension is part of their type.

So kernels are written once for every dimension, yet their loops over it are unrolled and live in registers. A vector
has `dim` entries (2 or 3), a matrix is a tuple of rows; of a symmetric one only the upper half may be kept, as a vector
of dim (dim + 1) / 2 entries, row by row. In a formula they have the operators of `traced.Vec` and `traced.Mat`: a + b,
c * a, the products a @ b and m @ v, and m.T. Here are these operators for kernels, and the other products.
"""

from __future__ import annotations

from typing import Any

from cable_twin.mechanics.language.traced import Mat, Vec, formula

Vector = tuple[float, ...]
Matrix = tuple[tuple[float, ...], ...]


@formula
def dot(a: Vec, b: Vec) -> Any:
    """Scalar product of two vectors."""
    return a @ b


@formula
def store(a: Vec | Mat, row: Any, first: int = 0) -> None:
    """Write the entries of a vector, or of a matrix row by row, into an array from its entry `first` on."""
    for i, entry in enumerate(a.entries):
        row[first + i] = entry


@formula
def accumulate(a: Vec | Mat, row: Any) -> None:
    """Add the entries of a vector, or of a matrix row by row, to an array."""
    for i, entry in enumerate(a.entries):
        row[i] += entry


@formula
def load(row: Any, like: Vec | Mat, first: int = 0) -> Vec | Mat:
    """Read a vector, or a matrix row by row, of the shape of `like` from the array `row`, from its entry `first` on."""
    if isinstance(like, Vec):
        return Vec(row[first + i] for i in range(len(like)))
    columns = len(like[0])
    return Mat(Vec(row[first + i * columns + j] for j in range(columns)) for i in range(len(like)))


@formula
def scale(c: float, a: Vec | Mat) -> Vec | Mat:
    """Product c a of a number and a vector."""
    return c * a


@formula
def subtract(a: Vec | Mat, b: Vec | Mat) -> Vec | Mat:
    """Difference a - b, of vectors or of matrices."""
    return a - b


@formula
def add_scaled(c: float, a: Vec | Mat, b: Vec | Mat) -> Vec | Mat:
    """Sum c a + b, of vectors or of matrices."""
    return c * a + b


@formula
def product(a: Vec | Mat, b: Vec | Mat) -> Vec | Mat:
    """Product a b of two matrices, of a matrix and a vector, or of a row vector and a matrix."""
    return a @ b


@formula
def less_product(c: Vec | Mat, a: Mat, b: Vec | Mat) -> Vec | Mat:
    """Difference c - a b of a matrix a with vectors or matrices b, c, by one fused multiply-add per product."""
    if isinstance(b, Mat):
        columns = b.T
        return Mat(
            Vec(_less(x, row, column) for x, column in zip(line, columns, strict=True))
            for line, row in zip(c, a, strict=True)
        )
    return Vec(_less(x, row, b) for x, row in zip(c, a, strict=True))


def _less(total: Any, row: Vec, column: Vec) -> Any:
    """`total` less the scalar product of a matrix row and a column, product by product."""
    for x, y in zip(row, column, strict=True):
        total = total - x * y
    return total


@formula
def sum_of_products(a: Mat, x: Vec | Mat, b: Mat, y: Vec | Mat) -> Vec | Mat:
    """Sum a x + b y of matrices a, b times vectors or matrices x, y, added up product by product."""
    if isinstance(x, Mat) and isinstance(y, Mat):
        columns = [Vec((*first, *second)) for first, second in zip(x.T, y.T, strict=True)]
        return Mat(Vec(Vec((*p, *q)) @ column for column in columns) for p, q in zip(a, b, strict=True))
    return Vec(Vec((*p, *q)) @ Vec((*x, *y)) for p, q in zip(a, b, strict=True))


@formula
def linear(a: Mat, x: Vec, b: Mat, y: Vec, c: Vec) -> Vec:
    """Sum c + a x + b y of vectors c, x, y and matrices a, b."""
    return c + sum_of_products(a, x, b, y)


@formula
def outer(c: float, a: Vec, b: Vec) -> Mat:
    """Outer product c a bᵀ of two vectors, times a number c."""
    return Mat(Vec(c * x * y for y in b) for x in a)


@formula
def transpose(a: Mat) -> Mat:
    """Transpose of a matrix."""
    return a.T


@formula
def block(c: float, a: Mat, d: float) -> Mat:
    """Matrix c a + d I of a full matrix `a`."""
    return Mat(Vec(c * x + d if i == j else c * x for j, x in enumerate(row)) for i, row in enumerate(a))


@formula
def unit_matrix(row: Vec) -> Mat:
    """Unit matrix of the size of the vector `row`."""
    count = len(row)
    return Mat(Vec(1.0 if i == j else 0.0 for j in range(count)) for i in range(count))


@formula
def determinant(a: Mat) -> Any:
    """Determinant of a full matrix (dim, dim)."""
    if len(a) == 2:
        return a[0][0] * a[1][1] - a[0][1] * a[1][0]
    (a_0, a_1, a_2), (b_0, b_1, b_2), (c_0, c_1, c_2) = a
    return a_0 * (b_1 * c_2 - b_2 * c_1) - a_1 * (b_0 * c_2 - b_2 * c_0) + a_2 * (b_0 * c_1 - b_1 * c_0)


@formula
def adjugate(c: float, a: Mat) -> Mat:
    """Adjugate of a full matrix (dim, dim) times c: its inverse when c is 1 / determinant."""
    if len(a) == 2:
        return Mat((Vec((c * a[1][1], -c * a[0][1])), Vec((-c * a[1][0], c * a[0][0]))))
    (a_0, a_1, a_2), (b_0, b_1, b_2), (c_0, c_1, c_2) = a
    return c * Mat(
        (
            Vec((b_1 * c_2 - b_2 * c_1, a_2 * c_1 - a_1 * c_2, a_1 * b_2 - a_2 * b_1)),
            Vec((b_2 * c_0 - b_0 * c_2, a_0 * c_2 - a_2 * c_0, a_2 * b_0 - a_0 * b_2)),
            Vec((b_0 * c_1 - b_1 * c_0, a_1 * c_0 - a_0 * c_1, a_0 * b_1 - a_1 * b_0)),
        )
    )


@formula
def symmetric(c: float, d: float, a: Vec) -> Vec:
    """Upper half of the symmetric matrix c I + d a aᵀ."""
    dim = len(a)
    upper = [(i, j) for i in range(dim) for j in range(i, dim)]
    return Vec(c + d * a[i] * a[j] if i == j else d * a[i] * a[j] for i, j in upper)


@formula
def symmetric_pair(c: float, a: Vec, b: Vec) -> Vec:
    """Upper half of the symmetric matrix c (a bᵀ + b aᵀ)."""
    return symmetric(0.0, c, a + b) - symmetric(0.0, c, b) - symmetric(0.0, c, a)


@formula
def full(c: float, a: Vec, d: float) -> Mat:
    """Full matrix c a + d I of the upper half `a` of a symmetric one."""
    if len(a) == 3:
        return Mat((Vec((c * a[0] + d, c * a[1])), Vec((c * a[1], c * a[2] + d))))
    x, y, z = c * a[1], c * a[2], c * a[4]
    return Mat((Vec((c * a[0] + d, x, y)), Vec((x, c * a[3] + d, z)), Vec((y, z, c * a[5] + d))))
