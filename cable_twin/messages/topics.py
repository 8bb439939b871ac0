"""Table of the topics of the twin: names, types, QoS and rate groups; and remapped names of topics and frames.

Carriages, which have names of their own, have topics of their own; carriers, many of one kind, come in columns, so
that the number of topics does not grow with them. A few carriers may be asked for by name.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.commands import INPUTS
from cable_twin.frame.rates import EVERY_FRAME, ONCE, frames_between
from cable_twin.frame.snapshot import Layout

String = ros2_jazzy.std_msgs__msg__String
Clock = ros2_jazzy.rosgraph_msgs__msg__Clock
PoseStamped = ros2_jazzy.geometry_msgs__msg__PoseStamped
Vector3Stamped = ros2_jazzy.geometry_msgs__msg__Vector3Stamped
PoseArray = ros2_jazzy.geometry_msgs__msg__PoseArray
WrenchStamped = ros2_jazzy.geometry_msgs__msg__WrenchStamped
TFMessage = ros2_jazzy.tf2_msgs__msg__TFMessage
Path = ros2_jazzy.nav_msgs__msg__Path
JointState = ros2_jazzy.sensor_msgs__msg__JointState
PointCloud2 = ros2_jazzy.sensor_msgs__msg__PointCloud2
MarkerArray = ros2_jazzy.visualization_msgs__msg__MarkerArray
DiagnosticArray = ros2_jazzy.diagnostic_msgs__msg__DiagnosticArray

NAMESPACE = "/cable_twin"
FRAME_ID = "map"

JOINT_STATES = "joint_states"
JOINT_REFERENCES = "joint_references"
AIR_WIND = "air/wind"
SHEAVES, CONNECTORS, PANTOGRAPHS = "sheaves", "connectors", "pantographs"
CABLE = "cable"
CABLE_PATH = "cable_path"
TENSIONS = "tensions"
CARRIER_POSES = "carriers/poses"
CARRIER_FORCES = "carriers/forces"
SCENARIO = "scenario"
APPLIED_COMMANDS = "applied_commands"
REFUSED_COMMANDS = "refused_commands"
KEY_FIGURES = "key_figures"
OUTLOOK = "outlook"
ESTIMATE = "estimate"
READMITTED = "readmitted"
DERAILMENTS = "derailments"
DIAGNOSTICS = "/diagnostics"
CLOCK = "/clock"
TF = "/tf"
TF_STATIC = "/tf_static"
MARKERS = "markers"
ROBOT_DESCRIPTION = "robot_description"

Group = Literal["joints", "poses", "forces", "rope", "path", "transforms", "markers", "clock", ""]


@dataclass(frozen=True, slots=True)
class Topic:
    """ROS topic: name relative to the node ("joint_states") or absolute ("/tf"), type and QoS."""

    name: str
    type: str  # such as "sensor_msgs/msg/JointState"
    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"
    depth: int = 10
    group: Group = ""  # rate group of frames; empty for messages at events


def topics(
    layout: Layout,
    *,
    own: Sequence[str] = (),
    clock: bool = False,
    tf: bool = False,
    markers: bool = False,
    robot: bool = False,
    outlook: bool = False,
    estimate: bool = False,
) -> tuple[Topic, ...]:
    """Table of the topics published for frames in a layout.

    Args:
        layout: Of its frames.
        own: Names of carriers with topics of their own in addition.
        clock: With `/clock`, off by default.
        tf: With `/tf` and `/tf_static`.
        markers: With `markers`, only where visualization_msgs exists.
        robot: With `robot_description`.
        outlook: With `outlook`, which the node has by default.
        estimate: With `estimate` and `readmitted`, of a node that follows a plant.

    Returns:
        Every topic, in a fixed order.
    """
    table = [
        Topic(SCENARIO, String.__msgtype__, durability="transient_local", depth=1),
        *(Topic(name, message_type, depth=50) for name, message_type in INPUTS.items()),  # as received
        Topic(APPLIED_COMMANDS, JointState.__msgtype__),
        Topic(REFUSED_COMMANDS, DiagnosticArray.__msgtype__),
        Topic(JOINT_STATES, JointState.__msgtype__, group="joints"),
        *([Topic(JOINT_REFERENCES, JointState.__msgtype__, group="joints")] if layout.commanded else []),
        Topic(CABLE, PointCloud2.__msgtype__, group="rope"),
        Topic(TENSIONS, JointState.__msgtype__, group="rope"),
        Topic(CABLE_PATH, Path.__msgtype__, group="path"),
    ]
    for vehicle in (*layout.carriages, *own):
        table += _of_vehicle(vehicle, layout)
    if layout.carriers:
        table.append(Topic(CARRIER_POSES, PoseArray.__msgtype__, group="poses"))
        table.append(Topic(CARRIER_FORCES, PointCloud2.__msgtype__, group="forces"))
    table += [Topic(support_force_topic(one), WrenchStamped.__msgtype__, group="forces") for one in layout.supports]
    table += _between_ropes(layout)
    if layout.grooves:
        table.append(Topic(DERAILMENTS, DiagnosticArray.__msgtype__, durability="transient_local", depth=1))
    if layout.space:
        table.append(Topic(AIR_WIND, Vector3Stamped.__msgtype__, group="forces"))
    table.append(Topic(KEY_FIGURES, DiagnosticArray.__msgtype__))
    if outlook:
        table.append(Topic(OUTLOOK, DiagnosticArray.__msgtype__))
    if estimate:
        table.append(Topic(ESTIMATE, DiagnosticArray.__msgtype__))
        table.append(Topic(READMITTED, String.__msgtype__))
    table.append(Topic(DIAGNOSTICS, DiagnosticArray.__msgtype__))
    if clock:
        table.append(Topic(CLOCK, Clock.__msgtype__, reliability="best_effort", depth=1, group="clock"))
    if tf:
        if layout.vehicles:  # a bare rope has no transforms that change
            table.append(Topic(TF, TFMessage.__msgtype__, depth=100, group="transforms"))
        table.append(Topic(TF_STATIC, TFMessage.__msgtype__, durability="transient_local", depth=1))
    if markers:
        table.append(Topic(MARKERS, MarkerArray.__msgtype__, group="markers"))
    if robot:
        table.append(Topic(ROBOT_DESCRIPTION, String.__msgtype__, durability="transient_local", depth=1))
    return tuple(table)


def _of_vehicle(vehicle: str, layout: Layout) -> Iterator[Topic]:
    """Topics of a single vehicle: poses, contact force, haul rope force."""
    for body in (None, *layout.vehicles[vehicle]):
        yield Topic(pose_topic(vehicle, body), PoseStamped.__msgtype__, group="poses")
    yield Topic(contact_force_topic(vehicle), WrenchStamped.__msgtype__, group="forces")
    if vehicle in layout.hauled:
        yield Topic(haul_force_topic(vehicle), WrenchStamped.__msgtype__, group="forces")


def _between_ropes(layout: Layout) -> Iterator[Topic]:
    """Topics of connectors, pantographs and bullwheels, which belong to no single rope."""
    if layout.sheaves:
        yield Topic(SHEAVES, JointState.__msgtype__, group="joints")
    if layout.connectors:
        yield Topic(CONNECTORS, JointState.__msgtype__, group="forces")
    if layout.pantographs:
        yield Topic(PANTOGRAPHS, JointState.__msgtype__, group="joints")
    for name in layout.pantographs:
        yield Topic(head_topic(name), PoseStamped.__msgtype__, group="joints")


def pose_topic(vehicle: str, body: str | None = None) -> str:
    """Relative name of the pose topic of a vehicle, or of one of its bodies."""
    return f"carriages/{vehicle}/pose" if body is None else f"carriages/{vehicle}/{body}/pose"


def head_topic(pantograph: str) -> str:
    """Relative name of the topic with the place of the head of a pantograph."""
    return f"{PANTOGRAPHS}/{pantograph}/pose"


def contact_force_topic(vehicle: str) -> str:
    """Relative name of the topic with the force (N) of the cable on a vehicle."""
    return f"carriages/{vehicle}/contact_force"


def haul_force_topic(vehicle: str) -> str:
    """Relative name of the topic with the force (N) of a haul rope on a vehicle."""
    return f"carriages/{vehicle}/haul_force"


def support_force_topic(support: str) -> str:
    """Relative name of the topic with the force (N) of a support on the cable."""
    return f"supports/{support}/force"


class Due(NamedTuple):
    """Topics that are due at one frame, for each consumer of messages, such as publisher or log."""

    names: tuple[str, ...]  # topics due for any taker
    taken: tuple[tuple[int, ...], ...]  # for each taker, indices in `names`
    groups: tuple[tuple[str, ...], ...]  # for each taker, its due groups


class Schedule:
    """Schedule of the topics due at each frame of a run, for one or more consumers such as publisher and log.

    Args:
        table: the topics; topics without a group come at events and are in no schedule.
        frame_rate: Hz.
        rates: for each taker Hz by group, every frame without an entry; a rate that does not divide the frame rate is
            lowered to the next that does.
    """

    def __init__(self, table: Sequence[Topic], frame_rate: float, *rates: Mapping[str, float]) -> None:
        self._groups = groups = list(dict.fromkeys(topic.group for topic in table if topic.group))
        self._names = [tuple(topic.name for topic in table if topic.group == group) for group in groups]
        self._given = [[frames_between(frame_rate, one.get(group, EVERY_FRAME)) for group in groups] for one in rates]
        self._periods = [list(periods) for periods in self._given]
        self._never = frames_between(frame_rate, ONCE)
        self._known: dict[tuple[bool, ...], Due] = {}

    def listen(self, taker: int, group: str, listening: bool) -> None:
        """Start a group of topics at its rate for a consumer given by index, or stop it without subscribers."""
        if group in self._groups:
            row = self._groups.index(group)
            self._periods[taker][row] = self._given[taker][row] if listening else self._never

    def due(self, frame: int, *, everything: bool = False) -> Due:
        """Topics due at a frame, by its number in the run, or all topics of the schedule."""
        wanted = tuple([everything or frame % period == 0 for periods in self._periods for period in periods])
        if wanted not in self._known:
            self._known[wanted] = self._gather(wanted)
        return self._known[wanted]

    def _gather(self, wanted: Sequence[bool]) -> Due:
        count = len(self._names)
        takers = [wanted[first : first + count] for first in range(0, len(wanted), count)]
        names: list[str] = []
        taken: list[list[int]] = [[] for _ in takers]
        for group, own in enumerate(self._names):
            if any(taker[group] for taker in takers):
                numbers = range(len(names), len(names) + len(own))
                names += own
                for indexes, taker in zip(taken, takers, strict=True):
                    if taker[group]:
                        indexes.extend(numbers)
        due = tuple(tuple(group for group, own in zip(self._groups, taker, strict=True) if own) for taker in takers)
        return Due(tuple(names), tuple(map(tuple, taken)), due)


@dataclass(frozen=True, slots=True)
class TopicNames:
    """Full names of topics with namespace and remappings, and their inverse.

    Attributes:
        namespace: full name of the node, in front of relative names.
        remapped: full names of the topics that ROS remaps, by their names in the table.
    """

    namespace: str = NAMESPACE
    remapped: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> TopicNames:
        """Topic names from log `metadata`, with defaults for missing entries."""
        return cls(metadata.get("namespace", NAMESPACE), json.loads(metadata.get("remapped", "{}")))

    @property
    def metadata(self) -> dict[str, str]:
        """Topic names as entries of log metadata."""
        return {"namespace": self.namespace, "remapped": json.dumps(self.remapped)}

    def full(self, topic: str) -> str:
        """Full name of a topic given relative to the node ("joint_states") or absolute ("/tf")."""
        plain = topic if topic.startswith("/") else f"{self.namespace.rstrip('/')}/{topic}"
        return self.remapped.get(topic, plain)

    def own(self, name: str) -> str:
        """Name in the topic table of the topic with a full name; inverse of `full`."""
        topics = {remapped: topic for topic, remapped in self.remapped.items()}
        return topics.get(name, name.removeprefix(f"{self.namespace.rstrip('/')}/"))


@dataclass(frozen=True, slots=True)
class FrameNames:
    """Names of coordinate frames of messages: the fixed frame, and a prefix for all others.

    Attributes:
        frame_id: name of the fixed frame, x along the track, y lateral, z up (REP-103).
        frame_prefix: in front of the names of vehicles, their bodies and supports, as in robot_state_publisher.
    """

    frame_id: str = FRAME_ID
    frame_prefix: str = ""

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> FrameNames:
        """Frame names from log `metadata`, with defaults for missing entries."""
        return cls(metadata.get("frame_id", FRAME_ID), metadata.get("frame_prefix", ""))

    @property
    def metadata(self) -> dict[str, str]:
        """Names of coordinate frames as entries of log metadata."""
        return {"frame_id": self.frame_id, "frame_prefix": self.frame_prefix}

    def named(self, thing: str) -> str:
        """Name of the coordinate frame of a vehicle ("cabin"), a body ("cabin/hanger") or a support ("tower_1")."""
        return f"{self.frame_prefix}{thing}"
