"""Threads that advance the members of an ensemble, each thread in a memory of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from cable_twin.ensemble.advancing import ASKING, NONE_LEFT, STOP, Looks, Members, advance_members
from cable_twin.mechanics.language.addresses import Addresses
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.entries import OUTCOME, address_of
from cable_twin.mechanics.parameters import IntArray
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope
from cable_twin.mechanics.solution.bundle.records import Bundle
from cable_twin.mechanics.state import allocate_states, allocate_workspace
from cable_twin.simulation.engine import Engine

GLANCE = 0.1  # s between two looks of the calling thread at the others
UNLIMITED = 2**62  # steps


class Lane:
    """Memory of one thread: state, workspace and copies for a step, of all ropes and couplings.

    Args:
        engine: engine with these ropes and couplings.
    """

    def __init__(self, engine: Engine) -> None:
        systems = [part.system for part in engine.parts]
        states = allocate_states(systems)
        ropes = [Rope(system, state, allocate_workspace(system)) for system, state in zip(systems, states, strict=True)]
        self._assembly = Assembly(ropes, engine.couplings)
        self.arguments = tuple(map(pack, self._assembly.arguments))
        self._tables: dict[int, Addresses] = {}
        self._bundles: dict[int, int] = {}

    def bundle_of(self, bundle: Bundle) -> int:
        """Address of the parameters of rope couplings, in a copy that refers to the ropes in this thread's memory."""
        if id(bundle) not in self._bundles:
            own = Addresses([(bundle._replace(records=self._assembly.bundle.records),)])
            self._tables[id(bundle)], self._bundles[id(bundle)] = own, int(own.table[0, 0])
        return self._bundles[id(bundle)]

    def forget(self, kept: Sequence[Bundle]) -> None:
        """Release parameters of rope couplings, except those of present members."""
        alive = {id(one) for one in kept}
        for number in self._bundles.keys() - alive:
            del self._bundles[number], self._tables[number]


class Threads:
    """Pool of threads that advance the members of an ensemble, the calling thread among them.

    Args:
        engine: of all members.
        count: number of threads.
    """

    def __init__(self, engine: Engine, count: int) -> None:
        self._engine, self._count = engine, count
        self._code = address_of(engine.integrator, engine.arguments(0), OUTCOME)
        self._lanes: list[Lane] = []
        self._pool = ThreadPoolExecutor(count - 1, "ensemble") if count > 1 else None
        self._front, self._closed = threading.Lock(), False

    def advance(
        self,
        members: Members,
        looks: Looks,
        order: IntArray,
        bundles: Sequence[Bundle],
        see_to: Callable[[int], object],
        on_part: Callable[[], object],
    ) -> None:
        """Advance members by their remaining steps in all threads.

        Args:
            members: all members.
            looks: occasions on which steps are interrupted.
            order: (n,) members to be advanced.
            bundles: couplings of each member.
            see_to: called for a member whose loading, stations or rollback need handling, one member at a time.
            on_part: called by the calling thread every some tenths of a second; what it raises ends the call, each
                member at a whole step.
        """
        if self._closed:
            raise ValueError("advance_to: given an ensemble after close(); allowed: before it")
        count = min(self._count, len(order))
        while len(self._lanes) < count:
            self._lanes.append(Lane(self._engine))
        queue, packed = np.zeros(2, dtype=np.int64), (pack(members), pack(looks))

        def run(lane: Lane, budget: int, after: Callable[[], object]) -> None:
            addresses = np.array([lane.bundle_of(one) for one in bundles], dtype=np.int64)
            member = -1
            try:
                while True:
                    member = advance_members(
                        self._code, queue, order, member, budget, *packed, addresses, *lane.arguments
                    )
                    if member == NONE_LEFT:
                        return
                    if member >= 0 and members.counts[member, ASKING]:
                        with self._front:
                            see_to(member)
                    after()
            except BaseException:
                queue[STOP] = 1
                raise

        others: list[Future[None]] = []
        if self._pool is not None:
            others = [self._pool.submit(run, lane, UNLIMITED, _nothing) for lane in self._lanes[1:count]]
        try:
            run(self._lanes[0], int(looks.most), on_part)
            waiting: Any = set(others)
            while waiting:
                _, waiting = wait(waiting, GLANCE)
                on_part()
        except BaseException:
            queue[STOP] = 1
            wait(others)
            raise
        for other in others:
            other.result()

    def forget(self, bundles: Sequence[Bundle]) -> None:
        """Release parameters of rope couplings, except those of present members."""
        for lane in self._lanes:
            lane.forget(bundles)

    def close(self) -> None:
        """End all threads of the ensemble."""
        self._closed = True
        if self._pool is not None:
            self._pool.shutdown(wait=True)


def _nothing() -> None:
    return None
