"""Key figures of vehicle buffers: highest force of each pair in contact, with speed, time and place of the touch."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_twin.frame.records import Touch
from cable_twin.frame.snapshot import Columns
from cable_twin.key_figures.figure import KeyFigure
from cable_twin.scenario import Scenario

BUFFER_FORCE = ": buffer force, highest"  # name of the figure of two vehicles, behind theirs


class BufferFigures:
    """Highest buffer force of each vehicle against the vehicles after it on the rope, over all solver steps.

    Args:
        scenario: what runs, with one rope.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._names = list(scenario.vehicles)
        self._possible = sum(vehicle.joint != "clamped" for vehicle in scenario.vehicles.values()) > 1
        self._highest = np.zeros(len(self._names))  # N
        self._hardest: dict[int, tuple[float, Touch]] = {}  # s of that force, and the touch that it followed
        self._last: dict[int, Touch] = {}

    def update(self, time: float, c: Columns) -> None:
        """Take in the columns of a frame at a time (s)."""
        if not self._possible or not np.any(c.touched > 0.0):
            return
        for row in np.flatnonzero(c.touched > 0.0).tolist():
            other, where = self._names[int(c.touched[row]) - 1], float(c.touch_place[row])
            touch = Touch(self._names[row], other, float(c.touch_time[row]), where, float(c.touch_speed[row]))
            self._last[row] = touch
            if c.push_highest[row] > self._highest[row]:
                self._highest[row] = c.push_highest[row]
                self._hardest[row] = time, touch

    def touches(self) -> list[Touch]:
        """Return the last touch of each vehicle with a vehicle after it on the rope."""
        return [*self._last.values()]

    def figures(self) -> Iterator[KeyFigure]:
        """Yield the highest buffer force of each pair of vehicles in contact so far."""
        for row, (time, touch) in sorted(self._hardest.items()):
            place = f"met at {touch.speed:.3g} m/s at {touch.time:.2f} s, arc length {touch.place:.1f} m"
            name = f"{touch.vehicle} and {touch.other}{BUFFER_FORCE}"
            yield KeyFigure(name, float(self._highest[row]), "N", time, place, band="sampled at every solver step")


__all__ = ["BUFFER_FORCE", "BufferFigures"]
