"""Cases of conserved and lost quantities: energy, momentum, amplitude."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.rope.point import AFTER, BEFORE, R
from cable_twin.mechanics.rope.shape_functions import MASS
from cable_twin.mechanics.solution.prediction import coefficients
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, beam, changing, observed_order, seed, start_moving


def momentum(simulation: Simulation) -> tuple[FloatArray, float, FloatArray]:
    """Linear momentum (2,) in kg m/s, angular momentum about the origin in kg m²/s, first moment of mass (2,) in kg m.

    The positive sense of the angular one is that of the pitch, from z to x.
    """
    cable, carriages, state = simulation.system.cable, simulation.system.carriages, simulation.state
    linear, first, angular = np.zeros(2), np.zeros(2), 0.0
    for element, length in enumerate(cable.element_length):
        scale = np.array([1.0, length, 1.0, length])
        mass = np.array(MASS) * np.outer(scale, scale) * cable.mass_per_length * length
        e, e_dot = (
            array[[element, element, element + 1, element + 1], [R, AFTER, R, BEFORE]]
            for array in (state.nodes.position, state.nodes.velocity)
        )
        row = mass[0] + mass[2]
        linear += row @ e_dot
        first += row @ e
        angular += float(np.sum(mass * (np.outer(e[:, 1], e_dot[:, 0]) - np.outer(e[:, 0], e_dot[:, 1]))))
    for body, m in enumerate(carriages.mass):
        q, v = state.bodies.position[body], state.bodies.velocity[body]
        linear += m * v[:2]
        first += m * q[:2]
        angular += m * (q[1] * v[0] - q[0] * v[1]) + carriages.inertia[body] * v[2]
    return linear, angular, first


@case("energy of a free motion", "no drive, no friction: never gained", needs_jit=True)
def energy_is_not_gained() -> Iterator[Result]:
    """The paper's example for 12 s, looked at every 10 ms; early, before paths part, a larger radius loses less."""
    early = []
    for radius in (0.5, 0.7, 0.9):
        simulation = seed(cable__elements=48, solver__spectral_radius=radius)
        energies = [simulation.energy().total]
        for frame in range(1, 1201):
            simulation.advance_to(0.01 * frame)
            energies.append(simulation.energy().total)
        label = f"spectral radius {radius:g}"
        gain = max(max(energies) - energies[0], 0.0)
        yield Result(f"largest gain over the start, {label}", "J", 0.0, gain, 1e-9)
        early.append(energies[0] - energies[100])
        yield Result(f"loss in 1 s, {label}", "J", 0.0, early[-1], 0.03)
        yield Result(
            f"loss in 12 s, share of the potential energy, {label}", "-", 0.0, energies[-1] / energies[0] - 1.0, 0.005
        )
    yield Result("losses in 1 s fall with the radius", "-", 1.0, float(early == sorted(early, reverse=True)), 0.0)


def axial_bar(
    frequency_step: float, radius: float, damping_time: float, elements: int = 16
) -> tuple[Simulation, float]:
    """A bar in its first axial mode, pinned at one end, and that mode's frequency (rad/s)."""
    length, mass_per_length, axial, amplitude = 2.0, 3.0, 5e4, 1e-3
    frequency = 0.5 * np.pi / length * np.sqrt(axial / mass_per_length)
    simulation = beam(
        length=length,
        mass_per_length=mass_per_length,
        axial=axial,
        bending=1.0,
        elements=elements,
        gravity=0.0,
        damping_time=damping_time,
        step=frequency_step / frequency,
        spectral_radius=radius,
        tolerance=1e-13,
    )
    arc_lengths = np.linspace(0.0, length, elements + 1)
    wave = 0.5 * np.pi / length
    with changing(simulation) as state:
        state.nodes.position[:, 0, 0] += amplitude * np.sin(wave * arc_lengths)
        state.nodes.position[:, 1:, 0] += (amplitude * wave * np.cos(wave * arc_lengths))[:, None]
    start_moving(simulation)
    return simulation, float(frequency)


def amplification(frequency_step: float, radius: float) -> float:
    """Largest size of an eigenvalue of one step of generalized-alpha on q_ddot = -ω² q, at ω h = `frequency_step`."""
    c = coefficients(radius)
    w = frequency_step**2
    # unknowns (q, h v, h² a, h² q_ddot): the updates of Newmark, the mean of a, and the equation of motion
    after = np.array([[1, 0, -c.beta, 0], [0, 1, -c.gamma, 0], [0, 0, 1 - c.alpha_m, c.alpha_f - 1], [w, 0, 0, 1]])
    now = np.array([[1, 1, 0.5 - c.beta, 0], [0, 1, 1 - c.gamma, 0], [0, 0, -c.alpha_m, c.alpha_f], [0, 0, 0, 0]])
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(after, now))).max())


@case("loss of the default integrator", "amplification matrix of Chung, Hulbert 1993", needs_jit=True)
def integrator_loss() -> Iterator[Result]:
    """Energy that an axial mode loses in 200 steps of ω h = 0.3."""
    for radius in (0.5, 0.7, 0.9, 1.0):
        simulation, _ = axial_bar(0.3, radius, 0.0)
        steps = 200
        energies = []
        for step in range(steps + 1):
            simulation.advance_to(step * simulation.step)
            energies.append(simulation.energy().total)
        # the numerical energy ripples twice a period: fit its decay
        rate = np.polyfit(np.arange(steps + 1), np.log(energies), 1)[0]
        expected = 2.0 * np.log(amplification(0.3, radius))
        yield Result(f"decay of the energy a step, spectral radius {radius:g}", "-", expected, float(rate), 2e-5)


@case("Kelvin-Voigt damping", "ζ = τ ω / 2", needs_jit=True)
def kelvin_voigt() -> Iterator[Result]:
    """First axial mode of a pinned bar, first bending mode of a beam on two pins: free decay over four periods."""
    zeta = 0.02
    for name in ("axial", "bending"):
        if name == "axial":
            _, frequency = axial_bar(0.01, 1.0, 0.0)
            simulation, _ = axial_bar(0.01, 1.0, 2.0 * zeta / frequency)
            row, column, start = -1, 0, 2.0
        else:
            length, mass_per_length, axial, bending, elements = 2.0, 3.0, 5e4, 40.0, 16
            wave = np.pi / length
            frequency = float(wave**2 * np.sqrt(bending / mass_per_length))
            simulation = beam(
                length=length,
                mass_per_length=mass_per_length,
                axial=axial,
                bending=bending,
                elements=elements,
                supports=("pinned", "pinned"),
                gravity=0.0,
                damping_time=2.0 * zeta / frequency,
                step=0.01 / frequency,
                spectral_radius=1.0,
                tolerance=1e-14,
            )
            amplitude = 1e-3 * np.sqrt(bending / axial)
            arc_lengths = np.linspace(0.0, length, elements + 1)
            with changing(simulation) as state:
                state.nodes.position[:, 0, 1] = amplitude * np.sin(wave * arc_lengths)
                state.nodes.position[:, 1:, 1] = (amplitude * wave * np.cos(wave * arc_lengths))[:, None]
            start_moving(simulation)
            row, column, start = elements // 2, 1, 0.0
        initial = simulation.state.nodes.position[row, 0, column] - start
        damped = frequency * np.sqrt(1.0 - zeta**2)
        worst = 0.0
        for frame in range(41):
            time = simulation.advance_to(0.2 * np.pi * frame / frequency).time
            got = (simulation.state.nodes.position[row, 0, column] - start) / initial
            phase = damped * time
            exact = np.exp(-zeta * frequency * time) * (np.cos(phase) + zeta * frequency / damped * np.sin(phase))
            worst = max(worst, abs(got - exact))
        yield Result(f"{name} mode, worst of four periods, share of the start", "-", 0.0, float(worst), 1e-3)


FREE_CHAIN: dict[str, Any] = {
    "car": {
        "arc_length": 1.3,
        "bodies": {
            "upper": {"mass": 0.7, "inertia": 0.05, "upper_pivot": [0.0, 0.2], "lower_pivot": [0.0, -0.2]},
            "lower": {"mass": 0.4, "inertia": 0.03, "upper_pivot": [0.0, 0.3]},
        },
    }
}


def thrown_cable(
    step: float, gravity: float, elements: int = 8, hinges: dict[str, float] | None = None, **solver: Any
) -> Simulation:
    """Unsupported cable, thrown and rotating, with a carriage of two bodies sliding freely.

    `hinges` has what is above each body, `solver` what else that section of the scenario is to hold.
    """
    bodies = {name: body | (hinges or {}) for name, body in FREE_CHAIN["car"]["bodies"].items()}
    simulation = beam(
        length=2.0,
        mass_per_length=0.6,
        axial=800.0,
        bending=0.5,
        elements=elements,
        supports=("free", "free"),
        gravity=gravity,
        carriages={"car": FREE_CHAIN["car"] | {"bodies": bodies}},
        step=step,
        tolerance=1e-12,
        **solver,
    )
    # a turn of the whole about the origin, and a throw: nothing moves against anything at first
    spin, throw = 3.0, np.array([0.4, 2.0])
    with changing(simulation) as state:
        e = state.nodes.position
        state.nodes.velocity[:, 0] = throw + spin * np.stack([e[:, 0, 1], -e[:, 0, 0]], axis=-1)
        state.nodes.velocity[:, 1:] = spin * np.stack([e[:, 1:, 1], -e[:, 1:, 0]], axis=-1)
        q = state.bodies.position
        state.bodies.velocity[:, :2] = throw + spin * np.stack([q[:, 1], -q[:, 0]], axis=-1)
        state.bodies.velocity[:, 2] = spin
    start_moving(simulation)
    return simulation


@case("momentum of a thrown cable", "Newton: no force, no change", needs_jit=True)
def momentum_is_kept() -> Iterator[Result]:
    """Cable free at both ends, with a sliding carriage of two bodies."""
    drifts = []
    for step in (5e-4, 2.5e-4):
        simulation = thrown_cable(step, 0.0)
        linear, angular, _ = momentum(simulation)
        simulation.advance_to(0.5)
        linear_after, angular_after, _ = momentum(simulation)
        yield Result(
            f"change of momentum in 0.5 s, {1e3 * step:g} ms",
            "kg m/s",
            0.0,
            float(np.abs(linear_after - linear).max()),
            1e-9,
        )
        drifts.append(abs(angular_after - angular))
    yield Result("change of angular momentum in 0.5 s, 0.25 ms", "kg m²/s", 0.0, drifts[-1], 1e-4)
    yield Result("order of that in time", "-", 2.0, observed_order(drifts), 0.3)
    simulation = thrown_cable(5e-4, GRAVITY)
    mass = 0.6 * 2.0 + 1.1
    linear, _, first = momentum(simulation)
    simulation.advance_to(0.5)
    _, _, first_after = momentum(simulation)
    fall = (first_after - first - 0.5 * linear) / mass
    yield Result("path of the centre of mass in 0.5 s, x", "m", 0.0, float(fall[0]), 1e-9)
    yield Result("path of the centre of mass in 0.5 s, z", "m", -0.5 * GRAVITY * 0.25, float(fall[1]), 1e-9)
