"""ROS messages of a plant, assembled from the samples of tags: samples of one scan go into one message."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.messages import SECOND, JointState, Topic, header, serialize
from cable_twin.messages.sensor_messages import PLANT, UNKNOWN, Imu, Vector3, Wrench, WrenchStamped, turned_about
from cable_twin.messages.topics import FRAME_ID, Vector3Stamped
from cable_twin.ros.door.plant_map import Tag
from cable_twin.ros.door.quantities import QUANTITIES, XYZ, conversion
from cable_twin.ros.door.samples import Measured

Temperature = ros2_jazzy.sensor_msgs__msg__Temperature

ONE_SCAN = SECOND // 200  # ns between the stamps of samples that belong together
EARLY = 0.05  # share of the shortest period by which a message may come earlier
DEGREE = math.pi / 180.0


class Ready(NamedTuple):
    """Serialized ROS message to publish on a topic of the plant."""

    topic: str  # full name
    data: bytes


class Group:
    """Assembler of the ROS messages of one measured object from the samples of its tags.

    Args:
        topic: full name.
        of: name of the measured object.
        tags: tags of the object by name.

    Attributes:
        count: number of assembled messages.
    """

    def __init__(self, topic: str, of: str, tags: Mapping[str, Tag]) -> None:
        self.topic, self._of, self._tags = topic, of, tags
        self._held: dict[str, Measured] = {}
        self._last_ns = -(2**62)  # stamp of the newest message
        self._period_ns = round((1.0 - EARLY) * SECOND / max(tag.rate for tag in tags.values()))
        self.count = 0

    def take(self, measured: Iterable[tuple[str, Measured]]) -> list[bytes]:
        """Assemble messages from samples of the tags of this group, in the order of their stamps."""
        found: list[bytes] = []
        scan: dict[str, Measured] = {}
        for name, one in sorted(measured, key=lambda item: item[1].stamp_ns):
            first = next(iter(scan.values()), None)
            if first is not None and (name in scan or one.stamp_ns - first.stamp_ns > ONE_SCAN):
                found += self._scanned(scan)
                scan = {}
            scan[name] = one
        found += self._scanned(scan)
        self.count += len(found)
        return found

    def _scanned(self, scan: Mapping[str, Measured]) -> list[bytes]:
        """Assemble the message of one scan of samples; none if no message is due or values are missing."""
        self._held |= scan
        leads = [name for name in scan if QUANTITIES[self._tags[name].quantity].lead or self._leads_alone()]
        if not leads:
            return []
        stamp_ns = max(scan[name].stamp_ns for name in leads)
        if stamp_ns - self._last_ns < self._period_ns:
            return []
        fresh = {
            name: one.value
            for name, one in self._held.items()
            if self._tags[name].hold or stamp_ns - one.stamp_ns <= self._tags[name].stale_after * SECOND
        }
        needed = [
            name for name, tag in self._tags.items() if QUANTITIES[tag.quantity].part not in ("position", "velocity")
        ]
        if any(name not in fresh for name in needed):
            return []
        self._last_ns = stamp_ns
        return [self._message(fresh, stamp_ns)]

    def drop(self, name: str) -> None:
        """Forget the held value of a tag whose newest sample was left out."""
        self._held.pop(name, None)

    def _leads_alone(self) -> bool:
        """Whether the group has no tag that normally triggers a message, as with a speed but no position."""
        return not any(QUANTITIES[tag.quantity].lead for tag in self._tags.values())

    def _message(self, values: Mapping[str, float], stamp_ns: int) -> bytes:
        parts: dict[str, float] = {}
        deviations: dict[str, float] = {}
        directions = np.zeros(3)
        heading = 0.0
        for name, value in values.items():
            tag = self._tags[name]
            quantity = QUANTITIES[tag.quantity]
            axis = tag.axis or quantity.default_axis
            parts[f"{quantity.part}.{axis}" if axis and quantity.axes else quantity.part] = value
            factor = conversion(tag.quantity, tag.unit, tag.radius, tag.area)[0]
            deviations[quantity.part] = max(abs(factor) * tag.deviation, deviations.get(quantity.part, 0.0))
            if tag.direction is not None:
                unit = np.array(tag.direction) / np.linalg.norm(tag.direction)
                directions += value * unit
            heading = tag.heading if tag.heading is not None else heading
        kind = QUANTITIES[next(iter(self._tags.values())).quantity].message
        build = {
            JointState.__msgtype__: self._joint,
            WrenchStamped.__msgtype__: self._force,
            Imu.__msgtype__: self._imu,
            Vector3Stamped.__msgtype__: self._wind,
            Temperature.__msgtype__: self._temperature,
        }[kind]
        if any(tag.direction is not None for tag in self._tags.values()):
            parts = {f"force.{axis}": float(directions[row]) for row, axis in enumerate(XYZ)}
        if "wind_speed" in parts:
            blows = parts["wind_direction"] - heading * DEGREE + math.pi  # towards, clockwise from the track
            speed = parts["wind_speed"]
            parts = {"wind.x": speed * math.cos(blows), "wind.y": -speed * math.sin(blows), "wind.z": 0.0}
        return serialize(build(parts, deviations, stamp_ns))

    def _joint(self, parts: Mapping[str, float], _: Mapping[str, float], stamp_ns: int) -> Any:
        fields = [np.array([parts[part]] if part in parts else []) for part in ("position", "velocity", "effort")]
        return JointState(header(stamp_ns, FRAME_ID), [self._of], *fields)

    def _force(self, parts: Mapping[str, float], _: Mapping[str, float], stamp_ns: int) -> Any:
        force = Vector3(*(parts.get(f"force.{axis}", 0.0) for axis in XYZ))
        return WrenchStamped(header(stamp_ns, self._of), Wrench(force, Vector3(0.0, 0.0, 0.0)))

    def _imu(self, parts: Mapping[str, float], deviations: Mapping[str, float], stamp_ns: int) -> Any:
        angle = "roll" if "roll" in parts else "pitch"
        turned = turned_about(angle, parts.get(angle, 0.0))
        vectors = {
            part: Vector3(*(parts.get(f"{part}.{axis}", 0.0) for axis in XYZ))
            for part in ("angular_velocity", "acceleration")
        }
        covariances = {
            part: deviations[part] ** 2 * np.eye(3).reshape(9) if part in deviations else UNKNOWN
            for part in (angle, "angular_velocity", "acceleration")
        }
        return Imu(
            header(stamp_ns, self._of),
            turned,
            covariances[angle],
            vectors["angular_velocity"],
            covariances["angular_velocity"],
            vectors["acceleration"],
            covariances["acceleration"],
        )

    def _wind(self, parts: Mapping[str, float], _: Mapping[str, float], stamp_ns: int) -> Any:
        return Vector3Stamped(header(stamp_ns, self._of), Vector3(*(parts.get(f"wind.{axis}", 0.0) for axis in XYZ)))

    def _temperature(self, parts: Mapping[str, float], _: Mapping[str, float], stamp_ns: int) -> Any:
        return Temperature(header(stamp_ns, FRAME_ID), parts["temperature"], 0.0)


class Assembly:
    """Assembler of all ROS messages of a plant map from the samples of its tags.

    Args:
        tags: tags of the map by name.

    Attributes:
        topics: table of the topics.
        groups: assemblers of messages, one for each topic and object.
    """

    def __init__(self, tags: Mapping[str, Tag]) -> None:
        members: dict[tuple[str, str, str], dict[str, Tag]] = {}
        types: dict[str, str] = {}
        for name, tag in tags.items():
            quantity = QUANTITIES[tag.quantity]
            topic = topic_of(tag)
            types[topic] = quantity.message
            kind = "effort" if quantity.part == "effort" else ""  # a force is a message of its own, as that of a sensor
            members.setdefault((topic, tag.of, kind), {})[name] = tag
        self.groups = [Group(topic, of, own) for (topic, of, _), own in members.items()]
        self._group_of = {name: group for group, own in zip(self.groups, members.values(), strict=True) for name in own}
        self.topics = tuple(Topic(name, kind) for name, kind in types.items())

    def take(self, measured: Iterable[tuple[str, Measured]]) -> list[Ready]:
        """Assemble messages from samples of any tags of the map."""
        by_group: dict[int, list[tuple[str, Measured]]] = {}
        for name, one in measured:
            by_group.setdefault(id(self._group_of[name]), []).append((name, one))
        groups = {id(group): group for group in self.groups}
        return [Ready(groups[key].topic, data) for key, own in by_group.items() for data in groups[key].take(own)]

    def drop(self, name: str) -> None:
        """Forget the held value of a tag whose newest sample was left out."""
        self._group_of[name].drop(name)


def topic_of(tag: Tag) -> str:
    """Full name of the topic on which the messages of a tag are published."""
    return f"{PLANT}/{QUANTITIES[tag.quantity].topic.replace('OF', tag.of)}"
