"""Rerun recordings that `review` shows, recorded by the twin or made from bags, and their viewers."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from cable_twin.offline.reading import Reading
from cable_twin.recording.log_reader import Log
from cable_twin.terminal.command_line import typed
from cable_twin.view.web_view import WebView

BATCH = 500  # frames; the index of a recording is kept in memory, an entry a batch


def existing_recordings(log: Log) -> list[Path]:
    """Existing rerun files of a log: recorded with each complete file, else the file made from the bag."""
    directory = log.files[0].path.resolve().parent
    choices = [[directory / _made_name([log])]]
    if log.complete:
        own = [directory / file.path.with_suffix(".rrd").name for file in log.files]
        choices = [own, *choices]
    for files in choices:
        with suppress(OSError):
            if all(file.stat().st_size > 0 for file in files):
                return files
    return []


def _made_name(logs: Sequence[Log]) -> str:
    """File name of a rerun recording made from bags, distinct from the names of recordings of the twin."""
    if len(logs) == 1:
        return f"{logs[0].source.name}_review.rrd"
    more = f"_and_{len(logs) - 3}_more" if len(logs) > 3 else ""  # a name may have 255 characters
    return f"{'_and_'.join(log.source.name for log in logs[:3])}{more}.rrd"


def serve(recordings: Sequence[Path]) -> None:
    """Serve rerun recordings to a browser of this machine until Ctrl-C.

    Raises:
        OSError: The recordings cannot be served.
    """
    view = WebView(*map(str, recordings))
    try:
        print(f"in a browser, until Ctrl-C: {view.link}", flush=True)
        view.wait()
    finally:
        view.close()


class MadeRecording:
    """Rerun recording being made from bags, renamed to its final name when complete.

    Raises:
        OSError: Neither the directory of the bag nor the directory for temporary files can be written.
    """

    def __init__(self, readings: Sequence[Reading]) -> None:
        from cable_twin.offline.comparison_view import ComparisonView  # noqa: PLC0415 - half a second
        from cable_twin.recording.run import open_view  # noqa: PLC0415

        names = [reading.name for reading in readings]
        name = _made_name([reading.log for reading in readings])
        directory = readings[0].log.files[0].path.parent
        if not os.access(directory, os.W_OK):
            directory = Path(tempfile.mkdtemp(prefix="review_"))
        self._target = directory / name
        self._partial = directory / f"{name}.part"
        self._view: Any
        if len(readings) > 1:
            scenarios = [reading.scenario for reading in readings]
            self._view = ComparisonView(scenarios, names, self._partial, readings[0].first)
            for reading, view in zip(readings, self._view.views, strict=True):
                reading.view = view
        else:
            self._view = open_view(readings[0].scenario, self._partial, batch_frames=BATCH)
            readings[0].view = self._view

    def finish(self) -> Path:
        """Close the rerun recording and rename it to its final name; returns the path."""
        self._view.close()
        return self._partial.replace(self._target)

    def discard(self) -> None:
        """Remove the unfinished rerun recording."""
        with suppress(OSError):
            self._partial.unlink(missing_ok=True)


def show(recordings: Sequence[Path], bags: Sequence[Path]) -> None:
    """Open rerun's viewer on recordings where a display exists, on the local interface; else print instructions."""
    files = [str(recording) for recording in recordings]
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        print(f"rerun recording: {shlex.join(files)}")
        print(f"no display here; in a browser: {typed('review')} {shlex.join(map(str, bags))} --rerun web")
        return
    subprocess.Popen(
        [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", *files],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    print(f"opened in rerun: {' '.join(files)}")
