"""What a simulation shows: snapshots out of the arrays of its state."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.readout.columns import groups, observe
from cable_twin.records import SolverReport
from cable_twin.scenario import Scenario
from cable_twin.snapshot import Layout, Snapshot


class Observer:
    """Reads snapshots of one scenario.

    Args:
        scenario: what runs.
        system: its parameters.
        samples: points (at least 2) at which snapshots hold the cable.
    """

    def __init__(self, scenario: Scenario, system: System, samples: int) -> None:
        self.layout = Layout.of(scenario, samples)
        self._numbers = np.zeros(self.layout.size)
        self._columns = pack(self.layout.columns(self._numbers))
        self._means = np.empty(groups(system.cable))

    def snapshot(self, time: float, system: Any, state: Any, rest_loads: FloatArray, report: SolverReport) -> Snapshot:
        """Read everything that a snapshot holds.

        Args:
            time: s.
            system: parameters with payloads, packed or not.
            state: what is read, packed or not.
            rest_loads: (towers, 2) N, at the start of the run in the first column.
            report: what the solver did since the snapshot before.
        """
        observe(system, state, self.layout.arc_lengths, rest_loads, self._means, self._columns)
        self._numbers[0] = time
        return Snapshot(self.layout, self._numbers.copy(), report)


def read_only(arrays: Any) -> Any:
    """Views of the arrays of a named tuple that cannot be written."""
    if isinstance(arrays, tuple):
        return type(arrays)(*map(read_only, arrays))
    view = arrays.view()
    view.flags.writeable = False
    return view


__all__ = ["Observer", "read_only"]
