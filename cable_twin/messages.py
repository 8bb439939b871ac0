"""Topics, and records of the simulation as ROS 2 messages in CDR: no rclpy. Commands are in `command_messages`.

A message is built once; the same bytes go to the publisher (`publisher.publish(data)`) and into the log. The rosbags
typestore lays them out, so logs are written where no ROS exists. Padding is zero: equal records give equal bytes, and
a replay may compare bytes.

Frame `map`: x along the track, z up, y lateral (REP-103); a planar cable has y = 0. A stamp is the epoch of the run
plus simulated time, in nanoseconds: one clock for messages, tf and logs.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.records import CableSamples, Snapshot

Time = ros2_jazzy.builtin_interfaces__msg__Time
Header = ros2_jazzy.std_msgs__msg__Header
String = ros2_jazzy.std_msgs__msg__String
Clock = ros2_jazzy.rosgraph_msgs__msg__Clock
Point = ros2_jazzy.geometry_msgs__msg__Point
Vector3Stamped = ros2_jazzy.geometry_msgs__msg__Vector3Stamped
Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion
Pose = ros2_jazzy.geometry_msgs__msg__Pose
PoseStamped = ros2_jazzy.geometry_msgs__msg__PoseStamped
WrenchStamped = ros2_jazzy.geometry_msgs__msg__WrenchStamped
Transform = ros2_jazzy.geometry_msgs__msg__Transform
TransformStamped = ros2_jazzy.geometry_msgs__msg__TransformStamped
TFMessage = ros2_jazzy.tf2_msgs__msg__TFMessage
Path = ros2_jazzy.nav_msgs__msg__Path
JointState = ros2_jazzy.sensor_msgs__msg__JointState
PointCloud2 = ros2_jazzy.sensor_msgs__msg__PointCloud2
PointField = ros2_jazzy.sensor_msgs__msg__PointField
DiagnosticArray = ros2_jazzy.diagnostic_msgs__msg__DiagnosticArray
DiagnosticStatus = ros2_jazzy.diagnostic_msgs__msg__DiagnosticStatus
KeyValue = ros2_jazzy.diagnostic_msgs__msg__KeyValue

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)
NAMESPACE = "/cable_twin"
FRAME_ID = "map"
SUPPORTS = ("start", "end")
JOINT_STATES = "joint_states"
CABLE = "cable"
CABLE_PATH = "cable_path"
SCENARIO = "scenario"
JOINT_COMMANDS = "joint_commands"
PAYLOAD = "payload"
WIND = "wind"
APPLIED_COMMANDS = "applied_commands"
KEY_FIGURES = "key_figures"
DIAGNOSTICS = "/diagnostics"
CLOCK = "/clock"
TF = "/tf"

SECOND = 1_000_000_000  # ns
PATH_PERIOD = SECOND // 10  # ns, of simulated time
CABLE_FIELDS = ("x", "y", "z", "arc_length", "tension")


class Message(Protocol):
    """Any message class of the typestore."""

    __msgtype__: ClassVar[str]


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic: its name, relative to the node ("joint_states") or absolute ("/tf"), its type and its QoS."""

    name: str
    type: str  # such as "sensor_msgs/msg/JointState"
    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    depth: int = 10


def topics(
    carriages: Mapping[str, Sequence[str]],
    *,
    supports: Sequence[str] = SUPPORTS,
    clock: bool = False,
    tf: bool = False,
) -> tuple[Topic, ...]:
    """Tell what the twin publishes.

    Args:
        carriages: Names of the bodies by name of their carriage, in the order of the scenario.
        supports: Names of what holds the cable.
        clock: With `/clock`, off by default.
        tf: With `/tf`, only where tf2_msgs exists.

    Returns:
        Every topic, in a fixed order.
    """
    table = [
        Topic(SCENARIO, String.__msgtype__, durability="transient_local", depth=1),
        Topic(JOINT_COMMANDS, JointState.__msgtype__, depth=50),  # as received
        Topic(PAYLOAD, JointState.__msgtype__, depth=50),
        Topic(WIND, Vector3Stamped.__msgtype__, depth=50),
        Topic(APPLIED_COMMANDS, JointState.__msgtype__),
        Topic(JOINT_STATES, JointState.__msgtype__),
        Topic(CABLE, PointCloud2.__msgtype__),
        Topic(CABLE_PATH, Path.__msgtype__),
    ]
    for carriage, bodies in carriages.items():
        table.append(Topic(pose_topic(carriage), PoseStamped.__msgtype__))
        table += [Topic(pose_topic(carriage, body), PoseStamped.__msgtype__) for body in bodies]
        table.append(Topic(contact_force_topic(carriage), WrenchStamped.__msgtype__))
    table += [Topic(support_force_topic(support), WrenchStamped.__msgtype__) for support in supports]
    table.append(Topic(KEY_FIGURES, DiagnosticArray.__msgtype__))
    table.append(Topic(DIAGNOSTICS, DiagnosticArray.__msgtype__))
    if clock:
        table.append(Topic(CLOCK, Clock.__msgtype__, reliability="best_effort", depth=1))
    if tf:
        table.append(Topic(TF, TFMessage.__msgtype__, depth=100))
    return tuple(table)


def pose_topic(carriage: str, body: str | None = None) -> str:
    """Give the relative name of the pose topic of a carriage, or of one of its bodies."""
    return f"carriages/{carriage}/pose" if body is None else f"carriages/{carriage}/{body}/pose"


def contact_force_topic(carriage: str) -> str:
    """Give the relative name of the topic with the force (N) of the cable on a carriage."""
    return f"carriages/{carriage}/contact_force"


def support_force_topic(support: str) -> str:
    """Give the relative name of the topic with the force (N) of a support on the cable."""
    return f"supports/{support}/force"


def full_name(name: str, namespace: str = NAMESPACE) -> str:
    """Give the absolute name of a topic of the node whose full name is `namespace`."""
    return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"


def nanoseconds(time: float) -> int:
    """Convert simulated time (s) into nanoseconds."""
    return round(time * SECOND)


def decode(data: bytes, message_type: str) -> Any:
    """Read a message of the given type ("sensor_msgs/msg/JointState") into its rosbags dataclass."""
    return TYPESTORE.deserialize_cdr(data, message_type)


class MessageEncoder:
    """Messages of snapshots of one run.

    The encoder remembers when it last gave the cable path, so frames have to come in the order of their time.
    """

    def __init__(self, carriages: Mapping[str, Sequence[str]], epoch_ns: int, drives: Sequence[str] = ()) -> None:
        """Prepare what stays the same.

        Args:
            carriages: Names of the bodies by name of their carriage, in the order of the scenario.
            epoch_ns: Wall time (ns since 1970) of simulated time zero.
            drives: Names of the drives that move a cable.
        """
        self.epoch_ns = epoch_ns
        self._carriages = {name: tuple(bodies) for name, bodies in carriages.items()}
        self._drives = tuple(drives)
        self._joints = [*self._carriages, *self._drives]
        self._joints += [f"{name}/{body}" for name, bodies in self._carriages.items() for body in bodies]
        self._path_period = -1  # index of the period of simulated time in which the path was last given
        self._path: _PathTemplate | None = None

    def stamp_ns(self, snapshot: Snapshot) -> int:
        """Give the stamp (ns) of all messages of a snapshot."""
        return self.epoch_ns + nanoseconds(snapshot.time)

    def frame(self, snapshot: Snapshot) -> list[tuple[str, bytes]]:
        """Encode what is published every frame.

        Args:
            snapshot: The twin at the time of the frame.

        Returns:
            Pairs of relative topic name and CDR: joint states, cable, poses, forces, and the first time in each
            tenth of a simulated second the cable path.
        """
        stamp = self.stamp_ns(snapshot)
        header = _header(stamp)
        frame = [
            (JOINT_STATES, self._joint_states(snapshot, header)),
            (CABLE, _cable(snapshot.cable, header)),
        ]
        for name, bodies in self._carriages.items():
            carriage = snapshot.carriages[name]
            x, z = carriage.position[0], carriage.position[-1]
            frame.append((pose_topic(name), _pose(header, float(x), float(z), 0.0)))
            for body_name in bodies:
                body = carriage.bodies[body_name]
                frame.append((pose_topic(name, body_name), _pose(header, body.x, body.z, body.pitch)))
            frame.append((contact_force_topic(name), _force(stamp, carriage.contact_force)))
        for name, support in snapshot.supports.items():
            frame.append((support_force_topic(name), _force(stamp, support.force)))
        period = nanoseconds(snapshot.time) // PATH_PERIOD
        if period != self._path_period:
            self._path_period = period
            frame.append((CABLE_PATH, self._cable_path(snapshot.cable, stamp)))
        return frame

    def transforms(self, snapshot: Snapshot) -> bytes:
        """Encode tf2_msgs/TFMessage: `map` to each carriage ("cabin") and to each body ("cabin/hanger")."""
        header = _header(self.stamp_ns(snapshot))
        transforms = []
        for name, bodies in self._carriages.items():
            carriage = snapshot.carriages[name]
            x, z = carriage.position[0], carriage.position[-1]
            transforms.append(_transform(header, name, float(x), float(z), 0.0))
            for body_name in bodies:
                body = carriage.bodies[body_name]
                transforms.append(_transform(header, f"{name}/{body_name}", body.x, body.z, body.pitch))
        return serialize(TFMessage(transforms))

    def _joint_states(self, snapshot: Snapshot, header: Header) -> bytes:
        states = [snapshot.carriages[name] for name in self._carriages]
        drives = [snapshot.drives[name] for name in self._drives]
        bodies = [
            state.bodies[body] for state, names in zip(states, self._carriages.values(), strict=True) for body in names
        ]
        places = [state.arc_length for state in states] + [drive.position for drive in drives]
        speeds = [state.speed for state in states] + [drive.speed for drive in drives]
        forces = [state.drive_force for state in states] + [drive.force for drive in drives]
        position = np.array(places + [body.pitch for body in bodies])
        velocity = np.array(speeds + [body.pitch_rate for body in bodies])
        effort = np.array(forces + [0.0] * len(bodies))
        return serialize(JointState(header, self._joints, position, velocity, effort))

    def _cable_path(self, cable: CableSamples, stamp_ns: int) -> bytes:
        count = len(cable.arc_lengths)
        if self._path is None or self._path.count != count:
            self._path = _PathTemplate(count)
        return self._path.fill(cable.positions, stamp_ns)


class _PathTemplate:
    """CDR of a path of `count` poses, made once and filled in place: 200 poses in 5 instead of 500 microseconds.

    Layout after the four bytes of encapsulation: header (stamp, length of the frame id, `map` and a zero), number of
    poses, then a pose each: header like the first, seven doubles on a multiple of eight. The first pose follows a
    20-byte head and so needs four bytes of padding; all later ones are 72 bytes apart.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        pose = PoseStamped(_header(0), Pose(Point(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)))
        self._data = bytearray(serialize(Path(_header(0), [pose] * count)))
        if count:
            self._x_y_z: NDArray[np.float64] = np.ndarray((count, 3), "<f8", self._data, 44, (72, 8))
            self._later_stamps: NDArray[np.uint32] = np.ndarray((count - 1, 2), "<u4", self._data, 100, (72, 4))

    def fill(self, positions: NDArray[np.float64], stamp_ns: int) -> bytes:
        stamp = divmod(stamp_ns, SECOND)
        struct.pack_into("<2I", self._data, 4, *stamp)
        if self.count:
            struct.pack_into("<2I", self._data, 24, *stamp)
            self._later_stamps[:] = stamp
            self._x_y_z[:, 0] = positions[:, 0]
            self._x_y_z[:, 2] = positions[:, -1]
        return bytes(self._data)


def scenario_message(scenario: Mapping[str, Any]) -> bytes:
    """Encode the whole resolved scenario as JSON text in a std_msgs/String."""
    return serialize(String(json.dumps(scenario, ensure_ascii=False)))


def scenario_from_message(data: bytes) -> dict[str, Any]:
    """Read the scenario back; raises ValueError where the text is not a JSON object."""
    scenario = json.loads(decode(data, String.__msgtype__).data)
    if not isinstance(scenario, dict):
        msg = "scenario: not a JSON object"
        raise ValueError(msg)
    return scenario


@dataclass(frozen=True, slots=True)
class Status:
    """One status of diagnostics."""

    level: int  # 0 ok, 1 warning, 2 error, 3 stale
    name: str  # what is diagnosed
    message: str  # one line for people
    values: Mapping[str, str]  # key figures, as text
    hardware_id: str = ""  # which of several


def diagnostics_message(stamp_ns: int, *statuses: Status) -> bytes:
    """Encode a diagnostic_msgs/DiagnosticArray with a stamp in ns."""
    array = [
        DiagnosticStatus(
            status.level,
            status.name,
            status.message,
            status.hardware_id,
            [KeyValue(key, value) for key, value in status.values.items()],
        )
        for status in statuses
    ]
    return serialize(DiagnosticArray(_header(stamp_ns, ""), array))


def clock_message(stamp_ns: int) -> bytes:
    """Encode rosgraph_msgs/Clock."""
    return serialize(Clock(_time(stamp_ns)))


def serialize(message: Message) -> bytes:
    """Encode a message of the typestore as little-endian CDR."""
    return bytes(TYPESTORE.serialize_cdr(message, message.__msgtype__, little_endian=True))


def _time(stamp_ns: int) -> Time:
    return Time(*divmod(stamp_ns, SECOND))


def _header(stamp_ns: int, frame_id: str = FRAME_ID) -> Header:
    return Header(_time(stamp_ns), frame_id)


def _quaternion(pitch: float) -> Quaternion:
    return Quaternion(0.0, math.sin(0.5 * pitch), 0.0, math.cos(0.5 * pitch))


def _pose(header: Header, x: float, z: float, pitch: float) -> bytes:
    return serialize(PoseStamped(header, Pose(Point(x, 0.0, z), _quaternion(pitch))))


def _force(stamp_ns: int, force: NDArray[np.float64]) -> bytes:
    """WrenchStamped of a force (dim,) in N without a moment, packed in a microsecond: its layout never changes."""
    second, nanosecond = divmod(stamp_ns, SECOND)
    return _WRENCH.pack(_LITTLE_ENDIAN, second, nanosecond, 4, b"map", force[0], 0.0, force[-1], 0.0, 0.0, 0.0)


def _transform(header: Header, child: str, x: float, z: float, pitch: float) -> TransformStamped:
    return TransformStamped(header, child, Transform(Vector3(x, 0.0, z), _quaternion(pitch)))


_WRENCH = struct.Struct("<4s3I4s6d")  # encapsulation, stamp, length of the frame id, `map` and a zero, six numbers
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_POINT_FIELDS = [PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate(CABLE_FIELDS)]
_POINT_STEP = 4 * len(CABLE_FIELDS)


def _cable(cable: CableSamples, header: Header) -> bytes:
    count = len(cable.arc_lengths)
    points = np.zeros((count, len(CABLE_FIELDS)), "<f4")
    points[:, 0] = cable.positions[:, 0]
    points[:, 2] = cable.positions[:, -1]
    points[:, 3] = cable.arc_lengths
    points[:, 4] = cable.tensions
    data = points.view(np.uint8).reshape(-1)
    return serialize(PointCloud2(header, 1, count, _POINT_FIELDS, False, _POINT_STEP, count * _POINT_STEP, data, True))
