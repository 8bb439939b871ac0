"""A strand of a loop, with more rope on its mesh than that is long, and other speeds at its ends."""

import numpy as np
import pytest
from systems import dense_blocks, difference, disturbed_state, make_system, put
from test_moving_rope import MOVING, changed

from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.language.simd import WIDTH
from cable_twin.mechanics.rope.element import add_cable, element_tensions
from cable_twin.mechanics.rope.strand import going_by, rest_stretch, rope_before

LENGTH = 2.1  # m, of the mesh
PASSED = ((0.3, 1.7, 0.6), (0.1, 1.2, -0.4))  # m, m/s, m/s²: rope that has gone by at start and end
SURPLUS = 0.05  # m


def strand(elements=3, dim=2, **cable):
    """A strand in general position; rope comes to it faster than it goes."""
    cable = {"element_count": elements, "element_length": LENGTH / elements, "bending_stiffness": 0.0} | cable
    system = make_system(dim=dim, cable=cable)._replace(moving_cable=MOVING)
    state, work = disturbed_state(system)
    state.surplus[0] = SURPLUS
    for end, values in enumerate(PASSED):
        for array, value in zip(state.rope, values, strict=True):
            array[end] = value
    return system, state, work


def stretch_at(time):
    """λ after `time` (s)."""
    gone = [p + v * time + 0.5 * a * time**2 for p, v, a in PASSED]
    return 1.0 + (SURPLUS + gone[0] - gone[1]) / LENGTH, gone[0]


def curve(s, t):
    """A smooth motion of the mesh: places (2,) in m."""
    x = 1.05 * s + 0.1 * np.sin(2.0 * s) + 0.2 * t * np.cos(s) + 0.05 * t**2 * s**2
    return np.array([x, 0.3 * np.sin(1.5 * s) + 0.3 * t * s * (LENGTH - s) + 0.1 * t**2 * np.sin(s)])


def by_s(s, t):
    """Its slope."""
    x = 1.05 + 0.2 * np.cos(2.0 * s) - 0.2 * t * np.sin(s) + 0.1 * t**2 * s
    return np.array([x, 0.45 * np.cos(1.5 * s) + 0.3 * t * (LENGTH - 2.0 * s) + 0.1 * t**2 * np.cos(s)])


def rates(function, s, step=1e-3):
    """Value, first and second derivative by time, now."""
    before, now, after = (function(s, t) for t in (-step, 0.0, step))
    return now, (after - before) / (2.0 * step), (after - 2.0 * now + before) / step**2


def test_forces_are_those_of_points_of_the_rope():
    """-∫φ·a dm for a smooth φ, a by differences of the place of what is fixed to the rope; second order in the mesh."""
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
            for row, function in enumerate((curve, by_s)):
                motion = state.nodes.position, state.nodes.velocity, state.nodes.acceleration
                for array, value in zip(motion, rates(function, s), strict=True):
                    array[node, row] = value
        add_cable(system, state, 0.0, 0.0, 0.0, work)
        nodal = np.array([[phi(s), (phi(s + 1e-5) - phi(s - 1e-5)) / 2e-5] for s in system.cable.node_arc_length])
        errors.append(abs(float(np.sum(work.right_side * nodal)) - expected))
    assert errors[-1] < 2e-3 * abs(expected), (errors, expected)
    assert np.log2(errors[0] / errors[-1]) / 2.0 > 1.7, errors


@pytest.mark.parametrize("dim", [2, 3])
def test_tangent_is_the_derivative_of_the_force(dim):
    """By differences, of position and velocity at once."""
    system, state, work = strand(dim=dim)

    def residual(change):
        moved = changed(
            state,
            nodes_position=state.nodes.position + change.reshape(state.nodes.position.shape),
            nodes_velocity=state.nodes.velocity + 25.0 * change.reshape(state.nodes.position.shape),
        )
        add_cable(system, moved, 0.0, 25.0, 1.0, work)
        return -work.right_side.ravel()

    exact = difference(residual, np.zeros(state.nodes.position.size), 1e-4)
    add_cable(system, state, 0.0, 25.0, 1.0, work)
    tangent = dense_blocks(work)
    np.testing.assert_allclose(tangent, exact, atol=1e-6 * np.abs(tangent).max())


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
    """A straight mesh that stands still: EA (ε + τ ε_dot) with ε = |r_s| / λ - 1, its rate by differences."""
    system, state, _ = strand(damping_time=0.02, even=True)
    state.nodes.position[:, 0, 0], state.nodes.position[:, 0, 1] = 1.2 * system.cable.node_arc_length, 0.0
    state.nodes.position[:, 1] = 1.2, 0.0
    state.nodes.velocity[:] = 0.0
    tensions = np.empty((1, WIDTH))
    element_tensions(system.cable, state, tensions)
    strains = [1.2 / stretch_at(t)[0] - 1.0 for t in (-1e-5, 0.0, 1e-5)]
    expected = 900.0 * (strains[1] + 0.02 * (strains[2] - strains[0]) / 2e-5)
    np.testing.assert_allclose(tensions, expected, rtol=1e-8)


def test_what_is_clamped_goes_with_its_place_on_the_rope():
    """Speed and its rate along the mesh, by differences of the place of what is fixed to the rope."""
    system, state, _ = strand()
    now, start = stretch_at(0.0)
    rope = now * 0.8 - start

    def place(t):
        stretch, gone = stretch_at(t)
        return (rope + gone) / stretch

    speed, rate = going_by(system.cable, state, 0.8)
    assert as_python(rest_stretch)(system.cable, state) == pytest.approx(now, rel=1e-15)
    assert speed == pytest.approx((place(1e-4) - place(-1e-4)) / 2e-4, rel=1e-6)
    assert rate == pytest.approx((place(1e-3) - 2.0 * place(0.0) + place(-1e-3)) / 1e-6, rel=1e-5)
