"""Snapshots of a simulation out of the arrays of its state."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_twin.frame.records import SolverReport
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.readout.columns import observe
from cable_twin.mechanics.readout.samples import places_on
from cable_twin.scenario import Scenario
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.ropeway import Ropeway


class Observer:
    """Reader of snapshots of one scenario.

    Args:
        scenario: what runs.
        engine: what is read.
        samples: points (at least 2) at which snapshots hold each rope.
    """

    def __init__(self, scenario: Scenario, engine: Engine, samples: int) -> None:
        self._engine = engine
        self.layout = layout = Layout.of(scenario, samples)
        self._numbers = np.zeros(layout.size)
        self._columns = layout.columns(self._numbers)
        self._of_ropes: list[tuple[Ropeway, tuple[Any, ...], tuple[Any, ...]]] = []

    def _prepare(self) -> None:
        """Find the sample places on ropes: by kernels, for which a bare rope without an equilibrium is not to wait."""
        for number, (part, samples) in enumerate(zip(self._engine.parts, self.layout.ropes.values(), strict=True)):
            places = places_on(part.system.cable, self.layout.arc_lengths[samples])
            read = pack(part.state), pack(part.sections), pack(places)
            written = pack(self.layout.rows_of(number)), pack(self.layout.columns_of(number, self._columns))
            self._of_ropes.append((part, read, written))

    def snapshot(self, time: float, report: SolverReport) -> Snapshot:
        """Read a snapshot from the present state.

        Args:
            time: s.
            report: what the solver did since the snapshot before.
        """
        if not self._of_ropes:
            self._prepare()
        self._engine.couple()
        for part, read, written in self._of_ropes:
            observe(part.packed_system, *read, part.start.tower_load, *written)
        self._engine.observe(self._columns)
        self._numbers[0] = time
        return Snapshot(self.layout, self._numbers.copy(), report)


def read_only(arrays: Any) -> Any:
    """Read-only views of the arrays of a named tuple."""
    if isinstance(arrays, tuple):
        return type(arrays)(*map(read_only, arrays))
    view = arrays.view()
    view.flags.writeable = False
    return view


__all__ = ["Observer", "read_only"]
