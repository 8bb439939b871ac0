"""How the picture is laid out: track, close-ups, plots, readout and commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cable_twin.plotted_signals import SIGNALS
from cable_twin.recording.view_geometry import TIMELINE
from cable_twin.recording.view_plots import LEGEND_HEIGHT, LEGENDS, Plots
from cable_twin.recording.view_space import NEAR_WIND, OVERVIEW_WIND, SPACE, Eye
from cable_twin.recording.view_vehicles import CLOSE_UPS
from cable_twin.records import FloatArray

LEGEND_LINES = 9  # of a plot, up to which it has a legend
TICKS, MOST_TICKS = 4, 8  # of a plot: wanted, and for which it is high enough
EDGE = 0.12  # of the distance between two ticks: room for the number of the outermost
AHEAD = 0.04  # of the time that a plot shows up to the cursor, behind it: room for its last number
IN_A_ROW = 3  # plots and close-ups, of about one height and width; in space there are more of them
IN_SPACE_IN_A_ROW = 5


def lay_out(
    low: FloatArray,
    high: FloatArray,
    top: float,
    followed: Mapping[str, float],
    boxes: Iterable[str],
    plots: Plots,
    unit: str,
    window: float | None,
    spans: Mapping[str, tuple[float, float]],
    eyes: tuple[Eye, Mapping[str, Eye]] | None = None,
) -> rrb.Blueprint:
    """Return the layout of the whole picture.

    Args:
        low: (2,) m, lower left corner of the scene.
        high: (2,) m, its upper right one.
        top: m, where the legend is, above the scene.
        followed: Entity -> m, what has a close-up, and how far its vehicle reaches from there.
        boxes: Entities that stand for vehicles where the whole track is shown.
        plots: All plots.
        unit: Of forces.
        window: s, how much time up to the cursor the plots show; None shows the whole run.
        spans: Signal -> lowest and highest value of its plot, where they are known.
        eyes: From where the whole is seen in space, and each entity that has a close-up there; None in a plane.
    """
    x, width = low[0], max(high[0] - low[0], high[1] - low[1])
    track: rrb.View | rrb.Container = rrb.Spatial2DView(
        name="Track, rope coloured by tension",
        origin="track",
        visual_bounds=rrb.VisualBounds2D(
            x_range=[x - 0.03 * width, high[0] + 0.03 * width],
            y_range=[-top - 0.03 * width, -low[1] + 0.02 * width],
        ),
    )
    cells = _plot_views(plots, unit, window, spans)
    if followed:
        cells.insert(0, _close_ups(followed, boxes))
    if eyes is not None:
        overview, near = eyes
        track = rrb.Horizontal(track, _in_space(overview), column_shares=[1, 1])
        if near:
            cells.insert(1, _together([_in_space(eye, entity) for entity, eye in near.items()]))
    rows = -(-len(cells) // (IN_A_ROW if eyes is None else IN_SPACE_IN_A_ROW))
    lower = [rrb.Horizontal(*cells[len(cells) * row // rows : len(cells) * (row + 1) // rows]) for row in range(rows)]
    return frame(
        rrb.Horizontal(
            rrb.Vertical(track, *lower, row_shares=[1] * (rows + 1)),
            rrb.Vertical(
                rrb.TextDocumentView(name="Readout", origin="readout"),
                rrb.TextLogView(
                    name="Commands", origin="commands", columns=rrb.TextLogColumns(text_log_columns=["Body"])
                ),
                row_shares=[3, 2],
            ),
            column_shares=[5, 1],
        )
    )


def _close_ups(followed: Mapping[str, float], boxes: Iterable[str]) -> rrb.View | rrb.Container:
    """Return the views that move with vehicles, one behind the other."""
    hidden = ("track/tension_colors", "track/names", *boxes)
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
    """Return views one behind the other."""
    return views[0] if len(views) == 1 else rrb.Tabs(*views)


def _in_space(eye: Eye, followed: str | None = None) -> rrb.View:
    """Return a view in space, from a place; it moves with an entity where it follows one."""
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


def _plot_views(
    plots: Plots, unit: str, window: float | None, spans: Mapping[str, tuple[float, float]]
) -> list[rrb.View | rrb.Container]:
    """Return a view of each signal that is plotted."""
    drawn = {plot.path.split("/")[1] for plot in plots}
    titles = {name: title for name, title in plot_titles(unit).items() if name in drawn}
    rows = {name: [len(row) for row in plots.legend(name)] for name in titles}
    return [_plot_view(f"plots/{name}", title, rows[name], window, spans.get(name)) for name, title in titles.items()]


def plot_titles(unit: str) -> dict[str, str]:
    """Return the plots by the name of their signal with their titles, forces in `unit`."""
    return {
        name: f"{signal.view} [{unit if signal.unit == 'N' else signal.unit}]"
        for name, signal in SIGNALS.items()
        if signal.view
    }


def frame(contents: rrb.Container) -> rrb.Blueprint:
    """Return a layout that shows its contents and the time, and nothing of rerun's own panels."""
    return rrb.Blueprint(
        contents,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
        auto_layout=False,
    )


def _plot_view(
    path: str, title: str, rows: Sequence[int], window: float | None, span: tuple[float, float] | None
) -> rrb.View | rrb.Container:
    """Return one plot, with its legend of so many names in each row below it; all show the same time."""
    lines = sum(rows)
    shown, time_axis = None, rrb.TimeAxis(link="LinkToGlobal")
    if window is not None:
        boundary = rr.TimeRangeBoundary.cursor_relative
        first, last = boundary(seconds=-window), boundary(seconds=AHEAD * window)
        shown = rr.VisibleTimeRange(TIMELINE, start=first, end=last)
        time_axis = rrb.TimeAxis(view_range=rr.TimeRange(first, last))
    plot = rrb.TimeSeriesView(
        name=title,
        origin=path,
        axis_x=time_axis,
        axis_y=None if span is None else rrb.ScalarAxis(range=with_ticks(*span)),
        plot_legend=rrb.PlotLegend(visible=False),
        time_ranges=shown,
    )
    if not 1 < lines <= LEGEND_LINES:
        return plot
    legend = rrb.Spatial2DView(
        origin=path.replace("plots", LEGENDS, 1),
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-0.5, lines - 0.5], y_range=[-0.005 * lines, (LEGEND_HEIGHT * len(rows) - 0.005) * lines]
        ),
        titlebar=False,
    )
    return rrb.Vertical(plot, legend, row_shares=[8, len(rows)])


def with_ticks(low: float, high: float) -> tuple[float, float]:
    """Return an axis around what reaches from `low` to `high`, on which rerun writes at least `TICKS` numbers.

    It writes the multiples of one power of ten, the smallest for which it has room.
    """
    span = max(high - low, 1e-3 * max(abs(low), abs(high)), 1e-9)
    step = 10.0 ** np.ceil(np.log10(span / MOST_TICKS))
    middle, half = (low + high) / 2.0, 0.52 * span
    first, last = np.ceil((middle - half) / step), np.floor((middle + half) / step)
    while last - first + 1 < TICKS:  # the nearer one next
        if middle - half - (first - 1) * step < (last + 1) * step - middle - half:
            first -= 1
        else:
            last += 1
    return float(min(middle - half, (first - EDGE) * step)), float(max(middle + half, (last + EDGE) * step))
