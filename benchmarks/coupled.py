"""Coupled ropes under way: Newton iterations a step, solver cost, and how near one step is to the exact one.

Each step is taken twice from the same state, with the tolerance of the scenario and with one of 1e-10 m: the largest
distance between nodes of both is what the tolerance leaves. With `--beside PATH` another checkout runs in turn.
"""

from __future__ import annotations

import statistics
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np
from rich.progress import Progress

from benchmarks.loads import ROPEWAYS, python_of
from benchmarks.measure import ROOT, Effort
from benchmarks.report import Part, Table, Value
from benchmarks.yardstick import Contestant
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

LIFTS = ("chairlift", "gondola", "jig_back", "bicable")
BEGIN, PIECE, TURNS = 10.0, 10.0, 5  # s of a lift before it is under way; s of simulated time in a turn; turns
PANTOGRAPH = 0.5  # s, of the pantograph, which is 1389 elements at 1 ms
COMPARED = 400  # steps that are taken twice
EXACT = 1e-10  # m, tolerance of the second one
MOST_ITERATIONS = dict.fromkeys(LIFTS, 1.3) | {"pantograph": 1.1}  # a step
MOST_LEFT = 3.0  # of the tolerance, by a step
MOST_COST = 0.35  # of the other checkout


@dataclass(frozen=True, slots=True)
class Counted:
    """Newton iterations of one scenario, and what its tolerance leaves of a step."""

    step: float  # s
    tolerance: float  # m
    iterations: float  # a step
    left: float  # m


def under_way(name: str, **changes: float) -> Simulation:
    """Simulation of a scenario at working speed."""
    simulation = Simulation(load_scenario(name, {f"solver.{key}": value for key, value in changes.items()}))
    if name in ROPEWAYS:
        simulation.command(ROPEWAYS[name].drive, speed=ROPEWAYS[name].speed)
        simulation.advance_to(BEGIN)
    return simulation


def count(name: str, duration: float) -> Counted:
    """Iterations of a scenario over a `duration` (s), and the distance of its steps from exact ones."""
    simulation = under_way(name)
    solver = simulation.scenario.solver
    report = simulation.advance_to(simulation.time + duration).solver
    exact = under_way(name, tolerance=EXACT)
    left = 0.0
    for _ in range(COMPARED):
        exact.restore(replace(simulation.capture(), scenario=exact.scenario))
        for one in (simulation, exact):
            one.advance_to(one.time + one.step)
        pairs = zip(simulation.parts.values(), exact.parts.values(), strict=True)
        for part, other in pairs:
            apart = part.state.nodes.position[:, 0] - other.state.nodes.position[:, 0]
            left = max(left, float(np.linalg.norm(apart, axis=1).max()))
    return Counted(solver.step, solver.tolerance, report.iterations / report.steps, left)


def run(effort: Effort, progress: Progress) -> Part:
    """Iterations and cost of all coupled scenarios."""
    turns = 1 if effort.quick else max(TURNS, effort.repetitions)
    piece = 1.0 if effort.quick else PIECE
    names = ("chairlift",) if effort.quick else (*LIFTS, "pantograph")
    trees = {"here": ROOT} | ({} if effort.beside is None else {"beside": effort.beside})
    task = progress.add_task("coupled", total=len(names) * (1 + turns))
    rows: list[dict[str, Value]] = []
    faults = []
    for name in names:
        found = count(name, piece if name in ROPEWAYS else PANTOGRAPH)
        progress.advance(task)
        row: dict[str, Value] = {
            "scenario": name,
            "tolerance [m]": found.tolerance,
            "iterations a step": found.iterations,
            "left of a step [m]": found.left,
        }
        if found.iterations > MOST_ITERATIONS[name] and not effort.quick:
            faults.append(
                f"coupled: {name} takes {found.iterations:.2f} iterations, allowed: {MOST_ITERATIONS[name]:g}"
            )
        if found.left > MOST_LEFT * found.tolerance and not effort.quick:
            allowed = MOST_LEFT * found.tolerance
            faults.append(f"coupled: a step of {name} leaves {found.left:.2g} m, allowed: {allowed:.2g} m")
        times: dict[str, list[float]] = {tree: [] for tree in trees}
        if name in ROPEWAYS:
            with ExitStack() as stack:
                running = {}
                for tree, path in trees.items():
                    running[tree] = Contestant("solver", ROPEWAYS[name], path, python_of(path))
                    stack.callback(running[tree].close)
                    running[tree].wait()
                for turn in range(turns):
                    for tree in sorted(running, reverse=turn % 2 == 1):  # neither is always the first
                        times[tree].append(running[tree].run(piece))
                    progress.advance(task)
            row["a step [µs]"] = statistics.median(times["here"]) / piece * found.step * 1e6
        else:
            progress.advance(task, turns)
            row["a step [µs]"] = None
        if "beside" in trees:
            row["of the other checkout"] = None
        if times.get("beside"):
            ratio = statistics.median(a / b for a, b in zip(times["here"], times["beside"], strict=True))
            row["of the other checkout"] = ratio
            if ratio > MOST_COST and not effort.quick:
                faults.append(f"coupled: {name} costs {ratio:.3f} of the other checkout, allowed: {MOST_COST:g}")
        rows.append(row)
    notes = [
        f"Under way at working speed: Newton iterations over {piece:g} s; processor time of the solver, medians of "
        f"{turns} turns. Left of a step: largest distance of a node after one step from that with a tolerance of "
        f"{EXACT:g} m, from equal states, over {COMPARED} steps.",
        f"Allowed: {MOST_ITERATIONS['chairlift']:g} iterations a step of a lift, {MOST_ITERATIONS['pantograph']:g} of "
        f"the pantograph, {MOST_LEFT:g} times the tolerance left of a step, {MOST_COST:g} of the cost of the checkout "
        "before couplings were in the tangent.",
    ]
    return Part("Coupled ropes", [Table("steps of coupled ropes", rows)], notes, faults)
