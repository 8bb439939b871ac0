"""Small swings along a rope: no energy lost by the tolerance of Newton's iteration."""

import pytest
from small_tramway import TRAMWAY

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT
from verification.loops import BODY, loop, wheels

pytestmark = pytest.mark.skipif(not JIT, reason="minutes without compilation")

SPEED = 1e-3  # m/s, of a push
TIGHT = 1e-12  # m, a tolerance that leaves nothing
WEIGHT = 12e3  # kg


def one_rope(space, **solver):
    """Rope with a displaced counterweight, and its mass (kg)."""
    cable = {**TRAMWAY["cable"], "damping_time": 0.0}
    simulation = Simulation(load_scenario({"space": space, "cable": cable, "solver": solver}), samples=2)
    full = simulation.capture()
    full.state.nodes.velocity[-1, 0] = SPEED * simulation.system.counterweights.direction[1]
    simulation.restore(full)
    return simulation, float(simulation.system.counterweights.mass[1])


def several_ropes(space, *, damping_time=0.0, **solver):
    """Lift of two strands with chairs and a displaced counterweight, and its mass (kg)."""
    across = [0.0] * (space - 2)
    simulation = loop(
        length=209.5,
        top=(200.0, *across, 60.0),
        rope={"elements": 30, "bending_stiffness": 3e3, "damping_time": damping_time},
        back={"counterweight": {"direction": [-0.958, *across, -0.287], "mass": WEIGHT}},
        carriers={"name": "chair", "count": 4, "first": 60.0, "spacing": 100.0, "bodies": BODY},
        solver=solver,
    )
    wheels(simulation).carriage.velocity[1] = SPEED
    return simulation, WEIGHT


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("pushed", [one_rope, several_ropes])
def test_no_energy_goes_by_the_tolerance(pushed, space):
    """Energy after 2 s of 1 ms steps against a far smaller tolerance: to 0.01 %."""
    left = []
    for tolerance in ({}, {"tolerance": TIGHT}):
        simulation, mass = pushed(space, step=0.001, **tolerance)
        start = simulation.energy().total
        simulation.advance_to(2.0)
        left.append(1.0 + (simulation.energy().total - start) / (0.5 * mass * SPEED**2))
    assert left[1] == pytest.approx(1.0, abs=0.05)
    assert left[0] == pytest.approx(left[1], abs=1e-4)


def test_what_stands_still_takes_one_iteration():
    simulation, _ = several_ropes(2, damping_time=0.01, step=0.01)
    wheels(simulation).carriage.velocity[1] = 0.0
    report = simulation.advance_to(2.0).solver
    assert report.iterations <= 1.1 * report.steps
