"""Snapshots and commands back from a log, one after the other: what a run showed, without simulating it again.

A log has the cable in single precision and nothing of the velocities of centres of mass, of haul ropes or of the
solver; what it does not have is NaN or None here, and zero in the solver's report. Logs without the topics of forces
give NaN for those. Of a tower a log has the force; its size stands for the normal load (friction adds to it, the turn
of the rope takes from it), and that in the first frame for the load at rest, where no snapshot that the run went on
from has it. The travel of a counterweight follows from the end of the cable, payloads from the commands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO

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
from cable_twin.recording.log_file import UNREADABLE, LogError, LogFile, one_line
from cable_twin.recording.log_reader import Log
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    DriveState,
    FloatArray,
    Snapshot,
    SolverReport,
    SupportState,
    TowerState,
)
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.snapshot_file import FullState, SnapshotError, read_full_state

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
        LogError: The scenario is not understood, or a message is unreadable; the line names topic and time.
    """
    try:
        frames = _Frames(log, load_scenario(log.scenario))
    except ScenarioError as error:
        raise LogError("\n".join(f"{log.path}: {fault}" for fault in error.faults)) from error
    frame: dict[str, bytes] = {}
    frame_stamp = -1
    topics = [*frames.needed, *frames.forces, APPLIED_COMMANDS]
    whole = True
    for file, moved in log.files_in_turn(on_position):
        if not whole:
            frames.go_on_from(file)
        for topic, stamp_ns, data in file.messages(topics, moved):
            if (stamp_ns != frame_stamp or topic == APPLIED_COMMANDS) and frame:
                if snapshot := frames.snapshot(frame_stamp, frame):
                    yield snapshot
                frame = {}
            frame_stamp = stamp_ns
            if topic == APPLIED_COMMANDS:
                applied = log.command(stamp_ns, data)
                frames.command(applied)
                yield applied
            else:
                frame[topic] = data
        whole = file.complete and not file.damage
    if frame and (snapshot := frames.snapshot(frame_stamp, frame)):
        yield snapshot


class _Frames:
    """Puts frames together; remembers what a single one does not tell."""

    def __init__(self, log: Log, scenario: Scenario) -> None:
        self._log, self._scenario = log, scenario
        self._vehicles = scenario.vehicles
        self._supports = (*SUPPORTS, *scenario.towers)
        self._rest_loads: dict[str, float] = {}  # N, of towers at rest, else in the first frame
        self._lowest_loads: dict[str, float] = {}  # N, since the start or the last reset
        self._payloads = self._first_payloads()
        self._full = _full_state(log.snapshot)
        if self._full is not None:
            self._rest_loads = dict(zip(scenario.towers, self._full.start.tower_load[:, 0].tolist(), strict=True))
            self._go_to(self._full.state.payload, self._full.state.tower_load)
        self.needed = [JOINT_STATES, CABLE]  # of a complete frame
        self.forces = [*map(support_force_topic, self._supports)]
        for name, vehicle in self._vehicles.items():
            self.needed += [pose_topic(name), *(pose_topic(name, body) for body in vehicle.bodies)]
            self.forces.append(contact_force_topic(name))

    def _first_payloads(self) -> dict[str, float]:
        """Payloads (kg) at the start of the run."""
        return {name: vehicle.payload.mass for name, vehicle in self._vehicles.items() if vehicle.payload is not None}

    def command(self, applied: AppliedCommand) -> None:
        """Follow what changes payloads and what is counted since the last reset."""
        if applied.command.kind == "payload":
            self._payloads.update(applied.command.values)
        elif applied.command.kind == "reset":
            if self._full is not None:
                self._go_to(self._full.start.payload, self._full.start.tower_load)
                return
            self._payloads = self._first_payloads()
            self._lowest_loads = dict(self._rest_loads)

    def go_on_from(self, file: LogFile) -> None:
        """Take over what was attached to a file, where commands before it are lost."""
        if (full := _full_state(file.snapshot())) is not None:
            self._full = full
            self._go_to(full.state.payload, full.state.tower_load)

    def _go_to(self, payloads: FloatArray, tower_loads: FloatArray) -> None:
        """Take over what no frame tells: payloads (vehicles,) in kg, loads (towers, 2) in N, now and least."""
        self._payloads = dict(zip(self._vehicles, payloads.tolist(), strict=True))
        self._lowest_loads = dict(zip(self._scenario.towers, tower_loads[:, 1].tolist(), strict=True))

    def snapshot(self, stamp_ns: int, frame: Mapping[str, bytes]) -> Snapshot | None:
        """Put one frame together; None where a part of it is missing."""
        if not all(topic in frame for topic in self.needed):
            return None
        time = (stamp_ns - self._log.epoch_ns) / SECOND
        topic = ""
        try:
            topic = JOINT_STATES
            joints = decode(frame[topic], "sensor_msgs/msg/JointState")
            position, velocity, effort = joints.position.tolist(), joints.velocity.tolist(), joints.effort.tolist()
            rows = dict(zip(joints.name, zip(position, velocity, effort, strict=True), strict=True))
            states = {}
            for name, vehicle in self._vehicles.items():
                bodies = {}
                for body in vehicle.bodies:
                    topic = pose_topic(name, body)
                    x, _, z = _numbers(frame[topic], 7)[:3].tolist()
                    pitch, pitch_rate, _ = rows[f"{name}/{body}"]
                    bodies[body] = BodyState(x, z, pitch, math.nan, math.nan, pitch_rate)
                topic = pose_topic(name)
                arc_length, speed, drive_force = rows[name]
                states[name] = CarriageState(
                    arc_length=arc_length,
                    speed=speed,
                    drive_force=drive_force,
                    contact_force=_force(frame, contact_force_topic(name)),
                    position=_numbers(frame[topic], 7)[Z],
                    bodies=bodies,
                    # what is off a moving cable hangs exactly at one of its ends
                    attached=vehicle.joint != "clamped"
                    or arc_length not in (0.0, self._scenario.cable.unstrained_length),
                    payload=self._payloads.get(name, 0.0),
                )
            drives = {name: DriveState(*rows[name]) for name in self._scenario.drives}
            topic = CABLE
            cable = _cable(frame[topic], int(self._log.metadata["sample_count"]))
        except UNREADABLE as error:
            raise LogError(f"{self._log.path}: {topic} at {time:.6f} s is unreadable: {one_line(error)}") from error
        supports = {
            name: self._support(name, _force(frame, support_force_topic(name)), cable) for name in self._supports
        }
        return Snapshot(time, states, supports, cable, NOTHING, drives)

    def _support(self, name: str, force: FloatArray, cable: CableSamples) -> SupportState:
        """What is known of a support by its force (2,) in N and the shape of the cable."""
        if name not in SUPPORTS:
            load = float(np.hypot(*force))
            rest = self._rest_loads.setdefault(name, load)
            lowest = self._lowest_loads[name] = min(load, self._lowest_loads.get(name, load))
            return SupportState(force, TowerState(load, lowest, rest, load == 0.0))
        end = getattr(self._scenario.cable, name)
        if end.support != "counterweight":
            return SupportState(force)
        place = cable.positions[0 if name == "start" else -1]
        direction = np.array(end.direction) / np.hypot(*end.direction)
        return SupportState(force, travel=float((place - np.array(end.position)) @ direction))


def _full_state(snapshot: bytes | None) -> FullState | None:
    """What a log or a file of it starts from, where that is a snapshot that this version reads."""
    if snapshot is None:
        return None
    try:
        return read_full_state(BytesIO(snapshot), SNAPSHOT_NAME)
    except SnapshotError:
        return None


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
