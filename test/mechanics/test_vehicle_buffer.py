"""Buffers between vehicles: internal force, its potential, and its part of the tangent."""

from itertools import pairwise

import numpy as np
import pytest
from systems import difference, disturbed_state, make_system

from cable_twin.mechanics.drives.pull import joint_forces
from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.on_rope.buffer import (
    CLOSING,
    FORCE_NOW,
    HIGHEST,
    buffers_energy,
    press,
    push_on,
    settle_buffers,
)
from cable_twin.mechanics.on_rope.sliding_joint import driven_force, joint_position, joint_tangent, place_joint
from cable_twin.mechanics.parameters import VehicleBuffers
from cable_twin.mechanics.solution.equations_of_motion import assemble, measure_gaps, solve
from cable_twin.mechanics.solution.newmark import coefficients, correct_rope, factors, predict_rope
from cable_twin.mechanics.solution.newton import largest_increment
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
    one, other = (np.array(push_on(system, state, carriage, 0.0, 0.0)[0]) for carriage in (0, 1))
    assert np.linalg.norm(one) > 50.0
    np.testing.assert_allclose(one, -other, rtol=0, atol=1e-12)
    way = np.subtract(*(joint_position(system.cable, state, carriage) for carriage in (1, 0)))
    assert one @ way == pytest.approx(-np.linalg.norm(one) * np.linalg.norm(way), rel=1e-12)
    for carriage in (2, 3):
        assert not any(np.any(part) for part in push_on(system, state, carriage, 1.0, 1.0))


@pytest.mark.parametrize("dim", [2, 3])
def test_without_damping_it_is_the_gradient_of_its_energy(dim):
    system, state, _ = pair(dim, damping=0.0)

    def energy(places):
        moved = clone(state)
        moved.joints.position[:2] = places
        return np.array(buffers_energy(system, moved, 0))

    gradient = difference(energy, state.joints.position[:2].copy(), 1e-4)
    for carriage in (0, 1):
        push = np.array(push_on(system, state, carriage, 0.0, 0.0)[0])
        assert push @ joint_tangent(system.cable, state, carriage) == pytest.approx(-gradient[carriage], abs=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_its_own_share_of_the_tangent_against_differences(dim):
    """Derivatives along the direction between both by place and speed; without its rotation."""
    system, state, _ = pair(dim)
    way = np.array(press(system, state, 0, 0)[2])
    along = joint_tangent(system.cable, state, 0)

    def force(state, field, change):
        moved = clone(state)
        getattr(moved.joints, field)[0] += change[0]
        return way @ np.array(push_on(system, moved, 0, 0.0, 0.0)[0])

    def share(state, rate_factor, stiffness_factor):
        return way @ np.reshape(push_on(system, state, 0, rate_factor, stiffness_factor)[1], (dim, dim)) @ along

    by_speed = difference(lambda change: force(state, "velocity", change), np.zeros(1), 1e-3)[0]
    assert share(state, 30.0, 0.0) == pytest.approx(-30.0 * by_speed, rel=1e-8)
    for motion in (state.nodes, state.joints):  # or the rate of the depth would change with the place
        motion.velocity[:] = 0.0
    by_place = difference(lambda change: force(state, "position", change), np.zeros(1), 1e-4)[0]
    assert share(state, 0.0, 1.0) == pytest.approx(-by_place, rel=1e-4)
    assert by_place < -100.0


@pytest.mark.parametrize("dim", [2, 3])
def test_the_rope_takes_none_of_it(dim):
    system, state, _ = pair(dim)
    without = system._replace(buffers=system.buffers._replace(present=False))
    for carriage in (0, 1):
        push = np.array(push_on(system, state, carriage, 0.0, 0.0)[0])
        change = np.array(joint_forces(system, state, carriage)[0]) - joint_forces(without, state, carriage)[0]
        np.testing.assert_allclose(change, -push, atol=1e-10)
        r_x = np.array(joint_tangent(system.cable, state, carriage))
        more = driven_force(system, state, carriage) - driven_force(without, state, carriage)
        assert more == pytest.approx(-push @ r_x / np.linalg.norm(r_x), abs=1e-9)


def test_it_never_pulls_and_ends_where_they_are_apart():
    system, state, _ = pair(2)
    state.joints.velocity[:2] = -40.0, 40.0  # so fast apart that the damper would pull
    assert press(system, state, 0, 0)[0] > 0.0
    assert not any(np.any(part) for part in push_on(system, state, 0, 1.0, 1.0))
    state.joints.position[1] = 1.9
    place_joint(system.cable, state, 1)
    assert press(system, state, 0, 0)[0] == -np.inf
    assert buffers_energy(system, state, 0) == 0.0


def test_beyond_each_other_they_are_still_pushed_back():
    system, state, _ = pair(2, damping=0.0)
    before = np.array(push_on(system, state, 0, 0.0, 0.0)[0])
    state.joints.position[:2] = state.joints.position[[1, 0]]
    for carriage in (0, 1):
        place_joint(system.cable, state, carriage)
    after = np.array(push_on(system, state, 0, 0.0, 0.0)[0])
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


@pytest.mark.long
def test_newton_hardly_feels_what_its_tangent_leaves_out():
    """Stiff buffers and little mass below the joint, where single vehicles would leave an error of a tenth."""
    body = {"mass": 100.0, "inertia": 20.0, "upper_pivot": [0.0, 2.0], "size": [1.0, 1.0]}
    pair = [
        {**vehicle(place, speed, 100.0, 1.0), "bodies": {"body": body}} for place, speed in ((5.0, 1.0), (6.1, -1.0))
    ]
    simulation = level(pair, step=4e-3)
    while simulation.snapshot.columns.push[0] < 500.0:
        simulation.advance_to(simulation.time + simulation.step)
    system, (state, work) = simulation.system, for_kernels(simulation)
    step, c = system.solver.step, coefficients(system.solver.spectral_radius)
    mass_factor, rate_factor = factors(c, step)
    predict_rope(c, step, system, state, work)
    sizes = []
    for _ in range(6):
        measure_gaps(system, state, work, True)
        assemble(system, state, mass_factor, rate_factor, 1.0, work)
        assert solve(system, state, work)
        sizes.append(largest_increment(system, state, work, 1.0))
        correct_rope(c, step, system, state, work)
    alone = work.pressed_stiffness[0] / (work.pressed_stiffness[0] + work.foreseen[0, 0])
    assert alone > 0.1
    ratios = [after / before for before, after in pairwise(sizes) if after > 1e-12]
    assert len(ratios) >= 2
    assert max(ratios) < 0.01
