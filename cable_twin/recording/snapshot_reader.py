"""Snapshots and commands read back from a log one after the other, without simulation.

A log holds each group of topics as often as it was told to; what it does not hold at a time is NaN in the snapshot of
that time, and so is what it never has: sheaves, energies, velocities of centres of mass, what has no topic.
The cable and what is known of carriers by their forces is in single precision; the pitch of a body below another one is
a sum of joints, right but for its last bits; roll and yaw are those of its pose. Of a tower a log has the force; its
size stands for the normal load (friction adds to it, the turn of the rope takes from it), and that in the first frame
for the load at rest, where no snapshot that the run went on from has it; its part across the line is what the groove
bears. The travel of a counterweight follows from the end of the cable, payloads from the commands, and the wind too
where it has no topic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from io import BytesIO
from math import nan
from typing import NamedTuple

import numpy as np

from cable_twin.frame.records import AppliedCommand, FloatArray, RefusedCommand, SolverReport
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.messages import (
    AIR_WIND,
    APPLIED_COMMANDS,
    CABLE,
    CABLE_FIELDS,
    CARRIER_FORCES,
    CARRIER_POSES,
    CONNECTORS,
    DERAILMENTS,
    FORCE_FIELDS,
    JOINT_REFERENCES,
    JOINT_STATES,
    KEY_FIGURES,
    PANTOGRAPHS,
    REFUSED_COMMANDS,
    ROPE_FIELD,
    SECOND,
    SHEAVES,
    TENSIONS,
    Status,
    bullwheel_numbers,
    contact_force_topic,
    decode,
    fill_bullwheels,
    fill_references,
    haul_force_topic,
    head_topic,
    hung_rows,
    joint_names,
    pose_topic,
    reference_numbers,
    refused_command_from_message,
    statuses_of_message,
    support_force_topic,
)
from cable_twin.recording.field_numbers import cloud_points, fill, joint_reader, last_numbers, reader, table_reader
from cable_twin.recording.log_file import UNREADABLE, LogFile, one_line
from cable_twin.recording.log_reader import Log
from cable_twin.recording.log_versions import LogError
from cable_twin.recording.logged_supports import LoggedSupports
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.scenario import Scenario, ScenarioError, in_space, load_scenario
from cable_twin.simulation.snapshot_file import FullState, SnapshotError, read_full_state

NOTHING = SolverReport(steps=0, iterations=0, halvings=0, constraint_residual=0.0)
POSE = 7  # numbers: place and quaternion


class RecordedFigures(NamedTuple):
    """Key figures recorded by the run itself."""

    time: float  # s
    statuses: list[Status]


Item = Snapshot | AppliedCommand | RefusedCommand | RecordedFigures


def read_snapshots(log: Log, *, on_position: Callable[[int], None] | None = None) -> Iterator[Item]:
    """Stream the frames of a log and the items between these, with one frame in memory.

    Args:
        log: Finished, or cut short: its last frame then may be missing.
        on_position: Called with the bytes of the file read so far.

    Yields:
        Snapshots, each command where it took effect or was refused, and key figures where they were recorded, in the
        order of the log.

    Raises:
        LogError: The scenario is not understood, or a message is unreadable; the line names topic and time.
    """
    try:
        frames = _Frames(log, load_scenario(log.scenario))
    except ScenarioError as error:
        raise LogError("\n".join(f"{log.path}: {fault}" for fault in error.faults)) from error
    stamp = -1
    topics = [*frames.readers, APPLIED_COMMANDS, REFUSED_COMMANDS, KEY_FIGURES]
    before: LogFile | None = None
    for file, moved in log.files_in_turn(on_position):
        if before is not None and not file.follows(before):
            frames.go_on_from(file)
        before = file
        for topic, stamp_ns, data in file.messages(topics, moved):
            in_frame = topic in frames.readers
            if (stamp_ns != stamp or not in_frame) and (snapshot := frames.take()) is not None:
                yield snapshot
            stamp = stamp_ns
            if in_frame:
                frames.read(topic, stamp_ns, data)
            elif topic == APPLIED_COMMANDS:
                applied = log.command(stamp_ns, data)
                frames.command(applied)
                yield applied
            elif topic == REFUSED_COMMANDS:
                yield frames.refusal(stamp_ns, data)
            else:
                yield frames.figures(stamp_ns, data)
    if (snapshot := frames.take()) is not None:
        yield snapshot


class _Frames:
    """Assembly of frames from messages, with the data that a single frame lacks.

    Attributes:
        readers: what takes in the message of each topic of a frame.
    """

    def __init__(self, log: Log, scenario: Scenario) -> None:
        self._log, self._scenario = log, scenario
        layout = self._layout = Layout.of(scenario, int(log.metadata["sample_count"]))
        self._numbers = np.full(layout.size, nan)
        self._columns = layout.columns(self._numbers)
        self._empty = True
        self._clamped = np.array([vehicle.joint == "clamped" for vehicle in scenario.vehicles.values()], dtype=bool)
        self._supports = LoggedSupports(scenario, layout)
        self._winds = np.array([in_space(scenario.air.wind)] * 2)  # m/s, at the start and now
        self._payloads = self._first_payloads()
        self._names_checked = False
        self._lengths = np.array([cable.unstrained_length for cable in scenario.cables.values()])
        self._hung = hung_rows(layout)
        self._full = _full_state(log.snapshot)
        if self._full is not None:
            self._supports.rest_loads[:] = np.concatenate([start.tower_load[:, 0] for start in self._full.starts])
            self._winds[0] = in_space(tuple(self._full.start.wind.tolist()))
            self._go_to(self._full)
        self.readers = self._make_readers()

    def _make_readers(self) -> dict[str, Callable[[bytes], None]]:
        """Readers for all topics of frames in a log."""
        layout, c = self._layout, self._columns
        readers: dict[str, Callable[[bytes], None]] = {JOINT_STATES: self._read_joints, CABLE: self._read_cable}
        readers[TENSIONS] = self._read_tensions
        readers[AIR_WIND] = reader(3, [c.wind])
        for row, (name, bodies) in enumerate(layout.vehicles.items()):
            readers[pose_topic(name)] = reader(POSE, [c.joint_position[row]])
            readers[contact_force_topic(name)] = reader(6, [c.contact_force[row]])
            readers[haul_force_topic(name)] = reader(6, [c.haul_pull[row]])
            for body, body_name in enumerate(bodies, layout.first_body[row]):
                targets = [c.body_position[body], c.body_orientation[body]]
                readers[pose_topic(name, body_name)] = reader(POSE, targets)
        if layout.carriers:
            first = len(layout.carriages)
            hung = slice(layout.first_body[first], None)
            readers[CARRIER_POSES] = table_reader([c.body_position[hung], c.body_orientation[hung]])
            joints, forces = c.joint_position[first:], c.contact_force[first:]
            readers[CARRIER_FORCES] = lambda data: fill(cloud_points(data, len(joints), FORCE_FIELDS), [joints, forces])
        if layout.commanded:
            doubles = reference_numbers(layout)
            readers[JOINT_REFERENCES] = lambda data: fill_references(last_numbers(data, doubles), layout, self._numbers)
        if layout.sheaves:
            count = bullwheel_numbers(layout)
            readers[SHEAVES] = lambda data: fill_bullwheels(last_numbers(data, count), layout, c)
        if layout.connectors:
            readers[CONNECTORS] = reader(len(layout.connectors), [c.connector_force])
        for row, name in enumerate(layout.pantographs):
            readers[head_topic(name)] = reader(POSE, [c.pantograph_position[row]])
        if layout.pantographs:
            readers[PANTOGRAPHS] = joint_reader(c.pantograph_speed, c.pantograph_force)
        if layout.grooves:
            readers[DERAILMENTS] = self._supports.read
        for row, name in enumerate(layout.supports):
            readers[support_force_topic(name)] = reader(6, [c.support_force[row]])
        return readers

    def read(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Read a message of a frame; raises LogError where unreadable."""
        try:
            self.readers[topic](data)
        except UNREADABLE as error:
            raise self._unreadable(topic, stamp_ns, error) from error
        self._columns.time[0] = self._time(stamp_ns)
        self._empty = False

    def take(self) -> Snapshot | None:
        """Completed frame, None without one; the next frame begins."""
        if self._empty:
            return None
        c = self._columns
        c.payload[:], c.wind[:] = self._payloads, np.where(np.isnan(c.wind), self._winds[1], c.wind)
        # what is off a moving cable hangs exactly at one of its ends
        self._layout.off_loop(c)
        ends = (c.arc_length == 0.0) | (c.arc_length == self._lengths[np.nan_to_num(c.vehicle_rope).astype(np.int64)])
        c.attached[:] = np.where(np.isnan(c.arc_length), nan, ~(self._clamped & ends))
        self._turn_bodies()
        self._supports.fill(c)
        snapshot = Snapshot(self._layout, self._numbers.copy(), NOTHING)
        self._numbers.fill(nan)
        self._empty = True
        return snapshot

    def command(self, applied: AppliedCommand) -> None:
        """Apply the effects of a command on payloads, wind and counts since the last reset."""
        if applied.command.kind == "payload":
            for name, mass in applied.command.values.items():
                self._payloads[[*self._layout.vehicles].index(name)] = mass
        elif applied.command.kind == "wind":
            self._winds[1] = [applied.command.values.get(axis, 0.0) for axis in "xyz"]
        elif applied.command.kind == "reset":
            if self._full is not None:
                self._go_to(self._full, back=True)
                return
            self._winds[1] = self._winds[0]
            self._payloads = self._first_payloads()
            self._supports.reset()

    def refusal(self, stamp_ns: int, data: bytes) -> RefusedCommand:
        """Read a refused command; raises LogError where unreadable."""
        try:
            return refused_command_from_message(data, self._time(stamp_ns))
        except UNREADABLE as error:
            raise self._unreadable(REFUSED_COMMANDS, stamp_ns, error) from error

    def figures(self, stamp_ns: int, data: bytes) -> RecordedFigures:
        """Read recorded key figures; raises LogError where unreadable."""
        try:
            return RecordedFigures(self._time(stamp_ns), statuses_of_message(data))
        except UNREADABLE as error:
            raise self._unreadable(KEY_FIGURES, stamp_ns, error) from error

    def go_on_from(self, file: LogFile) -> None:
        """Take over the state attached to a file, where commands before it are lost."""
        if (full := _full_state(file.snapshot())) is not None:
            self._full = full
            self._go_to(full)

    def _time(self, stamp_ns: int) -> float:
        """Simulated time (s) of a time stamp."""
        return (stamp_ns - self._log.epoch_ns) / SECOND

    def _unreadable(self, topic: str, stamp_ns: int, error: Exception) -> LogError:
        when = f"{self._time(stamp_ns):.6f} s"
        return LogError(f"{self._log.path}: {topic} at {when} is unreadable: {one_line(error)}")

    def _first_payloads(self) -> FloatArray:
        """Payloads (vehicles,) in kg at the start of the run."""
        vehicles = self._scenario.vehicles.values()
        return np.array([0.0 if vehicle.payload is None else vehicle.payload.mass for vehicle in vehicles])

    def _go_to(self, full: FullState, *, back: bool = False) -> None:
        """Take over payloads, supports and wind from a full state or, with `back`, from its start."""
        states = full.starts if back else full.states
        alone = [self._scenario.of_rope(name) for name in self._scenario.cables]
        for one, state in zip(alone, states, strict=True):  # of what rides a loop, as its last strand has it
            for vehicle, mass in zip(one.vehicles, state.payload.tolist(), strict=True):
                self._payloads[self._layout.vehicle_rows[vehicle]] = mass
        self._supports.go_to(states)
        self._winds[1] = in_space(tuple(states[0].wind.tolist()))

    def _read_joints(self, data: bytes) -> None:
        """Read the columns of joint_states, from three arrays of one length at the end, 8 bytes apart."""
        layout, c = self._layout, self._columns
        if not self._names_checked:
            names = decode(data, "sensor_msgs/msg/JointState").name
            if names != [*layout.vehicles, *layout.drives, *joint_names(layout)]:
                raise ValueError(f"its names are not those of the scenario: {', '.join(names[:5])}, ...")
            self._names_checked = True
        vehicles, drives = len(layout.vehicles), len(layout.vehicles) + len(layout.drives)
        count = drives + len(layout.bodies)
        numbers = last_numbers(data, 3 * count + 2)
        place, rate, force = numbers[:count], numbers[count + 1 : 2 * count + 1], numbers[2 * count + 2 :]
        c.arc_length[:], c.drive_position[:] = place[:vehicles], place[vehicles:drives]
        c.speed[:], c.drive_speed[:] = rate[:vehicles], rate[vehicles:drives]
        c.drive_force[:], c.moving_cable_force[:] = force[:vehicles], force[vehicles:drives]
        c.body_angles[:] = 0.0
        c.body_angles[:, 1], c.body_angular_velocity[:, 1] = place[drives:], rate[drives:]
        for row in self._hung:  # from the rope down: each against the one above it
            for column in (c.body_angles, c.body_angular_velocity):
                column[row, 1] += column[row - 1, 1]

    def _read_cable(self, data: bytes) -> None:
        fields = (*CABLE_FIELDS, ROPE_FIELD) if self._layout.alone else CABLE_FIELDS
        points = cloud_points(data, len(self._layout.arc_lengths), fields)
        self._columns.rope_position[:], self._columns.rope_tension[:] = points[:, :3], points[:, 4]

    def _read_tensions(self, data: bytes) -> None:
        """Read lowest, then highest tensions of all ropes with their places, from arrays 8 bytes apart."""
        c, count = self._columns, len(self._layout.ropes)
        numbers = last_numbers(data, 4 * count + 1)
        c.lowest_tension[:, 1], c.highest_tension[:, 1] = numbers[: 2 * count].reshape(2, -1)
        c.lowest_tension[:, 0], c.highest_tension[:, 0] = numbers[2 * count + 1 :].reshape(2, -1)

    def _turn_bodies(self) -> None:
        """Compute roll and yaw of bodies in space from their quaternions: about z, then own y, then own x."""
        if self._scenario.dim == 3:
            x, y, z, w = self._columns.body_orientation.T
            angles = self._columns.body_angles
            angles[:, 0] = np.arctan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
            angles[:, 2] = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))


def _full_state(snapshot: bytes | None) -> FullState | None:
    """Full state from which a log or a file starts, None without one of a readable version."""
    try:
        return None if snapshot is None else read_full_state(BytesIO(snapshot), SNAPSHOT_NAME)
    except SnapshotError:
        return None


__all__ = ["Item", "RecordedFigures", "read_snapshots"]
