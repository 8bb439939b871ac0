"""Encoding of frames for publisher and log: due messages, splitting of the log into files, limit of its backlog."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cable_twin.frame.records import AppliedCommand, RefusedCommand
from cable_twin.frame.snapshot import Snapshot
from cable_twin.messages import (
    REFUSED_COMMANDS,
    DerailmentWatch,
    FrameNames,
    MessageEncoder,
    Schedule,
    Topic,
    nanoseconds,
    refused_command_message,
)
from cable_twin.messages.columns import groups_due
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.messages.sensor_messages import SensorOutput
from cable_twin.recording.run import Run
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import FullState

Messages = list[tuple[str, bytes]]


class Prepared(NamedTuple):
    """Encoded frame of a simulation, to be published and recorded at its due time."""

    snapshot: Snapshot
    stamp_ns: int
    messages: Messages  # due ones of all takers
    taken: tuple[tuple[int, ...], ...]  # for each taker, indices of its messages
    columns: tuple[str, ...]  # groups of columns for the log
    split: FullState | None  # state for a new file of the log that begins with this frame, else None


class FrameOutput:
    """Encoder and recorder of the frames of a running simulation.

    Attributes:
        run: log in which frames are recorded, or None.
        encoder: message encoder of the frames.
        frames: count of prepared frames.
    """

    def __init__(
        self,
        simulation: Simulation,
        table: Sequence[Topic],
        rates: Sequence[Mapping[str, float]],
        *,
        frame_rate: float,
        run: Run | None = None,
        epoch_ns: int = 0,
        own: Sequence[str] = (),
        frames: FrameNames | None = None,
        backlog: float = math.inf,
    ) -> None:
        """Prepare message encoder, sensors and schedule of a log.

        Args:
            simulation: Running simulation.
            table: Topics of the simulation.
            rates: Hz by group of topics, of each taker; the log is the last one.
            frame_rate: Hz.
            run: Log in which frames are recorded, or None.
            epoch_ns: ns since 1970 of simulated time zero.
            own: Carriers with topics of their own.
            frames: Names of coordinate frames; the default names where None.
            backlog: Frames that may wait for the disk before the simulation does.
        """
        self.run = run
        frames, scenario = frames or FrameNames(), simulation.scenario
        self.encoder = MessageEncoder(simulation.layout, epoch_ns, own=own, frames=frames)
        self.frames = 0
        self._frame_id = frames.frame_id
        self._simulation = simulation
        self._sensors = SensorOutput(scenario, simulation.layout, frames) if scenario.sensors else None
        self._derailments = DerailmentWatch()
        self._schedule = Schedule(table, frame_rate, *rates)
        self._backlog = backlog

    def lay_out(self) -> None:
        """Lay out the templates of all messages before simulated time runs."""
        self.encoder.frame(self._simulation.snapshot, self._schedule.due(0, everything=True).names)

    def listen(self, group: str, listening: bool) -> None:
        """Start publishing a group of topics at its rate, or stop the group while it has no subscribers."""
        self._schedule.listen(0, group, listening)

    def prepare(self, snapshot: Snapshot) -> Prepared:
        """Encode the due messages of a new frame; the simulation is at the time of the frame."""
        split = None
        if self.run is not None and self.run.recorder.split_due(snapshot.time):
            split = self._simulation.capture()
        due = self._schedule.due(self.frames, everything=split is not None)
        self.frames += 1
        messages, taken = self.encoder.frame(snapshot, due.names), due.taken
        arrived = self.encoder.frame(snapshot, self._derailments.due(snapshot, everything=split is not None))
        if self._sensors is not None:
            arrived += self._sensors.messages(snapshot, self.encoder.epoch_ns)
        if arrived:
            own = tuple(range(len(messages), len(messages) + len(arrived)))
            messages, taken = messages + arrived, tuple((*numbers, *own) for numbers in taken)
        return Prepared(snapshot, self.encoder.stamp_ns(snapshot), messages, taken, groups_due(due.groups[-1]), split)

    def record(self, frame: Prepared) -> None:
        """Record a frame, after the start of a new file where due; waits while the backlog exceeds its limit."""
        if self.run is None:
            return
        recorder = self.run.recorder
        if frame.split is not None:
            recorder.split(frame.split)
        messages = [frame.messages[number] for number in frame.taken[-1]]
        recorder.record(messages, frame.stamp_ns, frame.snapshot, frame.columns)
        while recorder.backlog > self._backlog:  # as fast as possible is not faster than the disk
            time.sleep(0.002)

    def refusal(self, refused: RefusedCommand) -> None:
        """Record a refused command in the log, as a message."""
        if self.run is not None:
            stamp_ns = self.encoder.epoch_ns + nanoseconds(refused.time)
            self.run.recorder.record([(REFUSED_COMMANDS, refused_command_message(refused, stamp_ns))], stamp_ns)

    def command(self, applied: AppliedCommand) -> bytes:
        """Record an applied command in the log; returns the command's message."""
        if self._sensors is not None and applied.command.kind == "reset":
            self._sensors.restart()
        data = applied_command_message(applied, self.encoder.epoch_ns, self._frame_id)
        if self.run is not None:
            stamp_ns = self.encoder.epoch_ns + nanoseconds(applied.time)
            self.run.recorder.record_command(applied, data, stamp_ns)
        return data
