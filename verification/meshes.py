"""Meshes: closed forms and orders on graded ones, and forces of carriages passing elements and changes of length."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import root

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import beam, observed_order
from verification.statics import LEVEL_SPAN, Array, cantilever, catenary_end, elastica, tip


def graded(target: float, at_towers: float, growth: float = 1.5) -> dict[str, float]:
    """Value of `cable.elements`, in m."""
    return {"target": target, "at_towers": at_towers, "growth": growth}


@case("graded mesh, elastic catenary, inclined", "Irvine 1981")
def inclined_catenary() -> Iterator[Result]:
    """Elements of 0.3 m at the ends and 3 m between them: all points, and the tension at both ends."""
    span, weight, stiffness, length = np.array([100.0, 60.0]), 98.1, 2e7, 120.0
    simulation = Simulation(
        load_scenario(
            LEVEL_SPAN,
            {
                "cable.unstrained_length": length,
                "cable.end.position": [100.0, 60.0],
                "cable.elements": graded(3.0, 0.3),
                "cable.bending_stiffness": 0.0,
            },
        )
    )
    pull = root(lambda p: catenary_end(p, weight, stiffness, length) - span, [4000.0, -2000.0], tol=1e-12).x
    arc_lengths = np.linspace(0.0, length, 97)
    exact = np.array([catenary_end(pull, weight, stiffness, s) for s in arc_lengths])
    apart = np.linalg.norm(simulation.cable_positions(arc_lengths)[:, [0, 2]] - exact, axis=1)
    yield Result("worst of 97 points", "m", 0.0, float(apart.max()), 1e-5)
    for name, expected in (("start", -pull), ("end", pull + np.array([0.0, weight * length]))):
        force = simulation.snapshot.supports[name].force
        for axis, index in (("x", 0), ("z", 2)):
            wanted = float(expected[index // 2])
            yield Result(f"force at {name}, {axis}", "N", wanted, float(force[index]), 1e-6 * abs(wanted))


@case("graded mesh, order of convergence in space, cantilever", "elastica", needs_jit=True)
def order_in_space() -> Iterator[Result]:
    """All lengths halved twice: with the root of the growth, elements are half as long everywhere."""
    exact = np.array(elastica(3.0, 1e2)[:2])
    errors = []
    for target, at_towers, growth in ((0.16, 0.04, 2.25), (0.08, 0.02, 1.5), (0.04, 0.01, 1.5**0.5)):
        changes: dict[str, Any] = {"cable.elements": graded(target, at_towers, growth), "cable.axial_stiffness": 1e2}
        errors.append(float(np.linalg.norm(tip(cantilever(changes, force=3.0)) - exact)))
    yield Result("order, last two meshes", "-", 4.0, observed_order(errors), 0.2)
    yield Result("tip on the finest mesh", "m", 0.0, errors[-1], 2e-8)


@case("graded mesh, frequencies of a taut string", "closed form")
def string_frequencies() -> Iterator[Result]:
    """Half of sqrt(T / m) / l, its double and so on; elements of 1 and 5 m."""
    length, tension, mass = 100.0, 1e6, 10.0
    stiffness = 1e9
    simulation = beam(
        length=length / (1.0 + tension / stiffness),
        mass_per_length=mass,
        axial=stiffness,
        bending=0.0,
        elements=graded(5.0, 1.0),  # type: ignore[arg-type]
        end=(length, 0.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        gravity=0.0,
    )
    first = 0.5 / length * np.sqrt(tension / mass * (1.0 + tension / stiffness))
    for number, got in enumerate(simulation.natural_frequencies(4), 1):
        yield Result(f"frequency {number}", "Hz", number * first, float(got), 1e-5 * number * first)


@cache
def roll(elements: int | tuple[float, float, float]) -> tuple[Array, Array]:
    """Arc length (n,) in m and contact force (n,) in N of a load that is driven along a taut rope at 5 m/s."""
    body = {"mass": 500.0, "inertia": 100.0, "upper_pivot": [0.0, 1.0]}
    simulation = beam(
        length=100.0,
        mass_per_length=8.0,
        axial=5e7,
        bending=2e3,
        elements=elements if isinstance(elements, int) else graded(*elements),  # type: ignore[arg-type]
        end=(100.3, 10.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        damping_time=0.01,
        carriages={
            "load": {
                "arc_length": 55.0,
                "drive": {"mode": "speed", "limits": {"acceleration": 5.0}},
                "bodies": {"body": body},
            }
        },
        step=0.005,
    )
    simulation.command("load", speed=5.0)
    places, forces = [], []
    for frame in range(1, 1601):
        load = simulation.advance_to(0.005 * frame).carriages["load"]
        places.append(load.arc_length)
        forces.append(float(np.linalg.norm(load.contact_force)))
    return np.array(places), np.array(forces)


def lacking(count: int, place: float) -> float:
    """Height (l F / T) by which a force on cubic elements hangs above one on the taut string itself.

    `place` is that of the force in elements from an end; the string has `count` of them, of length 1, T = F = 1.
    """
    slope = np.array([[-6.0, 6.0, 0.0], [-4.0, 3.0, 1.0], [6.0, -6.0, 0.0], [-2.0, 3.0, 0.0]])  # s, s², 1: S_x
    powers = np.array([[1 / 3, 1 / 4, 1 / 2], [1 / 4, 1 / 5, 1 / 3], [1 / 2, 1 / 3, 1.0]])  # their products, integrated
    stiffness, force = np.zeros((2 * count + 2, 2 * count + 2)), np.zeros(2 * count + 2)
    for first in range(0, 2 * count, 2):
        stiffness[first : first + 4, first : first + 4] += slope @ powers @ slope.T
    element = min(int(place), count - 1)
    s = place - element
    shape = [1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2]
    force[2 * element : 2 * element + 4] = shape
    free = np.delete(np.arange(2 * count + 2), [0, 2 * count])
    return place * (count - place) / count - force[free] @ np.linalg.solve(stiffness[np.ix_(free, free)], force[free])


@case("waves that a load rides over from node to node", "linear string, cubic elements")
def waves_under_a_load() -> Iterator[Result]:
    """Long elements round off the bend under a load, by how much depends on its place: ± 1.5 % of l F / T."""
    length, stretched, count, force, stiffness = 100.0, 100.5, 20, 10.0, 1e7
    unit = stretched / count * force / (stiffness * (stretched / length - 1.0))
    for name, place in (("at a node", 10.0), ("0.2 elements beyond it", 10.2), ("in the middle of an element", 10.5)):
        changes = {
            "gravity": 0.0,
            "cable.unstrained_length": length,
            "cable.axial_stiffness": stiffness,
            "cable.bending_stiffness": 0.0,
            "cable.elements": count,
            "cable.end.position": [stretched, 0.0],
            "cable.loads": [{"arc_length": place * length / count, "force": [0.0, -force]}],
        }
        simulation = Simulation(load_scenario(LEVEL_SPAN, changes))
        height = float(simulation.cable_positions(np.array([place * length / count]))[0, 2])
        got = height / unit + place * (count - place) / count
        yield Result(f"height that it lacks, {name}", "l F / T", float(lacking(count, place)), got, 2e-5)


@case("waves that a load rides over, taken away", "two straight lines of rope and a load between them", needs_jit=True)
def nodes_under_loads() -> Iterator[Result]:
    """With `joint: node` it hangs as low as on two strings that meet at it, wherever it is, a large one too.

    Its node passes on no bending moment; a rope with bending stiffness would hang higher by F / 2T times √(EI / T).
    """
    for force in (2.0e3, 14.0e3, 28.0e3):
        for joint, bound in (("paper", 0.02), ("node", 1e-5)):
            places = 25.0 + np.linspace(0.0, 1.0, 9)
            heights, travels = np.array([_beside_string(force, place, joint) for place in places]).T
            text, waves = f"joint {joint}, {1e-3 * force:g} kN", 0.5 * float(np.ptp(heights))
            if joint == "node":
                yield Result(f"{text}: height above the kink, mean", "l F / T", 0.0, float(heights.mean()), 2e-5)
                far = float(np.abs(travels).max())
                yield Result(f"{text}: counterweight, largest way from its place", "m", 0.0, far, 1e-6)
            yield Result(f"{text}: waves up and down", "l F / T", 0.0, waves, bound)


def _beside_string(force: float, place: float, joint: str) -> tuple[float, float]:
    """A load on a rope of 50 elements at `place` (elements), beside two straight lines of rope that meet at it.

    Returns:
        How much higher it hangs, in l F / T, and how much further out the counterweight is (m).
    """
    length, count, tension, axial, bending = 250.0, 50, 240e3, 97e6, 7.5e3
    s, unit = place * length / count, length / count * force / tension
    changes = {
        "gravity": 10.0,
        "cable.unstrained_length": length,
        "cable.mass_per_length": 1e-6,
        "cable.axial_stiffness": axial,
        "cable.bending_stiffness": bending,
        "cable.elements": count,
        "cable.joint": joint,
        "cable.end": {
            "position": [length * (1.0 + tension / axial), 0.0],
            "support": "counterweight",
            "direction": [1.0, 0.0],
            "mass": tension / 10.0,
        },
        "carriages": {
            "load": {
                "arc_length": s,
                "bodies": {"body": {"mass": force / 10.0, "inertia": 1.0, "upper_pivot": [0.0, 0.0]}},
            }
        },
    }
    simulation = Simulation(load_scenario(LEVEL_SPAN, changes))
    height = float(simulation.state.bodies.position[0, 1])

    def unbalanced(unknown: Any) -> list[float]:
        x, z, end = unknown * [s, unit * count, length]
        before, after = np.hypot(x, z), np.hypot(end - x, z)
        t, t_after = axial * (before / s - 1.0), axial * (after / (length - s) - 1.0)
        return [
            t_after * (end - x) / after / tension - 1.0,
            (t * x / before - t_after * (end - x) / after) / force,
            (-t * z / before - t_after * z / after) / force - 1.0,
        ]

    _, kink, end = root(unbalanced, [1.0, -0.25, 1.0], tol=1e-13).x
    further = simulation.advance_to(0.0).supports["end"].travel - length * (end - 1.0 - tension / axial)
    return (height - kink * unit * count) / unit, further


@case("a load rolls over elements without a drive", "energy, which nothing takes or gives", needs_jit=True)
def nodes_keep_energy() -> Iterator[Result]:
    """Over the elements of a graded mesh for 4 s, with no friction or damping, whatever the step.

    What is left is what a node that is handed on changes of the rope: between 2e-6 and 6e-6 with any step.
    """
    for step in (0.002, 0.001):
        changes = {
            "cable.unstrained_length": 100.0,
            "cable.end.position": [100.4, 0.0],
            "cable.elements": {"target": 4.0, "at_towers": 1.0, "growth": 1.5},
            "solver.spectral_radius": 0.9,
            "solver.step": step,
            "carriages": {
                "load": {
                    "arc_length": 30.0,
                    "speed": 10.0,
                    "drive": {"mode": "free"},
                    "bodies": {"body": {"mass": 400.0, "inertia": 100.0, "upper_pivot": [0.0, 0.6]}},
                }
            },
        }
        simulation = Simulation(load_scenario(LEVEL_SPAN, changes))
        energies = [simulation.advance_to(0.05 * frame) and simulation.energy().total for frame in range(1, 81)]
        change = float(np.ptp(energies)) / (0.5 * 400.0 * 10.0**2)
        yield Result(f"range, of the load's kinetic energy, step {1e3 * step:g} ms", "-", 0.0, change, 8e-6)


@case("graded mesh, a carriage passes where elements change", "the even meshes of either length", needs_jit=True)
def carriage_passes() -> Iterator[Result]:
    """From elements of 2 m onto ones of 0.5 m near the end: no step is harder than on even meshes of either length."""

    def hardest(elements: int | tuple[float, float, float]) -> float:
        places, forces = roll(elements)
        return float(np.abs(np.diff(forces))[(places[1:] > 65.0) & (places[1:] < 90.0)].max())

    coarse, fine, mixed = hardest(50), hardest(200), hardest((2.0, 0.5, 1.5))
    above = max(mixed - max(coarse, fine), 0.0)
    yield Result("largest change in 5 ms, above that on the harder even mesh", "N", 0.0, above, 0.0)
