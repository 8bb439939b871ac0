"""Simulation of a recorded run at its start."""

from __future__ import annotations

from io import BytesIO

from cable_twin.recording.log_reader import Log
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.scenario import load_scenario
from cable_twin.simulation import SAMPLES, Meanwhile, Simulation, SnapshotError


def start_of(log: Log, *, samples: int = SAMPLES, meanwhile: Meanwhile | None = None) -> Simulation:
    """Build the simulation of a log: its scenario at the start, or in the attached state.

    Args:
        log: The run.
        samples: Points at which snapshots hold the cable.
        meanwhile: See `Simulation`.

    Raises:
        ScenarioError, EquilibriumError, SnapshotError: It cannot be simulated.
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


__all__ = ["start_of"]
