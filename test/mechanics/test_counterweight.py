"""Counterweight at an end of the cable: force, inertia and buffers against their definition."""

import numpy as np
import pytest
from systems import dense_blocks, difference, disturbed_state, from_nodal_vectors, make_system, nodal_vectors

from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.on_rope.counterweight import add_counterweights, counterweight_energies, limit_force

DIRECTION = np.array([0.6, 0.8])


def weighted(travel=(-0.4, 0.3)):
    """Cable in general position with a counterweight of 7 kg and 50 N at its end."""
    system = make_system(
        cable={"end_position": np.array([[0.0, 0.0], [2.2, 0.4]])},
        counterweights={
            "direction": np.stack([np.full(2, np.nan), DIRECTION]),
            "mass": np.array([0.0, 7.0]),
            "force": np.array([0.0, 50.0]),
            "travel": np.array([[-np.inf, np.inf], travel]),
            "stiffness": np.array([1.0, 900.0]),
            "damping": np.array([0.0, 0.3]),
        },
    )
    state, work = disturbed_state(system)
    return system, state, work


def right_side(system, state, work, factors=(0.0, 0.0, 0.0)):
    for array in (work.right_side, work.diagonal, work.upper, work.lower):
        array[:] = 0.0
    add_counterweights(system.counterweights, system.cable, state, *factors, work)
    return nodal_vectors(work.right_side)


def test_it_pulls_with_its_force_less_its_inertia_along_its_line():
    system, state, work = weighted((-10.0, 10.0))
    got = right_side(system, state, work).reshape(-1, 2, 2)
    pull = 50.0 - 7.0 * DIRECTION @ state.nodes.acceleration[-1, 0]
    np.testing.assert_allclose(got[-1, 0], pull * DIRECTION)
    assert not got[:-1].any()
    assert not got[-1, 1].any()


@pytest.mark.parametrize("limits", [(0.5, 1.0), (-1.0, -0.6), (-1.0, 1.0)], ids=["low", "high", "free"])
def test_tangent_is_the_derivative_of_the_force(limits):
    system, state, work = weighted(limits)
    mass_factor, rate_factor = 40.0, 3.0

    def moved(change):
        after = clone(state)
        after.nodes.position[:] += from_nodal_vectors(change, 2)
        after.nodes.velocity[:] += rate_factor * from_nodal_vectors(change, 2)
        after.nodes.acceleration[:] += mass_factor * from_nodal_vectors(change, 2)
        return right_side(system, after, work).ravel()

    exact = -difference(moved, np.zeros(nodal_vectors(state.nodes.position).size), 1e-4)
    right_side(system, state, work, (mass_factor, rate_factor, 1.0))
    np.testing.assert_allclose(dense_blocks(work), exact, rtol=0, atol=1e-8 * np.abs(exact).max())


def test_buffers_push_back_into_the_travel_and_never_pull():
    system, _, _ = weighted()
    weights = system.counterweights
    assert limit_force(weights, 1, -0.5, 0.0)[0] == pytest.approx(900.0 * 0.1)
    assert limit_force(weights, 1, 0.5, 0.0)[0] == pytest.approx(-900.0 * 0.2)
    assert limit_force(weights, 1, -0.5, -1.0)[0] == pytest.approx(900.0 * 0.1 * 1.3)
    assert limit_force(weights, 1, 0.5, 1.0)[0] == pytest.approx(-900.0 * 0.2 * 1.3)
    for travel, speed in ((0.0, 5.0), (-0.5, 4.0), (0.5, -4.0), (np.nan, 0.0)):
        assert limit_force(weights, 1, travel, speed) == (0.0, 0.0, 0.0)
    assert limit_force(weights, 0, 1e6, 1e6) == (0.0, 0.0, 0.0)


def test_energies_are_those_of_mass_force_and_buffer():
    system, state, _ = weighted()
    travel = (state.nodes.position[-1, 0] - [2.2, 0.4]) @ DIRECTION
    state.nodes.position[-1, 0] += (0.5 - travel) * DIRECTION
    speed = state.nodes.velocity[-1, 0] @ DIRECTION
    got = counterweight_energies(system.counterweights, system.cable, state, 1)
    np.testing.assert_allclose(got, [3.5 * speed**2, 450.0 * 0.2**2, -50.0 * 0.5])
    assert counterweight_energies(system.counterweights, system.cable, state, 0) == (0.0, 0.0, 0.0)
