"""Cases of rotation in space: free body, pendulums, orders of both integrators."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from math import cos, sin, sqrt
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope
from cable_twin.mechanics.solution.equilibrium import settle
from cable_twin.mechanics.solution.stepping import integrator_named
from cable_twin.mechanics.state import allocate_workspace
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY, changing, observed_order, start_moving

INERTIA = (1.0, 2.0, 2.5)  # kg m², principal
SPIN = (sqrt(1.24), 0.0, 1.0)  # rad/s in the axes of the body: close to what goes over into a turn about the middle one
ARM = 2.0  # m
SOFT_ROPE = {
    "unstrained_length": 10.0,
    "mass_per_length": 4.0,
    "axial_stiffness": 2e3,
    "bending_stiffness": 5.0,
    "elements": 4,
    "diameter": 0.05,
}


def free_spin(time: float) -> FloatArray:
    """Spin (3,) in rad/s of the free body in its axes, by Euler's equations (Landau, Lifshitz, Mechanics, § 37)."""
    one, two, three = INERTIA
    twice, squared = np.dot(INERTIA, np.square(SPIN)), np.dot(np.square(INERTIA), np.square(SPIN))
    rate, modulus = tumbling()
    sn, cn, dn, _ = ellipj(rate * time, modulus)
    first = sqrt((twice * three - squared) / (one * (three - one)))
    second = sqrt((twice * three - squared) / (two * (three - two)))
    third = sqrt((squared - twice * one) / (three * (three - one)))
    return np.array([first * cn, -second * sn, third * dn])


def tumbling() -> tuple[float, float]:
    """Rate (rad/s) and parameter k² of the elliptic functions of that motion."""
    one, two, three = INERTIA
    twice, squared = float(np.dot(INERTIA, np.square(SPIN))), float(np.dot(np.square(INERTIA), np.square(SPIN)))
    rate = sqrt((three - two) * (squared - twice * one) / (one * two * three))
    return rate, (two - one) * (twice * three - squared) / ((three - two) * (squared - twice * one))


def tumble(integrator: str, steps: int, duration: float, parts: int = 1, radius: float = 1.0) -> list[FloatArray]:
    """Quaternion and spin (7,) of a body that is held at its centre and free to turn, at the ends of all parts.

    A scenario holds the heading of what hangs from the rope, so the same system is taken without that.
    """
    body = {"mass": 3.0, "inertia_tensor": list(INERTIA), "inertia": 1.0, "upper_pivot": [0.0, 0.0]}
    scenario = {
        "gravity": 0.0,
        "cable": {**SOFT_ROPE, "start": {"position": [0.0, 0.0, 0.0]}, "end": {"position": [10.4, 0.0, 0.0]}},
        "carriages": {"body": {"arc_length": 5.0, "joint": "fixed", "bodies": {"body": body}}},
        "solver": {"step": duration / steps, "tolerance": 1e-14, "integrator": integrator, "spectral_radius": radius},
    }
    simulation = Simulation(load_scenario(scenario))
    system, state = simulation.system, simulation.capture().state
    system = system._replace(carriages=system.carriages._replace(held=np.zeros(1, dtype=np.int64)))
    start = Rotation.from_rotvec([0.3, -0.5, 0.2])
    state.bodies.position[0, 3:] = start.as_quat()
    state.bodies.velocity[0, 3:] = start.apply(SPIN)
    turning = -np.cross(SPIN, np.multiply(INERTIA, SPIN)) / INERTIA
    state.bodies.acceleration[0, 3:] = state.bodies.algorithmic[0, 3:] = start.apply(turning)
    alone, found = Assembly([Rope(system, state, allocate_workspace(system))]), []
    for _ in range(parts):
        assert integrator_named(integrator)(*alone.arguments, steps // parts)[0]
        found.append(np.concatenate([state.bodies.position[0, 3:], state.bodies.velocity[0, 3:]]))
    return found


@case(
    "a body that spins freely",
    "Euler's equations: Jacobi's elliptic functions; energy, momentum",
    needs_jit=True,
    long=True,
)
def free_body() -> Iterator[Result]:
    """Dzhanibekov's flip: the middle axis turns over and back, again and again, here four times."""
    rate, modulus = tumbling()
    period = 4.0 * float(ellipk(modulus)) / rate
    duration, start = 2.0 * period, Rotation.from_rotvec([0.3, -0.5, 0.2])
    momentum = start.apply(np.multiply(INERTIA, SPIN))
    energy = 0.5 * float(np.dot(INERTIA, np.square(SPIN)))
    looks, along, energies, momenta = 80, [], [], []
    for row in tumble("runge_kutta", 16000, duration, looks):
        turn = Rotation.from_quat(row[:4])
        own = turn.inv().apply(row[4:])
        along.append(float(turn.apply([0.0, 1.0, 0.0]) @ momentum / np.linalg.norm(momentum)))
        energies.append(0.5 * float(np.dot(INERTIA, np.square(own))))
        momenta.append(turn.apply(np.multiply(INERTIA, own)))
    yield Result(
        "energy lost in four flips, of the whole", "-", 0.0, max(abs(e / energy - 1.0) for e in energies), 1e-9
    )
    apart = np.linalg.norm(np.array(momenta) - momentum, axis=1).max() / np.linalg.norm(momentum)
    yield Result("momentum apart, of the whole", "-", 0.0, float(apart), 1e-9)
    yield Result("spin apart after four flips", "rad/s", 0.0, float(np.abs(own - free_spin(duration)).max()), 1e-8)
    tips = INERTIA[1] * abs(free_spin(period / 4.0)[1]) / float(np.linalg.norm(momentum))
    for name, got, want in (("most", max(along), tips), ("least", min(along), -tips)):
        yield Result(f"middle axis along the momentum, {name}", "-", want, got, 1e-3)
    changes = np.count_nonzero(np.diff(np.sign(along)))
    yield Result("flips", "-", 4.0, float(changes), 0.0)
    finer = 3200, 6400, 12800
    for name, counts, order, radius in (
        ("runge_kutta", (400, 800, 1600), 4.0, 1.0),
        ("generalized_alpha", finer, 2.0, 0.7),
        ("generalized_alpha", finer, 2.0, 1.0),
    ):
        errors = []
        for steps in counts:
            (row,) = tumble(name, steps, 0.5 * period, radius=radius)
            own = Rotation.from_quat(row[:4]).inv().apply(row[4:])
            errors.append(float(np.abs(own - free_spin(0.5 * period)).max()))
        label = name if name == "runge_kutta" else f"{name}, spectral radius {radius:g}"
        yield Result(f"order, {label}", "-", order, observed_order(errors), 0.1)


def swung(up: FloatArray, tangent: FloatArray) -> FloatArray:
    """Axes of a hanging body as columns: z to its pivot, the lateral one across the rope."""
    left = np.cross(up, tangent)
    left /= np.linalg.norm(left)
    return np.stack([np.cross(left, up), left, up], axis=1)


def spherical(integrator: str, step: float, swing: float, speed: float) -> Simulation:
    """A point mass on an arm below the end of a rope, aside by `swing` (rad), that goes across at `speed` (m/s)."""
    ball = {"mass": 2.0, "inertia": 1e-9, "upper_pivot": [0.0, ARM]}
    scenario = {
        "cable": {**SOFT_ROPE, "start": {"position": [0.0, 0.0, 0.0]}, "end": {"position": [9.0, 3.0, 1.0]}},
        "carriages": {"ball": {"arc_length": 0.05, "joint": "fixed", "bodies": {"ball": ball}}},
        "solver": {"step": step, "tolerance": 1e-13, "integrator": integrator, "spectral_radius": 1.0},
    }
    simulation = Simulation(load_scenario(scenario))
    with changing(simulation) as state:
        state.joints.position[:] = 0.0  # where the rope is held, and the end stop has no say over what is fixed
        settle(simulation.system, state, allocate_workspace(simulation.system))
        tangent = state.nodes.position[0, 1] / np.linalg.norm(state.nodes.position[0, 1])
        up = np.array([-sin(swing), 0.0, cos(swing)])
        axes, velocity = swung(up, tangent), np.array([0.0, speed, 0.0])
        up_rate = -velocity / ARM
        spin, hold = np.cross(up, up_rate), np.cross(axes[:, 1], tangent)
        spin = spin - (hold @ spin) / (hold @ up) * up
        state.bodies.position[0] = [*(-ARM * up), *Rotation.from_matrix(axes).as_quat()]
        state.bodies.velocity[0] = [*velocity, *spin]
    start_moving(simulation)
    return simulation


def oscillation(swing: float, speed: float) -> tuple[float, float, float, float]:
    """Time (s), turn about z (rad) and depths (m) at both ends of half an oscillation of a spherical pendulum."""
    depth, momentum = ARM * cos(swing), ARM * sin(swing) * speed
    energy = 0.5 * speed**2 - GRAVITY * depth

    def left(z: float) -> float:
        """Square of ARM times the rate of the depth z."""
        return 2.0 * (energy + GRAVITY * z) * (ARM**2 - z**2) - momentum**2

    other = brentq(left, depth + 1e-9 * ARM, ARM * (1.0 - 1e-12), xtol=1e-15)
    third = -(depth + other) - energy / GRAVITY  # the sum of the roots of `left` is -energy / g
    middle, half = 0.5 * (depth + other), 0.5 * (other - depth)

    def time_by(angle: float) -> float:
        """Dt by the angle where z = middle + half sin(angle)."""
        return ARM / sqrt(2.0 * GRAVITY * (middle + half * sin(angle) - third))

    def turn_by(angle: float) -> float:
        return time_by(angle) * momentum / (ARM**2 - (middle + half * sin(angle)) ** 2)

    ends = -0.5 * np.pi, 0.5 * np.pi
    time, turn = (quad(function, *ends, epsabs=1e-13)[0] for function in (time_by, turn_by))
    return time, turn, depth, other


@case("spherical pendulum", "quadratures of energy and momentum about z", needs_jit=True, long=True)
def spherical_pendulum() -> Iterator[Result]:
    """Swung out by 0.9 rad and sent across: after three oscillations it is as high again, turned about z."""
    swing, speed = 0.9, 1.5
    half, turned, top, bottom = oscillation(swing, speed)
    expected = Rotation.from_rotvec([0.0, 0.0, 6.0 * turned]).apply([ARM * sin(swing), 0.0, -top])
    for integrator, counts, within in (("runge_kutta", (1200,), 1e-6), ("generalized_alpha", (1200, 2400, 4800), 1e-4)):
        errors = []
        for steps in counts:
            simulation = spherical(integrator, 6.0 * half / steps, swing, speed)
            depth = -float(simulation.advance_to(5.0 * half).carriages["ball"].bodies["ball"].position[2])
            simulation.advance_to(6.0 * half)
            state = simulation.state.bodies
            errors.append(float(np.linalg.norm(state.position[0, :3] - expected)))
        yield Result(f"after three oscillations, apart, {integrator}", "m", 0.0, errors[-1], within)
        yield Result(f"depth at the other end, {integrator}", "m", bottom, depth, within)
        momentum = float(np.cross(state.position[0, :3], state.velocity[0, :3])[2])
        yield Result(f"momentum about z, {integrator}", "m²/s", ARM * sin(swing) * speed, momentum, within)
    yield Result(f"order, {integrator}", "-", 2.0, observed_order(errors), 0.15)


def blown(integrator: str, steps: int, turns: str) -> tuple[FloatArray, Simulation]:
    """A hanger and a cabin on a soft rope in a wind that has turned: where they are after 0.8 s, and how turned."""
    hanger: dict[str, Any] = {"mass": 3.0, "inertia": 1.0, "upper_pivot": [0.0, 1.5], "lower_pivot": [0.0, -1.5]}
    hanger |= {"damping": 2.0, "stiffness": 5.0, "roll_damping": 1.0}
    cabin = {"mass": 8.0, "inertia": 2.0, "inertia_tensor": [2.0, 1.0, 1.5, 0.1, 0.05, -0.1]}
    cabin |= {"upper_pivot": [0.1, 1.0], "drag_area": 0.4, "turns": turns}
    scenario = {
        "cable": {
            **SOFT_ROPE,
            "joint": "paper",  # the only one of both integrators
            "start": {"position": [0.0, 0.0, 0.0]},
            "end": {"position": [9.0, 2.0, 1.0]},
        },
        "carriages": {"car": {"arc_length": 4.6, "bodies": {"hanger": hanger, "cabin": cabin}}},
        "air": {"wind": [3.0, 12.0, 0.0]},
        "solver": {"step": 0.8 / steps, "tolerance": 1e-13, "integrator": integrator, "spectral_radius": 0.9},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = Simulation(load_scenario(scenario))
    with changing(simulation) as state:
        state.wind[:] = [6.0, -10.0, 0.0]
    start_moving(simulation)
    simulation.advance_to(0.8)
    return np.concatenate([simulation.state.joints.position, simulation.state.bodies.position.ravel()]), simulation


@case("order in time in space", "classical Runge-Kutta, 4; Chung, Hulbert 1993: 2", needs_jit=True, long=True)
def orders_in_space() -> Iterator[Result]:
    """A sliding joint that holds the heading, springs and dampers, either joint between the bodies, wind across."""
    for turns in ("universal", "revolute"):
        reference, simulation = blown("runge_kutta", 1600, turns)
        gap = simulation.snapshot.solver.constraint_residual
        yield Result(f"drift of the joints, {turns}", "m", 0.0, gap, 1e-9)
        for name, counts, order in (("runge_kutta", (200, 400), 4.0), ("generalized_alpha", (800, 1600), 2.0)):
            errors = [float(np.abs(blown(name, steps, turns)[0] - reference).max()) for steps in counts]
            yield Result(f"order, {name}, {turns}", "-", order, observed_order(errors), 0.15)
