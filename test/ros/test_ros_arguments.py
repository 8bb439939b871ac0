"""Twin with ROS arguments: namespace, remaps, QoS, parameter file; and `drive` beside it."""

from __future__ import annotations

import math
import re
import shlex
from contextlib import suppress
from functools import partial

import pytest
from bags import bag
from twin_process import COMPILING, PATIENCE, TwinProcess, stamps, wait_until, write_quick_scenario

from cable_twin.frame.records import Command
from cable_twin.messages import TopicNames
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import load_scenario

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_participant import Participant
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2

from cable_twin.ros.diagnostics import drive_hint

TWIN = "/south/cable_twin"
REMAPS = ["__ns:=/south", "/clock:=/south/clock", "~/joint_states:=/js", "~/joint_commands:=/desk"]
GIVEN = [
    "use_sim_time:=true",  # and nobody publishes /clock
    "frame_id:=valley",
    "frame_prefix:=south/",
    "command_timeout:=2",
    f"qos_overrides.{TWIN}/cable.publisher.reliability:=best_effort",
    f"qos_overrides.{TWIN}/cable.publisher.depth:=3",
    "qos_overrides./desk.subscription.depth:=7",
    "qos_overrides./nobody.publisher.depth:=3",
]


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    directory = tmp_path_factory.mktemp("south")
    file = directory / "parameters.yaml"
    file.write_text("/**:\n  ros__parameters:\n    rerun: off\n    publish_clock: true\n", encoding="utf-8")
    ros = ["--params-file", str(file)]
    for flag, rules in (("-r", REMAPS), ("-p", GIVEN)):
        ros += [word for rule in rules for word in (flag, rule)]
    changes = ["--set", "terrain=[[0, -90], [1000, -90]]", "--set", "terrain.1.1=-91"]
    process = TwinProcess(directory, str(write_quick_scenario(directory)), *changes, "--ros-args", *ros)
    participant = Participant(process.domain, node=TWIN)
    best_effort = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    for topic, kind, qos in (
        ("/js", JointState, 100),
        ("/desk", JointState, 100),
        ("/south/clock", Clock, best_effort),
        ("/diagnostics", DiagnosticArray, 10),
        ("applied_commands", JointState, 100),
        ("cable", PointCloud2, best_effort),
        ("carriages/cabin/pose", PoseStamped, 10),
        ("carriages/cabin/contact_force", WrenchStamped, 10),
        ("supports/end/force", WrenchStamped, 10),
    ):
        participant.subscribe(topic, kind, qos)
    participant.until(lambda: participant.received["/js"], COMPILING, "/js")
    yield process, participant
    participant.close()
    process.kill()


@pytest.fixture
def twin(running):
    return running[1]


def test_topics_have_the_names_they_were_remapped_to_also_in_texts(running, twin):
    twin.until(lambda: twin.received["/south/clock"], what="/south/clock")
    names = {name for name, _ in twin.node.get_topic_names_and_types()}
    assert not {"/clock", f"{TWIN}/joint_states", f"{TWIN}/joint_commands"} & names
    assert f"{TWIN}/outlook" not in names, "with the option outlook"
    twin.until(lambda: "commands on /desk" in running[0].output, what="the line that says so")
    publisher = twin.node.create_publisher(JointState, "/desk", 10)
    twin.until(publisher.get_subscription_count, what="a twin that listens")
    publisher.publish(JointState(name=["gondola"], velocity=[1.0]))
    twin.until(lambda: "/desk: command refused" in running[0].output, what="a refusal by name")


def test_frames_have_names_of_their_own(twin):
    topics = ("/js", "cable", "carriages/cabin/pose", "carriages/cabin/contact_force", "supports/end/force")
    expected = ["valley", "valley", "valley", "south/cabin", "south/end"]
    twin.until(lambda: all(twin.received[topic] for topic in topics), what="a frame")
    assert [twin.received[topic][-1].header.frame_id for topic in topics] == expected


def test_diagnostics_come_without_a_clock_and_name_node_task_and_scenario_in_full(twin):
    statuses = twin.until(lambda: twin.received["/diagnostics"], what="/diagnostics")[-1].status
    tasks = ("pace", "solver", "commands", "recording", "limits")
    assert [status.name for status in statuses] == [f"south/cable_twin: {task}" for task in tasks]
    assert {status.hardware_id for status in statuses} == {"quick"}
    assert all(status.message for status in statuses)
    keys = [pair.key for status in statuses for pair in status.values]
    assert len(set(keys)) == len(keys)


def test_values_of_the_scenario_are_changed_line_by_line(running, twin):
    assert value_of(twin, "set").string_value == "terrain=[[0, -90], [1000, -90]]\nterrain.1.1=-91"
    directory = running[0].run_directory
    assert wait_until(partial(written_scenario, directory))["terrain"] == [[0, -90], [1000, -91]]


def written_scenario(directory):
    """Scenario of a running log; None until it is on the disk."""
    with suppress(LogError):
        return read_log(directory).scenario
    return None


def value_of(twin: Participant, name: str) -> ParameterValue:
    return twin.call("get_parameters", GetParameters, names=[name]).values[0]


def test_rerun_off_of_a_file_which_yaml_reads_as_false_is_none(running, twin):
    assert value_of(twin, "rerun").string_value == "none"
    assert not list(running[0].run_directory.glob("*.rrd"))


def test_a_double_stays_a_double_where_a_whole_number_is_set(twin):
    name = "command_timeout"
    assert (value_of(twin, name).type, value_of(twin, name).double_value) == (ParameterType.PARAMETER_DOUBLE, 2.0)
    for value, taken in (
        (ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=3), True),
        (ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="3"), False),
    ):
        parameters = [Parameter(name=name, value=value)]
        (result,) = twin.call("set_parameters", SetParameters, parameters=parameters).results
        assert (result.successful, bool(result.reason)) == (taken, not taken)
        assert (value_of(twin, name).type, value_of(twin, name).double_value) == (ParameterType.PARAMETER_DOUBLE, 3.0)


def test_quality_of_service_is_what_was_asked_for(running, twin):
    (cable,) = twin.node.get_publishers_info_by_topic(f"{TWIN}/cable")
    assert cable.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    (joints,) = twin.node.get_publishers_info_by_topic("/js")
    assert joints.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert value_of(twin, "qos_overrides./desk.subscription.depth").integer_value == 7
    ignored = re.findall(r"parameter '(\S+)' is ignored", running[0].output)
    assert ignored == ["qos_overrides./nobody.publisher.depth"]


def words_in_the_namespace(scenario) -> list[str]:
    """Output of `drive` in the namespace of the twin."""
    remaps = ["__ns:=/south", f"{TWIN}/joint_commands:=/desk", f"{TWIN}/joint_states:=/js"]
    return ["cabin", "--speed", "5", "--ros-args", *(word for rule in remaps for word in ("-r", rule))]


def words_of_the_hint(scenario) -> list[str]:
    """Text in the last row of the terminal."""
    hint = drive_hint(scenario, TopicNames(TWIN, {"joint_commands": "/desk", "joint_states": "/js"}))
    return shlex.split(hint)[1:]


@pytest.mark.parametrize("words", [pytest.param(words_in_the_namespace, marks=pytest.mark.long), words_of_the_hint])
def test_drive_is_remapped_as_any_node_and_each_of_its_messages_has_a_stamp(running, twin, processes, words):
    twin.received["/desk"].clear()
    twin.received["/js"].clear()
    given = words(load_scenario(str(running[0].directory / "quick.yaml")))
    options = ["--duration", "3", "--wait", str(PATIENCE)]  # longer than it takes to be discovered here as well
    process = processes(*options, *given, module="ros.client.drive", domain=running[0].domain)
    twin.until(lambda: process.process.poll() is not None, what=f"end of drive; {process.output}")
    assert process.process.returncode == 0, process.output
    twin.until(lambda: twin.received["/desk"] and twin.received["/desk"][-1].velocity[0] == 0.0, what="its stop")
    sent = stamps(twin.received["/desk"])
    assert len(sent) > 1
    assert sent == sorted(sent)
    assert sent[0] > 0
    assert max(message.velocity[0] for message in twin.received["/js"]) > 0.5


def test_joints_that_are_named_with_nan_are_left_alone(twin):
    """All joints of joint_states in one message, as from a ros2_control hardware on topics."""
    publisher = twin.node.create_publisher(JointState, "/desk", 10)
    twin.until(publisher.get_subscription_count, what="a twin that listens")
    names = twin.received["/js"][-1].name
    assert names == ["cabin", "cabin_running_carriage", "cabin_hanger", "cabin_cabin"]
    nothing = [math.nan] * len(names)
    publisher.publish(JointState(name=names, position=nothing, velocity=[0.25, *nothing[1:]], effort=nothing))
    twin.until(lambda: Command("speed", {"cabin": 0.25}) in [one.command for one in twin.applied], what="the command")


def test_the_bag_has_the_names_and_the_quality_of_the_run_and_replays(running, twin, replayed):
    """Last test of the module: ends the twin."""
    process, _ = running
    assert process.end() == 0, process.output
    assert "Traceback" not in process.output
    with AnyReader([process.run_directory]) as reader:
        found = {item.topic: item for item in reader.connections}
    assert {"/js", "/desk", "/south/clock", f"{TWIN}/cable"} <= found.keys()
    assert not {"/clock", f"{TWIN}/joint_states", f"{TWIN}/joint_commands"} & found.keys()
    (quality,) = found[f"{TWIN}/cable"].ext.offered_qos_profiles
    assert (quality.reliability.name, quality.depth) == ("BEST_EFFORT", 3)
    log = read_log(bag(process.run_directory))
    topics = {topic for topic, *_ in log.messages()}
    assert {"joint_states", "joint_commands", "/clock", "cable"} <= topics
    assert len(list(log.messages(["joint_states"]))) > 100
    replayed(process.run_directory)
