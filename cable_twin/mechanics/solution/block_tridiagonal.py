"""The linear solver: block elimination along the cable, O(nodes), no fill.

A node has two unknown vectors, r and r_x, so its block is 2 x 2 matrices of the working space. Those are inverted in
closed form: the position by its own matrix, the slope by the Schur complement.
"""

from __future__ import annotations

from math import isfinite

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import (
    adjugate,
    apply,
    determinant,
    load,
    multiply,
    outer,
    store,
    subtract,
)


@kernel
def solve_block_tridiagonal(diagonal, upper, lower, right_side, like):
    """Solve in place; `right_side` becomes the solution and `upper` its factor.

    Args:
        diagonal: (nodes, 2, 2, dim²), matrices row by row.
        upper: (nodes - 1, 2, 2, dim²), row block k, column block k + 1.
        lower: (nodes - 1, 2, 2, dim²), row block k + 1, column block k.
        right_side: (nodes, 2, dim).
        like: any vector of the space; its length fixes `dim` at compile time.

    Returns:
        -1, or the number of the first node whose block has no inverse.
    """
    nodes = diagonal.shape[0]
    square = outer(0.0, like, like)
    for k in range(nodes):
        a, b = load(diagonal[k, 0, 0], square), load(diagonal[k, 0, 1], square)
        c, d = load(diagonal[k, 1, 0], square), load(diagonal[k, 1, 1], square)
        p, q = load(right_side[k, 0], like), load(right_side[k, 1], like)
        if k > 0:
            l_a, l_b = load(lower[k - 1, 0, 0], square), load(lower[k - 1, 0, 1], square)
            l_c, l_d = load(lower[k - 1, 1, 0], square), load(lower[k - 1, 1, 1], square)
            u_a, u_b = load(upper[k - 1, 0, 0], square), load(upper[k - 1, 0, 1], square)
            u_c, u_d = load(upper[k - 1, 1, 0], square), load(upper[k - 1, 1, 1], square)
            x, y = load(right_side[k - 1, 0], like), load(right_side[k - 1, 1], like)
            a = subtract(subtract(a, multiply(l_a, u_a)), multiply(l_b, u_c))
            b = subtract(subtract(b, multiply(l_a, u_b)), multiply(l_b, u_d))
            c = subtract(subtract(c, multiply(l_c, u_a)), multiply(l_d, u_c))
            d = subtract(subtract(d, multiply(l_c, u_b)), multiply(l_d, u_d))
            p = subtract(subtract(p, apply(l_a, x)), apply(l_b, y))
            q = subtract(subtract(q, apply(l_c, x)), apply(l_d, y))
        det = determinant(a)
        if det == 0.0 or not isfinite(det):
            return k
        a_inverse = adjugate(1.0 / det, a)
        a_b = multiply(a_inverse, b)
        c_a = multiply(c, a_inverse)
        schur = subtract(d, multiply(c, a_b))
        det = determinant(schur)
        if det == 0.0 or not isfinite(det):
            return k
        schur_inverse = adjugate(1.0 / det, schur)
        y = apply(schur_inverse, subtract(q, apply(c_a, p)))
        store(subtract(apply(a_inverse, p), apply(a_b, y)), right_side[k, 0])
        store(y, right_side[k, 1])
        if k < nodes - 1:
            for j in range(2):
                top, bottom = load(upper[k, 0, j], square), load(upper[k, 1, j], square)
                slope = multiply(schur_inverse, subtract(bottom, multiply(c_a, top)))
                store(subtract(multiply(a_inverse, top), multiply(a_b, slope)), upper[k, 0, j])
                store(slope, upper[k, 1, j])
    for k in range(nodes - 2, -1, -1):
        x, y = load(right_side[k + 1, 0], like), load(right_side[k + 1, 1], like)
        for i in range(2):
            total = subtract(load(right_side[k, i], like), apply(load(upper[k, i, 0], square), x))
            store(subtract(total, apply(load(upper[k, i, 1], square), y)), right_side[k, i])
    return -1
