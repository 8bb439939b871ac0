"""Picture of a calibration: estimates beside priors, correlation, and residuals of each sensor over time."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cable_twin.basics.units import NORMAL_95, rounded, shown_unit
from cable_twin.frame.records import FloatArray
from cable_twin.offline.calibration.prediction import Rows
from cable_twin.offline.calibration.solve import Solution
from cable_twin.offline.plots import COLORS, INK, QUIET, styled

WIDTH, ROW, HIGHEST = 12.0, 1.35, 60.0  # inches, of a row of residuals, of the picture
MOST_SHOWN = 6.0  # deviations, of the axis of residuals


def write_picture(title: str, solution: Solution, rows: Rows, path: Path) -> None:
    """Draw estimates, correlations and residuals of a calibration into a PNG file.

    Raises:
        OSError: the file cannot be written.
    """
    series = sorted({(int(log), int(sensor)) for log, sensor in zip(rows.log, rows.sensor, strict=True)})
    count = len(solution.estimates)
    top = 1.0 + 0.34 * count
    with styled():
        height = min(top + ROW * len(series) + 1.0, HIGHEST)
        figure = plt.figure(figsize=(WIDTH, height), layout="constrained")
        above, below = figure.subfigures(2, 1, height_ratios=[top, height - top])
        left, right = above.subplots(1, 2, width_ratios=[1.7, 1.0])
        _draw_estimates(left, solution)
        _draw_correlation(above, right, solution)
        panels = np.atleast_1d(below.subplots(len(series), 1, sharex=len({log for log, _ in series}) == 1))
        for panel, (log, sensor) in zip(panels, series, strict=True):
            own = (rows.log == log) & (rows.sensor == sensor)
            name = rows.sensors[sensor] + (f", log {log + 1}" if series[-1][0] else "")
            before, after = solution.prior.residuals[own], solution.last.residuals[own]
            _draw_residuals(panel, name, rows.time[own], before, after, rows.held[own])
        panels[0].legend(loc="upper right", ncols=3, fontsize=8)
        panels[-1].set_xlabel("s")
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold", fontsize=13.0)
        figure.savefig(path)
        plt.close(figure)


def _draw_estimates(panel: Axes, solution: Solution) -> None:
    """Draw the 95 % intervals of the estimates, scaled by prior standard deviations, with the values as text."""
    number = np.arange(len(solution.estimates))
    labels = []
    for row, one in enumerate(solution.estimates):
        prior = one.parameter
        middle = (one.value - prior.mean) / prior.deviation
        ends = [[(one.value - one.low) / prior.deviation], [(one.high - one.value) / prior.deviation]]
        panel.plot([-NORMAL_95, NORMAL_95], [row, row], color=QUIET, linewidth=7.0, alpha=0.35, solid_capstyle="butt")
        color = COLORS[0] if one.told else QUIET
        panel.errorbar(middle, row, xerr=ends, fmt="o", color=color, markersize=5.0, capsize=4.0, linewidth=1.6)
        unit, scale = shown_unit(prior.unit, one.value)
        half = f"± {rounded(scale * one.half, 2)}"
        if one.cut:
            half = f"({rounded(scale * one.low, 2)} to {rounded(scale * one.high, 2)})"
        text = f"{rounded(scale * one.value)} {half} {unit}".removesuffix(" -")
        panel.annotate(
            text if one.told else "not told: prior kept",
            (1.0, row),
            xycoords=("axes fraction", "data"),
            xytext=(6.0, 0.0),
            textcoords="offset points",
            va="center",
            fontsize=9.0,
            color=color,
        )
        labels.append(f"{row + 1}  {prior.key}")
    panel.set_yticks(number, labels, fontsize=9.0)
    panel.set_ylim(len(number) - 0.5, -0.5)
    panel.set_xlabel("standard deviations of the prior (grey: 95 % of it)")
    panel.grid(visible=False, axis="y")
    panel.set_title("estimates with intervals of 95 %")


def _draw_correlation(figure: Figure, panel: Axes, solution: Solution) -> None:
    """Draw the correlation matrix of the estimates as a coloured grid with the coefficients as text."""
    count = len(solution.estimates)
    image = panel.imshow(solution.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    for row in range(count):
        for column in range(count):
            value = solution.correlation[row, column]
            if count <= 12 and row != column:
                color = "white" if abs(value) > 0.6 else INK
                panel.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8.0, color=color)
    panel.set_xticks(range(count), [str(number + 1) for number in range(count)])
    panel.set_yticks(range(count), [str(number + 1) for number in range(count)])
    panel.grid(visible=False)
    panel.set_title("correlation")
    figure.colorbar(image, ax=panel, shrink=0.8)


def _draw_residuals(
    panel: Axes, name: str, times: FloatArray, before: FloatArray, after: FloatArray, held: FloatArray
) -> None:
    """Draw the residuals of a sensor over time before and after calibration, with the stretches held out."""
    panel.plot(times, before, ".", color=QUIET, markersize=1.5, alpha=0.6, label="prior")
    training = held == 0
    panel.plot(times[training], after[training], ".", color=COLORS[0], markersize=1.5, label="calibrated")
    panel.plot(times[~training], after[~training], ".", color=COLORS[1], markersize=1.5, label="held out")
    most = max(MOST_SHOWN, 1.2 * float(np.abs(after).max(initial=0.0)))
    panel.set_ylim(-most, most)
    panel.set_title(f"{name}, residuals in standard deviations", fontsize=9.0)
