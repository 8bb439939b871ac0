"""Cost of graded meshes over uniform ones, and the differences of key figures and rope shapes.

What they cost is measured on one strand where the unit has one: the scenarios of `test/one_strand`, with the elements
of the lifts. The trip: under way from rest, an emergency stop, and what comes after it. What all meshes
differ by from the even one of twice as many elements is shown beside, as the measure of what each is worth itself, also
that of the even one with the joint of the paper, whose elements round off the bends under vehicles.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.measure import ROOT, Effort
from benchmarks.report import Part, Table, Value
from benchmarks.yardstick import CASES, YARDSTICK, Case, contestants, yardstick_sources
from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

EVEN = {"chairlift": 600, "gondola": 800, "aerial_tramway": 260}  # elements before there were graded meshes
PIECE = 30.0  # s of simulated time in a turn
STOP, END = 40.0, 60.0  # s
FRAME = 0.02  # s, between looks
POINTS = 400  # along the rope
MOST_ELEMENTS, MOST_COST, MOST_FIGURE, MOST_SHAPE = 40.0, 45.0, 1.0, 5.0  # %, %, %, mm


@dataclass(frozen=True, slots=True)
class Trip:
    """Trip on one mesh."""

    elements: int
    figures: Mapping[str, float]
    shapes: Any  # (frames, POINTS, 3) m


def run(effort: Effort, progress: Progress) -> Part:
    """Cost and difference of all ropeways."""
    names = ["chairlift"] if effort.quick else [*CASES]
    task = progress.add_task("graded and even meshes", total=len(names) * (effort.repetitions + 4))
    rows, differences, faults = [], [], []
    with yardstick_sources() as (sources, note):
        for name in names:
            costs = _costs(name, effort, sources, lambda: progress.advance(task))
            trips = []
            even_ones = (
                {"elements": EVEN[name]},
                {"elements": 2 * EVEN[name]},
                {"elements": EVEN[name], "joint": "paper"},
            )
            for changes in ({}, *even_ones):
                trips.append(_trip(name, changes, 0.1 if effort.quick else 1.0))
                progress.advance(task)
            graded, even, fine, rounded = trips
            row: dict[str, Value] = {
                "scenario": name,
                "elements": graded.elements,
                "even mesh": even.elements,
                "elements [%]": 100.0 * graded.elements / even.elements,
                "measured on": "one strand" if _one_strand(name).is_file() else "the ropeway",
                f"of the cost of {YARDSTICK} [%]": 100.0 * costs,
            }
            rows.append(row)
            found = _difference(name, "graded, from even", graded, even)
            differences += [
                found,
                _difference(name, "graded, from twice as fine", graded, fine),
                _difference(name, "even, from twice as fine", even, fine),
                _difference(name, "even with the joint of the paper, from twice as fine", rounded, fine),
                _difference(name, "graded, from even with the joint of the paper", graded, rounded),
            ]
            faults += [] if effort.quick else _faults(row, found)
    notes = [
        note,
        "`chairlift` and `gondola` are loops of two strands now, where the unit has one strand of each: the cost is "
        "that of one strand too (`test/one_strand`), with the elements of the lifts.",
        "All meshes have nodes at loads, but where the joint of the paper is named.",
        "Key figures are those of the ropeway: what the solver says of its own losses is left out.",
        f"The trip: drive at the speed of the part `frame` from rest, emergency stop at {STOP:g} s, until {END:g} s. "
        f"Shapes are compared at {POINTS} places every {FRAME:g} s.",
        f"Allowed: {MOST_ELEMENTS:g} % of the elements, {MOST_COST:g} % of the cost, {MOST_FIGURE:g} % in a key "
        f"figure, {MOST_SHAPE:g} mm root mean square.",
    ]
    return Part("Graded meshes", [Table("cost", rows), Table("differences", differences)], notes, faults)


def _costs(name: str, effort: Effort, sources: Any, done: Any) -> float:
    """Solver time of the graded mesh over that of the reference commit, median over turns."""
    ratios = []
    with (
        contestants(("yardstick",), CASES[name], sources) as unit,
        contestants(("solver",), _like_the_unit(name), sources) as graded,
    ):
        running = {**unit, **graded}
        for _ in range(effort.repetitions):
            times = {kind: contestant.run(0.5 if effort.quick else PIECE) for kind, contestant in running.items()}
            ratios.append(times["solver"] / times["yardstick"])
            done()
    return statistics.median(ratios)


def _one_strand(name: str) -> Path:
    return ROOT / "test" / "one_strand" / f"{name}.yaml"


def _like_the_unit(name: str) -> Case:
    """Case with the elements and kinks that the ropeway has now, in the form of the reference commit."""
    if not _one_strand(name).is_file():
        return CASES[name]
    scenario = load_scenario(name)
    rope = next(iter(scenario.ropes.values()), scenario.cable)
    given = rope.model_dump(mode="json", include={"elements", "kinks"})
    changes = tuple(f"cable.{key}={json.dumps(value)}" for key, value in given.items())
    return replace(CASES[name], scenario=str(_one_strand(name)), changes=changes)


def _trip(name: str, changes: Mapping[str, Any], part: float) -> Trip:
    """Run the first `part` (0..1) of the trip with `changes` of keys of each rope."""
    case: Case = CASES[name]
    ropes = [f"ropes.{rope}" for rope in load_scenario(name).ropes] or ["cable"]
    scenario = load_scenario(name, {f"{rope}.{key}": value for rope in ropes for key, value in changes.items()})
    simulation, figures = Simulation(scenario), KeyFigures(scenario)
    arc_lengths = np.linspace(0.0, scenario.cable.unstrained_length, POINTS)
    shapes = []
    simulation.command(case.drive, speed=case.speed)
    stop, end = round(STOP * part / FRAME), round(END * part / FRAME)
    for frame in range(1, end + 1):
        figures.update(simulation.advance_to(frame * FRAME))
        shapes.append(simulation.cable_positions(arc_lengths))
        if frame == stop:
            simulation.emergency_stop()
    values = {
        figure.name: figure.value
        for figure in figures.figures()
        if np.isfinite(figure.value) and figure.id.quantity != "energy_lost"  # of the solver
    }
    return Trip(simulation.system.cable.element_count, values, np.array(shapes))


def _difference(name: str, mesh: str, trip: Trip, other: Trip) -> dict[str, Value]:
    """Distances between two trips."""
    apart = np.linalg.norm(trip.shapes - other.shapes, axis=2)
    figures = {
        figure: 100.0 * abs(trip.figures[figure] - value) / abs(value)
        for figure, value in other.figures.items()
        if figure in trip.figures and abs(value) > 0.0
    }
    worst = max(figures, key=figures.__getitem__)
    return {
        "scenario": name,
        "mesh": mesh,
        "elements": trip.elements,
        "shape, rms [mm]": 1e3 * float(np.sqrt(np.mean(apart**2))),
        "99 % [mm]": 1e3 * float(np.percentile(apart, 99)),
        "largest [mm]": 1e3 * float(apart.max()),
        "key figures": len(figures),
        "within 1 %": sum(value <= MOST_FIGURE for value in figures.values()),
        "largest [%]": figures[worst],
        "of": worst,
    }


def _faults(row: Mapping[str, Value], difference: Mapping[str, Value]) -> list[str]:
    """Exceeded limits, a line each."""
    cost = next(key for key in row if key.startswith("of the cost"))
    found = [
        f"graded: {row['scenario']}: {key} is {row[key]:.3g}, allowed: {most:g}"
        for key, most in (("elements [%]", MOST_ELEMENTS), (cost, MOST_COST))
        if float(row[key] or 0.0) > most
    ]
    found += [
        f"graded: {row['scenario']}: {key} is {difference[key]:.3g} ({difference['of']}), allowed: {most:g}"
        for key, most in (("shape, rms [mm]", MOST_SHAPE), ("largest [%]", MOST_FIGURE))
        if float(difference[key] or 0.0) > most
    ]
    return found
