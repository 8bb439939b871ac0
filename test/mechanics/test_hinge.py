"""Springs and dampers between bodies and against the cable: moments, directions, rest, Newton, reset, payload."""

from itertools import pairwise

import numpy as np
import pytest
from systems import changed, difference, disturbed_state, make_system
from test_equilibrium import loaded_span

from cable_twin.mechanics.on_rope.grip import moment_by_slope, spin_by_slope, tangent_pitch, turn_by_slope
from cable_twin.mechanics.on_rope.hinge import hinge_energy, hinge_moment
from cable_twin.mechanics.on_rope.sliding_joint import (
    cable_direction,
    driven_force,
    grip_moment,
    joint_point,
    joint_tangent,
    place_joint,
)
from cable_twin.mechanics.readout.energies import energies
from cable_twin.mechanics.rope.point import bend, slope
from cable_twin.mechanics.rope.shape_functions import shape_functions_xx, shape_functions_xxx
from cable_twin.mechanics.solution.equations_of_motion import assemble, measure_gaps, solve
from cable_twin.mechanics.solution.increments import largest_increment
from cable_twin.simulation import Simulation
from verification.conservation import thrown_cable
from verification.hinges import HINGES, hinged_pendulum
from verification.models import for_kernels

SPRINGS = {f"carriages.one.bodies.{name}.stiffness": 2e4 for name in ("upper", "lower")}
DAMPERS = {f"carriages.one.bodies.{name}.damping": 3e3 for name in ("upper", "lower")}


def hinged_system(chains=(2,)):
    bodies = sum(chains)
    springs = {"hinge_stiffness": 20.0 + np.arange(bodies), "hinge_damping": 3.0 + np.arange(bodies)}
    system = make_system(chains=chains, carriages=springs)
    state, work = disturbed_state(system)
    for carriage in range(len(chains)):
        place_joint(system.cable, state, carriage)
    return system, state, work


def test_moment_is_the_derivative_of_the_energy_and_resists():
    carriages = hinged_system()[0].carriages
    moment, by_angle, by_rate = hinge_moment(carriages, 1, 0.3, 0.0)
    exact = difference(lambda x: np.array([hinge_energy(carriages, 1, x[0])]), np.array([0.3]), 1e-3)[0, 0]
    assert moment == pytest.approx(-exact, rel=1e-12)
    assert by_angle == pytest.approx(21.0, rel=1e-15)
    assert hinge_moment(carriages, 1, 0.0, 0.5)[0] == pytest.approx(-0.5 * by_rate, rel=1e-15)
    assert by_rate == pytest.approx(4.0, rel=1e-15)


@pytest.mark.parametrize("slope", [(0.9, -0.4), (0.2, 1.1), (-0.8, 0.3)])
def test_pitch_of_the_cable_and_its_derivatives(slope):
    """Differences to 1e-9; a cable that falls in x has a positive pitch, whichever way it runs."""
    assert np.sign(tangent_pitch(slope)) == -np.sign(slope[1] / slope[0])
    assert tangent_pitch((-slope[0], -slope[1])) == pytest.approx(tangent_pitch(slope), abs=1e-15)
    first = difference(lambda r_x: np.array([tangent_pitch(tuple(r_x))]), np.array(slope), 1e-3)[0]
    np.testing.assert_allclose(turn_by_slope(slope), first, atol=1e-9)
    second = difference(lambda r_x: 3.0 * np.array(turn_by_slope(tuple(r_x))), np.array(slope), 1e-3)
    np.testing.assert_allclose(np.reshape(moment_by_slope((3.0,), slope), (2, 2)), second, atol=1e-8)
    rate = np.array([0.4, 0.7])
    spin = difference(lambda r_x: np.array(turn_by_slope(tuple(r_x)))[None] @ rate, np.array(slope), 1e-3)[0]
    np.testing.assert_allclose(spin_by_slope(tuple(rate), slope), spin, atol=1e-9)


def test_third_derivative_of_the_shape_functions():
    exact = difference(lambda x: np.array(shape_functions_xx(x[0], 0.7)), np.array([0.2]), 1e-2)[:, 0]
    np.testing.assert_allclose(shape_functions_xxx(0.7), exact, rtol=1e-10)


def turn_along(system, state):
    """Derivative (rad/m) of the pitch of the cable at the joint by the arc length."""
    point = joint_point(system.cable, state, 0)
    r_x, r_xx = slope(state.nodes.position, point, (0.0, 0.0)), bend(state.nodes.position, point, (0.0, 0.0))
    return float(np.dot(turn_by_slope(r_x), r_xx))


def test_direction_at_a_joint_turns_with_the_cable_and_along_it():
    """Rate and derivative by the arc length: differences of the pitch to 1e-7."""
    system, state, _ = hinged_system()

    def pitch(e, s):
        moved = changed(state, nodes_position=state.nodes.position + e, joints_position=state.joints.position + s)
        return np.array(cable_direction(system.cable, moved, 0).orientation)

    rate = cable_direction(system.cable, state, 0).spin[0]
    along = turn_along(system, state)
    motion = state.nodes.velocity, state.joints.velocity
    exact = difference(lambda t: pitch(t[0] * motion[0], t[0] * motion[1]), np.zeros(1), 1e-3)
    assert rate == pytest.approx(exact[0, 0], abs=1e-7)
    exact = difference(lambda s: pitch(0.0, s[0]), np.zeros(1), 1e-3)
    assert along == pytest.approx(exact[0, 0], abs=1e-7)


def test_springs_are_in_the_energy():
    """What they add is k φ² / 2 each."""
    system, state, _ = hinged_system()
    bare = system._replace(carriages=system.carriages._replace(hinge_stiffness=np.zeros(2)))
    pitches = state.bodies.position[:, 2]
    angles = np.array([pitches[0] - cable_direction(system.cable, state, 0).orientation[0], pitches[1] - pitches[0]])
    more = energies(system, state)[1] - energies(bare, state)[1]
    assert more == pytest.approx(0.5 * float(np.sum(system.carriages.hinge_stiffness * angles**2)), rel=1e-9)


def test_rest_with_springs_balances_moments():
    """Each spring bears the moment of what hangs below it; the fixed joint of an inclined cable bears the rest."""
    simulation = Simulation(loaded_span(**{"carriages.one.joint": "fixed", **SPRINGS}))
    system, state = simulation.system, simulation.state
    carriages, q = system.carriages, state.bodies.position
    joint = simulation.snapshot.carriages["one"].position
    weights = carriages.mass * 9.81
    about = [[joint[0], joint[2]], q[0, :2] + turned(q[0, 2], carriages.lower_pivot[0])]
    direction = cable_direction(system.cable, for_kernels(simulation)[0], 0).orientation[0]
    angles = q[0, 2] - direction, q[1, 2] - q[0, 2]
    for body in range(2):
        # the moment about y of a force (0, -w) at an arm of x is w x
        hanging = float(np.sum(weights[body:] * (q[body:, 0] - about[body][0])))
        assert -2e4 * angles[body] + hanging == pytest.approx(0.0, abs=1e-4)
    assert abs(q[0, 2]) > 1e-3
    before = state.nodes.position.copy(), q.copy()
    simulation.advance_to(0.2)
    np.testing.assert_allclose(state.nodes.position, before[0], atol=1e-7)
    np.testing.assert_allclose(q, before[1], atol=1e-7)


def turned(pitch, offset):
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, s], [-s, c]]) @ offset


def test_a_driven_joint_takes_the_moment_along_a_bent_cable():
    """m ∂α/∂s more than λ·t: to 1e-12."""
    system, state, _ = hinged_system()
    bare = system._replace(carriages=system.carriages._replace(hinge_stiffness=np.zeros(2), hinge_damping=np.zeros(2)))
    moment, force = grip_moment(system, state, 0)
    assert force == pytest.approx(moment[0] * turn_along(system, state), rel=1e-12)
    assert abs(force) > 0.5
    assert grip_moment(bare, state, 0) == ((0.0,), 0.0)
    more = driven_force(system, state, 0) - driven_force(bare, state, 0)
    assert more * np.linalg.norm(joint_tangent(system.cable, state, 0)) == pytest.approx(force, rel=1e-12)


def test_newton_is_quadratic_with_hinges():
    """From a state that is off by millimetres, each increment is of the square of the one before, down to rounding."""
    simulation = thrown_cable(1e-3, 0.0, 3, HINGES)
    state, work = for_kernels(simulation)
    cable = simulation.system.cable._replace(bending_stiffness=0.0)  # with which the tangent of the cable is exact
    system = simulation.system._replace(cable=cable)
    mass_factor, rate_factor = 4e4, 300.0
    rng, sizes = np.random.default_rng(1), []

    def move(e, q, s):
        for motion, increment in ((state.nodes, e), (state.bodies, q), (state.joints, s)):
            motion.position[:] += increment
            motion.velocity[:] += rate_factor * increment
            motion.acceleration[:] += mass_factor * increment

    move(*(2e-3 * rng.standard_normal(motion.position.shape) for motion in (state.nodes, state.bodies, state.joints)))
    for _ in range(6):
        measure_gaps(system, state, work, True)
        assemble(system, state, mass_factor, rate_factor, 1.0, work)
        assert solve(system, state, work)
        sizes.append(largest_increment(system, work))
        move(work.right_side, work.body_increment, work.sliding_increment)
    assert sizes[0] > 1e-3
    ratios = [after / before**2 for before, after in pairwise(sizes) if after > 1e-12]
    assert len(ratios) >= 2
    assert sizes[-1] < 1e-12
    assert max(ratios) < 100.0


def test_a_reset_gives_back_the_start_and_a_payload_takes_part():
    """A damper has no memory, so that a run is the same again; a heavier cabin hangs deeper in its spring."""
    changes = {**SPRINGS, **DAMPERS, "carriages.one.payload": {"capacity": 500.0, "station_distance": 200.0}}
    simulation = Simulation(loaded_span(**changes))
    rest = simulation.state.bodies.position.copy()
    simulation.advance_to(0.1)
    moved = simulation.state.bodies.position.copy()
    simulation.reset()
    np.testing.assert_array_equal(simulation.state.bodies.position, rest)
    simulation.advance_to(simulation.time + 0.1)
    np.testing.assert_array_equal(simulation.state.bodies.position, moved)
    heavy = Simulation(loaded_span(**changes, **{"carriages.one.payload.mass": 400.0}))
    assert abs(heavy.state.bodies.position[1, 2]) != abs(rest[1, 2])
    assert heavy.system.carriages.mass[1] == 1300.0


def test_a_damped_pendulum_loses_its_swing():
    """After 50 ms it is slower than one without: a few steps of the case in `verification`."""
    free, damped = hinged_pendulum(5e-3), hinged_pendulum(5e-3, damping=2.0)
    for simulation in (free, damped):
        simulation.advance_to(0.05)
    assert abs(damped.state.bodies.velocity[0, 2]) < abs(free.state.bodies.velocity[0, 2])
