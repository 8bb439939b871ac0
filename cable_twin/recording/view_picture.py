"""The whole picture of a run, drawn from batches of frames."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import rerun as rr

from cable_twin.recording.view_batch import Thinning, first_known, frame
from cable_twin.recording.view_geometry import planar, time_column
from cable_twin.recording.view_layout import lay_out
from cable_twin.recording.view_plots import CommandedSpeeds, Plots
from cable_twin.recording.view_readout import describe_moment
from cable_twin.recording.view_rope import Rope
from cable_twin.recording.view_scene import draw_scene, extent, scene_of
from cable_twin.recording.view_space import InSpace, Space
from cable_twin.recording.view_vehicles import Vehicles
from cable_twin.records import FloatArray
from cable_twin.snapshot import Columns, Layout

READOUT_RATE = 5.0  # Hz


@dataclass(frozen=True)
class Look:
    """How a run is drawn, see `RerunView`; points in the plane are x and z."""

    title: str
    outlines: Mapping[str, Mapping[str, FloatArray]]  # (n, 2) m, in rerun's plane
    support_positions: Mapping[str, FloatArray]  # (2,) m
    ground: FloatArray | None  # (n, 2) m
    force_unit: str | None
    plot_window: float | None  # s
    carriers: Collection[str]
    geometry_rate: float  # Hz
    rope_rate: float  # Hz
    wheels: Mapping[str, FloatArray]  # (n, 3) m, rims of bullwheels
    space: InSpace | None  # what is drawn in space, where it is drawn there as well


class Picture:
    """One run, drawn into one file after the other.

    Args:
        look: How it is drawn.
        layout: Of its frames.
        c: The first batch.
    """

    def __init__(self, look: Look, layout: Layout, c: Columns) -> None:
        self._look = look
        self._layout = layout
        self._unit = look.force_unit or _unit(first_known(c))
        self._scale = 1e-3 if self._unit == "kN" else 1.0
        self._plots = Plots(layout, look.carriers, self._scale)
        self._rope = Rope(layout, self._scale, self._unit, space=look.space is not None)
        self._vehicles = Vehicles(layout, look.outlines, look.carriers)
        self._space = look.space and Space(layout, look.space, look.carriers, self._vehicles.followed)
        self._rope_times = Thinning(look.rope_rate)
        self._pose_times = Thinning(look.geometry_rate)
        self._readout_times = Thinning(READOUT_RATE)
        self._corners = np.zeros(2), np.ones(2), 1.0  # m, of the scene, and where its legend is

    def begin(self, stream: rr.RecordingStream, c: Columns) -> None:
        """Lay a file out around its first batch: what never moves, and the blueprint."""
        look = self._look
        first = first_known(c)
        scene = scene_of(
            planar(first.rope_position),
            self._vehicles.points(first),
            self._layout.end_samples,
            look.support_positions,
            look.ground,
        )
        low, high = extent(scene)
        width = float(max(high - low))
        low = low - (0.0, draw_scene(stream, scene, width, look.wheels, self._layout.ropes))
        top = float(high[1] + (0.06 + 0.03 * (len(self._layout.ropes) - 1)) * width)  # room for a line a rope
        self._rope.begin(stream, float(first.time[0]), (float(low[0]), top, width))
        self._vehicles.begin(stream, first, 0.045 * width)
        self._plots.begin(stream)
        if self._space:
            self._space.begin(stream, first, scene.ground, look.wheels)
        stream.log("readout", rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)
        self._corners = low, high, top
        self._lay_out(stream, look.plot_window)
        for times in (self._rope_times, self._pose_times, self._readout_times):
            times.restart()

    def end(self, stream: rr.RecordingStream) -> None:
        """Lay a file out again with all of its time, now that it is known how far its plots reach."""
        self._lay_out(stream, None)

    def _lay_out(self, stream: rr.RecordingStream, window: float | None) -> None:
        vehicles, plots = self._vehicles, self._plots
        shown = vehicles.close_ups, vehicles.boxes
        eyes = (self._space.overview, self._space.close_ups) if self._space else None
        stream.send_blueprint(lay_out(*self._corners, *shown, plots, self._unit, window, plots.spans, eyes))

    def send(self, stream: rr.RecordingStream, c: Columns, commanded: CommandedSpeeds) -> None:
        """Draw a batch of at least one frame."""
        times = c.time[:, 0]
        self._plots.send(stream, c, commanded)
        if (rows := self._rope_times.rows(times)).size:
            self._rope.send(stream, c, rows)
        if (rows := self._pose_times.rows(times)).size:
            self._vehicles.send(stream, c, rows)
            if self._space:
                self._space.send(stream, c, rows)
        if (rows := self._readout_times.rows(times)).size:
            moments = [frame(c, row) for row in rows]
            texts = [describe_moment(self._layout, one, self._look.title, self._scale, self._unit) for one in moments]
            columns = rr.TextDocument.columns(text=texts)
            stream.send_columns("readout", [time_column(times[rows])], columns, strict=True)


def _unit(c: Columns) -> str:
    """Return N where every force of a frame is below 1 kN."""
    forces = [c.rope_tension, np.linalg.norm(c.support_force, axis=1), np.linalg.norm(c.contact_force, axis=1)]
    return "N" if np.fmax.reduce(np.abs(np.hstack(forces)), initial=0.0) < 1e3 else "kN"
