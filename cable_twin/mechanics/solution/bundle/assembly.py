"""Ropes and their couplings, assembled into the arguments of the solver kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from cable_twin.mechanics.language.addresses import Addresses
from cable_twin.mechanics.language.by_reference import Known, pack
from cable_twin.mechanics.language.declared import Kept, write
from cable_twin.mechanics.parameters import DriveLimits, FloatArray, IntArray, System
from cable_twin.mechanics.readout.sections import Sections
from cable_twin.mechanics.solution.bundle.elimination import lines_of, order_of
from cable_twin.mechanics.solution.bundle.records import (
    SYSTEM,
    Bullwheels,
    Bundle,
    BundleState,
    BundleWork,
    Clamps,
    Connectors,
    Pantographs,
    Wires,
    allocate_bundle_state,
    allocate_bundle_work,
)
from cable_twin.mechanics.state import State, Workspace

UNCOUPLED = cast(bool, Known(False))  # `Bundle.coupled` of a rope by itself, whose kernels have nothing for couplings


class Rope(NamedTuple):
    """Parameters, state and workspace of one rope with its vehicles."""

    system: System
    state: State
    work: Workspace
    sections: Sections | None = None  # where forces in it are to be read
    name: str = "the rope"  # in messages


class Couplings(NamedTuple):
    """Couplings between ropes, and loads carried by several ropes; a rope is given by its index."""

    connectors: Connectors
    pantographs: Pantographs
    clamps: Clamps
    wires: Wires
    sheaves: Bullwheels
    pairs: IntArray  # (n, 2) ropes of which something slides on one and is clamped to the other
    along: list[FloatArray]  # of each rope (nodes,) m along the track, where any is clamped to another one

    @property
    def any(self) -> bool:
        """True if any coupling between ropes exists."""
        things = self.connectors.rope, self.pantographs.rope, self.clamps.rope, self.sheaves.rope
        return self.wires.present or any(thing.size > 0 for thing in things)


def no_couplings(ropes: int, dim: int) -> Couplings:
    """Empty couplings for a number of ropes in a space of `dim` dimensions."""
    none, pair, vector, row = np.zeros(0), np.zeros((0, 2)), np.zeros((0, dim)), np.zeros((0, 1))
    number, numbers = np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
    wheels: dict[str, Any] = dict.fromkeys(Bullwheels._fields, none)
    wheels |= {
        "rope": numbers,
        "driven": number,
        "tensioning": number,
        "direction": vector,
        "limits": DriveLimits(*np.zeros((7, 0))),
        "way": pair,
        "travel": pair,
    }
    return Couplings(
        connectors=Connectors(numbers, numbers, none, none, none, none, number),
        pantographs=Pantographs(number, row, row, row, none, none),
        clamps=Clamps(number, number, vector, np.zeros(1, np.int64), number, none, none),
        wires=Wires(np.zeros(ropes), np.zeros(ropes), False),
        sheaves=Bullwheels(**wheels),
        pairs=numbers,
        along=[],
    )


class Assembly:
    """Ropes, their couplings and scratch memory of the solver; kept alive as long as kernels use the memory.

    Attributes:
        ropes: as they were given, their parameters before any of `put`.
        bundle: parameters of couplings, and where the records of each rope are.
        moving: motion of couplings.
        spare: two more records of that motion, without the response to bullwheels.
        scratch: of the solver, for couplings.
    """

    def __init__(self, ropes: Sequence[Rope], couplings: Couplings | None = None, like: Assembly | None = None) -> None:
        """Assemble ropes, whose states are in one block of memory, and their couplings, none where not given.

        A rope whose number is known at compile time is by itself: its kernels have no code for couplings.

        With `like`, an assembly whose states and workspaces the ropes have, its memory serves for the rest as well.
        """
        self.ropes = tuple(ropes)
        first = ropes[0]
        dim = len(first.system.cable.gravity)
        given = couplings or no_couplings(len(ropes), dim)
        self._systems: list[Any] = [rope.system for rope in ropes]
        self._copies: list[tuple[State, ...]] = (
            like._copies if like else [Kept(*[rope.state for rope in ropes]).records for _ in range(2)]
        )
        good, before = self._copies
        self._addresses = Addresses(
            [
                (rope.system, rope.state, rope.work, good[row], before[row], *_sections(rope))
                for row, rope in enumerate(ropes)
            ]
        )
        pairs = np.concatenate([given.connectors.rope, given.pairs])
        joined = np.isin(np.arange(len(ropes)), pairs)
        nodes = [rope.state.nodes.position.shape[0] if joined[row] else 0 for row, rope in enumerate(ropes)]
        self.bundle = Bundle(
            records=self._addresses.table,
            offset=np.cumsum([0, *(rope.state.nodes.position.shape[0] for rope in ropes)]),
            coupled=UNCOUPLED if isinstance(first.system.number, Known) else True,
            up=np.eye(dim)[-1].copy(),
            connectors=given.connectors,
            pantographs=given.pantographs,
            clamps=given.clamps,
            wires=given.wires,
            order=order_of(
                nodes,
                given.connectors.rope,
                given.connectors.node,
                [place[:count] for place, count in zip(given.along, nodes, strict=True)] if given.along else None,
                lines_of(len(ropes), pairs),
            ),
            sheaves=given.sheaves,
        )
        vehicles, patch = first.work.patch.shape[0], max(rope.work.patch.shape[1] for rope in ropes)
        first_motion = allocate_bundle_state(self.bundle, vehicles, patch)
        if like:
            write(first_motion, like.moving)
        self.moving: BundleState = like.moving if like else first_motion
        self.spare: tuple[BundleState, ...] = (
            like.spare if like else tuple(allocate_bundle_state(self.bundle, kept=0) for _ in range(2))
        )
        self.scratch: BundleWork = like.scratch if like else allocate_bundle_work(self.bundle, vehicles, patch)
        # packed once: of several assemblies that take turns, each would otherwise be packed anew in its turn
        self._couplings = tuple(map(pack, (self.bundle, self.moving, *self.spare, self.scratch)))
        self._rope: tuple[Any, ...] = tuple(map(pack, first[:3]))

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Packed arguments of an integrator kernel, all before the number of steps."""
        return *self._couplings, *self._rope

    @property
    def relaxed(self) -> tuple[Any, ...]:
        """Packed arguments of the kernel `relaxation.relax`, all before the tolerance."""
        bundle, moving, good, _, scratch = self._couplings
        return bundle, moving, good, scratch, *self._rope

    def put(self, row: int, system: Any) -> None:
        """Replace the parameters of rope number `row` by others of equal type, packed or not."""
        if self._systems[row] is not system:
            self._addresses.write(row, SYSTEM, system)
            self._systems[row] = system
            if row == 0:
                self._rope = pack(system), *self._rope[1:]


def _sections(rope: Rope) -> tuple[Sections, ...]:
    return () if rope.sections is None else (rope.sections,)


__all__ = ["UNCOUPLED", "Assembly", "Couplings", "Rope", "no_couplings"]
