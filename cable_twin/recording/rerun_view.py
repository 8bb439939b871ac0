"""Draw the twin in rerun: a recording file (.rrd) with its blueprint embedded, a live view, or both.

Layout: the whole track with the rope coloured by tension, a close-up that moves with each carriage, four plots
(speed, tension, swing, drive force), a readout and the commands. Everything lies on the one timeline `sim_time`.

Rates: plots take every snapshot; geometry and readout are drawn at `geometry_rate`, 25 Hz by default. Both are
collected and sent in batches, so that a snapshot costs little; `flush` sends what is still waiting.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from cable_twin.recording.view_geometry import (
    TIMELINE,
    default_ground,
    entity_path,
    pixels,
    planar,
    plane,
    time_column,
)
from cable_twin.recording.view_layout import lay_out
from cable_twin.recording.view_plots import Plots, describe_command, describe_moment
from cable_twin.recording.view_rope import COLOR_COUNT, COLOR_TABLE, TensionColors, rope_columns
from cable_twin.recording.view_stream import flush_stream, live_url, open_stream, split_stream
from cable_twin.records import AppliedCommand, CarriageState, Command, FloatArray, Snapshot

LABELS = 8  # carriages up to which each has its name beside it
CARRIAGE_COLORS = (0xFFFFFFFF, 0xFFD166FF, 0x9BF6FFFF, 0xCAFFBFFF, 0xFFADADFF, 0xBDB2FFFF)
BODY_COLORS = (0xFFD166FF, 0x9BF6FFFF, 0xCAFFBFFF, 0xFFADADFF, 0xBDB2FFFF)
QUIET = 0x8A93A6FF
WIND_CHANGE = 1.0  # m/s, from which on another wind is listed among the commands
GROUND = 0x6B5F4FFF

_LEVELS = {"emergency_stop": "ERROR", "release": "WARN", "reset": "WARN"}


class RerunView:
    """One run of one scenario, drawn; used from one thread.

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
        live_port: int = 9876,
        support_positions: Mapping[str, ArrayLike] | None = None,
        ground: ArrayLike | None = None,
        force_unit: str | None = None,
        plot_window: float | None = None,
        geometry_rate: float = 25.0,
        batch_frames: int | None = None,
        stream: rr.RecordingStream | None = None,
    ) -> None:
        """Open the file and the server; the picture is laid out with the first snapshot.

        Args:
            scenario_name: Title of the recording.
            body_outlines: Carriage -> body -> (n, 2) m, one line in the body's axes from its centre of mass (see
                `cable_twin.outlines`). A body without one is drawn as a dot.
            path: The .rrd to write, or None.
            live: Serve the picture at `127.0.0.1:live_port` for any number of viewers.
            live_port: TCP port of the live view.
            support_positions: Name -> (2,) m, for supports between the ends; the ends are taken from the cable.
            ground: (n, 2) m, the profile of the ground; by default a line that follows the chord of the track.
            force_unit: "kN" or "N"; by default kN unless every force of the first snapshot is below 1 kN.
            plot_window: s, how much time before and after the cursor the plots show; None shows the whole run.
            geometry_rate: Hz, at which rope, carriages and readout are drawn.
            batch_frames: Snapshots that are collected before they are sent; by default 20 where somebody may watch
                live, else 500, for a small file and a small index.
            stream: Drawn into where neither a file nor a live view is asked for; closing the view closes it.

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
        self._title = scenario_name
        self._outlines = {
            carriage: {body: plane(np.asarray(line, dtype=np.float64)) for body, line in bodies.items()}
            for carriage, bodies in body_outlines.items()
        }
        self._support_positions = {
            name: np.asarray(where, dtype=np.float64) for name, where in (support_positions or {}).items()
        }
        self._ground = None if ground is None else np.asarray(ground, dtype=np.float64)
        self._force_unit = force_unit
        self._plot_window = plot_window
        self._geometry_interval = 1.0 / geometry_rate
        self._batch_frames = batch_frames or (20 if live else 500)
        self.flush_period = 0.5 if live else 5.0

        self._stream: rr.RecordingStream | None = stream or open_stream(scenario_name, path, live, live_port)
        if live:
            self.url = live_url(live_port)

        self._plots: Plots | None = None  # until the first snapshot
        self._laid_out = False  # in this file
        self._moving_paths: list[str] = []  # of each carriage, then its bodies
        self._force_scale = 1e-3
        self._colors = TensionColors()
        self._legend_place = (0.0, 0.0, 1.0)
        self._commands: deque[AppliedCommand] = deque()  # not yet in effect at the last snapshot
        self._last_commands: dict[tuple[str, ...], Command] = {}  # that were listed, by kind and names
        self._next_geometry = -np.inf

        self._times: list[float] = []
        self._rows: list[list[float]] = []
        self._geometry_times: list[float] = []
        self._rope_points: list[NDArray[np.float32]] = []
        self._rope_tensions: list[NDArray[np.float32]] = []
        self._poses: list[list[tuple[float, float, float]]] = []
        self._readouts: list[str] = []
        self._command_times: list[float] = []
        self._command_texts: list[str] = []
        self._command_levels: list[str] = []

    def log(self, snapshot: Snapshot) -> None:
        """Draw one snapshot.

        Raises:
            RuntimeError: When the view is closed.
        """
        self._open()
        if self._plots is None or not self._laid_out:
            self._plots = self._begin(snapshot)
            self._laid_out = True
        while self._commands and self._commands[0].time <= snapshot.time:
            self._plots.obey(self._commands.popleft())
        self._times.append(snapshot.time)
        self._rows.append(self._plots.row(snapshot))
        if snapshot.time >= self._next_geometry:
            # A little slack, or rounding of the time would skip every other frame.
            self._next_geometry = snapshot.time + 0.999 * self._geometry_interval
            self._collect_geometry(snapshot)
        if len(self._times) >= self._batch_frames:
            self._send()

    def log_command(self, applied: AppliedCommand) -> None:
        """Note a command: a line in the log where it is a new one, and from its time on the commanded speed.

        Raises:
            RuntimeError: When the view is closed.
        """
        self._open()
        self._commands.append(applied)
        kind = applied.command.kind if applied.command.kind in ("payload", "wind") else "drive"
        key = (kind, *applied.command.values)
        last = self._last_commands.get(key)
        if applied.command == last:
            return  # a command that only goes on, as the time-out wants it
        if kind == "wind" and last is not None:
            change = [abs(speed - last.values[axis]) for axis, speed in applied.command.values.items()]
            if max(change) < WIND_CHANGE:
                return
        if not applied.command.values:
            self._last_commands.clear()  # after a stop or a reset the same command is a new one
        self._last_commands[key] = applied.command
        self._command_times.append(applied.time)
        self._command_texts.append(describe_command(applied))
        self._command_levels.append(_LEVELS.get(applied.command.kind, "INFO"))

    def flush(self) -> None:
        """Send what waits and have it on the disk; waits for a disk that stalls.

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
        """Finish the file with what waits and go on in another one, laid out anew; viewers stay connected.

        Raises:
            RuntimeError: When the view is closed.
            OSError: When a file cannot be written.
        """
        self.flush()
        split_stream(self._open(), self._title, self._path, path)
        self._path = path
        self._laid_out = False
        self._moving_paths.clear()
        self._last_commands.clear()  # so that the new file names those that go on
        self._next_geometry = -np.inf

    def close(self) -> None:
        """Send what waits and close the file and the server; a second call does nothing.

        Raises:
            OSError: When the last part cannot be written; the view is closed all the same.
        """
        if self._stream is None:
            return
        self.flush()
        self._stream.disconnect()
        self._stream = None

    def _open(self) -> rr.RecordingStream:
        """Return the stream, or raise if the view is closed."""
        if self._stream is None:
            raise RuntimeError("this view is closed")
        return self._stream

    def _begin(self, snapshot: Snapshot) -> Plots:
        """Lay the picture out around the first snapshot: scales, what never moves, and the blueprint."""
        stream = self._open()
        cable = planar(snapshot.cable.positions)
        tensions = snapshot.cable.tensions
        if self._force_unit is None:
            forces = [*tensions, *(np.hypot(*planar(s.force)) for s in snapshot.supports.values())]
            forces += [np.hypot(*planar(c.contact_force)) for c in snapshot.carriages.values()]
            self._force_unit = "N" if max(np.abs(forces)) < 1e3 else "kN"
        self._force_scale = 1e-3 if self._force_unit == "kN" else 1.0
        first = self._plots is None
        if first:
            self._colors.start(tensions * self._force_scale)
        plots = self._plots or Plots(snapshot, self._force_scale)

        supports = {name: cable[index] for name, index in (("start", 0), ("end", -1)) if name in snapshot.supports}
        supports.update(self._support_positions)
        carriages = [self._body_points(name, state) for name, state in snapshot.carriages.items()]
        ground = default_ground(cable, carriages) if self._ground is None else self._ground
        scene = np.vstack([cable, *carriages, ground])
        low, high = scene.min(axis=0), scene.max(axis=0)
        width = max(high[0] - low[0], high[1] - low[1])
        self._legend_place = (float(low[0]), float(high[1] + 0.06 * width), float(width))

        stream.log("track/rope", rr.LineStrips2D.from_fields(radii=pixels(2.5), draw_order=30.0), static=True)
        stream.log("track/ground", rr.LineStrips2D([plane(ground)], colors=[GROUND], radii=pixels(1.5)), static=True)
        masts = [[(x, z), (x, float(np.interp(x, ground[:, 0], ground[:, 1])))] for x, z in supports.values()]
        stream.log(
            "track/supports",
            rr.LineStrips2D([plane(np.array(mast)) for mast in masts], colors=[QUIET], radii=pixels(2.0)),
            rr.Points2D(
                [plane(where) for where in supports.values()],
                colors=[QUIET],
                radii=pixels(5.0),
                labels=list(supports),
                show_labels=True,
            ),
            static=True,
        )
        reaches = {}
        for index, (name, state) in enumerate(snapshot.carriages.items()):
            color = CARRIAGE_COLORS[index % len(CARRIAGE_COLORS)]
            reaches[name] = self._begin_carriage(name, state, color, len(snapshot.carriages) <= LABELS)
        plots.begin(stream)
        self._log_legend(snapshot.time)
        top = self._legend_place[1]
        blueprint = lay_out(low, high, top, reaches, plots, self._force_unit, self._plot_window)
        # somebody who watches keeps the layout that they made
        stream.send_blueprint(blueprint, make_active=first or self.url is None)
        return plots

    def _begin_carriage(self, name: str, state: CarriageState, color: int, labelled: bool) -> float:
        """Log what moves rigidly with a carriage and return how far it reaches from its joint (m)."""
        stream = self._open()
        path = entity_path("track/carriages", name)
        self._moving_paths.append(path)
        stream.log(
            path,
            rr.Points2D(
                [(0.0, 0.0)],
                colors=[color],
                radii=pixels(4.5),
                labels=[name],
                show_labels=labelled,
                draw_order=40.0,
            ),
            static=True,
        )
        for index, body in enumerate(state.bodies):
            body_path = entity_path(path, body)
            self._moving_paths.append(body_path)
            tint = BODY_COLORS[index % len(BODY_COLORS)]
            outline = self._outlines.get(name, {}).get(body)
            if outline is not None:
                stream.log(body_path, rr.LineStrips2D([outline], colors=[tint], radii=pixels(2.0)), static=True)
            stream.log(body_path, rr.Points2D([(0.0, 0.0)], colors=[tint], radii=pixels(3.0)), static=True)
        reach = np.hypot(*(self._body_points(name, state) - planar(state.position)).T)
        return float(max(reach.max(), 1e-3))

    def _body_points(self, carriage: str, state: CarriageState) -> FloatArray:
        """Return (n, 2) m, joint and every drawn point of a carriage, x and z."""
        points = [planar(state.position)[None]]
        for name, body in state.bodies.items():
            outline = self._outlines.get(carriage, {}).get(name, np.zeros((1, 2)))
            cos, sin = np.cos(body.pitch), np.sin(body.pitch)
            turned = outline @ np.array([(cos, sin), (-sin, cos)])  # in rerun's plane
            points.append(np.array([body.x, body.z]) + plane(turned))
        return np.vstack(points)

    def _collect_geometry(self, snapshot: Snapshot) -> None:
        """Copy what will be drawn of one snapshot."""
        cable = snapshot.cable
        points = planar(cable.positions).astype(np.float32)
        tensions = cable.tensions.astype(np.float32)
        # The joints are the rope's kinks and seldom among its samples.
        joints = list(snapshot.carriages.values())
        if joints:
            after = np.searchsorted(cable.arc_lengths, [joint.arc_length for joint in joints])
            points = np.insert(points, after, [planar(joint.position) for joint in joints], axis=0)
            inside = np.clip(after, 1, len(tensions) - 1)
            tensions = np.insert(tensions, after, (tensions[inside - 1] + tensions[inside]) / 2.0)
        self._geometry_times.append(snapshot.time)
        self._rope_points.append(points)
        self._rope_tensions.append(tensions)
        poses = []
        for joint in joints:
            x, z = joint.position[0], joint.position[-1]
            poses.append((x, -z, 0.0))
            poses += [(body.x - x, z - body.z, body.pitch) for body in joint.bodies.values()]
        self._poses.append(poses)
        self._readouts.append(describe_moment(snapshot, self._title, self._force_scale, self._force_unit or "N"))

    def _send(self) -> None:
        """Send everything that was collected, a column a quantity."""
        stream = self._open()
        if self._command_times:
            columns = rr.TextLog.columns(text=self._command_texts, level=self._command_levels)
            stream.send_columns("commands", [time_column(self._command_times)], columns, strict=True)
            self._command_times, self._command_texts, self._command_levels = [], [], []
        if self._plots is not None and self._times:
            self._plots.send(stream, time_column(self._times), self._rows)
            self._times, self._rows = [], []
        if self._geometry_times:
            self._send_geometry(stream)

    def _send_geometry(self, stream: rr.RecordingStream) -> None:
        """Send the collected ropes, poses and readouts."""
        times = time_column(self._geometry_times)
        points = np.stack(self._rope_points)
        tensions = np.stack(self._rope_tensions) * np.float32(self._force_scale)
        poses = np.array(self._poses, dtype=np.float64)
        readouts = self._readouts
        first_time = self._geometry_times[0]
        self._geometry_times, self._rope_points, self._rope_tensions = [], [], []
        self._poses, self._readouts = [], []

        if self._colors.widen(tensions):
            self._log_legend(first_time)
        stream.send_columns("track/rope", [times], rope_columns(points, self._colors.bins(tensions)), strict=True)
        half = poses[:, :, 2] / 2.0
        translations = np.stack([poses[:, :, 0], poses[:, :, 1], np.zeros_like(half)], axis=2)
        quaternions = np.stack([np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)], axis=2)
        for index, path in enumerate(self._moving_paths):
            columns = rr.Transform3D.columns(translation=translations[:, index], quaternion=quaternions[:, index])
            stream.send_columns(path, [times], columns, strict=True)
            time.sleep(0)
        markdown = rr.TextDocument.columns(text=readouts, media_type=[rr.MediaType.MARKDOWN] * len(readouts))
        stream.send_columns("readout", [times], markdown, strict=True)

    def _log_legend(self, time: float) -> None:
        """Draw the bar of tension colours with its ends in numbers, as valid from `time` (s) on."""
        stream = self._open()
        x, z, width = self._legend_place
        edges = x + np.linspace(0.0, 0.35 * width, COLOR_COUNT + 1)
        bar = [[(left, -z), (right, -z)] for left, right in pairwise(edges)]
        low, high = (f"{value:g}" for value in (self._colors.low, self._colors.high))
        stream.set_time(TIMELINE, duration=time)
        stream.log(
            "track/tension_colors",
            rr.LineStrips2D(bar, colors=COLOR_TABLE, radii=pixels(4.0)),
            rr.Points2D(
                [(edges[0], -z), (edges[-1], -z)],
                colors=[COLOR_TABLE[0], COLOR_TABLE[-1]],
                radii=pixels(4.0),
                labels=[f"{low} {self._force_unit}", f"{high} {self._force_unit}"],
                show_labels=True,
            ),
        )
