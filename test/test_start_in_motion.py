"""Starts in motion: kept by the drive, with quiet first steps, and restored by a reset."""

import numpy as np
import pytest
from test_scenario_faults import faults_of

from cable_twin.frame.records import Command
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT
from verification.random_loads import drawn, run

TRAMWAY = {"cable.elements": 60}


@pytest.mark.parametrize(
    ("scenario", "overrides", "name", "speed"),
    [
        ("aerial_tramway", {"carriages.cabin.speed": 6.0, **TRAMWAY}, "cabin", 6.0),
        ("single_span", {"carriages.cabin.speed": -3.0, "carriages.cabin.arc_length": 300.0}, "cabin", -3.0),
        ("gondola", {"drives.haul_rope.speed": 5.0}, "haul_rope", 5.0),
    ],
)
def test_it_goes_on_with_the_speed_of_its_start(scenario, overrides, name, speed):
    simulation = Simulation(load_scenario(scenario, overrides))

    def state():
        snapshot = simulation.snapshot
        return snapshot.drives[name] if name in snapshot.drives else snapshot.carriages[name]

    assert state().speed == speed
    assert simulation.commands == {name: Command("speed", {name: speed})}
    first = simulation.snapshot
    moving = first.columns.attached == 1.0
    assert np.all(first.columns.speed[moving] == speed)
    along = np.linalg.norm(first.columns.body_velocity[:, [0, 2]], axis=1)
    bodies = np.repeat(moving, np.diff(first.layout.first_body))
    assert along[bodies] == pytest.approx(abs(speed), rel=0.01)  # the rope is stretched by less
    swings = []
    for step in range(1, 101):
        snapshot = simulation.advance_to(0.02 * step)
        swings.append(np.abs(snapshot.columns.body_angles[:, 1]).max())
        assert snapshot.solver.halvings == 0
    assert state().speed == pytest.approx(speed, abs=0.15)  # a haul rope gives way
    assert max(swings) < np.radians(6.0)
    simulation.command(name, speed=0.0)
    simulation.advance_to(3.0)
    simulation.reset()
    assert state().speed == speed
    assert simulation.commands == {name: Command("speed", {name: speed})}
    assert np.array_equal(simulation.snapshot.columns.joint_position, first.columns.joint_position)


@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("single_span", {"carriages.cabin.speed": 10.0, "carriages.cabin.arc_length": 303.0}),
        ("aerial_tramway", {"carriages.cabin.speed": 10.0, "carriages.cabin.arc_length": 600.0}),
        ("windy_tramway", {"carriages.cabin.speed": 10.0, "carriages.cabin.arc_length": 600.0, "air.wind": [0, 0, 0]}),
        ("gondola", {"drives.haul_rope.speed": 6.0}),
    ],
)
def test_the_first_force_is_none_of_a_bend_that_goes_along(scenario, overrides):
    """Contact force within 3 % of the weight, without M v² r_xx (19 %) of the bend under the vehicle."""
    simulation = Simulation(load_scenario(scenario, overrides))

    def forces():
        columns = simulation.snapshot.columns
        return np.linalg.norm(columns.contact_force + np.nan_to_num(columns.haul_pull), axis=1)[columns.attached == 1.0]

    first = forces()
    columns = simulation.snapshot.columns
    bare = [sum(body.mass for body in one.bodies.values()) for one in simulation.scenario.vehicles.values()]
    weights = 9.81 * (np.array(bare) + columns.payload)[columns.attached == 1.0]
    np.testing.assert_allclose(first, weights, rtol=0.03)
    simulation.advance_to(2.0 * simulation.step)
    np.testing.assert_allclose(forces(), first, rtol=0.03)


def test_a_carriage_without_a_drive_just_goes():
    """Given speed without a force to keep it."""
    overrides = {"carriages.cabin.drive": {"mode": "free"}, "carriages.cabin.speed": 4.0}
    simulation = Simulation(load_scenario("single_span", overrides))
    assert simulation.commands == {}
    assert simulation.snapshot.carriages["cabin"].speed == 4.0
    # the wave that it sets off in the rope holds it back: 3.8619 m/s with steps of 0.3 ms
    assert simulation.advance_to(0.005).carriages["cabin"].speed == pytest.approx(3.8619, abs=2e-3)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize("number", [74, 102])  # in a plane, in space
def test_a_vehicle_that_starts_in_motion_gains_no_energy(number):
    """No drive, no friction, no damping; with accelerations of the rest, 1e-4 of its kinetic energy at once."""
    found = run(drawn(number), "push", 2.0)
    assert found.passed, found


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_a_step_of_force_is_told_from_a_command_that_is_repeated():
    """The first one sets in within a step, the others change nothing."""
    once, repeated = (Simulation(load_scenario("single_span")) for _ in range(2))
    for simulation in (once, repeated):
        simulation.command("cabin", force=20e3)
        simulation.advance_to(0.1)
    repeated.command("cabin", force=20e3)
    np.testing.assert_array_equal(once.advance_to(0.2).numbers, repeated.advance_to(0.2).numbers)


@pytest.mark.parametrize(
    ("scenario", "overrides", "said"),
    [
        ("single_span", {"carriages.cabin.speed": 20.0}, "carriages.cabin.speed: given 20.0 m/s; allowed: -10 to 10 m"),
        (
            "single_span",
            {"carriages.cabin.speed": 2.0, "carriages.cabin.joint": "fixed"},
            "given 2.0 m/s; allowed: 0 m/s,",
        ),
        ("gondola", {"drives.haul_rope.speed": -7.0}, "drives.haul_rope.speed: given -7.0 m/s; allowed: -6 to 6 m/s"),
        ("single_span", {"carriages.cabin.speed": "fast"}, "cabin.speed: given 'fast'; allowed: a finite"),
    ],
)
def test_speeds_that_cannot_be_are_told_in_a_line(scenario, overrides, said):
    (fault,) = faults_of(scenario, overrides)
    assert said in fault
