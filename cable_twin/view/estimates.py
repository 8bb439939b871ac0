"""Estimates of a plant that a twin follows, in rerun: a table with bands of 95 %, and each of the first ones over time.

All else in the picture has the values of the scenario.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cable_twin.basics.units import NORMAL_95, shown_unit, with_band
from cable_twin.frame.records import PlantEstimates
from cable_twin.view.batch import entity_path, time_column
from cable_twin.view.plots import PLOT_COLORS

TABLE, OVER_TIME = "estimates", "estimate"  # entity of the table, and root of those over time
MOST = 12  # that are drawn over time, the first ones; payloads last where there are more of them
LINES = ("estimate", "least", "most")
COLORS = np.array([PLOT_COLORS[0], *[PLOT_COLORS[0] & 0xFFFFFF80 | 0x80] * 2], dtype=np.uint32)


class EstimatePlots:
    """Table and plots of estimates, of which nothing is laid out before the first ones come.

    Attributes:
        units: unit, and factor from the SI unit to it, by name of what is drawn over time.
    """

    def __init__(self) -> None:
        self.units: dict[str, tuple[str, float]] = {}
        self._begun: set[str] = set()  # in the present file

    def restart(self) -> None:
        """Begin a new file."""
        self._begun.clear()

    def send(self, stream: rr.RecordingStream, estimates: Sequence[PlantEstimates]) -> bool:
        """Send estimates in order of time; returns whether some are new, so that the picture is to be laid out."""
        before = len(self.units)
        if not before:
            found = estimates[0].found
            many = sum(map(_is_payload, found)) > MOST
            shown = sorted(found, key=lambda name: many and _is_payload(name))[:MOST]
            self.units = {name: shown_unit(found[name][2], found[name][0]) for name in shown}
        times = time_column(np.array([one.time for one in estimates]))
        if TABLE not in self._begun:
            self._begun.add(TABLE)
            stream.log(TABLE, rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)
        stream.send_columns(TABLE, [times], rr.TextDocument.columns(text=[table_of(one) for one in estimates]))
        for name, (_, scale) in self.units.items():
            path = entity_path(OVER_TIME, name)
            if path not in self._begun:
                self._begun.add(path)
                lines = rr.SeriesLines(names=LINES, colors=COLORS, widths=[1.5, 0.8, 0.8])
                stream.log(path, lines, static=True)
            rows = np.array([one.found.get(name, (np.nan, np.nan, ""))[:2] for one in estimates])
            bands = rows[:, :1] + NORMAL_95 * rows[:, 1:] * [0.0, -1.0, 1.0]
            stream.send_columns(path, [times], rr.Scalars.columns(scalars=np.ascontiguousarray(bands * scale)))
        return len(self.units) > before

    def views(self, window: float | None) -> list[rrb.View]:
        """Views of the table and of each estimate over time; none before there are any.

        Args:
            window: time (s) that is shown before the cursor; None for the whole run.
        """
        if not self.units:
            return []
        shown = None
        if window is not None:
            boundary = rr.TimeRangeBoundary.cursor_relative
            shown = rr.VisibleTimeRange("sim_time", start=boundary(seconds=-window), end=boundary())
        return [
            rrb.TextDocumentView(name="Estimates", origin=TABLE),
            *(
                rrb.TimeSeriesView(
                    name=f"{name} [{unit}]",
                    origin=entity_path(OVER_TIME, name),
                    axis_x=rrb.TimeAxis(link="LinkToGlobal"),
                    plot_legend=rrb.PlotLegend(visible=False),
                    time_ranges=shown,
                )
                for name, (unit, _) in self.units.items()
            ),
        ]


def _is_payload(name: str) -> bool:
    return name.endswith("/payload")


def table_of(estimates: PlantEstimates) -> str:
    """Estimates as a Markdown table, each with its band of 95 %."""
    rows = [f"| {name} | **{with_band(*one)}** |" for name, one in estimates.found.items()]
    return "\n".join(["| of the plant | 95 % |", "| :-- | --: |", *rows])
