"""Cubic shape functions of the cable element (paper, eq. 2), their integrals, and array layout of element groups.

The four functions S belong to the nodal coordinates (r_A, r_x of A, r_B, r_x of B). As S_1 + S_3 = 1, derivatives
along the cable need only three: of the chord d = r_B - r_A and of the two slopes.

Residual and tangent of a group of elements are in `Workspace.group`, one row a number, one lane an element: first the
vectors of the four nodal coordinates, then the sixteen blocks of coordinate i against j, row by row.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import leggauss

from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import add_scaled, scale
from cable_twin.mechanics.parameters import FloatArray

AXIAL_POINTS = 4  # Gauss points of the axial energy
BENDING_POINTS = 3  # of the bending energy


def _abscissae(points: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre points and weights (points,) on the interval 0..1."""
    x, weights = leggauss(points)
    return (x + 1.0) / 2.0, weights / 2.0


def _slopes(x: FloatArray) -> FloatArray:
    """First derivatives S_x l of the shape functions of (d, slope A times l, slope B times l), (points, 3)."""
    return np.stack([6 * x - 6 * x**2, 1 - 4 * x + 3 * x**2, -2 * x + 3 * x**2], axis=1)


def _curvatures(x: FloatArray) -> FloatArray:
    """Second derivatives S_xx l² of the shape functions of (d, slope A times l, slope B times l), (points, 3)."""
    return np.stack([6 - 12 * x, -4 + 6 * x, -2 + 6 * x], axis=1)


def _rows(table: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Convert a table of numbers to nested tuples, as a constant of compiled kernels."""
    return tuple(tuple(float(value) for value in row) for row in table)


_AXIAL, _AXIAL_WEIGHT = _abscissae(AXIAL_POINTS)
_BENDING, _BENDING_WEIGHT = _abscissae(BENDING_POINTS)
AXIAL_PLACES = tuple(_AXIAL.tolist())
AXIAL_WEIGHT = tuple(_AXIAL_WEIGHT.tolist())
AXIAL_SLOPES = _rows(_slopes(_AXIAL))
BENDING_WEIGHT = tuple(_BENDING_WEIGHT.tolist())
BENDING_SLOPES = _rows(_slopes(_BENDING))
BENDING_CURVATURES = _rows(_curvatures(_BENDING))

# Eq. 6 with its missing factor m/l: integrals of S_i S_j over 0..1 with slopes taken times l.
MASS = (
    (13 / 35, 11 / 210, 9 / 70, -13 / 420),
    (11 / 210, 1 / 105, 13 / 420, -1 / 140),
    (9 / 70, 13 / 420, 13 / 35, -11 / 210),
    (-13 / 420, -1 / 140, -11 / 210, 1 / 105),
)

# Integrals of S_i S_j' and of S_i' S_j' over 0..1, ' by x / l, slopes likewise.
FLOW = (
    (-1 / 2, 1 / 10, 1 / 2, -1 / 10),
    (-1 / 10, 0.0, 1 / 10, -1 / 60),
    (-1 / 2, -1 / 10, 1 / 2, 1 / 10),
    (1 / 10, 1 / 60, -1 / 10, 0.0),
)
SLOPE = (
    (6 / 5, 1 / 10, -6 / 5, 1 / 10),
    (1 / 10, 2 / 15, -1 / 10, -1 / 30),
    (-6 / 5, -1 / 10, 6 / 5, -1 / 10),
    (1 / 10, -1 / 30, -1 / 10, 2 / 15),
)
# The same of chord and slopes, d, A and B: a row's coefficients of r_A and r_B are opposite.
FLOW_OF_CHORD = tuple((row[2], row[1], row[3]) for row in FLOW)
SLOPE_OF_CHORD = tuple((row[2], row[1], row[3]) for row in SLOPE)


@formula
def shape_functions(x, length):
    """Shape functions S_1..S_4 (eq. 2) of an element of `length` (m) at x (m)."""
    u = x / length
    return 1 - u * u * (3 - 2 * u), x * (1 - u) * (1 - u), u * u * (3 - 2 * u), x * u * (u - 1)


@formula
def shape_functions_x(x, length):
    """First derivatives of the shape functions along the cable, 1/m for positions, - for slopes."""
    u = x / length
    s = 6 * u * (1 - u) / length
    return -s, 1 - u * (4 - 3 * u), s, u * (3 * u - 2)


@formula
def shape_functions_xx(x, length):
    """Second derivatives of the shape functions along the cable, 1/m² for positions, 1/m for slopes."""
    u = x / length
    s = (6 - 12 * u) / (length * length)
    return -s, (6 * u - 4) / length, s, (6 * u - 2) / length


@formula
def shape_functions_xxx(length):
    """Third derivatives of the shape functions along the cable, 1/m³ for positions, 1/m² for slopes; constant."""
    s = 12 / (length * length * length)
    return s, 6 / (length * length), -s, 6 / (length * length)


@formula
def combine(c, d, a, b):
    """Linear combination c_0 d + c_1 a + c_2 b of three vectors."""
    return add_scaled(c[0], d, add_scaled(c[1], a, scale(c[2], b)))


@formula
def vector_row(i, like):
    """First row, in the array of a group of elements, of the vector (dim,) of nodal coordinate i."""
    return i * len(like)


@formula
def block_row(i, j, like):
    """First row, in the array of a group of elements, of the block (dim²) of nodal coordinate i against j."""
    dim = len(like)
    return 4 * dim + (4 * i + j) * dim * dim
