"""A scripted run with its log, and the frames of which the log holds the snapshots."""

from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import topics
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.recording.log_reader import read_log, read_snapshots
from cable_twin.recording.run import start_run
from cable_twin.recording.splitting import HOURLY
from cable_twin.simulation import Simulation

EPOCH = 1_700_000_000_123_456_789  # ns


def record(directory, scenario, script, duration, period=0.01, rerun="none", splitting=HOURLY, **options):
    """Record a run with frames every `period` (s), of whose script nothing is refused; its log, and its frames.

    The script has commands, or pairs of time (s) and command.
    """
    script = [one if isinstance(one, ScriptedCommand) else ScriptedCommand(*one, "script", "") for one in script]
    simulation = Simulation(scenario)
    run = start_run(
        simulation,
        topics(simulation.layout),
        record_directory=directory,
        frame_period=period,
        rerun=rerun,
        splitting=splitting,
    )
    run.begin(EPOCH)
    frames = []
    outcome = simulate(
        simulation,
        script,
        duration=duration,
        frame_steps=round(period / simulation.step),
        epoch_ns=EPOCH,
        run=run,
        figures=KeyFigures(scenario),
        on_frame=lambda _: frames.append(simulation.snapshot),
        **options,
    )
    run.recorder.close()
    assert (outcome.refused, outcome.fault, run.recorder.faults, run.recorder.dropped) == ([], "", [], 0)
    assert outcome.applied + outcome.left == len(script)
    return run.directory, frames


def snapshots_of(log):
    """Snapshots of a log in its order."""
    return [item for item in read_snapshots(read_log(log)) if isinstance(item, Snapshot)]
