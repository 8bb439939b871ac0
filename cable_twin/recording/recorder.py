"""Writer thread between the frame loop and the disk: queues items and writes log and view in its own time.

The frame loop never waits: `record` only appends to a queue. The thread sleeps, takes all that has come, and gives way
after some frames, so it holds the interpreter for fractions of a millisecond. It owns its sinks: it alone writes,
splits and closes them. There is no lock anywhere, so a signal handler may do anything at any time.

The caller asks before each frame whether a new file is due, and then hands over the full state of that moment:

    if recorder.split_due(simulation.time):
        recorder.split(simulation.capture())
    recorder.record(...)
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from cable_twin.frame.records import AppliedCommand, PlantEstimates, TensionAhead
from cable_twin.frame.snapshot import Snapshot
from cable_twin.messages import APPLIED_COMMANDS, SCENARIO, SECOND, nanoseconds
from cable_twin.messages.columns import COLUMNS, GROUPS, RowEncoder
from cable_twin.recording.log_writer import McapLog
from cable_twin.recording.mcap_file import GoneError
from cable_twin.recording.splitting import MEGABYTE, UNSPLIT, Splitting
from cable_twin.simulation.snapshot_file import FullState

SLEEP = 0.05  # s between looks into the queue
TURN = 16  # frames that are written, in about half a millisecond, before others get the interpreter for sure
CAPACITY = 6000  # frames, a minute at 100 Hz
TICK = 1e-9  # s, what two times may differ by that mean the same


class View(Protocol):
    """Interface of a live or recorded picture of a run, such as rerun."""

    flush_period: float  # s

    def log(self, snapshot: Snapshot) -> None:
        """Draw one snapshot into the picture."""

    def log_command(self, applied: AppliedCommand) -> None:
        """Show an applied command in the picture."""

    def log_ahead(self, ahead: TensionAhead) -> None:
        """Show the predicted range of rope tension in the near future in the picture."""

    def log_estimates(self, estimates: PlantEstimates) -> None:
        """Show the estimates of a plant that is followed in the picture."""

    def flush(self) -> None:
        """Send waiting data of the picture to disk."""

    def split(self, path: Path) -> None:
        """Close the file of the picture and continue in another one."""

    def close(self) -> None:
        """Close the picture and its file."""


class _Beginning(NamedTuple):
    """Queue item: start of the first or of a later file of the log."""

    epoch_ns: int
    stamp_ns: int
    scenario: bytes
    full_state: FullState | None  # None for a run from the start of its scenario
    first: bool


class _Item(NamedTuple):
    messages: Sequence[tuple[str, bytes]]
    stamp_ns: int
    snapshot: Snapshot | None
    columns: Sequence[str]
    applied: AppliedCommand | None
    ahead: TensionAhead | None = None
    estimates: PlantEstimates | None = None


class _LogSink:
    """Sink that writes queued items into the bag; idle between the loss of its directory and the next new file.

    Attributes:
        gone: Whether the directory is lost and no new file has begun in another one.
    """

    name = "log"

    def __init__(self, log: McapLog, new_directory: Callable[[Path], Path] | None) -> None:
        self._log, self._new_directory = log, new_directory
        self.gone = False
        self.may_move = new_directory is not None
        self._rows: RowEncoder | None = None  # of the layout of the first snapshot
        self.close = log.close

    def flush_if_due(self) -> None:
        if not self.gone:
            self._log.flush_if_due()

    @property
    def left(self) -> str:
        """End of the message about a failure of the log: simulated time up to which the log is readable."""
        return f"; readable up to {self._log.safe_until:.2f} s of simulated time, nothing later is written"

    def write(self, item: _Item) -> None:
        if self.gone:
            return
        if item.snapshot is not None:
            self._rows = self._rows or RowEncoder(item.snapshot.layout)
            if (row := self._rows.encode(item.snapshot, item.columns)) is not None:
                self._log.write(COLUMNS, item.stamp_ns, row)  # the first of a frame
        for topic, data in item.messages:
            self._log.write(topic, item.stamp_ns, data)

    def begin(self, beginning: _Beginning, number: int) -> None:
        snapshot = None
        if beginning.full_state is not None:
            stream = BytesIO()
            beginning.full_state.write(stream)
            snapshot = stream.getvalue()
        if beginning.first:
            self._log.begin(beginning.epoch_ns, snapshot)
        elif self._new_directory is not None and (self.gone or self._log.is_gone):
            self._log.move(self._new_directory(self._log.directory), snapshot, number)
            self.gone = False
        else:
            self._log.split(snapshot, number)
        self._log.write(SCENARIO, beginning.stamp_ns, beginning.scenario)


class _ViewSink:
    name = "view"
    left = ""

    def __init__(self, view: View, log: McapLog | None) -> None:
        self._view = view
        self._log = log
        self._flushed = time.monotonic()
        self.close = view.close

    def write(self, item: _Item) -> None:
        if item.snapshot is not None:
            self._view.log(item.snapshot)
        if item.applied is not None:
            self._view.log_command(item.applied)
        if item.ahead is not None:
            self._view.log_ahead(item.ahead)
        if item.estimates is not None:
            self._view.log_estimates(item.estimates)

    def begin(self, beginning: _Beginning, number: int) -> None:
        if self._log is not None and not beginning.first:
            self._view.split(self._log.path_of(number).with_suffix(".rrd"))

    def flush_if_due(self) -> None:
        if time.monotonic() - self._flushed >= self._view.flush_period:
            self._flushed = time.monotonic()
            self._view.flush()


class Recorder:
    """Recorder of a run into a log and views, in its own thread.

    A sink that fails is closed and left alone, the others go on; nothing is ever raised into the caller.

    Attributes:
        faults: Faults, a line each; removed by their reporter.
        dropped: Frames that were not recorded: the queue was full, or the recorder closed.
    """

    def __init__(
        self,
        log: McapLog | None,
        *views: View | None,
        splitting: Splitting = UNSPLIT,
        capacity: int = CAPACITY,
        new_directory: Callable[[Path], Path] | None = None,
    ) -> None:
        """Start the writer thread.

        Args:
            log: Where messages go; the recorder closes it.
            *views: Where snapshots and commands go; None is left out. The recorder closes them.
            splitting: When log and view go on in new files, and how long old files are kept.
            capacity: Frames that may wait before new ones are dropped.
            new_directory: Makes another directory for the log where its own one, the argument, is deleted; the log ends
                then where None.
        """
        self.faults: list[str] = []
        self.dropped = 0
        self._sinks: list[_LogSink | _ViewSink] = []
        self._log_sink = None if log is None else _LogSink(log, new_directory)
        if self._log_sink is not None:
            self._sinks.append(self._log_sink)
        self._sinks += [_ViewSink(view, log) for view in views if view is not None]
        self._log = log
        self._splitting = splitting
        self._split_time = math.inf  # s of simulated time at which the running file has lasted long enough
        self._split_size = splitting.split_size * MEGABYTE or math.inf  # bytes
        self._first: _Beginning | None = None
        self._asked = self._number = 0 if log is None else log.number  # of the newest file asked for, and opened
        self._capacity = capacity
        self._queue: deque[_Item | _Beginning] = deque()
        self._closing = False
        self._writing = False
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def directory(self) -> Path | None:
        """Present directory of the log, None without a log."""
        return None if self._log is None else self._log.directory

    @property
    def backlog(self) -> int:
        """Number of queued frames and other items that wait to be written."""
        return len(self._queue)

    @property
    def idle(self) -> bool:
        """Whether the recorder has written all queued frames and commands."""
        return not self._queue and not self._writing

    @property
    def recording(self) -> bool:
        """Whether the recorder still writes any log or view."""
        return bool(self._sinks)

    def begin(self, epoch_ns: int, simulated_time: float, scenario: bytes, full_state: FullState | None = None) -> None:
        """Queue the start of the run with its initial state for the log, before the first frame; returns at once.

        Args:
            epoch_ns: Wall time (ns since 1970) of simulated time zero.
            simulated_time: s, at which the run begins.
            scenario: Message of the scenario, written at the start of each file.
            full_state: State at the start of the run; None for the start of its scenario.
        """
        stamp_ns = epoch_ns + nanoseconds(simulated_time)
        self._first = _Beginning(epoch_ns, stamp_ns, scenario, None, first=True)
        self._queue.append(self._first._replace(full_state=full_state))
        self._split_time = self._next_split(simulated_time)

    def split_due(self, simulated_time: float) -> bool:
        """Whether a new log file is due with the frame of a simulated time (s); a cheap check for every frame."""
        if simulated_time >= self._split_time:
            return True
        if self._asked != self._number or self._log is None or self._log_sink is None:
            return False
        return self._log.size >= self._split_size or self._log_sink.gone

    def split(self, full_state: FullState) -> None:
        """Queue the start of a new file of log and views for all later items; returns at once.

        Args:
            full_state: State of the simulation at the time of the next frame, which is recorded afterwards.
        """
        if self._first is None or self._closing or not self.recording or self._log is None:
            self._split_time = math.inf
            return
        first = self._first
        self._split_time = self._next_split(full_state.time)
        self._asked += 1
        stamp_ns = first.epoch_ns + nanoseconds(full_state.time)
        self._queue.append(_Beginning(first.epoch_ns, stamp_ns, first.scenario, full_state, first=False))

    def record(
        self,
        messages: Sequence[tuple[str, bytes]],
        stamp_ns: int,
        snapshot: Snapshot | None = None,
        columns: Sequence[str] = GROUPS,
    ) -> None:
        """Queue one frame for log and view; returns at once.

        Args:
            messages: Pairs of topic and CDR, for the log; not changed afterwards.
            stamp_ns: Stamp (ns since 1970) of all of them.
            snapshot: The twin at that time, for the view and, with its columns, for the log.
            columns: Groups of its columns for the log, of `groups_due`.
        """
        if self._closing or len(self._queue) >= self._capacity:
            self.dropped += 1
        elif self.recording:
            self._queue.append(_Item(messages, stamp_ns, snapshot, columns, None))

    def record_ahead(self, ahead: TensionAhead, stamp_ns: int) -> None:
        """Queue the predicted range of rope tension in the near future for the views; returns at once."""
        if not self._closing and self.recording and len(self._queue) < self._capacity:
            self._queue.append(_Item((), stamp_ns, None, (), None, ahead))

    def record_estimates(self, estimates: PlantEstimates, stamp_ns: int) -> None:
        """Queue the estimates of a plant that is followed for the views; returns at once."""
        if not self._closing and self.recording and len(self._queue) < self._capacity:
            self._queue.append(_Item((), stamp_ns, None, (), None, None, estimates))

    def record_command(self, applied: AppliedCommand, message: bytes, stamp_ns: int) -> None:
        """Queue an applied command; never dropped, as a replay needs every one.

        Args:
            applied: The command, for the view.
            message: The command encoded by `applied_command_message`, for the log.
            stamp_ns: Stamp (ns since 1970) of the message.
        """
        if self._closing:
            self.dropped += 1
        elif self.recording:
            self._queue.append(_Item([(APPLIED_COMMANDS, message)], stamp_ns, None, (), applied))

    def close(self) -> None:
        """Write all queued items, close the sinks and end the thread; repeatable, also from a signal handler."""
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
        taken = 0
        while self._queue:
            item = self._queue.popleft()
            if isinstance(item, _Beginning):
                self._begin_files(item)
            else:
                for sink in tuple(self._sinks):
                    self._attempt(sink, sink.write, item)
            taken += 1
            if taken % TURN == 0:
                time.sleep(0)  # the frame loop may be waiting for the interpreter
        self._writing = False

    def _begin_files(self, beginning: _Beginning) -> None:
        """Begin a new file of log and views, then remove the oldest files beyond their limits."""
        number = self._number + (not beginning.first)
        before = self.directory
        for sink in tuple(self._sinks):
            self._attempt(sink, sink.begin, beginning, number)
        self._number = number
        if self.directory != before:
            since = (beginning.stamp_ns - beginning.epoch_ns) / SECOND
            self.faults.append(
                f"recording: {before} is gone with all files in it; recording continues in {self.directory} "
                f"from {since:.2f} s on"
            )
        if self._log is None or beginning.first or not any(isinstance(sink, _LogSink) for sink in self._sinks):
            return
        try:
            self._log.remove_oldest(self._splitting, beginning.stamp_ns)
        except OSError as error:
            self.faults.append(f"recording: old files cannot be removed: {' '.join(str(error).split())}")

    def _next_split(self, simulated_time: float) -> float:
        """Simulated time (s) at which a log file that begins now reaches its longest duration."""
        duration = self._splitting.split_duration
        return simulated_time + duration - TICK if duration and self._log is not None else math.inf

    def _attempt(self, sink: _LogSink | _ViewSink, action: Callable[..., Any], *arguments: Any) -> None:
        """Call an action of a log or view sink; after an exception record the error and remove the sink."""
        try:
            action(*arguments)
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            if isinstance(error, GoneError) and isinstance(sink, _LogSink) and sink.may_move and not self._closing:
                sink.gone = True
                self.faults.append(f"recording: {text}; it continues in a new directory with the next frame")
                return
            self._sinks.remove(sink)
            if isinstance(sink, _LogSink):
                self._split_size = math.inf  # its file grows no more, nor does it get smaller
            with suppress(Exception):
                sink.close()
            left = "" if isinstance(error, GoneError) else sink.left
            self.faults.append(f"recording: {sink.name} stopped: {text}{left}")
