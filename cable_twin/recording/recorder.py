"""The thread between the frame loop and the disk: takes what is handed to it and writes log and view in its own time.

The frame loop never waits: `record` only appends to a queue. The thread sleeps, takes all that has come, and gives way
after each frame, so it holds the interpreter for fractions of a millisecond. It owns its sinks: it alone writes and
closes them. There is no lock anywhere, so a signal handler may do anything at any time.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, Protocol

from cable_twin.messages import APPLIED_COMMANDS
from cable_twin.recording.mcap_log import McapLog
from cable_twin.records import AppliedCommand, Snapshot

SLEEP = 0.05  # s between looks into the queue
CAPACITY = 6000  # frames, a minute at 100 Hz


class View(Protocol):
    """A picture of the run."""

    flush_period: float  # s

    def log(self, snapshot: Snapshot) -> None:
        """Draw one snapshot."""

    def log_command(self, applied: AppliedCommand) -> None:
        """Show a command that took effect."""

    def flush(self) -> None:
        """Send what is still waiting, onto the disk."""

    def close(self) -> None:
        """Finish."""


class _Item(NamedTuple):
    messages: Sequence[tuple[str, bytes]]
    stamp_ns: int
    snapshot: Snapshot | None
    applied: AppliedCommand | None


class _LogSink:
    name = "log"

    def __init__(self, log: McapLog) -> None:
        self._log = log
        self.flush_if_due = log.flush_if_due
        self.close = log.close

    @property
    def left(self) -> str:
        """What is still there after a failure, for its message."""
        return f"; readable up to {self._log.safe_until:.2f} s of simulated time, nothing later is written"

    def write(self, item: _Item) -> None:
        for topic, data in item.messages:
            self._log.write(topic, item.stamp_ns, data)


class _ViewSink:
    name = "view"
    left = ""

    def __init__(self, view: View) -> None:
        self._view = view
        self._flushed = time.monotonic()
        self.close = view.close

    def write(self, item: _Item) -> None:
        if item.snapshot is not None:
            self._view.log(item.snapshot)
        if item.applied is not None:
            self._view.log_command(item.applied)

    def flush_if_due(self) -> None:
        if time.monotonic() - self._flushed >= self._view.flush_period:
            self._flushed = time.monotonic()
            self._view.flush()


class Recorder:
    """Writes a run to a log and shows it in a view.

    A sink that fails is closed and left alone, the other one goes on; nothing is ever raised into the caller.

    Attributes:
        faults: What went wrong, a line each; whoever reports them takes them out.
        dropped: Frames that were not recorded: the queue was full, or the recorder closed.
    """

    def __init__(self, log: McapLog | None, view: View | None = None, *, capacity: int = CAPACITY) -> None:
        """Start the thread.

        Args:
            log: Where messages go; the recorder closes it.
            view: Where snapshots and commands go; the recorder closes it.
            capacity: Frames that may wait before new ones are dropped.
        """
        self.faults: list[str] = []
        self.dropped = 0
        self._sinks: list[_LogSink | _ViewSink] = []
        if log is not None:
            self._sinks.append(_LogSink(log))
        if view is not None:
            self._sinks.append(_ViewSink(view))
        self._capacity = capacity
        self._queue: deque[_Item] = deque()
        self._closing = False
        self._writing = False
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def backlog(self) -> int:
        """Frames that wait to be written."""
        return len(self._queue)

    @property
    def idle(self) -> bool:
        """Whether all that was handed over has been written."""
        return not self._queue and not self._writing

    @property
    def recording(self) -> bool:
        """Whether any sink is still alive."""
        return bool(self._sinks)

    def record(self, messages: Sequence[tuple[str, bytes]], stamp_ns: int, snapshot: Snapshot | None = None) -> None:
        """Hand over one frame; returns at once.

        Args:
            messages: Pairs of topic and CDR, for the log; not changed afterwards.
            stamp_ns: Stamp (ns since 1970) of all of them.
            snapshot: The twin at that time, for the view.
        """
        if self._closing or len(self._queue) >= self._capacity:
            self.dropped += 1
        elif self.recording:
            self._queue.append(_Item(messages, stamp_ns, snapshot, None))

    def record_command(self, applied: AppliedCommand, message: bytes, stamp_ns: int) -> None:
        """Hand over a command that took effect; never dropped, a replay needs every one.

        Args:
            applied: The command, for the view.
            message: The same as `applied_command_message` gives it, for the log.
            stamp_ns: Its stamp (ns since 1970).
        """
        if self._closing:
            self.dropped += 1
        elif self.recording:
            self._queue.append(_Item([(APPLIED_COMMANDS, message)], stamp_ns, None, applied))

    def close(self) -> None:
        """Write all that waits, close the sinks and end the thread; may be called again, also from a signal handler."""
        self._closing = True
        self._thread.join()

    def _run(self) -> None:
        while not self._closing:
            self._drain()
            for sink in tuple(self._sinks):
                self._attempt(sink, sink.flush_if_due)
            time.sleep(SLEEP)
        self._drain()
        for sink in tuple(self._sinks):
            self._attempt(sink, sink.close)
        self._sinks.clear()

    def _drain(self) -> None:
        self._writing = True  # before the queue gets empty
        while self._queue:
            item = self._queue.popleft()
            for sink in tuple(self._sinks):
                self._attempt(sink, sink.write, item)
            time.sleep(0)  # the frame loop may be waiting for the interpreter
        self._writing = False

    def _attempt(self, sink: _LogSink | _ViewSink, action: Callable[..., Any], *arguments: Any) -> None:
        """Do it; where it fails, keep the fault and give the sink up."""
        try:
            action(*arguments)
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            self._sinks.remove(sink)
            with suppress(Exception):
                sink.close()
            self.faults.append(f"recording: {sink.name} stopped: {text}{sink.left}")
