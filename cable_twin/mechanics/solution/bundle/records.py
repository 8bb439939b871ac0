"""Parameters and state of a bundle: ropes side by side, what hangs between them, and what pushes from below."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.parameters import FREE, FloatArray, IntArray
from cable_twin.mechanics.state import Course, Motion

SYSTEM, STATE, WORK, GOOD, BEFORE = range(5)  # columns of `Bundle.records`
FIXED, COUNTERWEIGHT, HYDRAULIC = range(3)  # Sheaves.tensioning


@by_reference
class Connectors(NamedTuple):
    """Massless rods between nodes of two ropes: droppers, slack carriers. They pull; few push."""

    rope: IntArray  # (connectors, 2)
    node: IntArray  # (connectors, 2)
    length: FloatArray  # (connectors,) m, unstrained
    stiffness: FloatArray  # (connectors,) N/m, when longer than that
    compression: FloatArray  # (connectors,) N/m, when shorter
    damping: FloatArray  # (connectors,) N s/m, while it pulls


@by_reference
class Pantographs(NamedTuple):
    """Masses on springs that push a rope from below, one-sided, and move along the track at a given speed.

    Stage 0 is the head; below each stage is its spring, that of the last one stands on the vehicle.
    """

    rope: IntArray  # (pantographs,)
    mass: FloatArray  # (pantographs, stages) kg; weight is balanced
    stiffness: FloatArray  # (pantographs, stages) N/m, below the stage
    damping: FloatArray  # (pantographs, stages) N s/m, beside it
    base_force: FloatArray  # (pantographs,) N, upwards on the last stage at height 0
    contact_stiffness: FloatArray  # (pantographs,) N/m, of head and rope


@by_reference
class Wires(NamedTuple):
    """Damping of ropes as a share of their mass and of the stiffness that their tension gives them."""

    by_mass: FloatArray  # (ropes,) 1/s
    by_stiffness: FloatArray  # (ropes,) s
    tension: FloatArray  # (ropes,) N, for that stiffness
    present: bool  # whether any of them is not 0


@by_reference
class Sheaves(NamedTuple):
    """Bullwheels, each between the end of one strand and the start of another one or of the same."""

    rope: IntArray  # (sheaves, 2): whose end runs onto it, and whose start runs off it
    inertia: FloatArray  # (sheaves,) kg, of all that turns with it, reduced to its rim
    wrapped: FloatArray  # (sheaves,) kg, rope on it
    adhesion: FloatArray  # (sheaves,) -, highest ratio of their tensions, exp(μ α)
    resistance: FloatArray  # (sheaves,) N at its rim, of its bearings
    driven: IntArray  # (sheaves,) 1 where there is a drive
    acceleration_limit: FloatArray  # (sheaves,) m/s², of the drive
    emergency_deceleration: FloatArray  # (sheaves,) m/s², of the drive in an emergency stop
    jerk_limit: FloatArray  # (sheaves,) m/s³, inf where there is none
    brake_force: FloatArray  # (sheaves,) N at its rim, of what an emergency stop applies instead, 0 of none
    brake_rise_time: FloatArray  # (sheaves,) s, from release to full force
    rollback: FloatArray  # (sheaves,) m, that the rim may go back before it is stopped, inf without a watch
    tensioning: IntArray  # (sheaves,) FIXED, COUNTERWEIGHT or HYDRAULIC
    direction: FloatArray  # (sheaves, dim) unit vector in which it is pulled; 0 where FIXED
    mass: FloatArray  # (sheaves,) kg, that moves along that
    pull: FloatArray  # (sheaves,) N, of the counterweight, or that the cylinder keeps
    band: FloatArray  # (sheaves,) N, by which that may be off before the cylinder moves
    rate: FloatArray  # (sheaves,) m/s, of the cylinder
    travel: FloatArray  # (sheaves, 2) m, least and most
    buffer_stiffness: FloatArray  # (sheaves,) N/m, at both limits
    buffer_damping: FloatArray  # (sheaves,) s/m, of the buffer force, per unit of its elastic part


@by_reference
class Order(NamedTuple):
    """In which order the nodes of all ropes are eliminated, and when each connector has both its nodes at the front."""

    rope: IntArray  # (nodes of all,)
    node: IntArray  # (nodes of all,)
    connector_at: IntArray  # (connectors,) nodes that are gone before; rising


@by_reference
class Bundle(NamedTuple):
    """Everything that does not change while a bundle runs."""

    records: IntArray  # (ropes, 5) addresses of System, State, Workspace, and of two states more, for steps that fail
    up: FloatArray  # (dim,) unit vector
    connectors: Connectors
    pantographs: Pantographs
    wires: Wires
    order: Order
    sheaves: Sheaves


@by_reference
class SheaveMotion(NamedTuple):
    """Motion of the bullwheels, and what their drives were told."""

    rim: Motion  # (sheaves,) m, of unstrained rope
    rope: Motion  # (sheaves,) m, unstrained, that has gone over it
    carriage: Motion  # (sheaves,) m, in the direction in which it tensions
    given: FloatArray  # (sheaves,) N on the rim in this step, of drive, bearings and brake
    by_forces: IntArray  # (sheaves,) what moves by its forces in this step: nothing, the rope alone, or the wheel
    tension: FloatArray  # (sheaves, 2) N, of the strand that comes to it and of that which leaves it
    stretch: FloatArray  # (sheaves,) -, length of the rope on it over that without strain
    traction: FloatArray  # (sheaves,) N, of the rim on the rope, by the unstrained rope that goes over it
    pull: FloatArray  # (sheaves,) N, of both strands against the direction in which it tensions
    slipping: IntArray  # (sheaves,) 1 while it slips on a rim that is faster, -1 on one that is slower
    mode: IntArray  # (sheaves,) FREE, FORCE or SPEED, of the drive
    target: FloatArray  # (sheaves,) m/s
    force: FloatArray  # (sheaves,) N at the rim, in FORCE
    braking: IntArray  # (sheaves,) 1 in an emergency stop
    braking_time: FloatArray  # (sheaves,) s, since then
    sense: IntArray  # (sheaves,) 1 or -1, in which its drive turned it last, 0 before
    furthest: FloatArray  # (sheaves,) m, of its rim in that sense
    rolled_back: IntArray  # (sheaves,) 1 where it has gone back too far, until the release


@by_reference
class BundleState(NamedTuple):
    """Motion of what is on no rope alone."""

    stages: Motion  # (pantographs, stages) m, height
    place: Course  # (pantographs,) m, along the track
    arc_length: FloatArray  # (pantographs,) m, of the rope above the head
    contact_force: FloatArray  # (pantographs,) N
    tight: IntArray  # (connectors + pantographs,) 1 where it pulled or touched at the last look
    sheaves: SheaveMotion


@by_reference
class BundleWork(NamedTuple):
    """Scratch of the solver; contents have no meaning between steps."""

    fill: FloatArray  # (ropes, ropes, 2, 2, dim²): front node of one rope against that of another
    linked: IntArray  # (ropes, ropes) 1 where there is any
    side: FloatArray  # (nodes of all, ropes, 2, 2, dim²): eliminated node by the front node of another rope
    used: IntArray  # (nodes of all, ropes) 1 where there is any
    front: IntArray  # (ropes,)
    cross: FloatArray  # (connectors, dim²) N/m: either node by the other
    elimination: FloatArray  # (pantographs, stages, 3): matrix row, and what stands right of it
    increment: FloatArray  # (pantographs, stages) m
    by_rope: FloatArray  # (pantographs, stages) -, of each stage by the rope above the head


def allocate_bundle_state(bundle: Bundle) -> BundleState:
    """State of zeros."""
    shape = bundle.pantographs.mass.shape
    count = shape[0]
    return BundleState(
        stages=Motion(*(np.zeros(shape) for _ in Motion._fields)),
        place=Course(*(np.zeros(count) for _ in Course._fields)),
        arc_length=np.zeros(count),
        contact_force=np.zeros(count),
        tight=np.zeros(bundle.connectors.length.size + count, np.int64),
        sheaves=_sheaves_at_rest(bundle.sheaves.inertia.size),
    )


def _sheaves_at_rest(count: int) -> SheaveMotion:
    return SheaveMotion(
        rim=Motion(*(np.zeros(count) for _ in Motion._fields)),
        rope=Motion(*(np.zeros(count) for _ in Motion._fields)),
        carriage=Motion(*(np.zeros(count) for _ in Motion._fields)),
        given=np.zeros(count),
        by_forces=np.zeros(count, np.int64),
        tension=np.zeros((count, 2)),
        stretch=np.ones(count),
        traction=np.zeros(count),
        pull=np.zeros(count),
        slipping=np.zeros(count, np.int64),
        mode=np.full(count, FREE, np.int64),
        target=np.zeros(count),
        force=np.zeros(count),
        braking=np.zeros(count, np.int64),
        braking_time=np.zeros(count),
        sense=np.zeros(count, np.int64),
        furthest=np.zeros(count),
        rolled_back=np.zeros(count, np.int64),
    )


def clone_bundle_state(moving: BundleState) -> BundleState:
    """Independent copy."""
    return _clone(moving)  # type: ignore[no-any-return]


def _clone(record: Any) -> Any:
    return type(record)(*(_clone(field) if isinstance(field, tuple) else field.copy() for field in record))


def allocate_bundle_work(bundle: Bundle) -> BundleWork:
    """Scratch of the size of a bundle."""
    ropes, dim = bundle.records.shape[0], bundle.up.size
    nodes, connectors, shape = bundle.order.node.size, bundle.connectors.length.size, bundle.pantographs.mass.shape
    return BundleWork(
        fill=np.zeros((ropes, ropes, 2, 2, dim * dim)),
        linked=np.zeros((ropes, ropes), np.int64),
        side=np.zeros((nodes, ropes, 2, 2, dim * dim)),
        used=np.zeros((nodes, ropes), np.int64),
        front=np.zeros(ropes, np.int64),
        cross=np.zeros((connectors, dim * dim)),
        elimination=np.zeros((*shape, 3)),
        increment=np.zeros(shape),
        by_rope=np.zeros(shape),
    )


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


def order_of(nodes: list[int], ropes: IntArray, connected: IntArray) -> Order:
    """Order of elimination: ropes go on side by side from connector to connector.

    Args:
        nodes: number of nodes of each rope.
        ropes: (connectors, 2).
        connected: (connectors, 2) nodes; connectors in the order in which they follow each other along the ropes.

    Raises:
        ValueError: two connectors cross each other.
    """
    front = [0] * len(nodes)
    rope: list[int] = []
    node: list[int] = []
    at: list[int] = []
    for number, (pair, places) in enumerate(zip(ropes.tolist(), connected.tolist(), strict=True)):
        for one, place in zip(pair, places, strict=True):
            if place < front[one]:
                raise ValueError(f"connector {number} crosses the one before it")
            rope += [one] * (place - front[one])
            node += range(front[one], place)
            front[one] = place
        at.append(len(node))
    for one, count in enumerate(nodes):
        rope += [one] * (count - front[one])
        node += range(front[one], count)
    return Order(*(np.array(values, dtype=np.int64) for values in (rope, node, at)))
