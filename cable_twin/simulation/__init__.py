"""One twin: only owner of state and solver time, effect of commands on it, and its snapshots."""

from cable_twin.simulation.twin import SAMPLES, EquilibriumError, Meanwhile, Simulation, SnapshotError, SolverError

__all__ = ["SAMPLES", "EquilibriumError", "Meanwhile", "Simulation", "SnapshotError", "SolverError"]
