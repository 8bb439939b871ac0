"""Blocks of whole nodes: 2 x 2 matrices of the working space, of r and r_x against r and r_x, as tuples of four."""

from __future__ import annotations

from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    adjugate,
    apply,
    determinant,
    load,
    multiply,
    outer,
    scale,
    store,
    subtract,
)


@formula
def no_node(like):
    """Zero block of a node."""
    zero = outer(0.0, like, like)
    return zero, zero, zero, zero


@formula
def load_node(array, square):
    """Block of a node from an array (2, 2, dim²)."""
    return load(array[0, 0], square), load(array[0, 1], square), load(array[1, 0], square), load(array[1, 1], square)


@formula
def store_node(matrices, array):
    """Write the block of a node to an array (2, 2, dim²)."""
    store(matrices[0], array[0, 0])
    store(matrices[1], array[0, 1])
    store(matrices[2], array[1, 0])
    store(matrices[3], array[1, 1])


@formula
def multiply_nodes(a, b):
    """Product a b of two node blocks."""
    return (
        add_scaled(1.0, multiply(a[0], b[0]), multiply(a[1], b[2])),
        add_scaled(1.0, multiply(a[0], b[1]), multiply(a[1], b[3])),
        add_scaled(1.0, multiply(a[2], b[0]), multiply(a[3], b[2])),
        add_scaled(1.0, multiply(a[2], b[1]), multiply(a[3], b[3])),
    )


@formula
def minus_nodes(a, b):
    """Difference a - b of two node blocks."""
    return subtract(a[0], b[0]), subtract(a[1], b[1]), subtract(a[2], b[2]), subtract(a[3], b[3])


@formula
def apply_node(a, x):
    """Product of a block and the two vectors of a node."""
    return (
        add_scaled(1.0, apply(a[0], x[0]), apply(a[1], x[1])),
        add_scaled(1.0, apply(a[2], x[0]), apply(a[3], x[1])),
    )


@formula
def load_pair(array, like):
    """Two vectors of a node from an array (2, dim)."""
    return load(array[0], like), load(array[1], like)


@formula
def store_pair(pair, array):
    """Write the two vectors of a node to an array (2, dim)."""
    store(pair[0], array[0])
    store(pair[1], array[1])


@formula
def subtract_pair(a, b):
    """Difference a - b of two pairs of vectors."""
    return subtract(a[0], b[0]), subtract(a[1], b[1])


@formula
def factor_node(block):
    """Schur factors of a node block, and 0, or nan for a singular block."""
    a, b, c, d = block
    det = determinant(a)
    inverse = adjugate(1.0 / det, a)
    a_b, c_a = multiply(inverse, b), multiply(c, inverse)
    schur = subtract(d, multiply(c, a_b))
    det_of_schur = determinant(schur)
    missing = 0.0 * (det + 1.0 / det) + 0.0 * (det_of_schur + 1.0 / det_of_schur)
    return (inverse, a_b, c_a, adjugate(1.0 / det_of_schur, schur)), missing


@formula
def solve_pair(factors, x):
    """Solve a factored node block for a right side `x` of two vectors."""
    inverse, a_b, c_a, schur_inverse = factors
    last = apply(schur_inverse, subtract(x[1], apply(c_a, x[0])))
    return subtract(apply(inverse, x[0]), apply(a_b, last)), last


@formula
def solve_node(factors, block):
    """Solve a factored node block for a right side of another block."""
    inverse, a_b, c_a, schur_inverse = factors
    last = tuple(multiply(schur_inverse, subtract(block[2 + j], multiply(c_a, block[j]))) for j in range(2))
    first = tuple(subtract(multiply(inverse, block[j]), multiply(a_b, last[j])) for j in range(2))
    return (*first, *last)


@formula
def invert_node(block):
    """Inverse of a node block by the Schur complement of its first matrix, and 0, or nan for a singular block."""
    a, b, c, d = block
    det = determinant(a)
    inverse = adjugate(1.0 / det, a)
    a_b, c_a = multiply(inverse, b), multiply(c, inverse)
    schur = subtract(d, multiply(c, a_b))
    det_of_schur = determinant(schur)
    last = adjugate(1.0 / det_of_schur, schur)
    upper_right = multiply(a_b, last)
    lower_left = scale(-1.0, multiply(last, c_a))
    missing = 0.0 * (det + 1.0 / det) + 0.0 * (det_of_schur + 1.0 / det_of_schur)
    return (subtract(inverse, multiply(a_b, lower_left)), scale(-1.0, upper_right), lower_left, last), missing
