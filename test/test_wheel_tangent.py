"""Tangent of bullwheels and what is clamped to their ropes, against the equations of motion themselves.

A wheel moved by a little, with the rates that the integrator gives it, is to be moved back by one solution of the
linear equations, and nothing else with it: so all derivatives by its coordinate are right, of ropes, vehicles, towers
and clamps, and of the wheel's own equations.
"""

import dataclasses

import numpy as np
import pytest

from cable_twin.mechanics.parameters import FREE
from cable_twin.mechanics.solution.bundle.bullwheels import NOTHING, ROPE, WHEEL, correct_bullwheels, propagate_wheels
from cable_twin.mechanics.solution.bundle.clamp import follow_clamps
from cable_twin.mechanics.solution.bundle.records import SERVES
from cable_twin.mechanics.solution.bundle.wheel_tangent import LAGGING
from cable_twin.mechanics.solution.newton import solve_increments
from cable_twin.mechanics.solution.prediction import coefficients, correct_rope, factors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

STEP = 0.01  # s, of the shipped scenarios used here
SIZE = 1e-6  # m, of a disturbance
EXACT, LEFT = 1e-3, 1e-2  # of it: what a wheel may keep, and what may move beside it
MOST = 0.75  # of all nodes, which that holds for: where sheaves begin to touch, or cease to, is no derivative


class Solver:
    """Newton's method of a simulation by hand, at the end of its last step."""

    def __init__(self, simulation):
        self.engine, self.c = simulation._engine, coefficients(0.7)
        self.first, self.sheaves = self.engine.parts[0], self.engine.bundle.sheaves
        self.factors = factors(self.c, STEP)

    @property
    def increments(self):
        """Increments (2 wheels,) in m, of rope over each wheel and of its carriage."""
        return self.engine._ropes.scratch.wheel_increment

    def solve(self, *, anew=True):
        """Solve once, with the response found `anew`; returns the increments (nodes,) in m of all ropes."""
        engine, first = self.engine, self.first
        if anew:
            engine.moving.response.left[:] = 0
        solved, _, _ = solve_increments(
            engine.bundle,
            engine.moving,
            engine._ropes.scratch,
            first.system,
            first.state,
            engine._works[0],
            *self.factors,
            1.0,
        )
        assert solved
        return np.concatenate([np.abs(work.right_side[:, 0]).max(axis=1) for work in engine._works])

    def move_wheels(self, increments):
        """Move wheels, ropes over them and what is clamped to those by increments (2 wheels,) in m."""
        engine, first = self.engine, self.first
        correct_bullwheels(self.sheaves, engine.moving.sheaves, increments, self.c, STEP)
        propagate_wheels(engine.bundle, engine.moving.sheaves, first.system, first.state)
        follow_clamps(engine.bundle, engine.moving, first.system, first.state)

    def converge(self):
        """Apply increments until nothing moves."""
        for _ in range(6):
            self.solve()
            for part, work in zip(self.engine.parts, self.engine._works, strict=True):
                correct_rope(self.c, STEP, part.system, part.state, work)
            self.move_wheels(self.increments.copy())


def under_way(name, *, joint, turned=(), slipping=0, **changes):
    """Simulation of a shipped scenario under way, of which some wheels are turned by their forces, or slip."""
    scenario = load_scenario(name)
    joints = {f"ropes.{rope}.joint": joint for rope in scenario.ropes}
    simulation = Simulation(load_scenario(name, joints | changes))
    simulation.advance_to(1.3)
    motion = simulation._engine.moving.sheaves
    for wheel in turned:
        motion.drives.mode[wheel], motion.by_forces[wheel] = FREE, WHEEL
    if slipping:
        motion.slipping[1], motion.by_forces[1] = slipping, ROPE
    return simulation


def check(simulation):
    """Disturb each coordinate of each wheel by itself, and see it go back alone."""
    solver = Solver(simulation)
    motion, sheaves = simulation._engine.moving.sheaves, simulation._engine.bundle.sheaves
    solver.converge()
    start, tried = simulation.capture(), 0
    for coordinate in range(2 * sheaves.inertia.size):
        wheel, kind = divmod(coordinate, 2)
        if motion.by_forces[wheel] == NOTHING if kind == 0 else sheaves.tensioning[wheel] != 1:
            continue
        tried += 1
        for size in (SIZE, -SIZE):
            simulation.restore(start)
            moved = np.zeros(2 * sheaves.inertia.size)
            moved[coordinate] = size
            solver.move_wheels(moved)
            beside = np.quantile(solver.solve(), MOST)
            np.testing.assert_allclose(solver.increments, -moved, rtol=0, atol=EXACT * SIZE)
            assert beside < LEFT * SIZE, (coordinate, beside / SIZE)
    return tried


@pytest.mark.parametrize("joint", ["paper", "node"])
@pytest.mark.parametrize(
    ("changes", "coordinates"),
    [({}, 2), ({"turned": (0,)}, 3), ({"slipping": 1}, 2), ({"slipping": -1}, 2)],
    ids=["drive", "free", "slips ahead", "slips behind"],
)
def test_wheels_of_a_chairlift_go_back_alone(changes, coordinates, joint):
    assert check(under_way("chairlift", joint=joint, **changes, **{"drives.haul_rope.speed": 2.5})) == coordinates


@pytest.mark.long
@pytest.mark.parametrize("joint", ["paper", "node"])
def test_wheels_of_a_jig_back_in_space_go_back_alone(joint):
    assert check(under_way("jig_back", joint=joint, **{"drives.haul_rope.speed": 2.0})) == 2


@pytest.fixture
def chairlift_pair():
    """Two simulations of a chairlift under way, at equal states."""
    pair = [Simulation(load_scenario("chairlift", {"drives.haul_rope.speed": 2.5})) for _ in range(2)]
    for one in pair:
        one.advance_to(1.3)
    return pair


def test_a_kept_response_leaves_less_than_it_is_said_to(chairlift_pair):
    """One step from equal states: with the response that was kept, and with one that is found in it."""
    kept, anew = chairlift_pair
    lagged = 0
    for step in range(60):
        if step == 20:
            for one in (kept, anew):
                one.emergency_stop()
        anew.restore(dataclasses.replace(kept.capture(), scenario=anew.scenario))
        anew._engine.moving.response.left[:] = 0  # so that the next iteration finds it
        iterations = [one.advance_to(one.time + STEP).solver.iterations for one in (kept, anew)]
        if kept._engine.moving.response.left[0, 0] == SERVES or iterations != [1, 1]:
            continue
        lagged += 1
        moved = np.abs(kept._engine._ropes.scratch.wheel_increment).max()
        for name, part in kept.parts.items():
            apart = part.state.nodes.position[:, 0] - anew.parts[name].state.nodes.position[:, 0]
            assert np.abs(apart).max() <= LAGGING * moved
    assert lagged > 40


def test_a_response_is_found_anew_where_a_rope_begins_to_slip_or_a_body_gets_heavier(chairlift_pair):
    simulation, _ = chairlift_pair
    solver, moving = Solver(simulation), simulation._engine.moving
    solver.solve()
    solver.solve(anew=False)
    assert moving.response.left[0, 0] == SERVES - 1
    moving.sheaves.slipping[1] = 1
    solver.solve(anew=False)
    assert moving.response.left[0, 0] == SERVES
    solver.solve(anew=False)
    solver.first.system.carriages.mass[0] += 1.0
    solver.solve(anew=False)
    assert moving.response.left[0, 0] == SERVES


def test_a_restored_simulation_goes_on_with_the_response_that_it_had(chairlift_pair):
    one, other = chairlift_pair
    one.advance_to(one.time + 13 * STEP)  # between two times that the response is found
    assert 0 < one._engine.moving.response.left[0, 0] < SERVES
    other.restore(dataclasses.replace(one.capture(), scenario=other.scenario))
    for simulation in (one, other):
        simulation.advance_to(simulation.time + 1.0)
    assert np.array_equal(one.snapshot.numbers, other.snapshot.numbers, equal_nan=True)
