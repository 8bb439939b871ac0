"""Cases of carriages on a deformable rope: ellipse, moving force, several carriages, slack rope."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.integrate import quad

from cable_twin.mechanics.parameters import FloatArray
from cable_twin.simulation import Simulation, SolverError
from cable_twin.simulation.start_checks import growing_steps
from verification import Result, case
from verification.models import GRAVITY, beam, changing, pendulum

SPAN, ROPE = 3.9, 4.02  # m
LENGTH, AXIAL, STRAIN = 100.0, 1e7, 0.01  # m, N and -, of the string that a carriage runs along


def particle(mass: float, arc_length: float, **more: Any) -> dict[str, Any]:
    """Carriage of one point mass."""
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
        cable={"joint": "paper"},
        carriages=carriages,
        step=step,
        tolerance=1e-9,
        **more,
    )


@case("particle on a string", "ellipse with the supports as foci", needs_jit=True)
def ellipse() -> Iterator[Result]:
    """Point mass released aside on the ellipse x = a sin φ, z = -b cos φ; its period follows from energy."""
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


def on_string(share: float, *, mass: float, step: float, **changes: Any) -> tuple[Simulation, float]:
    """A particle at the start of a taut string of 1 kg/m, at `share` of its wave speed; and that (m/s).

    100 elements of 1 m; loads at the nodes bear the weight of the string itself.
    """
    elements, gravity = 100, changes.get("gravity", GRAVITY)
    unstrained = LENGTH / (1.0 + STRAIN)
    wave = float(np.sqrt(AXIAL * STRAIN * (1.0 + STRAIN)))
    of_element = gravity * unstrained / elements
    loads = [
        {"arc_length": unstrained * k / elements, "force": [0.0, of_element * (0.5 if k in (0, elements) else 1)]}
        for k in range(elements + 1)
    ]
    limits = {"acceleration": 1e9}
    car = particle(mass, 1e-6, end_stop={"stroke": 1e-6}, drive={"mode": "speed", "limits": limits})
    simulation = beam(
        length=unstrained,
        mass_per_length=1.0,
        axial=AXIAL,
        bending=1e-3,
        elements=elements,
        end=(LENGTH, 0.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        cable={"joint": "paper"},  # a node that follows the particle would leave the load of its place between nodes
        carriages={"car": car},
        loads=loads,
        step=step,
        **{"tolerance": 1e-12, **changes},
    )
    with changing(simulation) as state:
        along = share * wave / (1.0 + STRAIN)
        state.reference.velocity[0] = state.joints.velocity[0] = state.drives.target[0] = along
        state.bodies.velocity[0, 0] = share * wave
    return simulation, wave


@case("moving force on a string", "Frýba 1999, modal series", needs_jit=True)
def moving_force() -> Iterator[Result]:
    """A light carriage at constant speed v < c; loads at the nodes bear the weight of the string itself."""
    for share in (0.2, 0.5):
        simulation, wave = on_string(share, mass=0.1, step=5e-4)
        tension, weight, speed = AXIAL * STRAIN, 0.1 * GRAVITY, share * wave
        middle = np.array([0.5 * LENGTH / (1.0 + STRAIN)])
        rest = simulation.cable_positions(middle)[0, 2]
        n = np.arange(1, 2000)
        worst = 0.0
        for place in np.linspace(0.02, 0.9, 45):
            time = simulation.advance_to(place * LENGTH / speed).time
            got = rest - simulation.cable_positions(middle)[0, 2]
            modes = np.sin(n * np.pi * speed * time / LENGTH) - share * np.sin(n * np.pi * wave * time / LENGTH)
            series = np.sum(np.sin(0.5 * n * np.pi) * modes / n**2) * 2.0 * weight * LENGTH / np.pi**2 / tension
            worst = max(worst, abs(got - series / (1.0 - share**2)))
        static = weight * LENGTH / (4.0 * tension)
        label = f"v = {share:g} c"
        yield Result(f"midpoint, worst of 45 times, share of P L / 4 T, {label}", "-", 0.0, worst / static, 0.01)


def force_on_the_way(share: float, mass: float, step: float, spectral_radius: float) -> FloatArray:
    """Force of the joint over the weight at each step, from 20 to 60 m; 1 on an exact string."""
    weight = 0.1 * GRAVITY  # of every mass, so that a heavy one bends the string no more
    changes = {"spectral_radius": spectral_radius, "gravity": weight / mass}
    simulation, wave = on_string(share, mass=mass, step=step, **changes)
    first, last = (round(place / (share * wave * step)) for place in (20.0, 60.0))
    forces = []
    try:
        for number in range(first, last):
            snapshot = simulation.advance_to(number * step)
            forces.append(snapshot.carriages["car"].contact_force[2])
    except SolverError:
        forces.append(np.inf)
    return np.array(forces) / weight


@case(
    "mass that passes nodes",
    "linear string, elements and integrator: its exponents of growth",
    needs_jit=True,
    long=True,
)
def passing_nodes() -> Iterator[Result]:
    """A mass of 10 elements, v h/l against ln(1/ρ)/5.6, and a light one, which does not care; what is left."""
    wave = np.sqrt(AXIAL * STRAIN * (1.0 + STRAIN))
    for radius, share in ((0.5, 0.7), (0.7, 0.5), (0.9, 0.2)):
        for of_limit, grows in ((0.9, 0.0), (1.3, 1.0)):
            step = of_limit * growing_steps(radius, 1.0, share * wave, wave)[0]
            forces = force_on_the_way(share, 10.0, float(step), radius)
            label = f"grows, spectral radius {radius:g}, v = {share:g} c, {of_limit:g} of the limit"
            yield Result(label, "-", grows, float(np.abs(forces).max() > 1e3), 0.0)
    forces = force_on_the_way(0.5, 0.01, 1e-3, 0.7)
    yield Result("grows, 0.01 elements, spectral radius 0.7, v = 0.5 c, 1 ms", "-", 0.0, float(forces.max() > 1e3), 0.0)
    for share, mass in ((0.1, 1.0), (0.2, 1.0), (0.2, 0.1)):
        forces = force_on_the_way(share, mass, 0.05 / (share * wave), 0.7)
        bound = 3.0 * share**2 * mass / (1.0 + mass)
        label = f"force over weight, rms off 1 over 3 (v/c)² μ/(1 + μ), v = {share:g} c, μ = {mass:g}"
        yield Result(label, "-", 1.0, float((forces - 1.0).std() / bound), 1.0)


@case("two carriages", "mirror symmetry", needs_jit=True)
def two_carriages() -> Iterator[Result]:
    """Carriages released at equal distances from mid-span, meeting on one element."""
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
    """A level span thrown up at 6 m/s goes slack, falls and snaps taut, with a carriage on it.

    Without any damping a fifth of all throws that differ by 1e-9 m/s end in a step that finds no solution.
    """
    simulation = light_rope({"car": particle(0.2, 1.5)}, elements=48, damping_time=1e-4)
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
