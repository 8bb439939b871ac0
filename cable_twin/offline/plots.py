"""Plots of one run, or of several runs overlaid, and of verdicts on them: rope, tension, speed, swing, forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl

mpl.use("Agg")  # no screen needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from cable_twin.frame.plotted_signals import LEAST, PLOTS, SIGNALS, SPREAD, Signal
from cable_twin.frame.snapshot import ENDS
from cable_twin.key_figures.rules import RuleVerdict
from cable_twin.key_figures.rules.comparison import topic_of
from cable_twin.key_figures.rules.verdicts import BROKEN, KEPT, OUTSIDE, limit_text, value_text
from cable_twin.offline.thinned_series import Signals

INK = "#22303C"
QUIET = "#7B8794"
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # apart for colour-blind eyes too
MANY = 6  # lines of a run in a panel, above which they are a band with its highest and its lowest line
POINTS = 800  # of a band
EXTREMES: dict[str, Callable[..., str]] = {"highest": max, "lowest": min}  # lines of a band that are drawn
DASHES: tuple[tuple[float, ...], ...] = ((), (4.0, 1.6), (1.0, 1.0), (6.0, 1.2, 1.0, 1.2))  # of runs, or lines
STYLE = {
    "text.parse_math": False,  # names of scenarios and files are no formulas
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.titlelocation": "left",
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E8EC",
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.3,
    "savefig.dpi": 130,
}
ASIDE = 0.01  # m across the track, from which on a rope is drawn from above
MOST_USED = 1.6  # share of a limit at which the bars of verdicts end
MOST_COLUMNS = 5  # of the legend of a plot over time
LONG_NAME = 60  # letters of the name of a run, of which two do not fit beside each other
MARGIN = 1.2  # inches beside such a legend, for the names of the vertical axis
LEGENDS = 0.3  # inches, height of a legend for which panels have room
HEIGHT, WIDTH = 0.34, 11.0  # inches, of such a bar and of its picture
SCALED = ("N", "W", "N m")  # units that may get a prefix


def styled() -> AbstractContextManager[None]:
    """Context in which all pictures of the commands have the same fonts, colours and axes."""
    return mpl.rc_context(STYLE)  # type: ignore[arg-type]  # matplotlib lists every key


def save(figure: Figure, title: str, path: Path) -> None:
    """Write a figure with a title above its axes into a file, and close it.

    Raises:
        OSError: the file cannot be written.
    """
    figure.suptitle(title, x=0.012, ha="left", fontweight="bold", fontsize=13.0)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.99))
    figure.savefig(path)
    plt.close(figure)


@dataclass(frozen=True, slots=True)
class PlottedRun:
    """Run to be plotted: label in legends, names of scenario and run, signals."""

    label: str  # in legends of several runs: name by `--output`, or a, b, ...; empty for one run
    scenario: str
    run: str
    signals: Signals


class Panel(NamedTuple):
    """Panel of a plot over time, with the lines of one signal of one or more runs."""

    signal: Signal
    label: str  # without unit
    lines: Sequence[tuple[int, str]]  # numbers of runs, and names of lines


def write_plots(
    runs: Sequence[PlottedRun], directory: Path, on_file: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write all plots of one run, or of several runs overlaid, into a directory.

    Args:
        runs: One run, or several to lay over each other.
        directory: Made where it does not exist.
        on_file: Called with each file before it is drawn.

    Returns:
        The files; a plot without a number in it, or of zeros alone, is left out.

    Raises:
        OSError: A file cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    with styled():
        for name, title in PLOTS.items():
            shown = [panel for signal in SIGNALS.values() if signal.plot == name for panel in _panels(runs, signal)]
            if shown:
                written.append(_write(partial(_time_plot, runs, title, shown), directory / f"{name}.png", on_file))
        if all(run.signals.shapes() for run in runs):
            written.append(_write(partial(_rope_plot, runs), directory / "rope.png", on_file))
    return written


def _write(draw: Callable[[], Figure], file: Path, on_file: Callable[[Path], None] | None) -> Path:
    if on_file is not None:
        on_file(file)
    figure = draw()
    figure.savefig(file)
    plt.close(figure)
    return file


def _lines(runs: Sequence[PlottedRun], signal: Signal) -> list[tuple[int, str]]:
    """Run index and name of each line to plot for a signal; of several runs only each vehicle's last body."""
    lines = []
    for index, run in enumerate(runs):
        names = [
            name
            for name, series in run.signals.series.items()
            if name.partition("/")[0] == signal.name and np.isfinite(series.line()[1]).any()
        ]
        if len(runs) > 1 and signal.whose == "bodies":
            names = list({name.split("/")[1]: name for name in names}.values())
        lines += [(index, name) for name in names]
    return lines


def _panels(runs: Sequence[PlottedRun], signal: Signal) -> list[Panel]:
    """Plot panels of a signal: one, or two for supports, as loads on rope ends and on towers differ in size.

    None if all values are 0, or if there are too many lines of a signal whose range tells nothing.
    """
    if signal.beside:
        return []
    lines = _lines(runs, signal)
    many = signal.name in SPREAD and len({name for _, name in lines}) > MANY
    if lines:
        lines += [line for other in SIGNALS.values() if other.beside == signal.name for line in _lines(runs, other)]
    if many or all(signal.is_zero(runs[index].signals.series[name].line()[1]) for index, name in lines):
        return []
    if signal.whose != "supports":
        return [Panel(signal, signal.label, lines)] if lines else []
    at_ends = [line for line in lines if line[1].rpartition("/")[2] in ENDS]  # "load/start", or "load/up/start"
    at_towers = [line for line in lines if line not in at_ends]
    kinds = ((signal.label, at_ends), (signal.label.replace("support", "tower"), at_towers))
    return [Panel(signal, label, some) for label, some in kinds if some]


def _title(figure: Figure, runs: Sequence[PlottedRun], title: str, right: float = 1.0) -> None:
    """Write title and names of runs, two in a row unless long, above a plot; axes fill the rest, up to `right`."""
    figure.suptitle(title, x=0.012, ha="left", fontweight="bold", fontsize=13.0)
    names = [f"{run.label}: {run.scenario}, {run.run}" if run.label else f"{run.scenario}, {run.run}" for run in runs]
    beside = 2 if max(map(len, names)) < LONG_NAME else 1
    rows = ["     ".join(names[first : first + beside]) for first in range(0, len(names), beside)]
    figure.text(0.012, 1.0 - 0.5 / figure.get_figheight(), "\n".join(rows), color=QUIET, va="top", fontsize=9.0)
    top = 0.2 + 0.18 * (len(rows) - 1)  # inches
    figure.tight_layout(rect=(0.0, 0.0, right, 1.0 - top / figure.get_figheight()))


def _time_plot(runs: Sequence[PlottedRun], title: str, panels: Sequence[Panel]) -> Figure:
    """Plot panels of one quantity each above a common time axis."""
    height = 3.4 if len(panels) == 1 else 2.6 * len(panels)
    figure, rows = plt.subplots(len(panels), 1, figsize=(10.0, height + 0.9), sharex=True, squeeze=False)
    for axes, panel in zip(rows[:, 0], panels, strict=True):
        _panel(axes, runs, panel)
    legends = [legend for axes in rows[:, 0] if (legend := axes.get_legend()) is not None]
    taken = sum(legend.get_window_extent().height for legend in legends) / figure.dpi
    figure.set_figheight(height + 0.9 + max(taken - LEGENDS * len(legends), 0.0))
    rows[-1, 0].set_xlabel(f"simulated time [s], {_sampling_rate(runs, panels)} values a second")
    _title(figure, runs, title)
    return figure


def _sampling_rate(runs: Sequence[PlottedRun], panels: Sequence[Panel]) -> str:
    """Sampling rate of the lines of a plot as a text, in values a second, as "10" or "10 to 50"; "0" of single values.

    Peaks between samples are in key figures, and not in the plot.
    """
    lines = [runs[index].signals.series[name].line()[0] for panel in panels for index, name in panel.lines]
    each = [1.0 / float(np.median(np.diff(np.unique(times)))) for times in lines if np.unique(times).size > 1]
    return " to ".join(dict.fromkeys(f"{one:.3g}" for one in (min(each), max(each)))) if each else "0"


def _panel(axes: Axes, runs: Sequence[PlottedRun], panel: Panel) -> None:
    """Draw all lines of one panel of a plot over time."""
    signal, label, lines = panel
    names = list(dict.fromkeys(name for _, name in lines))
    lone = len({name.split("/")[1] for name in names}) == 1 and all(name.count("/") == 2 for name in names)
    many = len(names) > MANY
    if many:
        _bands(axes, runs, lines)
    for index, name in () if many else lines:
        times, values = runs[index].signals.series[name].line()
        other = SIGNALS[name.partition("/")[0]]
        whose = other.words(name.partition("/")[2])
        whose = name.split("/", 2)[2] if lone else whose
        whose += f" {other.label}" if other.beside else ""
        color, dashes = _look(names.index(name), len(names), index, len(runs))
        legend = f"{runs[index].label}: {whose}" if runs[index].label else whose
        axes.plot(times, values, color=color, dashes=dashes, label=legend, zorder=1.9 if other.beside else 2.0)
    largest = max(abs(value) for value in axes.get_ylim())
    scale, prefix = 1.0, ""
    if signal.unit in SCALED:
        scale, prefix = next(((s, p) for s, p in ((1e6, "M"), (1e3, "k")) if largest >= s), (1.0, ""))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / scale:g}"))
    axes.set_ylabel(f"{label} [{prefix}{signal.unit}]")
    low, high = axes.get_ylim()
    if high - low < max(1e-6 * max(abs(low), abs(high)), LEAST.get(signal.unit, 1e-9)):  # rounding alone is no signal
        axes.set_ylim(low - 0.05 * max(abs(low), 1.0), high + 0.05 * max(abs(high), 1.0))
    axes.margins(x=0.01)
    if len(lines) > 1:
        legend_above(axes, MOST_COLUMNS)


def legend_above(axes: Axes, most: int) -> None:
    """Write the legend above the axes, in as many columns, at most `most`, as fit beside each other in the figure."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    room = figure.bbox.width - MARGIN * figure.dpi
    for columns in range(min(len(axes.get_legend_handles_labels()[0]), most), 0, -1):
        legend = axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.0)
        if legend.get_window_extent().width <= room:
            return


def _bands(axes: Axes, runs: Sequence[PlottedRun], lines: Sequence[tuple[int, str]]) -> None:
    """Draw many lines of each run as the band of their range over time, with the lines that reach its extremes."""
    for number in dict.fromkeys(index for index, _ in lines):
        names = [name for index, name in lines if index == number]
        series = {name: runs[number].signals.series[name].line() for name in names}
        begin, end = (pick([float(pick(times)) for times, _ in series.values()]) for pick in (min, max))
        times = np.linspace(begin, end, POINTS)
        values = np.array([np.interp(times, *line, left=np.nan, right=np.nan) for line in series.values()])
        seen = np.isfinite(values).any(axis=0)
        low, high = np.fmin.reduce(values[:, seen], axis=0), np.fmax.reduce(values[:, seen], axis=0)
        whose = f"{runs[number].label}: " if runs[number].label else ""
        color = COLORS[(2 * number) % len(COLORS)]
        every = f"{whose}all {len(names)}"
        axes.fill_between(times[seen], low, high, color=color, alpha=0.18, linewidth=0, label=every)
        for dashes, (word, pick) in zip(DASHES, EXTREMES.items(), strict=False):
            reached = {name: _reach(line[1], word) for name, line in series.items()}
            name = pick(reached, key=reached.__getitem__)
            quantity, _, line = name.partition("/")
            label = f"{whose}{SIGNALS[quantity].words(line)}, {word}"
            axes.plot(*series[name], color=color, dashes=dashes, label=label, linewidth=1.0)


def _reach(values: np.ndarray, word: str) -> float:
    """Highest or lowest of values over time, ignoring NaN; if all are NaN, -inf for the highest, inf for the lowest."""
    extreme = np.fmax.reduce(values) if word == "highest" else np.fmin.reduce(values)
    return float(extreme) if np.isfinite(extreme) else (-np.inf if word == "highest" else np.inf)


def _look(line: int, lines: int, run: int, runs: int) -> tuple[Any, tuple[float, ...]]:
    """Colour and dash pattern of a plotted line, by the index of its run and its index within the run."""
    if runs > 2:  # a colour a run
        few = runs <= len(COLORS)
        color: Any = COLORS[run] if few else plt.get_cmap("viridis")(run / (runs - 1))
        return color, DASHES[line % len(DASHES)]
    return COLORS[(line + (3 * run if lines <= 3 else 0)) % len(COLORS)], DASHES[run]


def _rope_plot(runs: Sequence[PlottedRun]) -> Figure:
    """Plot rope shapes of runs at several times, coloured by time: height, height above chord, lateral place if any."""
    shapes = [run.signals.shapes() for run in runs]
    rows: list[tuple[str, Callable[[np.ndarray, np.ndarray], np.ndarray]]] = [
        ("z, height [m]", lambda points, _: points[:, 2]),
        ("z above the chord [m]", _height),
    ]
    if max(_aside(shape.positions) for several in shapes for shape in several) > ASIDE:
        rows.append(("y, to the left [m]", lambda points, _: points[:, 1]))
    width = 10.0 if len(runs) == 1 else max(14.0, 4.5 * len(runs))
    size = (width, 3.3 * len(rows))
    figure, grid = plt.subplots(len(rows), len(runs), figsize=size, sharex="col", sharey="row", squeeze=False)
    norm = Normalize(0.0, max(several[-1].time for several in shapes) or 1.0)
    for column, (run, several) in enumerate(zip(runs, shapes, strict=True)):
        colors = plt.get_cmap("viridis")(norm([shape.time for shape in several]))
        for axes, (_, seen) in zip(grid[:, column], rows, strict=True):
            lines = [
                np.column_stack([shape.positions[:, 0], seen(shape.positions, shape.positions)]) for shape in several
            ]
            axes.add_collection(LineCollection(lines, colors=colors, linewidths=1.0))
            axes.autoscale_view()
            for shape, color in zip(several, colors, strict=True):
                joints = np.array(list(shape.carriages.values())).reshape(-1, 3)
                dots = 4.0 if len(joints) <= MANY else 2.0
                axes.plot(joints[:, 0], seen(joints, shape.positions), "o", color=color, markersize=dots)
        grid[-1, column].set_xlabel("x, along the track [m]")
        if run.label:
            grid[0, column].set_title(run.label)
    for axes, (label, _) in zip(grid[:, 0], rows, strict=True):
        axes.set_ylabel(label)
    _title(figure, runs, "Rope over time, with the places of the carriages", right=0.9)
    bar = figure.add_axes((0.915, 0.12, 0.015, 0.7))
    figure.colorbar(ScalarMappable(norm, "viridis"), cax=bar, label="simulated time [s]")
    return figure


def _aside(rope: np.ndarray) -> float:
    """Largest lateral extent (m) of a rope, or of several ropes in one array with NaN between them."""
    parts = np.split(rope[:, 1], np.flatnonzero(np.isnan(rope[:, 0])))
    return max(float(np.nanmax(part) - np.nanmin(part)) for part in parts if not np.isnan(part).all())


def _height(points: np.ndarray, rope: np.ndarray) -> np.ndarray:
    """Height (m) of points (n, 3) above the chord of the first rope; if that chord is vertical, above its start."""
    rope = rope[: int(np.append(np.isnan(rope[:, 0]), True).argmax())]
    chord = rope[-1] - rope[0]
    slope = chord[2] / chord[0] if chord[0] else 0.0
    height: np.ndarray = points[:, 2] - rope[0, 2] - slope * (points[:, 0] - rope[0, 0])
    return height


def used_share(one: RuleVerdict) -> float:
    """Utilisation of the limit of a rule verdict by its figure, at most `MOST_USED`; above 1 the limit is not kept."""
    assert one.value is not None
    low, high, value = one.limits[0], one.limits[-1], one.value
    above = abs(value / high) if high else float(value > 0.0)
    below = abs(low / value) if value else float(low > 0.0) * MOST_USED
    shares = {"at most": above, "below": above, "at least": below, "above": below, "within": max(above, below)}
    return min(shares[one.comparison], MOST_USED)


def write_verdict_plot(title: str, verdicts: Sequence[RuleVerdict], path: Path) -> bool:
    """Draw rule verdicts that have a figure and a limit as bars into a file; returns whether there are any.

    Args:
        title: of the picture.
        verdicts: of all profiles.
        path: file of the picture.

    Raises:
        OSError: the file cannot be written.
    """
    shown = [one for one in verdicts if one.limits and one.value is not None and one.state != OUTSIDE]
    if not shown:
        return False
    profiles = list(dict.fromkeys(one.profile for one in shown))
    topics = list(dict.fromkeys(topic_of(one.quantity) for one in shown))
    shown.sort(key=lambda one: (topics.index(topic_of(one.quantity)), profiles.index(one.profile)))
    with styled():
        figure, axes = plt.subplots(figsize=(WIDTH, HEIGHT * len(shown) + 1.5))
        for row, one in enumerate(shown):
            share, color = used_share(one), COLORS[profiles.index(one.profile) % len(COLORS)]
            solid = one.state == KEPT or one.state in BROKEN
            face = color if solid else "white"
            axes.barh(row, share, 0.62, color=face, edgecolor=color, hatch="" if solid else "////", linewidth=0.8)
            text = f"{value_text(one)}, {limit_text(one)}: {one.state}"
            weight = "bold" if one.state in BROKEN else "normal"
            axes.text(max(share, 1.0) + 0.03, row, text, va="center", fontsize=8.5, color=INK, fontweight=weight)
        axes.axvline(1.0, color=INK, linewidth=1.2)
        labels = [f"{one.text[:66]}  {one.check}, {one.clause}" for one in shown]
        axes.set_yticks(range(len(shown)), labels, fontsize=8.5)
        axes.set(xlim=(0.0, 3.0), ylim=(len(shown) - 0.4, -0.6), xlabel="used share of the limit")
        axes.xaxis.label.set(x=0.165)
        axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0])
        axes.grid(visible=False, axis="y")
        for row, (one, after) in enumerate(pairwise(shown)):
            if topic_of(one.quantity) != topic_of(after.quantity):
                axes.axhline(row + 0.5, color=QUIET, linewidth=0.4)
        patches = [Patch(color=color, label=name) for color, name in zip(COLORS, profiles, strict=False)]
        patches.append(Patch(facecolor="white", edgecolor=QUIET, hatch="////", label="not decided"))
        axes.legend(handles=patches, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(patches), borderaxespad=0.2)
        save(figure, title, path)
    return True
