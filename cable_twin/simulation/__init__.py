"""One twin: the only owner of state and solver time, what commands do to it, and what it shows."""

from cable_twin.simulation.twin import SAMPLES, EquilibriumError, Meanwhile, Simulation, SnapshotError, SolverError

__all__ = ["SAMPLES", "EquilibriumError", "Meanwhile", "Simulation", "SnapshotError", "SolverError"]
