"""Simulation as fast as possible, with the commands of a script, recorded as by the node; start of a recorded run."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from math import copysign

from cable_twin.frame.rates import LOGGED
from cable_twin.frame.records import AppliedCommand, CommandError, RefusedCommand
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import KEY_FIGURES, topics
from cable_twin.messages.figure_messages import figures_message
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.offline.script import ScriptedCommand, commands_ahead
from cable_twin.recording.frame_output import FrameOutput
from cable_twin.recording.log_reader import Log
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.recording.run import Run
from cable_twin.scenario import load_scenario
from cable_twin.simulation import SAMPLES, Meanwhile, Simulation, SnapshotError, SolverError

BACKLOG = 500  # frames that may wait for the disk
FASTER = 5.0  # m/s by which nothing gets faster within a frame
FIGURES_PERIOD = 10.0  # s of simulated time between two records of the key figures


class _EndedError(Exception):
    """End of a run before its time, on request."""


@dataclass(slots=True)
class Outcome:
    """Result of a scripted run."""

    time: float = 0.0  # s, simulated
    wall_time: float = 0.0  # s
    applied: int = 0
    refused: list[str] = field(default_factory=list)  # a line each
    past: int = 0  # commands before the start
    left: int = 0  # commands at or after the end
    not_reached: list[str] = field(default_factory=list)  # a line for each place that was not passed
    fault: str = ""  # reason of an early end


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
    """Run a simulation with its script, and record it as the node does.

    A command takes effect at the solver step nearest to its time, after the frame of that time, or at the first step
    at which its place is reached, which frames have no part in. Where the simulation
    comes from a snapshot, earlier commands are part of its state and are not given again.

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
        Its end, and commands that were refused or not carried out.
    """
    frame_rate = 1.0 / (frame_steps * simulation.step)
    table = (*topics(simulation.layout), *sensor_topics(simulation.scenario))
    output = FrameOutput(simulation, table, [rates], frame_rate=frame_rate, run=run, epoch_ns=epoch_ns, backlog=BACKLOG)
    figures_due = simulation.time + FIGURES_PERIOD
    first = round(simulation.time / simulation.step)  # solver steps that are done
    given = list(script)
    ahead = commands_ahead(simulation, given)
    waiting, places = deque(item for item in ahead if item.at is None), PlaceWatch(item for item in ahead if item.at)
    outcome = Outcome(past=len(given) - len(ahead))

    def look() -> None:
        if ended is not None and ended():
            raise _EndedError

    def give(item: ScriptedCommand) -> None:
        applied = _apply(simulation, item, outcome, output)
        if figures is not None and applied is not None:
            figures.command(applied)

    def advance_to(time: float) -> Snapshot:
        """Advance to a time, step by step where a place may be reached."""
        while places.near(simulation, max(time - simulation.time, 0.0)):
            for item in places.reached(simulation):
                give(item)
            if simulation.time >= time - 0.5 * simulation.step:
                break
            simulation.advance_to(simulation.time + simulation.step, look)
        return simulation.advance_to(time, look)

    started = time.monotonic()
    frames = math.ceil(round(duration / simulation.step) / frame_steps)
    try:
        for frame in range(frames + 1):
            due = first + frame * frame_steps
            while waiting and round(waiting[0].time / simulation.step) < due:
                item = waiting.popleft()
                advance_to(item.time)
                give(item)
            snapshot = advance_to(due * simulation.step)
            if figures is not None:
                figures.update(snapshot)
            if run is not None:
                prepared = output.prepare(snapshot)
                output.record(prepared)
                if prepared.split is not None or snapshot.time >= figures_due:
                    figures_due = snapshot.time + FIGURES_PERIOD
                    _record_figures(output, snapshot, figures)
            if on_frame is not None:
                on_frame(snapshot.time)
            look()
    except _EndedError:
        outcome.fault = "ended by a signal"
    except SolverError as error:
        outcome.fault = str(error)
    _record_figures(output, simulation.snapshot, figures)
    outcome.left, outcome.not_reached = len(waiting), places.left
    outcome.time, outcome.wall_time = simulation.time, time.monotonic() - started
    return outcome


def _record_figures(output: FrameOutput, snapshot: Snapshot, figures: KeyFigures | None) -> None:
    """Record the present key figures."""
    if output.run is not None and figures is not None:
        stamp_ns = output.encoder.stamp_ns(snapshot)
        output.run.recorder.record([(KEY_FIGURES, figures_message(figures.figures(), stamp_ns))], stamp_ns)


def _apply(
    simulation: Simulation, item: ScriptedCommand, outcome: Outcome, output: FrameOutput
) -> AppliedCommand | None:
    """Apply one command and record it; a refusal is recorded, too."""
    try:
        applied = simulation.apply(item.command, item.source)
    except CommandError as error:
        outcome.refused.append(f"{item.place}: {error}")
        output.refusal(RefusedCommand(simulation.time, item.source, str(error), len(outcome.refused)))
        return None
    outcome.applied += 1
    output.command(applied)
    return applied


class PlaceWatch:
    """Commands that wait for a place; each is given once.

    Args:
        script: those with a place; each waits from its time on.
    """

    def __init__(self, script: Iterable[ScriptedCommand]) -> None:
        self._waiting: list[tuple[ScriptedCommand, float]] = []  # with the side on which it was, 0 where not looked at
        self._later = sorted(script, key=lambda item: item.time)

    @property
    def left(self) -> list[str]:
        """Messages about commands whose place has not been reached."""
        waiting = [*(item for item, _ in self._waiting), *self._later]
        return [f"{one.place}: '{one.at.name}' has not passed {one.at.position:g} m" for one in waiting if one.at]

    def reached(self, simulation: Simulation) -> list[ScriptedCommand]:
        """Commands whose place has been reached since the last call, removed from the waiting ones."""
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

    def near(self, simulation: Simulation, duration: float) -> bool:
        """Whether a place may be reached within `duration` (s), and each step has to be checked."""
        if self._later and self._later[0].time <= simulation.time + duration:
            return True
        for item, _ in self._waiting:
            distance, speed = _distance(item, simulation)
            if abs(distance) <= (abs(speed) + FASTER) * duration:
                return True
        return False


def _half(simulation: Simulation) -> float:
    """Half the rope length (m): a vehicle whose place jumps by more has changed to the other strand."""
    return 0.5 * simulation.scenario.cable.unstrained_length


def _distance(item: ScriptedCommand, simulation: Simulation) -> tuple[float, float]:
    """Distance (m) past the place of a command, negative before it, and speed (m/s)."""
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


def start_of(log: Log, *, samples: int = SAMPLES, meanwhile: Meanwhile | None = None) -> Simulation:
    """Build the simulation of a log: its scenario at the start, or in the attached state.

    Args:
        log: log of the run.
        samples: points of each rope in a snapshot.
        meanwhile: as of `Simulation`.

    Raises:
        ScenarioError, EquilibriumError, SnapshotError: it cannot be simulated.
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
