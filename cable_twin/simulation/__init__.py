"""Simulation of a ropeway, the only owner of state and solver time: static start, steps, commands, snapshots."""

from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.simulation.snapshot_file import SnapshotError
from cable_twin.simulation.twin import SAMPLES, Meanwhile, Simulation, SolverError

__all__ = ["SAMPLES", "EquilibriumError", "Meanwhile", "Simulation", "SnapshotError", "SolverError"]
