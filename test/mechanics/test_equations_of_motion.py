"""Equations of the whole system: condensed Newton step and eq. 16, against dense numpy solutions of all rows.

The rows are written here from their definitions; of the mechanics they use the residual of the bare cable, which has
its own tests. Their derivatives are differences of fourth order.
"""

import numpy as np
import pytest
from systems import (
    changed,
    difference,
    disturbed_state,
    from_nodal_vectors,
    make_system,
    nodal_vectors,
    second_difference,
    turned,
)

from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.language.rotations import cross, orientation
from cable_twin.mechanics.on_rope.buffer import stop_force
from cable_twin.mechanics.on_rope.chain import arm_to, carriage_mass
from cable_twin.mechanics.on_rope.friction import friction_force
from cable_twin.mechanics.on_rope.sliding_joint import place_joint
from cable_twin.mechanics.parameters import DRUM, ELEMENT_FRAME, FORCE, FREE, JOINT, SPEED
from cable_twin.mechanics.rope.element import add_cable
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x, shape_functions_xx
from cable_twin.mechanics.solution.equations_of_motion import (
    assemble,
    largest_gap,
    measure_gap_accelerations,
    measure_gaps,
    solve,
    solve_accelerations,
)
from cable_twin.mechanics.state import Motion

GRAVITY = np.array([0.0, -9.81])
MASS_FACTOR, RATE_FACTOR = 400.0, 25.0
LEVEL = (1.0, 0.0)  # any vector of a plane
ROUGH = {"rolling_friction": 0.3, "viscous_friction": 5.0}


def gaps(carriages, place, bodies):
    """Gaps (2 bodies,) in m of a chain below `place`, from its coordinates (bodies, 3)."""
    result, above = [], place
    for body, (x, z, pitch) in enumerate(bodies):
        centre = np.array([x, z])
        result.append(above - centre - turned(pitch, carriages.upper_pivot[body]))
        above = centre + turned(pitch, carriages.lower_pivot[body])
    return np.concatenate(result)


def test_positive_pitch_turns_x_towards_minus_z():
    axes = orientation((0.0, 0.0, np.pi / 2), LEVEL)
    assert arm_to(axes, np.array([1.0, 0.0]), LEVEL) == pytest.approx((0.0, -1.0), abs=1e-15)


def test_arm_and_its_derivative():
    """Closed form to 1e-15, derivative by fourth-order differences to 1e-10."""
    offset = np.array([0.3, -0.8])
    reached = arm_to(orientation((0.0, 0.0, 0.7), LEVEL), offset, LEVEL)
    np.testing.assert_allclose(reached, turned(0.7, offset), atol=1e-15)
    exact = difference(lambda p: turned(p[0], offset), np.array([0.7]), 1e-3)[:, 0]
    np.testing.assert_allclose(cross((1.0,), reached), exact, atol=1e-10)


def hinge_moments(carriages, pitches, spins, direction):
    """Moments (bodies,) in N m on the bodies of a chain, from pitches and rates of bodies and cable."""
    angle = np.diff(np.concatenate([[direction[0]], pitches]))
    rate = np.diff(np.concatenate([[direction[1]], spins]))
    return -carriages.hinge_stiffness * angle - carriages.hinge_damping * rate


def chain_residual(carriages, q, multipliers, accelerations, moments=None):
    """Residual M q_ddot - Q - Φ_qᵀ λ (3 bodies,) of all bodies, from the virtual work of the joint forces.

    A hinge has a moment on the body below it, and the opposite one on the body above.
    """
    rows = []
    moments = np.zeros(len(q)) if moments is None else moments
    last = len(q) - 1
    for body, (_, _, pitch) in enumerate(q):
        force = multipliers[body]
        below = multipliers[body + 1] if body < last else np.zeros(2)
        up, low = turned(pitch, carriages.upper_pivot[body]), turned(pitch, carriages.lower_pivot[body])
        row = carriages.mass[body] * (accelerations[body, :2] - GRAVITY) - force + below
        # the moment about y of a force F at (x, z) is z F_x - x F_z
        moment = up[1] * force[0] - up[0] * force[1] - low[1] * below[0] + low[0] * below[1]
        moment += moments[body] - (moments[body + 1] if body < last else 0.0)
        rows.append([*row, carriages.inertia[body] * accelerations[body, 2] - moment])
    return np.ravel(rows)


def test_mass_of_a_carriage():
    system = make_system(chains=(1, 3))
    assert carriage_mass(system.carriages, 1) == pytest.approx(system.carriages.mass[1:].sum(), rel=1e-15)


def setup(chains, *, places=None, modes=None, cable=None, **carriages):
    """System with a carriage for each entry of `chains` (its bodies), in general position; states and workspace."""
    count = len(chains)
    carriages = {name: np.full(count, value) for name, value in carriages.items()}
    system = make_system(chains=chains, cable=cable, carriages=carriages)
    state, work = disturbed_state(system)
    if places is not None:
        state.joints.position[:] = places
    state.drives.mode[:] = FREE if modes is None else modes
    state.drives.force[state.drives.mode == FORCE] = 12.0
    state.reference.position[:] = state.joints.position + 0.01
    state.reference.acceleration[:] = 0.4
    state.friction_origin[:] = state.joints.position - 0.004
    state.friction_deflection[:] = 0.2
    for carriage in range(count):
        place_joint(system.cable, state, carriage)
    return system, state, work


def joint_weights(system, state, carriage, function):
    """Shape functions (or derivatives) of a joint as a row (nodes 2,) over the nodal vectors."""
    cable = system.cable
    element = int(state.joint_element[carriage])
    row = np.zeros(2 * (cable.element_count + 1))
    row[2 * element : 2 * element + 4] = function(
        state.joints.position[carriage] - cable.node_arc_length[element], cable.element_length[element]
    )
    return row


def constraints(system, state, work=None):
    """Φ (2 bodies,) in m of all joints of all carriages."""
    e = nodal_vectors(state.nodes.position)
    offset, result = system.carriages.body_offset, [np.zeros(0)]
    for carriage in range(system.carriages.fixed.size):
        chain = slice(offset[carriage], offset[carriage + 1])
        own = system.carriages._replace(
            upper_pivot=system.carriages.upper_pivot[chain], lower_pivot=system.carriages.lower_pivot[chain]
        )
        place = joint_weights(system, state, carriage, shape_functions) @ e
        result.append(gaps(own, place, state.bodies.position[chain]))
    return np.concatenate(result)


def rows(system, state, work):
    """Rows 2, 1, 3 and 4 of eq. 16 as residuals: cable, bodies, sliding coordinates, joints; without drag."""
    cable, carriages = system.cable, system.carriages
    e = nodal_vectors(state.nodes.position)
    bare = system._replace(air=system.air._replace(present=False)) if system.air.present else system
    add_cable(bare, state, 0.0, 0.0, 0.0, work)
    on_cable = -nodal_vectors(work.right_side)
    for arc_length, force in zip(cable.load_arc_length, cable.load_force, strict=True):
        element = np.searchsorted(cable.node_arc_length[1:-1], arc_length, side="right")
        weights = shape_functions(arc_length - cable.node_arc_length[element], cable.element_length[element])
        on_cable[2 * element : 2 * element + 4] -= np.outer(weights, force)
    for node, moment in ((1, cable.end_moment[0]), (-1, cable.end_moment[1])):
        # work M δpitch with the pitch atan2(-z, x) of the slope (x, z)
        x, z = e[node]
        on_cable[node] -= moment * np.array([z, -x]) / (x * x + z * z)
    on_bodies, on_sliding = [], []
    for carriage in range(carriages.fixed.size):
        chain = slice(carriages.body_offset[carriage], carriages.body_offset[carriage + 1])
        own = carriages._replace(
            mass=carriages.mass[chain],
            inertia=carriages.inertia[chain],
            upper_pivot=carriages.upper_pivot[chain],
            lower_pivot=carriages.lower_pivot[chain],
            hinge_stiffness=carriages.hinge_stiffness[chain],
            hinge_damping=carriages.hinge_damping[chain],
        )
        forces, bodies = state.multipliers[chain], state.bodies
        shape_x = joint_weights(system, state, carriage, shape_functions_x)
        r_x, r_xx = shape_x @ e, joint_weights(system, state, carriage, shape_functions_xx) @ e
        turn = np.array([r_x[1], -r_x[0]]) / (r_x @ r_x)  # of the pitch atan2(-z, x), by the slope (x, z)
        rate = turn @ (shape_x @ nodal_vectors(state.nodes.velocity) + state.joints.velocity[carriage] * r_xx)
        direction = np.arctan2(-r_x[1], r_x[0]), rate
        moments = hinge_moments(own, bodies.position[chain, 2], bodies.velocity[chain, 2], direction)
        on_bodies.append(chain_residual(own, bodies.position[chain], forces, bodies.acceleration[chain], moments))
        on_cable = on_cable + np.outer(joint_weights(system, state, carriage, shape_functions), forces[0])
        on_cable = on_cable + moments[0] * np.outer(shape_x, turn)
        norm = np.linalg.norm(r_x)
        along = forces[0] @ r_x / norm
        normal = np.linalg.norm(forces[0] - along * r_x / norm)
        s, s_dot = state.joints.position[carriage], state.joints.velocity[carriage]
        if state.drives.mode[carriage] == SPEED:
            on_sliding.append(s - state.reference.position[carriage])
        else:
            pull = state.drives.force[carriage] + friction_force(carriages, state, carriage, normal)[0]
            pull += stop_force(carriages, cable, carriage, s, s_dot)[0]
            on_sliding.append(norm * (along - pull) + moments[0] * turn @ r_xx)
    for end, node in ((0, 0), (1, -2)):
        for slot in range(2):
            free = cable.end_projector[end, slot].reshape(2, 2)
            on_cable[node + slot] = free @ on_cable[node + slot]
    return np.concatenate([on_cable.ravel(), *on_bodies, np.array(on_sliding), constraints(system, state, work)])


def split(system, unknown):
    """Nodal (nodes, 3, 2), body (bodies, 3), sliding (carriages,) and multiplier (bodies, 2) parts of a vector."""
    nodes, bodies, count = system.cable.element_count + 1, system.carriages.mass.size, system.carriages.fixed.size
    parts = np.split(unknown, np.cumsum([4 * nodes, 3 * bodies, count]))
    return from_nodal_vectors(parts[0], 2), parts[1].reshape(bodies, 3), parts[2], parts[3].reshape(bodies, 2)


def held(system):
    """Projector (nodes 4, nodes 4) onto the coordinates held by supports."""
    size = 4 * (system.cable.element_count + 1)
    matrix = np.zeros((size, size))
    for end, first in ((0, 0), (1, size - 4)):
        for slot in range(2):
            place = slice(first + 2 * slot, first + 2 * slot + 2)
            matrix[place, place] = np.eye(2) - system.cable.end_projector[end, slot].reshape(2, 2)
    return matrix


def moved_by(system, state, unknown, into=None):
    """State after Newton increments of all unknowns, applied as by the integrator; `into` a copy if given."""
    count = system.carriages.fixed.size
    size = unknown.size - 2 * count
    e, q, s, multipliers = split(system, unknown[:size])
    factors = [1.0, RATE_FACTOR, MASS_FACTOR, 0.0]
    driven = (state.axis == JOINT) & (state.drives.mode == SPEED)
    drums = np.array(state.drums) + np.outer(factors, unknown[size : size + count])
    hauled = np.array(state.hauled) + np.outer(factors, unknown[size + count :])
    return changed(
        state,
        into,
        nodes_position=state.nodes.position + e,
        nodes_velocity=state.nodes.velocity + RATE_FACTOR * e,
        nodes_acceleration=state.nodes.acceleration + MASS_FACTOR * e,
        bodies_position=state.bodies.position + q,
        bodies_velocity=state.bodies.velocity + RATE_FACTOR * q,
        bodies_acceleration=state.bodies.acceleration + MASS_FACTOR * q,
        joints_position=state.joints.position + s,
        joints_velocity=state.joints.velocity + np.where(driven, 0.0, RATE_FACTOR) * s,
        multipliers=state.multipliers + multipliers,
        drums=Motion(*drums),
        hauled=Motion(*hauled),
    )


def check_newton_step(system, state, work, tolerance=1e-8, residual=None):
    """`assemble` and `solve` against the dense solution of all rows, relative to the largest entry of each kind.

    `residual` gives the rows of a state; after those of eq. 16 come drums and ways of the haul ropes.
    """
    size, count = 4 * (system.cable.element_count + 1), system.carriages.fixed.size
    total = size + 5 * system.carriages.mass.size + 3 * count
    residual = residual or (lambda moved: np.concatenate([rows(system, moved, work), np.zeros(2 * count)]))
    still = held(system)
    room = clone(state)
    matrix = difference(lambda unknown: residual(moved_by(system, state, unknown, room)), np.zeros(total), 1e-4)
    right = -residual(state)
    # what is held does not move: P K P + (1 - P)
    matrix[:, :size] = matrix[:, :size] @ (np.eye(size) - still)
    matrix[:size, :size] += still
    for k in range(count):  # what is not there does not move, and a sheave that is led is where it has to be
        hauled, led = state.axis[k] == DRUM, state.drives.mode[k] == SPEED
        for row, free in ((total - 2 * count + k, hauled and not led), (total - count + k, hauled)):
            matrix[row] = matrix[row] if free else np.eye(total)[row]
    exact = np.linalg.solve(matrix, right)
    before = state.multipliers.copy()
    measure_gaps(system, state, work, True)
    assemble(system, state, MASS_FACTOR, RATE_FACTOR, 1.0, work)
    assert solve(system, state, work)
    right = (*split(system, exact[: total - 2 * count]), *np.split(exact[total - 2 * count :], 2))
    got = (work.right_side, work.body_increment, work.sliding_increment, state.multipliers - before)
    got = (*got, work.drum_increment, work.haul_increment)
    names = ("cable", "bodies", "sliding", "multipliers", "sheaves", "ways")
    for name, value, expected in zip(names, got, right, strict=True):
        scale = np.abs(expected).max(initial=1e-6)  # of a difference, 1e-14 is rounding
        np.testing.assert_allclose(value, expected, rtol=0, atol=tolerance * scale, err_msg=name)


ELASTIC = {"bending_stiffness": 0.0}  # without bending the tangent of the cable is exact in both models


@pytest.mark.parametrize("mode", [FREE, FORCE, SPEED], ids=["free", "force", "driven"])
@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_newton_step(mode, bodies):
    """Chains of 1 to 3 bodies, each drive mode: to 1e-8."""
    check_newton_step(*setup([bodies], modes=mode, cable=ELASTIC))


def test_newton_step_of_the_bare_cable():
    check_newton_step(*setup([], cable=ELASTIC))


@pytest.mark.parametrize("mode", [FREE, FORCE], ids=["free", "force"])
def test_newton_step_with_friction(mode):
    """Rolling friction on the normal force, mobilised in part, and viscous: to rounding, so the tangent is exact."""
    check_newton_step(*setup([2], modes=mode, cable=ELASTIC, **ROUGH), tolerance=3e-8)


@pytest.mark.parametrize("place", [0.05, 2.04], ids=["start", "end"])
def test_newton_step_in_an_end_stop(place):
    check_newton_step(*setup([2], places=place, cable=ELASTIC, **ROUGH))


@pytest.mark.parametrize("place", [-0.03, 2.13], ids=["start", "end"])
def test_newton_step_beyond_the_end_of_the_cable(place):
    """Joint on the extrapolated end element, pushed back by the end stop."""
    check_newton_step(*setup([1], places=place, cable=ELASTIC))


HINGED = {"hinge_stiffness": [50.0, 20.0, 30.0], "hinge_damping": [4.0, 3.0, 2.0]}


def hinged(chains, spring=1.0, damper=1.0, **options):
    """`setup` with a spring and a damper above every body, driven joints at their references."""
    system, state, work = setup(chains, **options)
    bodies = sum(chains)
    springs = {key: np.resize(HINGED[key], bodies) for key in HINGED}
    springs = {
        "hinge_stiffness": spring * springs["hinge_stiffness"],
        "hinge_damping": damper * springs["hinge_damping"],
    }
    state.reference.position[:] = state.joints.position
    return system._replace(carriages=system.carriages._replace(**springs)), state, work


@pytest.mark.parametrize("mode", [FREE, FORCE, SPEED], ids=["free", "force", "driven"])
@pytest.mark.parametrize(("spring", "damper"), [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)], ids=["spring", "damper", "both"])
@pytest.mark.parametrize("bodies", [1, 3])
def test_newton_step_with_hinges(mode, spring, damper, bodies):
    """Between bodies and against the cable, with friction: to 1e-8, so the tangent is exact."""
    check_newton_step(*hinged([bodies], spring, damper, modes=mode, cable=ELASTIC, **ROUGH))


def test_newton_step_with_a_damper_between_bodies_alone():
    """Bare pivot at the cable, so that the direction of the cable is not needed."""
    system, state, work = hinged([3], cable=ELASTIC)
    system.carriages.hinge_stiffness[0] = system.carriages.hinge_damping[0] = 0.0
    check_newton_step(system, state, work)


def test_newton_step_with_several_carriages_on_one_element():
    """Three on the middle element and one beside it: free, with force, driven."""
    check_newton_step(
        *setup([1, 2, 1, 3], places=[0.8, 1.0, 1.3, 1.6], modes=[FREE, FORCE, SPEED, FREE], cable=ELASTIC, **ROUGH)
    )


def test_newton_step_of_element_frame_with_loads():
    """Exact with bending in the paper's model; two point forces and moments on both ends."""
    cable = {
        "elastic_model": ELEMENT_FRAME,
        "load_arc_length": np.array([0.3, 2.1]),
        "load_force": np.array([[5.0, -20.0], [-3.0, 8.0]]),
        "end_moment": np.array([2.0, -3.5]),
    }
    check_newton_step(*setup([2], cable=cable))


def test_newton_step_of_a_clamped_and_of_a_free_end():
    """Clamped end, whose slope can change in length only, and free end."""
    direction = np.array([0.96, 0.28])
    projector = np.stack(
        [
            np.stack([np.zeros(4), np.outer(direction, direction).ravel()]),
            np.stack([np.eye(2).ravel(), np.eye(2).ravel()]),
        ]
    )
    check_newton_step(*setup([1], cable={**ELASTIC, "end_projector": projector}))


def test_gaps_are_those_of_the_constraints():
    system, state, work = setup([1, 2])
    worst = largest_gap(system, state, work, True)
    exact = constraints(system, state)
    np.testing.assert_allclose(work.joint_gap.ravel(), exact, atol=1e-14)
    assert worst == pytest.approx(np.abs(exact).max(), rel=1e-13)


@pytest.mark.parametrize("feedback", [0.0, 3.0])
def test_right_side_of_the_constraints(feedback):
    """γ: second differences of Φ along a motion without accelerations, and Baumgarte's terms: to 1e-6."""
    system, state, work = setup([1, 3], modes=[FREE, SPEED])

    def along(t):
        return constraints(system, moving(state, t))

    rate = difference(lambda t: along(t[0]), np.zeros(1), 1e-3)[:, 0]
    exact = second_difference(along, 1e-3) + 2.0 * feedback * rate + feedback**2 * along(0.0)
    measure_gap_accelerations(system, state, feedback, work)
    np.testing.assert_allclose(work.joint_gap.ravel(), exact, atol=1e-6)
    assert work.sliding_increment[1] == state.reference.acceleration[1]


def moving(state, t):
    """State after `t` seconds of motion at constant velocities; joints stay on their elements."""
    return changed(
        state,
        nodes_position=state.nodes.position + t * state.nodes.velocity,
        bodies_position=state.bodies.position + t * state.bodies.velocity,
        joints_position=state.joints.position + t * state.joints.velocity,
    )


@pytest.mark.parametrize("modes", [[FREE, FORCE], [SPEED, FREE]], ids=["free and force", "driven and free"])
@pytest.mark.parametrize("model", [0, 1], ids=["continuum", "element_frame"])
@pytest.mark.parametrize("damper", [0.0, 1.0], ids=["bare", "hinged"])
def test_accelerations_solve_equation_16(model, modes, damper):
    """Eq. 16 built densely: M and Φ_q by differences, Q from the rows at zero acceleration, γ as above: to 1e-7."""
    cable = {"elastic_model": model, "damping_time": 0.01}
    system, state, work = hinged([1, 2], damper, damper, modes=modes, cable=cable, viscous_friction=5.0)
    size = 4 * (system.cable.element_count + 1)
    bodies, count = system.carriages.mass.size, system.carriages.fixed.size
    total = size + 5 * bodies + count
    at_rest = clone(state)
    for array in (at_rest.nodes.acceleration, at_rest.bodies.acceleration, at_rest.multipliers):
        array[:] = 0.0

    def residual(unknown):
        e_ddot, q_ddot, _, multipliers = split(system, unknown)
        trial = changed(
            at_rest,
            nodes_acceleration=e_ddot,
            bodies_acceleration=q_ddot,
            multipliers=np.ascontiguousarray(multipliers),
        )
        return rows(system, trial, work)

    def phi(unknown):
        e, q, s, _ = split(system, unknown)
        return constraints(
            system,
            changed(
                at_rest,
                nodes_position=state.nodes.position + e,
                bodies_position=state.bodies.position + q,
                joints_position=state.joints.position + s,
            ),
        )

    # the rows are linear in accelerations and multipliers, so any step will do
    matrix = difference(residual, np.zeros(total), 1.0)
    right = -residual(np.zeros(total))
    joints = slice(total - 2 * bodies, total)
    matrix[joints] = difference(phi, np.zeros(total), 1e-3)
    right[joints] = -second_difference(lambda t: constraints(system, moving(at_rest, t)), 1e-3)
    for carriage in range(count):
        if modes[carriage] == SPEED:
            row = size + 3 * bodies + carriage
            matrix[row], right[row] = 0.0, state.reference.acceleration[carriage]
            matrix[row, row] = 1.0
    still = held(system)
    matrix[:, :size] = matrix[:, :size] @ (np.eye(size) - still)
    matrix[:size, :size] += still
    exact = split(system, np.linalg.solve(matrix, right))

    assert solve_accelerations(system, state, 0.0, work)
    got = (state.nodes.acceleration, state.bodies.acceleration, state.joints.acceleration, state.multipliers)
    for name, value, expected in zip(("cable", "bodies", "sliding", "multipliers"), got, exact, strict=True):
        np.testing.assert_allclose(value, expected, rtol=0, atol=1e-7 * np.abs(expected).max(), err_msg=name)


def test_accelerations_with_friction_obey_its_law():
    """Repeated solution until the multipliers converge: the sliding row holds to 1e-8 N."""
    system, state, work = setup([2], cable={"damping_time": 0.01}, **ROUGH)
    for _ in range(20):
        assert solve_accelerations(system, state, 0.0, work)
    residual = rows(system, state, work)
    row = 4 * (system.cable.element_count + 1) + 3 * 2
    assert abs(residual[row]) < 1e-8
    assert np.abs(residual[: row + 1]).max() < 1e-8


def test_a_system_without_solution_is_reported():
    """Cable without mass and stiffness."""
    system, state, work = setup([1], cable={"axial_stiffness": 0.0, "bending_stiffness": 0.0, "mass_per_length": 0.0})
    measure_gaps(system, state, work, True)
    assemble(system, state, 400.0, 25.0, 1.0, work)
    assert not solve(system, state, work)
