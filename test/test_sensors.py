"""Sensors: statistics of logged measurements, equal bits from a seed, faults in a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from cable_twin.frame.sensors import Sensors
from cable_twin.messages.sensor_messages import SensorOutput, measurements_from_message, sensor_topic, sensor_topics
from cable_twin.messages.topics import FrameNames
from cable_twin.offline.simulate import main
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.simulation import Simulation

SENSORS = {
    "place": {"kind": "encoder", "of": "cabin", "quantum": 0.01, "delay": 0.03, "rate": 50.0},
    "anchor": {"kind": "load_cell", "of": "start", "noise": 800.0, "bias": 2000.0, "rate": 100.0, "seed": 4},
    "tilt": {"kind": "inclinometer", "of": "cabin/hanger", "noise": 0.002, "rate": 20.0},
    "box": {"kind": "imu", "of": "cabin", "noise": 0.05, "rate_noise": 0.01, "rate_bias": 0.1, "rate": 100.0},
}
TOPICS = {
    "place": "/cable_twin/sensors/joint_states",
    "anchor": "/cable_twin/sensors/supports/start/force",
    "tilt": "/cable_twin/sensors/inclinometer/cabin/hanger",
    "box": "/cable_twin/sensors/imu/cabin",
}
DURATION = 30.0  # s


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("single_span", {"cable.elements": 30, "sensors": SENSORS})


@pytest.fixture(scope="module")
def log(tmp_path_factory, scenario):
    """Times of arrival, stamps (s) and messages by topic of a run of `simulate`."""
    directory = tmp_path_factory.mktemp("sensors")
    (directory / "trip.yaml").write_text("- {time: 0, name: cabin, speed: 4.0}\n", encoding="utf-8")
    (directory / "lift.yaml").write_text(scenario.to_yaml(), encoding="utf-8")
    arguments = ["--script", str(directory / "trip.yaml"), "--duration", str(DURATION), "--output", str(directory)]
    rates = ["--log-pose-rate", "0", "--log-force-rate", "0", "--record", "bag"]
    assert main([str(directory / "lift.yaml"), *arguments, *rates]) == 0
    (bag,) = {path.parent for path in Path(directory).rglob("*.mcap")}
    found: dict[str, list] = {}
    with AnyReader([bag]) as reader:
        for connection, arrival, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if hasattr(message, "header"):
                stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
                found.setdefault(connection.topic, []).append((arrival * 1e-9, stamp, message))
    return found


def truth(log, topic, read):
    """True numbers of the twin by stamp."""
    return {round(stamp, 4): read(message) for _, stamp, message in log[topic]}


def beside(log, sensor, topic, read, read_truth):
    """Measured and true numbers at equal stamps."""
    true = truth(log, topic, read_truth)
    pairs = [(read(message), true[round(stamp, 4)]) for _, stamp, message in log[TOPICS[sensor]]]
    return np.array(pairs).T


def test_an_encoder_has_a_quantum_a_rate_and_a_delay(log):
    measured, true = beside(log, "place", "/cable_twin/joint_states", lambda m: m.position[0], lambda m: m.position[0])
    assert measured.size == pytest.approx(DURATION * 50.0, abs=3)
    assert np.abs(np.round(measured / 0.01) * 0.01 - measured).max() < 1e-9
    error = measured - true
    assert np.abs(error).max() <= 0.005 + 1e-9
    assert error.std() == pytest.approx(0.01 / np.sqrt(12.0), rel=0.15)  # evenly spread over the quantum
    delays = [arrival - stamp for arrival, stamp, _ in log[TOPICS["place"]]]
    assert delays == pytest.approx([0.03] * len(delays), abs=1e-5)
    assert log[TOPICS["place"]][-1][2].velocity[0] == pytest.approx(4.0, abs=0.6)  # of two places in 20 ms


def test_a_load_cell_has_noise_and_a_bias(log):
    def size(message):
        return np.hypot(message.wrench.force.x, message.wrench.force.z)

    measured, true = beside(log, "anchor", "/cable_twin/supports/start/force", size, size)
    error = measured - true
    assert error.size == pytest.approx(DURATION * 100.0, abs=3)
    assert error.std() == pytest.approx(800.0, rel=0.06)
    assert error.mean() == pytest.approx(2000.0, abs=4.0 * 800.0 / np.sqrt(error.size))
    together = np.corrcoef(error[1:], error[:-1])[0, 1]
    assert abs(together) < 4.0 / np.sqrt(error.size)  # white


def test_an_inclinometer_and_an_imu_tell_pitch_turn_and_acceleration(log):
    def pitch(pose):
        return 2.0 * np.arctan2(pose.y, pose.w)

    measured, true = beside(
        log,
        "tilt",
        "/cable_twin/carriages/cabin/hanger/pose",
        lambda m: pitch(m.orientation),
        lambda m: pitch(m.pose.orientation),
    )
    assert measured.size == pytest.approx(DURATION * 20.0, abs=3)
    assert (measured - true).std() == pytest.approx(0.002, rel=0.15)
    assert measured.std() > 0.002  # it swings
    boxes = [message for _, _, message in log[TOPICS["box"]]]
    assert {message.header.frame_id for message in boxes} == {"cabin/cabin"}
    across = np.array([(m.linear_acceleration.y, m.angular_velocity.x - 0.1) for m in boxes])
    assert across.std(axis=0) == pytest.approx([0.05, 0.01], rel=0.06)
    upwards = np.array([m.linear_acceleration.z for m in boxes])
    assert upwards.mean() == pytest.approx(9.81, abs=0.05)
    assert boxes[0].orientation_covariance[0] == -1.0
    assert boxes[0].linear_acceleration_covariance[0] == pytest.approx(0.05**2)


def test_an_inclinometer_in_space_tells_roll_as_well():
    both = {"kind": "inclinometer", "of": "cabin", "rate": 20.0}
    changes = {"sensors": {"pitch": both, "roll": {**both, "axis": "roll"}}, "air.wind": [-5.0, 12.0, 0.0]}
    scenario = load_scenario("windy_tramway", changes)
    assert {sensor_topic(one) for one in scenario.sensors.values()} == {
        "sensors/inclinometer/cabin",
        "sensors/inclinometer/cabin/roll",
    }
    simulation = Simulation(scenario, samples=2)
    output = SensorOutput(scenario, simulation.layout, FrameNames("map", ""))
    angles = simulation.snapshot.columns.body_angles[-1]
    assert angles[0] > 0.01  # rad
    for topic, data in output.messages(simulation.snapshot, 0):
        (found,) = measurements_from_message(topic, data, scenario.sensors, 0)
        assert found.values == pytest.approx((angles[0 if found.sensor == "roll" else 1],))


def samples(scenario, frame=0.01, begin=0.0):
    simulation = Simulation(scenario, samples=2)
    simulation.command("cabin", speed=3.0)
    simulation.advance_to(begin)
    sensors = Sensors(scenario, simulation.layout)
    count = round((1.0 - begin) / frame)
    return [item for k in range(count + 1) for item in sensors.take(simulation.advance_to(begin + k * frame))]


def test_a_seed_gives_the_same_bits_from_wherever_it_begins(scenario):
    first = samples(scenario)
    assert first == samples(scenario)
    late = [item for item in samples(scenario, begin=0.5) if item.sensor in ("anchor", "tilt")]
    assert late == [item for item in first if item.sensor in ("anchor", "tilt") and item.time >= 0.5]
    other = load_scenario(scenario.resolved(), {"sensors.anchor.seed": 5})
    for sensor in SENSORS:
        same = [a for a in first if a.sensor == sensor] == [b for b in samples(other) if b.sensor == sensor]
        assert same == (sensor != "anchor")


def test_a_scenario_without_sensors_has_no_topics_of_theirs():
    assert sensor_topics(load_scenario("single_span")) == ()


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        ({"kind": "encoder", "of": "bus"}, "sensors.one.of: given 'bus'; allowed: cabin, for encoder"),
        (
            {"kind": "inclinometer", "of": "cabin", "axis": "roll"},
            "sensors.one.axis: given 'roll'; allowed: pitch, or roll of an inclinometer in space",
        ),
        ({"kind": "load_cell", "of": "cabin"}, "sensors.one.of: given 'cabin'; allowed: start, end"),
        (
            {"kind": "imu", "of": "cabin/roof"},
            "of: given 'cabin/roof'; allowed: cabin, cabin/running_",
        ),
        (
            {"kind": "sonar", "of": "cabin"},
            "sensors.one.kind: given 'sonar'; allowed: one of encoder, drive_force, load_cell,",
        ),
        ({"kind": "encoder", "of": "cabin", "noise": -1.0}, "sensors.one.noise: given -1.0; allowed: a finite number"),
        (
            {"kind": "encoder", "of": "cabin", "rate": 0.0},
            "one.rate: given 0.0 Hz; allowed: a finite number above",
        ),
        (
            {"kind": "encoder", "of": "cabin", "rate_bias": 1.0},
            "one.rate_bias: given 1.0 rad/s; allowed: 0, except for an",
        ),
        ({"of": "cabin"}, "sensors.one.kind: given nothing: it is needed"),
    ],
)
def test_sensors_that_measure_nothing_are_told_in_a_line(sensor, said):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("single_span", {"sensors": {"one": sensor}})
    (fault,) = caught.value.faults
    assert said in fault
