"""One cable element: force against energy, tangent against force, damping, inertia; both models, planar and spatial.

The energies here are written with numpy alone and differentiated with complex steps, so that the gradient has no error
but rounding.
"""

import numpy as np
import pytest
from systems import (
    changed,
    dense_blocks,
    difference,
    disturbed_state,
    from_nodal_vectors,
    make_cable,
    make_system,
    nodal_vectors,
)

from cable_twin.mechanics.parameters import CONTINUUM, ELEMENT_FRAME
from cable_twin.mechanics.rope import elastic_models
from cable_twin.mechanics.rope import element as cable_element
from cable_twin.mechanics.rope.shape_functions import (
    AXIAL_POINTS,
    BENDING_POINTS,
    MASS,
    shape_functions,
    shape_functions_x,
    shape_functions_xx,
)

MODELS = pytest.mark.parametrize("model", [CONTINUUM, ELEMENT_FRAME], ids=["continuum", "element_frame"])
DIMS = pytest.mark.parametrize("dim", [2, 3])


def vectors(dim, seed=5):
    """Chord and slopes (3, dim) in m of a stretched and bent element of about 0.7 m."""
    rng = np.random.default_rng(seed)
    return 0.8 * np.eye(dim)[0] + 0.12 * rng.standard_normal((3, dim))


def slopes(u):
    return np.array([6 * u * (1 - u), 1 - 4 * u + 3 * u**2, 3 * u**2 - 2 * u])


def curvatures(u):
    return np.array([6 - 12 * u, 6 * u - 4, 6 * u - 2])


def gauss(points):
    """Gauss-Legendre points and weights on 0..1."""
    x, weights = np.polynomial.legendre.leggauss(points)
    return zip(0.5 + 0.5 * x, 0.5 * weights, strict=True)


ELEMENT = 1  # whose length counts where there is but one


def strains(cable, q, element=ELEMENT):
    """Axial strains, bending strain vectors (1/m), and the factors of their squares in twice the energy."""
    q = q.reshape(3, -1)
    i = q[0] / np.sqrt(q[0] @ q[0])
    length = cable.element_length[element]
    axial, bending, axial_factor, bending_factor = [], [], [], []
    for u, weight in gauss(AXIAL_POINTS):
        r_x = slopes(u) @ q / length
        along = r_x @ i if cable.elastic_model == ELEMENT_FRAME else np.sqrt(r_x @ r_x)
        axial.append(along - 1.0)
        axial_factor.append(weight * length * cable.axial_stiffness)
    for u, weight in gauss(BENDING_POINTS):
        r_x, r_xx = slopes(u) @ q / length, curvatures(u) @ q / length**2
        if cable.elastic_model == ELEMENT_FRAME:
            bending.append(r_xx - (r_xx @ i) * i)
        else:
            # derivative along the cable of the unit tangent
            norm = np.sqrt(r_x @ r_x)
            bending.append(r_xx / norm - r_x * (r_x @ r_xx) / norm**3)
        bending_factor.append(weight * length * cable.bending_stiffness)
    return np.array(axial), np.array(bending), np.array(axial_factor), np.array(bending_factor)


def energy(cable, q, element=ELEMENT):
    axial, bending, axial_factor, bending_factor = strains(cable, q, element)
    return 0.5 * (axial_factor @ axial**2 + bending_factor @ (bending * bending).sum(axis=1))


def gradient(function, q):
    """Derivative of an analytic function by complex steps."""
    columns = [np.imag(function(q + 1e-30j * change)) / 1e-30 for change in np.eye(q.size)]
    return np.stack(columns, axis=-1)


def evaluate(cable, q, q_dot=None, rate_factor=0.0, stiffness_factor=1.0):
    """Force (3 dim,) and tangent (3 dim, 3 dim) of the kernel."""
    dim = len(cable.gravity)
    q_dot = np.zeros(3 * dim) if q_dot is None else q_dot
    arguments = [tuple(row.tolist()) for array in (q, q_dot) for row in np.reshape(array, (3, dim))]
    length = cable.element_length[ELEMENT]
    result = elastic_models.elastic_force(cable, length, *arguments, rate_factor, stiffness_factor)
    dd, da, db, aa, ab, bb = (np.array(block) for block in result[3:])

    def whole(upper):
        matrix = np.zeros((dim, dim))
        matrix[np.triu_indices(dim)] = upper
        return matrix + np.triu(matrix, 1).T

    da, db = da.reshape(dim, dim), db.reshape(dim, dim)
    tangent = np.block([[whole(dd), da, db], [da.T, whole(aa), whole(ab)], [db.T, whole(ab), whole(bb)]])
    return np.concatenate(result[:3]), tangent


def rotation(dim, angle, axis=(0.48, -0.6, 0.64)):
    if dim == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@MODELS
@DIMS
def test_force_is_the_gradient_of_the_energy(model, dim):
    """To 1e-12 of the largest entry."""
    cable = make_cable(dim, elastic_model=model)
    q = vectors(dim).ravel()
    exact = gradient(lambda x: energy(cable, x), q)
    np.testing.assert_allclose(evaluate(cable, q)[0], exact, rtol=0, atol=1e-12 * np.abs(exact).max())


@MODELS
@DIMS
def test_elastic_energy_is_that_of_the_strains(model, dim):
    """`elastic_energy` against its definition, and differences of it against the residual of the cable."""
    system = make_system(dim, cable={"elastic_model": model})
    cable = system.cable
    state, work = disturbed_state(system)
    state.nodes.velocity[:], state.nodes.acceleration[:] = 0.0, cable.gravity

    def total(e):
        moved = changed(state, nodes_position=from_nodal_vectors(e, dim))
        return sum(elastic_models.elastic_energy(cable, moved, element) for element in range(cable.element_count))

    written = sum(
        energy(
            cable, np.concatenate(elastic_models.chord_and_slopes(state.nodes.position, element, cable, state)), element
        )
        for element in range(cable.element_count)
    )
    assert total(nodal_vectors(state.nodes.position)) == pytest.approx(written, rel=1e-13)
    state.nodes.acceleration[:, 1:] = 0.0  # r_ddot = g, so that inertia and gravity cancel
    cable_element.add_cable(system, state, 0.0, 0.0, 0.0, work)
    force = difference(total, nodal_vectors(state.nodes.position).ravel(), 1e-4)
    np.testing.assert_allclose(-nodal_vectors(work.right_side).ravel(), force, rtol=0, atol=1e-8 * np.abs(force).max())


STRAIGHT = 0.73 * np.outer(np.ones(3), [0.6, 0.8, 0.0])


@pytest.mark.parametrize(
    ("model", "bending_stiffness", "straight"),
    [(ELEMENT_FRAME, 7.0, False), (CONTINUUM, 0.0, False), (CONTINUUM, 7.0, True)],
    ids=["element_frame", "continuum without bending", "continuum where it is straight"],
)
@DIMS
def test_tangent_is_exact(model, bending_stiffness, straight, dim):
    """Against fourth-order differences of the force, to 1e-9; the tension term is in it.

    In a straight element r_xx lies along r_x, and Gauss-Newton leaves nothing out that does not vanish with it.
    """
    cable = make_cable(dim, elastic_model=model, bending_stiffness=bending_stiffness)
    q = STRAIGHT[:, :dim].ravel() if straight else vectors(dim).ravel()
    exact = difference(lambda x: evaluate(cable, x)[0], q, 1e-3 * 0.7)
    np.testing.assert_allclose(evaluate(cable, q)[1], exact, rtol=0, atol=1e-9 * np.abs(exact).max())


@DIMS
def test_tangent_of_continuum_in_bending_is_gauss_newton_on_chi(dim):
    """EI c_i c_j P / (|rho|² l) at each Gauss point, with P the projector across rho and c = S_xx l²: to 1e-13."""
    cable = make_cable(dim, axial_stiffness=0.0)
    q = vectors(dim)
    exact = np.zeros((3 * dim, 3 * dim))
    for u, weight in gauss(BENDING_POINTS):
        rho = slopes(u) @ q
        across = np.eye(dim) - np.outer(rho, rho) / (rho @ rho)
        factor = weight * cable.bending_stiffness / (rho @ rho * cable.element_length[ELEMENT])
        exact += factor * np.kron(np.outer(curvatures(u), curvatures(u)), across)
    np.testing.assert_allclose(evaluate(cable, q)[1], exact, rtol=0, atol=1e-13 * np.abs(exact).max())


@MODELS
@DIMS
def test_tangent_of_damping(model, dim):
    """Coordinates and rates moved together, about rest, without bending: to 1e-9 of the difference."""
    cable = make_cable(dim, elastic_model=model, bending_stiffness=0.0, damping_time=0.02)
    q, rate_factor = vectors(dim).ravel(), 300.0
    exact = difference(lambda x: evaluate(cable, x, rate_factor * (x - q))[0], q, 1e-4)
    got = evaluate(cable, q, None, rate_factor)[1]
    np.testing.assert_allclose(got, exact, rtol=0, atol=1e-8 * np.abs(exact).max())


@DIMS
def test_tangent_of_damping_in_bending_of_continuum(dim):
    """The viscous part of the tangent is the elastic one times damping time and rate factor."""
    cable = make_cable(dim, axial_stiffness=0.0, damping_time=0.02)
    q = vectors(dim).ravel()
    elastic = evaluate(cable, q)[1]
    np.testing.assert_allclose(evaluate(cable, q, None, 300.0)[1], 7.0 * elastic, rtol=1e-13, atol=1e-12)


@MODELS
@DIMS
def test_no_tangent_when_accelerations_are_the_unknowns(model, dim):
    cable = make_cable(dim, elastic_model=model, damping_time=0.02)
    assert np.all(evaluate(cable, vectors(dim).ravel(), None, 0.0, 0.0)[1] == 0.0)


@MODELS
@DIMS
def test_force_turns_with_the_element(model, dim):
    """Objectivity: force of the turned element is the turned force, to 1e-13."""
    cable = make_cable(dim, elastic_model=model)
    q, turn = vectors(dim), rotation(dim, 1.1)
    exact = (evaluate(cable, q)[0].reshape(3, dim) @ turn.T).ravel()
    np.testing.assert_allclose(evaluate(cable, q @ turn.T)[0], exact, rtol=0, atol=1e-13 * np.abs(exact).max())


@MODELS
@DIMS
def test_no_force_after_a_rigid_motion(model, dim):
    """An unstrained straight element, turned: below 1e-12 of EA."""
    cable = make_cable(dim, elastic_model=model)
    straight = np.outer(np.full(3, cable.element_length[ELEMENT]), np.eye(dim)[0])
    for angle in (0.3, 2.0, 4.4):
        force = evaluate(cable, straight @ rotation(dim, angle).T)[0]
        assert np.abs(force).max() < 1e-12 * cable.axial_stiffness


@MODELS
@DIMS
def test_damping_takes_energy_and_never_gives(model, dim):
    """Power of the viscous force over 200 random motions; the smallest is zero or above."""
    cable = make_cable(dim, elastic_model=model, damping_time=0.02)
    rng = np.random.default_rng(2)
    for seed in range(200):
        q, q_dot = vectors(dim, seed).ravel(), rng.standard_normal(3 * dim)
        viscous = evaluate(cable, q, q_dot)[0] - evaluate(cable, q)[0]
        assert viscous @ q_dot >= 0.0


@MODELS
@DIMS
def test_viscous_power_is_that_of_the_strain_rates(model, dim):
    """Power = τ (EA ε_dot² + EI k_dot²), with the rates by differences of the strains along a motion: to 1e-8.

    The rate of the bending strain counts as seen from the tangent (continuum) or the chord (element frame), that is
    across it; that is what a turning of either in a plane with it leaves over.
    """
    cable = make_cable(dim, elastic_model=model, damping_time=0.02)
    q, q_dot = vectors(dim).ravel(), np.random.default_rng(4).standard_normal(3 * dim)
    viscous = evaluate(cable, q, q_dot)[0] - evaluate(cable, q)[0]
    axial_rate = gradient(lambda x: strains(cable, x)[0], q) @ q_dot
    bending_rate = gradient(lambda x: strains(cable, x)[1], q) @ q_dot
    _, _, axial_factor, bending_factor = strains(cable, q)
    power = axial_factor @ axial_rate**2
    for (u, _), rate, factor in zip(gauss(BENDING_POINTS), bending_rate, bending_factor, strict=True):
        axis = q[:dim] if model == ELEMENT_FRAME else slopes(u) @ q.reshape(3, dim)
        across = rate - axis * (axis @ rate) / (axis @ axis)
        power += factor * across @ across
    assert viscous @ q_dot == pytest.approx(cable.damping_time * power, rel=1e-12)


@MODELS
@DIMS
def test_damping_does_not_notice_a_rotation(model, dim):
    """A bent and stretched element that turns in its own plane, of any attitude: no viscous force, to 1e-12."""
    cable = make_cable(dim, elastic_model=model, damping_time=0.02)
    spin = 3.0 * np.array([[0.0, -1.0], [1.0, 0.0]])
    q = vectors(2)
    q_dot = q @ spin.T
    if dim == 3:
        attitude = rotation(3, 0.9)[:, :2]
        q, q_dot = q @ attitude.T, q_dot @ attitude.T
    rest = evaluate(cable, q)[0]
    np.testing.assert_allclose(evaluate(cable, q, q_dot)[0], rest, rtol=0, atol=1e-12 * np.abs(rest).max())


@DIMS
def test_shape_functions_are_the_cubics_of_hermite(dim):
    """Values and slopes at the nodes, derivatives by differences, and r of any cubic reproduced: to 1e-9."""
    length = 0.7
    rng = np.random.default_rng(6)
    cubic = rng.standard_normal((4, dim))

    def r(x):
        return np.array([1.0, x, x**2, x**3]) @ cubic

    nodal = np.stack([r(0.0), cubic[1], r(length), np.array([0, 1, 2 * length, 3 * length**2]) @ cubic])
    for x in (0.0, 0.13, 0.4, length, 0.9):
        np.testing.assert_allclose(np.array(shape_functions(x, length)) @ nodal, r(x), atol=1e-13)
        first = np.array([0, 1, 2 * x, 3 * x**2]) @ cubic
        np.testing.assert_allclose(np.array(shape_functions_x(x, length)) @ nodal, first, atol=1e-12)
        second = np.array([0, 0, 2, 6 * x]) @ cubic
        np.testing.assert_allclose(np.array(shape_functions_xx(x, length)) @ nodal, second, atol=1e-11)


def test_mass_matrix_is_the_integral_of_the_shape_functions():
    """Eq. 6 with its missing factor, by five Gauss points (exact to degree 9): to 1e-15."""
    integral = np.zeros((4, 4))
    for u, weight in gauss(5):
        s = np.array(shape_functions(u, 1.0))
        integral += weight * np.outer(s, s)
    np.testing.assert_allclose(np.array(MASS), integral, rtol=0, atol=1e-15)


@DIMS
def test_inertia_and_gravity_are_integrals_over_the_element(dim):
    """∫ρA Sᵀ(r_ddot - g)dx by five Gauss points: to 1e-13."""
    system = make_system(dim)
    cable = system.cable
    state, _ = disturbed_state(system)
    length = cable.element_length[1]
    accelerations = nodal_vectors(state.nodes.acceleration[1:3])
    exact = np.zeros((4, dim))
    for u, weight in gauss(5):
        s = np.array(shape_functions(u * length, length))
        exact += weight * length * cable.mass_per_length * np.outer(s, s @ accelerations - cable.gravity)
    got = np.array(cable_element.inertia(cable, length, 1.0, *(tuple(row) for row in accelerations)))
    got[[1, 3]] *= length  # the kernel gives the force on the slope times length
    np.testing.assert_allclose(got, exact, rtol=0, atol=1e-13 * np.abs(exact).max())


@MODELS
@DIMS
def test_mean_tension_is_the_mean_of_the_strain(model, dim):
    """EA times the mean of ε + τ ε_dot over the Gauss points: to 1e-12."""
    system = make_system(dim, cable={"elastic_model": model, "damping_time": 0.02})
    state, _ = disturbed_state(system)
    shape = elastic_models.chord_and_slopes(state.nodes.position, 1, system.cable, state)
    rates = elastic_models.chord_and_slopes(state.nodes.velocity, 1, system.cable, state)
    q, q_dot = np.concatenate(shape), np.concatenate(rates)
    axial = strains(system.cable, q)[0] + 0.02 * gradient(lambda x: strains(system.cable, x)[0], q) @ q_dot
    exact = system.cable.axial_stiffness * np.array([weight for _, weight in gauss(AXIAL_POINTS)]) @ axial
    length = system.cable.element_length[1]
    assert elastic_models.mean_tension(system.cable, length, *shape, *rates) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(
    ("model", "bending_stiffness"), [(CONTINUUM, 0.0), (ELEMENT_FRAME, 7.0)], ids=["continuum", "element_frame"]
)
@DIMS
def test_blocks_of_the_cable_are_the_derivative_of_its_residual(model, bending_stiffness, dim):
    """All three unknown levels at once, e = e_0 + k Δ, e_dot likewise with c, e_ddot with m: to 1e-8, no damping."""
    system = make_system(dim, cable={"elastic_model": model, "bending_stiffness": bending_stiffness})
    state, work = disturbed_state(system)
    mass_factor, rate_factor, stiffness_factor = 90.0, 5.0, 1.0

    def residual(delta):
        delta = from_nodal_vectors(delta, dim)
        moved = changed(
            state,
            nodes_position=state.nodes.position + stiffness_factor * delta,
            nodes_velocity=state.nodes.velocity + rate_factor * delta,
            nodes_acceleration=state.nodes.acceleration + mass_factor * delta,
        )
        cable_element.add_cable(system, moved, mass_factor, rate_factor, stiffness_factor, work)
        return -nodal_vectors(work.right_side).ravel()

    exact = difference(residual, np.zeros(nodal_vectors(state.nodes.position).size), 1e-4)
    residual(np.zeros(nodal_vectors(state.nodes.position).size))
    np.testing.assert_allclose(dense_blocks(work), exact, rtol=0, atol=1e-9 * np.abs(exact).max())
