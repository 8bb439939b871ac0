"""Speeds at which carriages run into the end stops of their ropes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures.figure import KeyFigure, Subject, figure
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.vehicles import stop_stroke

LEAST = 0.01  # m/s; slower carriages lean on an end stop


class EndStops:
    """Highest speed at which each sliding carriage of a scenario has run into an end stop of its rope.

    Args:
        scenario: scenario of the run.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._names = [name for name, one in scenario.carriages.items() if one.joint == "sliding"]
        self._rows = np.array([[*scenario.vehicles].index(name) for name in self._names], np.intp)
        ropes = [scenario.of_rope(scenario.rope_of(scenario.carriages[name])) for name in self._names]
        own = zip(ropes, self._names, strict=True)
        self._low = np.array([stop_stroke(rope, scenario.carriages[name]) for rope, name in own])
        self._high = np.array([rope.cable.unstrained_length for rope in ropes]) - self._low
        self._before = np.zeros(len(self._names))  # m/s, speeds in the last frame; 0 at an end stop
        self._found: dict[int, tuple[float, float, float]] = {}  # speed (m/s), time (s) and place (m) by index

    def update(self, snapshot: Snapshot) -> None:
        """Update the speeds by one frame, in order of time."""
        columns = snapshot.columns
        places = columns.arc_length[self._rows]
        there = (places < self._low) | (places > self._high)
        if there.any():
            for row in np.flatnonzero(there & (self._before > LEAST)).tolist():
                speed = float(self._before[row])
                if speed > self._found.get(row, (0.0,))[0]:
                    self._found[row] = speed, snapshot.time, float(places[row])
        self._before = np.where(there, 0.0, np.abs(columns.speed[self._rows]))

    def figures(self) -> Iterator[KeyFigure]:
        """Yield the highest speed of each carriage that has run into an end stop."""
        for row, (speed, time, place) in sorted(self._found.items()):
            subject = Subject(f"carriages.{self._names[row]}", self._names[row])
            yield figure("end_stop_speed", subject, "highest", speed, time, f"arc length {place:.1f} m")
