"""Error that an iteration of Newton's method leaves, beside its estimate and beside the tolerance."""

from dataclasses import replace

import numpy as np
import pytest

from cable_twin.mechanics.solution.newton import LEAST_RATIO, second_order_error
from cable_twin.mechanics.solution.prediction import coefficients, factors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT

ROPE = {
    "unstrained_length": 100.0,
    "mass_per_length": 4.0,
    "axial_stiffness": 2e7,
    "bending_stiffness": 100.0,
    "elements": 20,
}
STEP, PUSH = 0.01, 0.05  # s; m/s
ANY, EXACT = 1.0, 1e-11  # m, tolerances of one iteration, and of as many as it takes
TIMES = 3.0  # the tolerance, which a step may leave: measured up to 2.4


def span(space, **solver):
    """One rope between two supports."""
    start, end = ([0.0, *[0.0] * (space - 2), 0.0], [100.2, *[0.0] * (space - 2), 20.0])
    cable = {**ROPE, "start": {"position": start}, "end": {"position": end}}
    return Simulation(load_scenario({"space": space, "cable": cable, "solver": {"step": STEP, **solver}}), samples=2)


def nodes(simulation):
    """Positions of the nodes of all ropes."""
    return [part.state.nodes.position[:, 0].copy() for part in simulation.parts.values()]


def apart(simulation, other):
    """Largest distance (m) between nodes of two simulations."""
    pairs = zip(nodes(simulation), nodes(other), strict=True)
    return max(float(np.linalg.norm(here - there, axis=1).max()) for here, there in pairs)


def again(simulation, full):
    """Take one step from the state of another simulation of the same scenario; return its iterations."""
    simulation.restore(replace(full, scenario=simulation.scenario))
    return simulation.advance_to(simulation.time + simulation.step).solver.iterations


@pytest.mark.parametrize("space", [2, 3])
def test_estimate_is_of_second_order_and_near_the_error(space):
    """Error of one iteration where a rope is pushed at a node: 0.1 to 2 times the estimate, both by the square."""
    one, exact, found = span(space, tolerance=ANY), span(space, tolerance=EXACT), []
    for push in (PUSH, 2.0 * PUSH):
        full = span(space).capture()
        full.state.nodes.velocity[7, 0, :] = push
        full.state.newton_ratio[0] = LEAST_RATIO  # as if accelerations were known
        assert again(one, full) == 1
        assert again(exact, full) > 1
        mass_factor, rate_factor = factors(coefficients(float(one.system.solver.spectral_radius)), STEP)
        estimate = second_order_error(one.system, one.state, one._engine._works[0], mass_factor, rate_factor, 0.0)
        found.append((apart(one, exact), estimate))
    for left, estimate in found:
        assert 0.1 * estimate < left < 2.0 * estimate
    for small, large in zip(*found, strict=True):
        assert large / small == pytest.approx(4.0, rel=0.2)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize(("scenario", "speed", "begin"), [("chairlift", 2.5, 12.5), ("gondola", 6.0, 14.5)])
def test_a_step_of_a_lift_leaves_about_its_tolerance(scenario, speed, begin):
    """Steps while vehicles pass towers and stations, each beside an exact one from the same state."""
    simulation, exact = (Simulation(load_scenario(scenario, values)) for values in ({}, {"solver.tolerance": 1e-10}))
    simulation.command("haul_rope", speed=speed)
    exact.command("haul_rope", speed=speed)
    simulation.advance_to(begin)
    left = 0.0
    for _ in range(60):
        full = simulation.capture()
        simulation.advance_to(simulation.time + simulation.step)
        again(exact, full)
        left = max(left, apart(simulation, exact))
    assert left < TIMES * simulation.system.solver.tolerance
