"""Snapshots of a simulation out of the arrays of its state."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_twin.frame.records import FloatArray, SolverReport
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
        self._of_ropes: list[tuple[Ropeway, tuple[Any, ...], Any]] = []
        self._own: dict[str, FloatArray] = {}

    def _prepare(self) -> None:
        """Find the places at which ropes are shown: by kernels, which a bare rope without a rest is not to wait for."""
        layout = self.layout
        for part, (name, points) in zip(self._engine.parts, layout.ropes.items(), strict=True):
            own, columns = layout.alone.get(name), self._columns
            if own is not None:
                self._own[name] = numbers = np.zeros(own.size)
                columns = own.columns(numbers)
            places = places_on(part.system.cable, layout.arc_lengths[points])
            packed = pack(part.state), pack(part.sections), pack(places)
            self._of_ropes.append((part, packed, pack(columns)))

    def snapshot(self, time: float, report: SolverReport) -> Snapshot:
        """Read a snapshot from the present state.

        Args:
            time: s.
            report: what the solver did since the snapshot before.
        """
        if not self._of_ropes:
            self._prepare()
        self._engine.couple()
        for part, packed, columns in self._of_ropes:
            observe(part.packed_system, *packed, part.start.tower_load, columns)
        for name, own in self._own.items():
            self.layout.put(self._numbers, name, own)
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
