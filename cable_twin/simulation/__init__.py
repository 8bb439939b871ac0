"""Twin: only owner of state and solver time, effects of commands on the state, and snapshots."""

from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.simulation.snapshot_file import SnapshotError
from cable_twin.simulation.twin import SAMPLES, Meanwhile, Simulation, SolverError

__all__ = ["SAMPLES", "EquilibriumError", "Meanwhile", "Simulation", "SnapshotError", "SolverError"]
