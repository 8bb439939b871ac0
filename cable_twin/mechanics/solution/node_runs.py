"""Elimination of runs of uncoupled nodes of one rope, between nodes that are coupled to another rope.

A run leaves a coupling of the nodes before and after it, and contributions to their equations. Four runs are side by
side in one SIMD register. Where there are fewer, the last run is repeated: each number is read for all four runs before
it is written, so that writing it twice does no harm.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.language.simd import read_beside, sum_of_lanes, write_beside
from cable_twin.mechanics.language.traced import formula, together
from cable_twin.mechanics.language.vectors import load, outer, scale
from cable_twin.mechanics.solution.block_tridiagonal import (
    add_parts,
    factor_node,
    less_nodes,
    less_pair,
    load_node,
    load_pair,
    no_node,
    solve_node,
    solve_pair,
    store_node,
    store_pair,
    substitute_one,
    subtract_node,
    without,
)


@inlined_kernel
def eliminate_run(diagonal, upper, lower, right_side, columns, count, before, after, done, like):
    """Eliminate the nodes of a run between two kept nodes, `before` and `after`, all but the first `done` ones.

    The couplings of both come to `upper[before]` and `lower[after - 1]`. Takes the other arguments of `solve_columns`.

    Returns:
        -1, or the number of a node whose block has no inverse.
    """
    square = outer(0.0, like, like)
    for node in range(before + 1 + done, after):
        factors, missing = factor_node(load_node(diagonal[node], square))
        if missing != 0.0:
            return node
        known = solve_pair(factors, load_pair(right_side[node], like))
        left = solve_node(factors, load_node(lower[node - 1], square))
        factor = solve_node(factors, load_node(upper[node], square))
        for b in range(count):
            store_pair(solve_pair(factors, load_pair(columns[node, b], square)), columns[node, b])
        store_pair(known, right_side[node])
        store_node(left, lower[node - 1])
        store_node(factor, upper[node])
        on, out = load_node(lower[node], square), load_node(upper[before], square)
        subtract_node(diagonal, right_side, columns, count, node, before, out, left, known, like)
        subtract_node(diagonal, right_side, columns, count, node, node + 1, on, factor, known, like)
        store_node(less_nodes(no_node(like), on, left), lower[node])
        store_node(less_nodes(no_node(like), out, factor), upper[before])
    return -1


@inlined_kernel
def eliminate_four_runs(diagonal, upper, lower, right_side, columns, count, runs, number, like):
    """Eliminate four runs of nodes side by side in SIMD lanes, up to the shortest length; then the rest of each.

    `runs` (4, 2) are the nodes before and after each; those from `number` on repeat others. Other arguments and result
    as of `eliminate_run`.
    """
    square, zero = outer(0.0, like, like), (scale(0.0, like), scale(0.0, like))
    at, shorter = shortest_of(runs, number)
    no_nodes, nothing = four_times(no_node(like)), four_times(zero)
    left, out = load_nodes(four(lower, at, 0), square), load_nodes(four(upper, at, 0), square)
    factor, coupling, on_kept, known, right_of_kept = no_nodes, no_nodes, no_nodes, nothing, nothing
    for k in range(1, shorter + 1):
        block, right = load_nodes(four(diagonal, at, k), square), load_pairs(four(right_side, at, k), like)
        if k > 1:
            block, right = without(block, right, coupling, factor, known)
            left = less_nodes(no_nodes, coupling, left)
            out = less_nodes(no_nodes, out, factor)
        factors, missing = factor_node(block)
        if sum_of_lanes(missing) != 0.0:
            return at[0] + k
        known, left = solve_pair(factors, right), solve_node(factors, left)
        on_kept, right_of_kept = without(on_kept, right_of_kept, out, left, known)
        factor = solve_node(factors, load_nodes(four(upper, at, k), square))
        coupling = load_nodes(four(lower, at, k), square)
        for b in range(count):
            column = solve_pair(factors, load_pairs(four_columns(columns, at, k, b), square))
            store_pairs(column, four_columns(columns, at, k, b))
            subtract_columns(coupling, column, four_columns(columns, at, k + 1, b), square)
            subtract_columns(out, column, four_columns(columns, at, 0, b), square)
        store_pairs(known, four(right_side, at, k))
        store_nodes(left, four(lower, at, k - 1))
        store_nodes(factor, four(upper, at, k))
    if shorter > 0:  # into the node after them, then into the kept one before
        here, there = four(diagonal, at, shorter + 1), four(right_side, at, shorter + 1)
        block, right = without(load_nodes(here, square), load_pairs(there, like), coupling, factor, known)
        store_nodes(block, here)
        store_pairs(right, there)
        here, there = four(diagonal, at, 0), four(right_side, at, 0)
        store_nodes(add_parts(load_nodes(here, square), on_kept), here)
        store_pairs(add_parts(load_pairs(there, like), right_of_kept), there)
        store_nodes(less_nodes(no_nodes, coupling, left), four(lower, at, shorter))
        store_nodes(less_nodes(no_nodes, out, factor), four(upper, at, 0))
    for run in range(number):
        before, after = runs[run, 0], runs[run, 1]
        stopped = eliminate_run(diagonal, upper, lower, right_side, columns, count, before, after, shorter, like)
        if stopped >= 0:
            return stopped
    return -1


@inlined_kernel
def subtract_columns(coupling, column, others, square):
    """Subtract four node blocks times their nodes' columns from the columns of four other nodes, in SIMD lanes."""
    store_pairs(less_pair(load_pairs(others, square), coupling, column), others)


@inlined_kernel
def shortest_of(runs, number):
    """Nodes before each of four runs, and the number of nodes in the shortest; 0 for a single run, best by itself."""
    shortest = runs[0, 1] - runs[0, 0] if number > 1 else 1
    for run in range(1, number):
        shortest = min(shortest, runs[run, 1] - runs[run, 0])
    return (runs[0, 0], runs[1, 0], runs[2, 0], runs[3, 0]), shortest - 1


@inlined_kernel
def four(array, at, k):
    """Four entries of an array, `k` after each of four indices."""
    return array[at[0] + k], array[at[1] + k], array[at[2] + k], array[at[3] + k]


@inlined_kernel
def four_columns(columns, at, k, b):
    """Column block `b` of four nodes, `k` after each of four node indices, from `columns` (nodes, blocks, 2, dim²)."""
    return columns[at[0] + k, b], columns[at[1] + k, b], columns[at[2] + k, b], columns[at[3] + k, b]


@formula
def four_times(one):
    """Repeat each number of a tuple in four SIMD lanes."""
    return together([one, one, one, one])


@formula
def load_nodes(arrays, square):
    """Load the blocks of several nodes, a SIMD lane each, see `load_node`."""
    count = len(square.entries)
    numbers = read_beside(arrays, (2, 2, count))
    return tuple(load(numbers[k * count : (k + 1) * count], square) for k in range(4))


@formula
def load_pairs(arrays, like):
    """Load the vectors or matrices of several nodes, a SIMD lane each, see `load_pair`."""
    count = len(like.entries)
    numbers = read_beside(arrays, (2, count))
    return load(numbers[:count], like), load(numbers[count:], like)


@formula
def store_nodes(blocks, arrays):
    """Write the blocks of several nodes, a SIMD lane each, to their arrays."""
    write_beside([one for matrix in blocks for one in matrix.entries], arrays, (2, 2, len(blocks[0].entries)))


@formula
def store_pairs(pairs, arrays):
    """Write SIMD lanes as loaded by `load_pairs` to the arrays of the nodes."""
    write_beside([one for part in pairs for one in part.entries], arrays, (2, len(pairs[0].entries)))


@inlined_kernel
def substitute_four_runs(upper, lower, right_side, columns, count, runs, number, like):
    """Back-substitute four runs of nodes side by side, as eliminated by `eliminate_four_runs`."""
    square = outer(0.0, like, like)
    at, shorter = shortest_of(runs, number)
    for run in range(number):
        substitute_run(upper, lower, right_side, columns, count, runs[run, 0], runs[run, 1], shorter, like)
    kept = load_pairs(four(right_side, at, 0), like)
    known = load_pairs(four(right_side, at, shorter + 1), like)
    for k in range(shorter, 0, -1):
        factor, left = load_nodes(four(upper, at, k), square), load_nodes(four(lower, at, k - 1), square)
        known = less_pair(load_pairs(four(right_side, at, k), like), factor, known)
        known = less_pair(known, left, kept)
        store_pairs(known, four(right_side, at, k))
        for b in range(count):
            after = load_pairs(four_columns(columns, at, k + 1, b), square)
            column = load_pairs(four_columns(columns, at, k, b), square)
            column = less_pair(column, factor, after)
            before = load_pairs(four_columns(columns, at, 0, b), square)
            store_pairs(less_pair(column, left, before), four_columns(columns, at, k, b))


@inlined_kernel
def substitute_run(upper, lower, right_side, columns, count, before, after, done, like):
    """Back-substitute a run of nodes between two solved ones, `before` and `after`, all but the first `done`."""
    for node in range(after - 1, before + done, -1):
        substitute_one(right_side, columns, count, node, node + 1, upper[node], like)
        substitute_one(right_side, columns, count, node, before, lower[node - 1], like)
