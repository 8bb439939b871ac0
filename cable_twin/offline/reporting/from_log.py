"""Results of a recorded run for a report: one pass over its log, with the key figures and verdicts of `review`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from cable_twin.frame.commands import describe_command
from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.geometry.ground import heights_over_ground
from cable_twin.key_figures import supports_of
from cable_twin.offline.envelopes.ranges import SupportForces
from cable_twin.offline.reading import Reading
from cable_twin.offline.reporting.remarks import inputs_of
from cable_twin.offline.reporting.results import Results, RopeCourse, TowerLoad
from cable_twin.offline.reporting.rope_life import LifeCounter, RopeLife
from cable_twin.recording.log_reader import Log
from cable_twin.scenario import Scenario

PLACES = 600  # of x, at which the lowest height of a rope is kept
PROGRAM = (
    "package_version",
    "python_version",
    "numpy_version",
    "numba_version",
    "machine",
    "cpu",
)  # in metadata of a log
PERIOD = 0.1  # s between shapes that are looked at, as for clearances


class Course:
    """Collector of rope courses, rope life and highest tower loads from the snapshots that a log reader passes to it.

    Args:
        scenario: of the run.
        first: first snapshot of the run.
    """

    def __init__(self, scenario: Scenario, first: Snapshot) -> None:
        self._scenario, self._layout = scenario, first.layout
        self._life = LifeCounter(scenario, first.layout)
        self.commands: list[tuple[float, str]] = []
        self._next_look = -np.inf
        self._shape: FloatArray | None = None
        self._tension = np.full((2, first.layout.arc_lengths.size), np.nan)
        self._grids: dict[str, tuple[FloatArray, FloatArray, FloatArray]] = {}
        self._forces = SupportForces(len(first.layout.supports))

    def log(self, snapshot: Snapshot) -> None:
        """Add a snapshot of the run to courses, counts and loads."""
        self._life.log(snapshot)
        c = snapshot.columns
        self._forces.take(c.support_force)
        if np.isnan(c.rope_position[0, 0]):
            return  # the log does not hold the rope at this time
        self._tension[0] = np.fmin(self._tension[0], c.rope_tension)
        self._tension[1] = np.fmax(self._tension[1], c.rope_tension)
        if snapshot.time >= self._next_look:
            self._next_look = snapshot.time + PERIOD * (1.0 - 1e-9)
            self._look(c.rope_position)

    def log_command(self, applied: AppliedCommand) -> None:
        """Add an applied command of the run to the list of commands."""
        self.commands.append((applied.time, describe_command(applied)))

    def _look(self, position: FloatArray) -> None:
        """Update lowest heights and clearances of all ropes by their positions (samples, 3) in m."""
        if self._shape is None:
            self._shape = position.copy()
        for name, part in self._layout.ropes.items():
            points = position[part]
            if name not in self._grids:
                x = np.linspace(points[:, 0].min(), points[:, 0].max(), PLACES)
                self._grids[name] = x, np.full(PLACES, np.nan), np.full(PLACES, np.nan)
            take_heights(self._scenario, points, *self._grids[name])

    def ropes(self) -> list[RopeCourse]:
        """Courses of all ropes so far; empty where the log holds no rope shapes."""
        if self._shape is None:
            return []
        return [
            RopeCourse(
                name, self._layout.arc_lengths[part], self._shape[part], *self._grids[name], self._tension[:, part]
            )
            for name, part in self._layout.ropes.items()
        ]

    def lives(self) -> list[RopeLife]:
        """Bends and tension cycles of each rope so far, for its life."""
        return self._life.lives()

    def towers(self) -> list[TowerLoad]:
        """Forces of the ropes on all towers, each at the time of its highest and of its least load."""
        return tower_loads(self._scenario, self._layout, self._forces.most, self._forces.least)


def take_heights(scenario: Scenario, points: FloatArray, x: FloatArray, lowest: FloatArray, above: FloatArray) -> None:
    """Update a rope's lowest heights and clearances over x, in place, by one more shape of the rope.

    Args:
        scenario: with the terrain, if any.
        points: (n, 3) m, of the rope.
        x: (m,) m.
        lowest: (m,) m, lowest heights, changed in place.
        above: (m,) m, least heights over the terrain, changed in place.
    """
    order = np.argsort(points[:, 0], kind="stable")
    there = points[order, 0]
    np.fmin(lowest, np.interp(x, there, points[order, 2], left=np.nan, right=np.nan), out=lowest)
    if scenario.terrain:
        heights = heights_over_ground(scenario, points)[order]
        np.fmin(above, np.interp(x, there, heights, left=np.nan, right=np.nan), out=above)


def tower_loads(scenario: Scenario, layout: Layout, forces: FloatArray, least: FloatArray) -> list[TowerLoad]:
    """Forces of the ropes on towers, with places of the towers, from the forces on all supports.

    Args:
        scenario: of the towers.
        layout: of the forces.
        forces: (supports, 3) N, of the ropes on all supports, with the highest loads.
        least: (supports, 3) N, with the least loads.
    """
    places = scenario.tower_places
    subjects = supports_of(scenario)
    return [
        TowerLoad(subject.key, subject.name, np.array(places[subject.name]), forces[row], least[row])
        for row, subject in enumerate(subjects)
        if row in layout.tower_rows
    ]


def read_results(
    log: Log,
    on_position: Callable[[int], None],
    profiles: Sequence[str] | None = None,
    facts: Mapping[str, Any] | None = None,
    file: Path | None = None,
) -> Results:
    """Read the results of a recorded run for a report, in one pass over its log.

    Args:
        log: of the run.
        on_position: called with the bytes read so far.
        profiles: rule profiles in place of those of the scenario.
        facts: keys of `limits.installation` in place of those of the scenario.
        file: scenario file with its remarks; None for the shipped file of the scenario's name.

    Raises:
        LogError: the log holds no frame, or cannot be understood.
        ScenarioError: the file of the scenario cannot be read.
    """
    reading = Reading(log, on_position, profiles, facts)
    inputs = inputs_of(reading.scenario, file)  # before the log is read, which may take long
    course = Course(reading.scenario, reading.first)
    reading.view = course
    for _ in reading.values():
        pass
    made = datetime.fromtimestamp(1e-9 * log.epoch_ns, timezone.utc)
    said = {key: log.metadata.get(key, "?") for key in PROGRAM}
    package, python, numpy, numba, machine, cpu = said.values()
    sources = [
        ("log", reading.summary()),
        ("begin of the run", f"{made:%Y-%m-%d %H:%M:%S} UTC"),
        ("run made by", f"cable_twin {package}, Python {python}, numpy {numpy}, numba {numba}"),
        ("run made on", f"{machine}, kernels for {cpu}"),
    ]
    return Results(
        reading.scenario.name,
        reading.scenario,
        reading.figures,
        inputs,
        profiles=reading.profiles,
        verdicts=reading.verdicts,
        ropes=course.ropes(),
        towers=course.towers(),
        signals=reading.signals,
        commands=course.commands,
        lives=course.lives(),
        sources=sources,
        notes=[f"{fault}; --profile gives another one" for fault in reading.rule_faults],
    )
