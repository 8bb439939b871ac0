"""Drawing of ropes in rerun as lines coloured by tension, with the legend of the colours."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.view.batch import (
    QUIET,
    TIMELINE,
    pixels,
    planar,
    plane,
    rows_without_gaps,
    send,
)
from cable_twin.view.labels import label_sizes
from cable_twin.view.tension_colors import COLOR_COUNT, COLOR_TABLE, RopeColors

LEGEND_PERIOD = 5.0  # s after which the legend is sent again, for viewers who connect late
NO_ROPE = -1  # colour of the stretch from one rope to the next, which is not drawn


class Rope:
    """Drawing of the ropes of a run in rerun.

    Args:
        layout: layout of the frames.
        scale: factor from N to the unit of forces.
        unit: unit of forces.
        space: whether to draw the rope in the 3D view too.
    """

    def __init__(self, layout: Layout, scale: float, unit: str, *, space: bool = False) -> None:
        self._arc_lengths = layout.arc_lengths + layout.rope_offsets[layout.sample_ropes]
        self._offsets = layout.rope_offsets
        self._starts = layout.rope_offsets[1:]  # of ropes after the first
        self._scale = scale
        self._unit = unit
        self._drawn = (IN_PLANE, IN_SPACE) if space else (IN_PLANE,)
        self._colors = RopeColors(layout.ropes)
        self._known = False  # whether any tension was known so far
        self._legend_place = (0.0, 0.0, 1.0)
        self._legend_time = -np.inf  # s, of the newest legend

    def begin(self, stream: rr.RecordingStream, time: float, legend_place: tuple[float, float, float]) -> None:
        """Log static data and the legend: its place (x, z, width) in m, valid from `time` (s) on."""
        self._legend_place = legend_place
        stream.log(IN_PLANE.path, rr.LineStrips2D.from_fields(radii=pixels(2.5), draw_order=30.0), static=True)
        if IN_SPACE in self._drawn:
            stream.log(IN_SPACE.path, rr.LineStrips3D.from_fields(radii=pixels(2.5)), static=True)
        if self._known:
            self._log_legend(stream, time)

    def legend_size(self) -> tuple[float, float]:
        """Return width and height in pixels of the legend labels, with room for a widened range."""
        names = [*self._colors.scales]
        text = "\n".join(f"{name}: 1000 to 2000 {self._unit}" for name in names) if len(names) > 1 else ""
        width, height = label_sizes([text])[0]
        return float(width), float(height)

    def send(self, stream: rr.RecordingStream, c: Columns, rows: NDArray[np.intp]) -> None:
        """Send the rope of selected frames of a batch, with its joints between the samples."""
        rows = rows[rows_without_gaps(planar(c.rope_position[rows]))]
        if not rows.size:
            return
        times = c.time[rows, 0]
        on_rope = c.attached[rows] == 1.0
        places = np.where(on_rope, c.arc_length[rows], np.nan)
        places += self._offsets[np.nan_to_num(c.vehicle_rope[rows]).astype(np.intp)]
        tensions = c.rope_tension[rows] * self._scale
        points, tensions = with_joints(
            self._arc_lengths, c.rope_position[rows], tensions, places, c.joint_position[rows]
        )
        wider = self._colors.widen(c.rope_tension[rows] * self._scale)
        self._known |= wider
        if wider or (self._known and abs(times[-1] - self._legend_time) >= LEGEND_PERIOD):
            self._log_legend(stream, float(times[0]))
        if not self._starts.size:
            bins = self._colors.bins(tensions, np.zeros((len(points), points.shape[1] - 1), dtype=np.intp))
        else:
            sorted_places = np.sort(self._placed(places), axis=1)
            bins = self._colors.bins(tensions, np.searchsorted(self._starts, sorted_places[:, :-1], side="right"))
            for frame, row in enumerate(sorted_places):
                bins[frame, np.searchsorted(row, self._starts) - 1] = NO_ROPE
        for form in self._drawn:
            send(stream, form.path, times, rope_columns(points, bins, form))

    def _placed(self, places: FloatArray) -> FloatArray:
        """Arc lengths (frames, n) in m of all rope samples, followed by those of the joints (frames, joints)."""
        return np.hstack([np.broadcast_to(self._arc_lengths, (len(places), self._arc_lengths.size)), places])

    def _log_legend(self, stream: rr.RecordingStream, time: float) -> None:
        """Log the bar of tension colours with the range of each rope in numbers, valid from `time` (s) on."""
        x, z, width = self._legend_place
        self._legend_time = time
        edges = x + np.linspace(0.0, width, COLOR_COUNT + 1)
        bar = [[(left, -z), (right, -z)] for left, right in pairwise(edges)]
        if len(self._colors.scales) == 1:
            (only,) = self._colors.scales.values()
            labels = [f"{value:g} {self._unit}" for value in (only.low, only.high)]
            places, colors = [(edges[0], -z), (edges[-1], -z)], [COLOR_TABLE[0], COLOR_TABLE[-1]]
        else:  # one label with a line for each rope, so that lines keep their distance at any zoom
            labels = ["\n".join(self._colors.captions(self._unit))]
            places, colors = [((edges[0] + edges[-1]) / 2.0, -z)], [QUIET]
        stream.set_time(TIMELINE, duration=time)
        stream.log(
            "track/tension_colors",
            rr.LineStrips2D(bar, colors=COLOR_TABLE, radii=pixels(4.0)),
            rr.Points2D(places, colors=colors, radii=pixels(4.0), labels=labels, show_labels=True),
        )


def with_joints(
    arc_lengths: FloatArray, points: FloatArray, tensions: FloatArray, places: FloatArray, joints: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Insert joints into the samples of a rope, as the rope is bent there between two samples.

    Args:
        arc_lengths: arc lengths of the samples (n,) m.
        points: samples (frames, n, 3) m.
        tensions: tensions at the samples (frames, n).
        places: arc lengths of the joints (frames, joints) m; NaN moves a joint off the rope to the last sample.
        joints: joints (frames, joints, 3) m.

    Returns:
        Points (frames, n + joints, 3) and tensions (frames, n + joints) in the order along the rope.
    """
    frames, count = tensions.shape
    absent = np.isnan(places) | np.isnan(joints).any(axis=2)
    places = np.where(absent, np.inf, places)
    joints = np.where(absent[..., None], points[:, -1:], joints)
    after = np.clip(np.searchsorted(arc_lengths, places), 1, count - 1)
    middle = (np.take_along_axis(tensions, after - 1, axis=1) + np.take_along_axis(tensions, after, axis=1)) / 2.0
    order = np.argsort(np.hstack([np.broadcast_to(arc_lengths, (frames, count)), places]), axis=1, kind="stable")
    tensions = np.take_along_axis(np.hstack([tensions, middle]), order, axis=1)
    return np.take_along_axis(np.hstack([points, joints]), order[..., None], axis=1), tensions


class Form(NamedTuple):
    """Drawing form of the rope: in the plane of the track, or in space."""

    path: str
    seen: Callable[[FloatArray], FloatArray]  # converts points (..., 3) in m to drawn ones
    points: Any
    lines: Any
    type: pa.DataType


IN_PLANE = Form(
    "track/rope",
    lambda points: plane(planar(points)),
    rr.components.Position2DBatch,
    rr.LineStrips2D,
    rr.components.LineStrip2DBatch([]).as_arrow_array().type,
)
IN_SPACE = Form(
    "space/rope",
    lambda points: points,
    rr.components.Position3DBatch,
    rr.LineStrips3D,
    rr.components.LineStrip3DBatch([]).as_arrow_array().type,
)


def rope_columns(points: FloatArray, bins: NDArray[np.intp], form: Form) -> list[rr.ComponentColumn]:
    """Return the columns of rerun for the rope in several frames, as lines of one colour each.

    Args:
        points: (frames, n, 3) m.
        bins: colour of each stretch (frames, n - 1).
        form: drawing form.
    """
    frames, count = bins.shape
    starts = np.ones((frames, count), dtype=bool)
    starts[:, 1:] = bins[:, 1:] != bins[:, :-1]
    # a sample between two colours ends one line and starts the next
    copies = np.ones((frames, count + 1), dtype=np.intp)
    copies[:, 1:-1] += starts[:, 1:]
    seen = form.seen(points).astype(np.float32)
    flat = np.repeat(seen.reshape(-1, seen.shape[-1]), copies.ravel(), axis=0)
    first = np.flatnonzero(starts)
    colors = bins.ravel()[first]
    lengths = np.diff(first, append=starts.size) + 1
    offsets = np.concatenate(([0], np.cumsum(lengths))).astype(np.int32)
    flat[offsets[:-1][colors == NO_ROPE] + 1] = flat[offsets[:-1][colors == NO_ROPE]]
    lines = pa.ListArray.from_arrays(offsets, form.points(flat).as_arrow_array(), type=form.type)
    columns = form.lines.columns(strips=lines, colors=COLOR_TABLE[colors])
    return [column.partition(starts.sum(axis=1)) for column in columns]
