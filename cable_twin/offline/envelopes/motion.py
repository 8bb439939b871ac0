"""Load cases in motion: a scripted run from rest, with a search for the worst moment of an emergency stop in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.records import Command
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import FigureId, KeyFigure, KeyFigures
from cable_twin.offline.envelopes.ranges import RangeCollector
from cable_twin.offline.envelopes.search import Search
from cable_twin.offline.script import ScriptedCommand, ScriptError, read_script
from cable_twin.offline.scripted_run import simulate
from cable_twin.scenario import Scenario
from cable_twin.scenario.checks.fault import show
from cable_twin.simulation import Simulation, SolverError

KEYS, OF_STOP = ("script", "duration", "stop"), ("from", "to", "points", "settle", "figures")
AFTER = 60.0  # s of a run after its last command
FRAME = 0.02  # s, between two looks at the key figures, and of a moment of a stop
POINTS, SETTLE = 40, 15.0  # moments of the coarse grid, and s after each stop


class Stop(NamedTuple):
    """Settings of the search for the worst moment of an emergency stop within a run.

    Attributes:
        first: s, earliest moment.
        last: s, latest moment.
        points: moments of the coarse grid.
        settle: s of simulated time after each stop.
        figures: ids of the key figures whose worst moment is sought.
    """

    first: float
    last: float
    points: int
    settle: float
    figures: tuple[str, ...]


class Dynamic(NamedTuple):
    """Load case in motion: a scripted run from rest, or emergency stops within it.

    Attributes:
        script: commands of the run.
        duration: s.
        stop: search for the worst emergency stop; None for the run as it is.
    """

    script: tuple[ScriptedCommand, ...]
    duration: float
    stop: Stop | None

    @property
    def inputs(self) -> list[Any]:
        """Commands, duration and stop of a load case in motion, for the hash that identifies its stored result."""
        commands = [[one.time, repr(one.command), one.at] for one in self.script]
        return [commands, self.duration, self.stop]


class DynamicError(ValueError):
    """Errors in a load case's entries for its run or its search for the worst, one line each."""


def read_dynamic(given: Any, directory: Path, scenario: Scenario) -> Dynamic:
    """Read the run of a load case from the mapping `dynamic` in its file.

    Args:
        given: the mapping.
        directory: of the file, to which paths are relative.
        scenario: of the case.

    Raises:
        DynamicError: the mapping is not valid.
    """
    if not isinstance(given, Mapping) or not isinstance(given.get("script"), str):
        raise DynamicError(f"dynamic: given {show(given)}; allowed: a mapping with script, and {', '.join(KEYS[1:])}")
    _known("dynamic", given, KEYS)
    try:
        script = tuple(read_script(directory / given["script"], scenario))
    except ScriptError as error:
        raise DynamicError("\n".join(f"dynamic.script: {line}" for line in str(error).splitlines())) from None
    end = (script[-1].time if script else 0.0) + AFTER
    duration = _number("dynamic.duration", given.get("duration", end), 0.0)
    stop = given.get("stop")
    if stop is None:
        return Dynamic(script, duration, None)
    if not isinstance(stop, Mapping) or not isinstance(stop.get("figures"), list) or not stop["figures"]:
        raise DynamicError(f"dynamic.stop: given {show(stop)}; allowed: a mapping with figures, a list of their ids")
    _known("dynamic.stop", stop, OF_STOP)
    figures = read_figures("dynamic.stop.figures", stop["figures"])
    first = _number("dynamic.stop.from", stop.get("from", 0.0), 0.0)
    last = _number("dynamic.stop.to", stop.get("to", duration), first)
    points = _number("dynamic.stop.points", stop.get("points", POINTS), 3)
    settle = _number("dynamic.stop.settle", stop.get("settle", SETTLE), 0.0)
    if last <= first or settle <= 0.0 or points != int(points):
        raise DynamicError(
            f"dynamic.stop: given from {first:g}, to {last:g} s, settle {settle:g} s, points {points:g}; allowed: from "
            "less than to, settle above 0 s, points a whole number"
        )
    return Dynamic(script, duration, Stop(first, last, int(points), settle, figures))


def read_figures(path: str, given: Sequence[Any]) -> tuple[str, ...]:
    """Read ids of key figures for a search for their worst values.

    Raises:
        DynamicError: a text is no id, or its figure has no worst value; one line.
    """
    try:
        statistics = {str(one): FigureId.of_text(str(one)).statistic for one in given}
    except ValueError as error:
        raise DynamicError(f"{path}: {error}") from None
    if other := [one for one, statistic in statistics.items() if statistic not in ("highest", "lowest")]:
        raise DynamicError(f"{path}: given {other[0]!r}; allowed: ids of key figures that end in /highest or /lowest")
    return tuple(statistics)


def _known(path: str, given: Mapping[str, Any], keys: Sequence[str]) -> None:
    if unknown := [key for key in given if key not in keys]:
        raise DynamicError(f"{path}.{unknown[0]}: this key does not exist; allowed: {', '.join(keys)}")


def _number(path: str, given: Any, least: float) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not least <= given < np.inf:
        raise DynamicError(f"{path}: given {show(given)}; allowed: a number from {least:g}")
    return float(given)


class Course(NamedTuple):
    """Course of a run: times (s) of its frames, and the place (m) of its drive or first vehicle at each."""

    times: list[float]
    places: list[float]

    def place(self, time: float) -> float:
        """Place (m) of the drive or first vehicle of a run at a time (s), interpolated."""
        return float(np.interp(time, self.times, self.places))


def run_dynamic(
    scenario: Scenario, dynamic: Dynamic, ranges: RangeCollector | None = None
) -> tuple[list[KeyFigure], str]:
    """Key figures of a load case in motion, or of the worst stops within it, and the reason of an early end.

    The `time` of a figure has the place (m) of the vehicle, as in a line at rest; its `place` has the time.

    Args:
        scenario: of the case.
        dynamic: its run.
        ranges: takes the frames from which the figures are; None: nothing does.

    Raises:
        EquilibriumError: the case has no equilibrium to begin at.
    """
    if dynamic.stop is not None:
        search = StopSearch(scenario, dynamic, dynamic.stop, ranges)
        return search.figures(), search.fault
    simulation, figures, course = Simulation(scenario, on_demand=True), KeyFigures(scenario), Course([], [])
    fault = _go(simulation, dynamic.script, dynamic.duration, figures, course, ranges)
    return [_at(one, course, "") for one in figures.figures()], fault


def _go(
    simulation: Simulation,
    script: Sequence[ScriptedCommand],
    duration: float,
    figures: KeyFigures | None,
    course: Course,
    ranges: RangeCollector | None = None,
    on_frame: Callable[[float], object] = lambda _: None,
) -> str:
    """Run the simulation of a load case with a script for a duration (s); returns the reason of an early end."""

    def look(time: float) -> None:
        course.times.append(time)
        course.places.append(_place(simulation.snapshot))
        if ranges is not None:
            ranges.take(simulation.snapshot)
        on_frame(time)

    steps = max(round(FRAME / simulation.step), 1)
    outcome = simulate(
        simulation, script, duration=duration, frame_steps=steps, epoch_ns=0, figures=figures, on_frame=look
    )
    return outcome.fault or "; ".join(outcome.refused[:1])


def _place(snapshot: Snapshot) -> float:
    """Place (m) of the drive of a moving cable, else of the first vehicle."""
    columns = snapshot.columns
    if columns.drive_position.size:
        return float(columns.drive_position[0])
    return float(columns.arc_length[0]) if columns.arc_length.size else 0.0


def _at(figure: KeyFigure, course: Course, what: str) -> KeyFigure:
    """Copy of a key figure of a run with the vehicle's place (m) in its `time`, and its time in the text `place`."""
    words = ", ".join(filter(None, (figure.place, f"at {figure.time:.2f} s", what)))
    return replace(figure, time=course.place(figure.time), place=words)


class StopSearch(Search):
    """Search for the worst moments of an emergency stop in a run: a coarse grid, then bounded searches at its peaks.

    The run goes once up to the last moment, and its state is kept at each moment of the grid; a stop begins from the
    last state kept before.

    Args:
        scenario: of the case.
        dynamic: its run.
        stop: range and key figures of the search.
        ranges: takes the frames after each stop; None: nothing does.

    Attributes:
        fault: reason of an early end of a run; empty for none.
    """

    def __init__(self, scenario: Scenario, dynamic: Dynamic, stop: Stop, ranges: RangeCollector | None = None) -> None:
        self._scenario, self._script, self._stop, self._ranges = scenario, dynamic.script, stop, ranges
        self._simulation = Simulation(scenario, on_demand=True)
        frame = max(round(FRAME / self._simulation.step), 1) * self._simulation.step
        super().__init__(self._stopped_at, frame, "dynamic.stop")
        self._course, self._states = Course([], []), {0.0: self._simulation.capture()}
        moments = np.linspace(stop.first, stop.last, stop.points)
        grid = sorted({round(round(time / frame) * frame, 9) for time in moments.tolist()})
        due = list(grid)

        def keep(time: float) -> None:
            if due and time >= due[0] - 0.5 * frame:
                self._states[due.pop(0)] = self._simulation.capture()

        self.fault = _go(self._simulation, self._script, stop.last + frame, None, self._course, on_frame=keep)
        for time in grid:
            self.at(time)
        for figure in stop.figures:
            self.refine(figure, grid)

    def _stopped_at(self, time: float) -> Mapping[str, KeyFigure]:
        """Key figures by id after an emergency stop at a moment (s) of the run."""
        simulation = self._simulation
        before = max(one for one in self._states if one <= time + 1e-9)
        simulation.restore(self._states[before])
        here, aside = simulation.time, Course([], [])
        if time - here > 0.5 * simulation.step:
            self.fault = self.fault or _go(simulation, self._script, time - here, None, aside)
        figures = KeyFigures(self._scenario)
        stopped = ScriptedCommand(simulation.time, Command("emergency_stop", {}), "", "")
        try:
            self.fault = self.fault or _go(simulation, [stopped], self._stop.settle, figures, aside, self._ranges)
        except SolverError as error:
            self.fault = self.fault or str(error)
        what = f"stop at {time:.2f} s, {self._course.place(time):.1f} m"
        return {str(one.id): _at(one, aside, what) for one in figures.figures()}
