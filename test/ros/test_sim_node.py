"""Node as its users meet it: a separate process, reached over DDS."""

from __future__ import annotations

import json
import math
import re
import time
from contextlib import contextmanager
from itertools import pairwise
from xml.etree import ElementTree

import pytest
from topics_page import services_of_page, topics_of_page
from twin_process import PATIENCE, TwinProcess, gaps, stamps, write_quick_scenario

from cable_twin.frame.records import Command
from cable_twin.ros.command_subscriber import WARNING_PERIOD
from cable_twin.ros.parameter_table import CHANGING, PARAMETERS
from cable_twin.scenario import load_scenario

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Vector3, Vector3Stamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_participant import Participant
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2, Temperature
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

FRAME = 10_000_000  # ns
MOVING = {"name": ["cabin"], "velocity": [2.0]}
BAD_COMMANDS = {  # one of each kind; test_command_messages.py and test_goals.py have the others
    "cabin' is nan": {"name": ["cabin"], "velocity": [math.nan]},
    "1 names and 2 values of velocity": {"name": ["cabin"], "velocity": [1.0, 2.0]},
    "speed of 'cabin': given 10.5 m/s; allowed: -10 to 10 m/s": {"name": ["cabin"], "velocity": [10.5]},
    "place for 'cabin': given 9000 m; allowed: ": {"name": ["cabin"], "position": [9000.0]},
    "carriage or drive: given 'gondola'": {"name": ["cabin", "gondola"], "velocity": [1.0, 1.0]},
}


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Twin with all logs for the whole module, and a participant that collects its topics."""
    directory = tmp_path_factory.mktemp("running")
    process = TwinProcess(directory, "--scenario", str(write_quick_scenario(directory)), "--publish-clock", "true")
    participant = Participant(process.domain)
    for topic, kind in (("cable", PointCloud2), ("carriages/cabin/pose", PoseStamped), ("cable_path", Path)):
        participant.subscribe(topic, kind)
    participant.subscribe("/clock", Clock, QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT))
    participant.subscribe_standard()
    participant.until(lambda: participant.received["/diagnostics"])
    yield process, participant
    participant.close()
    process.kill()


@pytest.fixture
def twin(running):
    """Running twin, at rest at its start, and checked to be alive afterwards."""
    process, participant = running
    assert participant.call("emergency_stop", SetBool, data=False).success
    assert participant.call("pause", SetBool, data=False).success
    assert participant.call("reset", Trigger).success
    participant.spin(0.1)
    for messages in participant.received.values():
        del messages[:-1]
    yield participant
    assert process.process.poll() is None, process.output


def give(twin: Participant, name: str, value: float) -> tuple[bool, str]:
    """Set a parameter of the twin; returns success and reason."""
    parameter = Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value))
    (result,) = twin.call("set_parameters", SetParameters, parameters=[parameter]).results
    return result.successful, result.reason


@contextmanager
def command_timeout(twin: Participant, seconds: float):
    """Lengthen the time-out of commands, so that a stall of the machine does not count as silence."""
    assert give(twin, "command_timeout", seconds)[0]
    try:
        yield
    finally:
        assert give(twin, "command_timeout", 0.5)[0]


RATES = {"joint_states": 100.0, "cable": 100.0, "carriages/cabin/pose": 100.0, "cable_path": 10.0, "/clock": 100.0}


def test_topics_arrive_at_the_frame_rate_with_stamps_of_simulated_time(twin):
    """Pace as reported by the twin: real time, unless the machine is too busy."""

    def window():
        before = {topic: len(twin.received[topic]) for topic in RATES}
        started = time.monotonic()
        values = twin.next_diagnostics()[2]
        elapsed = time.monotonic() - started
        pace = float(values["real_time_factor"])
        counts = {topic: len(twin.received[topic]) - count for topic, count in before.items()}
        return pace > 0.3 and all(
            counts[topic] / elapsed == pytest.approx(rate * pace, rel=0.2) for topic, rate in RATES.items()
        )

    twin.until(window, 2.0 * PATIENCE, what="rates of all topics")
    for topic in ("joint_states", "cable", "carriages/cabin/pose"):
        messages = twin.received[topic]
        steps = gaps(messages)
        assert min(steps) > 0
        assert steps.count(FRAME) >= 0.95 * len(steps), topic
        assert all(step % FRAME == 0 for step in steps)
        assert {message.header.frame_id for message in messages} == {"map"}
    level, message, values = twin.next_diagnostics()
    assert values["log_dropped_frames"] == "0"
    assert level in (0, 1), message  # a warning where this machine was late


ASKED_FOR = ("estimate", "outlook", "readmitted")  # by options
OF_OTHERS = (
    "air/",
    "carriers/",
    "connectors",
    "derailments",
    "pantographs",
    "sheaves",
    "/tf",
    "sensors/",
)  # what this scenario has not, or no wheel brings


def test_topics_and_services_are_those_of_the_page(twin):
    """Names, types and directions as seen by other nodes, without those of every node and without missing packages.

    The emergency stop is a participant of its own.
    """
    scenario = load_scenario("aerial_tramway")
    vehicles = {name: tuple(carriage.bodies) for name, carriage in scenario.carriages.items()}
    of_all = {
        *services_of_page(),
        *(
            row
            for row in topics_of_page()
            if not row.name.startswith((*OF_OTHERS, *ASKED_FOR)) and "haul" not in row.name
        ),
    }
    expected = {line for row in of_all for line in row.expanded(vehicles, ("start", "end"))}
    ask, nodes = twin.node, {("cable_twin", "/"), ("cable_twin_emergency_stop", "/")}
    groups = (
        ("out", ask.get_publisher_names_and_types_by_node, "msg"),
        ("in", ask.get_subscriber_names_and_types_by_node, "msg"),
        ("service", ask.get_service_names_and_types_by_node, "srv"),
    )

    def found() -> set[tuple[str, str, str]]:
        return {
            (direction, name.removeprefix("/cable_twin/"), types[0].replace(f"/{form}/", "/"))
            for node in nodes.intersection(ask.get_node_names_and_namespaces())
            for direction, get, form in groups
            for name, types in get(*node)
            if name not in ("/rosout", "/parameter_events") and not types[0].startswith(("rcl_", "type_desc"))
        }

    twin.until(lambda: found() == expected, what="the topics and services of the page")


def test_joint_states_name_carriages_and_bodies(twin):
    state = twin.received["joint_states"][-1]
    assert state.name == ["cabin", "cabin_running_carriage", "cabin_hanger", "cabin_cabin"]
    assert state.position[0] == pytest.approx(60.0, abs=0.1)
    assert state.effort[0] > 1e3  # the drive holds the cabin on the slope


def test_command_moves_the_cabin_and_silence_stops_it(running, twin):
    process, _ = running
    before = process.output.count("ramps to a stop")
    with twin.stream(**MOVING):
        twin.until(lambda: twin.speed == pytest.approx(2.0, abs=1e-6), what="commanded speed")
    assert twin.arc_length > 60.5
    silent = time.monotonic()
    twin.until(lambda: twin.speed == 0.0, what="stop after silence")
    assert time.monotonic() - silent > 0.4  # not before the time-out
    stopping = [applied.command for applied in twin.applied if applied.source == "command_timeout"]
    assert stopping == [Command("speed", {"cabin": 0.0})]
    assert process.output.count("no command for 0.5 s: cabin ramps to a stop") == before + 1
    speeds = [message.velocity[0] for message in twin.received["joint_states"]]
    fastest = max(abs(after - before) for before, after in pairwise(speeds))
    assert fastest <= 4.0 * 0.1  # a ramp at the drive's 4 m/s^2, not a jump, even where frames were missed


def test_force_that_falls_silent_is_stopped_too(twin):
    with twin.stream(name=["cabin"], effort=[0.0]):
        twin.until(lambda: twin.speed < -0.5, what="roll down without drive force")
    twin.until(lambda: twin.speed == 0.0, what="stop after silence")


def refusals(twin):
    """Function that returns the reasons of all commands refused since, a line each, from their topic."""
    twin.received["refused_commands"].clear()
    twin.subscribe("refused_commands", DiagnosticArray)
    twin.until(lambda: twin.node.count_publishers(f"{twin.twin}/refused_commands"), what="a topic of refusals")
    twin.spin(0.3)
    return lambda: "\n".join(one.status[0].message for one in twin.received["refused_commands"])


def test_bad_commands_are_refused_counted_and_named(running, twin):
    process, _ = running
    told = refusals(twin)
    refused = int(twin.next_diagnostics()[2]["commands_refused"])
    with command_timeout(twin, 60.0):
        twin.publish(**MOVING)
        twin.until(lambda: twin.speed == pytest.approx(2.0, abs=1e-6), what="commanded speed")
        twin.received["joint_states"].clear()
        length, begin = len(process.output), time.monotonic()
        for reason, fields in BAD_COMMANDS.items():
            twin.publish(**fields)
            twin.until(lambda reason=reason: reason in told(), what=reason)
            twin.spin(0.06)  # beyond the throttle
        warning = next(line for line in process.output[length:].splitlines() if "command refused" in line)
        assert warning.startswith("[WARN]")
        assert "/cable_twin/joint_commands: command refused, the previous one stays in force" in warning
        twin.publisher.publish(b"\x00\x01\x00\x00\xff\xff\xff\xff\xff\xff")
        twin.until(lambda: "not a JointState" in told())
        assert {status.name for message in twin.received["refused_commands"] for status in message.status} == {
            "joint_commands"
        }
        for _ in range(20):
            twin.publish(name=["cabin"], velocity=[math.nan])
        values = twin.next_diagnostics()[2]
        assert int(values["commands_refused"]) == refused + len(BAD_COMMANDS) + 1 + 20
        most = 1 + (time.monotonic() - begin) / WARNING_PERIOD
        assert process.output[length:].count("command refused") <= most
        twin.until(lambda: len(twin.received["joint_states"]) > 100, what="a second of frames")
        speeds = [message.velocity[0] for message in twin.received["joint_states"]]
    assert speeds == pytest.approx([2.0] * len(speeds), abs=1e-6)
    assert "Traceback" not in process.output


def test_payload_wind_and_temperature_are_taken_from_their_topics_or_refused_by_name(twin):
    told = refusals(twin)
    loads = twin.node.create_publisher(JointState, f"{twin.twin}/payload", 10)
    winds = twin.node.create_publisher(Vector3Stamped, f"{twin.twin}/wind", 10)
    degrees = twin.node.create_publisher(Temperature, f"{twin.twin}/temperature", 10)
    senders = loads, winds, degrees
    twin.until(lambda: all(one.get_subscription_count() for one in senders), what="a twin that listens")

    def applied(kind: str) -> Command | None:
        return next((one.command for one in twin.applied if one.command.kind == one.source == kind), None)

    loads.publish(JointState(name=["cabin"], effort=[3200.0]))
    winds.publish(Vector3Stamped(vector=Vector3(x=12.0, z=-1.0)))
    degrees.publish(Temperature(temperature=12.5, variance=0.1))
    load = twin.until(lambda: applied("payload"), what="applied payload")
    wind = twin.until(lambda: applied("wind"), what="applied wind")
    temperature = twin.until(lambda: applied("temperature"), what="applied temperature")
    assert load.values == {"cabin": 3200.0}
    assert temperature.values == {"ropes": 12.5}
    assert wind.values == {"x": 12.0, "z": -1.0}
    # the cabin swings downwind; its pitch is the sum of the joints above it
    twin.until(lambda: sum(twin.received["joint_states"][-1].position[1:]) < -0.005, what="a cabin in the wind")
    for publisher, message, reason in (
        (loads, JointState(name=["cabin"], effort=[1e6]), "payload of 'cabin': given 1e+06 kg; allowed: 0 to"),
        (winds, Vector3Stamped(vector=Vector3(y=3.0)), "wind y: given 3 m/s; allowed: 0"),
        (degrees, Temperature(temperature=285.65), "temperature: given 285.65 degC; allowed: -100 to 100 degC"),
        (degrees, Temperature(temperature=float("nan")), "temperature: given nan degC; allowed: -100 to 100 degC"),
    ):
        twin.spin(0.06)  # beyond the throttle
        publisher.publish(message)
        twin.until(lambda reason=reason: reason in told(), what=reason)
    with twin.stream(**MOVING):
        twin.until(lambda: twin.speed > 0.5)
        loads.publish(JointState(name=["cabin"], effort=[0.0]))
        twin.until(lambda: "payload of 'cabin': given at a " in told(), what="a refusal under way")


def test_reset_puts_the_state_back_and_never_the_time(twin):
    with twin.stream(**MOVING):
        twin.until(lambda: twin.arc_length > 61.0)
    answer = twin.call("reset", Trigger)
    assert answer.success
    assert "of simulated time" in answer.message
    twin.until(lambda: twin.arc_length == pytest.approx(60.0, abs=1e-3), what="start")
    twin.spin(0.3)
    assert twin.speed == pytest.approx(0.0, abs=1e-3)  # the reset takes the command back as well
    assert min(gaps(twin.received["joint_states"])) > 0
    assert min(gaps(twin.received["cable"])) > 0


def set_step_count(twin, count):
    value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=count)
    (result,) = twin.call(
        "set_parameters", SetParameters, parameters=[Parameter(name="step_count", value=value)]
    ).results
    assert result.successful, result.reason


def test_pause_step_and_reset(twin):
    with twin.stream(**MOVING):
        twin.until(lambda: twin.arc_length > 60.5, what="a cabin away from the start")
    refusal = twin.call("step", Trigger)
    assert not refusal.success
    assert "not paused" in refusal.message
    assert twin.call("pause", SetBool, data=True).success
    twin.spin(0.3)
    count = len(twin.received["joint_states"])
    twin.spin(0.5)
    assert len(twin.received["joint_states"]) == count
    for _ in range(3):
        assert twin.call("step", Trigger).success
    twin.until(lambda: len(twin.received["joint_states"]) == count + 3)
    assert gaps(twin.received["joint_states"])[-3:] == [FRAME] * 3
    assert twin.call("reset", Trigger).success
    twin.until(lambda: len(twin.received["joint_states"]) == count + 4, what="a frame that shows the reset")
    assert twin.arc_length == pytest.approx(60.0, abs=1e-3)
    assert gaps(twin.received["joint_states"])[-1:] == [FRAME]
    twin.next_diagnostics()
    assert twin.task("pace") == (0, "paused")
    paused_at = stamps(twin.received["joint_states"])[-1]
    resumed = time.monotonic()
    assert twin.call("pause", SetBool, data=False).success

    def simulated():
        return (stamps(twin.received["joint_states"])[-1] - paused_at) * 1e-9

    twin.until(lambda: simulated() > 0.1, what="time that runs")
    assert simulated() <= time.monotonic() - resumed + 0.02  # does not run after the time that it was paused


def test_emergency_stop_refuses_commands_until_released(running, twin):
    process, _ = running
    length = len(process.output)
    with twin.stream(**MOVING):
        twin.until(lambda: twin.speed == pytest.approx(2.0, abs=1e-6))
        assert twin.call("emergency_stop", SetBool, data=True).success
        twin.until(lambda: twin.speed == 0.0, what="emergency stop against commands")
        twin.spin(0.3)
        assert twin.speed == 0.0
        assert twin.next_diagnostics()[2]["emergency_stop"] == "true"
        assert twin.task("commands") == (1, "emergency stop in force")
        assert "release it before the next command" in process.output[length:]
        assert twin.call("emergency_stop", SetBool, data=False).success
        twin.until(lambda: twin.speed == pytest.approx(2.0, abs=1e-6), what="motion after the release")


def test_scenario_is_there_for_a_late_joiner(running, twin):
    process, _ = running
    late = Participant(process.domain)
    try:
        late.subscribe("scenario", String, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        (message,) = late.until(lambda: late.received["scenario"])
    finally:
        late.close()
    scenario = load_scenario(json.loads(message.data))
    expected = load_scenario(str(process.directory / "quick.yaml"))
    assert scenario.resolved() == expected.resolved()


def test_what_rviz_shows_is_there_for_a_late_joiner_and_while_the_twin_is_paused(twin):
    """Markers with each frame, else once a second, as their lifetime is limited."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    twin.subscribe("robot_description", String, latched)
    twin.subscribe("markers", MarkerArray)
    twin.until(lambda: len(twin.received["markers"]) >= 5 and twin.received["robot_description"])
    moved = [step for step in gaps([message.markers[0] for message in twin.received["markers"]]) if step]
    assert moved.count(10 * FRAME) >= 0.5 * len(moved)  # a machine that gives no frame for a second has the same again
    assert min(moved) > 0
    joints = ElementTree.fromstring(twin.received["robot_description"][-1].data).findall("joint")
    assert {joint.get("name") for joint in joints} >= {"cabin", "cabin_hanger", "cabin_cabin"}
    assert twin.call("pause", SetBool, data=True).success
    collected = twin.received["markers"]
    twin.until(lambda: gaps([message.markers[0] for message in collected[-2:]]) == [0], what="the same markers again")


def test_parameters_are_described_with_unit_and_range(twin):
    names = [parameter.name for parameter in PARAMETERS]
    descriptors = twin.call("describe_parameters", DescribeParameters, names=names).descriptors
    assert [descriptor.name for descriptor in descriptors] == names
    for descriptor, parameter in zip(descriptors, PARAMETERS, strict=True):
        assert len(descriptor.description) > 15
        assert descriptor.read_only == (parameter.name not in CHANGING)
        assert parameter.unit in descriptor.description
        if isinstance(parameter.default, float):
            (bounds,) = descriptor.floating_point_range
            assert (bounds.from_value, bounds.to_value) == (parameter.low, parameter.high)
            assert f"({parameter.low:g} to {parameter.high:g}" in descriptor.description
    assert descriptors[names.index("rerun")].additional_constraints == "one of: none, file, live, web"


def test_only_the_command_timeout_may_change_and_within_its_range(twin):
    assert not give(twin, "frame_rate", 50.0)[0]
    assert give(twin, "command_timout", 1.0) == (
        False,
        "command_timout: given a parameter that does not exist; did you mean command_timeout?",
    )
    successful, reason = give(twin, "command_timeout", 0.001)
    assert not successful
    assert "command_timeout" in reason
    assert "0.02" in reason
    with command_timeout(twin, 30.0):
        twin.publish(**MOVING)
        twin.until(lambda: twin.speed == pytest.approx(2.0, abs=1e-6), what="speed by a single command")


def test_diagnostics_go_on_where_somebody_sets_use_sim_time(twin):
    """Timer of the node independent of a clock that nobody publishes."""
    parameter = Parameter(name="use_sim_time", value=ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=True))
    (result,) = twin.call("set_parameters", SetParameters, parameters=[parameter]).results
    assert result.successful
    for _ in range(2):
        twin.next_diagnostics()
    parameter.value.bool_value = False
    assert twin.call("set_parameters", SetParameters, parameters=[parameter]).results[0].successful


def test_time_has_never_gone_back(running):
    """Stamps of all topics collected by the earlier tests, resets included."""
    _, participant = running
    assert stamps(participant.received["joint_states"]) == sorted(stamps(participant.received["joint_states"]))


def test_many_frames_in_one_call(twin):
    """One call for many frames as fast as possible; accepts an emergency stop, and is ended by a pause."""
    assert twin.call("pause", SetBool, data=True).success
    set_step_count(twin, 1)
    first = twin.call("step", Trigger).message
    set_step_count(twin, 2000)
    called = time.monotonic()
    last = twin.call("step", Trigger).message
    assert time.monotonic() - called < 19.0  # 20 s by the clock
    before, after = (float(re.search(r"to (.*) s of", answer).group(1)) for answer in (first, last))
    assert after - before == pytest.approx(20.0)
    set_step_count(twin, 1_000_000)
    long = twin.node.create_client(Trigger, f"{twin.twin}/step")
    twin.until(long.service_is_ready)
    future = long.call_async(Trigger.Request())
    seen = len(twin.received["joint_states"])
    twin.until(lambda: len(twin.received["joint_states"]) > seen + 100)
    for data in (True, False):
        assert twin.call("emergency_stop", SetBool, data=data).success
        assert not future.done()
    assert twin.call("pause", SetBool, data=True).success
    twin.until(future.done)
    assert not future.result().success
    assert re.fullmatch(r"paused after \d+ of 1000000 frames", future.result().message)
    twin.node.destroy_client(long)
    set_step_count(twin, 1)
