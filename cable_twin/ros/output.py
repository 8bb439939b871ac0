"""What leaves the node frame by frame: each message built once, for its publisher and for the log."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from cable_twin.command_messages import applied_command_message
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import (
    APPLIED_COMMANDS,
    KEY_FIGURES,
    MessageEncoder,
    Schedule,
    Topic,
    diagnostics_message,
    nanoseconds,
)
from cable_twin.recording.run import Run
from cable_twin.records import AppliedCommand
from cable_twin.ros.figure_watch import FigureWatch
from cable_twin.ros.run_clock import RunClock
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import FullState
from cable_twin.snapshot import Snapshot

BACKLOG = 1000  # frames that may wait for the recorder where nothing else sets the pace
Publish = Callable[[bytes], None]
Messages = list[tuple[str, bytes]]


class Prepared(NamedTuple):
    """A frame that is computed and encoded, and waits for its time."""

    snapshot: Snapshot
    stamp_ns: int
    published: list[tuple[Publish, bytes]]
    logged: Messages
    split: FullState | None  # where a new file of the log begins with it


class Output:
    """Publishers and logs of a running simulation.

    Args:
        simulation: what runs.
        table: its topics.
        publishers: of those that are published, by name.
        rates: Hz by group of topics, of publishers and of logs.
        frame_rate: Hz.
        own: carriers with topics of their own.
        paced: whether the clock sets the pace; where not, the recorder does.
    """

    def __init__(
        self,
        simulation: Simulation,
        table: Sequence[Topic],
        publishers: Mapping[str, Publish],
        rates: tuple[Mapping[str, float], Mapping[str, float]],
        *,
        frame_rate: float,
        own: Sequence[str],
        paced: bool,
    ) -> None:
        self.run: Run | None = None
        self.figures = FigureWatch(KeyFigures(simulation.scenario))
        self._simulation = simulation
        self._publishers = publishers
        self._schedule = Schedule(table, frame_rate, *rates)
        self._encoder = MessageEncoder(simulation.layout, own=own)
        self._frame = 0
        self._last_ns = 0  # newest stamp that was published
        self._paced = paced
        # what is laid out, or compiled, at the first use
        self._encoder.frame(simulation.snapshot, self._schedule.due(0, everything=True).names)
        self.figures.update(simulation.snapshot)

    def begin(self, clock: RunClock) -> None:
        """Let the run begin now: with the first file of the log and the frame that the simulation is at."""
        self._encoder.epoch_ns = clock.begin(self._simulation.time)
        if self.run is not None:
            self.run.begin(self._encoder.epoch_ns)
        self._send_frame(self.prepare(self._simulation.snapshot))  # whose figures are taken already

    def prepare(self, snapshot: Snapshot) -> Prepared:
        """Encode what is due with a new frame; the simulation is at its time."""
        split = None
        if self.run is not None and self.run.recorder.split_due(snapshot.time):
            split = self._simulation.capture()
        due = self._schedule.due(self._frame, everything=split is not None)
        self._frame += 1
        messages = self._encoder.frame(snapshot, due.names)
        published, logged = due.taken
        return Prepared(
            snapshot,
            self._encoder.stamp_ns(snapshot),
            [(self._publishers[messages[number][0]], messages[number][1]) for number in published],
            [messages[number] for number in logged] if self.run is not None else [],
            split,
        )

    def publish(self, frame: Prepared) -> None:
        """Send a frame: its time has come; then take it in, so that key figures are those of published frames."""
        self._send_frame(frame)
        self.figures.update(frame.snapshot)

    def finish(self) -> None:
        """Record the key figures of all frames, in the end."""
        self.record([(KEY_FIGURES, diagnostics_message(self._last_ns, *self.figures.statuses()))], self._last_ns)

    def _send_frame(self, frame: Prepared) -> None:
        self._last_ns = frame.stamp_ns
        for publish, data in frame.published:
            publish(data)
        if self.run is None:
            return
        recorder = self.run.recorder
        if frame.split is not None:
            recorder.split(frame.split)
        recorder.record(frame.logged, frame.stamp_ns, frame.snapshot)
        while not self._paced and recorder.backlog > BACKLOG:
            time.sleep(0.01)  # as fast as possible is not faster than the disk

    def send(self, messages: Messages, stamp_ns: int) -> None:
        """Publish and record what is no part of a frame."""
        self._last_ns = stamp_ns
        for topic, data in messages:
            self._publishers[topic](data)
        self.record(messages, stamp_ns)

    def record(self, messages: Messages, stamp_ns: int) -> None:
        """Record what is not published, or has been; nothing before the run begins."""
        if self.run is not None and self._frame > 0:
            self.run.recorder.record(messages, stamp_ns)

    def apply(self, applied: AppliedCommand) -> None:
        """Publish and record a command that took effect."""
        self.figures.command(applied)
        epoch_ns = self._encoder.epoch_ns
        data = applied_command_message(applied, epoch_ns)
        self._publishers[APPLIED_COMMANDS](data)
        if self.run is not None:
            self.run.recorder.record_command(applied, data, epoch_ns + nanoseconds(applied.time))
