"""Springs and dampers between bodies and against the cable: moments, signs, equilibrium, Newton step, payload."""

import numpy as np
import pytest
from systems import changed, difference, disturbed_state, make_system, turned
from test_equilibrium import loaded_span

from cable_twin.mechanics.on_rope.hinge import hinge_energy, hinge_moment
from cable_twin.mechanics.on_rope.sliding_joint import (
    cable_direction,
    driven_force,
    joint_point,
    joint_tangent,
    place_joint,
    tangent_moment,
)
from cable_twin.mechanics.on_rope.tangent_hinge import moment_by_slope, spin_by_slope, tangent_pitch, turn_by_slope
from cable_twin.mechanics.readout.energies import energies
from cable_twin.mechanics.rope.point import bend, slope
from cable_twin.mechanics.rope.shape_functions import shape_functions_xx, shape_functions_xxx
from cable_twin.simulation import Simulation
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
    """Differences to 1e-9; positive pitch of a cable falling in x, in either running direction."""
    assert np.sign(tangent_pitch(slope)) == -np.sign(slope[1] / slope[0])
    assert tangent_pitch((-slope[0], -slope[1])) == pytest.approx(tangent_pitch(slope), abs=1e-15)
    first = difference(lambda r_x: np.array([tangent_pitch(tuple(r_x))]), np.array(slope), 1e-3)[0]
    np.testing.assert_allclose(turn_by_slope(slope), [first], atol=1e-9)
    second = difference(lambda r_x: 3.0 * np.array(turn_by_slope(tuple(r_x))[0]), np.array(slope), 1e-3)
    np.testing.assert_allclose(np.reshape(moment_by_slope((3.0,), slope), (2, 2)), second, atol=1e-8)
    rate = np.array([0.4, 0.7])
    spin = difference(lambda r_x: np.array(turn_by_slope(tuple(r_x))) @ rate, np.array(slope), 1e-3)[0]
    np.testing.assert_allclose(spin_by_slope(tuple(rate), slope), [spin], atol=1e-9)


def test_third_derivative_of_the_shape_functions():
    exact = difference(lambda x: np.array(shape_functions_xx(x[0], 0.7)), np.array([0.2]), 1e-2)[:, 0]
    np.testing.assert_allclose(shape_functions_xxx(0.7), exact, rtol=1e-10)


def turn_along(system, state):
    """Derivative (rad/m) of the pitch of the cable at the joint by the arc length."""
    point = joint_point(system.cable, state, 0)
    r_x, r_xx = slope(state.nodes.position, point, (0.0, 0.0)), bend(state.nodes.position, point, (0.0, 0.0))
    return float(np.dot(turn_by_slope(r_x)[0], r_xx))


def test_direction_at_a_joint_turns_with_the_cable_and_along_it():
    """Rate and derivative by the arc length: differences of the pitch to 1e-7."""
    system, state, _ = hinged_system()

    def pitch(e, s):
        moved = changed(state, nodes_position=state.nodes.position + e, joints_position=state.joints.position + s)
        return np.array([tangent_pitch(cable_direction(system.cable, moved, 0).orientation)])

    rate = cable_direction(system.cable, state, 0).spin[0]
    along = turn_along(system, state)
    motion = state.nodes.velocity, state.joints.velocity
    exact = difference(lambda t: pitch(t[0] * motion[0], t[0] * motion[1]), np.zeros(1), 1e-3)
    assert rate == pytest.approx(exact[0, 0], abs=1e-7)
    exact = difference(lambda s: pitch(0.0, s[0]), np.zeros(1), 1e-3)
    assert along == pytest.approx(exact[0, 0], abs=1e-7)


def test_springs_are_in_the_energy():
    """Energy of k φ² / 2 for each spring."""
    system, state, _ = hinged_system()
    bare = system._replace(carriages=system.carriages._replace(hinge_stiffness=np.zeros(2)))
    pitches = state.bodies.position[:, 2]
    angles = np.array(
        [pitches[0] - tangent_pitch(cable_direction(system.cable, state, 0).orientation), pitches[1] - pitches[0]]
    )
    more = energies(system, state)[1] - energies(bare, state)[1]
    assert more == pytest.approx(0.5 * float(np.sum(system.carriages.hinge_stiffness * angles**2)), rel=1e-9)


def test_rest_with_springs_balances_moments():
    """Moment in each spring of all weight below it; the rest at the fixed joint of an inclined cable."""
    simulation = Simulation(loaded_span(**{"carriages.one.joint": "fixed", **SPRINGS}))
    system, state = simulation.system, simulation.state
    carriages, q = system.carriages, state.bodies.position
    joint = simulation.snapshot.carriages["one"].position
    weights = carriages.mass * 9.81
    about = [[joint[0], joint[2]], q[0, :2] + turned(q[0, 2], carriages.lower_pivot[0])]
    direction = tangent_pitch(cable_direction(system.cable, for_kernels(simulation)[0], 0).orientation)
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


def test_a_driven_joint_takes_the_moment_along_a_bent_cable():
    """Drive force of λ·t plus m ∂α/∂s, to 1e-12."""
    system, state, _ = hinged_system()
    bare = system._replace(carriages=system.carriages._replace(hinge_stiffness=np.zeros(2), hinge_damping=np.zeros(2)))
    moment, force = tangent_moment(system, state, 0)
    assert force == pytest.approx(moment[0] * turn_along(system, state), rel=1e-12)
    assert abs(force) > 0.5
    assert tangent_moment(bare, state, 0) == ((0.0,), 0.0)
    more = driven_force(system, state, 0) - driven_force(bare, state, 0)
    assert more * np.linalg.norm(joint_tangent(system.cable, state, 0)) == pytest.approx(force, rel=1e-12)
