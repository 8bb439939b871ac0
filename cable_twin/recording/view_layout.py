"""How the picture is laid out: track, close-ups, plots, readout and commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import rerun as rr
import rerun.blueprint as rrb

from cable_twin.recording.view_geometry import TIMELINE
from cable_twin.recording.view_plots import Plot
from cable_twin.recording.view_vehicles import CLOSE_UPS
from cable_twin.records import FloatArray
from cable_twin.signals import SIGNALS

LEGEND_LINES = 12  # of a plot, up to which it has a legend


def lay_out(
    low: FloatArray,
    high: FloatArray,
    top: float,
    followed: Mapping[str, float],
    plots: Iterable[Plot],
    unit: str,
    window: float | None,
) -> rrb.Blueprint:
    """Return the layout of the whole picture.

    Args:
        low: (2,) m, lower left corner of the scene.
        high: (2,) m, its upper right one.
        top: m, where the legend is, above the scene.
        followed: Entity -> m, what has a close-up, and how far its vehicle reaches from there.
        plots: All plots.
        unit: Of forces.
        window: s, how much time before and after the cursor the plots show; None shows the whole run.
    """
    x, width = low[0], max(high[0] - low[0], high[1] - low[1])
    paths = [(plot.path, len(plot.names)) for plot in plots]
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
            name=f"Close-up of {name}" if len(followed) == 1 else name,
            origin=path,
            contents=["+ /track/**", "- /track/tension_colors"],
            visual_bounds=rrb.VisualBounds2D(x_range=[-0.7 * reach, 0.7 * reach], y_range=[-0.3 * reach, 1.1 * reach]),
        )
        for path, reach in list(followed.items())[:CLOSE_UPS]
        for name in [path.rpartition("/")[2]]
    ]
    drawn = {path.split("/")[1] for path, _ in paths}
    titles = {name: title for name, title in plot_titles(unit).items() if name in drawn}
    views = [_plot_view(f"plots/{name}", title, paths, window) for name, title in titles.items()]
    lower: list[rrb.View | rrb.Container] = [rrb.Grid(*views, grid_columns=2)]
    if close_ups:
        lower.insert(0, close_ups[0] if len(close_ups) == 1 else rrb.Tabs(*close_ups))
    return frame(
        rrb.Horizontal(
            rrb.Vertical(track, rrb.Horizontal(*lower, column_shares=[2, 5][-len(lower) :]), row_shares=[2, 3]),
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


def _plot_view(path: str, title: str, paths: Iterable[tuple[str, int]], window: float | None) -> rrb.TimeSeriesView:
    """Return one plot; all of them share their time axis."""
    lines = sum(count for other, count in paths if other.startswith(f"{path}/") or other == path)
    shown = None
    if window is not None:
        boundary = rr.TimeRangeBoundary.cursor_relative
        shown = rr.VisibleTimeRange(TIMELINE, start=boundary(seconds=-window), end=boundary(seconds=window))
    return rrb.TimeSeriesView(
        name=title,
        origin=path,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=1 < lines <= LEGEND_LINES),
        time_ranges=shown,
    )
