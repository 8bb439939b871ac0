"""Buffers between vehicles: internal force, its potential, and its part of the tangent."""

from itertools import pairwise

import numpy as np
import pytest
from systems import difference, disturbed_state, make_system

from cable_twin.mechanics.drives.joint_drive import joint_forces
from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.on_rope.buffer import (
    CLOSING,
    FORCE_NOW,
    HIGHEST,
    buffers_energy,
    in_one_patch,
    pair_tangent,
    press,
    push_on,
    settle_buffers,
)
from cable_twin.mechanics.on_rope.sliding_joint import driven_force, joint_position, joint_tangent, place_joint
from cable_twin.mechanics.parameters import VehicleBuffers
from cable_twin.mechanics.solution.equations_of_motion import assemble, measure_gaps, solve
from cable_twin.mechanics.solution.newton import largest_increment
from cable_twin.mechanics.solution.prediction import coefficients, correct_rope, factors, predict_rope
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.models import for_kernels
from verification.vehicle_buffers import level, vehicle


def pair(dim, *, damping=0.4, room=0.5):
    """Two vehicles pressed into each other on a cable in general position, and two without contact."""
    buffers = VehicleBuffers(
        offset=np.array([0, 1, 2, 2, 2]),
        other=np.array([1, 0]),
        side=np.array([1.0, -1.0]),
        room=np.full(2, room),
        stiffness=np.full(2, 700.0),
        damping=np.full(2, damping),
        present=True,
    )
    system = make_system(dim, chains=(1, 2, 1, 1))._replace(buffers=buffers)
    state, work = disturbed_state(system)
    state.joints.position[:2] = 0.7, 0.95
    for motion in (state.nodes, state.joints):
        motion.velocity[:] *= 0.1
    for carriage in range(4):
        place_joint(system.cable, state, carriage)
    return system, state, work


@pytest.mark.parametrize("dim", [2, 3])
def test_it_is_equal_opposite_and_in_one_line(dim):
    system, state, _ = pair(dim)
    one, other = (np.array(push_on(system, state, carriage)) for carriage in (0, 1))
    assert np.linalg.norm(one) > 50.0
    np.testing.assert_allclose(one, -other, rtol=0, atol=1e-12)
    way = np.subtract(*(joint_position(system.cable, state, carriage) for carriage in (1, 0)))
    assert one @ way == pytest.approx(-np.linalg.norm(one) * np.linalg.norm(way), rel=1e-12)
    for carriage in (2, 3):
        assert not np.any(push_on(system, state, carriage))


@pytest.mark.parametrize("dim", [2, 3])
def test_without_damping_it_is_the_gradient_of_its_energy(dim):
    system, state, _ = pair(dim, damping=0.0)

    def energy(places):
        moved = clone(state)
        moved.joints.position[:2] = places
        return np.array(buffers_energy(system, moved, 0))

    gradient = difference(energy, state.joints.position[:2].copy(), 1e-4)
    for carriage in (0, 1):
        push = np.array(push_on(system, state, carriage))
        assert push @ joint_tangent(system.cable, state, carriage) == pytest.approx(-gradient[carriage], abs=1e-6)


@pytest.mark.parametrize("rate_factor", [0.0, 30.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_its_tangent_is_the_derivative_of_the_force_on_both(dim, rate_factor):
    """By the places of both joints in all directions, with velocities that go along with them."""
    system, state, _ = pair(dim, damping=0.05)
    for motion in (state.nodes, state.joints):
        motion.velocity[:] *= 20.0

    def forces(moved):
        changed = clone(state)
        for joint in range(2):  # the joints have an element each, so that a shift of its nodes moves no other
            changed.nodes.position[first[joint] : first[joint] + 2, 0] += moved[joint * dim : (joint + 1) * dim]
            changed.nodes.velocity[first[joint] : first[joint] + 2, 0] += (
                rate_factor * moved[joint * dim : (joint + 1) * dim]
            )
        return np.concatenate([push_on(system, changed, joint) for joint in range(2)])

    state.joints.position[:2] = 0.55, 1.45  # in the first and the last of three elements
    system = system._replace(buffers=system.buffers._replace(room=np.full(2, 1.2)))
    for carriage in range(2):
        place_joint(system.cable, state, carriage)
    first = state.joint_element[:2].copy()
    assert first[1] - first[0] == 2
    blocks = [[None, None], [None, None]]
    for one in range(2):
        tangent = pair_tangent(system.buffers, one, press(system, state, one, one), rate_factor, 1.0)
        blocks[one][one], blocks[one][1 - one] = np.array(tangent), -np.array(tangent)
    found = difference(forces, np.zeros(2 * dim), 1e-4)
    np.testing.assert_allclose(-np.block(blocks), found, rtol=0, atol=1e-6 * np.abs(found).max())
    assert np.linalg.norm(forces(np.zeros(2 * dim))) > 50.0


@pytest.mark.parametrize("dim", [pytest.param(2, marks=pytest.mark.long), 3])
def test_the_rope_takes_none_of_it(dim):
    system, state, _ = pair(dim)
    without = system._replace(buffers=system.buffers._replace(present=False))
    for carriage in (0, 1):
        push = np.array(push_on(system, state, carriage))
        change = np.array(joint_forces(system, state, carriage)[0]) - joint_forces(without, state, carriage)[0]
        np.testing.assert_allclose(change, -push, atol=1e-10)
        r_x = np.array(joint_tangent(system.cable, state, carriage))
        more = driven_force(system, state, carriage) - driven_force(without, state, carriage)
        assert more == pytest.approx(-push @ r_x / np.linalg.norm(r_x), abs=1e-9)


def test_it_never_pulls_and_ends_where_they_are_apart():
    system, state, _ = pair(2)
    state.joints.velocity[:2] = -40.0, 40.0  # so fast apart that the damper would pull
    assert press(system, state, 0, 0)[0] > 0.0
    assert not np.any(push_on(system, state, 0))
    state.joints.position[1] = 1.9
    place_joint(system.cable, state, 1)
    assert press(system, state, 0, 0)[0] == -np.inf
    assert buffers_energy(system, state, 0) == 0.0


def test_beyond_each_other_they_are_still_pushed_back():
    system, state, _ = pair(2, damping=0.0)
    before = np.array(push_on(system, state, 0))
    state.joints.position[:2] = state.joints.position[[1, 0]]
    for carriage in (0, 1):
        place_joint(system.cable, state, carriage)
    after = np.array(push_on(system, state, 0))
    assert before @ after > 0.0
    assert np.linalg.norm(after) > np.linalg.norm(before)


def test_what_is_kept_of_a_touch():
    system, state, _ = pair(2, damping=0.0)
    for motion in (state.nodes, state.joints):
        motion.velocity[:] = 0.0
    state.joints.position[1] = 1.6  # near, and closing in
    place_joint(system.cable, state, 1)
    state.joints.velocity[:2] = 1.0, -1.0
    settle_buffers(system, state)
    closing = state.push[0, CLOSING]
    assert closing > 1.0
    assert not state.touch.any()
    state.joints.position[1], state.joints.velocity[:2], state.clock[0] = 0.95, (0.1, -0.1), 41
    place_joint(system.cable, state, 1)
    settle_buffers(system, state)
    np.testing.assert_allclose(state.touch[0], [2, 0.7, closing, 42])
    highest = state.push[0, HIGHEST]
    assert state.push[0, FORCE_NOW] == highest > 0.0
    state.joints.position[1], state.clock[0] = 1.05, 50
    settle_buffers(system, state)  # still pressed: no new touch
    assert 0.0 < state.push[0, FORCE_NOW] < highest == state.push[0, HIGHEST]
    assert state.touch[0, 3] == 42
    assert not state.push[1:].any()


def sizes_in_contact(vehicles, step, **solver):
    """Newton's increments (m) of a step of vehicles in contact, and the simulation and workspace of that."""
    simulation = level(vehicles, step=step, **solver)
    while simulation.snapshot.columns.push[0] < 500.0:
        simulation.advance_to(simulation.time + simulation.step)
    system, (state, work) = simulation.system, for_kernels(simulation)
    c = coefficients(system.solver.spectral_radius)
    mass_factor, rate_factor = factors(c, step)
    predict_rope(c, step, system, state, work)
    sizes = []
    for _ in range(6):
        measure_gaps(system, state, work, True)
        assemble(system, state, mass_factor, rate_factor, 1.0, work)
        assert solve(system, state, work)
        sizes.append(largest_increment(system, state, work, 1.0))
        correct_rope(c, step, system, state, work)
    return sizes, system, state, work


def two(gap):
    """Two vehicles of 100 kg that meet, with stiff buffers and little mass below the joint."""
    body = {"mass": 100.0, "inertia": 20.0, "upper_pivot": [0.0, 2.0], "size": [1.0, 1.0]}
    places = ((5.0, 1.0), (5.0 + gap, -1.0))
    return [{**vehicle(place, speed, 100.0, 1.0), "bodies": {"body": body}} for place, speed in places]


@pytest.mark.long
@pytest.mark.parametrize(
    ("joint", "most"), [pytest.param("node", 1e-4, id="in one patch"), pytest.param("paper", 0.01, id="predicted")]
)
def test_newton_hardly_feels_what_its_tangent_leaves_out(joint, most):
    """Where single vehicles would leave an error of a tenth; with both in one patch nothing is left out."""
    sizes, system, state, work = sizes_in_contact(two(1.1), 4e-3, cable={"joint": joint})
    assert in_one_patch(system, state, 0, 1) == (joint == "node")
    assert work.pressed.any() == (joint == "paper")
    if joint == "paper":
        stiff = np.trace(work.pressed_tangent[0].reshape(2, 2))
        assert stiff / (stiff + work.foreseen[0, 0]) > 0.1
    ratios = [after / before for before, after in pairwise(sizes) if after > 1e-12]
    assert ratios
    assert ratios[-1] < most  # of the last two that are no rounding


@pytest.mark.long
@pytest.mark.parametrize("written", ["cable", "ropes"])
@pytest.mark.parametrize("space", [2, 3])
def test_a_train_that_pushes_itself_takes_one_iteration_a_step(space, written):
    """Five vehicles between the nodes of a mesh, one or several ropes, in plane and space."""
    scenario = level([{**vehicle(3.0 + 1.2 * number, float(number == 0), 100.0, 0.3)} for number in range(5)]).scenario
    data = {**scenario.resolved(), "space": space}
    if written == "ropes":
        data["ropes"] = {"only": data.pop("cable")}
    simulation = Simulation(load_scenario(data))
    used = []
    while simulation.time < 0.5:
        snapshot = simulation.advance_to(simulation.time + simulation.step)
        if snapshot.columns.push.max() > 10.0:
            used.append(snapshot.solver.iterations)
    assert len(used) > 50
    assert np.mean(used) < 1.1
