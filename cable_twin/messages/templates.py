"""Templates of the messages of a frame, each laid out once with the columns copied into it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.messages.cdr import Header, Template, marks
from cable_twin.messages.topics import PointCloud2, PoseStamped, Vector3Stamped, WrenchStamped

Point = ros2_jazzy.geometry_msgs__msg__Point
Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion
Pose = ros2_jazzy.geometry_msgs__msg__Pose
Wrench = ros2_jazzy.geometry_msgs__msg__Wrench
Transform = ros2_jazzy.geometry_msgs__msg__Transform
TransformStamped = ros2_jazzy.geometry_msgs__msg__TransformStamped
PointField = ros2_jazzy.sensor_msgs__msg__PointField

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
FloatArray = NDArray[np.float64]


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
    """Template of a Vector3Stamped with a vector (3,)."""
    return Template(Vector3Stamped(header, Vector3(*map(float, marks(3)))), [vector])


def transform_of(
    header: Header, child: str, position: FloatArray, orientation: Sequence[float] | FloatArray
) -> TransformStamped:
    """TransformStamped of a frame with a place (3,) in m and a quaternion (4,)."""
    turn = Quaternion(*map(float, orientation))
    return TransformStamped(header, child, Transform(Vector3(*map(float, position)), turn))


def cloud_template(header: Header, fields: Sequence[str], sources: Sequence[FloatArray]) -> Template:
    """Template of a PointCloud2 of float32 fields, with a point for each row of the sources (n, k)."""
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
