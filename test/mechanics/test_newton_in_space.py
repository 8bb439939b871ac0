"""Chain of bodies and condensed Newton step in space, against dense solutions.

The rows of carriage and joint are written here from their definitions; of the mechanics they use residuals alone. Their
derivatives are differences of fourth order.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from systems import (
    changed,
    difference,
    disturbed_state,
    from_nodal_vectors,
    make_limits,
    make_system,
    nodal_vectors,
    second_difference,
    with_moving_cable,
)

from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.on_rope.buffer import stop_force
from cable_twin.mechanics.on_rope.chain import close_joints, condense_chain, recover_chain
from cable_twin.mechanics.on_rope.counterweight import add_counterweights
from cable_twin.mechanics.on_rope.friction import friction_force
from cable_twin.mechanics.on_rope.hinge import Above
from cable_twin.mechanics.on_rope.sliding_joint import place_joint
from cable_twin.mechanics.on_rope.tower import add_towers
from cable_twin.mechanics.on_rope.wind import drag_bodies, set_wind
from cable_twin.mechanics.parameters import FORCE, FREE, SPEED, Air, MovingCable
from cable_twin.mechanics.rope.element import add_cable
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x, shape_functions_xx
from cable_twin.mechanics.solution.equations_of_motion import (
    add_loads,
    assemble,
    measure_gap_accelerations,
    measure_gaps,
    solve,
)

GRAVITY = np.array([0.0, 0.0, -9.81])
PLACE = np.array([0.2, 0.4, -0.1])
WIND = np.array([4.0, -9.0, 1.5])
DRAG = np.array([0.3, 2.5, 1.1])  # kg/m, along the axes of each body
MASS_FACTOR, RATE_FACTOR = 400.0, 25.0
ELASTIC = {"bending_stiffness": 0.0}  # without bending the tangent of the cable is exact
ROUGH = {"rolling_friction": 0.3, "viscous_friction": 5.0}
SPRINGS = {"hinge_stiffness": [50.0, 20.0, 30.0]}
DAMPERS = {"hinge_damping": [0.0, 3.0, 2.0], "roll_damping": [0.0, 4.0, 1.5]}  # between bodies
FIRST_DAMPERS = {"hinge_damping": [4.0, 3.0, 2.0], "roll_damping": [3.0, 4.0, 1.5]}
WINDY = Air(rope_drag=0.8, body_drag=np.tile(np.diag([1.5, 2.5, 2.0]).ravel(), (3, 1)), present=True)


def cross(a, b):
    """Vector product of two vectors, a tenth of the time that numpy takes for many."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def aligned(vector, goal):
    """Shortest rotation from the direction of one vector into that of another."""
    axis = cross(vector, goal)
    size = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis * (np.arctan2(size, vector @ goal) / size if size > 0.0 else 0.0))


def attitudes(state, holds, tangent, right=True):
    """Rotate the bodies of a chain, each differently; with joint axes at right angles if `right`."""
    for body, held_angles in enumerate(holds):
        turn = Rotation.from_rotvec([0.2 * body, 0.1 + 0.3 * body, 0.32])
        if right:  # laws of springs are linearised about joints whose axes are at right angles, as they are held
            axes, above = turn.as_matrix(), Rotation.from_quat(state.bodies.position[body - 1, 3:]).as_matrix()
            a, c = (tangent, axes[:, 1]) if body == 0 else (above[:, 1], axes[:, 0])
            turn = aligned(c, c - (a @ c) * a) * turn
            if held_angles == 2:
                turn = aligned(turn.as_matrix()[:, 1], a) * turn
        state.bodies.position[body, 3:] = turn.as_quat()
    state.moments[:] = np.random.default_rng(5).standard_normal(state.moments.shape)


def hanging(count, held, damped):
    """Chain in general position below a cable with nearly closed joints, and the rotation of the cable."""
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
    attitudes(state, holds, tangent, right=damped)
    work.turned[:] = 0.0
    return system, state, work, tangent, np.array([0.1, -0.3, 0.2])


class Moved:
    """Chain after rotations and displacements (bodies, 6) of its bodies and a rotation of the cable, by definition."""

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
        """Gaps (bodies, 3) in m of the joint positions, and cosines of the constrained angles."""
        above, found, held = self.hangs_at, [], []
        for body, axes in enumerate(self.axes):
            found.append(above - self.place[body] - axes @ self.carriages.upper_pivot[body])
            above = self.place[body] + axes @ self.carriages.lower_pivot[body]
            a, mine, _ = self.joint(body)
            held += [a @ mine[number] for number in range(self.carriages.held[body])]
        return np.concatenate([np.ravel(found), held])

    def moments(self, holding):
        """Moments (bodies, 3): springs and dampers about a and c, and constraint moments along c x a."""
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
                moment += holding[used] * cross((c, other)[number], a)
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
            total = inertia @ self.acceleration[body, 3:] + cross(self.spin[body], inertia @ self.spin[body])
            up, low = axes @ carriages.upper_pivot[body], axes @ carriages.lower_pivot[body]
            total += cross(low, below) - cross(up, forces[body]) + turning - moments[body]
            rows.append([*row, *total])
        return np.ravel(rows)


def stored_holding(moved, state):
    """Sizes of the constraint moments that the chain has stored in `state.moments`."""
    sizes = []
    for body in range(len(moved.axes)):
        a, mine, _ = moved.joint(body)
        for number in range(moved.carriages.held[body]):
            axis = cross(mine[number], a)
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
    displaced, turned = np.array([0.03, 0.02, -0.05]), 0.04 * cross(tangent, [0.3, -0.5, 0.8])
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
    drag_bodies(system, state, RATE_FACTOR, 1.0, work)
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


def setup(bodies, mode=FREE, *, held=1, place=1.1, air=None, turning=True, cable=ELASTIC, **carriages):
    """Carriage in general position on a disturbed cable, with joint axes at right angles."""
    carriages = {
        name: np.resize(value, bodies if name[:4] in ("hing", "roll") else 1) for name, value in carriages.items()
    }
    if "rolling_friction" in carriages:
        carriages["rolling_friction"] = np.array([ROUGH["rolling_friction"]])
    if air is not None:
        air = air._replace(body_drag=air.body_drag[:bodies])
    system = make_system(3, chains=(bodies,), cable=cable, carriages=carriages, air=air)
    holds = np.array([1, *[held] * (bodies - 1)])
    system = system._replace(carriages=system.carriages._replace(held=holds))
    state, work = disturbed_state(system)
    state.joints.position[:] = place
    place_joint(system.cable, state, 0)
    attitudes(state, holds, direction(system, state)[0])
    state.drives.mode[:] = mode
    state.drives.force[:] = 12.0 if mode == FORCE else 0.0
    state.reference.position[:] = state.joints.position + 0.01
    state.friction_origin[:] = state.joints.position - 0.004
    state.friction_deflection[:] = 0.2
    set_wind(state, WIND)
    if turning:
        work.turned[:] = 0.05 * np.random.default_rng(6).standard_normal(work.turned.shape)
    return system, state, work


def weights(system, state, function):
    """Shape functions (or derivatives) of the joint as a row (nodes 2,) over the nodal vectors."""
    cable, element = system.cable, int(state.joint_element[0])
    row = np.zeros(2 * (cable.element_count + 1))
    within = state.joints.position[0] - cable.node_arc_length[element]
    row[2 * element : 2 * element + 4] = function(within, cable.element_length[element])
    return row


def direction(system, state):
    """Tangent (3,) at the joint, its spin (3,) in rad/s, r_x and r_xx (3,), and its rotation (3, 3) by r_x."""
    e, e_dot = nodal_vectors(state.nodes.position), nodal_vectors(state.nodes.velocity)
    shape_x = weights(system, state, shape_functions_x)
    r_x, r_xx = shape_x @ e, weights(system, state, shape_functions_xx) @ e
    turn = np.stack([cross(r_x, axis) for axis in np.eye(3)], axis=1) / (r_x @ r_x)
    spin = turn @ (shape_x @ e_dot + state.joints.velocity[0] * r_xx)
    return r_x / np.linalg.norm(r_x), spin, r_x, r_xx, turn


def chain(system, state, work=None):
    """Chain of the carriage at its present place, by definition."""
    still = np.zeros((system.carriages.mass.size, 6))
    tangent, spin, *_ = direction(system, state)
    place = weights(system, state, shape_functions) @ nodal_vectors(state.nodes.position)
    return Moved(system, state, still, tangent, spin, np.zeros(3), place)


def rows(system, state, holding, work):
    """Rows 2, 1, 3 and 4 of eq. 16 as residuals: cable, bodies, sliding coordinate, joints with their constraints."""
    carriages, moved = system.carriages, chain(system, state, work)
    add_cable(system, state, 0.0, 0.0, 0.0, work)
    add_loads(system.cable, state, 0.0, work)
    add_towers(system.cable, system.towers, state, 0.0, 0.0, work)
    add_counterweights(system.counterweights, system.cable, state, 0.0, 0.0, 0.0, work)
    on_cable = -nodal_vectors(work.right_side)
    force, moment = state.multipliers[0], moved.moments(holding)[0]
    _, _, r_x, r_xx, turn = direction(system, state)
    on_cable = on_cable + np.outer(weights(system, state, shape_functions), force)
    on_cable = on_cable + np.outer(weights(system, state, shape_functions_x), turn.T @ moment)
    on_bodies = moved.residual(state.multipliers, holding).reshape(-1, 6)
    s, s_dot, norm = state.joints.position[0], state.joints.velocity[0], np.linalg.norm(r_x)
    along = force @ r_x / norm
    if state.drives.mode[0] == SPEED:
        sliding = s - state.reference.position[0]
    else:
        pull = state.drives.force[0] + stop_force(carriages, system.cable, 0, s, s_dot)[0]
        pull += friction_force(carriages, state, 0, np.linalg.norm(force - along * r_x / norm))[0]
        sliding = norm * (along - pull) + moment @ turn @ r_xx
    for end, node in ((0, 0), (1, -2)):
        for slot in range(2):
            on_cable[node + slot] = system.cable.end_projector[end, slot].reshape(3, 3) @ on_cable[node + slot]
    return np.concatenate([on_cable.ravel(), on_bodies.ravel(), [sliding], moved.gaps()])


def dense_newton_step(system, state, work):
    """Increments of all unknowns from the uncondensed system: nodes, bodies, s, multipliers, constraint moments."""
    bodies, driven = system.carriages.mass.size, state.drives.mode[0] == SPEED
    start, turned = stored_holding(chain(system, state), state), work.turned.copy()
    size = nodal_vectors(state.nodes.position).size
    parts, room = np.cumsum([size, 6 * bodies, 1, 3 * bodies]), clone(state)

    def residual(unknown):
        e, q, s, multipliers, holding = np.split(unknown, parts)
        e, q = from_nodal_vectors(e, 3), q.reshape(bodies, 6)
        places, grown = state.bodies.position.copy(), q.copy()
        places[:, :3] += q[:, :3]
        for body, turn in enumerate(map(Rotation.from_rotvec, q[:, 3:])):
            places[body, 3:] = (turn * Rotation.from_quat(places[body, 3:])).as_quat()
            grown[body, 3:] = (turn * Rotation.from_rotvec(turned[body])).as_rotvec() - turned[body]
        moved = changed(
            state,
            room,
            nodes_position=state.nodes.position + e,
            nodes_velocity=state.nodes.velocity + RATE_FACTOR * e,
            nodes_acceleration=state.nodes.acceleration + MASS_FACTOR * e,
            bodies_position=places,
            bodies_velocity=state.bodies.velocity + RATE_FACTOR * grown,
            bodies_acceleration=state.bodies.acceleration + MASS_FACTOR * grown,
            joints_position=state.joints.position + s,
            joints_velocity=state.joints.velocity + (0.0 if driven else RATE_FACTOR) * s,
            multipliers=state.multipliers + multipliers.reshape(bodies, 3),
            contact_arc_length=state.contact_arc_length.copy(),
        )
        return rows(system, moved, start + holding, work)

    matrix = difference(residual, np.zeros(parts[-1] + start.size), 1e-4)
    right = -residual(np.zeros(parts[-1] + start.size))
    still = np.zeros((size, size))
    for end, first in ((0, 0), (1, size - 6)):
        for slot in range(2):
            where = slice(first + 3 * slot, first + 3 * slot + 3)
            still[where, where] = np.eye(3) - system.cable.end_projector[end, slot].reshape(3, 3)
    matrix[:, :size] = matrix[:, :size] @ (np.eye(size) - still)
    matrix[:size, :size] += still
    work.turned[:] = turned
    return np.split(np.linalg.solve(matrix, right), parts)


def check_newton_step(system, state, work, tolerance=1e-5):
    """`assemble` and `solve` against the dense step, relative to the largest entry of each kind of unknown."""
    exact = dense_newton_step(system, state, work)
    exact[0] = from_nodal_vectors(exact[0], 3).ravel()
    before, start = state.multipliers.copy(), chain(system, state)
    holding = stored_holding(start, state)
    measure_gaps(system, state, work, True)
    assemble(system, state, MASS_FACTOR, RATE_FACTOR, 1.0, work)
    assert solve(system, state, work)
    got = (
        work.right_side,
        work.body_increment,
        work.sliding_increment,
        state.multipliers - before,
        stored_holding(start, state) - holding,
    )
    for name, value, expected in zip(("cable", "bodies", "sliding", "multipliers", "held"), got, exact, strict=True):
        scale = np.abs(expected).max(initial=1e-6)
        np.testing.assert_allclose(np.ravel(value), expected, rtol=0, atol=tolerance * scale, err_msg=name)


@pytest.mark.parametrize("mode", [FREE, FORCE, SPEED], ids=["free", "force", "driven"])
@pytest.mark.parametrize(("bodies", "held"), [(1, 1), (2, 1), (3, 2)])
def test_newton_step(mode, bodies, held):
    """Sliding joint with fixed heading, universal and revolute joints below."""
    check_newton_step(*setup(bodies, mode, held=held))


@pytest.mark.parametrize("mode", [FREE, SPEED], ids=["free", "driven"])
@pytest.mark.parametrize("laws", [SPRINGS, DAMPERS, SPRINGS | DAMPERS], ids=["springs", "dampers", "both"])
def test_newton_step_with_hinges_and_friction(mode, laws):
    """Springs against rope and bodies, dampers of pitch and roll between bodies."""
    check_newton_step(*setup(3, mode, turning=laws is SPRINGS, **laws, **ROUGH))


@pytest.mark.parametrize("place", [0.05, 2.04], ids=["start", "end"])
def test_newton_step_in_an_end_stop(place):
    check_newton_step(*setup(2, place=place, **ROUGH))


def test_newton_step_in_wind():
    """Drag of rope and bodies, which changes with their motion in the step."""
    check_newton_step(*setup(2, air=WINDY))


@pytest.mark.long  # of all kernels another kind; the same in a plane is in test_moving_rope
@pytest.mark.parametrize("mode", [FREE, SPEED], ids=["free", "clamped"])
def test_newton_step_on_a_moving_cable(mode):
    """Clamped vehicles as driven joints, and transport terms of the rope."""
    system, state, work = setup(2, mode)
    moving = MovingCable(True, 10.0, limits=make_limits(1, 0.5, 1.0))
    state.rope.velocity[:], state.rope.acceleration[:] = 2.5, 0.4
    check_newton_step(with_moving_cable(system, moving), state, work)


def test_newton_step_with_a_counterweight():
    """Cable end moving along an oblique line, beyond the limit of its travel."""
    system, state, work = setup(2)
    along = np.array([0.8, 0.36, 0.48])
    projector = system.cable.end_projector.copy()
    projector[1, 0] = np.outer(along, along).ravel()
    weight = system.counterweights._replace(
        direction=np.stack([along, along]),
        mass=np.array([0.0, 7.0]),
        force=np.array([0.0, 300.0]),
        travel=np.array([[-np.inf, np.inf], [-0.5, -0.1]]),
        stiffness=np.full(2, 4e3),
        damping=np.full(2, 0.1),
    )
    state.nodes.velocity[-1, 0] = 0.3 * along
    system = system._replace(cable=system.cable._replace(end_projector=projector), counterweights=weight)
    check_newton_step(system, state, work)


def test_newton_step_of_a_clamped_and_of_a_free_end():
    """Clamped end, whose slope can change in length only, and free end."""
    along = np.array([0.8, 0.36, 0.48])
    projector = np.stack([np.stack([np.zeros(9), np.outer(along, along).ravel()]), np.tile(np.eye(3).ravel(), (2, 1))])
    check_newton_step(*setup(1, cable={**ELASTIC, "end_projector": projector}))


@pytest.mark.parametrize("feedback", [0.0, 3.0])
@pytest.mark.parametrize(("bodies", "held"), [(1, 1), (3, 1), (3, 2)])
def test_right_side_of_the_constraints(bodies, held, feedback):
    """γ: second differences of all gaps along a motion without accelerations, and Baumgarte's terms: to 1e-6."""
    system, state, work = setup(bodies, held=held)
    start = Rotation.random(bodies, random_state=4)  # nothing is at right angles
    state.bodies.position[:, 3:] = start.as_quat()

    def along(t):
        turned = Rotation.from_rotvec(t * state.bodies.velocity[:, 3:]) * Rotation.from_quat(
            state.bodies.position[:, 3:]
        )
        places = state.bodies.position[:, :3] + t * state.bodies.velocity[:, :3]
        moved = changed(
            state,
            nodes_position=state.nodes.position + t * state.nodes.velocity,
            bodies_position=np.hstack([places, turned.as_quat()]),
            joints_position=state.joints.position + t * state.joints.velocity,
        )
        return chain(system, moved).gaps()

    rate = difference(lambda t: along(t[0]), np.zeros(1), 1e-3)[:, 0]
    exact = second_difference(along, 1e-3) + 2.0 * feedback * rate + feedback**2 * along(0.0)
    measure_gap_accelerations(system, state, feedback, work)
    holding = [work.held_gap[body, : system.carriages.held[body]] for body in range(bodies)]
    np.testing.assert_allclose(np.concatenate([work.joint_gap.ravel(), *holding]), exact, atol=1e-6)


@pytest.mark.parametrize("mode", [FREE, SPEED], ids=["free", "driven"])
def test_newton_step_with_a_damper_against_the_rope(mode):
    """Approximate tangent of the damper's rate: to a tenth in violent motion."""
    check_newton_step(*setup(3, mode, turning=False, **SPRINGS, **FIRST_DAMPERS), tolerance=0.1)
