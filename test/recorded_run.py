"""A scripted run with its log, and the frames of which the log holds the snapshots."""

from cable_twin.key_figures import KeyFigures
from cable_twin.messages import topics
from cable_twin.offline.scripted_run import simulate
from cable_twin.recording.run import start_run
from cable_twin.simulation import Simulation

EPOCH = 1_700_000_000_123_456_789  # ns


def record(directory, scenario, script, duration, period=0.01, **options):
    """Record a run with frames every `period` (s), of whose script nothing is refused; its log, and its frames."""
    simulation = Simulation(scenario)
    table = topics(simulation.layout)
    run = start_run(simulation, table, record_directory=directory, frame_period=period, rerun="none")
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
    assert (outcome.applied, outcome.refused, outcome.fault, run.recorder.faults) == (len(script), [], "", [])
    return run.directory, frames
