"""Linear solver of coupled ropes: block elimination along all ropes at once, O(nodes), fill at the front only.

The front is one node of each rope, the next to be eliminated, and the clamps of which a node has been reached, each a
block of its own until the last of its nodes is gone. Nodes of different ropes are coupled only there: a connector is
added when both its nodes are at the front, a clamp with each of its nodes when that is, and the remainder of an
elimination couples the nodes that follow. Nodes that nothing holds to another rope do not come to the front: before,
those outside the couplings of a rope are eliminated (`block_tridiagonal`), then those between two (`node_runs`). The
order of elimination is found once, from the places of the couplings.
"""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import accumulate, load, outer
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.solution.block_tridiagonal import (
    eliminate_ends,
    factor_node,
    less_neighbour,
    less_nodes,
    less_pair,
    load_node,
    load_pair,
    no_node,
    solve_node,
    solve_pair,
    store_node,
    store_pair,
    substitute_ends,
)
from cable_twin.mechanics.solution.bundle.records import WORK, Order
from cable_twin.mechanics.solution.node_runs import (
    eliminate_four_runs,
    eliminate_run,
    four_of,
    substitute_four_runs,
    substitute_run,
)

CLAMP_NODES = 4  # of the element with its joint, and of that to which it is clamped


def sequence_of(ropes: IntArray, nodes: IntArray) -> list[int]:
    """Indices of all connectors, in an order in which they follow one another along every rope.

    Args:
        ropes: (connectors, 2).
        nodes: (connectors, 2).

    Raises:
        ValueError: two of them cross.
    """
    waiting: dict[int, list[int]] = {}
    for rope in np.unique(ropes).tolist():
        on_rope = [(nodes[c, end], nodes[c, 1 - end], c) for c, end in zip(*np.nonzero(ropes == rope), strict=True)]
        waiting[rope] = [int(c) for _, _, c in sorted(on_rope, reverse=True)]
    sequence: list[int] = []
    while len(sequence) < len(ropes):
        ready = {w[-1] for w in waiting.values() if w and all(waiting[r][-1] == w[-1] for r in ropes[w[-1]].tolist())}
        if not ready:
            raise ValueError(
                f"connectors {sorted({*range(len(ropes))} - {*sequence})}: given ends that cross each other; "
                "allowed: ends in the same order along all their ropes"
            )
        for connector in sorted(ready):
            sequence.append(connector)
            for rope in ropes[connector].tolist():
                waiting[rope].pop()
    return sequence


def lines_of(count: int, pairs: IntArray) -> list[int]:
    """Index of the line (group of coupled ropes) of each rope; ropes coupled directly or through others share one.

    Args:
        count: number of ropes.
        pairs: (couplings, 2) ropes.
    """
    line = list(range(count))
    for a, b in pairs.tolist():
        line = [min(line[a], line[b]) if one in (line[a], line[b]) else one for one in line]
    return line


def order_of(
    nodes: list[int],
    ropes: IntArray,
    connected: IntArray,
    along: list[FloatArray] | None = None,
    lines: list[int] | None = None,
) -> Order:
    """Elimination order of the nodes of coupled ropes: ropes advance side by side from connector to connector.

    Args:
        nodes: number of nodes of each rope that something holds to another one, 0 of each other rope.
        ropes: (connectors, 2).
        connected: (connectors, 2) nodes; connectors in the order in which they follow each other along the ropes.
        along: of each rope (nodes,) m along the track: between two connectors, nodes follow each other by that;
            without it, rope by rope.
        lines: of each rope, as of `lines_of`, where some ropes are not coupled: connectors and nodes of a line come
            one after another, so that the front is as small as that of one line alone.

    Raises:
        ValueError: two connectors cross each other.
    """
    front = [0] * len(nodes)
    rope: list[int] = []
    node: list[int] = []
    at: list[int] = []

    def go_on(until: dict[int, int]) -> None:
        ahead = [(one, place) for one, end in until.items() for place in range(front[one], end)]
        if along is not None:
            reached = [np.maximum.accumulate(places) for places in along]
            ahead.sort(key=lambda item: reached[item[0]][item[1]])
        rope.extend(one for one, _ in ahead)
        node.extend(place for _, place in ahead)
        front[:] = [max(place, until.get(one, 0)) for one, place in enumerate(front)]

    line = lines or [0] * len(nodes)
    for number, (pair, places) in enumerate(zip(ropes.tolist(), connected.tolist(), strict=True)):
        ended = {one for one in line if one < line[pair[0]]}
        go_on({one: count for one, count in enumerate(nodes) if line[one] in ended})
        if any(place < front[one] for one, place in zip(pair, places, strict=True)):
            raise ValueError(
                f"connector {number}: given nodes {places}, where it crosses an earlier one; "
                f"allowed: nodes {[front[one] for one in pair]} or later ones"
            )
        go_on(dict(zip(pair, places, strict=True)))
        at.append(len(node))
    for number in sorted({*line}):
        go_on({one: count for one, count in enumerate(nodes) if line[one] == number})
    first = np.cumsum([0, *nodes[:-1]])
    number_of = np.argsort(first[rope] + np.array(node))
    joined = [int(count > 0) for count in nodes]
    return Order(*(np.array(values, dtype=np.int64) for values in (rope, node, at, number_of, first, joined, line)))


@kernel
def solve_bundle(bundle, scratch, work, like):
    """Solve the equations of coupled ropes for the increments of all nodes, in `right_side`, and clamps.

    The columns of the bullwheels, `slots` of each rope, become their solutions; `upper` becomes a factor.

    Args:
        bundle: parameters.
        scratch: `BundleWork`, with `cross` of the connectors, which are in the diagonals already, and the blocks of
            the clamps.
        work: Workspace of any of the ropes, for its type.
        like: any vector of the space.

    Returns:
        False when a block has no inverse.
    """
    order, ropes, nodes = bundle.order, bundle.records.shape[0], bundle.order.node.size
    if has_changed(scratch):
        note_order(bundle, scratch)
    clear_front(bundle, scratch)
    for rope in range(ropes):
        if order.joined[rope]:
            own = record_at(bundle.records[rope, WORK], work)
            if eliminate_ends(own.diagonal, *ends_of(bundle, rope, own, scratch), like) >= 0:
                return False
    if not eliminate_runs(bundle, scratch, work, like):
        return False
    connector, event = 0, 0
    for number in scratch.kept[: scratch.kept_count[0]]:
        rope, node = order.rope[number], order.node[number]
        while connector < order.connector_at.size and order.connector_at[connector] <= number:
            link(bundle.connectors, connector, scratch, like)
            connector += 1
        touch = scratch.touch[number]
        while touch >= 0:
            link_clamp(ropes, touch, rope, scratch, like)
            touch = scratch.touch[nodes + touch]
        if not eliminate(bundle, event, rope, node, scratch, work, like):
            return False
        scratch.sequence[event] = number
        scratch.front[rope] = scratch.next_kept[order.first[rope] + node]
        event += 1
        touch = scratch.touch[number]
        while touch >= 0:
            clamp = touch // CLAMP_NODES
            scratch.nodes_left[clamp] -= 1
            if scratch.nodes_left[clamp] == 0:
                if not eliminate_clamp(bundle, event, clamp, scratch, work, like):
                    return False
                scratch.sequence[event] = -1 - clamp
                event += 1
            touch = scratch.touch[nodes + touch]
    while event > 0:
        event -= 1
        number = scratch.sequence[event]
        if number >= 0:
            scratch.front[order.rope[number]] = order.node[number]
            substitute(bundle, event, order.rope[number], order.node[number], scratch, work, like)
        else:
            substitute_clamp(bundle, event, -1 - number, scratch, work, like)
    substitute_runs(bundle, scratch, work, like)
    for rope in range(ropes):
        if order.joined[rope]:
            own = record_at(bundle.records[rope, WORK], work)
            substitute_ends(*ends_of(bundle, rope, own, scratch), like)
    return True


@kernel
def eliminate_runs(bundle, scratch, work, like):
    """Eliminate all runs of nodes between nodes coupled to another rope, on all ropes, four runs at a time."""
    rope, node, number = next_runs(bundle, 0, scratch.coupled_from[0], scratch)
    done = 0
    while number > 0:
        columns, count, runs = scratch.wheel_columns, scratch.slots[scratch.run_rope[0]], scratch.runs
        rooms = rooms_of(bundle, scratch, work)
        length = eliminate_four_runs(rooms, columns, count, runs, number, scratch.run_factors[done:], like)
        if length < 0:
            return False
        for run in range(number):
            own, of_rope = run_of(bundle, scratch, run, work)
            matrices = own.diagonal, own.upper, own.lower, own.right_side, of_rope
            if eliminate_run(*matrices, count, runs[run, 0], runs[run, 1], length, like) >= 0:
                return False
        done += length
        rope, node, number = next_runs(bundle, rope, node, scratch)
    return True


@kernel
def substitute_runs(bundle, scratch, work, like):
    """Back-substitute the runs of nodes that `eliminate_runs` has eliminated."""
    rope, node, number = next_runs(bundle, 0, scratch.coupled_from[0], scratch)
    done = 0
    while number > 0:
        columns, count, runs = scratch.wheel_columns, scratch.slots[scratch.run_rope[0]], scratch.runs
        length = four_of(runs, number)[2]
        for run in range(number):
            own, of_rope = run_of(bundle, scratch, run, work)
            matrices = own.upper, own.lower, own.right_side, of_rope
            substitute_run(*matrices, count, runs[run, 0], runs[run, 1], length, like)
        rooms = rooms_of(bundle, scratch, work)
        done += substitute_four_runs(rooms, columns, count, runs, number, scratch.run_factors[done:], like)
        rope, node, number = next_runs(bundle, rope, node, scratch)


@kernel
def next_runs(bundle, rope, node, scratch):
    """Find the next four runs of uncoupled nodes, from a coupled `node` of a rope on; repeats the last to fill four.

    Runs of several ropes come together where these have as many columns.

    Returns:
        Rope and kept node after the runs, and the number of different runs.
    """
    ropes, number = bundle.records.shape[0], 0
    while number < 4 and rope < ropes:
        if bundle.order.joined[rope] == 0 or node >= scratch.coupled_to[rope]:
            rope += 1
            node = scratch.coupled_from[rope] if rope < ropes else 0
            if number > 0 and rope < ropes and scratch.slots[rope] != scratch.slots[scratch.run_rope[0]]:
                break
            continue
        after = scratch.next_kept[bundle.order.first[rope] + node]
        if after > node + 1:
            scratch.run_rope[number], scratch.runs[number, 2] = rope, bundle.offset[rope] + node
            scratch.runs[number, 0], scratch.runs[number, 1] = node, after
            number += 1
        node = after
    for run in range(max(number, 1), 4):
        scratch.run_rope[run] = scratch.run_rope[run - 1]
        for k in range(3):
            scratch.runs[run, k] = scratch.runs[run - 1, k]
    return rope, node, number


@inlined_kernel
def run_of(bundle, scratch, run, work):
    """Workspace, and columns of bullwheels, of the rope that has run number `run` of the present four runs of nodes."""
    rope = scratch.run_rope[run]
    columns = scratch.wheel_columns[bundle.offset[rope] : bundle.offset[rope + 1]]
    return record_at(bundle.records[rope, WORK], work), columns


@inlined_kernel
def rooms_of(bundle, scratch, work):
    """Workspaces of the four ropes that have the present four runs of nodes."""
    records, ropes = bundle.records, scratch.run_rope
    return (
        record_at(records[ropes[0], WORK], work),
        record_at(records[ropes[1], WORK], work),
        record_at(records[ropes[2], WORK], work),
        record_at(records[ropes[3], WORK], work),
    )


@inlined_kernel
def ends_of(bundle, rope, own, scratch):
    """Arguments of `substitute_ends` for a rope with its workspace `own`, all but the last one."""
    columns = scratch.wheel_columns[bundle.offset[rope] : bundle.offset[rope + 1]]
    kept = scratch.coupled_from[rope], scratch.coupled_to[rope]
    return own.upper, own.lower, own.right_side, columns, scratch.slots[rope], *kept


@inlined_kernel
def has_changed(scratch):
    """Return whether clamps hold other nodes than those noted for the elimination order, or nothing is noted yet."""
    changed = scratch.kept_count[0] == 0
    for clamp in range(scratch.clamp_node.shape[0]):
        for k in range(CLAMP_NODES):
            changed = changed or scratch.clamp_node[clamp, k] != scratch.noted[clamp, k]
    return changed


@kernel
def note_order(bundle, scratch):
    """Find the nodes that something holds to another rope, in order of elimination, and the clamps at each of them."""
    order, ropes, connectors = bundle.order, bundle.records.shape[0], bundle.connectors
    nodes = order.node.size
    scratch.next_kept[:] = -1
    for rope in range(ropes):
        scratch.coupled_from[rope], scratch.coupled_to[rope] = bundle.offset[rope + 1] - bundle.offset[rope], -1
    for connector in range(connectors.length.size):
        for end in range(2):
            note_coupled(order, scratch, connectors.rope[connector, end], connectors.node[connector, end])
    scratch.touch[:nodes] = -1
    for clamp in range(scratch.clamp_node.shape[0]):
        for k in range(CLAMP_NODES):
            scratch.noted[clamp, k] = scratch.clamp_node[clamp, k]
            if scratch.clamp_node[clamp, 0] >= 0:
                touch, number = CLAMP_NODES * clamp + k, order.number[scratch.clamp_node[clamp, k]]
                scratch.touch[nodes + touch] = scratch.touch[number]
                scratch.touch[number] = touch
                note_coupled(order, scratch, order.rope[number], order.node[number])
    for rope in range(ropes):
        if scratch.coupled_to[rope] < 0:
            middle = (bundle.offset[rope + 1] - bundle.offset[rope]) // 2
            scratch.coupled_from[rope], scratch.coupled_to[rope] = middle, middle
            if order.joined[rope]:
                scratch.next_kept[order.first[rope] + middle] = middle
        if order.joined[rope]:
            after = scratch.coupled_to[rope]
            for node in range(scratch.coupled_to[rope], scratch.coupled_from[rope] - 1, -1):
                at = order.first[rope] + node
                if scratch.next_kept[at] >= 0:
                    scratch.next_kept[at], after = after, node
    count = 0
    for number in range(nodes):
        if scratch.next_kept[order.first[order.rope[number]] + order.node[number]] >= 0:
            scratch.kept[count] = number
            count += 1
    scratch.kept_count[0] = count


@inlined_kernel
def clear_front(bundle, scratch):
    """Set the elimination front to the first coupled node of each rope, with no clamp."""
    ropes = bundle.records.shape[0]
    scratch.linked[:] = 0
    scratch.front[ropes:] = -1
    scratch.width[0] = ropes
    for rope in range(ropes):
        scratch.front[rope] = scratch.coupled_from[rope]
    for clamp in range(scratch.clamp_node.shape[0]):
        scratch.member[clamp], scratch.nodes_left[clamp] = -1, CLAMP_NODES


@inlined_kernel
def note_coupled(order, scratch, rope, node):
    """Record a node as coupled to another rope, and extend the range of its rope's coupled nodes."""
    scratch.next_kept[order.first[rope] + node] = node
    scratch.coupled_from[rope] = min(scratch.coupled_from[rope], node)
    scratch.coupled_to[rope] = max(scratch.coupled_to[rope], node)


@inlined_kernel
def link(connectors, connector, scratch, like):
    """Add the coupling by a connector to the front nodes of its two ropes."""
    a, b = connectors.rope[connector, 0], connectors.rope[connector, 1]
    square = outer(0.0, like, like)
    if not scratch.linked[a, b]:
        connect(a, b, scratch, like)
    for row in range(2 if connectors.rolls[connector] != 0 else 1):  # one fixed to its node does not feel its slope
        accumulate(load(scratch.cross[connector, row, 0], square), scratch.fill[a, b, 0, row])
        accumulate(load(scratch.cross[connector, row, 1], square), scratch.fill[b, a, row, 0])


@inlined_kernel
def connect(a, b, scratch, like):
    """Mark two members of the elimination front as coupled, with zero coupling blocks."""
    nothing = no_node(like)
    store_node(nothing, scratch.fill[a, b])
    store_node(nothing, scratch.fill[b, a])
    scratch.linked[a, b] = scratch.linked[b, a] = 1


@kernel
def link_clamp(ropes, touch, rope, scratch, like):
    """Add the coupling of a clamp with the front node of a rope; the clamp joins the front at its first node."""
    clamp, k, square = touch // CLAMP_NODES, touch % CLAMP_NODES, outer(0.0, like, like)
    if scratch.member[clamp] < 0:
        place = ropes
        while scratch.front[place] >= 0:
            place += 1
        scratch.front[place], scratch.member[clamp] = clamp, place
        scratch.width[0] = max(scratch.width[0], place + 1)
    member = scratch.member[clamp]
    if not scratch.linked[rope, member]:
        connect(rope, member, scratch, like)
    for i in range(2):
        for j in range(2):
            accumulate(load(scratch.clamp_out[clamp, k, i, j], square), scratch.fill[rope, member, i, j])
            accumulate(load(scratch.clamp_in[clamp, k, i, j], square), scratch.fill[member, rope, i, j])


@inlined_kernel
def at_front(bundle, member, scratch, work):
    """Diagonal block, right side and columns of a member (rope node or clamp) of the elimination front."""
    place = scratch.front[member]
    if member < bundle.records.shape[0]:
        own = record_at(bundle.records[member, WORK], work)
        return own.diagonal[place], own.right_side[place], scratch.wheel_columns[bundle.offset[member] + place]
    return scratch.clamp_diagonal[place], scratch.clamp_right[place], scratch.clamp_columns[place]


@kernel
def eliminate(bundle, event, rope, node, scratch, work, like):
    """Eliminate the front node of a rope from the equations of its next node and of the other front members."""
    square = outer(0.0, like, like)
    own = record_at(bundle.records[rope, WORK], work)
    factors, missing = factor_node(load_node(own.diagonal[node], square))
    if missing != 0.0:
        return False
    right = solve_pair(factors, load_pair(own.right_side[node], like))
    store_pair(right, own.right_side[node])
    columns, count = scratch.wheel_columns[bundle.offset[rope] + node], scratch.slots[rope]
    solve_blocks(factors, columns, count, square)
    follows = node < scratch.coupled_to[rope]
    lower = no_node(like)
    upper = lower
    if follows:
        after = scratch.next_kept[bundle.order.first[rope] + node]
        lower = load_node(own.lower[after - 1], square)
        upper = solve_node(factors, load_node(own.upper[node], square))
        store_node(upper, own.upper[node])
        less = less_nodes(load_node(own.diagonal[after], square), lower, upper)
        store_node(less, own.diagonal[after])
        less_neighbour(lower, own.right_side[node], own.right_side[after], like)
        for b in range(count):
            less_neighbour(lower, columns[b], scratch.wheel_columns[bundle.offset[rope] + after, b], square)
    eliminate_beside(bundle, event, rope, factors, right, columns, count, scratch, work, like)
    for other in range(scratch.width[0]):
        if scratch.used[event, other]:
            if follows:
                side, back = load_node(scratch.side[event, other], square), load_node(scratch.fill[other, rope], square)
                store_node(less_nodes(no_node(like), lower, side), scratch.fill[rope, other])
                store_node(less_nodes(no_node(like), back, upper), scratch.fill[other, rope])
            else:
                scratch.linked[rope, other] = scratch.linked[other, rope] = 0
    return True


@kernel
def eliminate_clamp(bundle, event, clamp, scratch, work, like):
    """Eliminate a clamp from the equations of the elimination front, and free its place in the front."""
    member, square = scratch.member[clamp], outer(0.0, like, like)
    factors, missing = factor_node(load_node(scratch.clamp_diagonal[clamp], square))
    if missing != 0.0:
        return False
    right = solve_pair(factors, load_pair(scratch.clamp_right[clamp], like))
    store_pair(right, scratch.clamp_right[clamp])
    columns, count = scratch.clamp_columns[clamp], scratch.slots[bundle.clamps.rope[clamp]]
    solve_blocks(factors, columns, count, square)
    eliminate_beside(bundle, event, member, factors, right, columns, count, scratch, work, like)
    scratch.front[member] = -1
    for other in range(scratch.width[0]):
        scratch.linked[member, other] = scratch.linked[other, member] = 0
    return True


@inlined_kernel
def solve_blocks(factors, columns, count, square):
    """Solve a factored node block for the first `count` columns (blocks, 2, dim²) of a front member, in place."""
    for b in range(count):
        store_pair(solve_pair(factors, load_pair(columns[b], square)), columns[b])


@inlined_kernel
def eliminate_beside(bundle, event, member, factors, right, wheel_columns, count, scratch, work, like):
    """Eliminate a member from the equations of all others at the front; keep the blocks for its back substitution."""
    square, width = outer(0.0, like, like), scratch.width[0]
    scratch.width_then[event] = width
    for other in range(width):
        scratch.used[event, other] = scratch.linked[member, other]
        if scratch.linked[member, other]:
            side = solve_node(factors, load_node(scratch.fill[member, other], square))
            store_node(side, scratch.side[event, other])
    for other in range(width):
        if scratch.used[event, other]:
            back = load_node(scratch.fill[other, member], square)
            diagonal, right_side, beside = at_front(bundle, other, scratch, work)
            store_pair(less_pair(load_pair(right_side, like), back, right), right_side)
            for b in range(count):
                less_neighbour(back, wheel_columns[b], beside[b], square)
            for third in range(width):
                if scratch.used[event, third]:
                    side = load_node(scratch.side[event, third], square)
                    if third == other:
                        store_node(less_nodes(load_node(diagonal, square), back, side), diagonal)
                    else:
                        if not scratch.linked[other, third]:
                            connect(other, third, scratch, like)
                        changed = less_nodes(load_node(scratch.fill[other, third], square), back, side)
                        store_node(changed, scratch.fill[other, third])


@inlined_kernel
def substitute_beside(bundle, event, right, wheel_columns, count, scratch, work, like):
    """Back-substitute a front member, right side and columns, from the members coupled to it at its elimination."""
    square = outer(0.0, like, like)
    for other in range(scratch.width_then[event]):
        if scratch.used[event, other]:
            _, found, beside = at_front(bundle, other, scratch, work)
            side = load_node(scratch.side[event, other], square)
            less_neighbour(side, found, right, like)
            for b in range(count):
                less_neighbour(side, beside[b], wheel_columns[b], square)


@kernel
def substitute(bundle, event, rope, node, scratch, work, like):
    """Back-substitute one node of a rope, from its next node and the other members of its front."""
    own, square = record_at(bundle.records[rope, WORK], work), outer(0.0, like, like)
    columns, count = scratch.wheel_columns[bundle.offset[rope] + node], scratch.slots[rope]
    if node < scratch.coupled_to[rope]:
        upper, after = load_node(own.upper[node], square), scratch.next_kept[bundle.order.first[rope] + node]
        less_neighbour(upper, own.right_side[after], own.right_side[node], like)
        for b in range(count):
            less_neighbour(upper, scratch.wheel_columns[bundle.offset[rope] + after, b], columns[b], square)
    substitute_beside(bundle, event, own.right_side[node], columns, count, scratch, work, like)


@kernel
def substitute_clamp(bundle, event, clamp, scratch, work, like):
    """Back-substitute one clamp's force and sliding coordinate, and put the clamp back into the elimination front."""
    scratch.front[scratch.member[clamp]] = clamp
    columns, count = scratch.clamp_columns[clamp], scratch.slots[bundle.clamps.rope[clamp]]
    substitute_beside(bundle, event, scratch.clamp_right[clamp], columns, count, scratch, work, like)
