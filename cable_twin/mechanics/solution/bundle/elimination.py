"""The linear solver of a bundle: block elimination along all ropes side by side, O(nodes), no fill but at the front.

The front is one node of each rope, the next to be eliminated. Nodes of different ropes are coupled only there: a
connector is added when both its nodes are at the front, and what an elimination leaves couples the nodes that follow.
Where nothing is linked this is `block_tridiagonal` rope by rope.
"""

from __future__ import annotations

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.vectors import accumulate, load, outer, scale
from cable_twin.mechanics.solution.bundle.node_blocks import (
    apply_node,
    invert_node,
    load_node,
    load_pair,
    minus_nodes,
    multiply_nodes,
    store_node,
    store_pair,
    subtract_pair,
)
from cable_twin.mechanics.solution.bundle.records import WORK


@kernel
def solve_bundle(bundle, scratch, work, like):
    """Solve for the nodal increments of all ropes, in their `right_side`; `upper` becomes a factor.

    Args:
        bundle: parameters.
        scratch: `BundleWork`, with `cross` of the connectors, which are in the diagonals already.
        work: Workspace of any of the ropes, for its type.
        like: any vector of the space.

    Returns:
        False when a block has no inverse.
    """
    order = bundle.order
    clear_array(scratch.fill)
    scratch.linked[:] = 0
    scratch.front[:] = 0
    connector = 0
    for number in range(order.node.size):
        while connector < order.connector_at.size and order.connector_at[connector] == number:
            link(bundle.connectors, connector, scratch, like)
            connector += 1
        rope = order.rope[number]
        if not eliminate(bundle, number, rope, order.node[number], scratch, work, like):
            return False
        scratch.front[rope] = order.node[number] + 1
    for number in range(order.node.size - 1, -1, -1):
        rope, node = order.rope[number], order.node[number]
        scratch.front[rope] = node
        substitute(bundle, number, rope, node, scratch, work, like)
    return True


@inlined_kernel
def link(connectors, connector, scratch, like):
    """Couple the front nodes of two ropes."""
    a, b = connectors.rope[connector, 0], connectors.rope[connector, 1]
    cross = load(scratch.cross[connector], outer(0.0, like, like))
    accumulate(cross, scratch.fill[a, b, 0, 0])
    accumulate(cross, scratch.fill[b, a, 0, 0])  # it is symmetric
    scratch.linked[a, b] = scratch.linked[b, a] = 1


@inlined_kernel
def eliminate(bundle, number, rope, node, scratch, work, like):
    """Take the front node of a rope out of the equations of the next one, and of the front nodes of other ropes."""
    square = outer(0.0, like, like)
    own = record_at(bundle.records[rope, WORK], work)
    inverse, found = invert_node(load_node(own.diagonal[node], square))
    if not found:
        return False
    right = apply_node(inverse, load_pair(own.right_side[node], like))
    store_pair(right, own.right_side[node])
    follows = node + 1 < own.diagonal.shape[0]
    lower = scale(0.0, square), scale(0.0, square), scale(0.0, square), scale(0.0, square)
    upper = lower
    if follows:
        lower = load_node(own.lower[node], square)
        upper = multiply_nodes(inverse, load_node(own.upper[node], square))
        store_node(upper, own.upper[node])
        after = minus_nodes(load_node(own.diagonal[node + 1], square), multiply_nodes(lower, upper))
        store_node(after, own.diagonal[node + 1])
        rest = load_pair(own.right_side[node + 1], like)
        store_pair(subtract_pair(rest, apply_node(lower, right)), own.right_side[node + 1])
    ropes = scratch.front.size
    for other in range(ropes):
        scratch.used[number, other] = scratch.linked[rope, other]
        if scratch.linked[rope, other]:
            store_node(
                multiply_nodes(inverse, load_node(scratch.fill[rope, other], square)), scratch.side[number, other]
            )
    for other in range(ropes):
        if scratch.used[number, other]:
            back = load_node(scratch.fill[other, rope], square)
            beside = record_at(bundle.records[other, WORK], work)
            place = scratch.front[other]
            rest = load_pair(beside.right_side[place], like)
            store_pair(subtract_pair(rest, apply_node(back, right)), beside.right_side[place])
            for third in range(ropes):
                if scratch.used[number, third]:
                    change = multiply_nodes(back, load_node(scratch.side[number, third], square))
                    if third == other:
                        changed = minus_nodes(load_node(beside.diagonal[place], square), change)
                        store_node(changed, beside.diagonal[place])
                    else:
                        changed = minus_nodes(load_node(scratch.fill[other, third], square), change)
                        store_node(changed, scratch.fill[other, third])
                        scratch.linked[other, third] = 1
    for other in range(ropes):
        if scratch.used[number, other]:
            zero = scale(0.0, square), scale(0.0, square), scale(0.0, square), scale(0.0, square)
            if follows:
                on = multiply_nodes(lower, load_node(scratch.side[number, other], square))
                store_node(minus_nodes(zero, on), scratch.fill[rope, other])
                on = multiply_nodes(load_node(scratch.fill[other, rope], square), upper)
                store_node(minus_nodes(zero, on), scratch.fill[other, rope])
            else:
                scratch.linked[rope, other] = scratch.linked[other, rope] = 0
    return True


@inlined_kernel
def substitute(bundle, number, rope, node, scratch, work, like):
    """The solution at one node, from that of the nodes it was coupled with when it was eliminated."""
    square = outer(0.0, like, like)
    own = record_at(bundle.records[rope, WORK], work)
    x = load_pair(own.right_side[node], like)
    if node + 1 < own.diagonal.shape[0]:
        after = load_pair(own.right_side[node + 1], like)
        x = subtract_pair(x, apply_node(load_node(own.upper[node], square), after))
    for other in range(scratch.front.size):
        if scratch.used[number, other]:
            beside = load_pair(record_at(bundle.records[other, WORK], work).right_side[scratch.front[other]], like)
            x = subtract_pair(x, apply_node(load_node(scratch.side[number, other], square), beside))
    store_pair(x, own.right_side[node])
