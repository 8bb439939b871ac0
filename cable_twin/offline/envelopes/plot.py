"""Plot of an envelope of load cases: range of tower loads and largest sags, with the governing cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from cable_twin.basics.units import rounded
from cable_twin.key_figures import KeyFigure
from cable_twin.offline.plots import COLORS, save, styled

Extremes = Sequence[tuple[str, KeyFigure]]
HEIGHT, WIDTH = 0.3, 11.0  # inches, of a row and of the picture
LETTER = 0.075  # inches, mean width of a letter
MOST_ROOM = 0.8  # of the axis, for values and cases behind a bar


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
    loads = [[low[name], high[name]] for name in high if name.startswith("towers.") and name in low]
    sags = [[row] for row in extremes if row[1].id.quantity == "sag"]
    if not loads and not sags:
        return False
    with styled():
        panels = [(draw, rows) for draw, rows in ((_loads, loads), (_sags, sags)) if rows]
        counts = [len(rows) for _, rows in panels]
        size = WIDTH, HEIGHT * sum(counts) + 1.1 * len(panels)
        figure, axes = plt.subplots(len(panels), 1, figsize=size, height_ratios=counts, squeeze=False)
        for (draw, rows), one in zip(panels, axes[:, 0], strict=True):
            draw(one, rows)
        save(figure, title, path)
    return True


def _loads(axes: Axes, rows: Sequence[Extremes]) -> None:
    """Draw the range of the load of each tower over load cases as bars, with values and governing cases."""
    bars = [(_name(row[0]), [(case, one.value / 1e3) for case, one in row]) for row in rows]
    _bars(axes, bars, "load of the tower [kN]", COLORS[0])


def _sags(axes: Axes, rows: Sequence[Extremes]) -> None:
    """Draw the largest sag of each span over load cases as bars, with values and governing cases."""
    bars = [(_name(row[0]), [(case, one.value) for case, one in row]) for row in rows]
    _bars(axes, bars, "largest sag below the chord [m]", COLORS[2])


def _name(row: tuple[str, KeyFigure]) -> str:
    """Name of a tower or span from that of its key figure."""
    name, one = row[1].name, row[1]
    if one.id.quantity == "sag":
        return name.replace("sag below the chord, ", "").removesuffix("sag below the chord")
    return name.partition(": ")[0]


def _bars(axes: Axes, bars: Sequence[tuple[str, Sequence[tuple[str, float]]]], label: str, color: str) -> None:
    """Draw bars from the first value of each row, or 0, to its last one; values and cases stand behind the bars.

    Args:
        axes: to be drawn in.
        bars: name and governing cases with values of each row.
        label: of the horizontal axis.
        color: of the bars.
    """
    texts = [" to ".join(f"{rounded(value)} ({case})" for case, value in row) for _, row in bars]
    starts = [row[0][1] if len(row) > 1 else 0.0 for _, row in bars]
    low = min(0.0, *starts)
    inches = WIDTH - LETTER * max(len(name) for name, _ in bars) - 0.6  # of the axis
    room = [min(LETTER * (len(text) + 2) / inches, MOST_ROOM) for text in texts]
    most = max((row[-1][1] - low) / (1.0 - share) for (_, row), share in zip(bars, room, strict=True))
    for number, ((_, row), start, text) in enumerate(zip(bars, starts, texts, strict=True)):
        axes.barh(number, row[-1][1] - start, 0.6, left=start, color=color)
        axes.annotate(text, (row[-1][1], number), (4.0, 0.0), textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(range(len(bars)), [name for name, _ in bars], fontsize=8.5)
    axes.set(xlabel=label, ylim=(len(bars) - 0.4, -0.6), xlim=(low, low + most))
    axes.grid(visible=False, axis="y")
