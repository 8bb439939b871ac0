"""Support columns restored from a log: ends from rope shapes, towers from forces, messages and earlier states."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any

import numpy as np

from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.messages import read_derailments
from cable_twin.scenario import Scenario, in_space, tower_axes


class LoggedSupports:
    """State of all supports, followed from frame to frame.

    Args:
        scenario: of the log.
        layout: of its frames.

    Attributes:
        rest_loads: (towers,) N, at rest, else in the first frame; NaN before one.
    """

    def __init__(self, scenario: Scenario, layout: Layout) -> None:
        count = len(layout.towers)
        self._rows = np.array([layout.support_rows[name] for name in layout.towers], dtype=np.int64)
        self._scenario, self._layout, self._step = scenario, layout, scenario.solver.step
        alone = [scenario.of_rope(name) for name in scenario.cables]
        each = zip(*map(tower_axes, alone), strict=True) if layout.grooves else ()
        self._axes = tuple(np.concatenate(axes) for axes in each)  # up, and to the left
        self.rest_loads = np.full(count, nan)
        self._lowest_loads = np.full(count, nan)  # N, since the start or the last reset
        self._ratios = np.full(count, nan)  # -, highest of lateral over normal force since then
        self._derailed, self._times = np.zeros((2, len(layout.supports)))  # how, and when (s)

    def go_to(self, states: Sequence[Any]) -> None:
        """Take over support data that frames do not hold from the states of all ropes."""
        loads, lateral, derailment = (
            np.concatenate([getattr(state, field) for state in states])
            for field in ("tower_load", "tower_lateral", "derailment")
        )
        self._lowest_loads[:] = loads[:, 1]
        self._ratios[:] = np.where(lateral[:, 1] < 0.0, nan, lateral[:, 1])  # negative: none yet
        self._derailed[self._rows] = derailment[:, 0]
        self._times[self._rows] = np.round(derailment[:, 1] * self._step, 9)

    def reset(self) -> None:
        """Reset the supports to the start of the run."""
        self._lowest_loads[:] = self.rest_loads
        self._ratios[:] = nan
        self._derailed[:], self._times[:] = 0.0, 0.0

    def read(self, data: bytes) -> None:
        """Read a message of derailments."""
        read_derailments(data, self._layout, self._derailed, self._times)

    def fill(self, c: Columns) -> None:
        """Fill the columns of supports in a frame with support forces and rope shape, or NaN."""
        self._fill_travels(c)
        loads = np.linalg.norm(c.support_force[self._rows], axis=1)
        seen = np.where(np.isnan(loads), nan, 1.0)
        self.rest_loads[:] = np.where(np.isnan(self.rest_loads), loads, self.rest_loads)
        self._lowest_loads[:] = np.fmin(self._lowest_loads, loads)
        c.tower_load[self._rows], c.tower_lowest_load[self._rows] = loads, seen * self._lowest_loads
        c.tower_rest_load[self._rows] = seen * self.rest_loads
        if self._axes:
            normal, left = (np.einsum("td,td->t", axes, c.support_force[self._rows]) for axes in self._axes)
            self._ratios[:] = np.fmax(self._ratios, np.abs(left) / np.where(normal > 0.0, normal, nan))
            c.tower_lateral[self._rows], c.tower_lateral_ratio[self._rows] = left, seen * self._ratios
            c.tower_derailed[self._rows], c.tower_derailed_time[self._rows] = (
                self._derailed[self._rows],
                self._times[self._rows],
            )

    def _fill_travels(self, c: Columns) -> None:
        """Fill the travel (m) of counterweights at rope ends, from the places of those ends."""
        for rope, part in self._layout.ropes.items():
            cable, names = self._scenario.cables[rope], self._scenario.end_names(rope)
            for sample, name, end in zip((part.start, part.stop - 1), names, (cable.start, cable.end), strict=True):
                if end.support == "counterweight" and end.direction is not None:
                    direction = np.array(in_space(end.direction)) / np.linalg.norm(end.direction)
                    moved = c.rope_position[sample] - self._scenario.placed(rope, end.position)
                    c.support_travel[self._layout.support_rows[name]] = float(moved @ direction)


__all__ = ["LoggedSupports"]
