"""Door of a plant as a process between ROS 2, a real OPC UA server and a real MQTT broker, which are killed."""

from __future__ import annotations

import re
import signal
import sys
import time

import pytest
from ruamel.yaml import YAML
from twin_process import COMPILING, TwinProcess, allocate_domain, environment, release_domain, wait_until

pytest.importorskip("rclpy")
pytest.importorskip("asyncua")
pytest.importorskip("paho.mqtt")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from plant_servers import PASSWORD, USER, Mosquitto, OpcUa, OpcUaReader, free_port, listens, make_certificate
from ros_participant import Participant, values_of
from sensor_msgs.msg import JointState, Temperature

from cable_twin.messages import SECOND
from cable_twin.messages.figure_messages import estimate_message

HOUR = 3600.0  # s that the clock of the server is ahead
COMMAND = [sys.executable, "-m", "cable_twin.ros.door.plant_door"]


def start(directory, content, domain, **variables):
    """Door with a map in a directory."""
    file = directory / f"map_{time.monotonic_ns()}.yaml"
    YAML().dump(content, file)
    given = {**environment(directory, domain), **variables}
    return TwinProcess(directory, str(file), module="door", domain=domain, command=COMMAND, variables=given)


def age(message):
    """Age (s) of a message by our clock."""
    return time.time() - message.header.stamp.sec - message.header.stamp.nanosec / SECOND


class Plant:
    """Plant of an OPC UA server and a broker, its door, and a node that listens."""

    def __init__(self, directory):
        self.domain = allocate_domain()
        values = {"position": 0.0, "speed": 0.0, "load": 10.0, "held": 1.5, "tension": 0.0}
        self.server = OpcUa(directory, values, clock=HOUR)
        self.broker = Mosquitto(directory)
        self.server.start()
        self.broker.start()
        self.port = free_port()
        common = {"source": "plc", "of": "cabin"}
        content = {
            "opcua": {"plc": {"url": self.server.url, "retry": 0.5, "timeout": 5.0}},
            "mqtt": {"broker": {"host": "127.0.0.1", "port": self.broker.port, "retry": 0.5}},
            "server": {"url": f"opc.tcp://127.0.0.1:{self.port}", "stale_after": 0.5},
            "tags": {
                "position": {
                    **common,
                    "address": "nsu=urn:test;s=position",
                    "quantity": "position",
                    "unit": "m",
                    "rate": 100.0,
                    "stale_after": 600.0,
                },
                "speed": {
                    **common,
                    "address": "ns=2;s=speed",
                    "quantity": "speed",
                    "unit": "km/h",
                    "sign": -1,
                    "rate": 100.0,
                    "stale_after": 600.0,
                },
                "load": {
                    "source": "plc",
                    "address": "ns=2;s=load",
                    "quantity": "support_force",
                    "of": "tower",
                    "unit": "kN",
                    "range": [1.0, 600.0],
                    "rate": 100.0,
                    "stale_after": 600.0,
                },
                "tension": {
                    "source": "plc",
                    "address": "ns=2;s=tension",
                    "quantity": "support_force",
                    "of": "up/start",
                    "direction": [-0.6, 0.0, -0.8],
                    "unit": "kN",
                    "rate": 100.0,
                    "stale_after": 600.0,
                },
                "missing": {"source": "plc", "address": "ns=2;s=nowhere", "quantity": "temperature", "unit": "degC"},
                "held": {
                    **common,
                    "address": "ns=2;s=held",
                    "quantity": "payload",
                    "unit": "t",
                    "hold": True,
                    "rate": 50.0,
                },
                "mistyped": {**common, "source": "broker", "address": "lift/tilt", "quantity": "pitch", "unit": "deg"},
                "wrong": {**common, "address": "ns=2;s=speed", "quantity": "payload", "unit": "lb"},
                "wind": {
                    "source": "broker",
                    "address": "lift/wind",
                    "field": "gusts.0",
                    "stamp_field": "at",
                    "quality_field": "state",
                    "quantity": "wind",
                    "axis": "x",
                    "unit": "m/s",
                    "rate": 100.0,
                    "stale_after": 600.0,
                },
            },
        }
        self.door = start(directory, content, self.domain)
        self.ros = Participant(self.domain)
        self.ros.subscribe("/plant/joint_states", JointState)
        self.ros.subscribe("/plant/supports/tower/force", WrenchStamped)
        self.ros.subscribe("/plant/supports/up/start/force", WrenchStamped)
        self.ros.subscribe("/plant/wind", Vector3Stamped)
        self.ros.subscribe("/diagnostics", DiagnosticArray)
        self.ros.subscribe("/plant/payload", JointState)
        self.ros.subscribe("/plant/temperature", Temperature)
        self.ros.until(lambda: self.told("plc: connected, 5 of 6 tags"), COMPILING, "the door")
        self.until_told("broker: connected, 2 of 2 tags")

    def told(self, pattern):
        """Lines of the door that match."""
        return [line for line in self.door.output.splitlines() if re.search(pattern, line)]

    def until_told(self, pattern, count=1):
        self.ros.until(lambda: len(self.told(pattern)) >= count, what=f"{pattern} in {self.door.output}")

    def sent(self, topic, write, condition=lambda message: True):
        """Newest message on a topic after `write`, which is repeated until one meets a condition."""
        messages = self.ros.received[topic]
        messages.clear()
        last = 0.0

        def arrived():
            nonlocal last
            if time.monotonic() - last > 0.1:
                last = time.monotonic()
                write()
            return [message for message in messages if condition(message)]

        return self.ros.until(arrived, what=f"{topic}; {self.door.output}")[-1]

    def status(self, name):
        """Newest status of a connection in the diagnostics."""
        for message in reversed(self.ros.received["/diagnostics"]):
            for status in message.status:
                if status.name == f"plant_door: {name}":
                    return status
        return None

    def figures(self, name):
        """Figures of a connection in the newest diagnostics."""
        status = self.status(name)
        return {} if status is None else values_of(status)

    def close(self):
        self.ros.close()
        self.door.kill()
        self.server.kill()
        self.broker.kill()
        release_domain(self.domain)


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    made = Plant(tmp_path_factory.mktemp("plant"))
    yield made
    made.close()


def move(plant, position=120.5, speed=-18.0):
    plant.server.set("speed", speed)
    plant.server.set("position", position)


def test_tags_are_topics_in_si_units_with_stamps_of_our_clock(plant):
    message = plant.sent(
        "/plant/joint_states", lambda: move(plant), lambda one: [*one.position, *one.velocity] == [120.5, 5.0]
    )
    assert message.name == ["cabin"]
    assert -0.5 < age(message) < 30.0  # a busy machine
    assert plant.told(
        r"WARN.*plc: its clock is 3\d{3}(\.\d+)? s ahead of ours \(\+-.* ms\); stamps are shifted by that"
    )
    message = plant.sent("/plant/supports/tower/force", lambda: plant.server.set("load", 250.0))
    assert (message.wrench.force.x, message.wrench.force.z) == (0.0, 250e3)
    assert message.header.frame_id == "tower"
    message = plant.sent(
        "/plant/supports/up/start/force",
        lambda: plant.server.set("tension", 240.0),
        lambda one: abs(one.wrench.force.x + 144e3) < 1e-6,
    )
    assert message.header.frame_id == "up/start"


def test_json_messages_of_a_broker_are_topics(plant):
    def publish():
        plant.broker.publish("lift/wind", {"gusts": [7.5], "at": time.time() * 1e3, "state": "OK"})

    message = plant.sent("/plant/wind", publish)
    assert (message.vector.x, message.vector.y) == (7.5, 0.0)
    assert -0.5 < age(message) < 30.0


def test_what_is_missing_or_wrong_is_one_line_and_the_rest_goes_on(plant):
    assert (
        len(plant.told(r"map_\d+\.yaml: tags\.wrong\.unit: given 'lb'; a mass or a force; .*this tag is left out")) == 1
    )
    assert len(plant.told(r"tags\.missing: plc has no node ns=2;s=nowhere \(BadNodeIdUnknown\)")) == 1
    plant.until_told(r"tags\.mistyped: no sample for 5 s; left out until it is right again")
    assert not plant.told(r"tags\.missing: no sample")
    assert not plant.ros.received["/plant/temperature"]


def test_a_held_value_is_repeated_without_a_change(plant):
    messages = plant.ros.received["/plant/payload"]
    messages.clear()
    plant.ros.until(lambda: len(messages) >= 3, what="repeated payload")
    assert [[*one.effort] for one in messages[:3]] == [[1500.0]] * 3
    assert len({one.header.stamp.sec + one.header.stamp.nanosec / SECOND for one in messages[:3]}) == 3


def test_bad_quality_nan_and_a_thousand_times_too_much_are_left_out(plant):
    plant.sent(
        "/plant/supports/tower/force", lambda: plant.server.set("load", 251.0), lambda one: one.wrench.force.z == 251e3
    )
    messages = plant.ros.received["/plant/supports/tower/force"]
    messages.clear()
    plant.server.set("load", 260.0, "BadSensorFailure")
    plant.until_told(r"tags\.load: given quality BadSensorFailure; allowed: good; left out")
    plant.ros.until(lambda: plant.figures("plc").get("left_out_load") == "quality", what="status")
    assert plant.figures("plc")["left_out_missing"] == "BadNodeIdUnknown"
    plant.server.set("load", 261e3)
    plant.server.set("load", float("nan"))
    assert {one.wrench.force.z for one in messages} <= {251e3}  # some of which may have been under way
    plant.sent(
        "/plant/supports/tower/force", lambda: plant.server.set("load", 252.0), lambda one: one.wrench.force.z == 252e3
    )
    plant.until_told(r"tags\.load: right again, after 3 samples left out")
    plant.broker.publish("lift/wind", {"gusts": [], "at": "yesterday", "state": "ok"})
    plant.until_told(r"tags\.wind: given quality of a message without the key gusts\.0;")
    plant.broker.publish("lift/wind", "{]")
    plant.sent(
        "/plant/wind",
        lambda: plant.broker.publish("lift/wind", {"gusts": [8.0], "at": time.time(), "state": "good"}),
        lambda one: one.vector.x == 8.0,
    )


def test_a_killed_server_is_said_and_followed_again(plant):
    plant.server.kill()
    plant.until_told(r"WARN.*plc: connection lost: .*; nothing comes from it, trying again")
    plant.ros.until(lambda: "no connection" in plant.status("plc").message, what="status")
    wind = {"gusts": [9.0], "at": time.time(), "state": "good"}
    plant.sent(
        "/plant/wind", lambda: plant.broker.publish("lift/wind", {**wind, "at": time.time()})
    )  # the rest goes on
    plant.server.start()
    plant.until_told(r"plc: connected again after [\d.]+ s, 5 of 6 tags")
    message = plant.sent("/plant/joint_states", lambda: move(plant, 130.0), lambda one: one.position[0] == 130.0)
    assert -0.5 < age(message) < 30.0
    assert len(plant.told(r"has no node")) == 1  # known from before


def test_a_killed_broker_is_said_and_followed_again(plant):
    plant.broker.kill()
    plant.until_told(r"WARN.*broker: connection lost: 127.0.0.1:\d+ has ended the connection; nothing comes")
    plant.sent("/plant/joint_states", lambda: move(plant, 131.0), lambda one: one.position[0] == 131.0)
    plant.broker.start()
    plant.until_told(r"broker: connected again after [\d.]+ s, 2 of 2 tags")
    plant.sent(
        "/plant/wind",
        lambda: plant.broker.publish("lift/wind", {"gusts": [10.0], "at": time.time(), "state": "good"}),
        lambda one: one.vector.x == 10.0,
    )


def test_estimates_and_alarms_of_the_twin_are_variables(plant):
    wait_until(lambda: listens(plant.port), COMPILING, "server of the door")
    reader = OpcUaReader(f"opc.tcp://127.0.0.1:{plant.port}")
    try:
        assert reader.read("Alarms/Newest").StatusCode.name == "BadWaitingForInitialData"
        publisher = plant.ros.node.create_publisher(DiagnosticArray, "/cable_twin/estimate", 10)
        estimates = {"cabin/payload": (4200.0, 25.0, "kg"), "wind/x": (float("nan"), 0.5, "m/s")}

        def publish(*alarms, **state):
            publisher.publish(estimate_message(estimates, alarms, time.time_ns(), **state))

        def written(name, **state):
            publish(**state)
            plant.ros.spin(0.05)
            found = reader.read(name)
            return None if found.StatusCode.name == "BadNodeIdUnknown" else found  # not there yet

        value = plant.ros.until(lambda: written("Estimates/cabin/payload"), what="estimate")
        assert (value.Value.Value, value.StatusCode.name) == (4200.0, "Good")
        assert abs(value.SourceTimestamp.timestamp() - time.time()) < 30.0
        assert reader.read("Estimates/cabin/payload/StandardDeviation").Value.Value == 25.0
        assert reader.read("Estimates/cabin/payload/EngineeringUnits").Value.Value.DisplayName.Text == "kg"
        assert reader.read("Estimates/wind/x").StatusCode.name == "BadNoData"
        assert reader.read("Alarms/Count").Value.Value == 0
        publish("12.0 s: sensor load_tower contradicts all others and is left out")
        plant.ros.until(lambda: reader.read("Alarms/Count").Value.Value == 1, what="alarm")
        assert reader.read("Alarms/Newest").Value.Value.startswith("12.0 s: sensor load_tower contradicts")
        publish(of_payloads=[f"{number} s: chair_{number}/payload is 300 kg" for number in range(25)])
        plant.ros.until(lambda: reader.read("Alarms/Count").Value.Value == 26, what="alarms about payloads")
        first, *others = reader.read("Alarms/List").Value.Value
        assert first.startswith("12.0 s: sensor load_tower contradicts")
        assert [one.split()[0] for one in others] == [str(number) for number in range(6, 25)]
        # silence of the plant, and a twin that is late
        for state, expected in (({"measured": False}, "SubNormal"), ({"behind": 60.0}, "LastUsableValue"), ({}, "")):
            wanted = f"Uncertain{expected}" if expected else "Good"
            plant.ros.until(
                lambda state=state, wanted=wanted: (
                    written("Estimates/cabin/payload", **state).StatusCode.name == wanted
                ),
                what=wanted,
            )
        # silence of the twin
        old = plant.ros.until(
            lambda: (one := reader.read("Estimates/cabin/payload")).StatusCode.is_uncertain() and one, what="uncertain"
        )
        assert (old.Value.Value, old.StatusCode.name) == (4200.0, "UncertainLastUsableValue")
        plant.until_told(r"server: no estimate of /cable_twin for 0.5 s; its values are uncertain")
        from asyncua import ua  # noqa: PLC0415

        with pytest.raises(ua.UaError):  # nobody else writes
            reader.call(reader.client.get_node("ns=2;s=Estimates/cabin/payload").write_value(1.0))
    finally:
        reader.close()


@pytest.mark.long
def test_a_second_door_leaves_out_the_topics_of_the_first_and_takes_them_over(plant, tmp_path):
    tag = {"source": "plc", "address": "ns=2;s=load", "quantity": "support_force", "of": "tower", "unit": "kN"}
    content = {
        "opcua": {"plc": {"url": plant.server.url}},
        "tags": {"load": {**tag, "rate": 100.0, "stale_after": 600.0}},
    }
    second = start(tmp_path, content, plant.domain)
    try:
        said = "/plant/supports/tower/force is published by another /plant_door as well; left out here while it does"
        plant.ros.until(lambda: said in second.output, COMPILING, said)
        plant.ros.until(lambda: "plc: connected, 1 of 1 tags" in second.output, what=second.output)
        plant.door.kill()
        plant.ros.until(lambda: "is published by this door alone now" in second.output, what=second.output)
        message = plant.sent("/plant/supports/tower/force", lambda: plant.server.set("load", 300.0))
        assert message.wrench.force.z == 300e3
        second.send(signal.SIGINT)
        assert second.wait() == 0
    finally:
        second.kill()


def test_certificates_and_passwords_are_used_and_never_said(tmp_path, participants, domain):
    server_files, door_files = make_certificate(tmp_path, "server"), make_certificate(tmp_path, "door")
    server = OpcUa(tmp_path, {"speed": 0.0}, security=server_files)
    broker = Mosquitto(
        tmp_path,
        f"certfile {server_files[0]}",
        f"keyfile {server_files[1]}",
        f"cafile {door_files[0]}",
        "require_certificate true",
        "use_identity_as_username true",
    )
    secret = tmp_path / "password.txt"
    secret.write_text(f"{PASSWORD}\n")
    (tmp_path / "door.key").write_bytes(door_files[1].read_bytes())  # a name that does not tell the format
    own = {"certificate": door_files[0].name, "private_key": "door.key"}
    common = {"quantity": "speed", "unit": "m/s", "rate": 100.0}
    port = free_port()
    content = {
        "opcua": {
            "plc": {
                "url": server.url,
                "security": "sign_and_encrypt",
                **own,
                "server_certificate": server_files[0].name,
                "user": {"environment": "DOOR_USER"},
                "password": {"file": secret.name},
                "retry": 0.5,
            }
        },
        "mqtt": {
            "broker": {
                "host": "127.0.0.1",
                "port": broker.port,
                "tls": True,
                "authority": "server.pem",
                **own,
                "retry": 0.5,
            }
        },
        "server": {
            "url": f"opc.tcp://127.0.0.1:{port}",
            "security": "sign_and_encrypt",
            **own,
            "user": {"environment": "DOOR_USER"},
            "password": {"file": secret.name},
        },
        "tags": {
            "encrypted": {**common, "source": "plc", "address": "ns=2;s=speed", "of": "cabin"},
            "tls": {**common, "source": "broker", "address": "v", "of": "other"},
        },
    }
    try:
        server.start()
        broker.start()
        good = start(tmp_path, content, domain, DOOR_USER=USER)
        wait_until(lambda: "plc: connected, 1 of 1 tags" in good.output, COMPILING, "the door")
        wait_until(lambda: "broker: connected, 1 of 1 tags" in good.output, what=good.output)
        wait_until(lambda: listens(port), COMPILING, "server of the door")
        policy = f"Basic256Sha256,SignAndEncrypt,{','.join(map(str, make_certificate(tmp_path, 'client')))}"
        with pytest.raises(Exception, match=r"BadUserAccessDenied|identity token"):
            OpcUaReader(f"opc.tcp://127.0.0.1:{port}", policy, "Wrong-horse_10")
        reader = OpcUaReader(f"opc.tcp://127.0.0.1:{port}", policy, PASSWORD)
        assert reader.read("Alarms/Count").StatusCode.name == "BadWaitingForInitialData"
        reader.close()
        secret.write_text("Wrong-horse_10\n")
        server.kill()
        server.start()
        refused = "plc: no connection: user name or password refused"
        wait_until(lambda: refused in good.output, what=refused)
        secret.write_text(f"{PASSWORD}\n")
        wait_until(lambda: "plc: connected again" in good.output, what=good.output)  # as they are read anew
        assert good.end() == 0
        assert "other users of this machine can read password.txt" in good.output
        for word in (PASSWORD, "Wrong-horse_10", USER):
            assert word not in good.output
    finally:
        server.kill()
        broker.kill()
