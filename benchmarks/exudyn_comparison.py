"""Cost of a step here and in Exudyn: equal mesh, step, spectral radius and start, in turn in one process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.cases import ropeway, seed_example
from benchmarks.exudyn_model import ACCURATE, DEFAULT_JOINT, ExudynModel, Setting, load_exudyn
from benchmarks.measure import Effort, Timing, interleave, note_on_load
from benchmarks.report import Part, Table, Value
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation

OURS = "cable_twin"
NOTES = [
    "Exudyn: variant without range checks, generalized-alpha of index 3 with our spectral radius, modified Newton, "
    "Newton tolerance 1e-6 relative and absolute, Eigen's sparse LU with its pattern kept (faster on every case here "
    "than its dense ones), as many Gauss points as ours, one thread, no files.",
    "*Default joint* is `ObjectJointSliding2D` as it comes. Its motion is of first order in the step: the distance "
    "halves with the step, so that it is no agreement of two solutions and has no tolerance here. *Accurate joint* is "
    "the same with `useClassicalFormulation=False`; its distance to ours has to be within what the table allows.",
    "Iterations: Newton iterations in a step. Time per element and iteration and how much ours is faster are of "
    "processor time, real time is of wall time. Distance: largest between the joints of one carriage in both programs "
    "at the end of the run.",
]


@dataclass(frozen=True, slots=True)
class Case:
    """System that both programs run."""

    name: str
    scenario: Scenario
    duration: float  # s
    allowed: float  # m, between the joints in both programs at the end


def cases(quick: bool) -> list[Case]:
    """Systems to compare; tolerances are of the size of the error of the step, and of Exudyn's mesh at carriages.

    A node of ours follows each carriage. Exudyn's joint has none, so that it holds its carriage too high and pulls it
    along the rope: carriages that roll freely are 6.8, 4.5 and 4.1 mm from ours after 0.5 s with 100, 200 and 400
    elements, 97 and 69 mm after 5 s with 100 and 200.
    """
    seed = [Case(f"seed example, {n} elements", seed_example(n), 0.1 if quick else 1.0, 1e-3) for n in (24, 96)]
    sizes = ((100, 10), (200, 10), (200, 40))
    lines = [
        Case(f"ropeway, {n} elements, {m} carriages", ropeway(n, m), *((0.5, 1e-2) if quick else (5.0, 0.15)))
        for n, m in sizes
    ]
    return [seed[0], lines[0]] if quick else [*seed, *lines]


class Contestant:
    """One program on one case, with the result of its last run."""

    def __init__(self, case: Case, exudyn: Any = None, setting: Setting | None = None) -> None:
        self._case, self._exudyn, self._setting = case, exudyn, setting
        self.positions: dict[str, np.ndarray] = {}
        self.iterations = 0

    def prepare(self) -> Callable[[], None]:
        """Build the system at its start; the returned function runs it."""
        simulation = Simulation(self._case.scenario)
        if self._setting is None:
            return lambda: self._run_ours(simulation)
        model = ExudynModel(self._exudyn, simulation, self._setting)
        return lambda: self._run_exudyn(model)

    def _run_ours(self, simulation: Simulation) -> None:
        snapshot = simulation.advance_to(self._case.duration)
        self.iterations = snapshot.solver.iterations
        self.positions = {name: state.position for name, state in snapshot.carriages.items()}

    def _run_exudyn(self, model: ExudynModel) -> None:
        model.run(self._case.duration)
        self.iterations, self.positions = model.iterations, model.positions()


def run(effort: Effort, progress: Progress) -> Part:
    """Run every case with every contestant."""
    exudyn = load_exudyn()
    settings = {} if exudyn is None else {setting.name: setting for setting in (DEFAULT_JOINT, ACCURATE)}
    tables: list[Table] = []
    summary: list[dict[str, Value]] = []
    faults: list[str] = []
    shares: list[Timing] = []
    for case in cases(effort.quick):
        contestants = {OURS: Contestant(case)}
        contestants |= {name: Contestant(case, exudyn, setting) for name, setting in settings.items()}
        prepared = {name: contestant.prepare for name, contestant in contestants.items()}
        timings = interleave(prepared, effort.repetitions, progress, case.name)
        shares += timings.values()
        rows: list[dict[str, Value]] = []
        for name, contestant in contestants.items():
            apart = max(
                float(np.linalg.norm(place - contestants[OURS].positions[key]))
                for key, place in contestant.positions.items()
            )
            allowed = case.allowed if name == ACCURATE.name else None
            if allowed is not None and not apart <= allowed:
                faults.append(
                    f"{case.name}: {name} is {apart * 1e3:.3g} mm from {OURS} after {case.duration:g} s, allowed are "
                    f"{allowed * 1e3:g} mm: the two do not compute the same motion, their times do not compare"
                )
            rows.append(_row(case, name, contestant.iterations, timings[name], timings[OURS]))
            rows[-1]["distance [mm]"] = None if name == OURS else apart * 1e3
            rows[-1]["allowed [mm]"] = None if allowed is None else allowed * 1e3
        summary.append(_summary(case, rows))
        tables.append(
            Table(f"{case.name}, {case.duration:g} s in steps of {case.scenario.solver.step * 1e3:g} ms", rows)
        )
    notes = NOTES if exudyn is not None else ["Exudyn is not installed: `pip install '.[bench]'` adds its rows."]
    return Part("Cost of a step", [Table("summary", summary), *tables], [*notes, note_on_load(shares)], faults)


def _summary(case: Case, rows: list[dict[str, Value]]) -> dict[str, Value]:
    """Summary of a case in one line: cost here, and the ratio for each setting of Exudyn."""
    ours, *others = rows
    return {
        "case": case.name,
        "step [ms]": case.scenario.solver.step * 1e3,
        "wall per step [µs]": ours["wall per step [µs]"],
        "processor [µs]": ours["processor [µs]"],
        "real time [times]": ours["real time [times]"],
        **{f"faster than {row['program']} [times]": row["ours faster [times]"] for row in others},
    }


def _row(case: Case, name: str, iterations: int, timing: Timing, ours: Timing) -> dict[str, Value]:
    solver, elements = case.scenario.solver, case.scenario.cable.elements
    steps = round(case.duration / solver.step)
    return {
        "program": name,
        "wall per step [µs]": timing.wall / steps * 1e6,
        "processor [µs]": timing.processor / steps * 1e6,
        "iterations": iterations / steps,
        "per element, iteration [µs]": timing.processor / iterations / elements * 1e6,
        "real time [times]": case.duration / timing.wall,
        "ours faster [times]": timing.processor / ours.processor,
    }
