"""Stream to rerun: into one file after the other, to live viewers or both, without endless waits.

Another file needs another set of sinks, and rerun ends a server that is a sink when the set changes. So the server
belongs to a stream of its own, which nothing is drawn into, and the drawing reaches it as any other program's would.
"""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from pathlib import Path

import rerun as rr
import rerun_bindings as bindings

from cable_twin.basics.files import sync
from cable_twin.view.web_view import LIVE_ADDRESS, LIVE_PORT, live_url

APPLICATION = "cable_twin"
FLUSH_TIMEOUT = 5.0  # s
# What a late viewer is sent first: a quarter to one minute. A viewer takes data in for 10 ms between two pictures only,
# and stays minutes behind one who has many of them where it draws without a GPU.
LIVE_MEMORY = "4MiB"


class _Stream(rr.RecordingStream):
    """Rerun stream that ends on disconnect, and whose deletion does not wait for its writer."""

    server: _Stream | None = None  # to whose viewers it is sent
    url = ""  # of the server
    _layouts: rr.RecordingStream | None = None
    _layout_count = 0

    def __del__(self) -> None:
        """Do nothing, as deletion must not wait for the writer."""

    def go_to(self, title: str, path: Path | None) -> None:
        """Close the file with its index, and continue in another one, and to the server.

        Raises:
            OSError: The new file cannot be created.
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
        """Send a blueprint, one for each file.

        rerun's own makes a stream for each that never ends, with two threads and 1.5 MB; this one is made once.
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
        """Close the file, then the server."""
        super().disconnect()
        if self._layouts is not None:
            self._layouts.memory_recording().drain_as_bytes()  # or rerun warns that they are dropped
            self._layouts.disconnect()  # its memory holds it, and it its memory
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
    # One timeline only: wall-clock times would be those of the batches.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    if live:
        stream.server, stream.url = _serve(stream, live_port), live_url(live_port)
    try:
        stream.go_to(title, path)
    except OSError:
        if stream.server is not None:
            stream.server.disconnect()
        raise
    return stream


def _serve(stream: rr.RecordingStream, port: int) -> _Stream:
    """Serve a recording; raises OSError where the port is in use."""
    # rerun finds a port in use only later, in a thread, and then every flush fails.
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
        stream: All that was sent to it is flushed.
        title: Name of the recording.
        old: The file it writes, or None.
        new: The file to write.

    Raises:
        OSError: The new file cannot be created, or the old one not be finished.
    """
    assert isinstance(stream, _Stream)
    stream.go_to(title, new)
    with suppress(FileNotFoundError):
        if old is not None:
            sync(old)


def flush_stream(stream: rr.RecordingStream, path: Path | None) -> None:
    """Flush sent data to disk, in the file `path` if given; waits for a disk that stalls.

    Raises:
        OSError: The file cannot be written any more, a full disk for instance; the stream is given up then. That it
            was deleted is no such fault.
    """
    try:
        try:
            # Without a limit rerun waits for good where its writer gives up in between.
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError as error:
            if "timed out" not in str(error):  # rerun has one class for all
                raise
            if path is not None and path.exists():
                os.utime(path)  # returns when the disk takes writes again, which a lost writer never does
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        with suppress(FileNotFoundError):  # it was deleted: whoever writes the log finds that out
            if path is not None:
                sync(path)
    except (RuntimeError, OSError) as error:
        _abandon(stream)
        raise OSError(f"the rerun recording cannot be written: {error}") from error


def end_threads() -> None:
    """End the threads of closed and unreferenced streams, which hold two threads and a megabyte each.

    rerun itself does so only when another global recording begins. It flushes all streams before, and so would wait for
    good where one was given up.
    """
    if not _ABANDONED:
        bindings.flush_and_cleanup_orphaned_recordings()


def _abandon(stream: rr.RecordingStream) -> None:
    """Leave a stream open, as rerun would wait forever for a writer that is gone, also at exit."""
    _ABANDONED.append(stream)
    rr.unregister_shutdown()


_ABANDONED: list[rr.RecordingStream] = []
