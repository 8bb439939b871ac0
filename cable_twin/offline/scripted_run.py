"""Scripted run of a simulation, as fast as possible and recorded as by the node; simulation of a log at its start."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from io import BytesIO

from cable_twin.frame.rates import LOGGED
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import KEY_FIGURES, topics
from cable_twin.messages.figure_messages import figures_message
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.offline.course import EndedError, Outcome, course
from cable_twin.offline.script import ScriptedCommand
from cable_twin.recording.frame_output import FrameOutput
from cable_twin.recording.log_reader import Log
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.recording.run import Run
from cable_twin.scenario import load_scenario
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
