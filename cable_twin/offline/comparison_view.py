"""Comparison of several runs in one rerun recording: each run below its own root, with overlaid plots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.offline.figure_table import LABELS
from cable_twin.recording.run import open_view
from cable_twin.scenario import Scenario
from cable_twin.view.picture import blueprint, plot_titles
from cable_twin.view.plots import PLOT_COLORS
from cable_twin.view.rerun_view import RerunView, flush_stream, open_stream
from cable_twin.view.space import SPACE


class _RootedStream:
    """Rerun stream of one run in a comparison: entity paths below a root, prefixed line names, no blueprint."""

    def __init__(self, stream: rr.RecordingStream, root: str, first_color: int) -> None:
        self._stream = stream
        self._root = root
        self._first_color = first_color
        self.set_time = stream.set_time

    def log(self, path: str, *entities: Any, **options: Any) -> None:
        self._stream.log(f"{self._root}/{path}", *map(self._named, entities), **options)

    def send_columns(self, path: str, *columns: Any, **options: Any) -> None:
        self._stream.send_columns(f"{self._root}/{path}", *columns, **options)

    def send_blueprint(self, *_: Any, **__: Any) -> None:
        """Ignore the blueprint of one run, as the comparison sends its own."""

    def flush(self, *, timeout_sec: float) -> None:
        self._stream.flush(timeout_sec=timeout_sec)

    def disconnect(self) -> None:
        """Keep the rerun stream open, as the comparison closes it."""

    def _named(self, entity: Any) -> Any:
        if not isinstance(entity, rr.SeriesLines) or entity.names is None:
            return entity
        names = entity.names.as_arrow_array().to_pylist()
        colors = [PLOT_COLORS[(self._first_color + index) % len(PLOT_COLORS)] for index in range(len(names))]
        return rr.SeriesLines(
            names=[f"{self._root}: {name}" for name in names], colors=np.array(colors, dtype=np.uint32), widths=[1.5]
        )


class ComparisonView:
    """Rerun recording of several runs side by side.

    Args:
        scenarios: Of the runs.
        titles: Name of each run.
        path: The .rrd to write.
        first: The first snapshot of the first run, for the unit of forces.

    Raises:
        OSError: The file cannot be created.
    """

    def __init__(self, scenarios: Sequence[Scenario], titles: Sequence[str], path: Path, first: Snapshot) -> None:
        self._stream = open_stream(" and ".join(titles), path)
        unit = "N" if abs(first.cable.tensions).max() < 1e3 else "kN"
        self.views: list[RerunView] = []
        for index, (root, scenario) in enumerate(zip(LABELS, scenarios, strict=False)):
            stream: Any = _RootedStream(self._stream, root, 3 * index)
            self.views.append(open_view(scenario, None, stream=stream, force_unit=unit, batch_frames=500))
        self._stream.send_blueprint(_blueprint(titles, unit, first.layout))

    def close(self) -> None:
        """Send waiting data of all runs and close the rerun file.

        Raises:
            OSError: The file cannot be written.
        """
        for view in self.views:
            view.close()
        flush_stream(self._stream, None)
        self._stream.disconnect()


def _blueprint(titles: Sequence[str], unit: str, layout: Layout) -> rrb.Blueprint:
    """Rerun blueprint of a comparison: tracks and commands side by side, plots of all runs below."""
    roots = LABELS[: len(titles)]
    tracks = [
        rrb.Spatial2DView(name=f"{root}: {title}", origin=f"{root}/track")
        for root, title in zip(roots, titles, strict=True)
    ]
    spaces = [rrb.Spatial3DView(name=f"{root}: in space", origin=f"{root}/{SPACE}", line_grid=False) for root in roots]
    plots = [
        rrb.TimeSeriesView(
            name=title,
            origin="/",
            contents=[f"+ /{root}/plots/{path}/**" for root in roots],
            axis_x=rrb.TimeAxis(link="LinkToGlobal"),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        )
        for path, title in plot_titles(unit).items()
        if SIGNALS[path].names(layout)
    ]
    commands = [
        rrb.TextLogView(
            name=f"Commands of {root}",
            origin=f"{root}/commands",
            columns=rrb.TextLogColumns(text_log_columns=["Body"]),
        )
        for root in roots
    ]
    return blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Horizontal(*tracks, *(spaces if layout.space else ())),
                rrb.Grid(*plots, grid_columns=3 if layout.space else 2),
                row_shares=[2, 3],
            ),
            rrb.Vertical(*commands),
            column_shares=[5, 1],
        )
    )
