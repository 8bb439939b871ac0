"""Linear solver of one rope: block elimination along the cable, O(nodes), without fill.

It goes from both ends to the middle, with the nodes of either side beside each other in one register: no node waits for
those of the other side, as it does for the one before it.

A node has two unknown vectors, r and r_x, so its block is 2 x 2 matrices of the working space, `node_blocks`.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.traced import beside, first_of, formula, second_of
from cable_twin.mechanics.language.vectors import outer
from cable_twin.mechanics.solution.node_blocks import (
    apply_node,
    factor_node,
    load_node,
    load_pair,
    minus_nodes,
    multiply_nodes,
    no_node,
    solve_node,
    solve_pair,
    store_node,
    store_pair,
    subtract_pair,
)


@kernel
def solve_block_tridiagonal(diagonal, upper, lower, right_side, like):
    """Solve in place; `right_side` becomes the solution, `upper` and `lower` in part factors.

    Args:
        diagonal: (nodes, 2, 2, dim²), matrices row by row.
        upper: (nodes - 1, 2, 2, dim²), row block k, column block k + 1.
        lower: (nodes - 1, 2, 2, dim²), row block k + 1, column block k.
        right_side: (nodes, 2, dim).
        like: any vector of the space; its length fixes `dim` at compile time.

    Returns:
        -1, or the number of a node whose block has no inverse.
    """
    last, square = diagonal.shape[0] - 1, outer(0.0, like, like)
    pairs = last // 2
    factor = beside(no_node(like), no_node(like))
    known = beside((like, like), (like, like))
    for k in range(pairs):
        back = last - k
        block = beside(load_node(diagonal[k], square), load_node(diagonal[back], square))
        right = beside(load_pair(right_side[k], like), load_pair(right_side[back], like))
        if k > 0:
            coupling = beside(load_node(lower[k - 1], square), load_node(upper[back], square))
            block, right = without(block, right, coupling, factor, known)
        factors, missing = factor_node(block)
        if first_of(missing) + second_of(missing) != 0.0:
            return k if first_of(missing) != 0.0 else back
        known = solve_pair(factors, right)
        store_pair(first_of(known), right_side[k])
        store_pair(second_of(known), right_side[back])
        factor = beside(load_node(upper[k], square), load_node(lower[back - 1], square))
        factor = solve_node(factors, factor)
        store_node(first_of(factor), upper[k])
        store_node(second_of(factor), lower[back - 1])
    for k in range(pairs, last - pairs + 1):  # one node is left in the middle, or two
        block, right = load_node(diagonal[k], square), load_pair(right_side[k], like)
        if k > 0:
            coupling, factor = load_node(lower[k - 1], square), load_node(upper[k - 1], square)
            block, right = without(block, right, coupling, factor, load_pair(right_side[k - 1], like))
        if pairs > 0 and k == last - pairs:
            coupling, factor = load_node(upper[k], square), load_node(lower[k], square)
            block, right = without(block, right, coupling, factor, load_pair(right_side[k + 1], like))
        factors, missing = factor_node(block)
        if missing != 0.0:
            return k
        store_pair(solve_pair(factors, right), right_side[k])
        if k < last - pairs:
            store_node(solve_node(factors, load_node(upper[k], square)), upper[k])
    if last > 2 * pairs:
        change = apply_node(load_node(upper[pairs], square), load_pair(right_side[pairs + 1], like))
        store_pair(subtract_pair(load_pair(right_side[pairs], like), change), right_side[pairs])
    for k in range(pairs - 1, -1, -1):
        back = last - k
        factor = beside(load_node(upper[k], square), load_node(lower[back - 1], square))
        known = beside(load_pair(right_side[k + 1], like), load_pair(right_side[back - 1], like))
        right = beside(load_pair(right_side[k], like), load_pair(right_side[back], like))
        right = subtract_pair(right, apply_node(factor, known))
        store_pair(first_of(right), right_side[k])
        store_pair(second_of(right), right_side[back])
    return -1


@formula
def without(block, right, coupling, factor, known):
    """Block and right side of a node after elimination of a neighbour, solved as `known` - `factor` x this node."""
    return minus_nodes(block, multiply_nodes(coupling, factor)), subtract_pair(right, apply_node(coupling, known))
