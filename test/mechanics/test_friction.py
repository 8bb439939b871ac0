from math import exp, radians, sin, tan

import numpy as np
import pytest

from cable_twin.mechanics.on_rope.buffer import stop_force
from cable_twin.mechanics.on_rope.friction import deflection, friction_force, settle_friction
from cable_twin.mechanics.state import allocate_state
from cable_twin.scenario import build_system, load_scenario
from cable_twin.scenario.builders.vehicles import PRESLIDING
from verification import JIT
from verification.drives import GRAVITY, MASS, gained_speed, slope

ROLLING, VISCOUS = 0.3, 4.0


@pytest.fixture
def joint():
    scenario = load_scenario(
        "seed_example",
        {"carriages.carriage.friction.rolling": ROLLING, "carriages.carriage.friction.viscous": VISCOUS},
    )
    system = build_system(scenario)
    state = allocate_state(system)
    state.joints.position[:] = state.friction_origin[:] = 2.0
    return system, state


def derivative(function, at, step=1e-7):
    return (function(at + step) - function(at - step)) / (2.0 * step)


@pytest.mark.parametrize("mobilised", [-0.9, 0.0, 0.4])
@pytest.mark.parametrize("way", [-2e-3, -1e-5, 3e-4])
def test_derivatives(joint, mobilised, way):
    system, state = joint
    state.friction_deflection[0] = mobilised
    state.joints.velocity[0] = 0.2

    def force(s=2.0 + way, s_dot=0.2, normal=50.0):
        state.joints.position[0], state.joints.velocity[0] = s, s_dot
        return friction_force(system.carriages, state, 0, normal)

    _, by_s, by_s_dot, by_normal = force()
    assert by_s == pytest.approx(derivative(lambda s: force(s=s)[0], 2.0 + way), rel=1e-5)
    assert by_s_dot == pytest.approx(derivative(lambda s_dot: force(s_dot=s_dot)[0], 0.2), rel=1e-5)
    assert by_normal == pytest.approx(derivative(lambda normal: force(normal=normal)[0], 50.0), rel=1e-5)


def test_it_is_smooth_where_the_motion_turns(joint):
    system, state = joint
    state.friction_deflection[0] = 0.6
    values = []
    for way in (-1e-9, 0.0, 1e-9):
        state.joints.position[0] = 2.0 + way
        values.append(deflection(system.carriages, state, 0)[0])
    np.testing.assert_allclose(values, 0.6, atol=1e-5)


def test_one_way_mobilises_as_dahl_has_it(joint):
    system, state = joint
    for way in np.linspace(0.0, 5e-3, 26):
        state.joints.position[0] = 2.0 + way
        assert deflection(system.carriages, state, 0)[0] == pytest.approx(1.0 - exp(-way / PRESLIDING), abs=1e-12)


def test_ways_add_up_whatever_the_steps(joint):
    system, state = joint
    for _ in range(7):
        state.joints.position[0] += 2e-4
        settle_friction(system.carriages, state, 0)
    assert state.friction_deflection[0] == pytest.approx(1.0 - exp(-7 * 2e-4 / PRESLIDING), abs=1e-12)
    assert state.friction_origin[0] == state.joints.position[0]


@pytest.mark.parametrize("way", [-1.0, -1e-4, 1e-4, 1.0])
def test_it_never_gives_more_than_its_limit(joint, way):
    system, state = joint
    state.friction_deflection[0] = -np.sign(way)
    state.joints.position[0] = 2.0 + way
    force = friction_force(system.carriages, state, 0, 50.0)[0]
    assert abs(force) <= ROLLING * 50.0 + 1e-12


def test_a_free_carriage_slides_down_faster_than_its_friction_holds():
    coefficient, angle = 0.3, radians(30.0)
    simulation = slope(angle, 90.0, friction={"rolling": coefficient}, step=1e-3 if JIT else 1e-2)
    expected = -GRAVITY * (sin(angle) - coefficient * np.cos(angle))
    assert gained_speed(simulation, 0.3, 0.8) == pytest.approx(expected, abs=5e-3)


def test_it_holds_where_its_limit_is_not_reached():
    coefficient, angle = 0.8, radians(30.0)
    simulation = slope(angle, 50.0, friction={"rolling": coefficient, "viscous": 1000.0}, step=2e-2)
    simulation.advance_to(4.0)
    assert simulation.state.friction_deflection[0] == pytest.approx(-tan(angle) / coefficient, abs=1e-3)
    at = simulation.snapshot.carriages["car"].arc_length
    assert simulation.advance_to(6.0).carriages["car"].arc_length == pytest.approx(at, abs=1e-6)


def test_terminal_speed_of_viscous_friction():
    angle, viscous = radians(20.0), 400.0
    simulation = slope(angle, 50.0, friction={"viscous": viscous}, step=5e-3)
    speed = simulation.advance_to(0.5).carriages["car"].speed
    assert speed == pytest.approx(-MASS * GRAVITY * sin(angle) / viscous, rel=2e-3)


@pytest.mark.parametrize(("s", "s_dot"), [(0.005, -0.5), (0.005, 0.1), (4.015, 0.4), (4.015, -0.1)])
def test_end_stop_derivatives(joint, s, s_dot):
    system, _ = joint

    def force(s, s_dot):
        return stop_force(system.carriages, system.cable, 0, s, s_dot)

    value, by_s, by_s_dot = force(s, s_dot)
    assert value * (1.0 if s < 1.0 else -1.0) > 0.0
    assert by_s == pytest.approx(derivative(lambda s: force(s, s_dot)[0], s), rel=1e-5)
    assert by_s_dot == pytest.approx(derivative(lambda s_dot: force(s, s_dot)[0], s_dot), rel=1e-5)


def test_end_stop_never_pulls(joint):
    system, _ = joint
    assert stop_force(system.carriages, system.cable, 0, 0.005, 1e3) == (0.0, 0.0, 0.0)
    assert stop_force(system.carriages, system.cable, 0, 4.015, -1e3) == (0.0, 0.0, 0.0)
    assert stop_force(system.carriages, system.cable, 0, 2.0, 3.0) == (0.0, 0.0, 0.0)
