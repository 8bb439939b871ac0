"""Cases of vehicles meeting on one rope: momentum, restitution, a train, a vehicle leaning on another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, beam, observed_order

STIFFNESS, LENGTH = 1e5, 1.0  # N/m of each buffer, m of each vehicle
UNSTRAINED, SPAN = 19.98, 20.0  # m
STRETCH = SPAN / UNSTRAINED  # speeds are along the unstrained rope


def vehicle(arc_length: float, speed: float, mass: float, damping: float = 0.0) -> dict[str, Any]:
    """Block around its joint, without swing."""
    block = {"mass": mass, "inertia": 10.0, "upper_pivot": [0.0, 0.0], "size": [LENGTH, LENGTH]}
    return {
        "arc_length": arc_length,
        "speed": speed,
        "bodies": {"block": block},
        "buffers": {"stiffness": STIFFNESS, "damping": damping},
    }


def level(vehicles: Sequence[dict[str, Any]], step: float = 1e-3, **solver: Any) -> Simulation:
    """Level taut rope without gravity."""
    return beam(
        length=UNSTRAINED,
        mass_per_length=1.0,
        axial=1e7,
        bending=1.0,
        elements=8,
        end=(SPAN, 0.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        gravity=0.0,
        carriages={f"vehicle_{number}": one for number, one in enumerate(vehicles)},
        step=step,
        **solver,
    )


@case("two vehicles meet", "elastic collision: momentum and energy are kept", needs_jit=True)
def elastic() -> Iterator[Result]:
    """Without damping equal masses exchange their speeds; others part as momentum and energy have it."""
    for masses in ((100.0, 100.0), (100.0, 300.0)):
        before = np.array([1.5, -0.5])
        simulation = level([vehicle(4.0 + 3.0 * row, before[row], masses[row]) for row in range(2)])
        strung, energy = simulation.snapshot.cable.tensions, simulation.energy().total
        stored, changed, lost = 0.0, 0.0, 0.0
        for frame in range(1, 61):
            snapshot = simulation.advance_to(0.02 * frame + 0.3)
            changed = max(changed, float(np.abs(snapshot.cable.tensions - strung).max()))
            stored = max(stored, simulation.energy().elastic)
            lost = max(lost, abs(simulation.energy().total - energy))
        after = snapshot.columns.speed
        total = sum(masses)
        common = float(np.dot(masses, before)) / total
        label = f"masses {masses[0]:g} and {masses[1]:g} kg"
        for row in range(2):
            yield Result(f"speed of {row + 1}, {label}", "m/s", 2.0 * common - before[row], float(after[row]), 1e-3)
        along = float(np.dot(masses, snapshot.columns.body_velocity[:, 0]))
        yield Result(f"momentum along the rope, {label}", "kg m/s", STRETCH * common * total, along, 1e-6)
        peak = 2.0 * STRETCH * np.sqrt(0.5 * STIFFNESS * masses[0] * masses[1] / total)
        force = float(snapshot.columns.push_highest[0])
        yield Result(f"highest force over v √(k m) of the pair, {label}", "-", 1.0, force / peak, 1e-3)
        yield Result(f"largest change of energy with the buffers', {label}", "J", 0.0, lost, 0.2)
        yield Result(f"largest change of rope tension, {label}", "N", 0.0, changed, 1e-3)


@case("buffers with damping", "c v - ln(1 + c v) is as large after as before, with -v'", needs_jit=True)
def restitution() -> Iterator[Result]:
    """Of m v dv/dd = -f(d) (1 + c v), whatever the elastic force f is; c of two in series is half of each."""
    for damping in (0.2, 1.0):
        c, v = 0.5 * damping, 2.0 * STRETCH
        simulation = level([vehicle(4.0, 1.5, 100.0, damping), vehicle(7.0, -0.5, 100.0, damping)])
        columns = simulation.advance_to(1.5).columns

        def left(w: float, c: float = c, v: float = v) -> float:
            return c * v - np.log1p(c * v) + c * w + np.log1p(-c * w)

        apart = float(brentq(left, 0.0, min(v, (1.0 - 1e-12) / c)))
        label = f"damping {damping:g} s/m"
        got = STRETCH * float(columns.speed[1] - columns.speed[0])
        yield Result(f"coefficient of restitution, {label}", "-", apart / v, got / v, 1e-3)
        yield Result(f"mean speed, {label}", "m/s", 0.5, float(columns.speed.mean()), 1e-6)
        yield Result(f"speed at which they met, {label}", "m/s", v, float(columns.touch_speed[0]), 1e-6)


@case("train of three", "elastic collisions one after the other", needs_jit=True)
def train() -> Iterator[Result]:
    """One that runs into two at rest, apart from each other: it stands, and so does the second; the last one goes."""
    speeds = (1.0, 0.0, 0.0)
    simulation = level([vehicle(4.0 + 3.0 * row, speed, 100.0) for row, speed in enumerate(speeds)])
    after = simulation.advance_to(5.5).columns.speed
    for row, speed in enumerate(reversed(speeds)):
        yield Result(f"speed of {row + 1}", "m/s", speed, float(after[row]), 1e-3)


@case("contact of two vehicles", "half a sine: √(m / k) v sin(√(k / m) t)", needs_jit=True)
def order() -> Iterator[Result]:
    """Half-way out of it, from a touch that begins with a step."""
    errors = []
    mass, pair, v = 50.0, 0.5 * STIFFNESS, 2.0
    rate, late = np.sqrt(pair / mass), 0.07
    exact = v * STRETCH / rate * np.sin(rate * late)
    for step in (2e-3, 1e-3, 5e-4):
        gap = 0.5 * v  # m along the rope, of which the joints keep 1 m in space
        ahead = vehicle(5.0 + LENGTH / STRETCH + gap, -1.0, 100.0)
        simulation = level([vehicle(5.0, 1.0, 100.0), ahead], step, tolerance=1e-13)
        columns = simulation.advance_to(0.5 + late).columns
        depth = LENGTH - np.linalg.norm(columns.joint_position[1] - columns.joint_position[0])
        errors.append(abs(float(depth) - exact))
        yield Result(f"depth after 0.07 s, step {step:g} s", "m", float(exact), float(depth), 2e-4)
    yield Result("order of convergence in the step", "-", 2.0, observed_order(errors), 0.3)


@case("a vehicle leans on another", "m g sin of the rope's slope at its joint", needs_jit=True)
def leaning() -> Iterator[Result]:
    """Free upper vehicle without friction, resting on an incline against the lower one, held by its drive."""
    mass = 400.0
    lower, upper = vehicle(40.0, 0.0, mass, 1.0), vehicle(41.02, 0.0, mass, 1.0)
    simulation = beam(
        length=103.3667,
        mass_per_length=3.0,
        axial=1e8,
        bending=100.0,
        elements=30,
        end=(100.0, 30.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        carriages={"lower": {**lower, "drive": {"mode": "speed"}}, "upper": {**upper, "friction": {"viscous": 2000.0}}},
        step=0.05,
        spectral_radius=0.0,
    )
    columns = simulation.advance_to(40.0).columns
    way = columns.joint_position[1] - columns.joint_position[0]
    way /= np.linalg.norm(way)
    below, above = (_tangent(simulation, place) for place in columns.arc_length)
    push = float(columns.push[0])
    weight = mass * GRAVITY
    yield Result("push along the rope over m g sin", "-", 1.0, push * float(way @ above) / (weight * above[2]), 1e-5)
    held = weight * float(below[2]) + push * float(way @ below)
    yield Result("drive force over what it holds, both", "-", 1.0, float(columns.drive_force[0]) / held, 1e-5)
    across = columns.contact_force[1] @ above / weight
    yield Result("rope on the upper one, along the rope, over its weight", "-", 0.0, float(across), 1e-5)


def _tangent(simulation: Simulation, place: float) -> Any:
    """Unit vector (3,) of the rope at an arc length (m)."""
    first, last = simulation.cable_positions(np.array([place - 1e-3, place + 1e-3]))
    return (last - first) / np.linalg.norm(last - first)
