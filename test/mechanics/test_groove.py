"""Grooves of towers in space: force sideways, and the two ways out of them, each latched for good."""

import numpy as np
import pytest
from systems import dense_blocks, disturbed_state, make_system

from cable_twin.mechanics.on_rope.tower import (
    add_towers,
    contact_energy,
    contact_force,
    contact_frame,
    derail,
    find_contact,
    settle_towers,
)
from cable_twin.mechanics.parameters import IN_GROOVE, LIFTED, OUT_LEFT, OUT_RIGHT

HEIGHT = 0.05  # m, of the groove


def lying(aside=0.0, depth=0.03, ratio=0.5, hold_down=False):
    """A straight level rope on one contact, `aside` (m) to its left, and pressed `depth` (m) into it."""
    side = -1.0 if hold_down else 1.0
    system = make_system(3, towers={"contacts": 1, "friction": np.zeros(1)})
    state, work = disturbed_state(system)
    state.nodes.position[:, 0] = system.cable.node_arc_length[:, None] * np.array([1.0, 0.0, 0.0])
    state.nodes.position[:, 1] = [1.0, 0.0, 0.0]
    for array in (state.nodes.velocity, state.nodes.acceleration):
        array[:] = 0.0
    state.contact_arc_length[:] = state.contact_origin[:] = 0.9
    place = np.array([[0.9, -aside, side * depth]])
    towers = system.towers._replace(position=place, derailment_ratio=np.array([ratio]), normal=np.array([[0, 0, side]]))
    return system._replace(towers=towers), state, work


def end_step(system, state):
    """What the end of a step makes of the towers: how the rope is out, and when (steps)."""
    find_contact(system.cable, system.towers, state, 0)
    settle_towers(system.cable, system.towers, state)
    derail(system.cable, system.towers, state, system.cable.gravity)
    return tuple(state.derailment[0].tolist())


@pytest.mark.parametrize("hold_down", [False, True])
@pytest.mark.parametrize("aside", [0.06, -0.06])
def test_the_groove_holds_the_rope_sideways_with_its_ratio_times_the_normal_force(aside, hold_down):
    system, state, _ = lying(aside, hold_down=hold_down)
    force, normal = contact_force(system.cable, system.towers, state, 0)
    ratio = 4.0 * aside  # 1/m times m
    np.testing.assert_allclose(force, [0.0, -ratio * normal, -normal if hold_down else normal], atol=1e-9)
    assert normal > 50.0
    assert end_step(system, state) == (IN_GROOVE, 0)
    np.testing.assert_allclose(state.tower_lateral[0], [-ratio * normal, abs(ratio)])


@pytest.mark.parametrize("hold_down", [False, True])
@pytest.mark.parametrize(("aside", "out"), [(0.126, OUT_LEFT), (-0.126, OUT_RIGHT)])
def test_beyond_its_ratio_the_rope_is_out_on_that_side_for_good(aside, out, hold_down):
    system, state, work = lying(aside, hold_down=hold_down)
    state.clock[0] = 41
    assert end_step(system, state) == (out, 42)
    state.nodes.position[:, 0, 1] -= aside  # straight above its groove again
    state.clock[0] = 50
    assert end_step(system, state) == (out, 42)
    force, normal = contact_force(system.cable, system.towers, state, 0)
    assert normal == 0.0
    np.testing.assert_array_equal(force, 0.0)
    assert contact_energy(system.cable, system.towers, state, 0) == 0.0
    for array in (work.right_side, work.diagonal):
        array[:] = 0.0
    add_towers(system.cable, system.towers, state, 5.0, 1.0, work)
    assert not work.right_side.any()
    assert not work.diagonal.any()
    assert state.tower_load[0].tolist() == [0.0, 0.0]


def test_just_below_its_ratio_it_stays():
    assert end_step(*lying(0.1249)[:2]) == (IN_GROOVE, 0)


@pytest.mark.parametrize(("lift", "out"), [(0.9 * HEIGHT, IN_GROOVE), (1.1 * HEIGHT, LIFTED)])
def test_lifted_above_the_groove_the_rope_is_out(lift, out):
    system, state, _ = lying(0.0, depth=-lift)
    assert contact_frame(system.cable, system.towers, state, 0)[4] == pytest.approx(-lift)
    assert end_step(system, state)[0] == out
    state.nodes.position[:, 0, 2] -= 2.0 * lift
    settle_towers(system.cable, system.towers, state)
    assert (state.tower_load[0, 0] > 0.0) == (out == IN_GROOVE)


def test_a_plane_has_no_way_out():
    system = make_system(2, towers={"contacts": 1})
    state, _ = disturbed_state(system)
    system.towers.position[0] = [0.9, -50.0]  # far below
    assert end_step(system, state) == (IN_GROOVE, 0)


@pytest.mark.parametrize("speed", [0.4, -0.003])
def test_friction_sideways_is_against_the_speed_and_its_tangent_is_the_derivative(speed):
    """Coulomb's but for a creep; the tangent against a difference over the step of an integrator."""
    system, state, work = lying(0.02)
    state.nodes.velocity[:, 0, 1] = speed
    cable, towers = system.cable, system.towers._replace(groove_friction=np.array([0.3]))
    system = system._replace(towers=towers)

    def side(aside=0.0, moving=0.0):
        state.nodes.position[:, 0, 1] += aside
        state.nodes.velocity[:, 0, 1] += moving
        work.right_side[:], work.diagonal[:], work.upper[:], work.lower[:] = 0.0, 0.0, 0.0, 0.0
        add_towers(cable, towers, state, 50.0, 1.0, work)
        state.nodes.position[:, 0, 1] -= aside
        state.nodes.velocity[:, 0, 1] -= moving
        return work.right_side[:, 0, 1].sum()

    force, normal = contact_force(cable, towers, state, 0)
    expected = -4.0 * 0.02 * normal - 0.3 * normal * speed / np.hypot(speed, 0.01)
    assert force[1] == pytest.approx(expected, rel=1e-9)
    assert end_step(system, state)[0] == IN_GROOVE
    assert state.tower_lateral[0, 0] == pytest.approx(expected, rel=1e-9)
    change = 1e-7
    numeric = -(side(change, 50.0 * change) - side(-change, -50.0 * change)) / (2.0 * change)
    side()
    matrix = dense_blocks(work)
    places = np.arange(1, matrix.shape[0], 6)  # y of each node
    assert matrix[np.ix_(places, places)].sum() == pytest.approx(numeric, rel=1e-5)
