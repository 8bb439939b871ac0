"""Cost of space: each shipped ropeway as shipped and with `space: 3`, on equal mesh and step, in turn."""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from rich.progress import Progress

from benchmarks.measure import Effort, Timing, median, note_on_load, timed
from benchmarks.report import Part, Table, Value
from benchmarks.yardstick import CASES, Case
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

TRIPS = {
    **CASES,
    "single_span": Case("single_span", "cabin", 6.0),
    "seed_example": Case("seed_example", "carriage", 0.0),
}
MOST_COST, LEAST_PACE = 2.5, 5.0  # times the planar solver; times real time
PIECE = 0.5  # s of simulated time in a turn
NOTES = [
    f"Whole steps of the default integrator on one thread, in turns of {PIECE:g} s of simulated time: a quotient is "
    "the median of those of neighbouring turns, by processor time. The wind is what the scenario has, along the track.",
    f"Allowed: {MOST_COST:g} times the planar solver, and at least {LEAST_PACE:g} times real time in space.",
]


@dataclass(frozen=True, slots=True)
class Turn:
    """Times of one turn, in the plane and in space."""

    plane: Timing
    space: Timing


def run(effort: Effort, progress: Progress) -> Part:
    """Measure all shipped ropeways."""
    names = ["single_span"] if effort.quick else [*TRIPS]
    turns = 4 if effort.quick else 8 * effort.repetitions
    task = progress.add_task("plane and space", total=len(names) * turns)
    rows: list[dict[str, Value]] = []
    faults, shares = [], []
    for name in names:
        runs = {"plane": _under_way(name, 2), "space": _under_way(name, 3)}
        done: list[Turn] = []
        for _ in range(turns):
            done.append(Turn(**{kind: _piece(simulation) for kind, simulation in runs.items()}))
            progress.advance(task)
        shares += [median([turn.plane for turn in done]), median([turn.space for turn in done])]
        rows.append(_row(name, runs["space"], done))
        if not effort.quick:
            faults += _faults(rows[-1])
    return Part("Space", [Table("cost of space", rows)], [*NOTES, note_on_load(shares)], faults)


def _under_way(name: str, dim: int) -> Simulation:
    """Simulation of a ropeway under way, with compiled kernels."""
    trip = TRIPS[name]
    simulation = Simulation(load_scenario(name, {"space": dim}))
    if trip.speed:
        simulation.command(trip.drive, speed=trip.speed)
    simulation.advance_to(PIECE)
    return simulation


def _piece(simulation: Simulation) -> Timing:
    """Simulate a piece of the run."""
    end = simulation.time + PIECE
    return timed(lambda: simulation.advance_to(end))


def _row(name: str, simulation: Simulation, turns: list[Turn]) -> dict[str, Value]:
    steps = round(PIECE / simulation.step)
    plane, space = (statistics.median(getattr(turn, kind).processor for turn in turns) for kind in ("plane", "space"))
    return {
        "scenario": name,
        "elements": simulation.system.cable.element_count,
        "vehicles": simulation.system.carriages.fixed.size,
        "plane, per step [µs]": plane / steps * 1e6,
        "space, per step [µs]": space / steps * 1e6,
        "space, times the plane": statistics.median(turn.space.processor / turn.plane.processor for turn in turns),
        "space, times real time": PIECE / space,
    }


def _faults(row: dict[str, Value]) -> list[str]:
    """Exceeded limits, a line each."""
    cost, pace = float(row["space, times the plane"] or 0.0), float(row["space, times real time"] or 0.0)
    found = []
    if cost > MOST_COST:
        found.append(f"space: {row['scenario']}: times the plane is {cost:.3g}, allowed: {MOST_COST:g}")
    if pace < LEAST_PACE:
        found.append(f"space: {row['scenario']}: times real time is {pace:.3g}, allowed: {LEAST_PACE:g} or more")
    return found
