"""Cost and motion here and in Exudyn's three-dimensional cable: gravity, and suddenly applied side forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.cases import ROPE_LENGTH, SPAN, ropeway
from benchmarks.exudyn_model import Setting, SpatialModel, load_exudyn
from benchmarks.measure import Effort, Timing, interleave, note_on_load
from benchmarks.report import Part, Table, Value
from cable_twin.frame.records import FloatArray
from cable_twin.mechanics.language.declared import write
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

OURS = "cable_twin"
FULL = Setting("Exudyn", True, 0.5, 8, modified=False)  # a new Jacobian in each iteration, as ours and as it comes
MODIFIED = Setting("Exudyn, modified Newton", True, 0.5, 8)
PUSH = 2000.0  # N sideways, at three places
LEAST = 12.0  # times as fast
NEAR = 1e-3  # of the span: most that the two may be apart
NOTES = [
    "`ANCFCable`, `NodePointSlope1`, `ObjectJointSliding` without held turns and a body of `NodeRigidBodyRxyz`, solved "
    "as in the part `exudyn`: sparse LU with its pattern kept, 4 Gauss points, one thread. Newton's method as it "
    "comes, with a new Jacobian in each iteration as ours, and the modified one that the part `exudyn` takes.",
    f"At rest under its weight, the rope is pushed sideways with {PUSH:g} N at each quarter of its length from the "
    "start on; the vehicle slides freely. Distance: largest between nodes, or between upper pivots, at the end of the "
    f"run; allowed are {NEAR * 1e3:g} mm per metre of span. Exudyn's joint in space is of first order in the step, and "
    "in the mesh, as no node follows it: ropes with a vehicle are 78, 36 and 18 mm apart with 100, 200 and 400 "
    "elements.",
    f"Ours has to be at least {LEAST:g} times as fast as Exudyn as it comes, by processor time.",
]


@dataclass(frozen=True, slots=True)
class Case:
    """Rope of 1 km."""

    elements: int
    vehicles: int
    duration: float  # s

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"1 km, {self.elements} elements, {'one moving vehicle' if self.vehicles else 'bare'}"


def pushed(case: Case) -> Simulation:
    """Rope at rest under its weight, with side forces just applied."""
    rest = {**ropeway(case.elements, max(case.vehicles, 1)).model_dump(exclude_unset=True), "space": 3}
    if not case.vehicles:
        rest["carriages"] = {}
    length = ROPE_LENGTH / case.elements
    places = [part * case.elements // 4 * length for part in (1, 2, 3)]
    loads = [{"arc_length": place, "force": [0.0, PUSH, 0.0]} for place in places]
    still, simulation = Simulation(load_scenario(rest)), Simulation(load_scenario(rest, {"cable.loads": loads}))
    full = simulation.capture()
    write(still.state, full.state)
    simulation.restore(full)
    return simulation


class Contestant:
    """One program on one case, with the state at the end of its last run."""

    def __init__(self, case: Case, exudyn: Any = None, setting: Setting | None = None) -> None:
        self._case, self._exudyn, self._setting = case, exudyn, setting
        self.nodes: FloatArray = np.zeros((0, 3))
        self.vehicles: dict[str, FloatArray] = {}
        self.iterations = 0

    def prepare(self) -> Callable[[], None]:
        """Build the system at its start; the returned function runs it."""
        simulation = pushed(self._case)
        if self._setting is None:
            return lambda: self._run_ours(simulation)
        model = SpatialModel(self._exudyn, simulation, self._setting)
        return lambda: self._run_exudyn(model)

    def _run_ours(self, simulation: Simulation) -> None:
        snapshot = simulation.advance_to(self._case.duration)
        self.iterations = snapshot.solver.iterations
        # at the nodes of Exudyn: one of ours follows the vehicle
        self.nodes = simulation.cable_positions(np.linspace(0.0, ROPE_LENGTH, self._case.elements + 1))
        self.vehicles = {name: state.position for name, state in snapshot.carriages.items()}

    def _run_exudyn(self, model: SpatialModel) -> None:
        model.run(self._case.duration)
        self.iterations, self.nodes, self.vehicles = model.iterations, model.shape(), model.positions()


def run(effort: Effort, progress: Progress) -> Part:
    """Run every case with both programs."""
    exudyn = load_exudyn()
    if exudyn is None:
        note = "Exudyn is not installed: `pip install '.[bench]'` makes this part."
        return Part("Exudyn in space", [Table("none", [{"case": "none"}])], [note])
    duration = 1.0 if effort.quick else 5.0
    cases = [Case(elements, vehicles, duration) for elements in (100, 200) for vehicles in (0, 1)]
    times: list[dict[str, Value]] = []
    distances: list[dict[str, Value]] = []
    faults: list[str] = []
    shares: list[Timing] = []
    for case in cases[:2] if effort.quick else cases:
        contestants = {OURS: Contestant(case)}
        contestants |= {setting.name: Contestant(case, exudyn, setting) for setting in (FULL, MODIFIED)}
        prepared = {name: contestant.prepare for name, contestant in contestants.items()}
        timings = interleave(prepared, effort.repetitions, progress, case.name)
        shares += timings.values()
        times.append(_times(case, contestants, timings))
        distances.append(_distances(case, contestants))
        faults += _faults(times[-1], distances[-1], effort.quick)
    title = f"{duration:g} s in steps of 10 ms"
    tables = [Table(title, times), Table("at the end", distances)]
    return Part("Exudyn in space", tables, [*NOTES, note_on_load(shares)], faults)


def _times(case: Case, contestants: dict[str, Contestant], timings: dict[str, Timing]) -> dict[str, Value]:
    """Cost of a step of one case."""
    steps, spent = round(case.duration / 0.01), {name: timing.processor for name, timing in timings.items()}
    return {
        "case": case.name,
        **{f"{name} [µs]": time / steps * 1e6 for name, time in spent.items()},
        "iterations": "/".join(f"{contestant.iterations / steps:.1f}" for contestant in contestants.values()),
        **{f"faster than {setting.name} [times]": spent[setting.name] / spent[OURS] for setting in (FULL, MODIFIED)},
    }


def _distances(case: Case, contestants: dict[str, Contestant]) -> dict[str, Value]:
    """Distances between the motions of one case."""
    ours, *others = contestants.values()
    ropes = [float(np.linalg.norm(ours.nodes - other.nodes, axis=1).max()) for other in others]
    pairs = [(place, other.vehicles[name]) for other in others for name, place in ours.vehicles.items()]
    joints = [float(np.linalg.norm(here - there)) for here, there in pairs]
    return {
        "case": case.name,
        "moved sideways [m]": float(np.abs(ours.nodes[:, 1]).max()),
        "ropes apart [mm]": max(ropes) * 1e3,
        "vehicles apart [mm]": max(joints) * 1e3 if joints else None,
        "allowed [mm]": NEAR * SPAN * 1e3,
    }


def _faults(times: dict[str, Value], distances: dict[str, Value], quick: bool) -> list[str]:
    """Exceeded limits, a line each; times of a quick run are not judged."""
    found = [
        f"exudyn_space: {distances['case']}: {key} is {distances[key]:.3g}, allowed: {distances['allowed [mm]']:g}"
        for key in ("ropes apart [mm]", "vehicles apart [mm]")
        if distances[key] is not None and not float(distances[key] or 0.0) <= float(distances["allowed [mm]"] or 0.0)
    ]
    faster = float(times[f"faster than {FULL.name} [times]"] or 0.0)
    if not quick and faster < LEAST:
        found.append(f"exudyn_space: {times['case']}: {faster:.3g} times as fast, allowed: {LEAST:g} or more")
    return found
