"""Axially moving cable and strand of a loop: forces against their definition, carriers entering and leaving.

On a strand there is more rope on the mesh than that is long, and rope has other speeds at its ends.
"""

import numpy as np
import pytest
from systems import (
    changed,
    dense_blocks,
    difference,
    disturbed_state,
    from_nodal_vectors,
    make_limits,
    make_system,
    nodal_vectors,
    put,
    with_moving_cable,
)
from test_equations_of_motion import ELASTIC, check_newton_step, setup

from cable_twin.mechanics.drives.moving_rope import move_rope, moving_rope_force
from cable_twin.mechanics.drives.stations import LEAVING, attach_carriers, loop_coordinate
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.language.declared import arrays_of
from cable_twin.mechanics.language.simd import WIDTH
from cable_twin.mechanics.on_rope.sliding_joint import joint_velocity
from cable_twin.mechanics.parameters import SPEED, STANDING, MovingCable
from cable_twin.mechanics.rope.ale import rest_stretch, rope_before, transport_velocity
from cable_twin.mechanics.rope.element import add_cable, element_tensions
from cable_twin.mechanics.rope.flow import flow_energy, flow_integrals
from cable_twin.mechanics.rope.shape_functions import (
    FLOW,
    SLOPE,
    shape_functions,
    shape_functions_x,
    shape_functions_xx,
)
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope
from cable_twin.mechanics.solution.equations_of_motion import largest_gap
from cable_twin.mechanics.solution.generalized_alpha import advance
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.mechanics.state import allocate_state, allocate_workspace

MOVING = MovingCable(moving=True, loop_length=5.0, limits=make_limits(1, 0.8, 1.5))  # of which 2.1 m are the cable


def gauss(points=6):
    """Gauss-Legendre points and weights on 0..1."""
    x, weights = np.polynomial.legendre.leggauss(points)
    return (x + 1.0) / 2.0, weights / 2.0


def moving_system(**changes):
    """Bare cable in general position moving at 1.7 m/s and accelerating at 0.6 m/s²."""
    system = with_moving_cable(make_system(**changes), MOVING)
    state, work = disturbed_state(system)
    put(state.rope, 0.3, 1.7, 0.6)
    return system, state, work


def fields(system, coordinates, function):
    """S, S_x or S_xx times `coordinates` at the Gauss points of all elements, and all weights in m."""
    cable = system.cable
    points, weights = gauss()
    e = nodal_vectors(coordinates)
    values = []
    for element, length in enumerate(cable.element_length):
        rows = np.array([function(u * length, length) for u in points])
        values.append(rows @ e[2 * element : 2 * element + 4])
    return np.concatenate(values), np.outer(cable.element_length, weights).ravel()


def flow(system, state, rate_factor, stiffness_factor):
    """Nodal forces and tangent of the axial motion: with motion less without."""
    found = []
    for each in (system, system._replace(moving_cable=STANDING)):
        work = allocate_workspace(each)
        add_cable(each, state, 0.0, rate_factor, stiffness_factor, work)
        found.append((nodal_vectors(work.right_side), dense_blocks(work)))
    return found[0][0] - found[1][0], found[0][1] - found[1][1]


def test_integrals_of_the_shape_functions():
    points, weights = gauss()
    s = np.array([shape_functions(u, 1.0) for u in points])
    s_x = np.array([shape_functions_x(u, 1.0) for u in points])
    np.testing.assert_allclose(np.array(FLOW), np.einsum("k,ki,kj", weights, s, s_x), atol=1e-15)
    np.testing.assert_allclose(np.array(SLOPE), np.einsum("k,ki,kj", weights, s_x, s_x), atol=1e-15)


@pytest.mark.parametrize("dim", [2, 3])
def test_force_is_that_of_the_convective_acceleration(dim):
    """-∫ρA Sᵀ(2 v r_tx + v² r_xx + v_t r_x) dx by quadrature, away from the ends: to 1e-12."""
    system, state, _ = moving_system(dim=dim)
    cable = system.cable
    forces, _ = flow(system, state, 0.0, 0.0)
    r_tx, _ = fields(system, state.nodes.velocity, shape_functions_x)
    r_x, _ = fields(system, state.nodes.position, shape_functions_x)
    r_xx, _ = fields(system, state.nodes.position, shape_functions_xx)
    speed, rate = state.rope.velocity[0], state.rope.acceleration[0]
    acceleration = 2.0 * speed * r_tx + speed**2 * r_xx + rate * r_x
    points, weights = gauss()
    expected = np.zeros((2 * (cable.element_count + 1), dim))
    for element in range(cable.element_count):
        for k, u in enumerate(points):
            length = cable.element_length[element]
            row = np.array(shape_functions(u * length, length))
            value = acceleration[element * points.size + k]
            weight = weights[k] * length * cable.mass_per_length
            expected[2 * element : 2 * element + 4] -= weight * np.outer(row, value)
    # by parts the ends have ρA v² r_x more, which their supports take
    boundary = cable.mass_per_length * speed**2 * state.nodes.position[:, 1]
    expected[0] -= boundary[0]
    expected[-2] += boundary[-1]
    np.testing.assert_allclose(forces, expected, atol=1e-12)


def test_a_cable_that_stands_still_has_no_such_force():
    system, state, _ = moving_system()
    put(state.rope, state.rope.position[0], 0.0, 0.0)
    forces, tangent = flow(system, state, 25.0, 1.0)
    assert not np.any(forces)
    assert not np.any(tangent)


@pytest.mark.parametrize("apart", [0.0, 1.5])
def test_kinetic_energy_is_that_of_the_velocity_of_the_cable(apart):
    """½∫ρA |r_t + u r_x|² dx by quadrature less that of r_t alone; u by elements, between ends of other speeds."""
    system, state, _ = moving_system()
    state.rope.velocity[1] += apart
    r_t, weights = fields(system, state.nodes.velocity, shape_functions)
    r_x, _ = fields(system, state.nodes.position, shape_functions_x)
    cable, speed = system.cable, state.rope.velocity
    middles = np.cumsum(cable.element_length) - 0.5 * cable.element_length
    u = speed[0] + (speed[1] - speed[0]) * np.repeat(middles, gauss()[0].size)[:, None] / cable.unstrained_length
    whole = np.sum(weights[:, None] * (r_t + u * r_x) ** 2) - np.sum(weights[:, None] * r_t**2)
    assert flow_energy(system.cable, state) == pytest.approx(0.5 * system.cable.mass_per_length * whole, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("elements", [1, 2, 3, 4, 5, 8, 11])
def test_flow_integrals_of_any_number_of_elements(elements, dim):
    """Full groups of lanes, remainders, and both: by quadrature to 1e-12."""
    system, state, _ = moving_system(dim=dim, cable={"element_count": elements})
    r_x, weights = fields(system, state.nodes.position, shape_functions_x)
    r_t, _ = fields(system, state.nodes.velocity, shape_functions)
    r_tx, _ = fields(system, state.nodes.velocity, shape_functions_x)
    r_tt, _ = fields(system, state.nodes.acceleration, shape_functions)
    expected = [
        system.cable.mass_per_length * np.sum(weights[:, None] * r_x * other) for other in (r_t, r_x, r_tt, r_tx)
    ]
    scale = expected[1]  # of the one that is a sum of squares: the others may be nearly nothing
    energies = []
    for speed in (1.0, -1.0):  # that of r_t is the derivative of the kinetic energy by the speed
        put(state.rope, state.rope.position[0], speed, state.rope.acceleration[0])
        energies.append(flow_energy(system.cable, state))
    got = 0.5 * (energies[0] - energies[1]), *flow_integrals(system.cable, state)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12 * scale)


def test_haul_force_is_the_rate_of_its_momentum():
    """d/dt of ∂T/∂v by differences along a motion of constant accelerations, less ∂T/∂(what has gone by) = 0."""
    system, state, _ = moving_system()

    def momentum(t):
        moved = changed(
            state,
            nodes_position=state.nodes.position
            + t[0] * state.nodes.velocity
            + 0.5 * t[0] ** 2 * state.nodes.acceleration,
            nodes_velocity=state.nodes.velocity + t[0] * state.nodes.acceleration,
        )
        r_t, weights = fields(system, moved.nodes.velocity, shape_functions)
        r_x, _ = fields(system, moved.nodes.position, shape_functions_x)
        speed = state.rope.velocity[0] + t[0] * state.rope.acceleration[0]
        integral = np.sum(weights[:, None] * r_x * (r_t + speed * r_x))
        return np.array([system.cable.mass_per_length * integral])

    rate = difference(momentum, np.zeros(1), 1e-3)[0, 0]
    # ∫ρA r_tx·r_t dx = ½ρA [r_t²] is in d/dt but not in the force; it vanishes where the ends are held
    r_tx, weights = fields(system, state.nodes.velocity, shape_functions_x)
    r_t, _ = fields(system, state.nodes.velocity, shape_functions)
    ends = system.cable.mass_per_length * np.sum(weights[:, None] * r_tx * r_t)
    assert moving_rope_force(system, state) == pytest.approx(rate - ends, rel=1e-9)


@pytest.mark.parametrize("rope", [(0.0, 1.7, 0.6), (0.0, -2.5, -0.4)])
def test_newton_step_of_a_moving_cable(rope):
    """Condensed against dense, with clamped carriages; `add_flow` has its own test."""
    system, state, work = setup([1, 2], modes=SPEED, cable=ELASTIC)
    moving = with_moving_cable(system, MOVING)
    put(state.rope, *rope)
    check_newton_step(moving, state, work)


def loop(places, *, speed=1.0, element_length=0.7, **changes):
    """Straight cable moving at `speed`, with carriers of one body at `places` on its loop."""
    count = len(places)
    standing = make_system(
        chains=[1] * count,
        cable={"element_length": element_length, "damping_time": 0.01, "even": True},
        carriages={
            "clamped": np.ones(count, dtype=np.bool_),
            "loop_place": np.array(places, dtype=float),
            "stop_stroke": np.zeros(count),
            "stop_stiffness": np.zeros(count),
            **changes,
        },
    )
    system = with_moving_cable(standing, MOVING)
    state, work = allocate_state(system), allocate_workspace(system)
    state.attached[:] = False
    state.nodes.position[:, 0, 0] = 1.05 * system.cable.node_arc_length
    state.nodes.position[:, 1:, 0] = 1.05
    state.drives.mode[:] = SPEED
    state.rope.velocity[:] = state.rope_drive.target[0] = speed
    attach_carriers(system, state)
    move_rope(system, state, 0.0)
    return system, state, work


@pytest.mark.parametrize(("travelled", "place"), [(0.0, 1.5), (3.4, 4.9), (3.6, 0.1), (-1.6, 4.9), (-11.4, 0.1)])
def test_loop_coordinate_goes_round_both_ways(travelled, place):
    system, state, _ = loop([1.5])
    state.rope.position[:] = travelled
    assert loop_coordinate(system, state, 0) == pytest.approx(place, abs=1e-12)


@pytest.mark.parametrize(
    ("place", "attached", "station"), [(2.02, True, 2.02), (2.06, False, 2.1), (2.2, False, 2.1), (4.9, False, 0.0)]
)
def test_what_is_off_the_mesh_hangs_in_the_nearer_station(place, attached, station):
    """Carrier at rest whose joint bears its weight."""
    system, state, work = loop([place])
    assert state.attached[0] == attached
    assert state.joints.position[0] == pytest.approx(station)
    assert largest_gap(system, state, work, True) < 1e-12
    if not attached:
        assert not np.any(state.bodies.velocity)
        np.testing.assert_allclose(state.multipliers[0], [0.0, 9.81 * system.carriages.mass[0]])


def test_what_comes_onto_a_moving_cable_moves_with_its_joint():
    """Carrier upright, without a gap, with velocity and acceleration of its point of the cable."""
    system, state, work = loop([4.95])
    state.nodes.velocity[1] = [[0.1, -0.3], [0.05, 0.2], [0.05, 0.2]]
    put(state.rope, 0.15, 1.3, 0.4)
    attach_carriers(system, state)
    assert state.attached[0]
    assert state.joints.position[0] == pytest.approx(0.1)
    assert largest_gap(system, state, work, True) < 1e-12
    assert state.bodies.position[0, 2] == 0.0
    velocity = joint_velocity(system.cable, state, 0)
    np.testing.assert_allclose(state.bodies.velocity[0], [*velocity, 0.0])

    def place(t):
        """Position of the joint after `t` at the present velocities and rope acceleration."""
        e = nodal_vectors(state.nodes.position + t[0] * state.nodes.velocity)
        s = 0.1 + 1.3 * t[0] + 0.5 * 0.4 * t[0] ** 2
        return np.array(shape_functions(s, system.cable.element_length[0])) @ e[:4]

    np.testing.assert_allclose(velocity, difference(place, np.zeros(1), 1e-3)[:, 0], atol=1e-10)
    step = 1e-3
    second = (place([step]) - 2.0 * place([0.0]) + place([-step])) / step**2
    np.testing.assert_allclose(state.bodies.acceleration[0, :2], second, atol=1e-5)
    force = system.carriages.mass[0] * (state.bodies.acceleration[0, :2] + [0.0, 9.81])
    np.testing.assert_allclose(state.multipliers[0], force)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_carriers_go_round_and_keep_their_spacing(direction):
    """Five carriers on a loop of 5 m for 8 s at 1 m/s: places to 1e-9 m, no halved step, each off and on again."""
    places = [0.5, 1.5, 2.5, 3.5, 4.5]
    system, state, work = loop(places, speed=direction, mass=np.full(5, 0.3))
    alone = Assembly([Rope(system, state, work)])
    seen = set()
    for second in range(80):
        while left := 100 * (second + 1) - int(state.clock[0]):  # a call ends with the step that changes a place
            outcome = Outcome(*advance(*alone.arguments, left))
            assert outcome.converged
            assert outcome.halvings == 0
            assert outcome.gap < 1e-9
        loops = np.array([loop_coordinate(system, state, k) for k in range(5)])
        rail = LEAVING * system.cable.element_length[0]
        staying = loops <= 2.1 - rail if direction > 0.0 else (rail <= loops) & (loops <= 2.1)
        np.testing.assert_array_equal(state.attached, staying)  # off the rope where a rail takes it
        np.testing.assert_allclose(state.joints.position[state.attached], loops[state.attached], atol=1e-12)
        seen.update(np.flatnonzero(state.attached).tolist())
        assert all(np.isfinite(array).all() for array in arrays_of(state).values())
    assert seen == {0, 1, 2, 3, 4}
    assert state.rope.position[0] == pytest.approx(8.0 * direction)
    gaps = (np.diff([loop_coordinate(system, state, k) for k in range(5)])) % 5.0
    np.testing.assert_allclose(gaps, 1.0, atol=1e-12)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_loop_no_longer_than_the_cable_has_every_carrier_on_it(direction):
    """Carriers leaving at one end enter at the other within the step, without a station."""
    system, state, work = loop([0.3, 1.0, 1.7], speed=direction, mass=np.full(3, 0.3))
    system = system._replace(moving_cable=MOVING._replace(loop_length=2.1))
    alone = Assembly([Rope(system, state, work)])
    passed = 0
    places = state.joints.position.copy()
    for tenth in range(300):
        while left := 10 * (tenth + 1) - int(state.clock[0]):  # a call ends with the step that changes a place
            assert Outcome(*advance(*alone.arguments, left)).converged
        assert state.attached.all()
        np.testing.assert_allclose(state.joints.velocity, direction)
        passed += int(np.sum(np.abs(state.joints.position - places) > 1.0))
        places = state.joints.position.copy()
    assert passed == 4  # 3 m go by


LENGTH = 2.1  # m, of the mesh
PASSED = ((0.3, 1.7, 0.6), (0.1, 1.2, -0.4))  # m, m/s, m/s²: rope that has gone by at start and end
SURPLUS = 0.05  # m


def strand(elements=3, dim=2, **cable):
    """Strand in general position with more rope entering than leaving."""
    cable = {"element_count": elements, "element_length": LENGTH / elements, "bending_stiffness": 0.0} | cable
    system = make_system(dim=dim, cable=cable)._replace(moving_cable=MOVING)
    state, work = disturbed_state(system)
    state.surplus[0] = SURPLUS
    for end, values in enumerate(PASSED):
        for array, value in zip(state.rope, values, strict=True):
            array[end] = value
    return system, state, work


def stretch_at(time):
    """Rest stretch λ after `time` (s)."""
    gone = [p + v * time + 0.5 * a * time**2 for p, v, a in PASSED]
    return 1.0 + (SURPLUS + gone[0] - gone[1]) / LENGTH, gone[0]


def curve(s, t):
    """Smooth motion of the mesh: positions (2,) in m."""
    x = 1.05 * s + 0.1 * np.sin(2.0 * s) + 0.2 * t * np.cos(s) + 0.05 * t**2 * s**2
    return np.array([x, 0.3 * np.sin(1.5 * s) + 0.3 * t * s * (LENGTH - s) + 0.1 * t**2 * np.sin(s)])


def by_s(s, t):
    """Slope of `curve`."""
    x = 1.05 + 0.2 * np.cos(2.0 * s) - 0.2 * t * np.sin(s) + 0.1 * t**2 * s
    return np.array([x, 0.45 * np.cos(1.5 * s) + 0.3 * t * (LENGTH - 2.0 * s) + 0.1 * t**2 * np.cos(s)])


def rates(function, s, step=1e-3):
    """Present value, first and second derivative by time."""
    before, now, after = (function(s, t) for t in (-step, 0.0, step))
    return now, (after - before) / (2.0 * step), (after - 2.0 * now + before) / step**2


def test_forces_are_those_of_points_of_the_rope():
    """-∫φ·a dm for a smooth φ, a by differences of positions fixed to the rope; second order in the mesh."""
    now, start = stretch_at(0.0)

    def acceleration(s, step=1e-3):
        rope = now * s - start  # what stays

        def place(t):
            stretch, gone = stretch_at(t)
            return curve((rope + gone) / stretch, t)

        return (place(step) - 2.0 * place(0.0) + place(-step)) / step**2

    def phi(s):
        return np.array([np.sin(np.pi * s / LENGTH) ** 2, s * np.sin(np.pi * s / LENGTH)])

    points, weights = np.polynomial.legendre.leggauss(40)
    places, weights = 0.5 * LENGTH * (points + 1.0), 0.5 * LENGTH * weights
    expected = -sum(1.3 * now * w * phi(s) @ acceleration(s) for s, w in zip(places, weights, strict=True))
    errors = []
    for elements in (20, 40, 80):
        system, state, work = strand(elements, axial_stiffness=0.0, gravity=(0.0, 0.0))
        for node, s in enumerate(system.cable.node_arc_length):
            for row, function in enumerate((curve, by_s, by_s)):
                motion = state.nodes.position, state.nodes.velocity, state.nodes.acceleration
                for array, value in zip(motion, rates(function, s), strict=True):
                    array[node, row] = value
        add_cable(system, state, 0.0, 0.0, 0.0, work)
        nodal = np.array([[phi(s), (phi(s + 1e-5) - phi(s - 1e-5)) / 2e-5] for s in system.cable.node_arc_length])
        errors.append(abs(float(np.sum(work.right_side[:, :2] * nodal)) - expected))
    assert errors[-1] < 2e-3 * abs(expected), (errors, expected)
    assert np.log2(errors[0] / errors[-1]) / 2.0 > 1.7, errors


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("of_loop", [False, True], ids=["cable", "strand"])
def test_tangent_is_the_derivative_of_the_force(of_loop, dim):
    """Differences of position and velocity at once, without bending, whose tangent is approximate."""
    system, state, work = strand(dim=dim) if of_loop else moving_system(dim=dim, cable={"bending_stiffness": 0.0})

    def residual(change):
        moved = changed(
            state,
            nodes_position=state.nodes.position + from_nodal_vectors(change, dim),
            nodes_velocity=state.nodes.velocity + 25.0 * from_nodal_vectors(change, dim),
        )
        add_cable(system, moved, 0.0, 25.0, 1.0, work)
        return -nodal_vectors(work.right_side).ravel()

    exact = difference(residual, np.zeros(nodal_vectors(state.nodes.position).size), 1e-4)
    add_cable(system, state, 0.0, 25.0, 1.0, work)
    tangent = dense_blocks(work)
    np.testing.assert_allclose(tangent, exact, atol=1e-9 * np.abs(tangent).max())


def test_weight_is_that_of_the_rope_on_the_mesh():
    system, state, work = strand(axial_stiffness=0.0)
    put(state.rope, 0.0, 0.0, 0.0)
    state.rope.position[:] = 0.3, 0.1
    state.nodes.acceleration[:] = 0.0
    add_cable(system, state, 0.0, 0.0, 0.0, work)
    rope = LENGTH + SURPLUS + 0.3 - 0.1
    assert work.right_side[:, 0, 1].sum() == pytest.approx(-1.3 * 9.81 * rope, rel=1e-13)
    assert rope_before(system.cable, state, LENGTH) - rope_before(system.cable, state, 0.0) == pytest.approx(rope)


def test_tension_and_its_damping_follow_the_rope_that_comes_onto_the_mesh():
    """Straight mesh at rest: EA (ε + τ ε_dot) with ε = |r_s| / λ - 1, its rate by differences."""
    system, state, _ = strand(damping_time=0.02, even=True)
    state.nodes.position[:, 0, 0], state.nodes.position[:, 0, 1] = 1.2 * system.cable.node_arc_length, 0.0
    state.nodes.position[:, 1:] = 1.2, 0.0
    state.nodes.velocity[:] = 0.0
    tensions = np.empty((1, WIDTH))
    element_tensions(system.cable, state, tensions)
    strains = [1.2 / stretch_at(t)[0] - 1.0 for t in (-1e-5, 0.0, 1e-5)]
    expected = 900.0 * (strains[1] + 0.02 * (strains[2] - strains[0]) / 2e-5)
    np.testing.assert_allclose(tensions, expected, rtol=1e-8)


def test_what_is_clamped_goes_with_its_place_on_the_rope():
    """Speed and its rate along the mesh, by differences of a place fixed to the rope."""
    system, state, _ = strand()
    now, start = stretch_at(0.0)
    rope = now * 0.8 - start

    def place(t):
        stretch, gone = stretch_at(t)
        return (rope + gone) / stretch

    speed, rate = transport_velocity(system.cable, state, 0.8)
    assert as_python(rest_stretch)(system.cable, state) == pytest.approx(now, rel=1e-15)
    assert speed == pytest.approx((place(1e-4) - place(-1e-4)) / 2e-4, rel=1e-6)
    assert rate == pytest.approx((place(1e-3) - 2.0 * place(0.0) + place(-1e-3)) / 1e-6, rel=1e-5)
