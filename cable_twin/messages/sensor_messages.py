"""Sensor measurements as messages, with names and types as in a real plant, below `sensors/`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.basics.printable import printable
from cable_twin.frame.sensors import Measurement, Sensors, body_of
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.messages import (
    SECOND,
    FrameNames,
    JointState,
    Topic,
    decode,
    header,
    nanoseconds,
    serialize,
    stamp_in,
    support_force_topic,
)
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Sensor

Imu = ros2_jazzy.sensor_msgs__msg__Imu
WrenchStamped = ros2_jazzy.geometry_msgs__msg__WrenchStamped
Wrench = ros2_jazzy.geometry_msgs__msg__Wrench
Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion

TYPES: dict[str, Any] = {
    "encoder": JointState,
    "drive_force": JointState,
    "load_cell": WrenchStamped,
    "inclinometer": Imu,
    "imu": Imu,
}
JOINT_SENSORS = ("encoder", "drive_force")  # which share a topic
PLANT = "/plant"  # namespace of the topics of a plant
UNKNOWN = np.array([-1.0, *[0.0] * 8])  # covariance of what a sensor_msgs/Imu does not have


def sensor_topic(sensor: Sensor) -> str:
    """Relative name of the topic of a sensor; all encoders and drive forces share one topic."""
    if sensor.kind in JOINT_SENSORS:
        return "sensors/joint_states"
    if sensor.kind == "load_cell":
        return f"sensors/{support_force_topic(sensor.of)}"
    return f"sensors/{sensor.kind}/{sensor.of}{'/roll' if sensor.axis == 'roll' else ''}"


def sensor_topics(scenario: Scenario) -> tuple[Topic, ...]:
    """Topics of all sensors of a scenario; each message holds one sample."""
    types = {sensor_topic(one): TYPES[one.kind].__msgtype__ for one in scenario.sensors.values()}
    return tuple(Topic(name, kind) for name, kind in types.items())


def plant_name(topic: str) -> str:
    """Full name of the topic of a plant with the measurements of a relative topic of a twin."""
    return f"{PLANT}/{topic.removeprefix('sensors/')}"


def plant_names(scenario: Scenario) -> dict[str, str]:
    """Full topic names of the sensors of a plant, by the relative names of the twin's sensor topics."""
    return {topic.name: plant_name(topic.name) for topic in sensor_topics(scenario)}


def plant_topics(scenario: Scenario) -> dict[str, Topic]:
    """Topics of the sensors of a plant, by relative names of the twin's topics; best effort suits any publisher."""
    names = plant_names(scenario)
    return {
        topic.name: replace(topic, name=names[topic.name], reliability="best_effort", depth=100)
        for topic in sensor_topics(scenario)
    }


def measurements_from_message(
    topic: str, data: bytes, sensors: Mapping[str, Sensor], epoch_ns: int
) -> list[Measurement]:
    """Decode the measurements in a sensor message of a plant or twin; inverse of `SensorOutput`.

    Args:
        topic: relative name, as `sensor_topic` gives it.
        data: CDR.
        sensors: known ones by name.
        epoch_ns: ns since 1970 of simulated time zero.

    Raises:
        ValueError: no known sensor belongs to the topic or to a name in the message.
    """
    names: dict[tuple[str, str], str] = {(one.kind, one.of): name for name, one in sensors.items()}
    if topic == "sensors/joint_states":
        message: Any = decode(data, JointState.__msgtype__)
        time = (stamp_in(data) - epoch_ns) / SECOND
        found = []
        for row, name in enumerate(message.name):
            for kind, fields in (("encoder", ("position", "velocity")), ("drive_force", ("effort",))):
                values = [getattr(message, field) for field in fields]
                if not len(values[0]):
                    continue
                if (kind, name) not in names:
                    known = ", ".join(of for one, of in names if one == kind)
                    raise ValueError(f"{kind}: given '{printable(name, 40)}'; allowed: {known or 'none'}")
                found.append(Measurement(names[kind, name], time, tuple(float(one[row]) for one in values if len(one))))
        return found
    name = next((name for name, one in sensors.items() if sensor_topic(one) == topic), "")
    if not name:
        raise ValueError(
            f"sensor topic: given {topic}; allowed: "
            f"{', '.join(sorted({sensor_topic(one) for one in sensors.values()}))}"
        )
    message = decode(data, TYPES[sensors[name].kind].__msgtype__)
    time = (stamp_in(data) - epoch_ns) / SECOND
    if sensors[name].kind == "load_cell":
        force = message.wrench.force
        return [Measurement(name, time, (force.x, force.y, force.z))]
    if sensors[name].kind == "inclinometer":
        turn = message.orientation
        about = turn.x if sensors[name].axis == "roll" else turn.y
        return [Measurement(name, time, (2.0 * float(np.arctan2(about, turn.w)),))]
    turn, pull = message.angular_velocity, message.linear_acceleration
    return [Measurement(name, time, (turn.x, turn.y, turn.z, pull.x, pull.y, pull.z))]


def turned_about(axis: str, angle: float) -> Any:
    """Orientation (geometry_msgs/Quaternion) of a rotation by an angle (rad) about the `roll` or `pitch` axis."""
    sine, cosine = float(np.sin(0.5 * angle)), float(np.cos(0.5 * angle))
    return Quaternion(sine, 0.0, 0.0, cosine) if axis == "roll" else Quaternion(0.0, sine, 0.0, cosine)


class SensorOutput:
    """Simulated sensors of a run, and the messages of their measurements.

    Args:
        scenario: with the parameters of all sensors.
        layout: of its frames.
        frames: names of coordinate frames.
    """

    def __init__(self, scenario: Scenario, layout: Layout, frames: FrameNames) -> None:
        self._frames = frames
        self._sensors, self._scenario, self._layout = Sensors(scenario, layout), scenario, layout
        self.restart = self._sensors.restart

    def messages(self, snapshot: Snapshot, epoch_ns: int) -> list[tuple[str, bytes]]:
        """Messages of measurements that arrived until a frame, stamped with the time of measurement."""
        return [self.message(item, epoch_ns + nanoseconds(item.time)) for item in self._sensors.take(snapshot)]

    def message(self, measurement: Measurement, stamp_ns: int) -> tuple[str, bytes]:
        """Encode a measurement as topic and message, with a stamp (ns since 1970)."""
        sensor, values = self._scenario.sensors[measurement.sensor], measurement.values
        topic = sensor_topic(sensor)
        if sensor.kind == "encoder":
            place, speed = np.array(values[:1]), np.array(values[1:])
            return topic, serialize(
                JointState(header(stamp_ns, self._frames.frame_id), [sensor.of], place, speed, np.empty(0))
            )
        if sensor.kind == "drive_force":
            none, force = np.empty(0), np.array(values)
            return topic, serialize(JointState(header(stamp_ns, self._frames.frame_id), [sensor.of], none, none, force))
        if sensor.kind == "load_cell":
            wrench = Wrench(Vector3(*values), Vector3(0.0, 0.0, 0.0))
            return topic, serialize(WrenchStamped(header(stamp_ns, self._frames.named(sensor.of)), wrench))
        head = header(stamp_ns, self._frames.named(body_of(sensor, self._layout)))
        if sensor.kind == "inclinometer":
            turned, still = turned_about(sensor.axis, values[0]), Vector3(0.0, 0.0, 0.0)
            return topic, serialize(Imu(head, turned, _square(sensor.noise), still, UNKNOWN, still, UNKNOWN))
        upright = Quaternion(0.0, 0.0, 0.0, 1.0)
        turn, pull = Vector3(*values[:3]), Vector3(*values[3:])
        covariances = _square(sensor.rate_noise), _square(sensor.noise)
        return topic, serialize(Imu(head, upright, UNKNOWN, turn, covariances[0], pull, covariances[1]))


def _square(deviation: float) -> np.ndarray:
    """Covariance matrix (9,) of three independent numbers with one standard deviation."""
    return deviation**2 * np.eye(3).reshape(9)
