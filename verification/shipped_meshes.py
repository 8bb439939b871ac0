"""Shipped scenarios on their meshes, on meshes of 0.6 of their elements, and on ones that are eight times finer.

`python -m verification.shipped_meshes` prints how far tensions and key figures are from those of the finest mesh, at
rest and over a short trip, and by how much drive and clamp forces at rest differ over meshes of nearly the same length.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from benchmarks.loads import EARLIER, ROPEWAYS
from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification import Result, case

FINER, FEWER = 8.0, 0.6  # times the elements
FRAME = 0.02  # s, between looks
TRIPS = {  # s: emergency stop and end of a trip, which takes a vehicle past a tower
    "aerial_tramway": (120.0, 150.0),
    "windy_tramway": (120.0, 150.0),
    "jig_back": (70.0, 90.0),
}
TRIP = (30.0, 45.0)  # s, of the others
MOST_TENSION, MOST_FIGURE, MOST_SPREAD = 0.1, 0.3, 0.2  # %
AROUND = np.linspace(0.9, 1.1, 16)  # times the elements of the shipped mesh
SPREAD = ("jig_back", "bicable")
SHOWN = 4  # figures that are farthest off
LEAST = 1e-6  # of any unit: a figure below that is rounding


@dataclass(frozen=True)
class Found:
    """Scenario on one mesh."""

    elements: int
    figures: Mapping[str, float]


def rope_keys(name: str) -> list[str]:
    """Keys of the ropes of a shipped scenario: `cable`, or `ropes.NAME`."""
    return list(EARLIER[name])


def shipped_elements(name: str) -> dict[str, Any]:
    """`elements` of each rope of a shipped scenario, by its key."""
    scenario = load_scenario(name)
    cables = {scenario.rope_key(rope): cable for rope, cable in scenario.cables.items()}
    return {key: cable.model_dump(mode="json", include={"elements"})["elements"] for key, cable in cables.items()}


def scaled(elements: Any, factor: float) -> Any:
    """A mesh of `factor` times the elements: all lengths by one over it, and the growth to that power."""
    if isinstance(elements, int):
        return max(round(elements * factor), 1)
    growth = max(elements["growth"] ** (1.0 / factor), 1.0001)
    lengths = {key: elements[key] / factor for key in ("target", "at_towers")}
    return {**lengths, "growth": min(growth, 4.0)}


def changed(name: str, factor: float, elements: Mapping[str, Any] | None = None) -> Simulation:
    """A shipped scenario with `factor` times the elements, of its own mesh or of another one."""
    base = shipped_elements(name) if elements is None else elements
    changes = {f"{rope}.elements": scaled(value, factor) for rope, value in base.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bends on short elements
        return Simulation(load_scenario(name, changes))


def elements_of(simulation: Simulation) -> int:
    """Count of the elements of all ropes."""
    return sum(part.system.cable.element_count for part in simulation.parts.values())


def figures_of(figures: KeyFigures) -> dict[str, float]:
    """Values by name; what the solver says of its own losses is left out."""
    return {
        figure.name: float(figure.value)
        for figure in figures.figures()
        if np.isfinite(figure.value) and figure.id.quantity != "energy_lost"
    }


def at_rest(simulation: Simulation, name: str) -> Found:
    """Key figures of the first frame."""
    figures = KeyFigures(simulation.scenario)
    figures.update(simulation.snapshot)
    return Found(elements_of(simulation), figures_of(figures))


def trip(simulation: Simulation, name: str) -> Found:
    """Key figures of a trip from rest that ends in an emergency stop."""
    case, figures, stopped = ROPEWAYS[name], KeyFigures(simulation.scenario), False
    stop, end = TRIPS.get(name, TRIP)
    figures.command(simulation.command(case.drive, speed=case.speed))
    for frame in range(1, round(end / FRAME) + 1):
        figures.update(simulation.advance_to(frame * FRAME))
        if not stopped and simulation.time >= stop:
            figures.command(simulation.emergency_stop())
            stopped = True
    return Found(elements_of(simulation), figures_of(figures))


def differences(found: Found, fine: Found) -> dict[str, float]:
    """Differences (%) of figures that both have, from those of the finer mesh; of a travel in % of a metre at least."""
    scales = {name: max(abs(value), 1.0 if "travel" in name else 0.0) for name, value in fine.figures.items()}
    return {
        name: 100.0 * (found.figures[name] - fine.figures[name]) / scale
        for name, scale in scales.items()
        if name in found.figures and scale > LEAST
    }


def tensions_of(off: Mapping[str, float]) -> dict[str, float]:
    """Those of the highest and lowest tension of ropes."""
    return {name: value for name, value in off.items() if "rope tension, " in name}


def spread(name: str) -> dict[str, list[float]]:
    """Drive and clamp forces (N) at rest over meshes around the shipped one; last that of the finest mesh."""
    forces: dict[str, list[float]] = {}
    for factor in [*AROUND, FINER]:
        for label, force in held(changed(name, float(factor))).items():
            forces.setdefault(label, []).append(force)
    return forces


def held(simulation: Simulation) -> dict[str, float]:
    """Forces (N) at rest of the drive at its rim, and of clamps along the track rope."""
    columns, layout = simulation.snapshot.columns, simulation.layout
    names = (*layout.carriages, *layout.carriers)
    row = list(simulation.scenario.sheaves).index("drive")
    forces = {"drive": float(columns.sheave_force[row])}
    for vehicle in np.flatnonzero((columns.attached == 1.0) & np.isfinite(columns.haul_force)):
        forces[f"clamp of {names[vehicle]}"] = float(columns.haul_force[vehicle])
    return forces


@case("jig-back and bicable lift at rest", "the same on 16 meshes", needs_jit=True, long=True)
def forces_over_meshes() -> Iterator[Result]:
    """Largest difference of drive and clamp forces from their means."""
    for name in SPREAD:
        off = {"drive": 0.0, "clamp": 0.0}
        for label, forces in spread(name).items():
            if len(forces) == len(AROUND) + 1:
                values, part = np.array(forces[:-1]), label.split()[0]
                off[part] = max(off[part], float(np.abs(values / values.mean() - 1.0).max()))
        for part, share in off.items():
            yield Result(f"{name}, {part}, share", "-", 0.0, share, MOST_SPREAD / 100.0)


def mesh_rows(name: str, show: Any) -> Iterator[str]:
    """Lines of the tables of one scenario, `SHOWN` figures each."""
    earlier, own = EARLIER[name], shipped_elements(name)
    meshes = {"before": (earlier, 1.0), "0.6 of before": (earlier, FEWER)}
    if own != earlier:
        meshes["shipped"] = (own, 1.0)
    for label, motion in (("rest", at_rest), ("trip", trip)):
        fine = motion(changed(name, FINER, earlier), name)
        show()
        for mesh, (elements, factor) in meshes.items():
            found = motion(changed(name, factor, elements), name)
            show()
            off = differences(found, fine)
            tension = tensions_of(off)
            worst = max(tension, key=lambda key: abs(tension[key]))
            far = sorted(off, key=lambda key: -abs(off[key]))
            beyond = sum(abs(value) > MOST_FIGURE for value in off.values())
            yield (
                f"| {name} | {label} | {mesh} | {found.elements} of {fine.elements} | "
                f"{tension[worst]:+.3f} % {worst} | {beyond} of {len(off)} | "
                + "; ".join(f"{off[key]:+.2f} % {key} ({fine.figures[key]:.4g})" for key in far[:SHOWN])
                + " |"
            )


def spread_rows(name: str) -> Iterator[str]:
    """Lines of the table of forces at rest."""
    for label, forces in spread(name).items():
        if len(forces) < len(AROUND) + 1:
            continue  # not on the line on each mesh
        values, fine = np.array(forces[:-1]), forces[-1]
        mean = float(values.mean())
        yield (
            f"| {name} | {label} | {mean:.1f} N | {100.0 * float(np.abs(values / mean - 1.0).max()):.3f} % | "
            f"{fine:.1f} N | {100.0 * float(np.abs(values / fine - 1.0).max()):.3f} % |"
        )


def main() -> int:
    """Run the command line: print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.shipped_meshes", description=__doc__, formatter_class=Filled
    )
    known = ", ".join(EARLIER)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"some of {known}; default: all")
    parser.add_argument("--forces", action="store_true", help="forces at rest over 16 meshes alone")
    options = parser.parse_args()
    if unknown := [name for name in options.scenarios if name not in EARLIER]:
        parser.error(f"SCENARIO: given {unknown[0]!r}; allowed: {known}")
    names = options.scenarios or list(EARLIER)
    if forced := [name for name in SPREAD if name in names]:
        print("| scenario | force at rest | mean of 16 meshes | largest off it | finest mesh | largest off that |")
        print("| --- | --- | --- | --- | --- | --- |")
        for name in forced:
            for row in spread_rows(name):
                print(row, flush=True)
    if not options.forces:
        print("\n| scenario | motion | mesh | elements | worst tension | figures beyond 0.3 % | farthest off |")
        print("| --- | --- | --- | --- | --- | --- | --- |")
        with Progress(console=Console(stderr=True)) as progress:
            for name in names:
                task = progress.add_task(name, total=None)
                for row in mesh_rows(name, lambda task=task: progress.advance(task)):
                    print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
