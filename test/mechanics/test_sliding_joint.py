"""Sliding joint: position, velocity and acceleration, end stops and friction, by differences."""

from math import exp

import numpy as np
import pytest
from systems import changed, difference, disturbed_state, make_system, second_difference

from cable_twin.mechanics.on_rope.buffer import stop_force
from cable_twin.mechanics.on_rope.friction import deflection, friction_force, settle_friction
from cable_twin.mechanics.on_rope.sliding_joint import (
    driven_force,
    joint_position,
    joint_velocity,
    place_joint,
    velocity_acceleration,
)
from cable_twin.mechanics.rope.point import element_at, point_at, position_on_cable
from cable_twin.mechanics.rope.shape_functions import shape_functions
from cable_twin.mechanics.state import allocate_state

ROUGH = {"rolling_friction": np.array([0.3]), "viscous_friction": np.array([5.0])}


def one_joint(s=1.2, **carriages):
    system = make_system(chains=(1,), carriages=carriages)
    state, work = disturbed_state(system)
    state.joints.position[0] = s
    place_joint(system.cable, state, 0)
    return system, state, work


@pytest.mark.parametrize(
    ("arc_length", "element", "local"),
    [(0.0, 0, 0.0), (0.59, 0, 0.59), (0.6, 1, 0.0), (1.3, 2, 0.2), (2.0, 3, 0.3), (2.4, 3, 0.7), (-0.2, 0, -0.2)],
)
def test_arc_length_belongs_to_an_element(arc_length, element, local):
    """Extrapolation of the end element beyond an end."""
    system = make_system(cable={"node_arc_length": np.array([0.0, 0.6, 1.1, 1.7, 2.1])})
    point = point_at(system.cable, allocate_state(system), arc_length)
    assert point.element == element
    np.testing.assert_allclose(point.shape, shape_functions(local, system.cable.element_length[element]), atol=1e-15)


@pytest.mark.parametrize(("arc_length", "element"), [(float("nan"), 0), (float("inf"), 2), (-float("inf"), 0)])
def test_what_is_no_arc_length_still_names_an_element(arc_length, element):
    """Broken states reach the checks of the solver instead of an index out of range."""
    system = make_system()
    assert element_at(system.cable, allocate_state(system), arc_length) == element


def test_cable_passes_through_its_nodes_smoothly():
    """r and r_x are continuous at a node: differences of r across it to 1e-9."""
    system, state, _ = one_joint()
    cable = system.cable
    node = cable.node_arc_length[1]
    np.testing.assert_allclose(position_on_cable(cable, state, node), state.nodes.position[1, 0], atol=1e-15)
    for side in (-1e-6, 1e-6):
        r_x = (np.array(position_on_cable(cable, state, node + side)) - state.nodes.position[1, 0]) / side
        np.testing.assert_allclose(r_x, state.nodes.position[1, 1], atol=2e-5)


@pytest.mark.parametrize("s", [0.05, 1.2, 2.0])
def test_velocity_and_acceleration_of_the_joint(s):
    """Differences of its position along the motion e + t e_dot, s + t s_dot: to 1e-9 and 1e-6."""
    system, state, _ = one_joint(s)

    def place(t):
        moved = changed(
            state,
            nodes_position=state.nodes.position + t * state.nodes.velocity,
            joints_position=state.joints.position + t * state.joints.velocity,
        )
        return np.array(joint_position(system.cable, moved, 0))

    velocity = difference(lambda t: place(t[0]), np.zeros(1), 1e-3)[:, 0]
    np.testing.assert_allclose(joint_velocity(system.cable, state, 0), velocity, atol=1e-9)
    np.testing.assert_allclose(velocity_acceleration(system.cable, state, 0), second_difference(place, 1e-3), atol=1e-6)


@pytest.mark.parametrize("s", [0.04, -0.02, 2.05, 2.2])
@pytest.mark.parametrize("s_dot", [-2.0, 0.0, 1.5])
def test_end_stop_in_contact(s, s_dot):
    """Closed form, its derivatives by differences to 1e-8, and the direction: off the end."""
    system, _, _ = one_joint()
    carriages, cable = system.carriages, system.cable
    force, by_s, by_s_dot = stop_force(carriages, cable, 0, s, s_dot)
    start = s < 1.0
    depth = 0.1 - s if start else s - 2.0
    inwards = -s_dot if start else s_dot
    assert abs(force) == pytest.approx(800.0 * depth * (1.0 + 0.3 * inwards), rel=1e-12)
    assert (force > 0.0) == start
    exact = difference(lambda x: np.array(stop_force(carriages, cable, 0, *x)[0]), np.array([s, s_dot]), 1e-3)
    np.testing.assert_allclose([by_s, by_s_dot], exact, atol=1e-8)


def test_end_stop_never_pulls():
    system, _, _ = one_joint()
    for s, s_dot in ((1.0, 3.0), (0.05, 4.0), (2.05, -4.0), (0.11, 0.0), (1.99, 0.0)):
        assert stop_force(system.carriages, system.cable, 0, s, s_dot) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("way", [-0.03, -1e-4, 2e-3, 0.05])
@pytest.mark.parametrize("before", [-0.9, 0.0, 0.6])
def test_mobilised_friction(way, before):
    """Dahl's law in closed form, its derivative by differences to 1e-8."""
    system, state, _ = one_joint(**ROUGH)
    state.friction_origin[0], state.friction_deflection[0] = 1.2, before

    def share(s):
        moved = changed(state, joints_position=s)
        return np.array(deflection(system.carriages, moved, 0)[0])

    z, z_by_s = deflection(system.carriages, changed(state, joints_position=np.array([1.2 + way])), 0)
    sign = np.sign(way)
    assert z == pytest.approx(sign + (before - sign) * exp(-abs(way) / 1e-2), abs=1e-13)
    exact = difference(share, np.array([1.2 + way]), 2e-5)[0]
    assert z_by_s == pytest.approx(exact, abs=1e-8 * 100.0)
    # the law itself: dz/ds = (1 - z sign) / p
    assert z_by_s == pytest.approx((1.0 - z * sign) / 1e-2, rel=1e-9)


def test_friction_is_smooth_through_zero_speed():
    """Mobilised share single-valued at rest, and within -1 and 1 over a long slip in either direction."""
    system, state, _ = one_joint(**ROUGH)
    state.friction_origin[0], state.friction_deflection[0] = 1.2, 0.4
    shares = [
        deflection(system.carriages, changed(state, joints_position=np.array([1.2 + way])), 0)[0]
        for way in (-9.0, -1e-9, 0.0, 1e-9, 9.0)
    ]
    np.testing.assert_allclose(shares, [-1.0, 0.4, 0.4, 0.4, 1.0], atol=3e-7)


def test_friction_force_and_its_derivatives():
    """By differences over s, s_dot and the normal force: to 1e-7."""
    system, state, _ = one_joint(**ROUGH)
    state.friction_origin[0], state.friction_deflection[0] = 1.195, 0.3

    def force(x):
        moved = changed(state, joints_position=x[:1], joints_velocity=x[1:2])
        return np.array(friction_force(system.carriages, moved, 0, x[2])[0])

    at = np.array([1.2, 0.7, 40.0])
    moved = changed(state, joints_position=at[:1], joints_velocity=at[1:2])
    got = friction_force(system.carriages, moved, 0, at[2])
    z = 1.0 + (0.3 - 1.0) * exp(-0.5)
    assert got[0] == pytest.approx(-0.3 * 40.0 * z - 5.0 * 0.7, rel=1e-12)
    np.testing.assert_allclose(got[1:], difference(force, at, 2e-5), atol=1e-7 * 500.0)


def test_friction_takes_up_where_the_step_ended():
    """Mobilised share after two half slips and after the whole one: to 1e-14."""
    system, state, _ = one_joint(**ROUGH)
    state.friction_origin[0], state.friction_deflection[0] = 1.2, -0.5
    state.joints.position[0] = 1.208
    whole = deflection(system.carriages, state, 0)[0]
    state.joints.position[0] = 1.203
    settle_friction(system.carriages, state, 0)
    assert state.friction_origin[0] == 1.203
    state.joints.position[0] = 1.208
    assert deflection(system.carriages, state, 0)[0] == pytest.approx(whole, abs=1e-14)


def test_drive_force_is_what_friction_and_stops_leave():
    """λ along the cable less friction and end stop, by definition: to 1e-11."""
    system, state, _ = one_joint(0.06, **ROUGH)
    state.friction_origin[0] = 0.055
    step = 1e-4
    near = np.array([position_on_cable(system.cable, state, 0.06 + k * step) for k in (-2, -1, 1, 2)])
    tangent = near[0] - 8 * near[1] + 8 * near[2] - near[3]
    tangent /= np.linalg.norm(tangent)
    force = state.multipliers[0]
    along = force @ tangent
    normal = np.linalg.norm(force - along * tangent)
    stop = stop_force(system.carriages, system.cable, 0, 0.06, state.joints.velocity[0])[0]
    friction = friction_force(system.carriages, state, 0, normal)[0]
    assert stop > 0.0
    assert friction != 0.0
    assert driven_force(system, state, 0) == pytest.approx(along - friction - stop, abs=1e-9)
