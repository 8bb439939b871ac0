"""Picture of a run in rerun, drawn from batches of frames."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import rerun as rr

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.view.batch import Thinning, first_known, frame
from cable_twin.view.geometry import planar, time_column
from cable_twin.view.layout import lay_out, plot_cells
from cable_twin.view.plots import Plots
from cable_twin.view.readout import describe_moment, table_columns
from cable_twin.view.rope import Rope
from cable_twin.view.scene import Framed, draw_scene, framed, scene_of
from cable_twin.view.sizes import Sizes, divided
from cable_twin.view.space import InSpace, Space
from cable_twin.view.vehicles import Vehicles

READOUT_RATE = 5.0  # Hz


@dataclass(frozen=True)
class Look:
    """Appearance of a run in `RerunView`; points in the plane are x and z."""

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
    """Picture of one run, drawn into one file after the other.

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
        self._plots = Plots(layout, look.carriers, self._scale, self._unit)
        self._rope = Rope(layout, self._scale, self._unit, space=look.space is not None)
        self._vehicles = Vehicles(layout, look.outlines, look.carriers)
        self._space = look.space and Space(layout, look.space, look.carriers, self._vehicles.followed)
        self._rope_times = Thinning(look.rope_rate)
        self._pose_times = Thinning(look.geometry_rate)
        self._readout_times = Thinning(READOUT_RATE)
        self._sizes: Sizes
        self._framed: Framed

    def begin(self, stream: rr.RecordingStream, c: Columns) -> None:
        """Lay out a file around its first batch: static entities and the blueprint."""
        look = self._look
        first = first_known(c)
        scene = scene_of(
            planar(first.rope_position),
            self._vehicles.points(first),
            self._layout.end_samples,
            look.support_positions,
            look.ground,
        )
        table = table_columns(describe_moment(self._layout, first, look.title, self._scale, self._unit))
        close_ups = bool(self._vehicles.followed) * (2 if self._space else 1)
        self._sizes = divided(close_ups + len(self._plots.signals), space=self._space is not None, table=table)
        self._framed = framed(
            scene,
            self._sizes.track,
            look.wheels,
            self._layout.ropes,
            self._rope.legend_size(),
            self._vehicles.headroom,
        )
        draw_scene(stream, scene, self._framed.names, look.wheels)
        self._rope.begin(stream, float(first.time[0]), self._framed.legend)
        self._vehicles.begin(stream, first, self._framed.pixel, self._framed.taken)
        self._plots.begin(stream, plot_cells(self._plots, self._sizes), look.plot_window)
        if self._space:
            self._space.begin(stream, first, scene.ground, look.wheels, self._sizes.track)
        stream.log("readout", rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)
        self._lay_out(stream, look.plot_window)
        for times in (self._rope_times, self._pose_times, self._readout_times):
            times.restart()

    def end(self, stream: rr.RecordingStream) -> None:
        """Lay out a file again at its end, with its whole time span and final plot ranges."""
        self._lay_out(stream, None)

    def _lay_out(self, stream: rr.RecordingStream, window: float | None) -> None:
        shown = self._vehicles.close_ups, self._vehicles.boxes
        eyes = (self._space.overview, self._space.close_ups) if self._space else None
        stream.send_blueprint(lay_out(self._framed, self._sizes, *shown, self._plots, self._unit, window, eyes))

    def send(self, stream: rr.RecordingStream, c: Columns) -> None:
        """Draw a batch of at least one frame."""
        times = c.time[:, 0]
        self._plots.send(stream, c)
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
    """Return the force unit of the picture: N where every force of a frame is below 1 kN, else kN."""
    forces = [c.rope_tension, np.linalg.norm(c.support_force, axis=1), np.linalg.norm(c.contact_force, axis=1)]
    return "N" if np.fmax.reduce(np.abs(np.hstack(forces)), initial=0.0) < 1e3 else "kN"
