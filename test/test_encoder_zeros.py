"""An encoder whose zero is elsewhere than that of the scenario: it is named as that, and load cells are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cable_twin.ensemble.estimate.detectors.biases import Biases
from cable_twin.ensemble.estimate.detectors.encoder_zeros import Displaced
from cable_twin.ensemble.estimate.detectors.sensor_faults import Doubts
from cable_twin.ensemble.estimate.detectors.windows import Row
from cable_twin.ensemble.estimate.kalman import Belief
from cable_twin.ensemble.estimate.tracker import FOLLOWING, Tracker
from cable_twin.frame.sensors import Sensors, standard_sensors
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed
AWAY = 10.0  # m
LONGEST = 30.0  # s


@pytest.fixture(scope="module")
def elsewhere():
    """Tracker of a plant that stands, whose encoder reads too much, once that is named, and the alarms until then."""
    bare = load_scenario("aerial_tramway", COARSE)
    scenario = load_scenario(bare.resolved(), {"sensors": standard_sensors(bare, Simulation(bare).snapshot)})
    plant = Simulation(load_scenario(scenario.resolved(), {"carriages.cabin.payload.mass": 2500.0}), samples=2)
    sensors, tracker, alarms = Sensors(plant.scenario, plant.layout), Tracker(scenario), []
    while not tracker.follower.zeros and plant.time < LONGEST:
        snapshot = plant.advance_to(round(plant.time + 0.1, 9))
        measured = [
            replace(one, values=(one.values[0] + AWAY,)) if one.sensor == "encoder_cabin" else one
            for one in sensors.take(snapshot)
        ]
        tracker.measure(measured, snapshot.time)
        for news in tracker.advance(snapshot.time):
            alarms += news.correction.alarms if news.correction else ()
    tracker.follower.close()
    return tracker, [alarm.reason for alarm in alarms]


def test_an_encoder_with_another_zero_is_named_and_no_sensor_is_left_out(elsewhere):
    tracker, reasons = elsewhere
    (said,) = [reason for reason in reasons if not reason.startswith("cabin/payload is ")]
    assert said.startswith("sensor encoder_cabin reads ")
    assert " m too much, standard deviation " in said
    size, deviation = (float(said.split()[row]) for row in (3, 9))
    assert size == pytest.approx(AWAY, abs=3.0 * deviation)
    assert deviation < 0.3 * AWAY
    assert not tracker.follower.left_out


def test_the_twin_is_where_its_plant_is_then(elsewhere):
    tracker, _ = elsewhere
    assert tracker.state == FOLLOWING
    read = tracker.follower.place_of("encoder_cabin")
    assert read == pytest.approx(12.0 + AWAY, abs=0.1)
    assert read - tracker.follower.zeros["cabin"] == pytest.approx(12.0, abs=3.0)


def test_an_error_that_others_explain_hardly_is_named_of_a_sensor_that_is_kept():
    """Both explain what the first sensor says; the other one explains it less well, and is no reason for no name."""
    named = []
    for kept in ((), ("zero",)):
        biases, belief = Biases({"cell": 5.0, "zero": 5.0}, 1, 0, kept), Belief(np.zeros(1), 1e-9 * np.eye(1))
        for _ in range(80):
            elsewhere = {"zero": np.array([1.0, 0.45])}
            biases.note(["cell", "other"], np.array([1.0, 0.45]), np.zeros((2, 1)), np.ones(2), belief, True, elsewhere)
        named.append(biases.surely()[0])
    assert named == ["", "zero"]


def test_a_load_cell_that_is_wrong_unless_another_one_is_is_told_once_and_not_left_out():
    biases, doubts = Biases({"cell": 5.0, "other": 5.0}, 1, 0), Doubts({})
    belief, elsewhere = Belief(np.zeros(1), 1e-9 * np.eye(1)), {"other": np.array([1.0, 0.45])}
    for _ in range(80):
        biases.note(["cell", "beside"], np.array([1.0, 0.45]), np.zeros((2, 1)), np.ones(2), belief, True, elsewhere)
    (told,) = [alarm.reason for time in (1.0, 2.0) for alarm in biases.judge(time, belief, doubts)[1]]
    assert told.startswith("sensor other seems to be wrong by 1 N: ")
    assert not doubts.left_out


def test_waves_of_a_displaced_carriage_are_no_effects_of_its_place():
    """A force that grows by 3 kN/m, beside waves of 500 N that the member that is elsewhere alone has."""
    scenario = load_scenario("aerial_tramway", COARSE)
    sensors = standard_sensors(scenario, (start := Simulation(scenario)).snapshot)
    displaced = Displaced(load_scenario(scenario.resolved(), {"sensors": sensors}), 1, start.layout)
    place = int(start.layout.places.arc_length[0])
    numbers = np.zeros((2, place + 1))
    numbers[1, place] = 0.1
    waves = 500.0 * np.sin(0.2 * np.pi * np.arange(20))
    rows = [Row("force_cabin", 0.0, np.array([0.0, 300.0 + wave]), 1.0, numbers) for wave in waves]
    np.testing.assert_allclose(displaced.effects(rows)["encoder_cabin"], -3000.0, rtol=1e-9)
