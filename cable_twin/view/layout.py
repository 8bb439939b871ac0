"""Layout of the rerun view: track, close-ups, plots, readout and commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.view.geometry import TIMELINE
from cable_twin.view.plots import LEGENDS, Plots, shown_unit
from cable_twin.view.scene import Framed
from cable_twin.view.sizes import LEGEND_ROW, Sizes
from cable_twin.view.space import NEAR_WIND, OVERVIEW_WIND, SPACE, Eye
from cable_twin.view.vehicles import CLOSE_UPS, NAMES

AHEAD = 0.04  # of the time that a plot shows up to the cursor, behind it: room for its last number


def lay_out(
    framed: Framed,
    sizes: Sizes,
    followed: Mapping[str, float],
    boxes: Iterable[str],
    plots: Plots,
    unit: str,
    window: float | None,
    eyes: tuple[Eye, Mapping[str, Eye]] | None = None,
) -> rrb.Blueprint:
    """Return the blueprint of the whole picture.

    Args:
        framed: What the view of the whole track shows.
        sizes: How the picture is divided.
        followed: Entity -> m, what has a close-up, and how far its vehicle reaches from there.
        boxes: Entities that stand for vehicles where the whole track is shown.
        plots: All plots.
        unit: Of forces.
        window: s, how much time up to the cursor the plots show; None shows the whole run.
        eyes: From where the whole is seen in space, and each entity that has a close-up there; None in a plane.
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
    return frame(
        rrb.Horizontal(
            rrb.Vertical(track, *lower, row_shares=[1] * (len(lower) + 1)),
            rrb.Vertical(
                rrb.TextDocumentView(name="Readout", origin="readout"),
                rrb.TextLogView(
                    name="Commands", origin="commands", columns=rrb.TextLogColumns(text_log_columns=["Body"])
                ),
                row_shares=[3, 1],
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
    """Return a 3D view from a place, moving with an entity where `followed` names one."""
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


def frame(contents: rrb.Container) -> rrb.Blueprint:
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
    """Return one plot with its legend rows below, linked to the common time axis."""
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


__all__ = ["frame", "lay_out", "plot_cells", "plot_titles"]
