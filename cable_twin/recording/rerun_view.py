"""Draw the twin in rerun: a recording file (.rrd) with its blueprint embedded, a live view, or both.

Layout: the whole track with the rope coloured by tension, a close-up that moves with each carriage, four plots
(speed, tension, swing, drive force), a readout and the commands. Everything lies on the one timeline `sim_time`.

Rates: plots take every snapshot; geometry and readout are drawn at `geometry_rate`, 25 Hz by default. Both are
collected and sent in batches, so that a snapshot costs little; `flush` sends what is still waiting.

rerun's plane has its second axis downwards: what is (x, z) in `cable_twin.records` is drawn at (x, -z), where a
right-handed pitch about the lateral axis is an ordinary rotation from the first axis to the second.
"""

from __future__ import annotations

import os
import socket
import time
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray

from cable_twin.recording.mcap_log import sync
from cable_twin.records import AppliedCommand, CarriageState, Command, FloatArray, Snapshot, TowerState

APPLICATION = "cable_twin"
TIMELINE = "sim_time"
LIVE_ADDRESS = "127.0.0.1"  # never another: rerun has no access control
FLUSH_TIMEOUT = 5.0  # s
LIVE_MEMORY = "256MiB"  # what a late viewer can still be sent

CLOSE_UPS = 6  # of carriages, where there are more than that
LEGEND_LINES = 12  # of a plot, up to which it has a legend
LABELS = 8  # carriages up to which each has its name beside it
COLOR_COUNT = 24  # colours between low and high tension; neighbours of one colour share one line
COLOR_STOPS = (0x3B8BFFFF, 0x35C9E0FF, 0x6FE08AFF, 0xF4E04DFF, 0xFF9838FF, 0xFF4338FF)
CARRIAGE_COLORS = (0xFFFFFFFF, 0xFFD166FF, 0x9BF6FFFF, 0xCAFFBFFF, 0xFFADADFF, 0xBDB2FFFF)
BODY_COLORS = (0xFFD166FF, 0x9BF6FFFF, 0xCAFFBFFF, 0xFFADADFF, 0xBDB2FFFF)
PLOT_COLORS = (0x4CC9F0FF, 0xFFD166FF, 0xFF6B6BFF, 0x80ED99FF, 0xC8B6FFFF, 0xFFADADFF)
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
        footer: bool = True,
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
            footer: End the file with an index, which rerun's tools want. It is kept in memory until then, 2 kB for
                each batch of an entity; without it, `rerun rrd optimize` adds one afterwards.
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
            carriage: {body: _plane(np.asarray(line, dtype=np.float64)) for body, line in bodies.items()}
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

        self._stream: rr.RecordingStream | None = stream or open_stream(scenario_name, path, live, live_port, footer)
        if live:
            self.url = f"rerun+http://{LIVE_ADDRESS}:{live_port}/proxy"

        self._plots: list[_Plot] = []  # empty until the first snapshot
        self._moving_paths: list[str] = []  # of each carriage, then its bodies
        self._force_scale = 1e-3
        self._colors = _TensionColors()
        self._legend_place = (0.0, 0.0, 1.0)
        self._commands: deque[AppliedCommand] = deque()  # not yet in effect at the last snapshot
        self._last_commands: dict[str, Command] = {}  # that were listed: of drives, payload, wind
        self._commanded: dict[str, float] = {}
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
        if not self._plots:
            self._begin(snapshot)
        while self._commands and self._commands[0].time <= snapshot.time:
            self._obey(self._commands.popleft())
        self._times.append(snapshot.time)
        self._rows.append(self._row(snapshot))
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
        last = self._last_commands.get(kind)
        if applied.command == last:
            return  # a command that only goes on, as the time-out wants it
        if kind == "wind" and last is not None:
            change = [abs(speed - last.values[axis]) for axis, speed in applied.command.values.items()]
            if max(change) < WIND_CHANGE:
                return
        self._last_commands[kind] = applied.command
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
            try:
                # Without a limit rerun waits for good where its writer gives up in between.
                stream.flush(timeout_sec=FLUSH_TIMEOUT)
            except RuntimeError as error:
                if "timed out" not in str(error):  # rerun has one class for all
                    raise
                if self._path is not None:
                    os.utime(self._path)  # returns when the disk takes writes again, which a lost writer never does
                stream.flush(timeout_sec=FLUSH_TIMEOUT)
            if self._path is not None:
                sync(self._path)
        except (RuntimeError, OSError) as error:
            self._abandon(stream)
            raise OSError(f"the rerun recording cannot be written: {error}") from error

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

    def _abandon(self, stream: rr.RecordingStream) -> None:
        """Close the view but not its stream: for a writer that is gone, rerun would wait for good, at exit too."""
        self._stream = None
        _ABANDONED.append(stream)
        rr.unregister_shutdown()

    def _open(self) -> rr.RecordingStream:
        """Return the stream, or raise if the view is closed."""
        if self._stream is None:
            raise RuntimeError("this view is closed")
        return self._stream

    def _begin(self, snapshot: Snapshot) -> None:
        """Lay the picture out around the first snapshot: scales, what never moves, and the blueprint."""
        stream = self._open()
        cable = _planar(snapshot.cable.positions)
        tensions = snapshot.cable.tensions
        if self._force_unit is None:
            forces = [*tensions, *(np.hypot(*_planar(s.force)) for s in snapshot.supports.values())]
            forces += [np.hypot(*_planar(c.contact_force)) for c in snapshot.carriages.values()]
            self._force_unit = "N" if max(np.abs(forces)) < 1e3 else "kN"
        self._force_scale = 1e-3 if self._force_unit == "kN" else 1.0
        self._colors.start(tensions * self._force_scale)
        self._plots = self._make_plots(snapshot)

        supports = {name: cable[index] for name, index in (("start", 0), ("end", -1)) if name in snapshot.supports}
        supports.update(self._support_positions)
        carriages = [self._body_points(name, state) for name, state in snapshot.carriages.items()]
        ground = _default_ground(cable, carriages) if self._ground is None else self._ground
        scene = np.vstack([cable, *carriages, ground])
        low, high = scene.min(axis=0), scene.max(axis=0)
        width = max(high[0] - low[0], high[1] - low[1])
        self._legend_place = (float(low[0]), float(high[1] + 0.06 * width), float(width))

        stream.log("track/rope", rr.LineStrips2D.from_fields(radii=_pixels(2.5), draw_order=30.0), static=True)
        stream.log("track/ground", rr.LineStrips2D([_plane(ground)], colors=[GROUND], radii=_pixels(1.5)), static=True)
        masts = [[(x, z), (x, float(np.interp(x, ground[:, 0], ground[:, 1])))] for x, z in supports.values()]
        stream.log(
            "track/supports",
            rr.LineStrips2D([_plane(np.array(mast)) for mast in masts], colors=[QUIET], radii=_pixels(2.0)),
            rr.Points2D(
                [_plane(where) for where in supports.values()],
                colors=[QUIET],
                radii=_pixels(5.0),
                labels=list(supports),
                show_labels=True,
            ),
            static=True,
        )
        reaches = {}
        for index, (name, state) in enumerate(snapshot.carriages.items()):
            color = CARRIAGE_COLORS[index % len(CARRIAGE_COLORS)]
            reaches[name] = self._begin_carriage(name, state, color, len(snapshot.carriages) <= LABELS)
        for plot in self._plots:
            stream.log(
                plot.path,
                rr.SeriesLines(names=plot.names, colors=np.array(plot.colors, dtype=np.uint32), widths=plot.widths),
                static=True,
            )
        self._log_legend(snapshot.time)
        stream.send_blueprint(self._blueprint(low, high, reaches))

    def _begin_carriage(self, name: str, state: CarriageState, color: int, labelled: bool) -> float:
        """Log what moves rigidly with a carriage and return how far it reaches from its joint (m)."""
        stream = self._open()
        path = _path("track/carriages", name)
        self._moving_paths.append(path)
        stream.log(
            path,
            rr.Points2D(
                [(0.0, 0.0)],
                colors=[color],
                radii=_pixels(4.5),
                labels=[name],
                show_labels=labelled,
                draw_order=40.0,
            ),
            static=True,
        )
        for index, body in enumerate(state.bodies):
            body_path = _path(path, body)
            self._moving_paths.append(body_path)
            tint = BODY_COLORS[index % len(BODY_COLORS)]
            outline = self._outlines.get(name, {}).get(body)
            if outline is not None:
                stream.log(body_path, rr.LineStrips2D([outline], colors=[tint], radii=_pixels(2.0)), static=True)
            stream.log(body_path, rr.Points2D([(0.0, 0.0)], colors=[tint], radii=_pixels(3.0)), static=True)
        reach = np.hypot(*(self._body_points(name, state) - _planar(state.position)).T)
        return float(max(reach.max(), 1e-3))

    def _body_points(self, carriage: str, state: CarriageState) -> FloatArray:
        """Return (n, 2) m, joint and every drawn point of a carriage, x and z."""
        points = [_planar(state.position)[None]]
        for name, body in state.bodies.items():
            outline = self._outlines.get(carriage, {}).get(name, np.zeros((1, 2)))
            cos, sin = np.cos(body.pitch), np.sin(body.pitch)
            turned = outline @ np.array([(cos, sin), (-sin, cos)])  # in rerun's plane
            points.append(np.array([body.x, body.z]) + _plane(turned))
        return np.vstack(points)

    def _make_plots(self, snapshot: Snapshot) -> list[_Plot]:
        """Return the plots in the order in which `_row` gives their values."""
        plots = []
        carriages = snapshot.carriages
        lone = len(carriages) == 1
        driven = list(_driven(snapshot))
        tints = iter(PLOT_COLORS * (1 + 2 * len(driven)))
        for name in driven:
            titles = ["speed", "commanded"] if len(driven) == 1 else [name, f"{name} commanded"]
            plots.append(_Plot(_path("plots/speed", name), titles, [next(tints), next(tints)]))
        titles = ["highest", "at the start", "at the end"]
        plots.append(_Plot("plots/tension", titles, [*PLOT_COLORS[2:0:-1], PLOT_COLORS[0]]))
        tints = iter(PLOT_COLORS * (1 + sum(len(c.bodies) for c in carriages.values())))
        for name, state in carriages.items():
            if state.bodies:
                titles = [body if lone else f"{name} {body}" for body in state.bodies]
                plots.append(_Plot(_path("plots/swing", name), titles, [next(tints) for _ in titles]))
        tints = iter(PLOT_COLORS * (1 + len(driven)))
        plots.extend(_Plot(_path("plots/drive_force", name), [name], [next(tints)]) for name in driven)
        tints = iter(PLOT_COLORS * (1 + len(snapshot.supports)))
        plots.extend(_Plot(_path("plots/tower_load", name), [name], [next(tints)]) for name in _towers(snapshot))
        return plots

    def _row(self, snapshot: Snapshot) -> list[float]:
        """Return the values of all plots: speeds, tensions, swings, drive forces, tower loads."""
        scale = self._force_scale
        tensions = snapshot.cable.tensions
        row: list[float] = []
        driven = _driven(snapshot)
        for name, (_, speed, _) in driven.items():
            row += (speed, self._commanded.get(name, np.nan))
        row += (tensions.max() * scale, tensions[0] * scale, tensions[-1] * scale)
        for state in snapshot.carriages.values():
            row += [body.pitch * _DEGREES if state.attached else np.nan for body in state.bodies.values()]
        row += [force * scale for _, _, force in driven.values()]
        row += [tower.normal_load * scale for tower in _towers(snapshot).values()]
        return row

    def _obey(self, applied: AppliedCommand) -> None:
        """Take a command over into the commanded speeds; no number where no speed is commanded."""
        command = applied.command
        if command.kind == "speed":
            self._commanded.update(command.values)
        elif command.kind == "force":
            self._commanded.update(dict.fromkeys(command.values, np.nan))
        elif command.kind == "emergency_stop":
            self._commanded = dict.fromkeys(self._commanded, 0.0)
        elif command.kind in ("release", "reset"):
            self._commanded = {}

    def _collect_geometry(self, snapshot: Snapshot) -> None:
        """Copy what will be drawn of one snapshot."""
        cable = snapshot.cable
        points = _planar(cable.positions).astype(np.float32)
        tensions = cable.tensions.astype(np.float32)
        # The joints are the rope's kinks and seldom among its samples.
        joints = list(snapshot.carriages.values())
        if joints:
            after = np.searchsorted(cable.arc_lengths, [joint.arc_length for joint in joints])
            points = np.insert(points, after, [_planar(joint.position) for joint in joints], axis=0)
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
        self._readouts.append(self._readout(snapshot))

    def _readout(self, snapshot: Snapshot) -> str:
        """Return the numbers of this moment as Markdown."""
        scale, unit = self._force_scale, self._force_unit
        tensions = snapshot.cable.tensions
        lines = [f"## {self._title}", f"| time | {snapshot.time:.2f} s |", "| :-- | --: |"]
        for name, (place, speed, force) in _driven(snapshot).items():
            lines += (
                f"| {name} {'by' if snapshot.drives else 'at'} | **{place:.2f} m** |",
                f"| speed | **{speed:.2f} m/s** |",
                f"| drive force | **{force * scale:.3g} {unit}** |",
            )
        if snapshot.drives:
            on_line = [state for state in snapshot.carriages.values() if state.attached]
            swing = max((abs(body.pitch) for state in on_line for body in state.bodies.values()), default=0.0)
            lines += (
                f"| on the line | **{len(on_line)} of {len(snapshot.carriages)}** |",
                f"| largest swing | **{swing * _DEGREES:.1f} deg** |",
            )
        lines.append(f"| tension | **{tensions.min() * scale:.4g} … {tensions.max() * scale:.4g} {unit}** |")
        for name, tower in _towers(snapshot).items():
            load = "lifted off" if tower.lifted_off else f"{tower.normal_load * scale:.4g} {unit}"
            lines.append(f"| {name} | **{load}** |")
        travels = [support.travel for support in snapshot.supports.values() if support.travel is not None]
        lines += [f"| counterweight | **{travel:+.3f} m** |" for travel in travels]
        return "\n".join(lines)

    def _send(self) -> None:
        """Send everything that was collected, a column a quantity."""
        stream = self._open()
        if self._command_times:
            columns = rr.TextLog.columns(text=self._command_texts, level=self._command_levels)
            stream.send_columns("commands", [_time_column(self._command_times)], columns, strict=True)
            self._command_times, self._command_texts, self._command_levels = [], [], []
        if self._times:
            times = _time_column(self._times)
            table = np.array(self._rows, dtype=np.float64)
            self._times, self._rows = [], []
            first = 0
            for plot in self._plots:
                last = first + len(plot.names)
                stream.send_columns(plot.path, [times], rr.Scalars.columns(scalars=table[:, first:last]), strict=True)
                first = last
                time.sleep(0)  # the frame loop may be waiting for the interpreter
        if self._geometry_times:
            self._send_geometry(stream)

    def _send_geometry(self, stream: rr.RecordingStream) -> None:
        """Send the collected ropes, poses and readouts."""
        times = _time_column(self._geometry_times)
        points = np.stack(self._rope_points)
        tensions = np.stack(self._rope_tensions) * np.float32(self._force_scale)
        poses = np.array(self._poses, dtype=np.float64)
        readouts = self._readouts
        first_time = self._geometry_times[0]
        self._geometry_times, self._rope_points, self._rope_tensions = [], [], []
        self._poses, self._readouts = [], []

        if self._colors.widen(tensions):
            self._log_legend(first_time)
        stream.send_columns("track/rope", [times], _rope_columns(points, self._colors.bins(tensions)), strict=True)
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
            rr.LineStrips2D(bar, colors=_COLOR_TABLE, radii=_pixels(4.0)),
            rr.Points2D(
                [(edges[0], -z), (edges[-1], -z)],
                colors=[_COLOR_TABLE[0], _COLOR_TABLE[-1]],
                radii=_pixels(4.0),
                labels=[f"{low} {self._force_unit}", f"{high} {self._force_unit}"],
                show_labels=True,
            ),
        )

    def _blueprint(self, low: FloatArray, high: FloatArray, reaches: Mapping[str, float]) -> rrb.Blueprint:
        """Return the layout for a scene between `low` and `high` (m) and carriages that reach so far (m)."""
        x, top, width = self._legend_place
        track = rrb.Spatial2DView(
            name="Track, rope coloured by tension",
            origin="track",
            visual_bounds=rrb.VisualBounds2D(
                x_range=[x - 0.03 * width, high[0] + 0.03 * width],
                y_range=[-top - 0.03 * width, -low[1] + 0.02 * width],
            ),
        )
        close_ups = [
            rrb.Spatial2DView(
                name=f"Close-up of {name}" if len(reaches) == 1 else name,
                origin=_path("track/carriages", name),
                contents=["+ /track/**", "- /track/tension_colors"],
                visual_bounds=rrb.VisualBounds2D(
                    x_range=[-0.7 * reach, 0.7 * reach], y_range=[-0.3 * reach, 1.1 * reach]
                ),
            )
            for name, reach in list(reaches.items())[:CLOSE_UPS]
        ]
        unit = self._force_unit
        titles = {
            "speed": "Speed [m/s]",
            "tension": f"Tension [{unit}]",
            "swing": "Swing [deg]",
            "drive_force": f"Drive force [{unit}]",
        }
        if any(plot.path.startswith("plots/tower_load/") for plot in self._plots):
            titles["tower_load"] = f"Load on towers [{unit}]"
        plots = [self._plot_view(f"plots/{path}", title) for path, title in titles.items()]
        lower: list[rrb.View | rrb.Container] = [rrb.Grid(*plots, grid_columns=2)]
        if close_ups:
            lower.insert(0, close_ups[0] if len(close_ups) == 1 else rrb.Tabs(*close_ups))
        return rrb.Blueprint(
            rrb.Horizontal(
                rrb.Vertical(track, rrb.Horizontal(*lower, column_shares=[2, 5][-len(lower) :]), row_shares=[2, 3]),
                rrb.Vertical(
                    rrb.TextDocumentView(name="Readout", origin="readout"),
                    rrb.TextLogView(
                        name="Commands", origin="commands", columns=rrb.TextLogColumns(text_log_columns=["Body"])
                    ),
                ),
                column_shares=[5, 1],
            ),
            rrb.BlueprintPanel(state="hidden"),
            rrb.SelectionPanel(state="hidden"),
            rrb.TimePanel(state="collapsed", timeline=TIMELINE),
            auto_views=False,
            auto_layout=False,
        )

    def _plot_view(self, path: str, title: str) -> rrb.TimeSeriesView:
        """Return one plot; all of them share their time axis."""
        lines = sum(len(plot.names) for plot in self._plots if plot.path.startswith(f"{path}/") or plot.path == path)
        window = None
        if self._plot_window is not None:
            boundary = rr.TimeRangeBoundary.cursor_relative
            window = rr.VisibleTimeRange(
                TIMELINE, start=boundary(seconds=-self._plot_window), end=boundary(seconds=self._plot_window)
            )
        return rrb.TimeSeriesView(
            name=title,
            origin=path,
            axis_x=rrb.TimeAxis(link="LinkToGlobal"),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=1 < lines <= LEGEND_LINES),
            time_ranges=window,
        )


class _Stream(rr.RecordingStream):
    """A stream that ends when it is disconnected, and does not wait for its writer when it is deleted."""

    def __del__(self) -> None:
        """Do nothing."""


class _Plot:
    """The lines of one entity in a plot."""

    def __init__(self, path: str, names: list[str], colors: list[int]) -> None:
        self.path = path
        self.names = names
        self.colors = colors
        # Wider below narrower: lines that coincide stay visible.
        self.widths = np.linspace(3.0, 1.5, len(names)) if len(names) > 1 else np.array([1.5])


class _TensionColors:
    """The range of tensions that the colours span: it starts around the first rope and only ever widens."""

    def __init__(self) -> None:
        self.low = 0.0
        self.high = 1.0
        self.lowest = 0.0  # of the tensions so far, outliers aside

    def start(self, tensions: FloatArray) -> None:
        """Span the tensions of the first snapshot, with room for what a moving carriage adds."""
        low, high = float(tensions.min()), float(tensions.max())
        self.lowest = low
        room = max(0.5 * (high - low), 0.03 * max(abs(low), abs(high)))
        self._span(low - room, high + room)

    def widen(self, tensions: NDArray[np.float32]) -> bool:
        """Widen the range where a batch leaves it, a few single samples aside; say whether it did."""
        low, high = (float(value) for value in np.percentile(tensions, (2.0, 98.0)))
        if low >= self.low and high <= self.high:
            return False
        self.lowest = min(self.lowest, low)
        room = 0.25 * (max(high, self.high) - min(low, self.low))
        self._span(low - room if low < self.low else self.low, high + room if high > self.high else self.high)
        return True

    def bins(self, tensions: NDArray[np.float32]) -> NDArray[np.intp]:
        """Return the colour of each stretch of rope between two samples, as index into the table of colours."""
        middle = (tensions[:, 1:] + tensions[:, :-1]) / 2.0
        scaled = (middle - self.low) * (COLOR_COUNT / (self.high - self.low))
        return np.clip(scaled, 0, COLOR_COUNT - 1).astype(np.intp)

    def _span(self, low: float, high: float) -> None:
        """Set the range, rounded outwards to numbers that read well."""
        slack = low < 0.0 and self.lowest >= 0.0  # a colour for tensions that do not occur
        low = 0.0 if slack else low
        width = max(high - low, 0.1)
        step = 10.0 ** np.floor(np.log10(width / 4.0))
        step *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if width / (step * factor) <= 8.0)
        self.low = float(step * np.floor(low / step))
        self.high = float(step * np.ceil(high / step))


def describe_command(applied: AppliedCommand) -> str:
    """Return a command in one line: what, for whom, with unit, from where."""
    command = applied.command
    unit = {"speed": "m/s", "force": "N", "payload": "kg", "wind": "m/s"}.get(command.kind, "")
    values = ", ".join(f"{name} {value:g} {unit}" for name, value in command.values.items())
    kind = command.kind.replace("_", " ")
    return f"{kind} {values} ({applied.source})" if values else f"{kind} ({applied.source})"


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


def _towers(snapshot: Snapshot) -> dict[str, TowerState]:
    """Return the towers among the supports."""
    return {name: support.tower for name, support in snapshot.supports.items() if support.tower is not None}


def _driven(snapshot: Snapshot) -> dict[str, tuple[float, float, float]]:
    """Return place (m), speed (m/s) and drive force (N) by name: of a moving cable, else of each carriage."""
    if snapshot.drives:
        return {name: (drive.position, drive.speed, drive.force) for name, drive in snapshot.drives.items()}
    return {name: (one.arc_length, one.speed, one.drive_force) for name, one in snapshot.carriages.items()}


def _planar(vector: FloatArray) -> FloatArray:
    """Return (…, 2) x and z of (…, dim) vectors."""
    return vector if vector.shape[-1] == 2 else vector[..., [0, -1]]


def _plane(points: FloatArray) -> FloatArray:
    """Turn (…, 2) x and z into rerun's plane, or back."""
    return points * _DOWNWARDS


def _pixels(radius: float) -> list[float]:
    """Return a radius in points of the screen, whatever the zoom; rerun takes negative ones so."""
    return [-radius]


def _path(parent: str, name: str) -> str:
    """Return the entity path of a child with any name."""
    return f"{parent}/{rr.escape_entity_path_part(name)}"


def _time_column(times: Sequence[float]) -> rr.TimeColumn:
    """Return times in seconds as an index, rounded to the nanosecond."""
    nanoseconds = np.rint(np.array(times) * 1e9).astype("timedelta64[ns]")
    return rr.TimeColumn(TIMELINE, duration=nanoseconds)


def _default_ground(cable: FloatArray, carriages: Sequence[FloatArray]) -> FloatArray:
    """Return a ground line that no carriage will touch on its way, parallel to the chord of the cable.

    A load that travels along a taut rope draws a parabola: its sag, and that of the bodies, is scaled to midspan.

    Args:
        cable: (n, 2) m.
        carriages: For each carriage (m, 2) m, its joint and then the points of its bodies.
    """
    chord = cable[-1] - cable[0]
    points = np.vstack([cable, *carriages])
    span = max(abs(chord[0]), np.ptp(points[:, 0]), 1e-3)
    slope = chord[1] / chord[0] if abs(chord[0]) > abs(chord[1]) else 0.0
    depths = cable[0, 1] + slope * (points[:, 0] - cable[0, 0]) - points[:, 1]
    deepest = depths.max()
    for carriage in carriages:
        part = np.clip((carriage[0, 0] - cable[0, 0]) / chord[0], 0.02, 0.98) if slope or chord[0] else 0.5
        sag = cable[0, 1] + slope * (carriage[0, 0] - cable[0, 0]) - carriage[0, 1]
        reach = carriage[0, 1] - carriage[:, 1].min()
        deepest = max(deepest, min(sag / (4.0 * part * (1.0 - part)), 0.3 * span) + reach)
    ends = np.array([points[:, 0].min() - 0.02 * span, points[:, 0].max() + 0.02 * span])
    heights = cable[0, 1] + slope * (ends - cable[0, 0]) - deepest - max(0.1 * deepest, 0.02 * span)
    return np.column_stack([ends, heights])


def _rope_columns(points: NDArray[np.float32], bins: NDArray[np.intp]) -> list[rr.ComponentColumn]:
    """Return the rope of several frames as lines of one colour each.

    Args:
        points: (frames, n, 2) m, in x and z.
        bins: (frames, n - 1) colour of each stretch.
    """
    frames, count = bins.shape
    starts = np.ones((frames, count), dtype=bool)
    starts[:, 1:] = bins[:, 1:] != bins[:, :-1]
    # A sample between two colours ends one line and starts the next.
    copies = np.ones((frames, count + 1), dtype=np.intp)
    copies[:, 1:-1] += starts[:, 1:]
    flat = np.repeat(points.reshape(-1, 2) * np.float32(_DOWNWARDS), copies.ravel(), axis=0)
    first = np.flatnonzero(starts)
    lengths = np.diff(first, append=starts.size) + 1
    offsets = np.concatenate(([0], np.cumsum(lengths))).astype(np.int32)
    lines = pa.ListArray.from_arrays(offsets, rr.components.Position2DBatch(flat).as_arrow_array(), type=_LINES_TYPE)
    columns = rr.LineStrips2D.columns(strips=lines, colors=_COLOR_TABLE[bins.ravel()[first]])
    return [column.partition(starts.sum(axis=1)) for column in columns]


def _color_table() -> NDArray[np.uint32]:
    """Return the colours from low to high tension as RGBA."""
    stops = np.array([[stop >> shift & 0xFF for shift in (24, 16, 8)] for stop in COLOR_STOPS], dtype=np.float64)
    where = np.linspace(0.0, len(stops) - 1.0, COLOR_COUNT)
    red, green, blue = (np.interp(where, np.arange(len(stops)), channel).astype(np.uint32) for channel in stops.T)
    return red << 24 | green << 16 | blue << 8 | np.uint32(255)


_ABANDONED: list[rr.RecordingStream] = []
_COLOR_TABLE = _color_table()
_DOWNWARDS = np.array([1.0, -1.0])
_DEGREES = 180.0 / np.pi
_LINES_TYPE = rr.components.LineStrip2DBatch([]).as_arrow_array().type
