"""Tower contacts: nearest point, force, tangent, potential, friction; grooves, and both ways of derailment."""

import numpy as np
import pytest
from systems import dense_blocks, difference, disturbed_state, from_nodal_vectors, make_system, nodal_vectors

from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.on_rope.tower import (
    add_towers,
    contact_energy,
    contact_force,
    contact_frame,
    derail,
    normal_force,
    settle_towers,
)
from cable_twin.mechanics.on_rope.tower_contact import NEAR
from cable_twin.mechanics.parameters import IN_GROOVE, LIFTED, OUT_LEFT, OUT_RIGHT
from cable_twin.mechanics.rope.point import point_at, slope, value
from cable_twin.mechanics.state import allocate_workspace

HEIGHT = 0.05  # m, of the groove
PLACES = (0.3, 0.9, 1.6)  # m, on three elements of 0.7 m
CONTACT_FIELDS = "stiffness", "damping", "friction", "presliding", "toe", "groove", "groove_friction"


def on_rope(cable, state, s):
    """Position and slope (2,) of the rope at an arc length."""
    point = point_at(cable, state, s)
    return [np.array(function(state.nodes.position, point, cable.gravity)) for function in (value, slope)]


def touching(depth=0.03, places=PLACES, dim=2, aside=0.0, **changes):
    """Cable in general position pressed by `depth` (m) onto contacts at several places; system, state, workspace.

    In space it is `aside` (m) of the middle of their grooves.
    """
    system = make_system(dim, towers={"contacts": len(places)})
    state, work = disturbed_state(system)
    position, normal = [], []
    for s, deep in zip(places, np.broadcast_to(depth, len(places)), strict=True):
        r, r_x = on_rope(system.cable, state, s)
        t = r_x / np.linalg.norm(r_x)
        if dim == 2:
            across = np.array([-t[1], t[0]])
            position.append(r + deep * across)
            normal.append(across + 0.2 * r_x)  # only the side counts
        else:
            up = np.array([0.1, -0.3, 1.0]) - t * (t @ [0.1, -0.3, 1.0])
            normal.append(up / np.linalg.norm(up))
            position.append(r + deep * normal[-1] + aside * np.cross(t, normal[-1]))
    towers = system.towers._replace(
        position=np.array(position), normal=np.array(normal) / np.linalg.norm(normal, axis=1)[:, None], **changes
    )
    state.contact_arc_length[:] = np.array(places) + 0.05
    state.contact_origin[:] = np.array(places) - 0.004
    state.contact_deflection[:] = 0.2
    return system._replace(towers=towers), state, work


def forces_on_nodes(system, state, work, rate_factor=0.0, stiffness_factor=0.0):
    """Contribution of all contacts to the right side (nodes 2 2,)."""
    for array in (work.right_side, work.diagonal, work.upper, work.lower):
        array[:] = 0.0
    add_towers(system.cable, system.towers, state, rate_factor, stiffness_factor, work)
    return nodal_vectors(work.right_side).ravel()


@pytest.mark.parametrize("start", [-0.15, 0.0, 0.2])
def test_the_contact_is_the_nearest_point_of_the_rope(start):
    system, state, work = touching()
    state.contact_arc_length[:] = np.array(PLACES) + start
    add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
    for contact, s in enumerate(PLACES):
        assert state.contact_arc_length[contact] == pytest.approx(s, abs=NEAR**2)  # of elements of less than a metre


def test_a_contact_that_is_clear_of_the_rope_is_looked_at_again_when_the_rope_comes():
    """Off by 2 cm it is left; off by 0.5 cm, and where it is far from the nearest point, it is found."""
    for depth, start, looked in ((-0.02, 0.005, False), (-0.005, 0.005, True), (-0.02, 0.1, True)):
        system, state, work = touching(depth)
        state.contact_arc_length[:] = np.array(PLACES) + start
        add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
        for contact, s in enumerate(PLACES):
            assert (work.contact_element[contact] >= 0) == looked
            where = s if looked else s + start
            assert state.contact_arc_length[contact] == pytest.approx(where, abs=NEAR**2)
        assert not forces_on_nodes(system, state, work).any()


def test_beyond_an_end_the_contact_stays_at_the_end():
    system, state, work = touching(places=(0.3,))
    system.towers.position[0] = [-5.0, 0.0]
    add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
    assert state.contact_arc_length[0] == 0.0


@pytest.mark.parametrize(
    ("case", "tolerance"),
    [
        ({"depth": 0.03, "friction": 0.0}, 1e-6),
        ({"depth": 0.03, "friction": 0.3}, 1e-6),
        ({"depth": 0.004, "friction": 0.0}, 1e-6),  # where the stiffness sets in
        ({"depth": 0.004, "friction": 0.3}, 1e-6),
        ({"dim": 3, "friction": 0.0}, 1e-9),
        ({"dim": 3, "friction": 0.3}, 1e-2),
        ({"dim": 3, "friction": 0.0, "aside": 0.004}, 1e-3),
        ({"dim": 3, "friction": 0.3, "aside": 0.004}, 1e-2),
        ({"dim": 3, "friction": 0.3, "aside": 0.06}, 2e-2),
    ],
)
def test_tangent_is_the_derivative_of_the_force(case, tolerance):
    """Exact in space in the middle of a groove; elsewhere without the rotation with the rope."""
    system, state, work = touching(**case | {"friction": np.full(3, case["friction"])})
    rate_factor = 5.0

    def right_side(change):
        moved = clone(state)
        moved.nodes.position[:] += from_nodal_vectors(change, len(system.cable.gravity))
        moved.nodes.velocity[:] += rate_factor * from_nodal_vectors(change, len(system.cable.gravity))
        return forces_on_nodes(system, moved, work)

    exact = -difference(right_side, np.zeros(nodal_vectors(state.nodes.position).size), 2e-5)
    forces_on_nodes(system, state, work, rate_factor, 1.0)
    np.testing.assert_allclose(dense_blocks(work), exact, rtol=0, atol=tolerance * np.abs(exact).max())
    assert np.abs(exact).max() > 100.0


def many_contacts(dim):
    """Eleven contacts, several of them on each of three elements, at depths on both sides of the toe, some clear."""
    places = tuple(np.linspace(0.2, 1.8, 11))
    depths = np.where(np.arange(11) % 5 == 2, -0.03, 0.03 - 0.007 * (np.arange(11) % 5))
    system, state, work = touching(depths, places, dim, 0.004 if dim == 3 else 0.0)
    state.contact_arc_length[2::5] = places[2::5]
    if dim == 3:
        state.derailment[3, 0] = OUT_LEFT
    return system, state, work


@pytest.mark.parametrize("dim", [2, 3])
def test_contacts_in_lanes_are_each_contact_by_itself(dim):
    system, state, work = many_contacts(dim)
    found, towers = clone(state), system.towers
    total = forces_on_nodes(system, found, work, 5.0, 1.0)
    tangent, clear = dense_blocks(work), work.contact_element[:11] < 0
    assert 0 < clear.sum() < 5
    assert len(set(work.contact_element[:11])) < 5
    forces, tangents = np.zeros_like(total), np.zeros_like(tangent)
    for contact in range(11):
        alone = {name: np.array([getattr(towers, name)[contact]]) for name in CONTACT_FIELDS}
        one, own, room = touching(0.0, (1.0,), dim, **alone)
        own.nodes.position[:], own.nodes.velocity[:] = state.nodes.position, state.nodes.velocity
        own.contact_arc_length[:] = state.contact_arc_length[contact]
        own.contact_origin[:] = state.contact_origin[contact]
        if dim == 3:
            own.derailment[0, 0] = state.derailment[contact, 0]
        one.towers.position[:], one.towers.normal[:] = towers.position[contact], towers.normal[contact]
        forces += forces_on_nodes(one, own, room, 5.0, 1.0)
        tangents += dense_blocks(room)
        assert own.contact_arc_length[0] == found.contact_arc_length[contact]
    np.testing.assert_allclose(total, forces, rtol=1e-12, atol=1e-12 * np.abs(total).max())
    np.testing.assert_allclose(tangent, tangents, rtol=1e-12, atol=1e-12 * np.abs(tangent).max())


@pytest.mark.parametrize("moved", [0.0, 0.002])
def test_friction_at_the_end_of_a_step_is_that_of_its_last_iteration_where_the_rope_has_not_moved_on(moved):
    system, state, work = many_contacts(2)
    forces_on_nodes(system, state, work)
    state.contact_origin[::2] -= moved
    fresh = clone(state)
    settle_towers(system.cable, system.towers, state, work)
    settle_towers(system.cable, system.towers, fresh, allocate_workspace(system))
    np.testing.assert_array_equal(state.contact_deflection, fresh.contact_deflection)
    np.testing.assert_array_equal(state.tower_load, fresh.tower_load)


@pytest.mark.parametrize("depth", [0.03, 0.004], ids=["stiff", "toe"])
def test_without_friction_and_damping_the_force_has_a_potential(depth):
    system, state, work = touching(depth, friction=np.zeros(3), damping=np.zeros(3))

    def energy(change):
        moved = clone(state)
        moved.nodes.position[:] += from_nodal_vectors(change, 2)
        total = 0.0
        add_towers(system.cable, system.towers, moved, 0.0, 0.0, work)
        for contact in range(3):
            total += contact_energy(system.cable, system.towers, moved, contact)
        return np.array([total])

    slope = difference(energy, np.zeros(nodal_vectors(state.nodes.position).size), 2e-5)[0]
    got = forces_on_nodes(system, state, work)
    np.testing.assert_allclose(got, -slope, rtol=0, atol=1e-7 * np.abs(slope).max())
    np.testing.assert_allclose(dense_blocks(work), dense_blocks(work).T)


def test_the_force_is_normal_and_along_the_rope_and_the_nodes_take_all_of_it():
    system, state, work = touching()
    total = np.zeros(2)
    forces_on_nodes(system, state, work)
    for contact in range(3):
        force, normal = contact_force(system.cable, system.towers, state, contact)
        _, r_x = on_rope(system.cable, state, state.contact_arc_length[contact])
        tangent = r_x / np.hypot(*r_x)
        assert np.array([-tangent[1], tangent[0]]) @ force == pytest.approx(normal)
        way = state.contact_arc_length[contact] - state.contact_origin[contact]
        share = 1.0 + (0.2 - 1.0) * np.exp(-way / 0.02)
        assert tangent @ force == pytest.approx(0.3 * normal * share)
        total += force
    np.testing.assert_allclose(work.right_side[:, 0].sum(axis=0), total)


def test_it_never_pulls():
    system, state, work = touching(depth=-0.01)
    assert not forces_on_nodes(system, state, work, 5.0, 1.0).any()
    assert not dense_blocks(work).any()
    towers = system.towers
    assert normal_force(towers, 0, 0.01, -1.0 / 0.2) == (0.0, 0.0, 0.0)  # it leaves faster than the contact follows
    assert normal_force(towers, 0, np.nan, 0.0) == (0.0, 0.0, 0.0)


def test_stiffness_sets_in_smoothly():
    """Equal force and stiffness on both sides of the toe and at its start, with damping."""
    towers = make_system(towers={"contacts": 1}).towers
    near = [normal_force(towers, 0, towers.toe[0] + change, 0.0) for change in (-1e-12, 1e-12)]
    np.testing.assert_allclose(near[0], near[1], rtol=1e-6)
    np.testing.assert_allclose(normal_force(towers, 0, 1e-9, 0.0)[:2], [0.0, 0.0], atol=1e-3)
    elastic, _, _ = normal_force(towers, 0, 0.02, 0.0)
    force, stiffness, by_rate = normal_force(towers, 0, 0.02, 0.7)
    assert force == pytest.approx(elastic * (1.0 + 0.2 * 0.7))
    assert stiffness == pytest.approx(3000.0 * (1.0 + 0.2 * 0.7))
    assert by_rate == pytest.approx(0.2 * elastic)


def test_a_step_ends_with_its_friction_and_the_loads_of_the_towers():
    system, state, work = touching()
    state.tower_load[:, 1] = [1e9, 1.0, 1e9]
    add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
    loads = [contact_force(system.cable, system.towers, state, contact)[1] for contact in range(3)]
    settle_towers(system.cable, system.towers, state, work)
    np.testing.assert_allclose(state.tower_load[:, 0], loads)
    np.testing.assert_allclose(state.tower_load[:, 1], [loads[0], 1.0, loads[2]])
    np.testing.assert_array_equal(state.contact_origin, state.contact_arc_length)
    np.testing.assert_allclose(state.contact_deflection, 1.0 - 0.8 * np.exp(-0.004 / 0.02))


def lying(aside=0.0, depth=0.03, ratio=0.5, hold_down=False):
    """Straight level rope on one contact, `aside` (m) to its left and pressed `depth` (m) into it."""
    side = -1.0 if hold_down else 1.0
    system = make_system(3, towers={"contacts": 1, "friction": np.zeros(1)})
    state, work = disturbed_state(system)
    state.nodes.position[:, 0] = system.cable.node_arc_length[:, None] * np.array([1.0, 0.0, 0.0])
    state.nodes.position[:, 1:] = [1.0, 0.0, 0.0]
    for array in (state.nodes.velocity, state.nodes.acceleration):
        array[:] = 0.0
    state.contact_arc_length[:] = state.contact_origin[:] = 0.9
    place = np.array([[0.9, -aside, side * depth]])
    towers = system.towers._replace(position=place, derailment_ratio=np.array([ratio]), normal=np.array([[0, 0, side]]))
    return system._replace(towers=towers), state, work


def end_step(system, state, work):
    """Derailment at the end of a step: kind and time (steps)."""
    add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
    settle_towers(system.cable, system.towers, state, work)
    derail(system.cable, system.towers, state, system.cable.gravity)
    return tuple(state.derailment[0].tolist())


@pytest.mark.parametrize("hold_down", [False, True])
@pytest.mark.parametrize("aside", [0.06, -0.06])
def test_the_groove_holds_the_rope_sideways_with_its_ratio_times_the_normal_force(aside, hold_down):
    system, state, work = lying(aside, hold_down=hold_down)
    force, normal = contact_force(system.cable, system.towers, state, 0)
    ratio = 4.0 * aside  # 1/m times m
    np.testing.assert_allclose(force, [0.0, -ratio * normal, -normal if hold_down else normal], atol=1e-9)
    assert normal > 50.0
    assert end_step(system, state, work) == (IN_GROOVE, 0)
    np.testing.assert_allclose(state.tower_lateral[0], [-ratio * normal, abs(ratio)])


@pytest.mark.parametrize("hold_down", [False, True])
@pytest.mark.parametrize(("aside", "out"), [(0.126, OUT_LEFT), (-0.126, OUT_RIGHT)])
def test_beyond_its_ratio_the_rope_is_out_on_that_side_for_good(aside, out, hold_down):
    system, state, work = lying(aside, hold_down=hold_down)
    state.clock[0] = 41
    assert end_step(system, state, work) == (out, 42)
    state.nodes.position[:, 0, 1] -= aside  # straight above its groove again
    state.clock[0] = 50
    assert end_step(system, state, work) == (out, 42)
    force, normal = contact_force(system.cable, system.towers, state, 0)
    assert normal == 0.0
    np.testing.assert_array_equal(force, 0.0)
    assert contact_energy(system.cable, system.towers, state, 0) == 0.0
    assert not forces_on_nodes(system, state, work, 5.0, 1.0).any()
    assert not work.diagonal.any()
    assert state.tower_load[0].tolist() == [0.0, 0.0]


def test_just_below_its_ratio_it_stays():
    assert end_step(*lying(0.1249)) == (IN_GROOVE, 0)


@pytest.mark.parametrize(("lift", "out"), [(0.9 * HEIGHT, IN_GROOVE), (1.1 * HEIGHT, LIFTED)])
def test_lifted_above_the_groove_the_rope_is_out(lift, out):
    system, state, work = lying(0.0, depth=-lift)
    assert contact_frame(system.cable, system.towers, state, 0)[4] == pytest.approx(-lift)
    assert end_step(system, state, work)[0] == out
    state.nodes.position[:, 0, 2] -= 2.0 * lift
    settle_towers(system.cable, system.towers, state, work)
    assert (state.tower_load[0, 0] > 0.0) == (out == IN_GROOVE)


def test_a_plane_has_no_way_out():
    system = make_system(2, towers={"contacts": 1})
    state, work = disturbed_state(system)
    system.towers.position[0] = [0.9, -50.0]  # far below
    assert end_step(system, state, work) == (IN_GROOVE, 0)


@pytest.mark.parametrize("speed", [0.4, -0.003])
def test_friction_sideways_is_against_the_speed_and_its_tangent_is_the_derivative(speed):
    """Coulomb friction with creep; tangent against the difference over a step of an integrator."""
    system, state, work = lying(0.02)
    state.nodes.velocity[:, 0, 1] = speed
    cable, towers = system.cable, system.towers._replace(groove_friction=np.array([0.3]))
    system = system._replace(towers=towers)

    def side(aside=0.0, moving=0.0):
        state.nodes.position[:, 0, 1] += aside
        state.nodes.velocity[:, 0, 1] += moving
        forces_on_nodes(system, state, work, 50.0, 1.0)
        state.nodes.position[:, 0, 1] -= aside
        state.nodes.velocity[:, 0, 1] -= moving
        return work.right_side[:, 0, 1].sum()

    force, normal = contact_force(cable, towers, state, 0)
    expected = -4.0 * 0.02 * normal - 0.3 * normal * speed / np.hypot(speed, 0.01)
    assert force[1] == pytest.approx(expected, rel=1e-9)
    assert end_step(system, state, work)[0] == IN_GROOVE
    assert state.tower_lateral[0, 0] == pytest.approx(expected, rel=1e-9)
    change = 1e-7
    numeric = -(side(change, 50.0 * change) - side(-change, -50.0 * change)) / (2.0 * change)
    side()
    matrix = dense_blocks(work)
    places = np.arange(1, matrix.shape[0], 6)  # y of each node
    assert matrix[np.ix_(places, places)].sum() == pytest.approx(numeric, rel=1e-5)
