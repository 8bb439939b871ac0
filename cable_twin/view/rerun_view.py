"""View of the twin in rerun: a recording file (.rrd) with its blueprint embedded, a live view, or both.

The whole track with the rope coloured by tension, close-ups that move with carriages, plots (speed, tension, swing,
drive force, tower load), a readout and the commands; for a scenario in space also 3D views and plots of lateral motion.
Everything is on the one timeline `sim_time`. Snapshots are collected as rows of numbers and drawn in batches, a column
an entity; `flush` draws those that wait. Plots take every snapshot, the rest is thinned out, see `RerunView`.

A new file needs a new set of sinks, and rerun ends a server that is a sink when the set changes. So the server belongs
to a stream of its own, into which nothing is drawn, and the drawing reaches it over the network.
"""

from __future__ import annotations

import ctypes
import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import rerun as rr
import rerun_bindings as bindings
from numpy.typing import ArrayLike

from cable_twin.basics.files import sync
from cable_twin.frame.commands import KINDS, describe_command
from cable_twin.frame.records import AppliedCommand, Command, PlantEstimates, TensionAhead
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.view.batch import Batch, time_column
from cable_twin.view.picture import Look, Picture
from cable_twin.view.web_view import LIVE_ADDRESS, LIVE_PORT, live_url

APPLICATION = "cable_twin"
FLUSH_TIMEOUT = 5.0  # s
# data sent first to a late viewer: a quarter to one minute. A viewer takes in data for 10 ms between two pictures only,
# and without a GPU it stays minutes behind.
LIVE_MEMORY = "4MiB"
_ABANDONED: list[rr.RecordingStream] = []
BATCH = 500  # frames
LIVE_WINDOW = 30.0  # s
LISTED_CHANGE = {"wind": 1.0, "temperature": 1.0}  # m/s, K: from which on another one is listed among the commands


class _Stream(rr.RecordingStream):
    """Rerun stream that ends on disconnect, and whose deletion does not wait for its writer."""

    server: _Stream | None = None  # serves the live viewers
    url = ""  # of the server
    _layouts: rr.RecordingStream | None = None
    _layout_count = 0

    def __del__(self) -> None:
        """Do nothing, as deletion must not wait for the writer."""

    def switch_to(self, title: str, path: Path | None) -> None:
        """Close the file with its index, and continue in another one, and to the server.

        Raises:
            OSError: the new file cannot be created.
        """
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if path is not None:
            sinks.append(rr.FileSink(path, write_footer=True))
        if self.server is not None:
            sinks.append(rr.GrpcSink(self.url))
        try:
            self.set_sinks(*sinks)
        except RuntimeError as error:
            raise OSError(str(error)) from error
        self.send_recording_name(title)

    def send_blueprint(
        self, blueprint: rr.BlueprintLike, *, make_active: bool = True, make_default: bool = True
    ) -> None:
        """Send the layout of the views (blueprint), one for each file.

        rerun would make a stream for each that never ends, with two threads and 1.5 MB; here one is reused.
        """
        if self._layouts is None:
            self._layouts = rr.RecordingStream._from_native(
                bindings.new_blueprint(APPLICATION, make_default=False, make_thread_default=False)
            )
        self._layout_count += 1
        self._layouts.set_time("blueprint", sequence=self._layout_count)
        blueprint.to_blueprint()._log_to_stream(self._layouts)
        layout = self._layouts.memory_recording().storage
        bindings.send_blueprint(layout, make_active, make_default, recording=self.to_native())

    def disconnect(self) -> None:
        """Close the recording file, then the server."""
        super().disconnect()
        if self._layouts is not None:
            self._layouts.memory_recording().drain_as_bytes()  # otherwise rerun warns of dropped data
            self._layouts.disconnect()  # stream and memory refer to each other
            self._layouts = None
        if self.server is not None:
            self.server.disconnect()
            self.server = None


def open_stream(title: str, path: Path | None, live: bool = False, live_port: int = LIVE_PORT) -> rr.RecordingStream:
    """Return a separate stream into a file, to a server on the local interface, or both.

    Raises:
        OSError: The file cannot be created, or the port is in use.
    """
    stream = _Stream(APPLICATION)
    # one timeline only: wall-clock times would be those of the batches
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    if live:
        stream.server, stream.url = _serve(stream, live_port), live_url(live_port)
    try:
        stream.switch_to(title, path)
    except OSError:
        if stream.server is not None:
            stream.server.disconnect()
        raise
    return stream


def _serve(stream: rr.RecordingStream, port: int) -> _Stream:
    """Serve a recording; raises OSError where the port is in use."""
    # rerun would find out later, in a thread, that a port is in use, and then every flush fails
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LIVE_ADDRESS, port))
        except OSError as error:
            raise OSError(f"the live view cannot use port {port} of {LIVE_ADDRESS}: {error}") from error
    server = _Stream(APPLICATION, recording_id=stream.get_recording_id(), send_properties=False)
    server.set_sinks(rr.GrpcServerSink(LIVE_ADDRESS, port, server_memory_limit=LIVE_MEMORY))
    return server


def split_stream(stream: rr.RecordingStream, title: str, old: Path | None, new: Path) -> None:
    """Close the file of a stream of `open_stream` and continue in another one; viewers stay connected.

    Args:
        stream: flushed stream.
        title: name of the recording.
        old: present file, or None.
        new: next file.

    Raises:
        OSError: the new file cannot be created, or the old one cannot be finished.
    """
    assert isinstance(stream, _Stream)
    stream.switch_to(title, new)
    with suppress(FileNotFoundError):
        if old is not None:
            sync(old)


def flush_stream(stream: rr.RecordingStream, path: Path | None) -> None:
    """Flush sent data to disk, in the file `path` if given; waits for a disk that stalls.

    Raises:
        OSError: the file cannot be written any more, as on a full disk; the stream is abandoned then. A deleted file
            is no error.
    """
    try:
        try:
            # without a time-out rerun waits forever if its writer fails meanwhile
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError as error:
            if "timed out" not in str(error):  # rerun has one class for all errors
                raise
            if path is not None and path.exists():
                os.utime(path)  # returns when the disk accepts writes again
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        with suppress(FileNotFoundError):  # deleted, which the recorder reports
            if path is not None:
                sync(path)
    except (RuntimeError, OSError) as error:
        _abandon(stream)
        raise OSError(f"the rerun recording cannot be written: {error}") from error


def end_threads() -> None:
    """End the threads of closed and unreferenced streams, which hold two threads and a megabyte each.

    rerun itself does so only when another global recording begins. It flushes all streams before, and so would wait
    forever for an abandoned one.
    """
    if not _ABANDONED:
        bindings.flush_and_cleanup_orphaned_recordings()


def _abandon(stream: rr.RecordingStream) -> None:
    """Leave a stream open, as rerun would wait forever for a writer that is gone, also at exit."""
    _ABANDONED.append(stream)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))  # so that the interpreter does not delete it either at its end
    rr.unregister_shutdown()


class RerunView:
    """View of a run of one scenario in rerun; for a single thread.

    Attributes:
        url: address of the live view for viewers (`rerun --connect URL`), None without one.
        flush_period: time (s) between two calls of `flush`.
    """

    def __init__(
        self,
        title: str,
        body_outlines: Mapping[str, Mapping[str, ArrayLike]],
        *,
        path: Path | None,
        live: bool,
        live_port: int = LIVE_PORT,
        batch_frames: int | None = None,
        stream: rr.RecordingStream | None = None,
        **appearance: Any,
    ) -> None:
        """Open the file and the server; the picture is laid out with the first snapshot.

        Args:
            title: title of the recording.
            body_outlines: carriage -> body -> outline (n, 2) m, as in `Look`.
            path: recording file (.rrd), or None.
            live: whether to serve the picture at `127.0.0.1:live_port` for any number of viewers. Its plots show the
                last 30 s, those of a finished file the whole run.
            live_port: TCP port of the live view.
            batch_frames: number of snapshots that are sent together; by default 20 for a live view, otherwise 500, for
                a small file with a small index; a flush sends those that wait.
            stream: stream to draw into without a file and a live view; closing the view closes it.
            **appearance: other fields of `Look`.

        Raises:
            ValueError: neither a file, a live view nor a stream is given, or the unit of forces is unknown.
            OSError: the file cannot be created, or the port is in use.
        """
        if path is None and not live and stream is None:
            raise ValueError("view: given no file, no live view and no stream; allowed: at least one of these")
        self.url: str | None = None
        self._path = path
        self._look = Look(title, body_outlines, **appearance)
        self._window = LIVE_WINDOW if live else None
        self.flush_period = 0.5 if live else 5.0

        self._stream: rr.RecordingStream | None = stream or open_stream(title, path, live, live_port)
        if live:
            self.url = live_url(live_port)

        self._batch = Batch(batch_frames or (20 if live else BATCH))
        self._layout: Layout | None = None  # until the first snapshot
        self._picture: Picture | None = None  # until the first batch
        self._laid_out = False  # whether the present file has its blueprint
        self._last_commands: dict[tuple[str, ...], Command] = {}  # newest listed command, by topic and names
        self._ahead: list[TensionAhead] = []  # not sent yet
        self._estimates: list[PlantEstimates] = []  # not sent yet
        self._commands: list[tuple[float, str, str]] = []  # time (s), text and level of commands not sent yet

    def lay_out(self, snapshot: Snapshot) -> None:
        """Lay the picture out around a snapshot now, not in the first batch: the layout takes the time of many frames.

        Raises:
            RuntimeError: the view is closed.
        """
        stream = self._open()
        self._layout = snapshot.layout
        columns = snapshot.layout.columns(snapshot.numbers[None])
        self._picture = Picture(self._look, snapshot.layout, columns, self._window)
        self._picture.begin(stream, columns)
        self._laid_out = True

    def log(self, snapshot: Snapshot) -> None:
        """Draw one snapshot, collected with others into a batch.

        Raises:
            RuntimeError: the view is closed.
        """
        self._open()
        self._layout = snapshot.layout
        if self._batch.add(snapshot):
            self._send()

    def log_command(self, applied: AppliedCommand) -> None:
        """Log a command as a text line, unless it is a repetition or a small change of wind or temperature.

        Raises:
            RuntimeError: the view is closed.
        """
        self._open()
        kind = KINDS[applied.command.kind]
        key = (kind.topic, *applied.command.values)
        last = self._last_commands.get(key)
        if applied.command == last:
            return  # repeated because of the time-out of commands
        if kind.name in LISTED_CHANGE and last is not None:
            change = [abs(value - last.values[axis]) for axis, value in applied.command.values.items()]
            if max(change) < LISTED_CHANGE[kind.name]:
                return
        if not applied.command.values:
            self._last_commands.clear()  # after a stop or a reset a repeated command is listed again
        self._last_commands[key] = applied.command
        self._commands.append((applied.time, describe_command(applied), kind.level))

    def log_ahead(self, ahead: TensionAhead) -> None:
        """Log the tension that an outlook foresees, beside the plot of tensions.

        Raises:
            RuntimeError: the view is closed.
        """
        self._open()
        self._ahead.append(ahead)

    def log_estimates(self, estimates: PlantEstimates) -> None:
        """Log the estimates of a plant that the twin follows, as a table and over time.

        Raises:
            RuntimeError: the view is closed.
        """
        self._open()
        self._estimates.append(estimates)

    def flush(self) -> None:
        """Send waiting data to disk; waits for a disk that stalls.

        Raises:
            RuntimeError: the view is closed.
            OSError: the file cannot be written any more, as on a full disk; the view is closed then.
        """
        stream = self._open()
        self._send()
        try:
            flush_stream(stream, self._path)
        except OSError:
            self._stream = None
            raise

    def split(self, path: Path) -> None:
        """Finish the present file and continue in another one, laid out anew; viewers stay connected.

        Raises:
            RuntimeError: the view is closed.
            OSError: a file cannot be written.
        """
        self._end_file()
        split_stream(self._open(), self._look.title, self._path, path)
        self._path = path
        self._laid_out = False
        self._last_commands.clear()  # so that the new file lists repeated commands

    def close(self) -> None:
        """Send waiting data and close file and server; a second call does nothing.

        Raises:
            OSError: the last part cannot be written; the view is closed anyway.
        """
        if self._stream is None:
            return
        self._end_file()
        self._stream.disconnect()
        self._stream = None
        end_threads()

    def _end_file(self) -> None:
        """Send waiting data, and the final layout of the file."""
        self._send()
        if self._picture is not None and self._laid_out:
            self._picture.end(self._open())
        self.flush()

    def _open(self) -> rr.RecordingStream:
        """Return the stream, or raise if the view is closed."""
        if self._stream is None:
            raise RuntimeError("this view is closed")
        return self._stream

    def _send(self) -> None:
        """Send waiting commands, and draw all collected frames, outlooks and estimates."""
        stream = self._open()
        if self._commands:
            times, texts, levels = zip(*self._commands, strict=True)
            self._commands = []
            columns = rr.TextLog.columns(text=texts, level=levels)
            stream.send_columns("commands", [time_column(times)], columns, strict=True)
        if self._layout is None:
            return
        c = self._batch.take(self._layout)
        if not len(c.time):
            return
        if self._picture is None:
            self._picture = Picture(self._look, self._layout, c, self._window)
        if not self._laid_out:
            self._picture.begin(stream, c)
            self._laid_out = True
        self._picture.send(stream, c)
        if self._ahead:
            self._picture.send_ahead(stream, self._ahead)
            self._ahead = []
        if self._estimates:
            self._picture.send_estimates(stream, self._estimates)
            self._estimates = []
