import numpy as np
import pytest

from cable_twin.mechanics.language.declared import arrays_of, clone
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope
from cable_twin.mechanics.solution.generalized_alpha import advance
from cable_twin.mechanics.solution.newton import largest_increment
from cable_twin.mechanics.solution.prediction import coefficients, correct, predict
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.mechanics.state import Motion, allocate_workspace
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT
from verification.models import beam, start_moving

ELEMENTS = 24 if JIT else 4


def seed(**overrides):
    overrides = {"cable.elements": ELEMENTS, **overrides}
    return Simulation(load_scenario("seed_example", overrides))


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.7, 0.9, 1.0])
def test_coefficients_are_of_second_order_and_unconditionally_stable(radius):
    c = coefficients(radius)
    assert c.gamma == pytest.approx(0.5 - c.alpha_m + c.alpha_f)
    assert c.alpha_m <= c.alpha_f <= 0.5
    assert c.beta >= 0.25 + 0.5 * (c.alpha_f - c.alpha_m) - 1e-15
    # what is left of an infinite frequency in a step
    assert c.alpha_f / (1.0 - c.alpha_f) == pytest.approx(radius)


@pytest.mark.parametrize("radius", [0.5, 0.7, 1.0])
def test_predictor_and_corrector_keep_the_updates_of_newmark(radius):
    c, h = coefficients(radius), 0.02
    generator = np.random.default_rng(3)
    x, v, q_ddot, a = generator.standard_normal((4, 5))
    x_0, v_0, q_ddot_0, a_0 = x.copy(), v.copy(), q_ddot.copy(), a.copy()
    motion = Motion(x, v, q_ddot, a)
    predict(c, h, motion)
    for _ in range(2):
        correct(c, h, generator.standard_normal(5), motion)
    np.testing.assert_allclose(x, x_0 + h * v_0 + h * h * ((0.5 - c.beta) * a_0 + c.beta * a), atol=1e-12)
    np.testing.assert_allclose(v, v_0 + h * ((1.0 - c.gamma) * a_0 + c.gamma * a), atol=1e-12)
    mean = (1.0 - c.alpha_f) * q_ddot + c.alpha_f * q_ddot_0
    np.testing.assert_allclose((1.0 - c.alpha_m) * a + c.alpha_m * a_0, mean, rtol=1e-9)


def test_free_fall_is_exact_with_the_accelerations_of_the_start():
    simulation = beam(
        length=2.0, mass_per_length=1.0, axial=1e4, bending=1.0, elements=3, supports=("free", "free"), step=0.01
    )
    start_moving(simulation)
    simulation.advance_to(0.5)
    fall = simulation.state.nodes.position[:, 0, 1]
    np.testing.assert_allclose(fall, -0.5 * 9.81 * 0.25, rtol=1e-10)


def test_joints_stay_closed_and_energy_is_not_gained():
    simulation = seed()
    start = simulation.energy().total
    for frame in range(1, 6):
        snapshot = simulation.advance_to(0.02 * frame)
        assert snapshot.solver.constraint_residual < 1e-9
        assert simulation.energy().total <= start + 1e-9
    assert simulation.energy().kinetic > 1.0


def test_a_step_that_fails_is_taken_in_halves():
    whole = seed()
    halved = seed(**{"solver.max_iterations": 3, "solver.step": 0.02, "solver.tolerance": 1e-8})
    snapshot = halved.advance_to(0.2)
    assert snapshot.solver.halvings > 0
    assert snapshot.solver.steps == 10
    want = whole.advance_to(0.2).carriages["carriage"].position
    np.testing.assert_allclose(snapshot.carriages["carriage"].position, want, atol=0.03)


def test_a_step_that_cannot_be_taken_leaves_the_last_good_state():
    simulation = seed(**{"solver.max_iterations": 1, "solver.max_halvings": 1, "solver.tolerance": 1e-9})
    state = simulation.capture().state
    before = clone(state)
    alone = Assembly([Rope(simulation.system, state, allocate_workspace(simulation.system))])
    outcome = Outcome(*advance(*alone.arguments, 5))
    assert not outcome.converged
    assert outcome.steps == 0
    assert outcome.halvings == 2
    assert outcome.increment > 1e-9
    assert 0 <= outcome.element < ELEMENTS
    for array, kept in zip(arrays_of(state).values(), arrays_of(before).values(), strict=True):
        np.testing.assert_array_equal(array, kept)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_increment_that_is_no_number_is_seen_wherever_it_is(bad):
    simulation = seed()
    work = allocate_workspace(simulation.system)
    increments = work.right_side[:, :2], work.body_increment, work.sliding_increment  # no node follows a load
    for array in increments:
        for other in increments:
            other[:] = 0.0
        array[(-1,) * array.ndim] = bad
        assert not np.isfinite(largest_increment(simulation.system, simulation.capture().state, work, 1.0))
