"""Plots of a study: key figures over varied keys, and Sobol indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.offline.studies.design import Design
from cable_twin.offline.studies.indices import Indices
from cable_twin.offline.studies.record import Results
from cable_twin.scenario.reference import unit_of

WIDTH, HEIGHT = 2.7, 2.1  # inches of a panel
LEAST = 5.5  # inches of a picture, for title and legend beside each other
TICKS, DIGITS = 4, 6  # most intervals between numbers on the axis of a key, and digits of these
BAR, GAP = 0.38, 0.02
SHARES = -0.1, 1.1  # of the axis: intervals of few cases go beyond what a share can be
BLUE, ORANGE = "#2a6fbb", "#d98324"


def write_scatter(title: str, design: Design, results: Results, shown: Sequence[str], file: Path) -> None:
    """Draw key figures of a study over each varied key as scatter plots, one point per case.

    Args:
        title: title of the plot.
        design: design of the cases.
        results: results of the cases.
        shown: ids of the figures.
        file: .png, .pdf or .svg.
    """
    columns = results.columns()
    keys = [one.key for one in design.factors if len({*columns[one.key]}) > 1]  # a key with one value shows nothing
    keys = keys or [one.key for one in design.factors]
    scaled = {key: _scaled(key, columns[key]) for key in keys}
    size = (WIDTH * len(keys) + 1.2, HEIGHT * len(shown) + 0.8)
    figure = Figure(figsize=size, layout="constrained", dpi=120)
    figure.suptitle(title, fontsize=10)
    panels = figure.subplots(len(shown), len(keys), squeeze=False, sharex="col", sharey="row")
    for row, name in zip(panels, shown, strict=True):
        values = results.figures[name]
        unit, scale = shown_unit(results.names[name][1], float(np.nanmax(np.abs(values))))
        for place, (panel, key) in enumerate(zip(row, keys, strict=True)):
            panel.plot(scaled[key][0], values * scale, ".", color=BLUE, markersize=4, alpha=0.7)
            panel.grid(alpha=0.3)
            panel.tick_params(labelsize=7)
            if place == 0:
                panel.set_ylabel(f"{_folded(results.names[name][0])}\n{_of(unit)}", fontsize=7)
    for panel, key in zip(panels[-1], keys, strict=True):
        points, label = scaled[key]
        panel.set_xlabel(label, fontsize=8)
        if isinstance(points[0], str):
            panel.margins(x=0.2)
            panel.tick_params(axis="x", rotation=20.0)
        else:
            panel.xaxis.set_major_locator(MaxNLocator(TICKS))
            panel.xaxis.set_major_formatter(lambda value, _: rounded(value, DIGITS))
    figure.savefig(file)


def _scaled(key: str, values: Sequence[object]) -> tuple[list[object], str]:
    """Values of a varied key, short names if they are no numbers, and label of their axis with the unit of the key."""
    if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in values):
        return [Path(str(one)).name for one in values], key
    return [*values], f"{key}\n{_of(unit_of(key))}"


def write_indices_plot(title: str, found: Mapping[str, Indices], names: Mapping[str, str], file: Path) -> None:
    """Draw first-order and total Sobol indices of key figures as bars by varied key, with confidence intervals.

    Args:
        title: title of the plot.
        found: Sobol indices by id of the key figure.
        names: printed names of figures.
        file: .png, .pdf or .svg.
    """
    columns = min(len(found), 3)
    rows = -(-len(found) // columns)
    keys = list(next(iter(found.values())).first)
    size = (max(3.1 * columns + 1.0, LEAST), (0.42 * len(keys) + 0.9) * rows + 1.0)
    figure = Figure(figsize=size, layout="constrained", dpi=120)
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for panel, (name, one) in zip(panels, found.items(), strict=False):
        _bars(panel, one, keys)
        panel.set_title(_folded(names[name]), fontsize=8)
    for panel in panels[len(found) :]:
        panel.set_axis_off()
    panels[0].set_xlim(*SHARES)
    figure.legend(*panels[0].get_legend_handles_labels(), fontsize=7, loc="outside upper right", ncols=2)
    figure.supxlabel("share of the variance, with 95 % confidence [-]", fontsize=8)
    figure.savefig(file)


def _bars(panel: Axes, one: Indices, keys: Sequence[str]) -> None:
    """Draw the Sobol indices of one key figure: per varied key a bar each for first-order and total index."""
    places = np.arange(len(keys), dtype=float)
    for offset, by_key, label, colour, hatch in (
        (-0.5 * BAR - GAP, one.first, "first order", BLUE, ""),
        (0.5 * BAR + GAP, one.total, "total", ORANGE, "///"),
    ):
        values = np.array([by_key[key].value for key in keys])
        off = np.array(
            [[values[row] - by_key[key].low, by_key[key].high - values[row]] for row, key in enumerate(keys)]
        )
        panel.barh(places + offset, values, BAR, color=colour, hatch=hatch, edgecolor="white", label=label,
                   xerr=np.maximum(off.T, 0.0), error_kw={"lw": 0.8, "capsize": 2})  # fmt: skip
    panel.set_yticks(places, keys, fontsize=8)
    panel.set_ylim(len(keys) - 0.5, -0.5)
    panel.tick_params(axis="x", labelsize=7)
    panel.axvline(0.0, color="black", lw=0.6)
    panel.grid(axis="x", alpha=0.3)


def _folded(name: str) -> str:
    """Break the long name of a key figure into two lines, at its colon."""
    head, colon, rest = name.partition(": ")
    return f"{head}:\n{rest}" if colon and len(name) > 24 else name


def _of(unit: str) -> str:
    return f"[{unit or '-'}]"
