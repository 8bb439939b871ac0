"""Cases of springs and dampers between bodies, and between the first body and the cable."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_twin.mechanics.language.rotations import cross, orientation
from cable_twin.mechanics.on_rope.sliding_joint import cable_direction
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.conservation import momentum, thrown_cable
from verification.models import GRAVITY, changing, for_kernels, observed_order, pendulum, start_moving

MASS, INERTIA, ARM = 2.0, 0.3, 0.8  # kg, kg m², m
ABOUT_PIVOT = INERTIA + MASS * ARM**2
WEIGHT = MASS * GRAVITY * ARM  # N m/rad, of a small swing
HINGES = {"damping": 0.4, "stiffness": 3.0}


def hinged_pendulum(step: float, *, damping: float = 0.0, stiffness: float = 0.0, swing: float = 0.01) -> Simulation:
    """A body clamped to a rope so taut that its direction stands still, let go aside by `swing` (rad)."""
    hinge = {"damping": damping, "stiffness": stiffness}
    body = {"mass": MASS, "inertia": INERTIA, "upper_pivot": [0.0, ARM], **hinge}
    simulation = pendulum(body, swing, axial=1e10, step=step, tolerance=1e-13)
    start_moving(simulation)
    return simulation


def pitches(simulation: Simulation, duration: float, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) in s and pitches (n,) in rad of the only body."""
    times, found = [], []
    for frame in range(round(duration / interval) + 1):
        times.append(simulation.advance_to(interval * frame).time)
        found.append(simulation.state.bodies.position[0, 2])
    return np.array(times), np.array(found)


@case("damped pendulum on a rope", "closed form of a small swing", needs_jit=True)
def damped_pendulum() -> Iterator[Result]:
    """Logarithmic decrement 2π ζ / √(1 - ζ²) with ζ = c / 2√(J k), J about the pivot and k = m g d and the spring."""
    for zeta, stiffness in ((0.02, 0.0), (0.2, 0.0), (0.05, 25.0)):
        whole = WEIGHT + stiffness
        damping = 2.0 * zeta * np.sqrt(ABOUT_PIVOT * whole)
        simulation = hinged_pendulum(1e-3, damping=damping, stiffness=stiffness, swing=1e-4)
        frequency = np.sqrt(whole / ABOUT_PIVOT)
        damped = frequency * np.sqrt(1.0 - zeta**2)
        time, pitch = pitches(simulation, 3.2 * 2.0 * np.pi / damped, 1e-3)
        turns = 1 + np.flatnonzero((pitch[1:-1] > pitch[:-2]) & (pitch[1:-1] >= pitch[2:]))
        before, here, after = pitch[turns - 1], pitch[turns], pitch[turns + 1]
        peaks = here + (after - before) ** 2 / (8.0 * (2.0 * here - before - after))
        label = f"ζ = {zeta:g}" + (f", spring of {stiffness:g} N m/rad" if stiffness else "")
        decrement = 2.0 * np.pi * zeta / np.sqrt(1.0 - zeta**2)
        got = float(np.log(peaks[:-1] / peaks[1:]).mean())
        yield Result(f"logarithmic decrement, {label}", "-", decrement, got, 1e-4 * decrement)
        phase = damped * time
        exact = np.exp(-zeta * frequency * time) * (np.cos(phase) + zeta * frequency / damped * np.sin(phase))
        worst = float(np.abs(pitch / pitch[0] - exact).max())
        yield Result(f"worst of three periods, share of the start, {label}", "-", 0.0, worst, 3e-4)
    errors = []
    for step in (8e-3, 4e-3, 2e-3):
        simulation = hinged_pendulum(step, damping=2.0, stiffness=5.0, swing=1e-4)
        zeta = 1.0 / np.sqrt(ABOUT_PIVOT * (WEIGHT + 5.0))
        frequency = np.sqrt((WEIGHT + 5.0) / ABOUT_PIVOT)
        time, pitch = pitches(simulation, 1.6, 0.8)
        decay = np.exp((-zeta + 1j * np.sqrt(1.0 - zeta**2)) * frequency * time[-1])
        exact = pitch[0] * (decay.real + zeta / np.sqrt(1.0 - zeta**2) * decay.imag)
        errors.append(abs(float(pitch[-1] - exact)))
    yield Result("order in time", "-", 2.0, observed_order(errors), 0.05)


def swing_lower_body(simulation: Simulation, rate: float) -> None:
    """Let the last body of a chain turn about its pivot by `rate` (rad/s) more than it does."""
    offset = simulation.system.carriages.upper_pivot[-1]
    with changing(simulation) as state:
        axes = np.reshape(orientation(state.bodies.position[-1], (0.0, 0.0)), (2, 2))
        state.bodies.velocity[-1] += rate * np.array([*cross((-1.0,), tuple(axes @ offset)), 1.0])
    start_moving(simulation)


def dissipation(simulation: Simulation) -> float:
    """Power (W) of all dampers, Σ c φ_dot²."""
    system, (state, _) = simulation.system, for_kernels(simulation)
    above, total = cable_direction(system.cable, state, 0).spin[0], 0.0
    for damping, spin in zip(system.carriages.hinge_damping, state.bodies.velocity[:, 2], strict=True):
        total += damping * (spin - above) ** 2
        above = spin
    return total


@case("dampers and springs of a thrown carriage", "energy and momentum", needs_jit=True)
def thrown_carriage() -> Iterator[Result]:
    """Nothing holds the cable: what dampers take is all that is lost, and no moment of a hinge turns the whole."""
    for integrator, steps in (("generalized_alpha", (1e-3, 5e-4, 2.5e-4)), ("runge_kutta", (2e-4, 1e-4))):
        missing, drifts = [], []
        for step in steps:
            simulation = thrown_cable(step, 0.0, hinges=HINGES, integrator=integrator)
            swing_lower_body(simulation, 5.0)
            start, (linear, angular, _) = simulation.energy().total, momentum(simulation)
            powers = [dissipation(simulation)]
            for number in range(1, round(0.3 / step) + 1):
                simulation.advance_to(number * step)
                powers.append(dissipation(simulation))
            taken = step * (sum(powers) - 0.5 * (powers[0] + powers[-1]))
            missing.append(abs(start - simulation.energy().total - taken))
            linear_after, angular_after, _ = momentum(simulation)
            drifts.append(abs(angular_after - angular))
        label = f"{integrator}, {1e3 * steps[-1]:g} ms"
        yield Result(f"energy that dampers take in 0.3 s, {label}", "J", start - simulation.energy().total, taken, 1e-5)
        yield Result(f"change of angular momentum, {label}", "kg m²/s", 0.0, drifts[-1], 1e-6)
        yield Result(f"change of momentum, {label}", "kg m/s", 0.0, float(np.abs(linear_after - linear).max()), 1e-9)
        if integrator == "generalized_alpha":
            yield Result("order in time of the balance of energy", "-", 2.0, observed_order(missing), 0.3)
            yield Result("order in time of the angular momentum", "-", 2.0, observed_order(drifts), 0.3)
