"""Linear solver of one rope: block elimination along the cable, O(nodes), without fill.

Elimination goes from both ends to the middle, or to the first and last node that is coupled to other ropes. The nodes
of both sides, which do not depend on each other, are side by side in one SIMD register.

A node has two unknown vectors, r and r_x, so its block is a tuple of four matrices of the working space.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import beside, first_of, second_of
from cable_twin.mechanics.language.traced import Mat, Vec, formula, row_of
from cable_twin.mechanics.language.vectors import (
    adjugate,
    determinant,
    less_product,
    load,
    outer,
    product,
    store,
)


@formula
def no_node(like):
    """Zero node block: four matrices (dim, dim), by position and slope of a node."""
    zero = Mat(Vec(0.0 for _ in like) for _ in like)
    return zero, zero, zero, zero


@formula
def load_node(array, square):
    """Load a node block from an array (2, 2, dim²)."""
    numbers, count = row_of(array), len(square.entries)
    return tuple(load(numbers, square, k * count) for k in range(4))


@formula
def store_node(matrices, array):
    """Write a node block to an array (2, 2, dim²)."""
    numbers, count = row_of(array), len(matrices[0].entries)
    for k, matrix in enumerate(matrices):
        store(matrix, numbers, k * count)


@formula
def less_nodes(c, a, b):
    """Difference c - a b of three node blocks."""
    return (
        less_product(less_product(c[0], a[0], b[0]), a[1], b[2]),
        less_product(less_product(c[1], a[0], b[1]), a[1], b[3]),
        less_product(less_product(c[2], a[2], b[0]), a[3], b[2]),
        less_product(less_product(c[3], a[2], b[1]), a[3], b[3]),
    )


@formula
def add_parts(a, b):
    """Sum a + b of two node blocks, or of two pairs of node vectors."""
    return tuple(one + other for one, other in zip(a, b, strict=True))


@formula
def less_pair(c, a, x):
    """Difference c - a x of two pairs of node vectors, with a node block `a`."""
    return (
        less_product(less_product(c[0], a[0], x[0]), a[1], x[1]),
        less_product(less_product(c[1], a[2], x[0]), a[3], x[1]),
    )


@formula
def load_pair(array, like):
    """Position and slope vector of a node from an array (2, dim), or two matrices (2, dim²) if `like` is a matrix."""
    numbers = row_of(array)
    return load(numbers, like), load(numbers, like, len(like.entries))


@formula
def store_pair(pair, array):
    """Write the two vectors of a node to an array (2, dim)."""
    numbers = row_of(array)
    store(pair[0], numbers)
    store(pair[1], numbers, len(pair[0].entries))


@formula
def load_both(one, other, like):
    """Load the vector or matrix pairs of two nodes, one node per SIMD lane, see `load_pair`."""
    return beside(load_pair(one, like), load_pair(other, like))


@formula
def store_both(both, one, other):
    """Write the vector or matrix pairs of two nodes, one node per SIMD lane, to the arrays of the two nodes."""
    store_pair(first_of(both), one)
    store_pair(second_of(both), other)


@formula
def factor_node(block):
    """Schur factors of a node block, for `solve_pair` and `solve_node`, and a number: 0, or nan if singular."""
    a, b, c, d = block
    det = determinant(a)
    inverse = adjugate(1.0 / det, a)
    a_b, c_a = product(inverse, b), product(c, inverse)
    schur = less_product(d, c, a_b)
    det_of_schur = determinant(schur)
    missing = 0.0 * (det + 1.0 / det) + 0.0 * (det_of_schur + 1.0 / det_of_schur)
    return (inverse, a_b, c_a, adjugate(1.0 / det_of_schur, schur)), missing


@formula
def solve_pair(factors, x):
    """Solve a factored node block for a right side `x` of two vectors of the node."""
    inverse, a_b, c_a, schur_inverse = factors
    last = product(schur_inverse, less_product(x[1], c_a, x[0]))
    return less_product(product(inverse, x[0]), a_b, last), last


@formula
def solve_node(factors, block):
    """Solve a factored node block for a right side that is another node block."""
    inverse, a_b, c_a, schur_inverse = factors
    last = tuple(product(schur_inverse, less_product(block[2 + j], c_a, block[j])) for j in range(2))
    first = tuple(less_product(product(inverse, block[j]), a_b, last[j]) for j in range(2))
    return (*first, *last)


@kernel
def solve_block_tridiagonal(diagonal, upper, lower, right_side, like):
    """Solve the equations of a rope in place; `right_side` becomes the solution, see `solve_columns`."""
    return solve_columns(diagonal, upper, lower, right_side, upper, 0, like)


@inlined_kernel
def solve_columns(diagonal, upper, lower, right_side, columns, count, like):
    """Solve the equations of a rope in place, for `right_side` and further columns, which become the solutions.

    `upper` and `lower` become factors in part.

    Args:
        diagonal: (nodes, 2, 2, dim²), matrices row by row.
        upper: (nodes - 1, 2, 2, dim²), row block k, column block k + 1.
        lower: (nodes - 1, 2, 2, dim²), row block k + 1, column block k.
        right_side: (nodes, 2, dim).
        columns: (nodes, blocks, 2, dim²), blocks of `dim` further right sides each, a matrix a vector of the node.
        count: how many of the blocks.
        like: any vector of the space; its length fixes `dim` at compile time.

    Returns:
        -1, or the number of a node whose block has no inverse.
    """
    middle, square = diagonal.shape[0] // 2, outer(0.0, like, like)
    stopped = eliminate_ends(diagonal, upper, lower, right_side, columns, count, middle, middle, like)
    if stopped >= 0:
        return stopped
    factors, missing = factor_node(load_node(diagonal[middle], square))
    if missing != 0.0:
        return middle
    store_pair(solve_pair(factors, load_pair(right_side[middle], like)), right_side[middle])
    for b in range(count):
        store_pair(solve_pair(factors, load_pair(columns[middle, b], square)), columns[middle, b])
    substitute_ends(upper, lower, right_side, columns, count, middle, middle, like)
    return -1


@inlined_kernel
def eliminate_ends(diagonal, upper, lower, right_side, columns, count, first, kept_to, like):
    """Eliminate all nodes of a rope before node `first` and after node `kept_to`, which may be the same one.

    Takes the other arguments of `solve_columns` and returns the same number; couplings become factors.
    """
    last, square = diagonal.shape[0] - 1, outer(0.0, like, like)
    pairs = min(first, last - kept_to)
    factor = beside(no_node(like), no_node(like))
    known = beside((like, like), (like, like))
    coupling = factor
    for k in range(pairs):
        back = last - k
        block = beside(load_node(diagonal[k], square), load_node(diagonal[back], square))
        right = load_both(right_side[k], right_side[back], like)
        if k > 0:
            coupling = beside(load_node(lower[k - 1], square), load_node(upper[back], square))
            block, right = without(block, right, coupling, factor, known)
        factors, missing = factor_node(block)
        if first_of(missing) + second_of(missing) != 0.0:
            return k if first_of(missing) != 0.0 else back
        known = solve_pair(factors, right)
        store_both(known, right_side[k], right_side[back])
        for b in range(count):
            column = load_both(columns[k, b], columns[back, b], square)
            if k > 0:
                before = load_both(columns[k - 1, b], columns[back + 1, b], square)
                column = less_pair(column, coupling, before)
            column = solve_pair(factors, column)
            store_both(column, columns[k, b], columns[back, b])
        factor = beside(load_node(upper[k], square), load_node(lower[back - 1], square))
        factor = solve_node(factors, factor)
        store_node(first_of(factor), upper[k])
        store_node(second_of(factor), lower[back - 1])
    if pairs > 0:
        into, back = pairs, last - pairs
        take_in(diagonal, right_side, columns, count, into - 1, into, lower[into - 1], upper[into - 1], like)
        take_in(diagonal, right_side, columns, count, back + 1, back, upper[back], lower[back], like)
    for node in range(pairs, first):
        if not eliminate_one(diagonal, right_side, columns, count, node, node + 1, upper[node], lower[node], like):
            return node
    for node in range(last - pairs, kept_to, -1):
        out, back_to = lower[node - 1], upper[node - 1]
        if not eliminate_one(diagonal, right_side, columns, count, node, node - 1, out, back_to, like):
            return node
    return -1


@inlined_kernel
def eliminate_one(diagonal, right_side, columns, count, node, inner, out, back, like):
    """Eliminate a node, coupled by `out` and `back` to its neighbour `inner`; False when its block has no inverse."""
    square = outer(0.0, like, like)
    factors, missing = factor_node(load_node(diagonal[node], square))
    if missing != 0.0:
        return False
    store_pair(solve_pair(factors, load_pair(right_side[node], like)), right_side[node])
    for b in range(count):
        store_pair(solve_pair(factors, load_pair(columns[node, b], square)), columns[node, b])
    store_node(solve_node(factors, load_node(out, square)), out)
    take_in(diagonal, right_side, columns, count, node, inner, back, out, like)
    return True


@inlined_kernel
def take_in(diagonal, right_side, columns, count, node, inner, coupling, factor, like):
    """Subtract an eliminated node from the equations of `inner`; it is right side - `factor` x solution of `inner`."""
    square = outer(0.0, like, like)
    on, by, known = load_node(coupling, square), load_node(factor, square), load_pair(right_side[node], like)
    subtract_node(diagonal, right_side, columns, count, node, inner, on, by, known, like)


@inlined_kernel
def subtract_node(diagonal, right_side, columns, count, node, left, coupling, factor, known, like):
    """Subtract an eliminated node from the equations of `left`; it is `known` - `factor` x solution of `left`."""
    square = outer(0.0, like, like)
    block, right = load_node(diagonal[left], square), load_pair(right_side[left], like)
    block, right = without(block, right, coupling, factor, known)
    store_node(block, diagonal[left])
    store_pair(right, right_side[left])
    for b in range(count):
        less_neighbour(coupling, columns[node, b], columns[left, b], square)


@inlined_kernel
def substitute_ends(upper, lower, right_side, columns, count, first, kept_to, like):
    """Back-substitute the nodes before `first` and after `kept_to`, which `eliminate_ends` has eliminated."""
    last, square = right_side.shape[0] - 1, outer(0.0, like, like)
    pairs = min(first, last - kept_to)
    for node in range(first - 1, pairs - 1, -1):
        substitute_one(right_side, columns, count, node, node + 1, upper[node], like)
    for node in range(kept_to + 1, last - pairs + 1):
        substitute_one(right_side, columns, count, node, node - 1, lower[node - 1], like)
    for k in range(pairs - 1, -1, -1):
        back = last - k
        factor = beside(load_node(upper[k], square), load_node(lower[back - 1], square))
        known = load_both(right_side[k + 1], right_side[back - 1], like)
        right = load_both(right_side[k], right_side[back], like)
        right = less_pair(right, factor, known)
        store_both(right, right_side[k], right_side[back])
        for b in range(count):
            after = load_both(columns[k + 1, b], columns[back - 1, b], square)
            column = load_both(columns[k, b], columns[back, b], square)
            column = less_pair(column, factor, after)
            store_both(column, columns[k, b], columns[back, b])


@inlined_kernel
def substitute_one(right_side, columns, count, node, inner, factor, like):
    """Back-substitute one node from the solution of its neighbour `inner`."""
    square = outer(0.0, like, like)
    by = load_node(factor, square)
    less_neighbour(by, right_side[inner], right_side[node], like)
    for b in range(count):
        less_neighbour(by, columns[inner, b], columns[node, b], square)


@formula
def less_neighbour(coupling, neighbour, array, like):
    """Subtract a node block times the vector or matrix pair of a neighbouring node from `array` (2, ...), in place."""
    store_pair(less_pair(load_pair(array, like), coupling, load_pair(neighbour, like)), array)


@formula
def without(block, right, coupling, factor, known):
    """Block and right side of a node after elimination of a neighbour, which is `known` - `factor` x the node."""
    return less_nodes(block, coupling, factor), less_pair(right, coupling, known)
