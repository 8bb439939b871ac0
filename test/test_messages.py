from __future__ import annotations

import math
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.command_messages import (
    applied_command_from_message,
    applied_command_message,
    command_from_joint_state,
    payload_from_joint_state,
    wind_from_vector,
)
from cable_twin.messages import (
    PATH_PERIOD,
    SECOND,
    TYPESTORE,
    Header,
    MessageEncoder,
    Path,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Status,
    Time,
    Vector3,
    Vector3Stamped,
    WrenchStamped,
    clock_message,
    decode,
    diagnostics_message,
    full_name,
    scenario_from_message,
    scenario_message,
    serialize,
    topics,
)
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    Command,
    CommandError,
    Snapshot,
    SolverReport,
    SupportState,
)

Wrench = ros2_jazzy.geometry_msgs__msg__Wrench
CARRIAGES = {"cabin": ("hanger", "cabin"), "load": ()}
EPOCH = 1_700_000_000_123_456_789


def make_snapshot(time: float, samples: int = 5) -> Snapshot:
    body = BodyState(1.25, -0.5, 0.3, 0.1, 0.0, -0.02)
    force = np.array([1.0, 2.0])
    cabin = CarriageState(
        3.5, 6.0, 120.0, force, np.array([3.25, 0.75]), {"hanger": body, "cabin": replace(body, pitch=-0.1)}
    )
    load = CarriageState(1.5, 0.0, 0.0, force, np.array([1.25, 0.5]), {})
    arc_lengths = np.linspace(0.0, 4.0, samples)
    positions = np.column_stack([np.linspace(0.0, 3.0, samples), np.linspace(0.0, -1.0, samples)])
    cable = CableSamples(arc_lengths, positions, np.linspace(900.0, 1000.0, samples))
    supports = {"start": SupportState(np.array([-900.0, 30.0])), "end": SupportState(np.array([950.0, 70.0]))}
    return Snapshot(time, {"cabin": cabin, "load": load}, supports, cable, SolverReport(1, 2, 0, 1e-12))


def frame_at(time: float) -> dict[str, bytes]:
    return dict(MessageEncoder(CARRIAGES, EPOCH).frame(make_snapshot(time)))


TYPES = {topic.name: topic.type for topic in topics(CARRIAGES, clock=True, tf=True)}


def test_topics_hold_everything_a_frame_gives_and_nothing_twice():
    table = topics(CARRIAGES, clock=True, tf=True)
    assert len({topic.name for topic in table}) == len(table)
    assert set(frame_at(0.0)) == {topic.name for topic in table} - {
        "scenario",
        "joint_commands",
        "payload",
        "wind",
        "applied_commands",
        "key_figures",
        "/diagnostics",
        "/clock",
        "/tf",
    }
    assert {topic.name for topic in table} - {topic.name for topic in topics(CARRIAGES)} == {"/clock", "/tf"}
    assert next(topic for topic in table if topic.name == "scenario").durability == "transient_local"


def test_full_names_follow_the_node():
    assert full_name("joint_states") == "/cable_twin/joint_states"
    assert full_name("joint_states", "/site/twin") == "/site/twin/joint_states"
    assert full_name("/tf", "/site/twin") == "/tf"


def test_joint_states_list_carriages_before_bodies():
    message = decode(frame_at(1.5)["joint_states"], TYPES["joint_states"])
    assert message.name == ["cabin", "load", "cabin/hanger", "cabin/cabin"]
    assert message.position.tolist() == [3.5, 1.5, 0.3, -0.1]
    assert message.velocity.tolist() == [6.0, 0.0, -0.02, -0.02]
    assert message.effort.tolist() == [120.0, 0.0, 0.0, 0.0]


def test_every_message_of_a_frame_has_the_stamp_of_its_simulated_time():
    for name, data in frame_at(1.23).items():
        header = decode(data, TYPES[name]).header
        assert header.stamp.sec * SECOND + header.stamp.nanosec == EPOCH + 1_230_000_000
        assert header.frame_id == "map"


@pytest.mark.parametrize(
    ("topic", "force"),
    [("carriages/cabin/contact_force", (1.0, 0.0, 2.0)), ("supports/end/force", (950.0, 0.0, 70.0))],
)
def test_packed_forces_are_what_the_typestore_writes(topic, force):
    stamp = Time(*divmod(EPOCH + 1_230_000_000, SECOND))
    wrench = Wrench(Vector3(*force), Vector3(0.0, 0.0, 0.0))
    assert frame_at(1.23)[topic] == serialize(WrenchStamped(Header(stamp, "map"), wrench))


def test_cable_points():
    message = decode(frame_at(0.0)["cable"], TYPES["cable"])
    points = message.data.view("<f4").reshape(-1, 5)
    snapshot = make_snapshot(0.0)
    assert [field.name for field in message.fields] == ["x", "y", "z", "arc_length", "tension"]
    assert (message.width, message.height, message.point_step, message.row_step) == (5, 1, 20, 100)
    np.testing.assert_array_equal(points[:, [0, 2]], snapshot.cable.positions.astype("f4"))
    np.testing.assert_array_equal(points[:, 1], 0.0)
    np.testing.assert_array_equal(points[:, 3], snapshot.cable.arc_lengths.astype("f4"))
    np.testing.assert_array_equal(points[:, 4], snapshot.cable.tensions.astype("f4"))


def test_pose_turns_x_towards_minus_z_for_positive_pitch():
    pose = decode(frame_at(0.0)["carriages/cabin/hanger/pose"], TYPES["carriages/cabin/hanger/pose"]).pose
    q = pose.orientation
    assert (pose.position.x, pose.position.y, pose.position.z) == (1.25, 0.0, -0.5)
    x_axis = [1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y)]
    np.testing.assert_allclose(x_axis, [math.cos(0.3), 0.0, -math.sin(0.3)], atol=1e-15)


def test_carriage_pose_is_its_joint_point():
    pose = decode(frame_at(0.0)["carriages/cabin/pose"], TYPES["carriages/cabin/pose"]).pose
    assert (pose.position.x, pose.position.y, pose.position.z) == (3.25, 0.0, 0.75)
    assert (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w) == (0, 0, 0, 1)


@pytest.mark.parametrize("samples", [0, 1, 2, 200])
def test_path_filled_in_place_equals_the_plain_way(samples):
    encoder = MessageEncoder(CARRIAGES, EPOCH)
    for time in (0.0, 0.7):  # the second one fills the template a second time
        snapshot = make_snapshot(time, samples)
        header = Header(Time(*divmod(EPOCH + round(time * 1e9), SECOND)), "map")
        poses = [
            PoseStamped(header, Pose(Point(float(x), 0.0, float(z)), Quaternion(0.0, 0.0, 0.0, 1.0)))
            for x, z in snapshot.cable.positions
        ]
        assert dict(encoder.frame(snapshot))["cable_path"] == serialize(Path(header, poses))


@pytest.mark.parametrize("rate", [7, 60, 100, 250])
def test_path_comes_once_in_each_tenth_of_a_simulated_second(rate):
    encoder = MessageEncoder(CARRIAGES, EPOCH)
    times = [count / rate for count in range(3 * rate)]
    given = [time for time in times if "cable_path" in dict(encoder.frame(make_snapshot(time)))]
    tenths = [round(time * SECOND) // PATH_PERIOD for time in given]
    assert tenths == sorted({round(time * SECOND) // PATH_PERIOD for time in times})
    assert given[0] == 0.0


def test_equal_snapshots_give_equal_bytes():
    assert frame_at(0.1) == frame_at(0.1)


def test_transforms_name_bodies_under_their_carriage():
    message = decode(MessageEncoder(CARRIAGES, EPOCH).transforms(make_snapshot(0.0)), TYPES["/tf"])
    assert [transform.child_frame_id for transform in message.transforms] == [
        "cabin",
        "cabin/hanger",
        "cabin/cabin",
        "load",
    ]
    assert {transform.header.frame_id for transform in message.transforms} == {"map"}


def test_scenario_round_trip():
    scenario = {"description": "Bergbahn Süd", "cable": {"elements": 48, "damping_time": 0.1}, "loads": []}
    assert scenario_from_message(scenario_message(scenario)) == scenario


@pytest.mark.parametrize(
    "applied",
    [
        AppliedCommand(0.0, Command("speed", {"cabin": 6.000000000000001}), "joint_commands"),
        AppliedCommand(1234.567891, Command("force", {"load": -1e-300, "cabin": 0.1}), "script"),
        AppliedCommand(0.2, Command("payload", {"cabin": 640.0, "load": 0.1}), "payload"),
        AppliedCommand(0.2, Command("wind", {"x": -12.3, "z": 0.7}), "wind"),
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


def test_foreign_message_is_no_applied_command():
    with pytest.raises(ValueError, match="KIND:SOURCE"):
        applied_command_from_message(frame_at(0.0)["joint_states"], EPOCH)


@pytest.mark.parametrize("make", [list, np.array])
def test_commands_understood(make):
    speed = command_from_joint_state(["a", "b"], make([]), make([1.0, -2.0]), make([]))
    assert speed == Command("speed", {"a": 1.0, "b": -2.0})
    assert command_from_joint_state(["a"], make([]), make([]), make([5.0])) == Command("force", {"a": 5.0})


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (([], [], [1.0], []), "without names"),
        ((["a"], [1.0], [1.0], []), "1 positions"),
        ((["a"], [], [], []), "neither velocity nor effort"),
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
        command_from_joint_state(*given)
    assert "\n" not in str(caught.value)


def test_payload_understood():
    assert payload_from_joint_state(["a", "b"], [], [], [640.0, 0.0]) == Command("payload", {"a": 640.0, "b": 0.0})


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
        payload_from_joint_state(*given)
    assert "\n" not in str(caught.value)


def test_wind_is_in_the_plane_of_the_track():
    assert wind_from_vector(-3.0, 0.0, 0.5) == Command("wind", {"x": -3.0, "z": 0.5})
    with pytest.raises(CommandError, match=r"wind y is 2 m/s; allowed is 0"):
        wind_from_vector(1.0, 2.0, 0.0)


def plain(value):
    """Message of rosbags or rclpy as plain Python values."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, "__dataclass_fields__"):
        names = [name for name in value.__dataclass_fields__ if not name.isupper() and not name.startswith("__")]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, bytes):  # a `byte` field
        return value[0]
    if isinstance(value, str | int | float | np.number):
        return value
    return [plain(item) for item in value]


def every_message() -> dict[str, bytes]:
    encoder = MessageEncoder(CARRIAGES, EPOCH)
    applied = AppliedCommand(0.25, Command("force", {"cabin": 12.5}), "script")
    return {
        **dict(encoder.frame(make_snapshot(0.5))),
        "scenario": scenario_message({"description": "ü"}),
        "joint_commands": applied_command_message(applied, EPOCH),
        "payload": applied_command_message(AppliedCommand(0.0, Command("payload", {"cabin": 80.0}), "desk"), EPOCH),
        "wind": serialize(Vector3Stamped(Header(Time(1, 2), "map"), Vector3(3.0, 0.0, -1.0))),
        "applied_commands": applied_command_message(applied, EPOCH),
        "key_figures": diagnostics_message(EPOCH, *(Status(0, name, "1 m", {"unit": "m"}) for name in ("a", "b"))),
        "/diagnostics": diagnostics_message(
            EPOCH, Status(1, "cable_twin", "late", {"lag (s)": "0.2", "missed frames": "3"})
        ),
        "/clock": clock_message(EPOCH),
        "/tf": encoder.transforms(make_snapshot(0.5)),
    }


def test_every_topic_has_its_message():
    assert set(every_message()) == set(TYPES)


@pytest.mark.parametrize("topic", sorted(TYPES))
def test_rclpy_reads_the_same_values(topic):
    serialization = pytest.importorskip("rclpy.serialization")
    package, _, name = TYPES[topic].split("/")
    if package == "tf2_msgs":
        pytest.importorskip("tf2_msgs.msg")  # not among the wheels
    message_class = getattr(import_module(f"{package}.msg"), name)
    data = every_message()[topic]
    assert plain(serialization.deserialize_message(data, message_class)) == plain(decode(data, TYPES[topic]))


def test_tf_in_its_parts_reads_the_same_in_rclpy():
    serialization = pytest.importorskip("rclpy.serialization")
    transform_class = import_module("geometry_msgs.msg").TransformStamped
    for transform in decode(every_message()["/tf"], TYPES["/tf"]).transforms:
        data = bytes(TYPESTORE.serialize_cdr(transform, transform.__msgtype__))
        assert plain(serialization.deserialize_message(data, transform_class)) == plain(transform)
