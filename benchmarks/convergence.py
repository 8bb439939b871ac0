"""Error of the default scenario against a finer one: a start, a ride and an emergency stop, over elements and step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rich.progress import Progress

from benchmarks.measure import Effort, Timing, timed
from benchmarks.report import Part, Table, Value
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

SCENARIO, CARRIAGE = "single_span", "cabin"
SPEED = 7.0  # m/s
STOP, END = 40.0, 60.0  # s
SAMPLE = 0.05  # s
REFERENCE = (400, 0.001)  # elements, s
HALF_REFERENCE = (200, 0.002)
MESHES, STEPS = (50, 100, 200), (0.002, 0.005, 0.01)
QUICK_STEPS = (0.005,)


@dataclass(frozen=True, slots=True)
class Ride:
    """Samples of a ride on one mesh with one step."""

    places: FloatArray  # (samples, 3) m, centre of the lowest body
    tension: FloatArray  # (samples,) N, what the upper support holds
    swing: FloatArray  # (samples,) rad
    timing: Timing


def run(effort: Effort, progress: Progress) -> Part:
    """Ride on every mesh with every step, and compare."""
    grid = [(elements, step) for elements in MESHES for step in (QUICK_STEPS if effort.quick else STEPS)]
    turns = [REFERENCE, HALF_REFERENCE, *grid]
    rides = {turn: _ride(*turn) for turn in progress.track(turns, description="convergence: elements, step")}
    rows = [_row(turn, rides[turn], rides[REFERENCE]) for turn in (HALF_REFERENCE, *grid)]
    own = load_scenario(SCENARIO)
    chosen = f"{own.cable.elements} elements and steps of {own.solver.step * 1e3:g} ms"
    elements, step = REFERENCE
    return Part(
        f"Convergence of {SCENARIO}",
        [Table(f"largest differences from {elements} elements at {step * 1e3:g} ms, and costs", rows)],
        [
            f"From rest to {SPEED:g} m/s, at {STOP:g} s an emergency stop, {END:g} s in all, compared every "
            f"{SAMPLE * 1e3:g} ms: centre and pitch of the cabin, and the force that the upper support holds. "
            f"Its mean is {rides[REFERENCE].tension.mean() / 1e3:.0f} kN. The scenario has {chosen}.",
            "Processor time of one simulated second, a snapshot every 50 ms included; of one run each.",
        ],
    )


def _ride(elements: int, step: float) -> Ride:
    simulation = Simulation(load_scenario(SCENARIO, {"cable.elements": elements, "solver.step": step}))
    simulation.command(CARRIAGE, speed=SPEED)
    snapshots: list[Snapshot] = []

    def ride() -> None:
        for index in range(1, round(END / SAMPLE) + 1):
            if index == round(STOP / SAMPLE) + 1:
                simulation.emergency_stop()
            snapshots.append(simulation.advance_to(index * SAMPLE))

    timing = timed(ride)
    bodies = [list(snapshot.carriages[CARRIAGE].bodies.values())[-1] for snapshot in snapshots]
    return Ride(
        places=np.array([body.position for body in bodies]),
        tension=np.array([np.linalg.norm(snapshot.supports["end"].force) for snapshot in snapshots]),
        swing=np.array([body.pitch for body in bodies]),
        timing=timing,
    )


def _row(turn: tuple[int, float], ride: Ride, reference: Ride) -> dict[str, Value]:
    elements, step = turn
    tension = ride.tension - reference.tension
    return {
        "elements": elements,
        "step [ms]": step * 1e3,
        "place [mm]": float(np.linalg.norm(ride.places - reference.places, axis=1).max()) * 1e3,
        "swing [mrad]": float(np.abs(ride.swing - reference.swing).max()) * 1e3,
        "support force [kN]": float(np.abs(tension).max()) / 1e3,
        "root mean square [kN]": float(np.sqrt(np.mean(tension**2))) / 1e3,
        "support force [%]": float(np.abs(tension / reference.tension).max()) * 1e2,
        "processor [ms]": ride.timing.processor / END * 1e3,
        "real time [times]": END / ride.timing.wall,
    }
