"""Key figures of couplings between ropes: contact force of pantographs, pull of connectors and of clamps."""

from __future__ import annotations

from math import nan, sqrt

import numpy as np

from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures.figure import KeyFigure
from cable_twin.scenario import Scenario

UNFILTERED = "sampled at every frame, unfiltered; EN 50318 filters it with a low-pass of 20 Hz"


class CouplingFigures:
    """Running statistics of pantograph, connector and clamp forces, in memory independent of the length of the run.

    Args:
        scenario: what runs.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._pantographs, self._connectors = list(scenario.pantographs), list(scenario.connectors)
        count = len(self._pantographs)
        self._frames = 0
        self._mean, self._squares = np.zeros(count), np.zeros(count)  # N, and sum of squared distances from it, N²
        self._lost = np.zeros(count)  # frames without contact
        self._extremes = np.full((count, 2, 3), nan)  # lowest and highest: N, s, m along the track
        self._pull = np.full((len(self._connectors), 2), nan)  # highest: N, s
        self._slack = np.zeros(len(self._connectors))  # s
        vehicles, carriers = list(scenario.vehicles), scenario.carriers
        riders = vehicles[len(scenario.carriages) :] if carriers and carriers.tracks else []
        clamped = [name for name, one in scenario.carriages.items() if one.clamped_to]
        self._groups = [[name] for name in clamped] + ([riders] if riders else [])  # those of one figure
        self._group_names = clamped + ([carriers.name] if carriers and riders else [])
        self._clamps = clamped + riders
        self._clamp_rows = np.array([vehicles.index(name) for name in self._clamps], np.int64)
        self._along = np.full((len(self._clamps), 3), nan)  # highest: N, s, m
        self._last = nan  # s

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        if not (self._pantographs or self._connectors or self._clamps):
            return
        c, time = snapshot.columns, snapshot.time
        force, place = c.pantograph_force, c.pantograph_position[:, 0]
        self._frames += 1
        apart = force - self._mean
        self._mean += apart / self._frames  # Welford 1962
        self._squares += apart * (force - self._mean)
        self._lost += force <= 0.0
        for row, (value, x) in enumerate(zip(force.tolist(), place.tolist(), strict=True)):
            low, high = self._extremes[row]
            if not value >= low[0]:
                low[:] = value, time, x
            if not value <= high[0]:
                high[:] = value, time, x
        higher = ~(c.connector_force <= self._pull[:, 0])
        self._pull[higher] = np.stack([c.connector_force[higher], np.full(int(higher.sum()), time)], axis=1)
        along, places = abs(c.drive_force[self._clamp_rows]), c.arc_length[self._clamp_rows]
        higher = ~(along <= self._along[:, 0])
        self._along[higher] = np.stack([along, np.full(along.size, time), places], axis=1)[higher]
        if time > self._last:
            self._slack += (time - self._last) * (c.connector_force <= 0.0)
        self._last = time

    def figures(self) -> list[KeyFigure]:
        """Return the figures of all pantographs, clamps and connectors; none before the first snapshot."""
        if not self._frames:
            return []
        found = []
        for row, name in enumerate(self._pantographs):
            deviation = sqrt(self._squares[row] / self._frames)
            low, high = self._extremes[row].tolist()
            share = 100.0 * float(self._lost[row]) / self._frames
            found += [
                KeyFigure(f"{name}: contact force, mean", float(self._mean[row]), "N", self._last, band=UNFILTERED),
                KeyFigure(f"{name}: contact force, standard deviation", deviation, "N", self._last, band=UNFILTERED),
                KeyFigure(
                    f"{name}: contact force, highest", high[0], "N", high[1], f"x {high[2]:.1f} m", band=UNFILTERED
                ),
                KeyFigure(f"{name}: contact force, lowest", low[0], "N", low[1], f"x {low[2]:.1f} m", band=UNFILTERED),
                KeyFigure(f"{name}: loss of contact, share of the time", share, "%", self._last, band=UNFILTERED),
            ]
        for name, group in zip(self._group_names, self._groups, strict=True):
            rows = [self._clamps.index(one) for one in group]
            worst = rows[int(np.argmax(self._along[rows, 0]))]
            force, time, place = self._along[worst].tolist()
            which = f"{self._clamps[worst]}, " if len(group) > 1 else ""
            label = f"{name}: pull of {'the' if which else 'its'} clamp along the track, highest"
            found.append(KeyFigure(label, force, "N", time, f"{which}arc length {place:.1f} m"))
        if self._connectors:
            most, longest = int(np.argmax(self._pull[:, 0])), int(np.argmax(self._slack))
            pull, time = self._pull[most].tolist()
            found.append(KeyFigure("connectors: pull, highest", pull, "N", time, self._connectors[most]))
            slack = float(self._slack[longest])
            found.append(
                KeyFigure("connectors: slack, longest in all", slack, "s", self._last, self._connectors[longest])
            )
        return found


__all__ = ["CouplingFigures"]
