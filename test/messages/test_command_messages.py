"""Conversion of commands to messages and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.frame.records import AppliedCommand, Command, CommandError, Goal
from cable_twin.messages import FrameNames, Header, JointState, Time, decode, header, serialize
from cable_twin.messages.command_messages import (
    applied_command_from_message,
    applied_command_message,
    command_from_joint_state,
    command_from_message,
    command_from_vector,
)
from cable_twin.recording.frame_output import FrameOutput
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

EPOCH = 1_700_000_000_123_456_789


@pytest.mark.parametrize(
    "applied",
    [
        AppliedCommand(0.0, Command("speed", {"cabin": 6.000000000000001}), "joint_commands"),
        AppliedCommand(1234.567891, Command("force", {"load": -1e-300, "cabin": 0.1}), "script"),
        AppliedCommand(0.2, Command("payload", {"cabin": 640.0, "load": 0.1}), "payload"),
        AppliedCommand(0.2, Command("wind", {"x": -12.3, "z": 0.7}), "wind"),
        AppliedCommand(0.2, Command("temperature", {"ropes": -5.5}), "temperature"),
        AppliedCommand(0.3, Command("emergency_stop", {}), "service"),
        AppliedCommand(86_400.000001, Command("release", {}), "service"),
        AppliedCommand(0.000001, Command("reset", {}), "odd:source"),
        AppliedCommand(2.0, Command("speed", {"cabin": 0.0}), "command_timeout"),
    ],
)
def test_applied_command_round_trip_is_exact(applied):
    data = applied_command_message(applied, EPOCH)
    assert applied_command_from_message(data, EPOCH) == applied
    assert applied_command_message(applied_command_from_message(data, EPOCH), EPOCH) == data


def test_times_of_whole_microseconds_survive():
    for micros in np.random.default_rng(1).integers(0, 10**12, 2000).tolist():
        applied = AppliedCommand(micros / 10**6, Command("reset", {}), "service")
        assert applied_command_from_message(applied_command_message(applied, EPOCH), EPOCH) == applied


@pytest.mark.parametrize("names", [["cabin"], ["speed"], [], ["speed/cabin"], ["speed/a/b", "force/a/b"], ["jump/a/b"]])
def test_foreign_message_is_no_applied_command(names):
    with pytest.raises(ValueError, match="KIND/NAME/SOURCE"):
        applied_command_from_message(serialize(JointState(header(EPOCH), names, *[np.zeros(len(names))] * 3)), EPOCH)


def test_applied_command_names_its_frame_and_has_its_numbers_by_kind_name_and_source():
    applied = AppliedCommand(0.5, Command("speed", {"a": 1.0, "b": -2.0}), "joint_commands")
    message = decode(applied_command_message(applied, EPOCH), JointState.__msgtype__)
    assert message.header.frame_id == "map"
    simulation = Simulation(load_scenario("seed_example"))
    output = FrameOutput(simulation, [], [{}], frame_rate=100.0, frames=FrameNames("valley"))
    assert decode(output.command(applied), JointState.__msgtype__).header.frame_id == "valley"
    assert message.name == ["speed/a/joint_commands", "speed/b/joint_commands"]
    assert message.velocity.tolist() == [1.0, -2.0]


NOT = math.nan


@pytest.mark.parametrize(
    ("names", "fields", "expected"),
    [
        (["a", "b"], ([], [1.5, NOT], []), Command("speed", {"a": 1.5})),
        (["a", "a_hanger", "b"], ([NOT] * 3, [1.5, NOT, -2.0], [NOT] * 3), Command("speed", {"a": 1.5, "b": -2.0})),
        (["a", "b"], ([NOT, NOT], [NOT, NOT], [NOT, 40e3]), Command("force", {"b": 40e3})),
    ],
)
def test_joints_that_are_named_with_nan_are_not_commanded(names, fields, expected):
    """Messages of a ros2_control hardware on topics, with all its joints in each."""
    assert command_from_joint_state(JOINT_COMMANDS, names, *fields) == expected


@pytest.mark.parametrize(
    ("names", "fields", "expected"),
    [
        (["a"], ([7.0], [], []), Goal({"a": 7.0}, {})),
        (["a", "b"], ([7.0, 8.0], [NOT, -3.0], []), Goal({"a": 7.0, "b": 8.0}, {"b": 3.0})),
        (["a", "b"], ([7.0, NOT], [NOT, NOT], [NOT, NOT]), Goal({"a": 7.0}, {})),
    ],
)
def test_positions_are_places_to_go_to(names, fields, expected):
    assert command_from_joint_state(JOINT_COMMANDS, names, *fields) == expected


@pytest.mark.parametrize(
    ("names", "fields", "complaint"),
    [
        (["a"], ([], [NOT], []), "velocity of 'a' is nan; give a finite number"),
        (["a", "b"], ([], [NOT, NOT], []), "velocity of 'a' is nan"),
        (["a", "b"], ([], [1.0, math.inf], []), "velocity of 'b' is inf"),
        (["a", "b"], ([], [1.0, NOT], [NOT, 5.0]), "both velocity and effort"),
        (["a", "b"], ([7.0, NOT], [NOT, 1.0], []), "position of 'b' is nan"),
        (["a"], ([7.0], [], [1.0]), "position and effort; give position"),
        (["a", "a"], ([7.0, 8.0], [], []), "'a' more than once"),
        (["a"], ([7.0, 8.0], [], []), "1 names and 2 of position"),
        (["a"], ([math.inf], [], []), "position of 'a' is inf"),
        (["a", "a", "b"], ([], [1.0, 2.0, NOT], []), "more than once"),
        (["a", "b"], ([], [1.0, NOT, NOT], []), "2 names and 3 values of velocity"),
    ],
)
def test_what_is_commanded_beside_nan_has_to_be_clear(names, fields, complaint):
    with pytest.raises(CommandError, match=complaint):
        command_from_joint_state(JOINT_COMMANDS, names, *fields)


@pytest.mark.parametrize("make", [list, np.array])
def test_commands_understood(make):
    speed = command_from_joint_state(JOINT_COMMANDS, ["a", "b"], make([]), make([1.0, -2.0]), make([]))
    assert speed == Command("speed", {"a": 1.0, "b": -2.0})
    assert command_from_joint_state(JOINT_COMMANDS, ["a"], make([]), make([]), make([5.0])) == Command(
        "force", {"a": 5.0}
    )


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (([], [], [1.0], []), "without names"),
        ((["a"], [], [], []), "with neither position, velocity nor effort; give one of"),
        ((["a"], [], [1.0], [1.0]), "both velocity and effort"),
        ((["a", "b"], [], [1.0], []), "2 names and 1 values of velocity"),
        ((["a"], [], [], [1.0, 2.0]), "1 names and 2 values of effort"),
        ((["a", "a"], [], [1.0, 2.0], []), "'a' more than once"),
        ((["a"], [], [math.nan], []), r"velocity of 'a' is nan.*m/s"),
        ((["a"], [], [], [-math.inf]), r"effort of 'a' is -inf.*\(N\)"),
    ],
)
def test_commands_refused_in_one_line(given, complaint):
    with pytest.raises(CommandError, match=complaint) as caught:
        command_from_joint_state(JOINT_COMMANDS, *given)
    assert "\n" not in str(caught.value)


def test_payload_understood():
    assert command_from_joint_state("payload", ["a", "b"], [], [], [640.0, 0.0]) == Command(
        "payload", {"a": 640.0, "b": 0.0}
    )


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (([], [], [], []), r"0 names.*mass \(kg\)"),
        ((["a"], [], [], []), "0 values of effort"),
        ((["a"], [], [2.0], []), "1 velocities"),
        ((["a"], [1.0], [], [2.0]), "1 positions"),
        ((["a", "a"], [], [], [1.0, 2.0]), "more than once"),
        ((["a"], [], [], [np.nan]), "finite"),
    ],
)
def test_payloads_refused_in_one_line(given, complaint):
    with pytest.raises(CommandError, match=complaint) as caught:
        command_from_joint_state("payload", *given)
    assert "\n" not in str(caught.value)


def test_a_temperature_comes_as_degrees_celsius():
    header = Header(Time(0, 0), "")
    data = serialize(ros2_jazzy.sensor_msgs__msg__Temperature(header, -5.5, 0.0))
    assert command_from_message("temperature", data, 1) == Command("temperature", {"ropes": -5.5})


def test_wind_across_the_track_is_named_where_there_is_some():
    assert command_from_vector("wind", -3.0, 0.0, 0.5) == Command("wind", {"x": -3.0, "z": 0.5})
    assert command_from_vector("wind", 1.0, 2.0, 0.0) == Command("wind", {"x": 1.0, "y": 2.0, "z": 0.0})
