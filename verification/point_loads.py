"""Closed-form statics of elastic ropes with point loads, and simulations of these ropes to compare with.

The closed form is worked out here with scipy alone. A rope without bending stiffness has the force vector
n(s) = n(0) + q s ẑ - Σ (forces on the rope before s) and the slope r_s = n (1/EA + 1/|n|), both by unstrained length.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq, root

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

GRAVITY = 9.81  # m/s²
BESIDE = 1e-7  # of a length, on both sides of a load
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rope:
    """Rope between two points with weights on it; vectors have z last, in a plane (2,), in space (3,)."""

    end: tuple[float, ...]  # m, from the start
    length: float  # m, unstrained
    weight: float  # N/m
    stiffness: float  # EA, N
    places: tuple[float, ...]  # m, unstrained arc lengths of the loads, rising
    loads: tuple[float, ...]  # N, downwards
    pulls: tuple[tuple[float, ...], ...] = ()  # N, vectors (dim,) on the rope at these places beside the loads


class Solved:
    """Equilibrium of a rope, from the force vector (dim,) in N at its start."""

    def __init__(self, rope: Rope, pull: Array) -> None:
        self.rope, self.pull = rope, pull

    def force(self, s: float, after: bool = False) -> Array:
        """Force vector (dim,) in N that the rope beyond `s` (m) exerts; at a load that before it, or `after` it."""
        rope, passed = self.rope, self._passed(s, after)
        force = self.pull.copy()
        force[-1] += rope.weight * s + sum(rope.loads[:passed])
        for pull in rope.pulls[:passed]:
            force -= pull
        return force

    def _passed(self, s: float, after: bool) -> int:
        """Count of loads before `s` (m)."""
        return sum(place <= s if after else place < s for place in self.rope.places)

    def tension(self, s: float, after: bool = False) -> float:
        """Tension (N) at `s` (m); at a load that before it, or `after` it."""
        return float(np.linalg.norm(self.force(s, after)))

    def position(self, s: float) -> Array:
        """Point (dim,) in m of the rope at `s` (m)."""
        rope, reached, at = self.rope, 0.0, np.zeros(self.pull.size)
        for until in (*(place for place in rope.places if place < s), s):
            at = at + _part(rope, self.force(reached, after=True), until - reached)
            reached = until
        return at

    def hold(self, load: int) -> float:
        """Force (N) towards the end of the rope that holds a load in place, per length of the stretched rope.

        The derivative of the potential by its place is the difference of T + T² / 2 EA on both sides; of that, per
        mean stretch, the difference of the tensions is left.
        """
        place = self.rope.places[load]
        return self.tension(place, after=True) - self.tension(place)

    def potential(self) -> float:
        """Elastic and gravitational energy (J) of rope and loads, by quadrature."""
        rope = self.rope
        edges, total = [0.0, *rope.places, rope.length], 0.0
        for first, last in pairwise(edges):
            middle, half = 0.5 * (first + last), 0.5 * (last - first)
            for node, share in zip(NODES, WEIGHTS, strict=True):
                s = middle + half * node
                stored = self.tension(s) ** 2 / (2.0 * rope.stiffness) + rope.weight * self.position(s)[-1]
                total += half * share * stored
        loads = zip(rope.places, rope.loads, strict=True)
        return total + sum(weight * float(self.position(place)[-1]) for place, weight in loads)


def _part(rope: Rope, first: Array, length: float) -> Array:
    """Way (dim,) in m from one end of a part of rope to the other, with the force `first` (N) at its start."""
    last = first + np.array([*np.zeros(first.size - 1), rope.weight * length])
    across = float(np.linalg.norm(first[:-1]))
    way = 0.5 * (first + last) * length / rope.stiffness
    turned = np.arcsinh(last[-1] / across) - np.arcsinh(first[-1] / across)
    way[:-1] += first[:-1] / rope.weight * turned
    way[-1] += (np.linalg.norm(last) - np.linalg.norm(first)) / rope.weight
    return way


def solve(rope: Rope, guess: Array | None = None) -> Solved:
    """Equilibrium of a rope, by shooting from its start.

    Args:
        rope: rope with its loads.
        guess: force vector (dim,) in N at its start to look from; without one, that of a nearby tension.
    """
    end = np.array(rope.end)
    if guess is None:
        chord = float(np.linalg.norm(end))
        total = rope.weight * rope.length + sum(rope.loads)
        size = max(rope.stiffness * (chord / rope.length - 1.0), total)
        guess = size * end / chord - np.array([*np.zeros(end.size - 1), 0.5 * total])
    scale = float(np.linalg.norm(guess))

    def missed(unknown: Array) -> Array:
        return (Solved(rope, unknown * scale).position(rope.length) - end) / rope.length

    found = root(missed, guess / scale, method="hybr", tol=1e-14)
    pull = found.x * scale
    assert np.abs(missed(found.x)).max() < 1e-12, f"no equilibrium of {rope}: {found.message}"
    return Solved(rope, pull)


@lru_cache(maxsize=100)
def with_tension(rope: Rope, tension: float) -> Rope:
    """The rope with such an unstrained length that both sides of its first load have `tension` (N) on average.

    `places` are shares of the length.
    """
    chord, shares = float(np.linalg.norm(rope.end)), rope.places

    def off(length: float) -> float:
        solved = solve(replace(rope, length=length, places=tuple(share * length for share in shares)))
        place = shares[0] * length
        return 0.5 * (solved.tension(place) + solved.tension(place, after=True)) / tension - 1.0

    tight = chord / (1.0 + 1.2 * tension / rope.stiffness)
    slack = 1.02 * tight
    while off(slack) > 0.0:
        slack *= 1.02
    length = brentq(off, tight, slack, xtol=1e-12 * chord)
    return replace(rope, length=length, places=tuple(share * length for share in shares))


def simulated(
    rope: Rope,
    elements: int | Mapping[str, float],
    joint: str = "driven",
    changes: Mapping[str, Any] | None = None,
) -> Simulation:
    """The rope in the product, a body below each load; joints are `driven` (held by a drive), `fixed` or `free`."""
    return Simulation(load_scenario(plain(rope, elements, joint), changes))


def plain(rope: Rope, elements: int | Mapping[str, float], joint: str) -> dict[str, Any]:
    """Scenario of `simulated`."""
    dim = len(rope.end)
    cable = {
        "unstrained_length": rope.length,
        "mass_per_length": rope.weight / GRAVITY,
        "axial_stiffness": rope.stiffness,
        "bending_stiffness": 0.0,
        "elements": elements,
        "joint": "node",
        "start": {"position": [0.0] * dim},
        "end": {"position": list(rope.end)},
    }
    return {"gravity": GRAVITY, "cable": cable, "carriages": hung(rope, joint)}


def hung(rope: Rope, joint: str, name: str = "load", more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Carriages that weigh what the loads of a rope do, as plain data."""
    kind = {"driven": {"drive": {"mode": "speed"}}, "fixed": {"joint": "fixed"}, "free": {"drive": {"mode": "free"}}}
    found = {}
    for number, (place, load) in enumerate(zip(rope.places, rope.loads, strict=True), 1):
        mass = load / GRAVITY
        pivot = [0.0] * (len(rope.end) - 1) + [1.0]
        body = {"mass": mass, "inertia": mass, "upper_pivot": pivot, "size": [0.1, 0.1]}
        found[f"{name}_{number}"] = {
            "arc_length": place,
            "end_stop": {"stroke": 0.01},
            "bodies": {"body": body},
            **kind[joint],
            **(more or {}),
        }
    return found


@dataclass(frozen=True)
class Errors:
    """Errors of one load, and of the rope with it, beside the closed form; F its weight, T the tension beside it."""

    height: float  # of the load above where it belongs, over l F / T
    hold: float  # of the force that holds it along the rope, over F² / T
    sides: float  # worst of the tensions just before and after it, over T
    anywhere: float  # worst tension of 501 points of the rope, of the exact one
    ends: float  # worst of the force vectors on both supports, of the exact one


LIMITS = {"height": 2e-4, "hold": 1e-3, "sides": 1e-3, "anywhere": 1e-3, "ends": 1e-3}


def compare(
    simulation: Simulation, exact: Solved, load: int = 0, *, rope: str | None = None, name: str = "load"
) -> Errors:
    """Errors of a simulation at rest beside the closed form."""
    given = exact.rope
    axes = [0, 2] if len(given.end) == 2 else [0, 1, 2]
    place, weight = given.places[load], given.loads[load]
    before, after = exact.tension(place), exact.tension(place, after=True)
    tension = 0.5 * (before + after)
    part = simulation.parts[rope or next(iter(simulation.parts))]
    element = given.length / part.system.cable.element_count
    car = simulation.snapshot.carriages[f"{name}_{load + 1}"]
    higher = float((car.position[axes] - np.array(simulation_origin(simulation, rope)) - exact.position(place))[-1])
    beside = np.array([place - BESIDE * given.length, place + BESIDE * given.length])
    got = simulation.cable_tension(beside, rope)
    # points between loads: at a load the readout is that before it
    points = np.array(
        [s for s in np.linspace(0.0, given.length, 501) if np.abs(s - np.array(given.places)).min() > 1e-6]
    )
    expected = np.array([exact.tension(s) for s in points])
    prefix = "" if rope is None else f"{rope}/"
    forces = [simulation.snapshot.supports[f"{prefix}{end}"].force[axes] for end in ("start", "end")]
    wanted = [-exact.force(0.0), exact.force(given.length, after=True)]
    apart = [np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(forces, wanted, strict=True)]
    return Errors(
        height=higher / (element * weight / tension),
        hold=(car.drive_force - exact.hold(load)) / (weight**2 / tension),
        sides=float(np.abs(got - [before, after]).max()) / tension,
        anywhere=float(np.abs(simulation.cable_tension(points, rope) / expected - 1.0).max()),
        ends=float(max(apart)),
    )


def simulation_origin(simulation: Simulation, rope: str | None) -> tuple[float, ...]:
    """Start (dim,) in m of a rope."""
    return tuple(simulation.scenario.cables[rope or next(iter(simulation.scenario.cables))].start.position)


def worst(errors: list[Errors]) -> dict[str, float]:
    """Errors of the largest size, by name."""
    return {name: max((getattr(one, name) for one in errors), key=abs) for name in LIMITS}


def held_by_potential(
    rope: Rope, elements: int | Mapping[str, float], joint: str = "driven", *, step: float = 0.02
) -> float:
    """Force (N) that holds the first load, from the energies of the product with it `step` (m) to either side.

    It is per stretched length, as `Solved.hold` is.
    """
    energies = []
    for off in (-step, step):
        moved = replace(rope, places=(rope.places[0] + off, *rope.places[1:]))
        energy = simulated(moved, elements, joint, {"solver.tolerance": 1e-12}).energy()
        energies.append(energy.elastic + energy.gravitational)
    exact = solve(rope)
    stretch = 1.0 + 0.5 * (exact.tension(rope.places[0]) + exact.tension(rope.places[0], after=True)) / rope.stiffness
    return (energies[1] - energies[0]) / (2.0 * step) / stretch


def rest_place(rope: Rope) -> float:
    """Unstrained arc length (m) at which its single load stands still without a drive."""

    def off(place: float) -> float:
        return solve(replace(rope, places=(place,))).hold(0)

    return float(brentq(off, 0.02 * rope.length, 0.98 * rope.length, xtol=1e-11 * rope.length))


def by_quadrature(exact: Solved, s: float) -> Array:
    """Point (dim,) in m of the rope at `s` (m), by integrating its slope: a check of the closed form."""
    rope = exact.rope

    def slope(at: float, axis: int) -> float:
        force = exact.force(at)
        return float(force[axis] * (1.0 / rope.stiffness + 1.0 / np.linalg.norm(force)))

    breaks = [place for place in rope.places if place < s]
    return np.array(
        [
            quad(slope, 0.0, s, args=(k,), points=breaks or None, epsabs=1e-11, limit=200)[0]
            for k in range(exact.pull.size)
        ]
    )
