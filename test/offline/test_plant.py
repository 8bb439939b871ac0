"""`plant`: a bag with the topics of a plant, of the sensors that are asked for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from cable_twin.offline import plant
from cable_twin.offline.plant import main
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import load_scenario

DURATION = 20.0  # s
CHANGED = ["--set", "cable.elements=30", "--set", "carriages.cabin.friction.rolling=0.01"]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp("plant")
    (directory / "trip.yaml").write_text("- {time: 0, name: cabin, speed: 4.0}\n", encoding="utf-8")
    arguments = ["--script", str(directory / "trip.yaml"), "--duration", str(DURATION), "--log", str(directory)]
    assert main(["single_span", *CHANGED, *arguments]) == 0
    (bag,) = {path.parent for path in directory.rglob("*.mcap")}
    return bag


def test_samples_are_quantised_noisy_late_and_lost_and_stamped_when_they_were_taken(bag):
    found: dict[str, list] = {}
    with AnyReader([bag]) as reader:
        for connection, arrival, data in reader.messages():
            if connection.topic.startswith("/plant/"):
                message = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
                found.setdefault(connection.topic, []).append((arrival * 1e-9 - stamp, message))
    assert {*found} == {
        "/plant/joint_states",
        "/plant/inclinometer/cabin",
        "/plant/supports/start/force",
        "/plant/supports/end/force",
    }
    encoder = [one for _, one in found["/plant/joint_states"] if len(one.position)]
    forces = [one.effort[0] for _, one in found["/plant/joint_states"] if len(one.effort)]
    places = np.array([one.position[0] for one in encoder])
    assert np.abs(places / 0.01 - np.round(places / 0.01)).max() < 1e-6
    assert places[-1] > 50.0  # m: it has moved
    assert max(forces) > 1000.0  # N: and was pulled
    waits = np.array([wait for pairs in found.values() for wait, _ in pairs])
    assert waits.min() >= -1e-6
    assert 0.05 < waits.max() < 0.08  # s: jitter, and a frame
    count = sum(map(len, found.values()))
    assert 0.95 * 5 * 10 * DURATION < count < 0.995 * 5 * 10 * DURATION  # 2 % are lost


def test_the_bag_is_a_log_with_the_values_of_the_plant_and_its_sensors(bag):
    log = read_log(bag)
    assert log.scenario["carriages"]["cabin"]["friction"]["rolling"] == 0.01
    assert {*log.scenario["sensors"]} == {"encoder_cabin", "force_cabin", "load_start", "load_end", "tilt_cabin"}
    assert [one.command.values for one in log.commands] == [{"cabin": 4.0}]
    assert any(log.messages(["sensors/joint_states"]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[]", "given []; allowed: a mapping with sensors by name"),
        ("{}", "given no sensors; allowed: sensors by name"),
        ("a: {kind: radar, of: cabin}", "sensors.a.kind: given 'radar'"),
        ("a: {kind: encoder, of: cabin, lost: 2}", "sensors.a.lost: given 2"),
    ],
)
def test_a_wrong_file_of_sensors_is_a_line(tmp_path, refusal, text, said):
    (tmp_path / "sensors.yaml").write_text(text, encoding="utf-8")
    assert said in refusal(main, "single_span", "--sensors", tmp_path / "sensors.yaml", "--log", tmp_path)


def test_a_stuck_sensor_repeats_its_last_value_and_a_drift_grows(tmp_path):
    text = "a: {kind: encoder, of: cabin, rate: 10, stuck_after: 1.0}\nb: {kind: load_cell, of: start, drift: 3.6e7}\n"
    (tmp_path / "sensors.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "trip.yaml").write_text("- {time: 0, name: cabin, speed: 4.0}\n", encoding="utf-8")
    arguments = ["--sensors", str(tmp_path / "sensors.yaml"), "--script", str(tmp_path / "trip.yaml")]
    assert main(["single_span", *arguments, "--duration", "3", "--log", str(tmp_path / "out")]) == 0
    ((bag,),) = [[path.parent for path in tmp_path.rglob("*.mcap")]]
    with AnyReader([bag]) as reader:
        messages = [(one.topic, reader.deserialize(data, one.msgtype)) for one, _, data in reader.messages()]
    places = [one.position[0] for topic, one in messages if topic == "/plant/joint_states"]
    assert len({*places[12:]}) == 1
    assert len({*places}) > 5
    loads = [
        np.hypot(one.wrench.force.x, one.wrench.force.z) for topic, one in messages if topic.endswith("start/force")
    ]
    assert loads[-1] - loads[0] == pytest.approx(3.0e4, rel=0.2)  # N, in 3 s, while the cabin moves


def test_arguments_of_ros_go_to_the_node_before_the_names_of_a_plant(monkeypatch):
    """So that they win, as the first rule for a name does."""
    started = []
    monkeypatch.setattr(plant, "plant_of", lambda *_: SimpleNamespace(scenario=load_scenario("single_span")))
    monkeypatch.setattr(plant, "_record", lambda *_: 0)
    monkeypatch.setattr(plant.os, "execv", lambda _, program: started.extend(program))
    main(["single_span", "--ros-args", "-p", "record:=false", "-r", "__ns:=/b"])
    first = started.index("--ros-args")
    assert started[first + 1 : first + 5] == ["-p", "record:=false", "-r", "__ns:=/b"]
    assert "~/joint_commands:=/plant/joint_commands" in started[first + 5 :]


def test_arguments_of_ros_are_for_a_live_plant(tmp_path, refusal):
    assert "--ros-args: given with --log" in refusal(main, "single_span", "--log", tmp_path, "--ros-args")


@pytest.mark.parametrize(("name", "told"), [("pantograph", "pantograph: given no vehicles; "), ("single_span", "")])
def test_a_plant_that_no_twin_can_follow_is_told(name, told, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(plant, "plant_of", lambda *_: SimpleNamespace(scenario=load_scenario(name)))
    monkeypatch.setattr(plant, "_record", lambda *_: 0)
    assert main([name, "--log", str(tmp_path)]) == 0
    assert (f"plant: note: no twin can follow this plant: {told}" in capsys.readouterr().err) == bool(told)
