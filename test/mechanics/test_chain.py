"""The chain of bodies: pivots, gaps and their accelerations by differences, elimination against a dense solution."""

import numpy as np
import pytest
from systems import difference, disturbed_state, make_system, second_difference

from cable_twin.mechanics.language.orientations import orientation
from cable_twin.mechanics.language.turns import cross
from cable_twin.mechanics.on_rope.chain import (
    arm_to,
    carriage_mass,
    close_joints,
    condense_chain,
    joint_accelerations,
    pivot_velocity,
    recover_chain,
)
from cable_twin.mechanics.on_rope.hinge import Above, hinge

GRAVITY = np.array([0.0, -9.81])
LEVEL = (1.0, 0.0)  # any vector of a plane


def arm(pitch, offset):
    """A u with A = [[cos, sin], [-sin, cos]]: right-handed about y, so x turns towards -z."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, s], [-s, c]]) @ offset


def gaps(carriages, place, bodies):
    """Gaps (2 bodies,) in m of a chain that hangs at `place`, from its coordinates (bodies, 3)."""
    result, above = [], place
    for body, (x, z, pitch) in enumerate(bodies):
        centre = np.array([x, z])
        result.append(above - centre - arm(pitch, carriages.upper_pivot[body]))
        above = centre + arm(pitch, carriages.lower_pivot[body])
    return np.concatenate(result)


def test_positive_pitch_turns_x_towards_minus_z():
    axes = orientation((0.0, 0.0, np.pi / 2), LEVEL)
    assert arm_to(axes, np.array([1.0, 0.0]), LEVEL) == pytest.approx((0.0, -1.0), abs=1e-15)


def test_arm_and_its_derivative():
    """Closed form to 1e-15, derivative by fourth-order differences to 1e-10."""
    offset = np.array([0.3, -0.8])
    reached = arm_to(orientation((0.0, 0.0, 0.7), LEVEL), offset, LEVEL)
    np.testing.assert_allclose(reached, arm(0.7, offset), atol=1e-15)
    exact = difference(lambda p: arm(p[0], offset), np.array([0.7]), 1e-3)[:, 0]
    np.testing.assert_allclose(cross((1.0,), reached), exact, atol=1e-10)


def test_velocity_of_a_pivot():
    """By differences of its place along a straight motion: to 1e-10."""
    system = make_system(chains=(2,))
    state, _ = disturbed_state(system)
    offset = system.carriages.lower_pivot[1]
    q, q_dot = state.bodies.position[1], state.bodies.velocity[1]

    def place(t):
        at = q + t[0] * q_dot
        return at[:2] + arm(at[2], offset)

    exact = difference(place, np.zeros(1), 1e-3)[:, 0]
    np.testing.assert_allclose(pivot_velocity(state, 1, offset, LEVEL), exact, atol=1e-10)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_gaps_of_a_chain(count):
    system = make_system(chains=(1, count))
    state, work = disturbed_state(system)
    close_joints(system.carriages, state, 1, (0.4, -0.3), Above((0.0,), (0.0,)), work)
    chain = system.carriages._replace(
        upper_pivot=system.carriages.upper_pivot[1:], lower_pivot=system.carriages.lower_pivot[1:]
    )
    exact = gaps(chain, np.array([0.4, -0.3]), state.bodies.position[1:])
    np.testing.assert_allclose(work.joint_gap[1:].ravel(), exact, atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("feedback", [0.0, 4.0])
def test_accelerations_of_the_gaps(count, feedback):
    """γ: second difference of the gaps along a motion without acceleration, and Baumgarte's terms: to 1e-7."""
    system = make_system(chains=(count,))
    state, work = disturbed_state(system)
    place, speed, curving = np.array([0.4, -0.3]), np.array([0.8, 0.2]), np.array([-1.1, 0.6])

    def along(t):
        at = place + t * speed + 0.5 * t * t * curving
        return gaps(system.carriages, at, state.bodies.position + t * state.bodies.velocity)

    exact = second_difference(along, 1e-3)
    rate = difference(lambda t: along(t[0]), np.zeros(1), 1e-3)[:, 0]
    exact = exact + 2.0 * feedback * rate + feedback**2 * along(0.0)
    cable = tuple(place), tuple(speed), tuple(curving), (0.0,)
    joint_accelerations(system.carriages, state, 0, feedback, cable, Above((0.0,), (0.0,)), work)
    np.testing.assert_allclose(work.joint_gap.ravel(), exact, atol=1e-7)


def hinge_moments(carriages, pitches, spins, direction):
    """Moments (bodies,) in N m on the bodies of a chain, from their pitches and rates and those of the cable."""
    angle = np.diff(np.concatenate([[direction[0]], pitches]))
    rate = np.diff(np.concatenate([[direction[1]], spins]))
    return -carriages.hinge_stiffness * angle - carriages.hinge_damping * rate


def chain_residual(carriages, q, multipliers, accelerations, moments=None):
    """M q_ddot - Q - Φ_qᵀ λ of all bodies (3 bodies,), written from the virtual work of the joint forces.

    A hinge has a moment on the body below it, and the opposite one on the body above.
    """
    rows = []
    moments = np.zeros(len(q)) if moments is None else moments
    last = len(q) - 1
    for body, (_, _, pitch) in enumerate(q):
        force = multipliers[body]
        below = multipliers[body + 1] if body < last else np.zeros(2)
        up, low = arm(pitch, carriages.upper_pivot[body]), arm(pitch, carriages.lower_pivot[body])
        row = carriages.mass[body] * (accelerations[body, :2] - GRAVITY) - force + below
        # the moment about y of a force F at (x, z) is z F_x - x F_z
        moment = up[1] * force[0] - up[0] * force[1] - low[1] * below[0] + low[0] * below[1]
        moment += moments[body] - (moments[body + 1] if body < last else 0.0)
        rows.append([*row, carriages.inertia[body] * accelerations[body, 2] - moment])
    return np.ravel(rows)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("stiffness_factor", [0.0, 1.0])
@pytest.mark.parametrize("hinged", [False, True], ids=["bare", "hinged"])
def test_elimination_of_a_chain_is_a_dense_solution(count, stiffness_factor, hinged):
    """D, b, increments and multipliers against a Newton step on all equations of the chain: to 1e-8.

    The joint's place moves by a given (x, z), the cable there turns by a given angle; the derivatives of the dense
    system are differences of the residual.
    """
    springs = {"hinge_stiffness": np.array([70.0, 30.0, 50.0]), "hinge_damping": np.array([6.0, 9.0, 4.0])}
    system = make_system(chains=(count,), carriages={key: value[:count] for key, value in springs.items() if hinged})
    carriages = system.carriages
    state, work = disturbed_state(system)
    mass_factor, rate_factor = 40.0, 7.0
    place, moved, turned = np.array([0.2, -0.1]), np.array([0.03, -0.05]), 0.04
    direction = np.array([0.3, -0.6])
    size = 3 * count

    def residual(delta, forces, turn):
        q = state.bodies.position + stiffness_factor * delta
        spins = state.bodies.velocity[:, 2] + rate_factor * delta[:, 2]
        above = direction + turn * np.array([stiffness_factor, rate_factor])
        moments = hinge_moments(carriages, q[:, 2], spins, above)
        return chain_residual(carriages, q, forces, state.bodies.acceleration + mass_factor * delta, moments)

    def equations(unknown):
        return residual(unknown[:size].reshape(count, 3), unknown[size:].reshape(count, 2), 0.0)

    start = np.concatenate([np.zeros(size), state.multipliers.ravel()])
    top = difference(equations, start, 1e-3)
    q = state.bodies.position
    jacobian = difference(lambda x: gaps(carriages, place, x.reshape(count, 3)), q.ravel(), 1e-3)
    matrix = np.block([[top], [jacobian, np.zeros((2 * count, 2 * count))]])
    gap = gaps(carriages, place, q)
    gap[:2] += moved
    right = -np.concatenate([residual(np.zeros((count, 3)), state.multipliers, turned), gap])
    exact = np.linalg.solve(matrix, right)

    above = Above((direction[0],), (direction[1],))
    close_joints(carriages, state, 0, tuple(place), above, work)
    condense_chain(carriages, tuple(GRAVITY), state, 0, above, mass_factor, rate_factor, stiffness_factor, work)
    before = np.append(state.multipliers[0], hinge(carriages, state, 0, True, above, 0.0, 0.0, LEVEL).moment)
    matrix = np.block(
        [
            [work.impedance[0].reshape(2, 2), work.impedance_turning[0][:, None]],
            [work.impedance_moment[0][None], work.impedance_turn[0][None]],
        ]
    )
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12 * np.abs(matrix).max())
    force = before + matrix @ np.append(moved, turned) + work.impedance_force[0]
    recover_chain(carriages, state, 0, tuple(moved), (turned,), work)
    np.testing.assert_allclose(work.body_increment.ravel(), exact[:size], atol=1e-8)
    scale = np.abs(exact[size:]).max()
    np.testing.assert_allclose(state.multipliers.ravel(), start[size:] + exact[size:], atol=1e-8 * scale)
    np.testing.assert_allclose(state.multipliers[0], force[:2], atol=1e-12 * scale)
    delta = exact[:size].reshape(count, 3)[:, 2]
    after = hinge_moments(
        carriages,
        state.bodies.position[:, 2] + stiffness_factor * delta,
        state.bodies.velocity[:, 2] + rate_factor * delta,
        direction + turned * np.array([stiffness_factor, rate_factor]),
    )
    assert force[2] == pytest.approx(after[0], abs=1e-8)


def test_mass_of_a_carriage():
    system = make_system(chains=(1, 3))
    assert carriage_mass(system.carriages, 1) == pytest.approx(system.carriages.mass[1:].sum(), rel=1e-15)
