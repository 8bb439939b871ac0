"""Scripted run of a simulation: its course with the commands, the recorded run, and the start of that of a log."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from math import copysign
from typing import Protocol

from cable_twin.frame.rates import LOGGED
from cable_twin.frame.records import AppliedCommand, Command, CommandError, RefusedCommand
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import KEY_FIGURES, topics
from cable_twin.messages.figure_messages import figures_message
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.offline.script import ScriptedCommand, commands_ahead
from cable_twin.recording.frame_output import FrameOutput
from cable_twin.recording.log_reader import Log
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.recording.run import Run
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import SAMPLES, Meanwhile, Simulation, SnapshotError, SolverError

BACKLOG = 500  # frames that may wait for the disk
FIGURES_PERIOD = 10.0  # s of simulated time between two records of the key figures


def simulate(
    simulation: Simulation,
    script: Iterable[ScriptedCommand],
    *,
    duration: float,
    frame_steps: int,
    epoch_ns: int,
    run: Run | None = None,
    figures: KeyFigures | None = None,
    on_frame: Callable[[float], None] | None = None,
    ended: Callable[[], bool] | None = None,
    rates: Mapping[str, float] = LOGGED,
) -> Outcome:
    """Run a simulation with a script of commands, and record it as the ROS 2 node records a live run.

    Commands take effect as in `course`.

    Args:
        simulation: simulation at its start, or a loaded one.
        script: commands in the order of time.
        duration: s, from the present time on.
        frame_steps: solver steps in a frame.
        epoch_ns: ns since 1970 of simulated time zero, as given to `Run.begin`.
        run: recorder of the run, or None.
        figures: collector of key figures, or None.
        on_frame: called with the simulated time (s) of each frame.
        ended: condition for an end before `duration`.
        rates: recorded rates (Hz) by group of topics; every frame for other groups.

    Returns:
        Outcome with the end of the run, and commands that were refused or not carried out.
    """
    frame_rate = 1.0 / (frame_steps * simulation.step)
    table = (*topics(simulation.layout), *sensor_topics(simulation.scenario))
    output = FrameOutput(simulation, table, [rates], frame_rate=frame_rate, run=run, epoch_ns=epoch_ns, backlog=BACKLOG)
    figures_due = simulation.time + FIGURES_PERIOD

    def look() -> None:
        if ended is not None and ended():
            raise EndedError

    def take(snapshot: Snapshot) -> None:
        nonlocal figures_due
        if run is not None:
            prepared = output.prepare(snapshot)
            output.record(prepared)
            if prepared.split is not None or snapshot.time >= figures_due:
                figures_due = snapshot.time + FIGURES_PERIOD
                _record_figures(output, snapshot, figures)
        if on_frame is not None:
            on_frame(snapshot.time)
        look()

    times = course(
        simulation,
        script,
        duration=duration,
        frame_steps=frame_steps,
        figures=figures,
        on_frame=take,
        on_applied=output.command,
        on_refused=output.refusal,
    )
    try:
        time = next(times)
        while True:
            time = _go_on(times, simulation, time, look)
    except StopIteration as end:
        outcome: Outcome = end.value
    _record_figures(output, simulation.snapshot, figures)
    return outcome


def _go_on(
    times: Generator[float, None, Outcome], simulation: Simulation, time: float, look: Callable[[], None]
) -> float:
    """Advance a simulation to a time (s) of its scripted course; returns the next time."""
    try:
        simulation.advance_to(time, look)
    except (SolverError, EndedError) as error:
        return times.throw(error)
    return next(times)


def _record_figures(output: FrameOutput, snapshot: Snapshot, figures: KeyFigures | None) -> None:
    """Record the key figures of the run so far in its log, if any, stamped with the time of a snapshot."""
    if output.run is not None and figures is not None:
        stamp_ns = output.encoder.stamp_ns(snapshot)
        output.run.recorder.record([(KEY_FIGURES, figures_message(figures.figures(), stamp_ns))], stamp_ns)


def start_of(log: Log, *, samples: int = SAMPLES, meanwhile: Meanwhile | None = None) -> Simulation:
    """Build the simulation of a log at its start: its scenario at rest, or in the attached full state.

    Args:
        log: log of the run.
        samples: points of each rope in a snapshot.
        meanwhile: as for `Simulation`.

    Raises:
        ScenarioError, EquilibriumError, SnapshotError: the log cannot be simulated.
    """
    if log.snapshot is None:
        return Simulation(load_scenario(log.scenario), samples=samples, meanwhile=meanwhile)
    if not log.snapshot:
        raise SnapshotError(
            f"{log.path}: the run started from a snapshot, and {SNAPSHOT_NAME} is no longer attached: "
            "its messages can be read, and nothing replayed"
        )
    try:
        return Simulation.load(BytesIO(log.snapshot), samples=samples, meanwhile=meanwhile)
    except SnapshotError as error:
        raise SnapshotError(f"{log.path}: {error}") from None


FASTER = 5.0  # m/s by which nothing gets faster within a frame


class EndedError(Exception):
    """Early end of a scripted run on request, as by a signal."""


class Scripted(Protocol):
    """Interface of a simulation that a script drives."""

    scenario: Scenario

    @property
    def layout(self) -> Layout:
        """Layout of a snapshot: names and array indices of the values in it."""

    @property
    def step(self) -> float:
        """Solver step (s)."""

    @property
    def time(self) -> float:
        """Simulated time (s)."""

    @property
    def snapshot(self) -> Snapshot:
        """Snapshot of the present state."""

    def apply(self, command: Command, source: str = ...) -> AppliedCommand:
        """Apply a command to the simulation; raises CommandError where refused."""


@dataclass(slots=True)
class Outcome:
    """Result of a scripted run: times, counts of commands, refusals, reason of an early end."""

    time: float = 0.0  # s, simulated
    wall_time: float = 0.0  # s
    applied: int = 0
    refused: list[str] = field(default_factory=list)  # a line each
    past: int = 0  # commands before the start
    left: int = 0  # commands at or after the end
    not_reached: list[str] = field(default_factory=list)  # a line for each place that was not passed
    fault: str = ""  # reason of an early end


def course(
    simulation: Scripted,
    script: Iterable[ScriptedCommand],
    *,
    duration: float,
    frame_steps: int,
    figures: KeyFigures | None = None,
    on_frame: Callable[[Snapshot], object] | None = None,
    on_applied: Callable[[AppliedCommand], object] | None = None,
    on_refused: Callable[[RefusedCommand], object] | None = None,
) -> Generator[float, None, Outcome]:
    """Yield times (s) up to which the caller advances a simulation, with the commands of a script in between.

    A command takes effect at the solver step nearest to its time, after the frame of that time, or at the first step
    at which its place is reached, whatever the frames are. Where the simulation comes from a snapshot, earlier
    commands are part of its state and are not given again. The caller throws `SolverError` or `EndedError` into the
    generator where the simulation does not reach the time.

    Args:
        simulation: simulation at its start, or a loaded one.
        script: commands in the order of time.
        duration: s, from the present time on.
        frame_steps: solver steps in a frame.
        figures: collector of key figures, or None.
        on_frame: called with the snapshot of each frame.
        on_applied: called after each command.
        on_refused: called for each refused command.

    Returns:
        Outcome with the end of the run, and commands that were refused or not carried out.
    """
    first = round(simulation.time / simulation.step)  # solver steps that are done
    given = list(script)
    ahead = commands_ahead(given, simulation.time, simulation.step)
    waiting, places = deque(item for item in ahead if item.at is None), PlaceWatch(item for item in ahead if item.at)
    outcome = Outcome(past=len(given) - len(ahead))

    def give(item: ScriptedCommand) -> None:
        try:
            applied = simulation.apply(item.command, item.source)
        except CommandError as error:
            outcome.refused.append(f"{item.place}: {error}")
            if on_refused is not None:
                on_refused(RefusedCommand(simulation.time, item.source, str(error), len(outcome.refused)))
            return
        outcome.applied += 1
        if on_applied is not None:
            on_applied(applied)
        if figures is not None:
            figures.command(applied)

    def advance_to(time: float) -> Generator[float, None, Snapshot]:
        """Advance the simulation to a time (s), step by step where the place of a command may be reached."""
        while places.near(simulation, max(time - simulation.time, 0.0)):
            for item in places.reached(simulation):
                give(item)
            if simulation.time >= time - 0.5 * simulation.step:
                break
            yield simulation.time + simulation.step
        yield time
        return simulation.snapshot

    started = time.monotonic()
    frames = math.ceil(round(duration / simulation.step) / frame_steps)
    try:
        for frame in range(frames + 1):
            due = first + frame * frame_steps
            while waiting and round(waiting[0].time / simulation.step) < due:
                item = waiting.popleft()
                yield from advance_to(item.time)
                give(item)
            snapshot = yield from advance_to(due * simulation.step)
            if figures is not None:
                figures.update(snapshot)
            if on_frame is not None:
                on_frame(snapshot)
    except EndedError:
        outcome.fault = "ended by a signal"
    except SolverError as error:
        outcome.fault = str(error)
    outcome.left, outcome.not_reached = len(waiting), places.left
    outcome.time, outcome.wall_time = simulation.time, time.monotonic() - started
    return outcome


class PlaceWatch:
    """Monitor of scripted commands that a vehicle or drive triggers, once each, by passing a place.

    Args:
        script: commands with a place; each waits from its time on.
    """

    def __init__(self, script: Iterable[ScriptedCommand]) -> None:
        self._waiting: list[tuple[ScriptedCommand, float]] = []  # with the side on which it was, 0 where not looked at
        self._later = sorted(script, key=lambda item: item.time)

    @property
    def left(self) -> list[str]:
        """Messages about scripted commands whose place has not been reached."""
        waiting = [*(item for item, _ in self._waiting), *self._later]
        return [f"{one.place}: '{one.at.name}' has not passed {one.at.position:g} m" for one in waiting if one.at]

    def reached(self, simulation: Scripted) -> list[ScriptedCommand]:
        """Remove and return the waiting scripted commands whose place has been reached since the last call."""
        while self._later and self._later[0].time <= simulation.time + 0.5 * simulation.step:
            self._waiting.append((self._later.pop(0), 0.0))
        found, waiting = [], []
        for item, before in self._waiting:
            distance = _distance(item, simulation)[0]
            if distance == 0.0 or (distance * before < 0.0 and abs(distance - before) < _half(simulation)):
                found.append(item)
            else:
                waiting.append((item, distance))
        self._waiting = waiting
        return found

    def near(self, simulation: Scripted, duration: float) -> bool:
        """Whether the place of a command may be reached within `duration` (s), so that each step must be checked."""
        if self._later and self._later[0].time <= simulation.time + duration:
            return True
        for item, _ in self._waiting:
            distance, speed = _distance(item, simulation)
            if abs(distance) <= (abs(speed) + FASTER) * duration:
                return True
        return False


def _half(simulation: Scripted) -> float:
    """Half the length (m) of the first rope: a vehicle whose place jumps by more has changed to the other strand."""
    return 0.5 * simulation.scenario.cable.unstrained_length


def _distance(item: ScriptedCommand, simulation: Scripted) -> tuple[float, float]:
    """Distance (m) of a vehicle or drive past the place of a command, negative before it, and its speed (m/s)."""
    assert item.at is not None
    columns, layout = simulation.snapshot.columns, simulation.layout
    name, position = item.at
    if (row := layout.drive_rows.get(name)) is not None:
        return float(columns.drive_position[row]) - position, float(columns.drive_speed[row])
    row = layout.vehicle_rows[name]
    place = float(columns.arc_length[row])
    if not columns.attached[row]:  # in a station: on neither side
        return copysign(_half(simulation) + abs(place - position), place - position), 0.0
    return place - position, float(columns.speed[row])
