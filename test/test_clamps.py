"""Carriages sliding on one rope and clamped to another: forces, faults, files, and opening clamps."""

import numpy as np
import pytest
from test_scenario_faults import faults_of

from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.parameters import DriveLimits
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.solution.newton import solve_increments
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.ropes import MASS, clamp_place, clamped, slope_of


def pulled(speed=4.0, **changes):
    """Carriage clamped to a moving haul rope, accelerated to `speed` (m/s)."""
    simulation = Simulation(load_scenario(clamped(places=(100.0,), elements=16, **changes)))
    let_haul(simulation, speed)
    return simulation


def let_haul(simulation, speed):
    part = simulation.parts["haul"]
    limits = DriveLimits(*np.full((7, 1), 1.0))
    moving = part.system.moving_cable._replace(moving=True, loop_length=1e4, limits=limits)
    part.system = part.system._replace(moving_cable=moving)
    part.state.rope_drive.target[0] = speed


def test_clamp_takes_its_carriage_along_and_says_how_hard():
    simulation = pulled()
    figures = KeyFigures(simulation.scenario)
    highest = 0.0
    for time in np.arange(0.1, 6.05, 0.1):
        snapshot = simulation.advance_to(float(time))
        figures.update(snapshot)
        cabin = snapshot.carriages["cabin_1"]
        slope = slope_of(simulation, "track", cabin.arc_length)
        along = float(cabin.clamp_force @ slope / np.linalg.norm(slope))
        assert cabin.drive_force == pytest.approx(along, rel=1e-6)
        highest = max(highest, abs(along))
        assert snapshot.solver.constraint_residual < 1e-9
        assert snapshot.solver.halvings == 0
    there = clamp_place(simulation) + float(simulation.parts["haul"].state.rope.position[0])
    assert there > clamp_place(simulation) + 12.0
    np.testing.assert_allclose(simulation.cable_positions([there], rope="haul")[0], cabin.position, rtol=0, atol=1e-9)
    assert cabin.speed == pytest.approx(4.0, abs=0.5)
    assert highest > 1.1 * MASS * 9.81 * np.sin(np.arctan2(slope[2], slope[0]))  # it starts upwards
    assert not [one for one in figures.figures() if one.name.startswith("cabin_1: drive")]  # which it does not have
    (figure,) = (one for one in figures.figures() if "pull of its clamp" in one.name)
    assert figure.name == "cabin_1: pull of its clamp along the track, highest"
    assert figure.value == pytest.approx(highest, rel=1e-9)


def test_clamp_that_leaves_its_rope_lets_go_and_another_rope_takes_it():
    """Place on the second rope beyond its start until enough rope has passed."""
    data = clamped(places=(100.0,), elements=16)
    lengths = {name: rope["unstrained_length"] for name, rope in data["ropes"].items()}
    data["ropes"]["second"] = data["ropes"]["haul"]
    at = data["carriages"]["cabin_1"]["clamped_to"]["haul"]
    data["carriages"]["cabin_1"]["clamped_to"]["second"] = at - lengths["haul"] - 0.05
    simulation = Simulation(load_scenario(data))
    first, second = (simulation.parts[name].state for name in ("haul", "second"))
    assert simulation.snapshot.carriages["cabin_1"].clamp_force[0] > 1000.0
    first.rope.position[:] = lengths["haul"]  # both by hand: gone by at once
    snapshot = simulation.advance_to(0.02)
    np.testing.assert_array_equal(snapshot.carriages["cabin_1"].clamp_force, 0.0)
    assert snapshot.carriages["cabin_1"].speed < 0.0  # down the slope
    second.rope.position[:] = lengths["haul"] + 0.05
    apart = []
    for time in (0.021, 4.0):
        snapshot = simulation.advance_to(time)
        there = simulation.cable_positions([at], rope="second")[0]
        apart.append(float(np.linalg.norm(there - snapshot.carriages["cabin_1"].position)))
    assert 0.1 < apart[0] < 10.0  # it hangs elsewhere, without a load
    assert apart[1] < 1e-3 * apart[0]
    assert np.isfinite(snapshot.numbers[: snapshot.columns.arc_length.size]).all()


def test_supports_of_both_ropes_hold_all_weight_wherever_the_clamp_is():
    """Also on the end element of the haul rope, with a part of the pull on its support."""
    for place in (8.0, 100.0):
        simulation = Simulation(load_scenario(clamped(places=(place,), elements=16)))
        weight = MASS + sum(
            rope.mass_per_length * rope.unstrained_length for rope in simulation.scenario.ropes.values()
        )
        held = sum(support.force for support in simulation.snapshot.supports.values())
        np.testing.assert_allclose(held, [0.0, 0.0, 9.81 * weight], rtol=0, atol=1e-3)


def test_tangent_of_a_clamp_is_whole():
    """Quadratic convergence of Newton steps of ropes, bodies, arc length and forces."""
    data = clamped(places=(100.0, 200.0), elements=8)
    for carriage in data["carriages"].values():
        carriage["clamp_offset"] = [0.1, -0.4]
        carriage["bodies"]["cabin"] = carriage["bodies"]["cabin"] | {"stiffness": 5e4}
    simulation = Simulation(load_scenario(data))
    start, engine = simulation.capture(), simulation._engine
    first, work = engine.parts[0], engine._works[0]
    left = []
    for size in (4e-3, 2e-3, 1e-3):
        increments = []
        simulation.restore(start)
        random = np.random.default_rng(4)
        for part in engine.parts:
            nodes = part.state.nodes.position[1:-1]
            change = random.normal(size=(len(nodes), 2, nodes.shape[2]))[:, [0, 1, 1]]  # of both slopes alike
            nodes += size * change * np.array([[1.0], [0.1], [0.1]])
        first.state.joints.position[:] += size * random.normal(size=2)
        for _ in range(3):
            solved, largest, _ = solve_increments(
                engine.bundle, engine.moving, engine._ropes.scratch, first.system, first.state, work, 0.0, 0.0, 1.0
            )
            assert solved
            increments.append(largest)
            for part, scratch in zip(engine.parts, engine._works, strict=True):
                part.state.nodes.position[:] += scratch.right_side
                part.state.joints.position[:] += scratch.sliding_increment
                part.state.bodies.position[:] += scratch.body_increment
        left.append(increments[1])
        assert increments[2] < 3e-4 * increments[1]
    np.testing.assert_allclose(np.array(left[:-1]) / np.array(left[1:]), 4.0, rtol=0.1)


def test_state_goes_through_a_file_to_the_last_bit(tmp_path):
    simulation = pulled()
    simulation.advance_to(0.5)
    simulation.save(tmp_path / "state.npz")
    again = Simulation.load(tmp_path / "state.npz")
    let_haul(again, 4.0)
    np.testing.assert_array_equal(simulation.advance_to(1.0).numbers, again.advance_to(1.0).numbers)
    start = simulation.capture().starts[0]
    simulation.reset()
    np.testing.assert_array_equal(simulation.parts["track"].state.clamp_force, start.clamp_force)


def changed(**changes):
    """Scenario of two carriages with changed keys of the first."""
    data = clamped(places=(100.0, 200.0))
    data["carriages"]["cabin_1"] |= changes
    return data


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"clamped_to": {"rail": 1.0}}, "clamped_to.rail: given the rope 'rail'; allowed: track, haul"),
        ({"clamped_to": {"track": 1.0}}, "carriages.cabin_1.clamped_to.track: given 'track': the carriage slides on"),
        ({"clamped_to": {"haul": -1.0}}, "carriages.cabin_1.clamped_to: given -1 m: on no ropes"),
        ({"clamped_to": {"haul": "x"}}, "carriages.cabin_1.clamped_to.haul: given 'x'"),
        ({"joint": "fixed"}, "carriages.cabin_1.clamped_to: given a mapping: a joint or drive holds the carriage"),
        ({"drive": {"mode": "speed"}}, "carriages.cabin_1.clamped_to: given a mapping: a joint or drive holds"),
        ({"clamped_to": {}, "clamp_offset": [0.0, 0.3]}, "carriages.cabin_1.clamp_offset: given [0.0, 0.3] m: without"),
    ],
)
def test_clamps_are_checked(changes, said):
    (fault,) = faults_of(changed(**changes))
    assert "carriages.cabin_1.c" in fault
    assert said in fault


def test_two_clamps_at_one_place_are_a_fault():
    data = clamped(places=(100.0, 200.0))
    data["carriages"]["cabin_2"]["clamped_to"] = data["carriages"]["cabin_1"]["clamped_to"]
    (fault,) = faults_of(data)
    assert "carriages.cabin_2.clamped_to.haul: given" in fault
    assert "'cabin_1' is clamped there; allowed: another place, in m" in fault


def test_clamp_beside_one_cable_is_a_fault():
    data = clamped()
    data["cable"] = data.pop("ropes")["track"]
    assert any(
        "clamped_to: given a mapping: with one cable; allowed: only with several `ropes`" in fault
        for fault in faults_of(data)
    )


def test_clamp_far_from_its_carriage_is_told_with_the_distance():
    data = changed(clamped_to={"haul": 180.0})
    with pytest.raises(
        EquilibriumError, match=r"^carriages.cabin_1.clamped_to: given 180 m on 'haul', which at rest is 8"
    ):
        Simulation(load_scenario(data))
