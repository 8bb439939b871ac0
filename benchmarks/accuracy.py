"""Cost of accuracy: wall time of one simulated second of the seed example against the error at its end."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from rich.progress import Progress

from benchmarks.cases import seed_example
from benchmarks.exudyn_model import ACCURATE, DEFAULT_JOINT, ExudynModel, Setting, load_exudyn
from benchmarks.measure import Effort, Timing, median, note_on_load, timed
from benchmarks.report import Part, Table, Value
from cable_twin.frame.records import FloatArray
from cable_twin.simulation import Simulation, SolverError

TIME = 1.0  # s, at which the joint's place is compared
WANTED = 2e-3  # m
OURS = "cable_twin"
REFERENCE = {"elements": 384, "step": 1.25e-4}
HALF_REFERENCE = {"elements": 192, "step": 2.5e-4}
TIGHT = 1e-9  # m, Newton tolerance of the reference
STEPS = (0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3, 5e-3, 8e-3, 10e-3)  # s, whole parts of a second
MESHES = (12, 24, 32, 48, 64, 96)  # every other one for Exudyn
QUICK_MESHES, QUICK_STEPS = (12, 24), (1e-3, 2e-3)
PICTURE = "accuracy.png"
COLORS = {OURS: "#0072B2", DEFAULT_JOINT.name: "#CC79A7", ACCURATE.name: "#D55E00"}


@dataclass(frozen=True, slots=True)
class Choice:
    """One program with its model, mesh and step."""

    program: str
    elements: int
    step: float  # s
    spectral_radius: float  # -
    tolerance: float  # m for us, of the residual for Exudyn
    setting: Setting | None  # of Exudyn

    def prepare(self, exudyn: Any, out: list[FloatArray]) -> Callable[[], None]:
        """Build the system; the returned function runs it and writes the joint's place (3,) in m into `out`."""
        solver = {"step": self.step, "spectral_radius": self.spectral_radius}
        if self.setting is None:
            solver["tolerance"] = self.tolerance
        simulation = Simulation(seed_example(self.elements, **solver))
        if self.setting is None:
            return lambda: out.append(simulation.advance_to(TIME).carriages["carriage"].position)
        model = ExudynModel(exudyn, simulation, self.setting)

        def run() -> None:
            model.run(TIME)
            out.append(model.positions()["carriage"])

        return run


@dataclass(frozen=True, slots=True)
class Point:
    """Error and cost of one choice."""

    choice: Choice
    timing: Timing
    error: float  # m


def run(effort: Effort, progress: Progress) -> Part:
    """Measure all choices in turn, find the cheapest of each program that is accurate enough, and draw them."""
    exudyn = load_exudyn()
    reference = _place(REFERENCE)
    doubt = float(np.linalg.norm(reference - _place(HALF_REFERENCE)))
    choices = _choices(effort.quick, exudyn is not None)
    points = _measure(choices, exudyn, reference, min(effort.repetitions, 3), progress)
    rows = [_row(program, points) for program in dict.fromkeys(choice.program for choice in choices)]
    ours = next((row["processor [ms]"] for row in rows if row["program"] == OURS), None)
    for row in rows:
        cost = row["processor [ms]"]
        row["ours faster [times]"] = cost / ours if isinstance(cost, float) and isinstance(ours, float) else None
    notes = [
        f"Reference: ours on {REFERENCE['elements']} elements with steps of {REFERENCE['step'] * 1e3:g} ms; twice as "
        f"coarse in both it moves by {doubt * 1e3:.2g} mm.",
        f"A choice counts only when every smaller step on its mesh is within {WANTED * 1e3:g} mm as well, so that no "
        "lucky crossing wins; the least processor time is the cheapest. An empty row: no choice is accurate enough.",
        f"{len(points)} of {len(choices)} choices ran through; the others failed to converge.",
        note_on_load([point.timing for point in points]),
    ]
    title = f"Accuracy for the money: {WANTED * 1e3:g} mm at {TIME:g} s on the seed example"
    best = [Table("cheapest choice", rows), Table("cheapest choice of ours on each mesh", _by_mesh(points))]
    return Part(title, best, notes, pictures=_pictures(points))


def _choices(quick: bool, with_exudyn: bool) -> list[Choice]:
    """Grids of meshes and steps for each program."""
    meshes, steps = (QUICK_MESHES, QUICK_STEPS) if quick else (MESHES, STEPS)
    radii, tolerances = ((0.7,), (1e-8,)) if quick else ((0.5, 0.7, 0.9), (1e-8, 1e-5))
    choices = [Choice(OURS, *grid, None) for grid in product(meshes, steps, radii, tolerances)]
    if with_exudyn:
        choices += [
            Choice(setting.name, elements, step, 0.7, setting.tolerance, setting)
            for setting, elements, step in product((DEFAULT_JOINT, ACCURATE), meshes[1::2], steps)
        ]
    return choices


def _measure(
    choices: list[Choice], exudyn: Any, reference: FloatArray, repetitions: int, progress: Progress
) -> list[Point]:
    """Run all choices in rounds; a failing choice is left out of later rounds."""
    timings: dict[Choice, list[Timing]] = {choice: [] for choice in choices}
    errors: dict[Choice, float] = {}
    turns = [choice for _ in range(repetitions) for choice in choices]
    for choice in progress.track(turns, description="accuracy: elements, step, radius, tolerance"):
        if choice in timings:
            places: list[FloatArray] = []
            try:
                timings[choice].append(timed(choice.prepare(exudyn, places)))
                errors[choice] = float(np.linalg.norm(places[0] - reference))
            except (SolverError, RuntimeError, ValueError):  # the last two are Exudyn's
                del timings[choice]
    return [Point(choice, median(times), errors[choice]) for choice, times in timings.items()]


def _place(mesh: dict[str, Any]) -> FloatArray:
    """Place (3,) in m of the joint at the end, converged to a tight tolerance."""
    simulation = Simulation(seed_example(mesh["elements"], step=mesh["step"], tolerance=TIGHT))
    return simulation.advance_to(TIME).carriages["carriage"].position


def _meets(point: Point, points: list[Point]) -> bool:
    """Whether a choice is accurate enough, also with every smaller step."""

    def alike(choice: Choice) -> tuple:
        return choice.program, choice.elements, choice.spectral_radius, choice.tolerance

    return all(
        other.error <= WANTED
        for other in points
        if alike(other.choice) == alike(point.choice) and other.choice.step <= point.choice.step
    )


def _cheapest(points: list[Point], program: str) -> Point | None:
    good = [point for point in points if point.choice.program == program and _meets(point, points)]
    return min(good, key=lambda point: point.timing.processor, default=None)


def _describe(point: Point | None) -> dict[str, Value]:
    if point is None:
        keys = (
            "elements",
            "step [ms]",
            "spectral radius",
            "tolerance",
            "wall [ms]",
            "processor [ms]",
            "real time [times]",
            "error [mm]",
        )
        return dict.fromkeys(keys)
    choice = point.choice
    return {
        "elements": choice.elements,
        "step [ms]": choice.step * 1e3,
        "spectral radius": choice.spectral_radius,
        "tolerance": choice.tolerance,
        "wall [ms]": point.timing.wall * 1e3,
        "processor [ms]": point.timing.processor * 1e3,
        "real time [times]": TIME / point.timing.wall,
        "error [mm]": point.error * 1e3,
    }


def _row(program: str, points: list[Point]) -> dict[str, Value]:
    return {"program": program, **_describe(_cheapest(points, program))}


def _by_mesh(points: list[Point]) -> list[dict[str, Value]]:
    meshes = sorted({point.choice.elements for point in points if point.choice.program == OURS})
    rows: list[dict[str, Value]] = []
    for mesh in meshes:
        best = _cheapest([point for point in points if point.choice.elements == mesh], OURS)
        rows.append({**_describe(best), "elements": mesh})
    return rows


def _pictures(points: list[Point]) -> dict[str, bytes]:
    """Error over processor time of all choices, the best of each program joined; nothing without matplotlib."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 - optional
    except ImportError:
        return {}
    mpl.use("Agg")  # no screen needed
    import matplotlib.pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(figsize=(8.4, 5.2), layout="constrained")
    for program in dict.fromkeys(point.choice.program for point in points):
        own = sorted((p for p in points if p.choice.program == program), key=lambda point: point.timing.processor)
        x = np.array([point.timing.processor * 1e3 for point in own])
        y = np.array([point.error * 1e3 for point in own])
        axes.plot(x, y, ls="", marker="o", ms=4, alpha=0.3, color=COLORS[program])
        axes.step(x, np.minimum.accumulate(y), where="post", lw=2, color=COLORS[program], label=program)
    axes.axhline(WANTED * 1e3, color="#7B8794", lw=1, ls="--", label=f"{WANTED * 1e3:g} mm")
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel("processor time of one simulated second [ms]")
    axes.set_ylabel(f"error of the joint's place at {TIME:g} s [mm]")
    axes.set_title("Seed example: what accuracy costs", loc="left")
    axes.grid(which="major", color="#E3E8EC")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    plt.close(figure)
    return {PICTURE: buffer.getvalue()}
