"""Block elimination of a coupled rope outside its couplings: from both ends inwards, without fill.

Nodes before the first coupling of a rope and after its last one feel their neighbours alone. They are eliminated as in
`block_tridiagonal`, one of either end beside each other in a register. What is left, from the first coupled node to the
last one, is for the front of `elimination`.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.traced import beside, first_of, formula, second_of
from cable_twin.mechanics.language.vectors import outer
from cable_twin.mechanics.solution.block_tridiagonal import (
    apply_node,
    factor_node,
    less_neighbour,
    load_node,
    load_pair,
    minus_nodes,
    multiply_nodes,
    solve_node,
    solve_pair,
    store_node,
    store_pair,
    subtract_pair,
)


@kernel
def eliminate_ends(work, wheel_columns, count, first, kept_to, like):
    """Eliminate all nodes before node `first` and after node `kept_to` of a rope; with `count` columns of its nodes.

    Args:
        work: of the rope; couplings of what is eliminated become factors.
        wheel_columns: (nodes, slots, 2, dim²).
        count: how many of the slots.
        first: node that is kept.
        kept_to: the same, or one after it.
        like: any vector of the space.

    Returns:
        False when a block has no inverse.
    """
    end = work.diagonal.shape[0] - 1
    pairs = min(first, end - kept_to)
    if first == kept_to:
        pairs -= 1  # the last ones of both ends have the same neighbour
    for node in range(pairs):
        if not eliminate_pair(work, wheel_columns, count, node, end - node, like):
            return False
    for node in range(max(pairs, 0), first):
        if not eliminate_one(work, wheel_columns, count, node, node + 1, like):
            return False
    for node in range(end - max(pairs, 0), kept_to, -1):
        if not eliminate_one(work, wheel_columns, count, node, node - 1, like):
            return False
    return True


@kernel
def substitute_ends(work, wheel_columns, count, first, kept_to, like):
    """Back substitution of what `eliminate_ends` eliminated; takes its arguments."""
    square = outer(0.0, like, like)
    for node in range(first - 1, -1, -1):
        factor = load_node(work.upper[node], square)
        less_neighbour(factor, work.right_side[node + 1], work.right_side[node], like)
        for b in range(count):
            less_neighbour(factor, wheel_columns[node + 1, b], wheel_columns[node, b], square)
    for node in range(kept_to + 1, work.diagonal.shape[0]):
        factor = load_node(work.lower[node - 1], square)
        less_neighbour(factor, work.right_side[node - 1], work.right_side[node], like)
        for b in range(count):
            less_neighbour(factor, wheel_columns[node - 1, b], wheel_columns[node, b], square)


@formula
def eliminated(block, right, out, back, neighbour, rest):
    """Eliminate a node coupled by `out` and `back` to its neighbour, whose block is `neighbour`, right side `rest`.

    Returns:
        Factors of the node's block, and 0, or nan for a singular one; solution less the share of the neighbour; that
        share, a block; block and right side of the neighbour.
    """
    factors, missing = factor_node(block)
    known, share = solve_pair(factors, right), solve_node(factors, out)
    neighbour = minus_nodes(neighbour, multiply_nodes(back, share))
    return factors, missing, known, share, neighbour, subtract_pair(rest, apply_node(back, known))


@kernel
def eliminate_one(work, wheel_columns, count, node, inner, like):
    """Eliminate a node from the equations of its neighbour `inner`; returns False when its block has no inverse."""
    square = outer(0.0, like, like)
    out, back = (work.upper[node], work.lower[node]) if inner > node else (work.lower[inner], work.upper[inner])
    coupling = load_node(back, square)
    factors, missing, known, share, neighbour, rest = eliminated(
        load_node(work.diagonal[node], square),
        load_pair(work.right_side[node], like),
        load_node(out, square),
        coupling,
        load_node(work.diagonal[inner], square),
        load_pair(work.right_side[inner], like),
    )
    if missing != 0.0:
        return False
    store_pair(known, work.right_side[node])
    store_node(share, out)
    store_node(neighbour, work.diagonal[inner])
    store_pair(rest, work.right_side[inner])
    for b in range(count):
        column = solve_pair(factors, load_pair(wheel_columns[node, b], square))
        store_pair(column, wheel_columns[node, b])
        less_neighbour(coupling, wheel_columns[node, b], wheel_columns[inner, b], square)
    return True


@kernel
def eliminate_pair(work, wheel_columns, count, node, opposite, like):
    """Eliminate a node from the equations of the next one, and `opposite` from those of another one, before it.

    Returns:
        False when a block has no inverse.
    """
    square, after, before = outer(0.0, like, like), node + 1, opposite - 1
    coupling = beside(load_node(work.lower[node], square), load_node(work.upper[before], square))
    factors, missing, known, share, neighbour, rest = eliminated(
        beside(load_node(work.diagonal[node], square), load_node(work.diagonal[opposite], square)),
        beside(load_pair(work.right_side[node], like), load_pair(work.right_side[opposite], like)),
        beside(load_node(work.upper[node], square), load_node(work.lower[before], square)),
        coupling,
        beside(load_node(work.diagonal[after], square), load_node(work.diagonal[before], square)),
        beside(load_pair(work.right_side[after], like), load_pair(work.right_side[before], like)),
    )
    if first_of(missing) + second_of(missing) != 0.0:
        return False
    store_pair(first_of(known), work.right_side[node])
    store_pair(second_of(known), work.right_side[opposite])
    store_node(first_of(share), work.upper[node])
    store_node(second_of(share), work.lower[before])
    store_node(first_of(neighbour), work.diagonal[after])
    store_node(second_of(neighbour), work.diagonal[before])
    store_pair(first_of(rest), work.right_side[after])
    store_pair(second_of(rest), work.right_side[before])
    for b in range(count):
        column = beside(load_pair(wheel_columns[node, b], square), load_pair(wheel_columns[opposite, b], square))
        column = solve_pair(factors, column)
        store_pair(first_of(column), wheel_columns[node, b])
        store_pair(second_of(column), wheel_columns[opposite, b])
        less_neighbour(load_node(work.lower[node], square), wheel_columns[node, b], wheel_columns[after, b], square)
        less_neighbour(
            load_node(work.upper[before], square), wheel_columns[opposite, b], wheel_columns[before, b], square
        )
    return True
