"""Messages of a frame: filled templates against the typestore's encoding of the same records."""

from __future__ import annotations

import math
from importlib import import_module

import numpy as np
import pytest
from hand_made_snapshot import body_in_plane, snapshot_of

from cable_twin.frame.records import (
    AppliedCommand,
    CableSamples,
    CarriageState,
    Command,
    DriveState,
    RefusedCommand,
    SupportState,
)
from cable_twin.frame.snapshot import Snapshot
from cable_twin.messages import (
    SECOND,
    TYPESTORE,
    FrameNames,
    Header,
    MessageEncoder,
    Status,
    clock_message,
    decode,
    diagnostics_message,
    header,
    refused_command_from_message,
    refused_command_message,
    scenario_from_message,
    scenario_message,
    serialize,
    statuses_of_message,
    topics,
)
from cable_twin.messages.cdr import STAMP, Template, marks
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.messages.frame import Point, Pose, Quaternion, Vector3, Wrench
from cable_twin.messages.topics import JointState, Path, PoseArray, PoseStamped, WrenchStamped
from cable_twin.ros.rviz import static_transforms
from cable_twin.scenario import load_scenario

EPOCH = 1_700_000_000_123_456_789
OWN = ("chair_2",)


def make_snapshot(time: float, samples: int = 5, carriers: int = 3) -> Snapshot:
    """Snapshot of a cabin of two bodies, a load without bodies and chairs, with distinct numbers."""
    places = [np.array([3.25, 0.0, 0.75]), np.array([1.25, 0.0, 0.5])]
    cabin = {"hanger": body_in_plane(1.25, -0.5, 0.3, spin=-0.02), "cabin": body_in_plane(1.5, -0.75, -0.1, spin=0.04)}
    carriages = {
        "cabin": CarriageState(3.5, 6.0, 120.0, np.array([1.0, 0.0, 2.0]), places[0], cabin),
        "load": CarriageState(1.5, 0.0, 0.0, np.array([3.0, 0.0, 4.0]), places[1], {}),
    }
    for number in range(1, carriers + 1):
        body = {"chair": body_in_plane(10.0 * number, -number, 0.01 * number, spin=0.1 * number)}
        force, place = np.array([0.5 * number, 0.0, 5e3 + number]), np.array([10.0 * number, 0.0, 2.0 * number])
        carriages[f"chair_{number}"] = CarriageState(4.0 * number, 2.5, 7.0 * number, force, place, body)
    arc_lengths = np.linspace(0.0, 4.0, samples)
    positions = np.column_stack([np.linspace(0.0, 3.0, samples), np.linspace(0.0, -1.0, samples)])
    cable = CableSamples(arc_lengths, positions, np.linspace(900.0, 1000.0, samples))
    supports = {name: SupportState(np.array([k - 900.0, 30.0 * k])) for k, name in enumerate(("start", "end", "tower"))}
    drives = {"haul_rope": DriveState(12.5, 2.5, 1e4)}
    return snapshot_of(time, carriages, supports, cable, drives, carriers=carriers)


def frame_at(time: float, carriers: int = 3, **options) -> dict[str, bytes]:
    snapshot = make_snapshot(time, carriers=carriers)
    encoder = MessageEncoder(snapshot.layout, EPOCH, own=OWN, **options)
    return dict(encoder.frame(snapshot, [name for name in encoder.topics if name != "/clock"]))


TYPES = {topic.name: topic.type for topic in topics(make_snapshot(0.0).layout, own=OWN, clock=True, tf=True)}


def test_a_frame_has_every_topic_that_is_in_a_group():
    table = topics(make_snapshot(0.0).layout, own=OWN, tf=True)
    assert set(frame_at(0.0)) == {topic.name for topic in table if topic.group}


def test_joint_states_list_vehicles_and_drives_before_the_joints_of_bodies():
    """Joint of each body with the body above, under a name valid in a URDF."""
    message = decode(frame_at(1.5)["joint_states"], TYPES["joint_states"])
    vehicles = ["cabin", "load", "chair_1", "chair_2", "chair_3"]
    joints = ["cabin_hanger", "cabin_cabin", "chair_1_chair", "chair_2_chair", "chair_3_chair"]
    assert message.name == [*vehicles, "haul_rope", *joints]
    expected = JointState(
        header(EPOCH + 1_500_000_000),
        message.name,
        np.array([3.5, 1.5, 4.0, 8.0, 12.0, 12.5, 0.3, -0.1 - 0.3, 0.01, 0.02, 0.03]),
        np.array([6.0, 0.0, 2.5, 2.5, 2.5, 2.5, -0.02, 0.04 + 0.02, 0.1, 0.2, 0.1 * 3]),
        np.array([120.0, 0.0, 7.0, 14.0, 21.0, 1e4, 0.0, 0.0, 0.0, 0.0, 0.0]),
    )
    assert frame_at(1.5)["joint_states"] == serialize(expected)


@pytest.mark.parametrize("frames", [FrameNames(), FrameNames("south/map", "south/")])
def test_every_message_of_a_frame_has_its_time_and_the_frame_that_its_numbers_are_in(frames):
    """Forces in the coordinate frame of the loaded object, at which viewers draw them."""
    for name, data in frame_at(1.23, frames=frames).items():
        message = decode(data, TYPES[name])
        for one in message.transforms if name == "/tf" else [message]:
            assert one.header.stamp.sec * SECOND + one.header.stamp.nanosec == EPOCH + 1_230_000_000
            at_it = name.endswith("force") and f"{frames.frame_prefix}{name.split('/')[1]}"
            assert one.header.frame_id == (at_it or frames.frame_id)


@pytest.mark.parametrize(
    ("topic", "force"),
    [
        ("carriages/cabin/contact_force", (1.0, 0.0, 2.0)),
        ("carriages/chair_2/contact_force", (1.0, 0.0, 5002.0)),
        ("supports/end/force", (-899.0, 0.0, 30.0)),
    ],
)
def test_forces_are_what_the_typestore_writes(topic, force):
    wrench = Wrench(Vector3(*force), Vector3(0.0, 0.0, 0.0))
    head = header(EPOCH + 1_230_000_000, topic.split("/")[1])
    assert frame_at(1.23)[topic] == serialize(WrenchStamped(head, wrench))


def test_cable_points():
    message = decode(frame_at(0.0)["cable"], TYPES["cable"])
    points = message.data.view("<f4").reshape(-1, 5)
    snapshot = make_snapshot(0.0)
    assert [field.name for field in message.fields] == ["x", "y", "z", "arc_length", "tension"]
    assert (message.width, message.height, message.point_step, message.row_step) == (5, 1, 20, 100)
    np.testing.assert_array_equal(points[:, :3], snapshot.cable.positions.astype("f4"))
    np.testing.assert_array_equal(points[:, 3], snapshot.cable.arc_lengths.astype("f4"))
    np.testing.assert_array_equal(points[:, 4], snapshot.cable.tensions.astype("f4"))


def test_poses_of_carriers_are_those_of_all_their_bodies_in_the_order_of_joint_states():
    snapshot = make_snapshot(0.0)
    bodies = [snapshot.carriages[f"chair_{number}"].bodies["chair"] for number in (1, 2, 3)]
    poses = [Pose(Point(*body.position), Quaternion(*body.orientation)) for body in bodies]
    assert frame_at(0.0)["carriers/poses"] == serialize(PoseArray(header(EPOCH), poses))


def test_forces_of_carriers_are_at_their_joints():
    message = decode(frame_at(0.0)["carriers/forces"], TYPES["carriers/forces"])
    assert [field.name for field in message.fields] == ["x", "y", "z", "fx", "fy", "fz"]
    points = message.data.view("<f4").reshape(-1, 6)
    np.testing.assert_array_equal(points[1], np.array([20.0, 0.0, 4.0, 1.0, 0.0, 5002.0], "f4"))


@pytest.mark.parametrize("carriers", [1, 2, 28])
def test_a_chair_with_a_topic_of_its_own_is_where_it_is_among_all(carriers):
    frame = frame_at(0.0, carriers=max(carriers, 2))
    array = decode(frame["carriers/poses"], TYPES["carriers/poses"]).poses[1]
    assert decode(frame["carriages/chair_2/chair/pose"], "geometry_msgs/msg/PoseStamped").pose == array


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


@pytest.mark.parametrize("samples", [2, 3, 200])
def test_a_path_that_is_filled_again_equals_the_plain_way(samples):
    encoder = MessageEncoder(make_snapshot(0.0, samples).layout, EPOCH)
    for time in (0.0, 0.7):
        snapshot = make_snapshot(time, samples)
        head = header(EPOCH + round(time * 1e9))
        poses = [
            PoseStamped(head, Pose(Point(*map(float, place)), Quaternion(0.0, 0.0, 0.0, 1.0)))
            for place in snapshot.cable.positions
        ]
        assert dict(encoder.frame(snapshot))["cable_path"] == serialize(Path(head, poses))


def test_a_message_stays_as_it_is_when_the_next_one_is_encoded():
    snapshot = make_snapshot(0.0)
    encoder = MessageEncoder(snapshot.layout, EPOCH)
    first = dict(encoder.frame(snapshot))
    encoder.frame(make_snapshot(0.3))
    assert first == dict(MessageEncoder(snapshot.layout, EPOCH).frame(snapshot))


def test_equal_snapshots_give_equal_bytes():
    assert frame_at(0.1) == frame_at(0.1)


def test_transforms_name_bodies_under_their_vehicle():
    message = decode(frame_at(0.0)["/tf"], TYPES["/tf"])
    children = [transform.child_frame_id for transform in message.transforms]
    assert children[:5] == ["cabin", "cabin/hanger", "cabin/cabin", "load", "chair_1"]
    hanger = message.transforms[1].transform
    assert (hanger.translation.x, hanger.translation.z, hanger.rotation.y) == (1.25, -0.5, math.sin(0.15))
    again = decode(frame_at(0.0, frames=FrameNames("map", "south/"))["/tf"], TYPES["/tf"])
    assert [transform.child_frame_id for transform in again.transforms] == [f"south/{child}" for child in children]
    chair = message.transforms[children.index("chair_3/chair")].transform
    assert (chair.translation.x, chair.translation.z, chair.rotation.w) == (30.0, -3.0, math.cos(0.5 * 0.03))


def test_a_template_that_does_not_fit_its_sources_says_so():
    nothing = np.zeros(0)
    with pytest.raises(ValueError, match="given 3 numbers; allowed: 2"):
        Template(JointState(Header(STAMP, "map"), ["a", "b"], marks(2), nothing, nothing), [np.zeros(3)])
    without = JointState(header(0), ["a"], marks(1), nothing, nothing)
    with pytest.raises(ValueError, match="given no stamp"):
        Template(without, [np.zeros(1)])


def test_scenario_round_trip():
    scenario = {"description": "Bergbahn Süd", "cable": {"elements": 48, "damping_time": 0.1}, "loads": []}
    assert scenario_from_message(scenario_message(scenario)) == scenario


def test_diagnostics_round_trip():
    statuses = [Status(1, "a", "late", {"lag (s)": "0.2"}), Status(0, "b", "", {})]
    assert statuses_of_message(diagnostics_message(EPOCH, *statuses)) == statuses


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


REFUSED = RefusedCommand(0.25, "joint_commands", "speed of 'cabin' is 99 m/s", 3)


def test_a_refused_command_comes_back_from_its_message():
    data = refused_command_message(REFUSED, EPOCH)
    assert refused_command_from_message(data, REFUSED.time) == REFUSED
    assert str(REFUSED) == "at 0.25 s from joint_commands: speed of 'cabin' is 99 m/s"


def every_message() -> dict[str, bytes]:
    applied = AppliedCommand(0.25, Command("force", {"cabin": 12.5}), "script")
    return {
        **frame_at(0.5),
        "scenario": scenario_message({"description": "ü"}),
        "joint_commands": applied_command_message(applied, EPOCH),
        "payload": applied_command_message(AppliedCommand(0.0, Command("payload", {"cabin": 80.0}), "desk"), EPOCH),
        "wind": serialize(
            TYPESTORE.types["geometry_msgs/msg/Vector3Stamped"](header(1_000_000_002), Vector3(3.0, 0.0, -1.0))
        ),
        "temperature": serialize(TYPESTORE.types["sensor_msgs/msg/Temperature"](header(1_000_000_002), -5.0, 0.0)),
        "applied_commands": applied_command_message(applied, EPOCH),
        "refused_commands": refused_command_message(REFUSED, EPOCH),
        "key_figures": diagnostics_message(EPOCH, *(Status(0, name, "1 m", {"unit": "m"}) for name in ("a", "b"))),
        "/diagnostics": diagnostics_message(
            EPOCH, Status(1, "cable_twin", "late", {"lag (s)": "0.2", "missed frames": "3"})
        ),
        "/clock": clock_message(EPOCH),
        "/tf_static": static_transforms(load_scenario("seed_example"), EPOCH),
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
