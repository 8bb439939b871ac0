"""Elimination order of the nodes of several ropes."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.solution.bundle.records import Order


def sequence_of(ropes: IntArray, nodes: IntArray) -> list[int]:
    """Indices of the connectors in their common order along all ropes.

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
            raise ValueError("connectors cross each other")
        for connector in sorted(ready):
            sequence.append(connector)
            for rope in ropes[connector].tolist():
                waiting[rope].pop()
    return sequence


def lines_of(count: int, pairs: IntArray) -> list[int]:
    """Line number of each rope; ropes coupled directly or through other ropes share a line.

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
    """Elimination order of all nodes: ropes advance side by side from connector to connector.

    Args:
        nodes: number of nodes of each rope that something holds to another one, 0 of each other rope.
        ropes: (connectors, 2).
        connected: (connectors, 2) nodes; connectors in the order in which they follow each other along the ropes.
        along: of each rope (nodes,) m along the track: between two connectors, nodes follow each other by that;
            without it, rope by rope.
        lines: of each rope, where some are coupled by nothing, as by `lines_of`: connectors of a line follow each
            other, and so does all that is on it, so that its front is as small as that of a line alone.

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
            raise ValueError(f"connector {number} crosses the one before it")
        go_on(dict(zip(pair, places, strict=True)))
        at.append(len(node))
    for number in sorted({*line}):
        go_on({one: count for one, count in enumerate(nodes) if line[one] == number})
    first = np.cumsum([0, *nodes[:-1]])
    number_of = np.argsort(first[rope] + np.array(node))
    joined = [int(count > 0) for count in nodes]
    return Order(*(np.array(values, dtype=np.int64) for values in (rope, node, at, number_of, first, joined)))
