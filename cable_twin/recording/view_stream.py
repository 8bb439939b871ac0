"""A stream to rerun: into a file, to live viewers or both, that never waits for good."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import rerun as rr

from cable_twin.recording.mcap_log import sync

APPLICATION = "cable_twin"
LIVE_ADDRESS = "127.0.0.1"  # never another: rerun has no access control
FLUSH_TIMEOUT = 5.0  # s
LIVE_MEMORY = "256MiB"  # what a late viewer can still be sent


class _Stream(rr.RecordingStream):
    """A stream that ends when it is disconnected, and does not wait for its writer when it is deleted."""

    def __del__(self) -> None:
        """Do nothing."""


def open_stream(
    title: str, path: Path | None, live: bool = False, live_port: int = 9876, footer: bool = True
) -> rr.RecordingStream:
    """Return a stream of its own into a file, a server on the local interface, or both."""
    stream = _Stream(APPLICATION)
    # One timeline only: wall-clock times would be those of the batches.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    sinks: list[rr.FileSink | rr.GrpcServerSink] = []
    if path is not None:
        sinks.append(rr.FileSink(path, write_footer=footer))
    if live:
        # rerun finds a port in use only later, in a thread, and then every flush fails.
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LIVE_ADDRESS, live_port))
            except OSError as error:
                raise OSError(f"the live view cannot use port {live_port} of {LIVE_ADDRESS}: {error}") from error
        sinks.append(rr.GrpcServerSink(LIVE_ADDRESS, live_port, server_memory_limit=LIVE_MEMORY))
    try:
        stream.set_sinks(*sinks)
    except RuntimeError as error:
        raise OSError(str(error)) from error
    stream.send_recording_name(title)
    return stream


def flush_stream(stream: rr.RecordingStream, path: Path | None) -> None:
    """Have what was sent on the disk, in the file `path` if there is one; waits for a disk that stalls.

    Raises:
        OSError: The file cannot be written any more, a full disk for instance; the stream is given up then.
    """
    try:
        try:
            # Without a limit rerun waits for good where its writer gives up in between.
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError as error:
            if "timed out" not in str(error):  # rerun has one class for all
                raise
            if path is not None:
                os.utime(path)  # returns when the disk takes writes again, which a lost writer never does
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        if path is not None:
            sync(path)
    except (RuntimeError, OSError) as error:
        _abandon(stream)
        raise OSError(f"the rerun recording cannot be written: {error}") from error


def _abandon(stream: rr.RecordingStream) -> None:
    """Leave a stream open: for a writer that is gone, rerun would wait for good, at exit too."""
    _ABANDONED.append(stream)
    rr.unregister_shutdown()


_ABANDONED: list[rr.RecordingStream] = []
