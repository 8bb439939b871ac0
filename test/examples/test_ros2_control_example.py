"""Example for ros2_control: names and limits of its joints are those of the scenario, its topics those of the twin."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.messages import JOINT_STATES
from cable_twin.ros.parameter_table import PARAMETERS
from cable_twin.scenario import load_scenario

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "ros2_control"
SCENARIO = load_scenario("aerial_tramway")
ROBOT = ElementTree.parse(EXAMPLE / "aerial_tramway.urdf").getroot()
HARDWARE = ROBOT.find("ros2_control")
CONTROLLERS = YAML(typ="safe").load((EXAMPLE / "controllers.yaml").read_text(encoding="utf-8"))
COMMANDED = [joint.get("name") for joint in HARDWARE.findall("joint")]


def test_only_what_is_commanded_is_a_joint():
    """The hardware interface sends all its joints in one message, with NaN for those without a command."""
    assert list(SCENARIO.carriages) == COMMANDED
    assert {joint.get("name") for joint in ROBOT.findall("joint")} == set(COMMANDED)
    for joint in HARDWARE.findall("joint"):
        assert [one.get("name") for one in joint.findall("command_interface")] == ["velocity"]
        assert {one.get("name") for one in joint.findall("state_interface")} == {"position", "velocity", "effort"}


def test_each_command_is_sent_to_the_topics_of_the_twin():
    given = {one.get("name"): one.text for one in HARDWARE.findall("hardware/param")}
    assert given == {
        "joint_commands_topic": f"/cable_twin/{JOINT_COMMANDS}",
        "joint_states_topic": f"/cable_twin/{JOINT_STATES}",
        "trigger_joint_command_threshold": "-1",
    }
    plugin = HARDWARE.findtext("hardware/plugin")
    assert plugin == "joint_state_topic_hardware_interface/JointStateTopicSystem"


def test_limits_are_those_of_the_scenario():
    (joint,) = ROBOT.findall("joint")
    limits = SCENARIO.carriages["cabin"].drive.limits
    limit = {key: float(value) for key, value in joint.find("limit").attrib.items()}
    length = SCENARIO.cable.unstrained_length
    assert limit == {"lower": 0.0, "upper": length, "velocity": limits.speed, "effort": limits.force}
    links = {link.get("name") for link in ROBOT.findall("link")}
    assert {joint.find("parent").get("link"), joint.find("child").get("link")} == links


def test_controllers_drive_these_joints_and_more_often_than_the_twin_waits():
    manager = CONTROLLERS["controller_manager"]["ros__parameters"]
    timeout = next(one.default for one in PARAMETERS if one.name == "command_timeout")
    assert manager.pop("update_rate") > 2.0 / timeout
    assert set(manager) == set(CONTROLLERS) - {"controller_manager"}
    for name in manager:
        parameters = CONTROLLERS[name]["ros__parameters"]
        assert parameters["joints"] == COMMANDED
    states = {one.get("name") for one in HARDWARE.findall("joint/state_interface")}
    assert set(CONTROLLERS["joint_state_broadcaster"]["ros__parameters"]["interfaces"]) == states


@pytest.mark.parametrize("kind", ["sliding"])
def test_the_carriage_can_be_driven(kind):
    assert SCENARIO.carriages["cabin"].joint == kind
    assert SCENARIO.carriages["cabin"].drive.mode == "speed"
