"""A cabin in a station that people leave: its payload is found anew, and no sensor is left out for it."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.ensemble.estimate.boarding import Boarding
from cable_twin.ensemble.estimate.detectors.biases import Biases
from cable_twin.ensemble.estimate.follower import Follower
from cable_twin.ensemble.estimate.kalman import Belief, reset
from cable_twin.frame.records import AppliedCommand, Command
from cable_twin.frame.sensors import Sensors, standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed
BEFORE, AFTER = 3000.0, 1000.0  # kg
BEGINS, ENDS = 8.0, 20.5  # s, of a change with 160 kg/s
FOUND = ENDS + 20.0  # s


@pytest.fixture(scope="module")
def reload():
    """Follower of a plant in its upper station whose cabin people leave, and its corrections."""
    bare = load_scenario("aerial_tramway", COARSE | {"carriages.cabin.arc_length": 1027.0})
    usual = standard_sensors(bare, Simulation(bare).snapshot)
    scenario = load_scenario(bare.resolved(), {"sensors": usual})
    plant = Simulation(load_scenario(scenario.resolved(), {"carriages.cabin.payload.mass": BEFORE}), samples=2)
    sensors, follower, corrections = Sensors(plant.scenario, plant.layout), Follower(scenario, threads=1), []
    leave = Command("payload", {"cabin": AFTER})
    for frame in range(round(FOUND / 0.1) + 1):
        snapshot = plant.advance_to(round(0.1 * frame, 9))
        if frame == round(BEGINS / 0.1):
            plant.apply(leave)
            follower.command(AppliedCommand(BEGINS, leave, "test"))  # as it is in the bag of a plant
        measured = sensors.take(snapshot)
        if (correction := follower.take(snapshot.time, measured) if measured else None) is not None:
            at_end, carried = np.linalg.norm(snapshot.columns.support_force[1]), snapshot.columns.payload[0]
            corrections.append((correction, float(at_end), float(carried)))
    follower.close()
    return follower, corrections


def test_a_reload_leaves_no_sensor_out(reload):
    follower, corrections = reload
    assert not follower.left_out
    reasons = [alarm.reason for one, *_ in corrections for alarm in one.alarms]
    assert all(reason.startswith("cabin/payload is ") for reason in reasons)


def test_the_payload_after_a_reload_is_within_its_band(reload):
    found = reload[1][-1][0].slow["cabin/payload"]
    assert abs(found.value - AFTER) < 3.0 * found.deviation < 400.0


def test_the_payload_is_within_three_deviations_all_the_time(reload):
    loading = [(one, true) for one, _, true in reload[1] if one.time > BEGINS + 2.0]
    assert loading
    for one, true in loading:
        found = one.slow["cabin/payload"]
        assert abs(found.value - true) < 3.0 * found.deviation, one.time


def test_the_force_at_the_end_of_the_rope_is_found_after_a_reload(reload):
    """The tower holds by friction what the payload did to the rope, 11 kN: no rest of the twin would have it."""
    correction, true, _ = reload[1][-1]
    assert abs(correction.hidden["end/force"].value - true) < 3e3


def test_what_else_was_known_is_kept(reload):
    corrections = [one for one, *_ in reload[1]]
    before = [one for one in corrections if one.time < BEGINS][-1].slow
    for name in ("cabin/rolling", "ice", "start/counterweight"):
        assert abs(corrections[-1].slow[name].value - before[name].value) < 3.0 * before[name].deviation, name


def test_a_quantity_that_is_reset_is_apart_from_all_others():
    belief = reset(Belief(np.ones(3), np.full((3, 3), 0.5) + np.eye(3)), [1], 4.0, 2.0)
    np.testing.assert_array_equal(belief.mean, [1.0, 4.0, 1.0])
    np.testing.assert_array_equal(belief.covariance, [[1.5, 0.0, 0.5], [0.0, 4.0, 0.0], [0.5, 0.0, 1.5]])


def test_members_are_loaded_alike_near_the_capacity():
    """Above the estimate there is no room for 92 kg: with less for one member, slopes would be those of its loading."""
    boarding, points = Boarding(np.full(1, 1920.0), 0, {0: 0}), np.array([[6308.0], [6366.0], [6250.0]])
    boarding.changing, boarding._rows = True, [0]
    wanted = np.array([[6400.0], [6400.0], [6200.0]])
    blended, given = boarding.apart(points, wanted, np.zeros(1), np.full(1, 6400.0))
    np.testing.assert_array_equal(blended, points)
    np.testing.assert_allclose(given - points, 34.0)


def test_a_wind_that_is_found_while_a_plant_stands_is_no_boarding():
    """Of two windows with one payload the first did not know the wind yet, -13 m/s, which adds as much as -650 kg."""
    boarding, rows = Boarding(np.array([1800.0, 5.0]), 0, {0: 0}), [0]
    for wind in (0.0, -13.0):
        belief = Belief(np.array([3000.0, wind]), np.diag([1800.0, 5.0 + wind / 3.0]) ** 2)
        terms = np.full(20, 50.0 * (-13.0 - wind)), np.tile([1.0, 50.0], (20, 1)), np.full(20, 30.0**2)
        assert not boarding.look(rows, terms, belief, Biases({}, 2), False)
    terms = np.full(20, 400.0), *terms[1:]  # kg that board
    assert boarding.look(rows, terms, belief, Biases({}, 2), False)
