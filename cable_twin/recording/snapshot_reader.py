"""Snapshots and commands back from a log, one after the other: what a run showed, without simulating it again.

A log has the cable in single precision and nothing of the velocities of centres of mass or of the solver; what it does
not have is NaN here, and zero in the solver's report. Logs without the topics of forces give NaN for those.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from cable_twin.messages import (
    APPLIED_COMMANDS,
    CABLE,
    CABLE_FIELDS,
    JOINT_STATES,
    SECOND,
    SUPPORTS,
    contact_force_topic,
    decode,
    pose_topic,
    support_force_topic,
)
from cable_twin.recording.log_reader import UNREADABLE, Log, LogError, one_line
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    FloatArray,
    Snapshot,
    SolverReport,
    SupportState,
)

NOTHING = SolverReport(steps=0, iterations=0, halvings=0, constraint_residual=0.0)
POINT_SIZE = 4 * len(CABLE_FIELDS)  # bytes of a point of the cable
Z = slice(0, 3, 2)  # x and z of x, y, z


def read_snapshots(
    log: Log, *, on_position: Callable[[int], None] | None = None
) -> Iterator[Snapshot | AppliedCommand]:
    """Stream the frames of a log and the commands between them, one frame in memory.

    Args:
        log: Finished, or cut short: its last frame then may be missing.
        on_position: Called with the bytes of the file read so far.

    Yields:
        Snapshots, and each command where it took effect, in the order of the log.

    Raises:
        LogError: A message is unreadable; the line names topic and time.
    """
    carriages = {name: tuple(item["bodies"]) for name, item in log.scenario.get("carriages", {}).items()}
    wanted = [JOINT_STATES, CABLE, APPLIED_COMMANDS, *map(support_force_topic, SUPPORTS)]
    for name, bodies in carriages.items():
        wanted += [pose_topic(name), contact_force_topic(name), *(pose_topic(name, body) for body in bodies)]
    frame: dict[str, bytes] = {}
    frame_stamp = -1
    for topic, stamp_ns, data in log.messages(wanted, on_position):
        if (stamp_ns != frame_stamp or topic == APPLIED_COMMANDS) and frame:
            if snapshot := _snapshot(log, carriages, frame_stamp, frame):
                yield snapshot
            frame = {}
        frame_stamp = stamp_ns
        if topic == APPLIED_COMMANDS:
            yield log.command(stamp_ns, data)
        else:
            frame[topic] = data
    if frame and (snapshot := _snapshot(log, carriages, frame_stamp, frame)):
        yield snapshot


def _snapshot(
    log: Log, carriages: Mapping[str, tuple[str, ...]], stamp_ns: int, frame: Mapping[str, bytes]
) -> Snapshot | None:
    """Put one frame together; None where a part of it is missing."""
    needed = [JOINT_STATES, CABLE]
    for name, bodies in carriages.items():
        needed += [pose_topic(name), *(pose_topic(name, body) for body in bodies)]
    if not all(topic in frame for topic in needed):
        return None
    time = (stamp_ns - log.epoch_ns) / SECOND
    topic = ""
    try:
        topic = JOINT_STATES
        joints = decode(frame[topic], "sensor_msgs/msg/JointState")
        position, velocity, effort = joints.position.tolist(), joints.velocity.tolist(), joints.effort.tolist()
        pitches = {name: (position[index], velocity[index]) for index, name in enumerate(joints.name)}
        states = {}
        for index, (name, bodies) in enumerate(carriages.items()):
            states_of_bodies = {}
            for body in bodies:
                topic = pose_topic(name, body)
                x, _, z = _numbers(frame[topic], 7)[:3].tolist()
                pitch, pitch_rate = pitches[f"{name}/{body}"]
                states_of_bodies[body] = BodyState(x, z, pitch, math.nan, math.nan, pitch_rate)
            topic = pose_topic(name)
            states[name] = CarriageState(
                arc_length=position[index],
                speed=velocity[index],
                drive_force=effort[index],
                contact_force=_force(frame, contact_force_topic(name)),
                position=_numbers(frame[topic], 7)[Z],
                bodies=states_of_bodies,
            )
        topic = CABLE
        cable = _cable(frame[topic], int(log.metadata["sample_count"]))
    except UNREADABLE as error:
        raise LogError(f"{log.path}: {topic} at {time:.6f} s is unreadable: {one_line(error)}") from error
    supports = {name: SupportState(_force(frame, support_force_topic(name))) for name in SUPPORTS}
    return Snapshot(time, states, supports, cable, NOTHING)


def _numbers(data: bytes, count: int) -> FloatArray:
    """The doubles with which a message ends."""
    return np.frombuffer(data, "<f8", count, len(data) - 8 * count)


def _force(frame: Mapping[str, bytes], topic: str) -> FloatArray:
    """Force (2,) in N of a WrenchStamped, NaN where there is none."""
    return _numbers(frame[topic], 6)[Z] if topic in frame else np.full(2, np.nan)


def _cable(data: bytes, count: int) -> CableSamples:
    """Points of a PointCloud2: they stand before its last byte."""
    points = np.frombuffer(data, "<f4", count * len(CABLE_FIELDS), len(data) - 1 - count * POINT_SIZE)
    table = points.reshape(count, -1).astype(np.float64)
    return CableSamples(arc_lengths=table[:, 3], positions=table[:, Z], tensions=table[:, 4])


__all__ = ["read_snapshots"]
