"""Picture of a run in rerun: division into views, readout, and drawing from batches of frames."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from itertools import pairwise
from math import isnan
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from cable_twin.basics.units import rounded
from cable_twin.frame.plotted_signals import SIGNALS, driven, driven_names
from cable_twin.frame.records import FloatArray, PlantEstimates, TensionAhead
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.view.batch import TIMELINE, Thinning, first_known, frame_of, planar, plane, send
from cable_twin.view.estimates import EstimatePlots, table_of
from cable_twin.view.plots import LEGEND_ROW, LEGENDS, Plots, shown_unit
from cable_twin.view.rope import Rope
from cable_twin.view.space import NEAR_WIND, OVERVIEW_WIND, SPACE, Eye, InSpace, Space
from cable_twin.view.track import CLOSE_UPS, NAMES, Framed, Vehicles, draw_scene, framed, scene_of

# sizes on the smallest supported screen, in pixels of rerun's browser view
WIDTH, HEIGHT = 1280, 800
MENU, TIME_PANEL, TITLE = 37, 30, 29  # at the top, at the bottom, and above each view
IN_A_ROW, IN_SPACE_IN_A_ROW = 3, 4  # plots and close-ups in a row, without and with 3D views
READOUT_LETTER, READOUT_MARGINS = 6.5, 32  # width of a letter of the readout, and of its margins
LONGEST_VALUE = len("-1000.00 m")  # letters
SLIPPED = 1e-3  # m of slip from which on it is shown
AHEAD = 0.04  # time shown after the cursor over that shown before it: room for the newest number
READOUT_RATE = 5.0  # Hz


class Sizes(NamedTuple):
    """Sizes of the views in the picture, in pixels.

    Attributes:
        side: width of the column with readout and commands.
        rows: number of cells, plots and close-ups, in each row below the track.
        space: whether there is a 3D view beside that of the plane.
    """

    side: float
    rows: tuple[int, ...]
    space: bool

    @property
    def main(self) -> float:
        """Width in pixels of the picture without the side column."""
        return WIDTH - self.side

    @property
    def row(self) -> float:
        """Height in pixels of a row of views, titles included."""
        return (HEIGHT - MENU - TIME_PANEL) / (1 + len(self.rows))

    @property
    def track(self) -> tuple[float, float]:
        """Width and height in pixels of a view of the whole track."""
        return self.main / (2 if self.space else 1), self.row - TITLE

    def cell(self, number: int) -> tuple[float, float]:
        """Width and height in pixels of a plot with legend, or of a close-up, by index, counted row by row."""
        for count in self.rows:
            if number < count:
                return self.main / count, self.row - TITLE
            number -= count
        raise IndexError(number)


def divided(cells: int, *, space: bool, table: tuple[int, int]) -> Sizes:
    """Return the sizes of all views for a number of plots and close-ups, and a readout with columns in letters."""
    count = max(1, -(-cells // (IN_SPACE_IN_A_ROW if space else IN_A_ROW)))
    ends = [cells * row // count for row in range(count + 1)]
    rows = tuple(last - first for first, last in pairwise(ends))
    return Sizes(side_width(table), rows, space)


def side_width(table: tuple[int, int]) -> float:
    """Return the width in pixels of the side column in which a table with columns in letters can be read."""
    wanted = READOUT_MARGINS + READOUT_LETTER * sum(table)
    return min(max(wanted, WIDTH / 6.0), WIDTH / 3.0)


def describe_moment(layout: Layout, c: Columns, title: str, scale: float, unit: str) -> str:
    """Return the readout of a frame as Markdown, without NaN values; forces are multiplied by `scale`, in `unit`."""
    lines: list[tuple[str, float, str]] = []
    movers = driven(layout, c)
    at = "by" if layout.drives else "at"
    for name, place, speed, force in zip(driven_names(layout), *(row.tolist() for row in movers), strict=True):
        lines += (
            (f"{name} {at}", place, f"{place:.2f} m"),
            ("speed", speed, f"{speed:.2f} m/s"),
            ("drive force", force, f"{rounded(force * scale, 3)} {unit}"),
        )
    if layout.drives:
        on_line = c.attached == 1.0
        bodies = np.repeat(on_line, np.diff(layout.first_body))
        swing = float(np.abs(c.body_angles[bodies, 1]).max(initial=0.0))
        lines += (
            ("on the line", 0.0, f"{on_line.sum()} of {len(layout.vehicles)}"),
            ("largest swing", swing, f"{np.rad2deg(swing):.1f} deg"),
        )
    if layout.space:
        roll = float(np.degrees(np.abs(c.body_angles[:, 0]).max(initial=0.0)))
        lines += (
            ("swing across", roll, f"{roll:.1f} deg"),
            ("wind along", float(c.wind[0]), f"{c.wind[0]:.1f} m/s"),
            ("wind across", float(c.wind[1]), f"{c.wind[1]:.1f} m/s"),
        )
    low, high = float(c.lowest_tension[:, 0].min()) * scale, float(c.highest_tension[:, 0].max()) * scale
    lines += [
        (f"{which} tension", value, f"{rounded(value)} {unit}") for which, value in (("lowest", low), ("highest", high))
    ]
    for name, load in zip(layout.towers, c.tower_load[layout.tower_rows].tolist(), strict=True):
        lines.append((name, load, "lifted off" if load == 0.0 else f"{rounded(load * scale)} {unit}"))
    lines += [("counterweight", travel, f"{travel:+.3f} m") for travel in c.support_travel.tolist()]
    for name, (on, off), slip, travel in zip(
        layout.sheaves, c.sheave_tension.tolist(), c.sheave_slip.tolist(), c.sheave_travel.tolist(), strict=True
    ):
        lines += [
            (f"{name} {side}", pull, f"{rounded(pull * scale)} {unit}") for side, pull in (("on", on), ("off", off))
        ]
        lines += [(f"{name} slip", slip, f"{slip:.3f} m")] if abs(slip) > SLIPPED else []
        lines += [(f"{name} travel", travel, f"{travel:+.3f} m")]
    shown = [f"| {name} | **{text}** |" for name, value, text in lines if not isnan(value)]
    return "\n".join([f"## {title}", f"| time | {c.time[0]:.2f} s |", "| :-- | --: |", *shown])


def table_columns(text: str) -> tuple[int, int]:
    """Return the widths in letters of both columns of a `describe_moment` text, with room for larger numbers."""
    rows = [[cell.strip(" *") for cell in line.split("|")[1:3]] for line in text.splitlines()[1:]]
    names, values = (max(len(row[column]) for row in rows) for column in (0, 1))
    return names, max(values, LONGEST_VALUE)


def lay_out(
    framed: Framed,
    sizes: Sizes,
    followed: Mapping[str, float],
    boxes: Iterable[str],
    plots: Plots,
    unit: str,
    window: float | None,
    eyes: tuple[Eye, Mapping[str, Eye]] | None = None,
    estimates: Sequence[rrb.View] = (),
) -> rrb.Blueprint:
    """Return rerun's blueprint of the whole picture: track, close-ups, plots, readout and commands.

    Args:
        framed: range of the view of the whole track.
        sizes: division of the picture into views.
        followed: entity of each close-up -> reach (m) of its vehicle.
        boxes: entities that stand for vehicles in the view of the whole track only.
        plots: all plots.
        unit: unit of forces.
        window: time (s) that the plots show before the cursor; None for the whole run.
        eyes: eye of the 3D view, and of the 3D close-up of each entity; None in a plane.
        estimates: views of the estimates of a plant; beside them the readout is that of the scenario.
    """
    (left, low), (right, high) = framed.low, framed.high
    track: rrb.View | rrb.Container = rrb.Spatial2DView(
        name="Track, rope coloured by tension",
        origin="track",
        visual_bounds=rrb.VisualBounds2D(x_range=[left, right], y_range=[-high, -low]),
    )
    cells: list[rrb.View | rrb.Container] = []
    if followed:
        cells.append(_close_ups(followed, boxes))
    if eyes is not None:
        overview, near = eyes
        track = rrb.Horizontal(track, _in_space(overview), column_shares=[1, 1])
        if near:
            cells.append(_together([_in_space(eye, entity) for entity, eye in near.items()]))
    titles = plot_titles(unit)
    axes = plots.axes(plot_cells(plots, sizes)) if window is None else {}
    cells += [
        _plot_view(f"plots/{name}", titles[name], len(plots.legend_rows(name, cell)), cell, window, axes.get(name))
        for name, cell in zip(plots.signals, plot_cells(plots, sizes), strict=True)
    ]
    ends = np.cumsum([0, *sizes.rows])
    lower = [rrb.Horizontal(*cells[first:last]) for first, last in pairwise(ends)]
    return blueprint(
        rrb.Horizontal(
            rrb.Vertical(track, *lower, row_shares=[1] * (len(lower) + 1)),
            rrb.Vertical(
                rrb.TextDocumentView(name="Scenario" if estimates else "Readout", origin="readout"),
                *([_together(estimates)] if estimates else []),
                rrb.TextLogView(
                    name="Commands", origin="commands", columns=rrb.TextLogColumns(text_log_columns=["Body"])
                ),
                row_shares=[3, 3, 1] if estimates else [3, 1],
            ),
            column_shares=[sizes.main, sizes.side],
        )
    )


def plot_cells(plots: Plots, sizes: Sizes) -> list[tuple[float, float]]:
    """Return width and height in pixels of the plot of each signal, legend included."""
    first = sum(sizes.rows) - len(plots.signals)
    return [sizes.cell(first + number) for number in range(len(plots.signals))]


def _close_ups(followed: Mapping[str, float], boxes: Iterable[str]) -> rrb.View | rrb.Container:
    """Return the close-up views that move with vehicles, as tabs."""
    hidden = ("track/tension_colors", "track/names", NAMES, *boxes)
    views = [
        rrb.Spatial2DView(
            name=f"Close-up of {name}" if len(followed) == 1 else name,
            origin=path,
            contents=["+ /track/**", *(f"- /{entity}" for entity in hidden)],
            visual_bounds=rrb.VisualBounds2D(x_range=[-0.7 * reach, 0.7 * reach], y_range=[-0.3 * reach, 1.1 * reach]),
        )
        for path, reach in list(followed.items())[:CLOSE_UPS]
        for name in [path.rpartition("/")[2]]
    ]
    return _together(views)


def _together(views: Sequence[rrb.View]) -> rrb.View | rrb.Container:
    """Return views as tabs of one container."""
    return views[0] if len(views) == 1 else rrb.Tabs(*views)


def _in_space(eye: Eye, followed: str | None = None) -> rrb.View:
    """Return a 3D view from an eye, which moves with the `followed` entity if given."""
    hidden = NEAR_WIND if followed is None else OVERVIEW_WIND
    name = "In space" if followed is None else f"{followed.rpartition('/')[2]} in space"
    return rrb.Spatial3DView(
        name=name,
        origin=SPACE,
        contents=["+ $origin/**", f"- /{hidden}", *([] if followed is None else [f"- /{SPACE}/names"])],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=eye.position, look_target=eye.target, eye_up=(0.0, 0.0, 1.0), tracking_entity=followed
        ),
    )


def plot_titles(unit: str) -> dict[str, str]:
    """Return plot titles by signal name, forces in `unit`."""
    return {name: f"{signal.view} [{shown_unit(signal, unit)}]" for name, signal in SIGNALS.items() if signal.view}


def blueprint(contents: rrb.Container) -> rrb.Blueprint:
    """Return a blueprint of contents and time panel, without other panels of rerun."""
    return rrb.Blueprint(
        contents,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
        auto_layout=False,
    )


def _plot_view(
    path: str,
    title: str,
    rows: int,
    cell: tuple[float, float],
    window: float | None,
    axis: tuple[float, float] | None,
) -> rrb.View | rrb.Container:
    """Return the view of one plot with its legend rows below, linked to the common time axis."""
    shown, time_axis = None, rrb.TimeAxis(link="LinkToGlobal")
    if window is not None:
        boundary = rr.TimeRangeBoundary.cursor_relative
        first, last = boundary(seconds=-window), boundary(seconds=AHEAD * window)
        shown = rr.VisibleTimeRange(TIMELINE, start=first, end=last)
        time_axis = rrb.TimeAxis(view_range=rr.TimeRange(first, last))
    width, height = cell[0], LEGEND_ROW * rows
    plot = rrb.TimeSeriesView(
        name=title,
        origin=path,
        axis_x=time_axis,
        axis_y=None if axis is None else rrb.ScalarAxis(range=axis),
        plot_legend=rrb.PlotLegend(visible=False),
        time_ranges=shown,
    )
    if not rows:
        return plot
    legend = rrb.Spatial2DView(
        origin=path.replace("plots", LEGENDS, 1),
        visual_bounds=rrb.VisualBounds2D(x_range=[0.0, width], y_range=[0.0, height]),
        titlebar=False,
    )
    return rrb.Vertical(plot, legend, row_shares=[cell[1] - height, height])


@dataclass(frozen=True)
class Look:
    """Appearance of a run in rerun; points in the plane are x and z.

    Attributes:
        title: title of the recording.
        outlines: carriage -> body -> outline (n, 2) m in the body's axes from its centre of mass (see
            `cable_twin.geometry.bodies`). A body without one is drawn as a dot.
        support_positions: name -> place (2,) m of supports between the ends of the ropes.
        ground: profile of the ground (n, 2) m; None: a line along the chord of the track.
        force_unit: "kN" or "N"; None: kN unless every force of the first snapshot is below 1 kN.
        carriers: carriages that are drawn and plotted together, so that their number costs little.
        geometry_rate: rate (Hz) at which carriages are drawn.
        rope_rate: rate (Hz) at which the rope is drawn. Files at 20 Hz are a quarter larger than at 10 Hz, where joints
            of the shipped ropeways are drawn some centimetres off the rope.
        space: scene of the 3D view, None for none.
        wheels: name -> (n, 3) m, rim of each bullwheel.

    Raises:
        ValueError: the unit of forces is unknown.
    """

    title: str
    outlines: Mapping[str, Mapping[str, ArrayLike]]
    _: KW_ONLY
    support_positions: Mapping[str, ArrayLike] = field(default_factory=dict)
    ground: ArrayLike | None = None
    force_unit: str | None = None
    carriers: Collection[str] = ()
    geometry_rate: float = 20.0
    rope_rate: float = 10.0
    space: InSpace | None = None
    wheels: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.force_unit not in (None, "N", "kN"):
            raise ValueError(f"force_unit: given {self.force_unit!r}; allowed: 'N', 'kN' or None")


class Picture:
    """Picture of one run in rerun, drawn into one file after the other.

    Args:
        look: appearance.
        layout: layout of the frames.
        c: columns of the first batch.
        window: time (s) before the cursor that live plots show, None for the whole run.
    """

    def __init__(self, look: Look, layout: Layout, c: Columns, window: float | None) -> None:
        self._look, self._window = look, window
        self._layout = layout
        self._unit = look.force_unit or _unit(first_known(c))
        self._scale = 1e-3 if self._unit == "kN" else 1.0
        self._plots = Plots(layout, look.carriers, self._scale, self._unit)
        self._rope = Rope(layout, self._scale, self._unit, space=look.space is not None)
        outlines = {
            name: {body: plane(np.asarray(line, np.float64)) for body, line in bodies.items()}
            for name, bodies in look.outlines.items()
        }
        self._vehicles = Vehicles(layout, outlines, look.carriers)
        self._space = look.space and Space(layout, look.space, look.carriers, self._vehicles.followed)
        self._estimates = EstimatePlots()
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
            {name: np.asarray(place, np.float64) for name, place in look.support_positions.items()},
            None if look.ground is None else np.asarray(look.ground, np.float64),
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
        self._estimates.restart()
        self._plots.begin(stream, plot_cells(self._plots, self._sizes), self._window)
        if self._space:
            self._space.begin(stream, first, scene.ground, look.wheels, self._sizes.track)
        stream.log("readout", rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)
        self._lay_out(stream, self._window)
        for times in (self._rope_times, self._pose_times, self._readout_times):
            times.restart()

    def end(self, stream: rr.RecordingStream) -> None:
        """Lay out a file again at its end, with its whole time span and final plot ranges."""
        self._lay_out(stream, None)

    def _lay_out(self, stream: rr.RecordingStream, window: float | None) -> None:
        shown = self._vehicles.close_ups, self._vehicles.boxes
        eyes = (self._space.overview, self._space.close_ups) if self._space else None
        estimates = self._estimates.views(window)
        stream.send_blueprint(
            lay_out(self._framed, self._sizes, *shown, self._plots, self._unit, window, eyes, estimates)
        )

    def send(self, stream: rr.RecordingStream, c: Columns) -> None:
        """Draw a batch of at least one frame into the file."""
        times = c.time[:, 0]
        self._plots.send(stream, c)
        if (rows := self._rope_times.rows(times)).size:
            self._rope.send(stream, c, rows)
        if (rows := self._pose_times.rows(times)).size:
            self._vehicles.send(stream, c, rows)
            if self._space:
                self._space.send(stream, c, rows)
        if (rows := self._readout_times.rows(times)).size:
            moments = [frame_of(c, row) for row in rows]
            texts = [describe_moment(self._layout, one, self._look.title, self._scale, self._unit) for one in moments]
            send(stream, "readout", times[rows], rr.TextDocument.columns(text=texts))

    def send_ahead(self, stream: rr.RecordingStream, ahead: Sequence[TensionAhead]) -> None:
        """Draw the tension ranges forecast by outlooks into the plot of tensions, each at the start of its forecast."""
        self._plots.send_ahead(stream, ahead, self._scale)

    def send_estimates(self, stream: rr.RecordingStream, estimates: Sequence[PlantEstimates]) -> None:
        """Draw estimates of a plant in order of time, in views of their own from the first ones on."""
        if self._estimates.send(stream, estimates):
            self._sizes = self._sizes._replace(
                side=max(self._sizes.side, side_width(table_columns(table_of(estimates[0]))))
            )
            self._plots.begin(stream, plot_cells(self._plots, self._sizes), self._window)
            self._lay_out(stream, self._window)


def _unit(c: Columns) -> str:
    """Return the force unit of the picture: N where every force of a frame is below 1 kN, else kN."""
    forces = [c.rope_tension, np.linalg.norm(c.support_force, axis=1), np.linalg.norm(c.contact_force, axis=1)]
    return "N" if np.fmax.reduce(np.abs(np.hstack(forces)), initial=0.0) < 1e3 else "kN"
