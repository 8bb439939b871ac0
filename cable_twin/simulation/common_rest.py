"""Common rest of coupled ropes: ways to find it, and others where they fail.

Towers touch sharp bends only where there is no rest without (`on_rope.tower`). Connectors that roll are at their nodes
first, and roll from there. Of ropes that stretch much more than those for which the nodes were chosen, their places are
metres from these, and the tangent of both ends' coupling is too inexact for Newton's method. Without it the iteration
contracts, for the stiffness of the ropes is positive; it takes more iterations, and with soft connectors fewer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.declared import Kept, clone, write
from cable_twin.mechanics.solution.bundle.assembly import Assembly
from cable_twin.mechanics.solution.bundle.connector import ROLLS_FAR
from cable_twin.mechanics.solution.bundle.records import Connectors
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.solution.equilibrium import settle_together, touching_bends, without_friction
from cable_twin.simulation.ropeway import Ropeway

SOFTER = (1e-3, 1e-2, 1e-1)  # of the stiffness of connectors


class CommonRest:
    """Search for the common rest of ropes, to be called once or, by bullwheels, again and again.

    Once a search has failed, this and all later ones have towers that touch the ropes' sharp bends at loads
    (`on_rope.tower`), so that all of them have the same forces.

    Args:
        ropes: assembled, without friction.
        parts: the same ropes with their vehicles.
        tolerance: last increment (m) that is allowed.
        near: whether a search begins near the rest; such a one is not repeated.
        may_touch: whether another one is repeated.
    """

    def __init__(
        self,
        ropes: Assembly,
        parts: Sequence[Ropeway],
        tolerance: float,
        *,
        near: bool = False,
        may_touch: bool = True,
    ) -> None:
        self._ropes, self._parts, self._tolerance, self._near = ropes, parts, tolerance, near
        self._elements = sum(len(part.state.nodes.position) - 1 for part in parts)
        self._may_touch = may_touch and not near and any(part.system.towers.stiffness.size > 0 for part in parts)

    def __call__(self) -> None:
        """Find the rest between the present ends of the ropes.

        Raises:
            EquilibriumError: there is none.
        """
        states, moving = Kept(*[part.state for part in self._parts]), clone(self._ropes.moving)
        try:
            settle_together(self._ropes, self._tolerance, self._elements, near=self._near)
        except EquilibriumError:
            if not self._may_touch:
                raise
            self._may_touch = False
            for row, part in enumerate(self._parts):
                self._ropes.put(row, pack(touching_bends(without_friction(part.system))))
            write(states, self._parts[0].state)
            write(moving, self._ropes.moving)
            settle_together(self._ropes, self._tolerance, self._elements)


@contextmanager
def rolling_far(connectors: Connectors) -> Iterator[None]:
    """Leave the coupling of both ends of connectors that roll out of the tangent."""
    rolls = connectors.rolls.copy()
    connectors.rolls[rolls != 0] = ROLLS_FAR
    try:
        yield
    finally:
        connectors.rolls[:] = rolls


def settle_fixed(connectors: Connectors, settle: Callable[[], None]) -> None:
    """Find a rest with rollers fixed to their nodes: from far away they find their places along the ropes badly."""
    rolls = connectors.rolls.copy()
    connectors.rolls[:] = 0
    try:
        settle()
    finally:
        connectors.rolls[:] = rolls


def settle_softly(connectors: Connectors, settle: Callable[[], None]) -> None:
    """Find rests with connectors that are less and less soft, up to a tenth of their stiffness."""
    whole = connectors.stiffness.copy(), connectors.compression.copy()
    try:
        for share in SOFTER:
            connectors.stiffness[:], connectors.compression[:] = share * whole[0], share * whole[1]
            settle()
    finally:
        connectors.stiffness[:], connectors.compression[:] = whole
