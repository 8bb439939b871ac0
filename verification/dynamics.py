"""Cases in motion: the example of the paper, the integrators against each other and their orders."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.solution.runge_kutta import stable_step
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation import Simulation, SolverError
from verification import Result, case
from verification.models import beam, changing, observed_order, seed, start_moving

# joint (x, z) in m at times in s: an independent prototype of the same equations, other code and other linear solver
SEED_POSITIONS = {
    ("continuum", 96): {0.0: (3.1041, -0.6442), 0.5: (2.465, -0.816), 1.0: (1.804, -0.875), 2.0: (0.807, -0.742)},
    ("continuum", 24): {2.0: (0.828, -0.744)},
    ("element_frame", 24): {2.0: (0.899, -0.725)},
    ("element_frame", 96): {2.0: (0.806, -0.742)},
}


@case("paper's example, joint positions", "independent prototype", needs_jit=True)
def seed_positions() -> Iterator[Result]:
    """Both elastic models, 1 ms, spectral radius 0.7."""
    for (model, elements), places in SEED_POSITIONS.items():
        simulation = seed(cable__elements=elements, cable__elastic_model=model)
        for time, (x, z) in places.items():
            got = simulation.advance_to(time).carriages["carriage"].position
            where = f"{model}, {elements} elements, {time:g} s"
            yield Result(f"x, {where}", "m", x, float(got[0]), 3e-3)
            yield Result(f"z, {where}", "m", z, float(got[2]), 3e-3)


@case("paper's integrator against the default", "Seo et al. 2004, eq. 16", needs_jit=True, long=True)
def integrators_agree() -> Iterator[Result]:
    """The paper's three meshes; 0.8 of the stable step against 50 µs."""
    for model in ("continuum", "element_frame"):
        for elements in (12, 18, 24):
            common: dict[str, Any] = {"cable__elements": elements, "cable__elastic_model": model}
            default = seed(**common, solver__step=5e-5, solver__tolerance=1e-9)
            time = 0.1
            step = time / np.ceil(time / (0.8 * stable_step(default.system)))
            paper = seed(**common, solver__integrator="runge_kutta", solver__step=float(step))
            got = paper.advance_to(time)
            want = default.advance_to(time)
            apart = got.carriages["carriage"].position - want.carriages["carriage"].position
            yield Result(
                f"joint apart after 0.1 s, {model}, {elements} elements", "m", 0.0, float(np.linalg.norm(apart)), 1e-3
            )
            yield Result(
                f"drift of the constraints, {model}, {elements}", "m", 0.0, got.solver.constraint_residual, 1e-9
            )


SOFT_SPAN: dict[str, Any] = {
    "length": 4.2,
    "mass_per_length": 1.0,
    "axial": 400.0,
    "bending": 2.0,
    "elements": 6,
    "end": (4.0, 0.0),
    "supports": ("pinned", "pinned"),
    "shape": "equilibrium",
    "carriages": {
        "car": {
            "arc_length": 3.0,
            "bodies": {"body": {"mass": 1.0, "inertia": 0.1, "upper_pivot": [0.0, 0.3]}},
        }
    },
}


def after_a_step_of_force(name: str, drive: str, changes: dict[str, Any], step: float) -> FloatArray:
    """Place (m) and speed (m/s) of all vehicles 1.28 s after a drive's force rose to 20 kN at once."""
    simulation = Simulation(load_scenario(name, {**changes, "solver.step": step, "solver.tolerance": 1e-12}))
    simulation.advance_to(0.64)
    simulation.command(drive, force=20e3)
    columns = simulation.advance_to(1.92).columns
    return np.concatenate([columns.joint_position.ravel(), columns.speed])


def soft_span(steps: int, **solver: Any) -> tuple[FloatArray, Simulation]:
    """A carriage let go on a soft, heavy rope: joint, arc length and pitch after 0.8 s, one node on its way."""
    simulation = beam(**SOFT_SPAN, cable={"joint": "paper"}, step=0.8 / steps, tolerance=1e-12, **solver)
    car = simulation.advance_to(0.8).carriages["car"]
    return np.array([*car.position[[0, 2]], car.arc_length, car.bodies["body"].pitch]), simulation


@case("order in time, paper's integrator over a node", "classical Runge-Kutta, 4", needs_jit=True)
def runge_kutta_order() -> Iterator[Result]:
    """The node is found within a step, or the jump of r_xx there would cost the order."""
    reference, _ = soft_span(6400, integrator="runge_kutta")
    errors = []
    for steps in (400, 800, 1600):
        got, simulation = soft_span(steps, integrator="runge_kutta")
        errors.append(float(np.abs(got - reference).max()))
        yield Result(f"nodes passed, {steps} steps", "-", 1.0, float(simulation.snapshot.solver.halvings), 0.0)
    yield Result("error after 0.8 s in 1600 steps", "m", 0.0, errors[-1], 1e-8)
    yield Result("order", "-", 4.0, observed_order(errors), 0.2)


@case("order in time, default integrator", "Chung, Hulbert 1993: 2", needs_jit=True)
def generalized_alpha_order() -> Iterator[Result]:
    """A release, against the other integrator; and a step of force on a vehicle, against finer steps."""
    reference, _ = soft_span(6400, integrator="runge_kutta")
    for radius in (0.5, 0.7, 0.9):
        errors = []
        for steps in (1600, 3200):
            got, _ = soft_span(steps, spectral_radius=radius)
            errors.append(float(np.abs(got - reference).max()))
        yield Result(f"order, spectral radius {radius:g}", "-", 2.0, observed_order(errors), 0.1)
    got, simulation = soft_span(3200)
    lag = (reference - got)[2] / simulation.snapshot.carriages["car"].speed
    yield Result("lag of a release, in steps", "-", 0.0, float(lag / simulation.step), 0.02)
    kinds = (
        ("one rope", "single_span", "cabin", {}),
        ("in space", "single_span", "cabin", {"space": 3}),
        ("several ropes", "jig_back", "haul_rope", {}),
    )
    for kind, *scenario in kinds:
        places = [after_a_step_of_force(*scenario, step) for step in (0.02, 0.0025, 0.000625)]
        first, last = (float(np.abs(place - places[-1]).max()) for place in places[:2])
        order = np.log2(first / last) / 3.0
        yield Result(f"order after a step of force, {kind}", "-", 2.0, float(order), 0.5)


@case("stable step of the paper's integrator", "frequencies of the endless mesh", needs_jit=True)
def stable_steps() -> Iterator[Result]:
    """The paper's rope, disturbed by 1 mm/s: bounded at 0.95 of the step, not at 1.05.

    The axial wave crosses an element in l √(ρA/EA). An element's highest axial frequency is √42 over that time for
    two nodes in step (their slopes alternate with nothing else, 2/105 + 2/140 against 4/15 - 2/30).
    """
    resolved = load_scenario("seed_example").resolved()
    for elements in (12, 18, 24):
        common: dict[str, Any] = {"carriages": {}, "cable.elements": elements, "solver.integrator": "runge_kutta"}
        limit = stable_step(build_system(load_scenario(resolved, common)))
        cable = build_system(load_scenario(resolved, common)).cable
        crossing = cable.element_length[0] * np.sqrt(cable.mass_per_length / cable.axial_stiffness)
        yield Result(f"stable step, {elements} elements", "µs", 1e6 * np.sqrt(8.0 / 42.0) * crossing, 1e6 * limit, 1e-3)
        for share in (0.95, 1.05):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                simulation = Simulation(load_scenario(resolved, {**common, "solver.step": share * limit}))
            generator = np.random.default_rng(1)
            with changing(simulation) as state:
                velocities = state.nodes.velocity
                change = 1e-3 * generator.standard_normal((elements - 1, 2, velocities.shape[2]))
                velocities[1:-1] += change[:, [0, 1, 1]]  # both slopes of a node alike
            before = simulation.energy()
            bounded = True
            try:
                simulation.advance_to(3000 * simulation.step)
            except SolverError:
                bounded = False
            gain = (simulation.energy().total - before.total) / before.kinetic
            bounded = bool(bounded and gain < 1.0)
            yield Result(f"bounded, {elements} elements, {share:g} of it", "-", float(share < 1.0), float(bounded), 0.0)


PENDULUM: dict[str, Any] = {"length": 1.2, "mass_per_length": 9.972, "axial": 1260.0, "bending": 0.1}


def flexible_pendulum(elements: int, steps: int, radius: float = 1.0) -> tuple[FloatArray, float]:
    """Curve (25, 2) in m of a rubber beam let go level, after 0.3 s, and what energy it gained (J)."""
    simulation = beam(**PENDULUM, elements=elements, step=0.3 / steps, spectral_radius=radius, tolerance=1e-11)
    start_moving(simulation)
    before = simulation.energy().total
    simulation.advance_to(0.3)
    return simulation.cable_positions(np.linspace(0.0, 1.2, 25))[:, [0, 2]], simulation.energy().total - before


@case("flexible pendulum", "self-convergence; beam of Berzeri, Shabana 2000, stiffer in bending", needs_jit=True)
def pendulum_convergence() -> Iterator[Result]:
    """Rubber beam, 10 % strain, from level; 36 J are in motion after 0.3 s."""
    curves, gains = [], []
    for steps in (400, 800, 1600, 3200):
        curve, gained = flexible_pendulum(8, steps)
        curves.append(curve)
        gains.append(abs(gained))
    apart = [float(np.sqrt(np.mean((a - b) ** 2))) for a, b in itertools.pairwise(curves)]
    yield Result("order in time", "-", 2.0, observed_order(apart), 0.1)
    yield Result("order of the energy error in time", "-", 2.0, observed_order(gains), 0.05)
    yield Result("energy error, 3200 steps", "J", 0.0, gains[-1], 5e-6)
    curves = [flexible_pendulum(elements, 800, 0.7)[0] for elements in (4, 8, 16, 32, 64)]
    apart = [float(np.sqrt(np.mean((a - b) ** 2))) for a, b in itertools.pairwise(curves)]
    yield Result("order in elements, over 4 to 64", "-", 3.0, observed_order([apart[0], apart[-1]], 8.0), 0.7)
    yield Result("32 against 64 elements", "m", 0.0, apart[-1], 5e-5)


@case("constraints for a minute", "eq. 14", needs_jit=True)
def constraints_hold() -> Iterator[Result]:
    """The paper's example for 60 s."""
    report = seed().advance_to(60.0).solver
    yield Result("largest gap of a joint", "m", 0.0, report.constraint_residual, 1e-9)
    yield Result("share of the steps that had to be halved", "-", 0.0, report.halvings / report.steps, 5e-4)
