"""Warnings of a step with which a vehicle crosses nodes too fast, or swings in too few steps."""

import math
import warnings

import pytest

from cable_twin.scenario import load_scenario
from cable_twin.scenario.sections.vehicles import Body, Carriage
from cable_twin.simulation import Simulation
from cable_twin.simulation.start_checks import growing_steps, highest_speed, swing_period

# waves of about 220 m/s, so 0.1 of an element of 10.4 m in 5 ms: only what is as fast as 130 m/s is too fast
PAPER = {"cable.joint": "paper", "cable.elements": 100}
FAST = {"carriages.cabin.drive.limits.speed": 150.0} | PAPER
WARNING = r"solver\.step of 0\.005 s is above 0\.0044\d* s, the longest for a vehicle at 150 m/s on elements of 10\.4 m"


def test_such_a_step_is_warned_of():
    with pytest.warns(UserWarning, match=WARNING):
        Simulation(load_scenario("single_span", FAST))


NODE = {"cable.joint": "node"}  # which goes along with the vehicle


@pytest.mark.parametrize(
    "changes", [PAPER, FAST | NODE, {**FAST, "solver.step": 0.004}, {**FAST, "solver.spectral_radius": 0.6}]
)
def test_others_are_not(changes):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*ropeways run at up to")
        Simulation(load_scenario("single_span", changes))


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("single_span", {"cable.elements": 100, "carriages.cabin.drive.limits.speed": 450.0}),
        ("jig_back", {"solver.step": 0.05}),  # several ropes, in space
        ("chairlift", {"solver.step": 0.25, "space": 2}),
    ],
)
def test_fewer_than_five_steps_in_an_element_of_a_joint_with_a_node_of_its_own_are_warned_of(name, changes):
    with pytest.warns(
        UserWarning, match=r"solver\.step of 0\.\d+ s: a vehicle at its highest .* in [1-4]\.\d steps; below 5 "
    ):
        Simulation(load_scenario(name, changes))


def test_fewer_than_twelve_steps_in_a_swing_are_warned_of():
    still = {"carriages.cabin.drive.limits.speed": None, "carriages.cabin.joint": "fixed", "solver.step": 0.7}
    with pytest.warns(UserWarning, match=r"solver\.step of 0\.7 s: 'cabin' swings once in 5\.\d s, in \d\.\d steps"):
        Simulation(load_scenario("single_span", still))


def test_the_period_of_a_swing_is_that_of_a_compound_pendulum():
    rod = Body(mass=3.0, inertia=1.0, upper_pivot=(0.0, 1.0), lower_pivot=(0.0, -1.0))  # two, 4 m long together
    pair = Carriage.model_construct(bodies={"upper": rod, "lower": rod})
    assert swing_period(pair, 9.81) == pytest.approx(2.0 * math.pi * math.sqrt(2.0 / 3.0 * 4.0 / 9.81))
    assert swing_period(pair, 0.0) == math.inf


def test_limits():
    shortest, longest = growing_steps(0.7, 1.0, 10.0, 100.0)
    assert shortest == pytest.approx(6.37e-3, rel=1e-3)
    assert longest == pytest.approx(12.6e-3, rel=2e-3)
    assert growing_steps(0.0, 1.0, 10.0, 100.0)[0] == float("inf")
    assert growing_steps(0.7, 1.0, 0.0, 100.0)[0] == float("inf")
    assert growing_steps(1.0, 1.0, 10.0, 100.0) == (0.0, float("inf"))


@pytest.mark.parametrize(("name", "speed"), [("single_span", 10.0), ("gondola", 6.0), ("jig_back", 10.0)])
def test_speed_of_what_moves_by_itself_or_with_its_rope(name, speed):
    scenario = load_scenario(name)
    assert highest_speed(scenario, scenario) == speed
