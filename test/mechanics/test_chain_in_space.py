"""The chain of bodies in space: elimination, joints that hold and dampers against a dense solution of its equations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from systems import difference, disturbed_state, make_system

from cable_twin.mechanics.on_rope.body_drag import drag_bodies
from cable_twin.mechanics.on_rope.chain import close_joints, condense_chain, recover_chain
from cable_twin.mechanics.on_rope.hinge import Above
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.parameters import Air

GRAVITY = np.array([0.0, 0.0, -9.81])
PLACE = np.array([0.2, 0.4, -0.1])
MASS_FACTOR, RATE_FACTOR = 40.0, 7.0


def aligned(vector, goal):
    """The shortest turn that brings one vector into the direction of another."""
    axis = np.cross(vector, goal)
    size = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis * (np.arctan2(size, vector @ goal) / size if size > 0.0 else 0.0))


WIND = np.array([4.0, -9.0, 1.5])
DRAG = np.array([0.3, 2.5, 1.1])  # kg/m, along the axes of each body


def hanging(count, held, damped):
    """A chain that hangs in general position from a cable, its joints nearly closed, and how the cable is turned."""
    springs = {
        "hinge_stiffness": np.array([70.0, 30.0, 50.0])[:count],
        "hinge_damping": np.array([6.0, 9.0, 4.0])[:count],
        "roll_damping": np.array([3.0, 5.0, 2.0])[:count],
    }
    system = make_system(3, chains=(count,), carriages=springs if damped else {})
    holds = np.array([1, *[held] * (count - 1)])
    air = Air(rope_drag=0.0, body_drag=np.tile(damped * np.diag(DRAG).ravel(), (count, 1)), present=damped)
    system = system._replace(carriages=system.carriages._replace(held=holds), air=air)
    state, work = disturbed_state(system)
    tangent = np.array([0.9, 0.3, -0.2])
    tangent /= np.linalg.norm(tangent)
    for body in range(count):
        turn = Rotation.from_rotvec([0.2 * body, 0.1 + 0.3 * body, 0.32])
        if damped:  # laws of springs are linearised about joints whose axes are at right angles, as they are held
            axes, above = turn.as_matrix(), Rotation.from_quat(state.bodies.position[body - 1, 3:]).as_matrix()
            a, c = (tangent, axes[:, 1]) if body == 0 else (above[:, 1], axes[:, 0])
            turn = aligned(c, c - (a @ c) * a) * turn
            if holds[body] == 2:
                turn = aligned(turn.as_matrix()[:, 1], a) * turn
        state.bodies.position[body, 3:] = turn.as_quat()
    state.moments[:] = np.random.default_rng(5).standard_normal(state.moments.shape)
    work.turned[:] = 0.0
    return system, state, work, tangent, np.array([0.1, -0.3, 0.2])


class Moved:
    """The chain after turns and displacements (bodies, 6) of its bodies and a turn of the cable, as defined."""

    def __init__(self, system, state, delta, tangent, spin, turn, hangs_at=PLACE):
        self.hangs_at = hangs_at
        carriages, rates = system.carriages, state.bodies.velocity
        self.carriages, self.drag = carriages, system.air.body_drag
        self.velocity = rates[:, :3] + RATE_FACTOR * delta[:, :3]
        rotations = [
            Rotation.from_rotvec(row[3:]) * Rotation.from_quat(q[3:])
            for row, q in zip(delta, state.bodies.position, strict=True)
        ]
        self.axes = [rotation.as_matrix() for rotation in rotations]
        self.place = state.bodies.position[:, :3] + delta[:, :3]
        self.spin = rates[:, 3:] + RATE_FACTOR * delta[:, 3:]
        self.acceleration = state.bodies.acceleration + MASS_FACTOR * delta
        self.tangent = Rotation.from_rotvec(turn).as_matrix() @ tangent
        self.spin_above = spin + RATE_FACTOR * turn

    def joint(self, body):
        """Axes a and (c, second c) of a joint, and its relative spin."""
        axes = self.axes[body]
        if body == 0:
            return self.tangent, (axes[:, 1], axes[:, 2]), self.spin[0] - self.spin_above
        return self.axes[body - 1][:, 1], (axes[:, 0], axes[:, 2]), self.spin[body] - self.spin[body - 1]

    def gaps(self):
        """Gaps (bodies, 3) in m of the joints at their places, and the cosines of what they hold."""
        above, found, held = self.hangs_at, [], []
        for body, axes in enumerate(self.axes):
            found.append(above - self.place[body] - axes @ self.carriages.upper_pivot[body])
            above = self.place[body] + axes @ self.carriages.lower_pivot[body]
            a, mine, _ = self.joint(body)
            held += [a @ mine[number] for number in range(self.carriages.held[body])]
        return np.concatenate([np.ravel(found), held])

    def moments(self, holding):
        """Moments (bodies, 3): springs and dampers about a and c, and `holding` along c x a, one a held angle."""
        carriages, result, used = self.carriages, [], 0
        for body in range(len(self.axes)):
            a, (c, other), relative = self.joint(body)
            axes = self.axes[body]
            if body == 0:
                angle, pitch, roll = np.arctan2(a @ axes[:, 2], a @ axes[:, 0]), c, a
            else:
                above = self.axes[body - 1]
                angle, pitch, roll = np.arctan2(-c @ above[:, 2], c @ above[:, 0]), a, c
            moment = (
                -(carriages.hinge_stiffness[body] * angle + carriages.hinge_damping[body] * (pitch @ relative)) * pitch
            )
            moment -= carriages.roll_damping[body] * (roll @ relative) * roll
            for number in range(carriages.held[body]):
                moment += holding[used] * np.cross((c, other)[number], a)
                used += 1
            result.append(moment)
        return np.array(result)

    def residual(self, forces, holding):
        """Newton's and Euler's equations (bodies, 6) about the axes of the world."""
        carriages, rows, moments = self.carriages, [], self.moments(holding)
        last = len(self.axes) - 1
        for body, axes in enumerate(self.axes):
            below, turning = (forces[body + 1], moments[body + 1]) if body < last else (np.zeros(3), np.zeros(3))
            row = carriages.mass[body] * (self.acceleration[body, :3] - GRAVITY) - forces[body] + below
            relative = WIND - self.velocity[body]
            row -= axes @ self.drag[body].reshape(3, 3) @ axes.T @ relative * np.linalg.norm(relative)
            inertia = axes @ carriages.inertia[body].reshape(3, 3) @ axes.T
            total = inertia @ self.acceleration[body, 3:] + np.cross(self.spin[body], inertia @ self.spin[body])
            up, low = axes @ carriages.upper_pivot[body], axes @ carriages.lower_pivot[body]
            total += np.cross(low, below) - np.cross(up, forces[body]) + turning - moments[body]
            rows.append([*row, *total])
        return np.ravel(rows)


def stored_holding(moved, state):
    """Sizes of the moments that hold, as the chain takes them out of `state.moments`."""
    sizes = []
    for body in range(len(moved.axes)):
        a, mine, _ = moved.joint(body)
        for number in range(moved.carriages.held[body]):
            axis = np.cross(mine[number], a)
            sizes.append(state.moments[body] @ axis / (axis @ axis))
    return np.array(sizes)


@pytest.mark.parametrize("damped", [False, True], ids=["bare", "damped"])
@pytest.mark.parametrize(("count", "held"), [(1, 1), (2, 1), (2, 2), (3, 1), (3, 2)])
def test_elimination_of_a_chain_is_a_dense_solution(count, held, damped):
    """Increments and forces against a Newton step on all equations of the chain, by differences: to 1e-7.

    What is damped has drag as well, by the axes of each body.
    """
    system, state, work, tangent, spin = hanging(count, held, damped)
    carriages = system.carriages
    displaced, turned = np.array([0.03, 0.02, -0.05]), 0.04 * np.cross(tangent, [0.3, -0.5, 0.8])
    start = Moved(system, state, np.zeros((count, 6)), tangent, spin, np.zeros(3))
    holding = stored_holding(start, state)
    size, forces = 6 * count, 3 * count

    def equations(unknown, turn):
        moved = Moved(system, state, unknown[:size].reshape(count, 6), tangent, spin, turn)
        lambdas = state.multipliers + unknown[size : size + forces].reshape(count, 3)
        return np.concatenate([moved.residual(lambdas, holding + unknown[size + forces :]), moved.gaps()])

    zero = np.zeros(size + forces + holding.size)
    left = difference(lambda x: equations(x, np.zeros(3)), zero, 1e-4)
    by_turn = difference(lambda turn: equations(zero, turn), np.zeros(3), 1e-4)
    moved_on = equations(zero, np.zeros(3))
    moved_on[size : size + 3] += displaced
    exact = np.linalg.solve(left, -moved_on - by_turn @ turned)

    before = state.multipliers.ravel().copy()
    above = Above(tuple(tangent), tuple(spin))
    close_joints(carriages, state, 0, tuple(PLACE), above, work)
    np.testing.assert_allclose(work.joint_gap, start.gaps()[:forces].reshape(count, 3), atol=1e-14)
    set_wind(state, WIND)
    drag_bodies(system.air, state, tuple(GRAVITY), RATE_FACTOR, 1.0, work)
    condense_chain(carriages, tuple(GRAVITY), state, 0, above, MASS_FACTOR, RATE_FACTOR, 1.0, work)
    matrix = np.block(
        [
            [work.impedance[0].reshape(3, 3), work.impedance_turning[0].reshape(3, 3)],
            [work.impedance_moment[0].reshape(3, 3), work.impedance_turn[0].reshape(3, 3)],
        ]
    )
    acting = np.concatenate([state.multipliers[0], start.moments(holding)[0]])
    acting = acting + matrix @ np.concatenate([displaced, turned]) + work.impedance_force[0]
    recover_chain(carriages, state, 0, tuple(displaced), tuple(turned), work)
    np.testing.assert_allclose(work.body_increment.ravel(), exact[:size], atol=1e-7 * np.abs(exact[:size]).max())
    scale = np.abs(exact[size : size + forces]).max()
    np.testing.assert_allclose(state.multipliers[0], acting[:3], atol=1e-9 * scale)
    np.testing.assert_allclose(state.multipliers.ravel(), before + exact[size : size + forces], atol=1e-6 * scale)
