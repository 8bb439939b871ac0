"""Companion process by which a twin follows a plant: the plant's messages from a pipe, and estimates back.

It stands beside the twin at a lower priority, and ends with it: as soon as the pipe is closed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty
from typing import IO, Any

from cable_twin.basics.printable import printable
from cable_twin.ensemble.estimate.tracker import FOLLOWING, LISTENING, WAITING, News, Tracker
from cable_twin.messages import READMITTED, SECOND, nanoseconds
from cable_twin.messages.command_messages import command_from_message
from cable_twin.messages.figure_messages import estimate_message
from cable_twin.messages.sensor_messages import measurements_from_message
from cable_twin.messages.texts import readmitted_from_message
from cable_twin.runtime.companion import inbox, send, serve_twin
from cable_twin.runtime.following import COMMANDS, COMPILING, Arrival, Estimated
from cable_twin.scenario import load_scenario
from cable_twin.simulation.first_compilation import Moment, watching_compilation

GLANCE = 0.1  # s between two looks at what is due
PART = 1.0  # s of the plant's messages at a time, so that it is known how far behind this is
LONGEST_REASON = 300  # characters


class Decoder:
    """Decoder of a plant's messages, which gives their measurements and commands to a tracker.

    Args:
        tracker: tracker that gets measurements and commands.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._tracker, self._sensors = tracker, tracker.sensors
        self.epoch_ns: int | None = None  # by the clock of this machine: the arrival of the first message

    def take(self, one: Arrival) -> None:
        """Decode a plant message and pass it to the tracker; unreadable messages are counted with their reason."""
        if self.epoch_ns is None:
            self.epoch_ns = one.arrival_ns
        arrival = (one.arrival_ns - self.epoch_ns) / SECOND
        try:
            if one.topic == READMITTED:
                self._tracker.readmit(readmitted_from_message(one.data))
            elif one.topic == COMMANDS:
                command = command_from_message("joint_commands", one.data)
                if getattr(command, "kind", "") == "speed" and self._tracker.arrivals.started:
                    self._tracker.command(command.values, arrival)  # type: ignore[union-attr]
            else:
                found = measurements_from_message(one.topic, one.data, self._sensors, self.epoch_ns)
                self._tracker.measure(found, arrival)
        except Exception as error:  # of whatever a stranger sends
            self._tracker.arrivals.leave_out(one.topic, printable(error, LONGEST_REASON))


def answers_of(news: News, tracker: Tracker, epoch_ns: int) -> Iterator[Estimated]:
    """Replies of the follow process to the node for one result of a tracker: estimates, alarms, log lines, counts."""
    correction, warnings = news.correction, list(news.warnings)
    message, of_payloads = b"", list[str]()
    if correction is not None:
        alarms, of_payloads = correction.said(of_payloads=False), correction.said(of_payloads=True)
        warnings += alarms
        stamp_ns, estimates = epoch_ns + nanoseconds(correction.time), {**correction.slow, **correction.hidden}
        state: dict[str, Any] = {"measured": tracker.state == FOLLOWING, "behind": tracker.behind}
        message = estimate_message(estimates, alarms, stamp_ns, of_payloads=of_payloads, **state)
    left_out = {name: one.reason for name, one in tracker.follower.left_out.items()}
    counts = dict(tracker.arrivals.left_out)
    told = tuple(warnings), tracker.state, left_out, counts, tracker.behind, tuple(of_payloads), news.notes
    yield Estimated(news.time, message, *told, swapped=dict(tracker.follower.doubts.swapped))


@contextmanager
def compilation_told(sink: IO[bytes]) -> Iterator[None]:
    """Context that sends one answer as soon as a kernel has to be compiled, which takes long beside a twin."""
    told = False

    def tell(_: Moment) -> None:
        nonlocal told
        if not told:
            told = True
            line = "the estimator compiles its kernels, once on this machine"
            send(sink, Estimated(0.0, b"", (), COMPILING, {}, {}, notes=(line,)))

    with watching_compilation(tell):
        yield


def serve(source: IO[bytes], sink: IO[bytes], leave: Callable[[], None]) -> None:
    """Follow a plant by the messages from a pipe, until the pipe is closed.

    Args:
        source: pipe with the options, then messages of the plant.
        sink: pipe for the answers.
        leave: called as soon as the source is closed.
    """
    waiting = inbox(source, leave)
    options = waiting.get()
    with compilation_told(sink):
        tracker = Tracker(load_scenario(options["scenario"]), threads=1, relief=options["relief"])
    decoder = Decoder(tracker)
    ready = f"the estimator is ready: it begins when the plant {tracker.wanted} for {LISTENING:g} s"
    send(sink, Estimated(0.0, b"", (), tracker.state, {}, {}, notes=(ready,)))
    taken = now = 0.0  # s of this machine's clock since the first message: up to which all is taken, and the present
    while True:
        try:
            decoder.take(waiting.get(timeout=GLANCE if taken == now else 1e-3))
            while True:
                decoder.take(waiting.get_nowait())
        except Empty:
            pass
        if decoder.epoch_ns is None:
            continue
        now = (time.time_ns() - decoder.epoch_ns) / SECOND
        taken = now if tracker.state == WAITING else min(taken + PART, now)
        for news in tracker.advance(taken, now):
            for answer in answers_of(news, tracker, decoder.epoch_ns):
                send(sink, answer)


if __name__ == "__main__":
    serve_twin(serve)
