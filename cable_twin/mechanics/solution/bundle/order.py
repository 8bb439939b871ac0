"""In which order the nodes of several ropes are eliminated."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.solution.bundle.records import Order


def sequence_of(ropes: IntArray, nodes: IntArray) -> list[int]:
    """Numbers of the connectors in an order in which they follow each other on every rope.

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


def order_of(nodes: list[int], ropes: IntArray, connected: IntArray, along: list[FloatArray] | None = None) -> Order:
    """Order of elimination: ropes go on side by side from connector to connector.

    Args:
        nodes: number of nodes of each rope.
        ropes: (connectors, 2).
        connected: (connectors, 2) nodes; connectors in the order in which they follow each other along the ropes.
        along: of each rope (nodes,) m along the track: between two connectors, nodes follow each other by that;
            without it, rope by rope.

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

    for number, (pair, places) in enumerate(zip(ropes.tolist(), connected.tolist(), strict=True)):
        if any(place < front[one] for one, place in zip(pair, places, strict=True)):
            raise ValueError(f"connector {number} crosses the one before it")
        go_on(dict(zip(pair, places, strict=True)))
        at.append(len(node))
    go_on(dict(enumerate(nodes)))
    first = np.cumsum([0, *nodes[:-1]])
    number_of = np.argsort(first[rope] + np.array(node))
    return Order(*(np.array(values, dtype=np.int64) for values in (rope, node, at, number_of, first)))
