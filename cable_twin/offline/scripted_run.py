"""A simulation as fast as it goes, with the commands of a script, recorded as the node records."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from cable_twin.command_messages import applied_command_message
from cable_twin.figure_messages import figures_message
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import KEY_FIGURES, MessageEncoder, Schedule, nanoseconds, topics
from cable_twin.offline.script import ScriptedCommand, commands_ahead
from cable_twin.rates import LOGGED
from cable_twin.recording.run import Run
from cable_twin.records import AppliedCommand, CommandError
from cable_twin.simulation import Simulation, SolverError
from cable_twin.snapshot import Snapshot

BACKLOG = 500  # frames that may wait for the disk
FIGURES_PERIOD = 10.0  # s of simulated time between two records of the key figures


@dataclass(slots=True)
class Outcome:
    """What came of a run."""

    time: float = 0.0  # s, simulated
    wall_time: float = 0.0  # s
    applied: int = 0
    refused: list[str] = field(default_factory=list)  # a line each
    past: int = 0  # commands before the start
    left: int = 0  # commands at or after the end
    fault: str = ""  # why it ended early


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

    A command takes effect at the solver step nearest to its time, after the frame of that time. Where the simulation
    comes from a snapshot, those of before are part of its state and are not given again.

    Args:
        simulation: At its start, or as it was loaded.
        script: Commands in the order of time.
        duration: s, from the present time on.
        frame_steps: Solver steps in a frame.
        epoch_ns: ns since 1970 of simulated time zero, as given to `Run.begin`.
        run: Where it is recorded, or None.
        figures: Take in what is seen, or None.
        on_frame: Called with the simulated time (s) of each frame.
        ended: Whether to end before `duration`.
        rates: Hz by group of topics, at which they are recorded; every frame where there is none.

    Returns:
        How far it came, and what was refused.
    """
    output = None if run is None else _Output(simulation, run, figures, epoch_ns, frame_steps, rates)
    first = round(simulation.time / simulation.step)  # solver steps that are done
    given = list(script)
    waiting = deque(commands_ahead(simulation, given))
    outcome = Outcome(past=len(given) - len(waiting))
    started = time.monotonic()
    frames = math.ceil(round(duration / simulation.step) / frame_steps)
    try:
        for frame in range(frames + 1):
            due = first + frame * frame_steps
            while waiting and round(waiting[0].time / simulation.step) < due:
                item = waiting.popleft()
                simulation.advance_to(item.time)
                applied = _apply(simulation, item, outcome, epoch_ns, run)
                if figures is not None and applied is not None:
                    figures.command(applied)
            snapshot = simulation.advance_to(due * simulation.step)
            if figures is not None:
                figures.update(snapshot)
            if output is not None:
                output.record(snapshot)
            if on_frame is not None:
                on_frame(snapshot.time)
            if ended is not None and ended():
                outcome.fault = "ended by a signal"
                break
    except SolverError as error:
        outcome.fault = str(error)
    if output is not None:
        output.record_figures()
    outcome.left = len(waiting)
    outcome.time, outcome.wall_time = simulation.time, time.monotonic() - started
    return outcome


class _Output:
    """The log of a run: messages that are due with each frame, and the key figures now and then."""

    def __init__(
        self,
        simulation: Simulation,
        run: Run,
        figures: KeyFigures | None,
        epoch_ns: int,
        frame_steps: int,
        rates: Mapping[str, float],
    ) -> None:
        self._simulation, self._run, self._figures = simulation, run, figures
        self._encoder = MessageEncoder(simulation.layout, epoch_ns)
        self._schedule = Schedule(topics(simulation.layout), 1.0 / (frame_steps * simulation.step), rates)
        self._frame = 0
        self._figures_due = simulation.time + FIGURES_PERIOD

    def record(self, snapshot: Snapshot) -> None:
        """Hand over a frame; waits where the disk is slower than the solver."""
        recorder = self._run.recorder
        split = recorder.split_due(snapshot.time)
        if split:
            recorder.split(self._simulation.capture())
        due = self._schedule.due(self._frame, everything=split)
        self._frame += 1
        recorder.record(self._encoder.frame(snapshot, due.names), self._encoder.stamp_ns(snapshot), snapshot)
        if split or snapshot.time >= self._figures_due:
            self._figures_due = snapshot.time + FIGURES_PERIOD
            self.record_figures()
        while recorder.backlog > BACKLOG:  # as fast as it goes is not faster than the disk
            time.sleep(0.002)

    def record_figures(self) -> None:
        """Hand over the key figures as they are now."""
        if self._figures is not None:
            stamp_ns = self._encoder.stamp_ns(self._simulation.snapshot)
            message = figures_message(self._figures.figures(), stamp_ns)
            self._run.recorder.record([(KEY_FIGURES, message)], stamp_ns)


def _apply(
    simulation: Simulation, item: ScriptedCommand, outcome: Outcome, epoch_ns: int, run: Run | None
) -> AppliedCommand | None:
    """Give one command and record it; a refused one is noted."""
    try:
        applied = simulation.apply(item.command, item.source)
    except CommandError as error:
        outcome.refused.append(f"{item.place}: {error}")
        return None
    outcome.applied += 1
    if run is not None:
        stamp_ns = epoch_ns + nanoseconds(applied.time)
        run.recorder.record_command(applied, applied_command_message(applied, epoch_ns), stamp_ns)
    return applied
