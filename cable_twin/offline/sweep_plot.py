"""Plot of a sweep: key figures that first miss their limits over the swept value, windows with all limits kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.offline.lines.plot import LIMIT
from cable_twin.offline.plots import COLORS, QUIET, save, styled
from cable_twin.offline.sweep_limits import SweptFigure, Window

PANELS = 6
KEPT = "#2E9E5B"


def write_sweep_plot(
    title: str, swept: str, figures: Sequence[SweptFigure], windows: Sequence[Window], path: Path
) -> None:
    """Draw up to six key figures of a sweep with their limits, on green where all limits are kept, into a file.

    Raises:
        OSError: the file cannot be written.
    """
    shown = figures[:PANELS]
    with styled():
        columns = 1 if len(shown) == 1 else 2
        rows = -(-len(shown) // columns)
        figure, grid = plt.subplots(rows, columns, figsize=(5.2 * columns, 2.7 * rows + 0.7), squeeze=False)
        for number, axes in enumerate(grid.ravel()):
            if number >= len(shown):
                axes.axis("off")
                continue
            _panel(axes, shown[number], COLORS[number % len(COLORS)], windows)
            if number + columns >= len(shown):
                axes.set_xlabel(swept)
        save(figure, title, path)


def _panel(axes: Axes, figure: SweptFigure, color: str, windows: Sequence[Window]) -> None:
    values = np.array([np.nan if one is None else one.value for one in figure.figures])
    limits = np.array([np.nan if one is None or one.limit is None else one.limit for one in figure.figures])
    unit, scale = shown_unit(figure.unit, float(np.nanmax(np.abs([*values, *limits]))))
    for window in windows:
        axes.axvspan(window.low.value, window.high.value, color=KEPT, alpha=0.12, linewidth=0)
    axes.plot(figure.values, values * scale, marker=".", color=color)
    least, most = figure.limits
    if least == most:
        axes.axhline(least * scale, color=LIMIT, linewidth=1.0)
    else:
        axes.plot(figure.values, limits * scale, color=LIMIT, linewidth=1.0)
    axes.annotate(
        figure.bound if least != most else f"{figure.bound} {rounded(least * scale)}",
        (0.01, float(limits[np.isfinite(limits)][0]) * scale),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        color=LIMIT,
        fontsize=8.5,
    )
    for value in {end.value for window in windows for end in (window.low, window.high) if end.figure is not None}:
        axes.axvline(value, color=QUIET, linestyle="--", linewidth=1.0)
    axes.set_title(figure.name, fontsize=9.5)
    axes.set_ylabel("" if unit == "-" else unit)
    axes.margins(y=0.15)
