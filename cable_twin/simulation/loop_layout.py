"""Initial layout of the strands of a loop before the search for equilibrium, and its checks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.solution.bundle.loop_in_closed_form import on_bullwheels, rest_in_closed_form
from cable_twin.mechanics.solution.bundle.records import FIXED, BullwheelMotion, Bullwheels, bullwheels_at_rest
from cable_twin.mechanics.solution.catenary import Cure, EquilibriumError, check_rest, rest_over_supports
from cable_twin.scenario import Scenario
from cable_twin.scenario.checks.line import groove_faults
from cable_twin.simulation.ropeway import Ropeway, of_rope


class LoopLayout:
    """Strands of one scenario without other ropes, in closed form; there may be none.

    Args:
        scenario: what runs.
        sheaves: its bullwheels.
        parts: one a rope, with what is on it.
    """

    def __init__(self, scenario: Scenario, sheaves: Bullwheels, parts: list[Ropeway]) -> None:
        self._sheaves, self._wheels = sheaves, list(scenario.sheaves)
        self._names, self._parts, self._strands = list(scenario.ropes), parts, scenario.strands
        self._bare_rest = bullwheels_at_rest(len(self._wheels))  # until it is known
        self._rows = [row for row, name in enumerate(self._names) if name in self._strands]

    def check_bare(self) -> None:
        """Refuse towers without contact to the bare strands at the tension over their bullwheels.

        Raises:
            EquilibriumError: naming one, or a strand that has no rest even by itself.
        """
        if not self._rows:
            return
        strands = self._bare()
        try:
            self._bare_rest = motion = self._rest(self._sheaves, strands)
        except EquilibriumError:
            self._check_each(strands)
            return
        for row, system in strands.items():
            scenario, here = self._parts[row].scenario, on_bullwheels(self._sheaves, motion, row, system)
            with of_rope(self._names[row]):
                check_rest(here, tuple(scenario.towers), loaded=True, cure=self._cure(row))
                if scenario.dim == 3 and (fault := next(groove_faults(scenario, here), None)) is not None:
                    raise EquilibriumError(f"{'.'.join(map(str, fault.path))}: {fault.text}")

    def lay_out(self, motion: BullwheelMotion) -> None:
        """Start bullwheels near their equilibrium: that with vehicles spread evenly over their strands.

        Where there is no such rest, they begin as the strands are by themselves, and what finds none later says why.
        """
        if not self._rows:
            return
        loaded = {}
        for row, system in self._bare().items():
            cable, carriages = system.cable, system.carriages
            attached = np.repeat(self._parts[row].state.attached, np.diff(carriages.body_offset))
            more = float(carriages.mass[attached].sum()) / cable.unstrained_length
            loaded[row] = system._replace(cable=cable._replace(mass_per_length=cable.mass_per_length + more))
        try:
            found = self._rest(self._sheaves, loaded, self._bare_rest)
        except EquilibriumError:
            return
        motion.rope.position[:], motion.carriage.position[:] = found.rope.position, found.carriage.position
        for sheave, side in np.ndindex(self._sheaves.rope.shape):
            part = self._parts[int(self._sheaves.rope[sheave, side])]
            part.state.rope.position[1 - side] = motion.rope.position[sheave]

    def ends(self, name: str, motion: BullwheelMotion) -> FloatArray | None:
        """Ends (2, dim) in m of a strand at the places of its bullwheels, None of any other rope."""
        if name not in self._strands:
            return None
        row = self._names.index(name)
        ends: FloatArray = on_bullwheels(self._sheaves, motion, row, self._parts[row].system).cable.end_position
        return ends

    def _bare(self) -> dict[int, System]:
        """Systems of the strands by number of the rope."""
        return {row: self._parts[row].system for row in self._rows}

    def _rest(
        self, sheaves: Bullwheels, strands: Mapping[int, System], start: BullwheelMotion | None = None
    ) -> BullwheelMotion:
        """Bullwheel motion at the closed-form equilibrium of strands, searched for from `start`."""
        motion = bullwheels_at_rest(len(self._wheels))
        if start is not None:
            motion.rope.position[:], motion.carriage.position[:] = start.rope.position, start.carriage.position
        rest_in_closed_form(sheaves, motion, strands)
        return motion

    def _check_each(self, strands: Mapping[int, System]) -> None:
        """Refuse a strand without an equilibrium even by itself."""
        for row, system in strands.items():
            if not self._parts[row].is_taut:
                with of_rope(self._names[row]):
                    rest_over_supports(system)

    def _cure(self, row: int) -> Cure:
        """Remedy for a strand off its towers: another tensioning force, or another length of a fixed loop."""
        sheaves, strands = self._sheaves, self._bare()
        tensioned = np.flatnonzero(sheaves.tensioning != FIXED)

        def pulled(force: float) -> System:
            pull = sheaves.pull.copy()
            pull[tensioned[0]] = force
            other = sheaves._replace(pull=pull)
            return on_bullwheels(other, self._rest(other, strands), row, strands[row])

        if tensioned.size:
            text = f"a pull of {{bound}} {{value}} of sheaves.{self._wheels[tensioned[0]]}"
            return Cure(float(sheaves.pull[tensioned[0]]), text, "N", pulled)

        whole = sum(system.cable.unstrained_length for system in strands.values())

        def cut(given: float) -> System:
            other = {}
            for one, system in strands.items():
                length = given / whole * system.cable.unstrained_length
                other[one] = system._replace(cable=system.cable._replace(unstrained_length=length))
            return on_bullwheels(sheaves, self._rest(sheaves, other), row, other[row])

        return Cure(whole, "strands of {bound} {value} in all", "m", cut)


__all__ = ["LoopLayout"]
