"""Plot of an envelope of load cases: range of tower loads and largest sags, with the governing cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from cable_twin.basics.units import rounded
from cable_twin.key_figures import KeyFigure
from cable_twin.offline.plots import COLORS, INK, save, styled

Extremes = Sequence[tuple[str, KeyFigure]]
HEIGHT, WIDTH = 0.3, 11.0  # inches, of a row and of the picture


def write_envelope_plot(title: str, extremes: Extremes, path: Path) -> bool:
    """Draw tower loads and sags of an envelope of load cases into a file; returns whether there are any.

    Args:
        title: of the picture.
        extremes: figures with the ids of their governing cases.
        path: file of the picture, with a format by its suffix.

    Raises:
        OSError: the file cannot be written.
    """
    low = {one.id.subject: (case, one) for case, one in extremes if one.id[::2] == ("support_load", "lowest")}
    high = {one.id.subject: (case, one) for case, one in extremes if one.id[::2] == ("support_load", "highest")}
    towers = [name for name in high if name.startswith("towers.") and name in low]
    sags = [(case, one) for case, one in extremes if one.id.quantity == "sag"]
    if not towers and not sags:
        return False
    with styled():
        counts = [max(len(towers), 1), max(len(sags), 1)]
        size = WIDTH, HEIGHT * sum(counts) + 2.2
        figure, (above, below) = plt.subplots(2, 1, figsize=size, height_ratios=counts)
        _loads(above, [(low[name], high[name]) for name in towers])
        _sags(below, sags)
        save(figure, title, path)
    return True


def _loads(axes: Axes, rows: Sequence[tuple[tuple[str, KeyFigure], tuple[str, KeyFigure]]]) -> None:
    """Draw the range of the load of each tower over load cases as bars, with values and governing cases."""
    most = max((one.value for _, (_, one) in rows), default=1.0) / 1e3
    for row, ((lowest, least), (highest, greatest)) in enumerate(rows):
        start, end = least.value / 1e3, greatest.value / 1e3
        axes.barh(row, end - start, 0.6, left=start, color=COLORS[0])
        axes.text(
            start - 0.01 * most, row, f"{rounded(start)}  {lowest}", va="center", ha="right", fontsize=8, color=INK
        )
        axes.text(end + 0.01 * most, row, f"{rounded(end)}  {highest}", va="center", fontsize=8, color=INK)
    _label(axes, [one.name.partition(": ")[0] for (_, one), _ in rows], "load of the tower [kN]", most, low=-0.3)


def _sags(axes: Axes, sags: Extremes) -> None:
    """Draw the largest sag of each span over load cases as bars, with values and governing cases."""
    most = max((one.value for _, one in sags), default=1.0)
    for row, (case, one) in enumerate(sags):
        axes.barh(row, one.value, 0.6, color=COLORS[2])
        axes.text(one.value + 0.01 * most, row, f"{rounded(one.value)}  {case}", va="center", fontsize=8, color=INK)
    names = [one.name.replace("sag below the chord, ", "").removesuffix("sag below the chord") for _, one in sags]
    _label(axes, names, "largest sag below the chord [m]", most, low=0.0)


def _label(axes: Axes, names: Sequence[str], label: str, most: float, *, low: float) -> None:
    axes.set_yticks(range(len(names)), names, fontsize=8.5)
    axes.set(xlabel=label, ylim=(len(names) - 0.4, -0.6), xlim=(low * most, 1.35 * most))
    axes.set_xticks([tick for tick in axes.get_xticks() if 0.0 <= tick <= 1.05 * most])
    axes.grid(visible=False, axis="y")
