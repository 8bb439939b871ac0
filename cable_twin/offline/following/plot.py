"""Plot of the estimates of a followed plant over time with 95 % bands, beside true values where known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cable_twin.basics.units import NORMAL_95, shown_unit
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.frame.records import FloatArray
from cable_twin.offline.following.truth import Truth
from cable_twin.offline.plots import COLORS, INK, styled

HEIGHT, WIDTH, HEAD = 1.7, 11.0, 0.5  # inches, of a row, of the picture and of its title
COLUMNS = 3  # panels beside each other
MANY = 16  # estimates of one kind, above which they share a panel with the last ones


def write_estimates(title: str, corrections: Sequence[Correction], truth: Mapping[str, Truth], path: Path) -> None:
    """Draw all estimates of a followed plant over time with 95 % bands into a file; of many of a kind the last ones.

    Args:
        title: of the picture.
        corrections: in the order of time, at least one.
        truth: true values of the plant, by the name of the estimate.
        path: file of the picture.

    Raises:
        OSError: the file cannot be written.
    """
    names = [*corrections[-1].slow, *corrections[-1].hidden]
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(name.rpartition("/")[2], []).append(name)
    together = {kind: own for kind, own in kinds.items() if len(own) > MANY}
    alone = [name for name in names if name.rpartition("/")[2] not in together]
    rows = len(together) + -(-len(alone) // COLUMNS)
    with styled():
        height = HEIGHT * rows + HEAD
        layout = ConstrainedLayoutEngine(rect=(0.0, 0.0, 1.0, 1.0 - HEAD / height), h_pad=0.06, w_pad=0.06)
        figure = plt.figure(figsize=(WIDTH, height), layout=layout)
        grid = figure.add_gridspec(rows, COLUMNS)
        for row, (kind, own) in enumerate(together.items()):
            _draw_last(figure.add_subplot(grid[row, :]), kind, own, corrections[-1], truth)
        for number, name in enumerate(alone):
            row, column = divmod(number, COLUMNS)
            panel = figure.add_subplot(grid[len(together) + row, column])
            _draw_over_time(panel, name, corrections, truth.get(name))
            if number + COLUMNS >= len(alone):
                panel.set_xlabel("time [s]")
        figure.suptitle(title, x=0.012, y=1.0 - 0.1 / height, ha="left", va="top", fontweight="bold", fontsize=13.0)
        looks: list[Artist] = [Line2D([], [], color=COLORS[0], marker=".", label="estimate")]
        looks += [Patch(color=COLORS[0], alpha=0.3, linewidth=0.0, label="95 %")]
        looks += [Line2D([], [], color=INK, linewidth=0.8, label="plant")] if truth else []
        legend = figure.legend(handles=looks, loc="upper right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        legend.set_in_layout(False)  # it stands beside the title
        figure.savefig(path)
        plt.close(figure)


def _draw_over_time(panel: Axes, name: str, corrections: Sequence[Correction], truth: Truth | None) -> None:
    """Draw an estimate over time: slow ones as a line, those of motion as points, as nothing is known between them."""
    times = np.array([one.time for one in corrections])
    found = [(one.slow | one.hidden)[name] for one in corrections]
    values, deviations = np.array([[one.value, one.deviation] for one in found]).T
    unit, scale = shown_unit(found[0].unit, float(np.abs(values).max()))
    values, low, high = (
        scale * values,
        scale * (values - NORMAL_95 * deviations),
        scale * (values + NORMAL_95 * deviations),
    )
    if truth is not None:
        panel.plot(truth.times, scale * truth.values, color=INK, linewidth=0.8)
    if name in corrections[-1].slow:
        panel.fill_between(times, low, high, color=COLORS[0], alpha=0.3, linewidth=0.0)
        panel.plot(times, values, color=COLORS[0], linewidth=1.2)
    else:
        panel.vlines(times, low, high, color=COLORS[0], alpha=0.3, linewidth=2.5)
        panel.plot(times, values, ".", color=COLORS[0], markersize=4.0)
    panel.set_title(f"{name}, {unit}", loc="left", fontsize=9)
    panel.ticklabel_format(useOffset=False)
    panel.margins(x=0.02)


def _draw_last(
    panel: Axes, kind: str, names: Sequence[str], correction: Correction, truth: Mapping[str, Truth]
) -> None:
    """Draw the estimates of many objects in a correction beside each other, with bands of 95 % and true values."""
    found = [(correction.slow | correction.hidden)[name] for name in names]
    values, deviations = np.array([[one.value, one.deviation] for one in found]).T
    unit, scale = shown_unit(found[0].unit, float(np.abs(values).max()))
    rows: FloatArray = np.arange(len(names), dtype=np.float64)
    low, high = scale * (values - NORMAL_95 * deviations), scale * (values + NORMAL_95 * deviations)
    panel.vlines(rows, low, high, color=COLORS[0], alpha=0.3, linewidth=6.0)
    panel.plot(rows, scale * values, ".", color=COLORS[0])
    for row, name in enumerate(names):
        if name in truth:
            true = scale * truth[name].last
            panel.plot([row - 0.35, row + 0.35], [true, true], color=INK, linewidth=1.2)
    panel.set_title(f"{kind} at {correction.time:.0f} s, {unit}", loc="left", fontsize=9)
    panel.set_xticks(rows, [name.rpartition("/")[0] for name in names], rotation=60, ha="right", fontsize=7.0)
    panel.margins(x=0.02)
