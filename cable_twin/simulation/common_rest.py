"""Common rest of coupled ropes, found again with towers that touch sharp bends where it is not found without."""

from __future__ import annotations

from collections.abc import Sequence

from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.declared import Kept, clone, write
from cable_twin.mechanics.solution.bundle.assembly import Assembly
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.solution.equilibrium import settle_together, touching_bends, without_friction
from cable_twin.simulation.ropeway import Ropeway


class CommonRest:
    """Search for the common rest of ropes, to be called once or, by bullwheels, again and again.

    Once a search has failed, this and all later ones have towers that touch the ropes' sharp bends at loads
    (`on_rope.tower`), so that all of them have the same forces.

    Args:
        ropes: assembled, without friction.
        parts: the same ropes with their vehicles.
        tolerance: last increment (m) that is allowed.
        near: whether a search begins near the rest; such a one is not repeated.
    """

    def __init__(self, ropes: Assembly, parts: Sequence[Ropeway], tolerance: float, *, near: bool) -> None:
        self._ropes, self._parts, self._tolerance, self._near = ropes, parts, tolerance, near
        self._elements = sum(len(part.state.nodes.position) - 1 for part in parts)
        self._may_touch = not near and any(part.system.towers.stiffness.size > 0 for part in parts)

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
