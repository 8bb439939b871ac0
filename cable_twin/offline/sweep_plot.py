"""Picture of a sweep: the figures that come nearest to their limits over the swept value."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # no screen needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from cable_twin.offline.figure_table import shown_unit
from cable_twin.offline.line_plot import LIMIT
from cable_twin.offline.plots import COLORS, QUIET, STYLE
from cable_twin.offline.sweep_limits import OperatingLimit, SweptFigure

PANELS = 6


def write_sweep_plot(
    title: str, swept: str, figures: Sequence[SweptFigure], limit: OperatingLimit | None, path: Path
) -> None:
    """Draw up to six figures with their limits, the value of the operating limit across all.

    Raises:
        OSError: it cannot be written.
    """
    shown = figures[:PANELS]
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]  # matplotlib lists every key
        columns = 1 if len(shown) == 1 else 2
        rows = -(-len(shown) // columns)
        figure, grid = plt.subplots(rows, columns, figsize=(5.2 * columns, 2.7 * rows + 0.7), squeeze=False)
        for number, axes in enumerate(grid.ravel()):
            if number >= len(shown):
                axes.axis("off")
                continue
            _panel(axes, shown[number], COLORS[number % len(COLORS)], limit)
            if number + columns >= len(shown):
                axes.set_xlabel(swept)
        figure.suptitle(title, x=0.012, ha="left", fontweight="bold", fontsize=13.0)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.99))
        figure.savefig(path)
        plt.close(figure)


def _panel(axes: Axes, figure: SweptFigure, color: str, limit: OperatingLimit | None) -> None:
    values = np.array([np.nan if one is None else one.value for one in figure.figures])
    unit, scale = shown_unit(figure.unit, float(np.nanmax(np.abs([*values, figure.limit]))))
    axes.plot(figure.values, values * scale, marker=".", color=color)
    axes.axhline(figure.limit * scale, color=LIMIT, linewidth=1.0)
    axes.annotate(
        f"{figure.bound} {figure.limit * scale:.4g}",
        (0.01, figure.limit * scale),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        color=LIMIT,
        fontsize=8.5,
    )
    if limit is not None:
        axes.axvline(limit.value, color=QUIET, linestyle="--", linewidth=1.0)
    axes.set_title(figure.name, fontsize=9.5)
    axes.set_ylabel("" if unit == "-" else unit)
    axes.margins(y=0.15)


__all__ = ["write_sweep_plot"]
