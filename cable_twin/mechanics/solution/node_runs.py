"""Elimination of runs of uncoupled nodes of a rope, between nodes that are coupled to another rope.

A run leaves a coupling of the nodes before and after it, and contributions to their equations. Four runs, of one rope
or several, are side by side in one SIMD register. Where there are fewer, the last run is repeated: each number is read
for all four runs before it is written, so that writing it twice does no harm. What back substitution needs of them
stays in SIMD lanes.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.language.simd import WIDTH, read_beside, sum_of_lanes, together, write_beside
from cable_twin.mechanics.language.traced import formula, read_lanes, write_lanes
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
    """Eliminate a run of nodes, after its first `done` ones, between the nodes `before` and `after`, which remain.

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
def eliminate_four_runs(rooms, columns, count, runs, number, run_factors, like):
    """Eliminate four runs of nodes side by side in SIMD lanes, up to the length of the shortest.

    Args:
        rooms: workspace of the rope of each.
        columns: as in `solve_columns`, of the nodes of all ropes.
        count: how many blocks of them.
        runs: (4, 3), nodes before and after each run, and that before it among the nodes of all ropes; from `number`
            on they repeat others.
        number: of different runs.
        run_factors: (nodes, 32 dim²), takes what back substitution needs of nodes side by side.
        like: any vector of the space.

    Returns:
        How many nodes of each run, or -1 when a block has no inverse.
    """
    square, (at, of_all, shortest) = outer(0.0, like, like), four_of(runs, number)
    diagonals, uppers, lowers, right_sides = matrices_of(rooms)
    nothing, no_vectors = four_times(no_node(like)), four_times((scale(0.0, like), scale(0.0, like)))
    on_kept, right_of_kept, missing = nothing, no_vectors, 0.0
    left, out = load_nodes(lowers, at, 0, square), load_nodes(uppers, at, 0, square)
    block, right = load_nodes(diagonals, at, 1, square), load_pairs(right_sides, at, 1, like)
    for k in range(1, shortest + 1):
        factors, without_inverse = factor_node(block)
        missing += sum_of_lanes(without_inverse)
        factor, coupling = solve_node(factors, load_nodes(uppers, at, k, square)), load_nodes(lowers, at, k, square)
        known, left = solve_pair(factors, right), solve_node(factors, left)
        block, right = load_nodes(diagonals, at, k + 1, square), load_pairs(right_sides, at, k + 1, like)
        block, right = without(block, right, coupling, factor, known)
        on_kept, right_of_kept = without(on_kept, right_of_kept, out, left, known)
        for b in range(count):
            column = solve_pair(factors, load_columns(columns, of_all, k, b, square))
            store_columns(column, columns, of_all, k, b)
            subtract_columns(coupling, column, columns, of_all, k + 1, b, square)
            subtract_columns(out, column, columns, of_all, 0, b, square)
        store_pairs(known, right_sides, at, k)
        store_lanes(left, run_factors[k - 1], 0)
        store_lanes(factor, run_factors[k - 1], 1)
        left, out = less_nodes(nothing, coupling, left), less_nodes(nothing, out, factor)
    if missing != 0.0:
        return -1
    if shortest > 0:  # into the node after them, then into the kept one before
        store_nodes(block, diagonals, at, shortest + 1)
        store_pairs(right, right_sides, at, shortest + 1)
        store_nodes(add_parts(load_nodes(diagonals, at, 0, square), on_kept), diagonals, at, 0)
        store_pairs(add_parts(load_pairs(right_sides, at, 0, like), right_of_kept), right_sides, at, 0)
        store_nodes(left, lowers, at, shortest)
        store_nodes(out, uppers, at, 0)
    return shortest


@inlined_kernel
def subtract_columns(coupling, column, columns, at, k, b, square):
    """Subtract four node blocks times their nodes' columns from the columns of four other nodes, in SIMD lanes."""
    store_columns(less_pair(load_columns(columns, at, k, b, square), coupling, column), columns, at, k, b)


@inlined_kernel
def four_of(runs, number):
    """Index of the node before each of four runs, in its rope and in all ropes, and node count of the shortest run.

    That number is 0 for a single run, which is best eliminated by itself.
    """
    shortest = runs[0, 1] - runs[0, 0] if number > 1 else 1
    for run in range(1, number):
        shortest = min(shortest, runs[run, 1] - runs[run, 0])
    before, of_all = runs[:, 0], runs[:, 2]
    at = before[0], before[1], before[2], before[3]
    return at, (of_all[0], of_all[1], of_all[2], of_all[3]), shortest - 1


@inlined_kernel
def matrices_of(rooms):
    """Diagonal, upper and lower blocks and right sides of four workspaces."""
    a, b, c, d = rooms
    return (
        (a.diagonal, b.diagonal, c.diagonal, d.diagonal),
        (a.upper, b.upper, c.upper, d.upper),
        (a.lower, b.lower, c.lower, d.lower),
        (a.right_side, b.right_side, c.right_side, d.right_side),
    )


@formula
def four_times(one):
    """Repeat each number of a tuple in four SIMD lanes."""
    return together([one, one, one, one])


@formula
def load_nodes(arrays, at, k, square):
    """Load the blocks of the nodes `k` places after four given nodes, one node per SIMD lane."""
    count = len(square.entries)
    numbers = read_beside(entries_of(arrays, at, k), 4 * count)
    return tuple(load(numbers, square, k * count) for k in range(4))


@formula
def store_nodes(blocks, arrays, at, k):
    """Write the blocks of the nodes `k` places after four given nodes, from one SIMD lane per node."""
    write_beside([one for matrix in blocks for one in matrix.entries], entries_of(arrays, at, k))


@formula
def load_pairs(arrays, at, k, like):
    """Load the vector pairs of the nodes `k` places after four given nodes, one node per SIMD lane."""
    return pair_of(read_beside(entries_of(arrays, at, k), 2 * len(like.entries)), like)


@formula
def store_pairs(pair, arrays, at, k):
    """Write the vector pairs of the nodes `k` places after four given nodes, from one SIMD lane per node."""
    write_beside([one for part in pair for one in part.entries], entries_of(arrays, at, k))


@formula
def load_columns(columns, at, k, b, square):
    """Load column block `b` of the nodes `k` places after four given nodes, one node per SIMD lane."""
    return pair_of(read_beside([columns[one + k, b] for one in at], 2 * len(square.entries)), square)


@formula
def store_columns(pair, columns, at, k, b):
    """Write column block `b` of the nodes `k` places after four given nodes, from one SIMD lane per node."""
    write_beside([one for part in pair for one in part.entries], [columns[one + k, b] for one in at])


def entries_of(arrays, at, k):
    """Entries of four arrays, each `k` places after an index of its own; for traced formulas."""
    return [array[one + k] for array, one in zip(arrays, at, strict=True)]


def pair_of(numbers, like):
    """Two vectors or matrices of the shape of `like`, read from a list of numbers; for traced formulas."""
    return load(numbers, like), load(numbers, like, len(like.entries))


@formula
def store_lanes(blocks, row, first):
    """Write four node blocks, one per SIMD lane, to a flat array in lane order, from its block number `first` on."""
    numbers = [one for matrix in blocks for one in matrix.entries]
    for k, one in enumerate(numbers):
        write_lanes(one, row, (WIDTH * (first * len(numbers) + k),))


@formula
def load_lanes(row, first, square):
    """Read four node blocks, a SIMD lane each, that `store_lanes` has written into a row of numbers."""
    count = len(square.entries)
    numbers = [read_lanes(row, (WIDTH * (4 * first * count + k),), WIDTH) for k in range(4 * count)]
    return tuple(load(numbers, square, k * count) for k in range(4))


@inlined_kernel
def substitute_four_runs(rooms, columns, count, runs, number, run_factors, like):
    """Back-substitute four runs of nodes that `eliminate_four_runs` has eliminated; returns the node count of each."""
    square, (at, of_all, shortest) = outer(0.0, like, like), four_of(runs, number)
    _, _, _, right_sides = matrices_of(rooms)
    first, known = load_pairs(right_sides, at, 0, like), load_pairs(right_sides, at, shortest + 1, like)
    for k in range(shortest, 0, -1):
        left, factor = load_lanes(run_factors[k - 1], 0, square), load_lanes(run_factors[k - 1], 1, square)
        known = less_pair(load_pairs(right_sides, at, k, like), factor, known)
        known = less_pair(known, left, first)
        store_pairs(known, right_sides, at, k)
        for b in range(count):
            after, before = load_columns(columns, of_all, k + 1, b, square), load_columns(columns, of_all, 0, b, square)
            column = less_pair(load_columns(columns, of_all, k, b, square), factor, after)
            store_columns(less_pair(column, left, before), columns, of_all, k, b)
    return shortest


@inlined_kernel
def substitute_run(upper, lower, right_side, columns, count, before, after, done, like):
    """Back-substitute a run of nodes, after its first `done` ones, between the solved nodes `before` and `after`."""
    for node in range(after - 1, before + done, -1):
        substitute_one(right_side, columns, count, node, node + 1, upper[node], like)
        substitute_one(right_side, columns, count, node, before, lower[node - 1], like)
