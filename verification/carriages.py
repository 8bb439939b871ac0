"""Cases of carriages on a rope that gives way: ellipse, moving force, several of them, slack rope."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.integrate import quad

from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, beam, changing, pendulum

SPAN, ROPE = 3.9, 4.02  # m


def particle(mass: float, arc_length: float, **more: Any) -> dict[str, Any]:
    """A carriage that is one point."""
    bodies = {"body": {"mass": mass, "inertia": 0.01, "upper_pivot": [0.0, 0.0], "size": [0.0, 0.0]}}
    return {"arc_length": arc_length, "bodies": bodies, **more}


def light_rope(carriages: dict[str, Any], *, elements: int = 192, step: float = 1e-3, **more: Any) -> Simulation:
    """A level span so light and stiff that it counts as a string.

    A particle passes nodes smoothly when elements are not longer than the rope's bend beside it, √(EI/T).
    """
    return beam(
        length=ROPE,
        mass_per_length=1e-3,
        axial=1e5,
        bending=1e-2,
        elements=elements,
        end=(SPAN, 0.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        carriages=carriages,
        step=step,
        tolerance=1e-9,
        **more,
    )


@case("particle on a string", "ellipse with the supports as foci", needs_jit=True)
def ellipse() -> Iterator[Result]:
    """Let go aside, it keeps to the ellipse x = a sin φ, z = -b cos φ; its period follows from energy."""
    a, c = ROPE / 2.0, SPAN / 2.0
    b = np.sqrt(a**2 - c**2)
    for amplitude in (0.4, 0.15):
        simulation = light_rope({"car": particle(1.0, a + c * np.sin(amplitude))})
        times, places = [], []
        for frame in range(1201):
            snapshot = simulation.advance_to(0.01 * frame)
            times.append(snapshot.time)
            places.append(snapshot.carriages["car"].position[[0, 2]] - [c, 0.0])
        path, time = np.array(places), np.array(times)
        first, second = np.hypot(path[:, 0] + c, path[:, 1]), np.hypot(path[:, 0] - c, path[:, 1])
        towards = (path - [-c, 0.0]) / first[:, None] + (path - [c, 0.0]) / second[:, None]
        apart = (first + second - ROPE) / np.linalg.norm(towards, axis=1)
        yield Result(f"largest distance from it, from φ = {amplitude:g}", "m", 0.0, float(np.abs(apart).max()), 5e-4)

        # a quarter of the period: dφ over φ_dot = √(2 g b (cos φ - cos φ0) / (a² cos²φ + b² sin²φ)), φ = φ0 sin u
        def slowness(u: float, a: float = a, b: float = b, start: float = amplitude) -> float:
            phi = start * np.sin(u)
            metric = (a * np.cos(phi)) ** 2 + (b * np.sin(phi)) ** 2
            return start * np.cos(u) * np.sqrt(metric / (2.0 * GRAVITY * b * (np.cos(phi) - np.cos(start))))

        period = 4.0 * quad(slowness, 0.0, 0.5 * np.pi - 1e-9)[0]
        x = path[:, 0]
        passing = np.flatnonzero(x[:-1] * x[1:] < 0.0)
        crossings = time[passing] - x[passing] * (time[passing + 1] - time[passing]) / (x[passing + 1] - x[passing])
        got = float(2.0 * np.diff(crossings).mean())
        yield Result(f"period from φ = {amplitude:g}", "s", float(period), got, 0.01 * period)
    small = 2.0 * np.pi * a / np.sqrt(GRAVITY * b)
    yield Result("period of the last against 2π a / √(g b)", "s", float(small), got, 0.01 * small)


@case("moving force on a string", "Frýba 1999, modal series", needs_jit=True)
def moving_force() -> Iterator[Result]:
    """A light carriage at constant speed v < c; loads at the nodes bear the weight of the string itself.

    Near the wave speed a mass that passes node after node can excite the mesh: 0.5 c is stable with 0.5 ms and
    with 2 ms, but not with 1 ms at a spectral radius of 0.7. No ropeway comes near.
    """
    length, mass_per_length, axial, strain, mass, elements = 100.0, 1.0, 1e7, 0.01, 0.1, 100
    unstrained = length / (1.0 + strain)
    tension, weight = axial * strain, mass * GRAVITY
    wave = np.sqrt(tension * (1.0 + strain) / mass_per_length)
    share_of_element = mass_per_length * GRAVITY * unstrained / elements
    loads = [
        {"arc_length": unstrained * k / elements, "force": [0.0, share_of_element * (0.5 if k in (0, elements) else 1)]}
        for k in range(elements + 1)
    ]
    for share in (0.2, 0.5):
        speed = share * wave
        limits = {"acceleration": 1e9}
        car = particle(mass, 1e-6, end_stop={"stroke": 1e-6}, drive={"mode": "speed", "limits": limits})
        simulation = beam(
            length=unstrained,
            mass_per_length=mass_per_length,
            axial=axial,
            bending=1e-3,
            elements=elements,
            end=(length, 0.0),
            supports=("pinned", "pinned"),
            shape="equilibrium",
            carriages={"car": car},
            loads=loads,
            step=5e-4,
            tolerance=1e-12,
        )
        along = speed / (1.0 + strain)
        with changing(simulation) as state:
            state.reference.velocity[0] = state.joints.velocity[0] = state.drive_target[0] = along
            state.bodies.velocity[0, 0] = speed
        middle = np.array([0.5 * unstrained])
        rest = simulation.cable_positions(middle)[0, 2]
        n = np.arange(1, 2000)
        worst = 0.0
        for place in np.linspace(0.02, 0.9, 45):
            time = simulation.advance_to(place * length / speed).time
            got = rest - simulation.cable_positions(middle)[0, 2]
            modes = np.sin(n * np.pi * speed * time / length) - share * np.sin(n * np.pi * wave * time / length)
            series = np.sum(np.sin(0.5 * n * np.pi) * modes / n**2) * 2.0 * weight * length / np.pi**2 / tension
            worst = max(worst, abs(got - series / (1.0 - share**2)))
        static = weight * length / (4.0 * tension)
        label = f"v = {share:g} c"
        yield Result(f"midpoint, worst of 45 times, share of P L / 4 T, {label}", "-", 0.0, worst / static, 0.01)


@case("two carriages", "mirror symmetry", needs_jit=True)
def two_carriages() -> Iterator[Result]:
    """Let go at equal distances from the middle, passing nodes together, on one element when they meet."""
    cars = {"left": particle(0.5, 1.2), "right": particle(0.5, ROPE - 1.2)}
    simulation = light_rope(cars, elements=48)
    worst, least, shared = 0.0, ROPE, False
    for frame in range(201):
        snapshot = simulation.advance_to(0.01 * frame)
        left, right = snapshot.carriages["left"], snapshot.carriages["right"]
        worst = max(worst, abs(left.arc_length + right.arc_length - ROPE), abs(left.position[2] - right.position[2]))
        least = min(least, right.arc_length - left.arc_length)
        shared = shared or abs(right.arc_length - left.arc_length) < ROPE / 48.0
    yield Result("they meet", "-", 1.0, float(shared and least < 0.0), 0.0)
    yield Result("largest difference of mirror images in 2 s", "m", 0.0, worst, 1e-6)
    yield Result("steps that had to be halved", "-", 0.0, float(snapshot.solver.halvings), 0.0)


@case("fixed joint", "period of the compound pendulum", needs_jit=True)
def fixed_joint() -> Iterator[Result]:
    """A body clamped to a taut rope swings by 0.5 rad: 4 √((I + m d²)/(m g d)) K(sin 0.25)."""
    mass, inertia, arm, swing = 2.0, 0.3, 0.8, 0.5
    body = {"mass": mass, "inertia": inertia, "upper_pivot": [0.0, arm]}
    simulation = pendulum(body, swing)
    times, pitches = [], []
    for frame in range(1, 1001):
        snapshot = simulation.advance_to(0.01 * frame)
        times.append(snapshot.time)
        pitches.append(snapshot.carriages["car"].bodies["body"].pitch)
    pitch, time = np.array(pitches), np.array(times)
    passing = np.flatnonzero(pitch[:-1] * pitch[1:] < 0.0)
    crossings = time[passing] + 0.01 * pitch[passing] / (pitch[passing] - pitch[passing + 1])
    quarter = quad(lambda u: 1.0 / np.sqrt(1.0 - (np.sin(0.5 * swing) * np.sin(u)) ** 2), 0.0, 0.5 * np.pi)[0]
    period = 4.0 * np.sqrt((inertia + mass * arm**2) / (mass * GRAVITY * arm)) * quarter
    yield Result("period", "s", float(period), float(2.0 * np.diff(crossings).mean()), 1e-3)
    yield Result("largest swing", "rad", swing, float(np.abs(pitch).max()), 1e-3)
    yield Result("arc length", "m", 5.0, snapshot.carriages["car"].arc_length, 0.0)


@case("rope goes slack and taut again", "none: it must go on", needs_jit=True)
def slack_rope() -> Iterator[Result]:
    """A level span thrown up at 6 m/s goes slack, falls and snaps taut, with a carriage on it."""
    simulation = light_rope({"car": particle(0.2, 1.5)}, elements=48)
    with changing(simulation) as state:
        interior = state.nodes.velocity[1:-1, 0, 1]
        interior += 6.0 * np.sin(np.pi * np.linspace(0.0, 1.0, 49)[1:-1])
        state.bodies.velocity[0, 1] = interior[round(1.5 / ROPE * 48) - 1]
    lowest, highest, finite = np.inf, -np.inf, True
    for frame in range(1, 301):
        snapshot = simulation.advance_to(0.01 * frame)
        lowest, highest = min(lowest, snapshot.cable.tensions.min()), max(highest, snapshot.cable.tensions.max())
        finite = finite and bool(np.isfinite(snapshot.cable.positions).all())
    yield Result("goes slack", "-", 1.0, float(lowest < 0.0), 0.0)
    yield Result("all finite over 3 s", "-", 1.0, float(finite), 0.0)
    yield Result("largest gap of a joint at the end", "m", 0.0, snapshot.solver.constraint_residual, 1e-9)
