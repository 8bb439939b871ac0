"""Output of a running twin: each message is built once, for its publisher and for the log."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from cable_twin.frame.records import AppliedCommand, PlantEstimates, TensionAhead
from cable_twin.frame.snapshot import Columns
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import APPLIED_COMMANDS, ESTIMATE, KEY_FIGURES, OUTLOOK, FrameNames, Topic, diagnostics_message
from cable_twin.messages.frame import Filled
from cable_twin.recording.frame_output import FrameOutput, Messages, Prepared
from cable_twin.recording.run import Run
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.watches import FigureWatch
from cable_twin.simulation import Simulation

BACKLOG = 1000  # frames that may wait for the recorder where the clock does not set the pace


class Output:
    """Publishers and logs of a running simulation.

    Args:
        simulation: running simulation.
        table: topics of the twin.
        publishers: functions that publish the bytes of a message, by topic.
        rates: rates (Hz) by group of topics, of the publishers and of the log.
        frame_rate: rate of frames (Hz).
        own: names of carriers with topics of their own.
        makers: makers of the messages of further topics, by topic.
        frames: names of coordinate frames.
        paced: whether the clock sets the pace; otherwise the recorder does.

    Attributes:
        figures: key figures of the run, with the watch of their limits.
    """

    def __init__(
        self,
        simulation: Simulation,
        table: Sequence[Topic],
        publishers: Mapping[str, Callable[[bytes], None]],
        rates: tuple[Mapping[str, float], Mapping[str, float]],
        *,
        frame_rate: float,
        own: Sequence[str],
        makers: Mapping[str, Callable[[Columns], Filled]],
        frames: FrameNames,
        paced: bool,
    ) -> None:
        self.figures = FigureWatch(KeyFigures(simulation.scenario), simulation.scenario)
        self._simulation = simulation
        self._publishers = publishers
        backlog = math.inf if paced else BACKLOG
        self._frames = FrameOutput(
            simulation, table, rates, frame_rate=frame_rate, own=own, frames=frames, backlog=backlog
        )
        for name, make in makers.items():
            self._frames.encoder.offer(name, make)
        self._once: Messages = []
        self._last_ns = 0  # newest published stamp
        self._frames.lay_out()  # now, as the first use compiles kernels
        self.figures.update(simulation.snapshot)
        self.prepare = self._frames.prepare

    @property
    def run(self) -> Run | None:
        """Recording of the run; None without recording."""
        return self._frames.run

    @run.setter
    def run(self, run: Run) -> None:
        self._frames.run = run

    def begin(self, clock: RunClock) -> None:
        """Begin the run, with the first file of the log and the present frame of the simulation."""
        epoch_ns = self._frames.encoder.epoch_ns = clock.begin(self._simulation.time)
        if self.run is not None:
            self.run.begin(epoch_ns)
        self._send_frame(self.prepare(self._simulation.snapshot))  # its key figures are updated already
        self.record(self._once, epoch_ns)

    def send_once(self, messages: Messages) -> None:
        """Publish latched messages, and record them at the start of the run."""
        self._once = messages
        for topic, data in messages:
            self._publishers[topic](data)

    def publish(self, frame: Prepared) -> None:
        """Publish a frame at its due time, then update the key figures, which cover published frames."""
        self._send_frame(frame)
        self.figures.update(frame.snapshot)

    def finish(self) -> None:
        """Record the key figures of all frames at the end of the run."""
        self.record([(KEY_FIGURES, diagnostics_message(self._last_ns, *self.figures.statuses()))], self._last_ns)

    def _send_frame(self, frame: Prepared) -> None:
        self._last_ns = frame.stamp_ns
        for number in frame.taken[0]:
            topic, data = frame.messages[number]
            self._publishers[topic](data)
        self._frames.record(frame)
        if frame.split is not None:
            self.record(self._once, frame.stamp_ns)  # each file of a log stands alone

    def listen(self, group: str, listening: bool) -> None:
        """Set whether a group of topics has subscribers: it is published at its rate, or not at all."""
        self._frames.listen(group, listening)

    def send_again(self, topic: str) -> None:
        """Publish a frame topic from the present snapshot, outside its rate; to be called in the solver's thread."""
        for name, data in self._frames.encoder.frame(self._simulation.snapshot, (topic,)):
            self._publishers[name](data)

    def send(self, messages: Messages, stamp_ns: int) -> None:
        """Publish and record messages that belong to no frame."""
        self._last_ns = stamp_ns
        for topic, data in messages:
            self._publishers[topic](data)
        self.record(messages, stamp_ns)

    def send_ahead(self, message: bytes, ahead: TensionAhead, stamp_ns: int) -> None:
        """Publish an outlook, record it, and draw its ranges of tension."""
        self.send([(OUTLOOK, message)], stamp_ns)
        if self.run is not None and self._frames.frames > 0:
            self.run.recorder.record_ahead(ahead, stamp_ns)

    def send_estimates(self, message: bytes, estimates: PlantEstimates, stamp_ns: int) -> None:
        """Publish estimates of a plant, record them, and draw them."""
        self.send([(ESTIMATE, message)], stamp_ns)
        if self.run is not None and self._frames.frames > 0:
            self.run.recorder.record_estimates(estimates, stamp_ns)

    def record(self, messages: Messages, stamp_ns: int) -> None:
        """Record messages without publishing; ignored before the run begins."""
        if self.run is not None and self._frames.frames > 0:
            self.run.recorder.record(messages, stamp_ns)

    def apply(self, applied: AppliedCommand) -> None:
        """Publish and record a command that has taken effect."""
        self.figures.command(applied)
        self._publishers[APPLIED_COMMANDS](self._frames.command(applied))
