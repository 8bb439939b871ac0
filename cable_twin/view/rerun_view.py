"""View of the twin in rerun: a recording file (.rrd) with its blueprint embedded, a live view, or both.

Layout: the whole track with the rope coloured by tension, close-ups that move with carriages, plots (speed, tension,
swing, drive force, tower load), a readout and the commands. A scenario in space is drawn there as well, with plots of
what goes across the track. Everything lies on the one timeline `sim_time`.

Snapshots are collected as rows of numbers and drawn in batches, a column an entity; `flush` draws those that wait.
Plots take every snapshot, the rest is thinned out, see `RerunView`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import AppliedCommand, Command, FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.view.batch import Batch
from cable_twin.view.geometry import plane, time_column
from cable_twin.view.picture import Look, Picture
from cable_twin.view.readout import describe_command
from cable_twin.view.space import InSpace
from cable_twin.view.stream import end_threads, flush_stream, open_stream, split_stream
from cable_twin.view.web_view import LIVE_PORT, live_url

BATCH = 500  # frames
LIVE_WINDOW = 30.0  # s
WIND_CHANGE = 1.0  # m/s, from which on another wind is listed among the commands


class RerunView:
    """View of one run of one scenario; used from one thread.

    Attributes:
        url: Where a viewer finds the live view (`rerun --connect URL`), or None when it is not served.
        flush_period: s, how often `flush` should be called.
    """

    def __init__(
        self,
        scenario_name: str,
        body_outlines: Mapping[str, Mapping[str, ArrayLike]],
        *,
        path: Path | None,
        live: bool,
        live_port: int = LIVE_PORT,
        support_positions: Mapping[str, ArrayLike] | None = None,
        ground: ArrayLike | None = None,
        force_unit: str | None = None,
        plot_window: float | None = LIVE_WINDOW,
        carriers: Collection[str] = (),
        geometry_rate: float = 20.0,
        rope_rate: float = 10.0,
        batch_frames: int | None = None,
        stream: rr.RecordingStream | None = None,
        space: InSpace | None = None,
        wheels: Mapping[str, FloatArray] | None = None,
    ) -> None:
        """Open the file and the server; the picture is laid out with the first snapshot.

        Args:
            scenario_name: Title of the recording.
            body_outlines: Carriage -> body -> (n, 2) m, one line in the body's axes from its centre of mass (see
                `cable_twin.geometry.bodies`). A body without one is drawn as a dot.
            path: The .rrd to write, or None.
            live: Serve the picture at `127.0.0.1:live_port` for any number of viewers.
            live_port: TCP port of the live view.
            support_positions: Name -> (2,) m, for supports between the ends; the ends are taken from the cable.
            ground: (n, 2) m, the profile of the ground; by default a line that follows the chord of the track.
            force_unit: "kN" or "N"; by default kN unless every force of the first snapshot is below 1 kN.
            plot_window: s, how much time up to the cursor the plots show while the run goes on; None shows the whole
                run. By default 30 s where the picture is served. A file that is finished shows the whole run.
            carriers: Carriages that are drawn and plotted together, so that their number costs little.
            geometry_rate: Hz, at which carriages are drawn.
            rope_rate: Hz, at which the rope is drawn. At 20 Hz files have a quarter more bytes than at 10 Hz, where
                the joints of the shipped ropeways are some centimetres off the rope that is shown.
            batch_frames: Snapshots that are collected before they are sent; by default 20 where somebody may watch
                live, else 500, for a small file and a small index; a flush sends what there is.
            stream: Drawn into where neither a file nor a live view is asked for; closing the view closes it.
            space: What is drawn in space as well, beside the plane of the track.
            wheels: Name -> (n, 3) m, the rim of each bullwheel.

        Raises:
            ValueError: When neither a file, a live view nor a stream is given, or the unit is unknown.
            OSError: When the file cannot be created or the port is in use.
        """
        if path is None and not live and stream is None:
            raise ValueError("a view without a file and without a live server shows nothing")
        if force_unit not in (None, "N", "kN"):
            raise ValueError(f"force_unit is {force_unit!r}, allowed are 'N' and 'kN'")
        self.url: str | None = None
        self._path = path
        self._look = Look(
            title=scenario_name,
            outlines={
                carriage: {body: plane(np.asarray(line, dtype=np.float64)) for body, line in bodies.items()}
                for carriage, bodies in body_outlines.items()
            },
            support_positions={
                name: np.asarray(where, dtype=np.float64) for name, where in (support_positions or {}).items()
            },
            ground=None if ground is None else np.asarray(ground, dtype=np.float64),
            force_unit=force_unit,
            plot_window=plot_window if live else None,
            carriers=tuple(carriers),
            geometry_rate=geometry_rate,
            rope_rate=rope_rate,
            space=space,
            wheels=wheels or {},
        )
        self.flush_period = 0.5 if live else 5.0

        self._stream: rr.RecordingStream | None = stream or open_stream(scenario_name, path, live, live_port)
        if live:
            self.url = live_url(live_port)

        self._batch = Batch(batch_frames or (20 if live else BATCH))
        self._layout: Layout | None = None  # until the first snapshot
        self._picture: Picture | None = None  # until the first batch
        self._laid_out = False  # in this file
        self._last_commands: dict[tuple[str, ...], Command] = {}  # that were listed, by kind and names
        self._commands: list[tuple[float, str, str]] = []  # s, text and level of those not sent yet

    def lay_out(self, snapshot: Snapshot) -> None:
        """Lay the picture out around a snapshot now instead of with the first batch, as it takes many frames' time.

        Raises:
            RuntimeError: When the view is closed.
        """
        stream = self._open()
        self._layout = snapshot.layout
        columns = snapshot.layout.columns(snapshot.numbers[None])
        self._picture = Picture(self._look, snapshot.layout, columns)
        self._picture.begin(stream, columns)
        self._laid_out = True

    def log(self, snapshot: Snapshot) -> None:
        """Draw one snapshot.

        Raises:
            RuntimeError: When the view is closed.
        """
        self._open()
        self._layout = snapshot.layout
        if self._batch.add(snapshot):
            self._send()

    def log_command(self, applied: AppliedCommand) -> None:
        """Log a command as a text line where it is a new one.

        Raises:
            RuntimeError: When the view is closed.
        """
        self._open()
        kind = KINDS[applied.command.kind]
        key = (kind.topic, *applied.command.values)
        last = self._last_commands.get(key)
        if applied.command == last:
            return  # a command that only goes on, as the time-out wants it
        if kind.name == "wind" and last is not None:
            change = [abs(speed - last.values[axis]) for axis, speed in applied.command.values.items()]
            if max(change) < WIND_CHANGE:
                return
        if not applied.command.values:
            self._last_commands.clear()  # after a stop or a reset the same command is a new one
        self._last_commands[key] = applied.command
        self._commands.append((applied.time, describe_command(applied), kind.level))

    def flush(self) -> None:
        """Send waiting data to disk; waits for a disk that stalls.

        Raises:
            RuntimeError: When the view is closed.
            OSError: When the file cannot be written any more, a full disk for instance; the view is closed then.
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
            RuntimeError: When the view is closed.
            OSError: When a file cannot be written.
        """
        self._end_file()
        split_stream(self._open(), self._look.title, self._path, path)
        self._path = path
        self._laid_out = False
        self._last_commands.clear()  # so that the new file names those that go on

    def close(self) -> None:
        """Send waiting data and close file and server; a second call does nothing.

        Raises:
            OSError: When the last part cannot be written; the view is closed all the same.
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
        """Draw all collected frames."""
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
            self._picture = Picture(self._look, self._layout, c)
        if not self._laid_out:
            self._picture.begin(stream, c)
            self._laid_out = True
        self._picture.send(stream, c)
