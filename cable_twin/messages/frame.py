"""Frames of the simulation as ROS 2 messages: from columns to bytes.

A message is built once; the same bytes go to the publisher (`publisher.publish(data)`) and into the log. Names never
change in a run, so each message is a template into which the columns of a frame are copied.

Positions are in one frame, by default `map`: x along the track, y lateral, z up (REP-103). A force is in the frame of
the vehicle or support where it acts, with axes parallel to `map`. A stamp is the epoch of the run plus simulated time,
in nanoseconds: one clock for messages, tf and logs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.layout import of_bullwheel
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout, Snapshot
from cable_twin.messages.cdr import STAMP, Header, Template, marks, nanoseconds, serialize, time_of
from cable_twin.messages.texts import DerailmentMessage
from cable_twin.messages.topics import (
    AIR_WIND,
    CABLE,
    CABLE_PATH,
    CARRIER_FORCES,
    CARRIER_POSES,
    CLOCK,
    CONNECTORS,
    DERAILMENTS,
    JOINT_REFERENCES,
    JOINT_STATES,
    PANTOGRAPHS,
    SHEAVES,
    TENSIONS,
    TF,
    Clock,
    FrameNames,
    JointState,
    Path,
    PointCloud2,
    PoseArray,
    PoseStamped,
    TFMessage,
    Vector3Stamped,
    WrenchStamped,
    contact_force_topic,
    haul_force_topic,
    head_topic,
    pose_topic,
    support_force_topic,
)

Point = ros2_jazzy.geometry_msgs__msg__Point
Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion
Pose = ros2_jazzy.geometry_msgs__msg__Pose
Wrench = ros2_jazzy.geometry_msgs__msg__Wrench
Transform = ros2_jazzy.geometry_msgs__msg__Transform
TransformStamped = ros2_jazzy.geometry_msgs__msg__TransformStamped
PointField = ros2_jazzy.sensor_msgs__msg__PointField


UPRIGHT = (0.0, 0.0, 0.0, 1.0)
CABLE_FIELDS = ("x", "y", "z", "arc_length", "tension")  # m, m, m, m, N
ROPE_FIELD = "rope"  # of several: their number in the order of the scenario
FORCE_FIELDS = ("x", "y", "z", "fx", "fy", "fz")  # m and N, of the joint of each carrier
PLAIN = FrameNames()
NONE = np.zeros(0)


class Filled(Protocol):
    """Message with a fixed layout, filled with the numbers of each frame."""

    def fill(self, stamp_ns: int) -> bytes:
        """Encode the numbers of the present frame as a message with a stamp (ns)."""


class MessageEncoder:
    """Encoder of the snapshots of one run as ROS 2 messages.

    Attributes:
        epoch_ns: wall time (ns since 1970) of simulated time zero.
    """

    def __init__(
        self,
        layout: Layout,
        epoch_ns: int = 0,
        *,
        own: Sequence[str] = (),
        frames: FrameNames = PLAIN,
    ) -> None:
        """Prepare the messages of all topics for frames in a layout.

        Args:
            layout: Of the snapshots.
            epoch_ns: Wall time (ns since 1970) of simulated time zero.
            own: Names of carriers with topics of their own in addition.
            frames: Names of coordinate frames.
        """
        self.epoch_ns = epoch_ns
        self._frames = frames
        self._header = Header(STAMP, frames.frame_id)
        self._joints = np.zeros((2, len(layout.bodies)))  # rad, rad/s
        self._place = np.zeros(len(layout.vehicles))
        self._layout = layout
        self._numbers = np.zeros(layout.size)
        self._columns = layout.columns(self._numbers)
        self._encoders: dict[str, Callable[[int], bytes]] = {}
        self._makers: dict[str, Callable[[], Filled]] = {
            JOINT_STATES: self._joint_states,
            CABLE: self._cable,
            TENSIONS: self._tensions,
            CABLE_PATH: self._cable_path,
            TF: self._transforms,
        }
        for vehicle in (*layout.carriages, *own):
            self._offer_vehicle(vehicle)
        if layout.carriers:
            self._makers[CARRIER_POSES] = self._carrier_poses
            self._makers[CARRIER_FORCES] = self._carrier_forces
        for row, support in enumerate(layout.supports):
            force = self._columns.support_force[row]
            self._makers[support_force_topic(support)] = _maker(wrench_template, self._header_at(support), force)
        if layout.commanded:
            self._makers[JOINT_REFERENCES] = partial(ReferencesMessage, self._header, layout, self._numbers)
        if layout.sheaves:
            self._makers[SHEAVES] = partial(BullwheelsMessage, self._header, layout, self._numbers)
        if layout.connectors:
            self._makers[CONNECTORS] = self._connectors
        if layout.pantographs:
            self._makers[PANTOGRAPHS] = self._pantographs
            for row, name in enumerate(layout.pantographs):
                place = self._columns.pantograph_position[row]
                self._makers[head_topic(name)] = _maker(joint_pose_template, self._header, place)
        if layout.grooves:
            self._makers[DERAILMENTS] = partial(DerailmentMessage, layout, self._columns)
        if layout.space:
            self._makers[AIR_WIND] = _maker(vector_template, self._header, self._columns.wind)

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of all topics that the encoder has messages for."""
        return (*self._makers, CLOCK)

    def stamp_ns(self, snapshot: Snapshot) -> int:
        """Stamp (ns) of all messages of a snapshot."""
        return self.epoch_ns + nanoseconds(snapshot.time)

    def frame(self, snapshot: Snapshot, names: Iterable[str] | None = None) -> list[tuple[str, bytes]]:
        """Encode the messages of a snapshot for given topics.

        Args:
            snapshot: The twin at the time of the frame.
            names: Relative names of the topics; all of each frame but `/clock` and `/tf` where None.

        Returns:
            Pairs of relative topic name and CDR, in the order of the names.
        """
        np.copyto(self._numbers, snapshot.numbers)
        stamp = self.stamp_ns(snapshot)
        if names is None:
            names = [name for name in self._makers if name not in (TF, DERAILMENTS)]
        return [(name, (self._encoders.get(name) or self._prepare(name))(stamp)) for name in names]

    def offer(self, name: str, make: Callable[[Columns], Filled]) -> None:
        """Register one more topic, with the function that makes its message from the columns of a frame."""
        self._makers[name] = partial(make, self._columns)

    def _prepare(self, name: str) -> Callable[[int], bytes]:
        """Lay out the message template of a topic at its first use; returns its fill function."""
        self._encoders[name] = clock_message if name == CLOCK else self._makers[name]().fill
        if name == JOINT_STATES:
            self._encoders[name] = self._fill_joint_states(self._encoders[name])
        return self._encoders[name]

    def _header_at(self, thing: str) -> Header:
        """Message header in the coordinate frame of a vehicle or support."""
        return Header(STAMP, self._frames.named(thing))

    def _offer_vehicle(self, vehicle: str) -> None:
        """Add the topics of one vehicle by its name."""
        layout, columns = self._layout, self._columns
        row = [*layout.vehicles].index(vehicle)
        self._makers[pose_topic(vehicle)] = _maker(joint_pose_template, self._header, columns.joint_position[row])
        for body, name in enumerate(layout.vehicles[vehicle], layout.first_body[row]):
            position, orientation = columns.body_position[body], columns.body_orientation[body]
            self._makers[pose_topic(vehicle, name)] = _maker(body_pose_template, self._header, position, orientation)
        force = columns.contact_force[row]
        self._makers[contact_force_topic(vehicle)] = _maker(wrench_template, self._header_at(vehicle), force)
        if vehicle in layout.hauled:
            self._makers[haul_force_topic(vehicle)] = _maker(
                wrench_template, self._header_at(vehicle), columns.haul_pull[row]
            )

    def _joint_states(self) -> Template:
        """JointState of vehicles, drives and body joints: place or angle, rate, and force along the cable."""
        layout, c = self._layout, self._columns
        names = [*layout.vehicles, *layout.drives, *joint_names(layout)]
        sources = [self._place, c.drive_position, self._joints[0]]
        sources += [c.speed, c.drive_speed, self._joints[1]]
        sources += [c.drive_force, c.moving_cable_force]
        driven = len(layout.vehicles) + len(layout.drives)
        numbers = marks(2 * len(names) + driven)
        effort = np.concatenate([numbers[2 * len(names) :], np.zeros(len(layout.bodies))])
        message = JointState(self._header, names, numbers[: len(names)], numbers[len(names) : 2 * len(names)], effort)
        return Template(message, sources)

    def _fill_joint_states(self, fill: Callable[[int], bytes]) -> Callable[[int], bytes]:
        """Wrap a fill function to set body joint angles first, relative to the body above or to the vertical."""
        layout, frame, joints = self._layout, self._numbers, self._joints
        own = np.array([layout.places.body_angles[:, 1], layout.places.body_angular_velocity[:, 1]])
        hung, above, hangs = hung_rows(layout), np.zeros_like(own), np.zeros_like(joints)
        above[:, hung], hangs[:, hung] = own[:, hung - 1], 1.0
        upper = np.zeros_like(joints)

        def fill_joints(stamp_ns: int) -> bytes:
            self._place[:] = layout.on_loop(self._columns)
            frame.take(own, None, joints, "clip")
            frame.take(above, None, upper, "clip")
            np.multiply(upper, hangs, out=upper)  # 0 above the first one
            np.subtract(joints, upper, out=joints)
            return fill(stamp_ns)

        return fill_joints

    def _connectors(self) -> Template:
        """JointState message of connectors: pull as effort in N."""
        pulls = self._columns.connector_force
        return Template(JointState(self._header, [*self._layout.connectors], NONE, NONE, marks(pulls.size)), [pulls])

    def _pantographs(self) -> Template:
        """JointState of pantographs: place along the track (m), speed (m/s), force on the rope (N)."""
        c, names = self._columns, [*self._layout.pantographs]
        places, speeds, forces = marks(3 * len(names)).reshape(3, -1)
        message = JointState(self._header, names, places, speeds, forces)
        return Template(message, [c.pantograph_position[:, 0], c.pantograph_speed, c.pantograph_force])

    def _cable(self) -> Template:
        c, arc_lengths = self._columns, self._layout.arc_lengths
        sources = [c.rope_position, arc_lengths[:, None], c.rope_tension[:, None]]
        if not self._layout.several:
            return cloud_template(self._header, CABLE_FIELDS, sources)
        ropes = self._layout.sample_ropes[:, None].astype(np.float64)
        return cloud_template(self._header, (*CABLE_FIELDS, ROPE_FIELD), [*sources, ropes])

    def _tensions(self) -> Template:
        """JointState of lowest and highest tension of each rope (N), with their arc lengths (m)."""
        layout, names = self._layout, tension_names(self._layout)
        first = int(layout.places.lowest_tension[0, 0])
        both = self._numbers[first : first + 2 * len(names)].reshape(-1, 2)  # the highest come after the lowest
        numbers = marks(both.size).reshape(both.shape)
        message = JointState(self._header, names, numbers[:, 1].copy(), NONE, numbers[:, 0].copy())
        return Template(message, [both])

    def _cable_path(self) -> Template:
        positions = self._columns.rope_position[next(iter(self._layout.ropes.values()))]  # a path has no gaps
        poses = [PoseStamped(self._header, pose_of(place, UPRIGHT)) for place in marks(positions.size).reshape(-1, 3)]
        return Template(Path(self._header, poses), [positions])

    def _carrier_poses(self) -> Template:
        """PoseArray of all bodies of all carriers, in the order of `joint_states`."""
        first = self._layout.first_body[len(self._layout.carriages)]
        positions, orientations = self._columns.body_position[first:], self._columns.body_orientation[first:]
        numbers = marks(positions.size + orientations.size)
        places = numbers[: positions.size].reshape(-1, 3)
        turns = numbers[positions.size :].reshape(-1, 4)
        poses = [pose_of(place, turn) for place, turn in zip(places, turns, strict=True)]
        return Template(PoseArray(self._header, poses), [positions, orientations])

    def _carrier_forces(self) -> Template:
        """PointCloud2 of joint places and contact forces of all carriers, in the order of `joint_states`."""
        first = len(self._layout.carriages)
        return cloud_template(
            self._header, FORCE_FIELDS, [self._columns.joint_position[first:], self._columns.contact_force[first:]]
        )

    def _transforms(self) -> Template:
        """TFMessage from the fixed frame to each vehicle ("cabin") and each body ("cabin/hanger")."""
        layout, c = self._layout, self._columns
        joints, bodies, turns = c.joint_position, c.body_position, c.body_orientation
        numbers = marks(joints.size + bodies.size + turns.size)
        joint_marks = numbers[: joints.size].reshape(-1, 3)
        body_marks = numbers[joints.size : joints.size + bodies.size].reshape(-1, 3)
        turn_marks = numbers[joints.size + bodies.size :].reshape(-1, 4)
        transforms = []
        for row, name in enumerate(layout.vehicles):
            child = self._frames.named(name)
            transforms.append(transform_of(self._header, child, joint_marks[row], UPRIGHT))
            transforms += [
                transform_of(self._header, self._frames.named(layout.bodies[body]), body_marks[body], turn_marks[body])
                for body in range(layout.first_body[row], layout.first_body[row + 1])
            ]
        return Template(TFMessage(transforms), [joints, bodies, turns])


def read_rope(data: bytes, layout: Layout, numbers: FloatArray) -> None:
    """Fill shape and tension of the ropes from the message `cable` into a frame that lacks these columns.

    Raises:
        ValueError: The message is shorter than its points.
    """
    c, count = layout.columns(numbers), layout.arc_lengths.size
    if np.isnan(c.rope_position[0, 0]):
        width = len(CABLE_FIELDS) + bool(layout.several)
        points = np.frombuffer(data, "<f4", count * width, len(data) - 1 - 4 * count * width).reshape(count, width)
        c.rope_position[:], c.rope_tension[:] = points[:, :3], points[:, 4]


def tension_names(layout: Layout) -> list[str]:
    """Names of the rows in the message of the topic `tensions`."""
    return [f"{rope}/{which}" for which in ("lowest", "highest") for rope in layout.ropes]


def clock_message(stamp_ns: int) -> bytes:
    """Encode a rosgraph_msgs/Clock message of a simulated time."""
    return serialize(Clock(time_of(stamp_ns)))


def _maker(make: Callable[..., Template], header: Header, *sources: FloatArray) -> Callable[[], Template]:
    return lambda: make(header, *sources)


def joint_names(layout: Layout) -> list[str]:
    """Names VEHICLE_BODY of the joints of all bodies in a URDF."""
    return [body.replace("/", "_") for body in layout.bodies]


def hung_rows(layout: Layout) -> NDArray[np.intp]:
    """Row indices (n,) of bodies that hang from another body, which is in the previous row."""
    return np.array([row for row in range(len(layout.bodies)) if row not in layout.first_body], dtype=np.intp)


def pose_of(position: Sequence[float] | FloatArray, orientation: Sequence[float] | FloatArray) -> Pose:
    """Pose from a position (3,) in m and a quaternion (4,)."""
    return Pose(Point(*map(float, position)), Quaternion(*map(float, orientation)))


def joint_pose_template(header: Header, position: FloatArray) -> Template:
    """Template of a PoseStamped at a place (3,) in m, upright."""
    return Template(PoseStamped(header, pose_of(marks(3), UPRIGHT)), [position])


def body_pose_template(header: Header, position: FloatArray, orientation: FloatArray) -> Template:
    """Template of a PoseStamped with a place (3,) in m and a quaternion (4,)."""
    numbers = marks(7)
    return Template(PoseStamped(header, pose_of(numbers[:3], numbers[3:])), [position, orientation])


def wrench_template(header: Header, force: FloatArray) -> Template:
    """Template of a WrenchStamped with a force (3,) in N and no moment."""
    return Template(WrenchStamped(header, Wrench(Vector3(*map(float, marks(3))), Vector3(0.0, 0.0, 0.0))), [force])


def vector_template(header: Header, vector: FloatArray) -> Template:
    """Encoded Vector3Stamped, of which each frame overwrites the stamp and the vector (3,) alone."""
    return Template(Vector3Stamped(header, Vector3(*map(float, marks(3)))), [vector])


def transform_of(
    header: Header, child: str, position: FloatArray, orientation: Sequence[float] | FloatArray
) -> TransformStamped:
    """TransformStamped of a frame with a place (3,) in m and a quaternion (4,)."""
    turn = Quaternion(*map(float, orientation))
    return TransformStamped(header, child, Transform(Vector3(*map(float, position)), turn))


def cloud_template(header: Header, fields: Sequence[str], sources: Sequence[FloatArray]) -> Template:
    """Encoded PointCloud2 of float32 fields, which frames fill, with a point for each row of the sources (n, k)."""
    count, step = len(sources[0]), 4 * len(fields)
    numbers = marks(count * len(fields), "<f4")
    points = np.empty((count, len(fields)), "<f4")
    taken = column = 0
    for source in sources:
        width = source.shape[1]
        points[:, column : column + width] = numbers[taken : taken + source.size].reshape(source.shape)
        taken, column = taken + source.size, column + width
    described = [PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate(fields)]
    data = points.view(np.uint8).reshape(-1)
    message = PointCloud2(header, 1, count, described, False, step, count * step, data, True)
    return Template(message, sources, "<f4")


IntArray = NDArray[np.int64]
ROWS = ("", "/command", "/limit")  # behind a name


class ReferencesMessage:
    """Message `joint_references`: references, commands and force limits of each commanded carriage and drive.

    NAME has the reference that the drive follows, ramped within its limits: place (m), speed (m/s) and commanded force
    (N); without a ramp, the actual place and speed. NAME/command has the kind of the command (by its number
    in `COMMANDED`) as position, the commanded speed (m/s) and force (N). NAME/limit has the share of the force limit in
    use as position (1 in saturation) and the limit (N) as effort; both are 0 where there is no limit. The limit of a
    bullwheel's drive is the least of its limits of force and power, the highest force that it takes as a command, and
    the force at which the rope slips on the wheel with its present tensions.

    Args:
        header: of the message.
        layout: of the frame.
        numbers: (size,) of the frame, which are filled in before each call.
    """

    def __init__(self, header: Header, layout: Layout, numbers: FloatArray) -> None:
        self._frame, self._sources = numbers, _sources(layout)
        self._shown = np.zeros(self._sources.shape)
        places, speeds, forces = marks(self._shown.size).reshape(3, -1)
        names = [f"{name}{row}" for name in layout.commanded for row in ROWS]
        self._template = Template(JointState(header, names, places, speeds, forces), [self._shown])
        # places in the message and numbers of the frame: share in use, force limit, force
        columns = layout.places
        self._limited = [
            (number, self._sources[2, number, 2].item(), int(columns.drive_force[layout.vehicle_rows[name]]))
            for number, name in enumerate(layout.commanded)
            if name in layout.vehicle_rows
        ]
        first = len(layout.commanded) - len(layout.drives)
        grips = np.expm1(layout.grips).tolist()
        self._on_bullwheels = [  # of drives: limits of force, power and slip; places of force and speed, of tensions
            (
                (first + row, (limit, power, grips[wheel])),
                (int(columns.moving_cable_force[row]), int(columns.drive_speed[row])),
                tuple(map(int, columns.sheave_tension[wheel])),
            )
            for row, (limit, power, wheel) in enumerate(
                zip(
                    layout.drive_limits.tolist(),
                    layout.drive_powers.tolist(),
                    layout.drive_sheaves.tolist(),
                    strict=True,
                )
            )
            if limit > 0.0
        ]

    def fill(self, stamp_ns: int) -> bytes:
        """Encode the references of the present frame with a stamp (ns)."""
        shown, frame = self._shown, self._frame
        frame.take(self._sources, None, shown, "clip")
        shown[:, :, 2] = 0.0
        for number, limit, force in self._limited:
            if (most := frame.item(limit)) > 0.0:  # there is one
                shown[0, number, 2], shown[2, number, 2] = abs(frame.item(force)) / most, most
        for (number, limits), (force, speed), (on, off) in self._on_bullwheels:
            tensions = frame.item(on), frame.item(off)
            shown[0, number, 2], shown[2, number, 2] = of_bullwheel(
                limits, frame.item(force), frame.item(speed), tensions
            )
        return self._template.fill(stamp_ns)


def _sources(layout: Layout) -> IntArray:
    """Indices (3, names, rows) in a frame of the values of `joint_references`: place, speed, force; 0 for no value."""
    c = layout.places
    limits = layout.of_commanded(c.force_limit, np.zeros_like(c.drive_position))
    kinds = layout.of_commanded(c.command_kind, c.drive_command_kind)
    force = layout.of_commanded(c.commanded_force, c.drive_commanded_force)
    places = layout.of_commanded(c.reference_position, c.drive_reference_position)
    speeds = layout.of_commanded(c.reference_speed, c.drive_reference_speed)
    told, none = layout.of_commanded(c.commanded_speed, c.drive_commanded_speed), np.zeros_like(kinds)
    rows = [[places, kinds, none], [speeds, told, none], [force, force, limits]]
    return np.moveaxis(np.array(rows, dtype=np.int64), 1, 2)


class _Rows:
    """Rows of message `sheaves`: names, and the row indices of wheels, strands and tensioning carriages."""

    def __init__(self, layout: Layout) -> None:
        self.names: list[str] = []
        self.wheel, self.on, self.off, self.carriage = [], [], [], []  # type: ignore[var-annotated]
        for name in layout.sheaves:
            for rows, row in ((self.wheel, name), (self.on, f"{name}/on"), (self.off, f"{name}/off")):
                rows.append(len(self.names))
                self.names.append(row)
            if name in layout.tensioned:
                self.carriage.append(len(self.names))
                self.names.append(f"{name}/carriage")
        self.tensioned = [row for row, name in enumerate(layout.sheaves) if name in layout.tensioned]


class BullwheelsMessage:
    """Message `sheaves` of bullwheels: rope travel, drive force, tensions of both strands and tensioning of each.

    NAME has the travel of the rope over the wheel (m), its speed (m/s) and the force of the drive at the rim (N).
    NAME/on and NAME/off are the strands that come to the wheel and leave it, with their tensions (N) as effort; NAME/on
    has the slip (m), by which the rim has gone further than the rope, as position. NAME/carriage, for a wheel with a
    tensioning device, has the travel of the device (m).

    Args:
        header: of the message.
        layout: of the frame.
        numbers: (size,) of the frame, which are filled in before each call.
    """

    def __init__(self, header: Header, layout: Layout, numbers: FloatArray) -> None:
        self._frame, rows = numbers, _Rows(layout)
        count = len(rows.names)
        self._sources, self._shows = np.zeros((3, count), dtype=np.int64), np.zeros((3, count))
        c = layout.places
        for kind, row, sources in (
            (0, rows.wheel, c.sheave_position),
            (0, rows.on, c.sheave_slip),
            (0, rows.carriage, c.sheave_travel[rows.tensioned]),
            (1, rows.wheel, c.sheave_speed),
            (2, rows.wheel, c.sheave_force),
            (2, rows.on, c.sheave_tension[:, 0]),
            (2, rows.off, c.sheave_tension[:, 1]),
        ):
            self._sources[kind, row], self._shows[kind, row] = sources, 1.0
        self._numbers = np.zeros((3, count))
        places, speeds, forces = marks(3 * count).reshape(3, -1)
        self._template = Template(JointState(header, rows.names, places, speeds, forces), [self._numbers])

    def fill(self, stamp_ns: int) -> bytes:
        """Encode the bullwheels of the present frame with a stamp (ns)."""
        self._frame.take(self._sources, None, self._numbers, "clip")
        self._numbers *= self._shows  # 0 where a row shows nothing
        return self._template.fill(stamp_ns)
