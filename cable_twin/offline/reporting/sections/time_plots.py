"""Section of a report with plots over time; for many objects the range of all, with the lines of its extremes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_twin.basics.units import shown_unit
from cable_twin.frame.plotted_signals import PLOTS, SIGNALS, SPREAD, Signal
from cable_twin.frame.records import FloatArray
from cable_twin.offline.reporting.chart import LOOKS, Chart, span
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.texts import Texts
from cable_twin.offline.thinned_series import Signals

MANY = 6  # lines, above which they are drawn as a range
POINTS = 300  # intervals of a line, each with its lowest and highest value


def time_plots(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Over time: charts grouped by plot title; None without signals."""
    if results.signals is None or not results.signals.series:
        return None
    groups = []
    for plot, title in PLOTS.items():
        panels = [
            _panel(one, results.signals, texts) for one in SIGNALS.values() if one.plot == plot and not one.beside
        ]
        charts = [one.svg() for one in panels if one is not None]
        if charts:
            groups.append((texts(title), charts))
    return {"groups": groups}


def _panel(signal: Signal, signals: Signals, texts: Texts) -> Chart | None:
    """Chart of one signal over time, with other signals drawn in the same chart; None if nothing is to be drawn."""
    beside = [one for one in SIGNALS.values() if one.beside == signal.name]
    lines = {}
    for one in (signal, *beside):
        for name, series in signals.series.items():
            if name.startswith(f"{one.name}/"):
                whose = one.words(name.partition("/")[2], texts)
                lines[f"{whose} {texts(one.label)}" if one.beside else whose] = thinned(*series.line())
    if (signal.name in SPREAD and len(lines) > MANY) or all(signal.is_zero(values) for _, values in lines.values()):
        return None
    size = max(
        (float(np.nanmax(np.abs(values))) for _, values in lines.values() if np.isfinite(values).any()), default=0.0
    )
    unit, scale = shown_unit(signal.unit, size) if signal.unit != "rad" else (signal.unit, 1.0)
    lines = {name: (times, scale * values) for name, (times, values) in lines.items()}
    label = texts(signal.label)
    y = span([values for _, values in lines.values()])
    x = span([times for times, _ in lines.values()], margin=0.0)
    chart = Chart(label, x, y, (texts("time [s]"), f"{label} [{unit}]"), height=190.0)
    if len(lines) > MANY:
        _draw_range(chart, lines, texts)
    else:
        for number, (name, line) in enumerate(lines.items()):
            chart.line(*line, LOOKS[number % len(LOOKS)], name)
    return chart


def _draw_range(chart: Chart, lines: Mapping[str, tuple[FloatArray, FloatArray]], texts: Texts) -> None:
    """Draw the range of many lines over time, and the lines with the highest and the lowest value."""
    begin = min(float(times[0]) for times, _ in lines.values())
    end = max(float(times[-1]) for times, _ in lines.values())
    times = np.linspace(begin, end, 2 * POINTS)
    values = np.array([np.interp(times, *line, left=np.nan, right=np.nan) for line in lines.values()])
    low, high = np.fmin.reduce(values), np.fmax.reduce(values)
    chart.area(times, low, high)
    names = list(lines)
    top = int(np.argmax([_highest(one) for one in values]))
    bottom = int(np.argmin([_lowest(one) for one in values]))
    words = {top: [texts("highest")]}
    words.setdefault(bottom, []).append(texts("lowest"))
    for (index, reached), look in zip(words.items(), LOOKS, strict=False):
        chart.line(*lines[names[index]], look, f"{names[index]} ({', '.join(reached)} {texts('of')} {len(names)})")


def _highest(values: FloatArray) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else -np.inf


def _lowest(values: FloatArray) -> float:
    return float(np.nanmin(values)) if np.isfinite(values).any() else np.inf


def thinned(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thin a line over time to at most `POINTS` intervals, each with its lowest and highest value."""
    if times.size <= 2 * POINTS:
        return times, values
    found: list[tuple[float, float]] = []
    for part in np.array_split(np.arange(times.size), POINTS):
        seen = part[np.isfinite(values[part])]
        if not seen.size:
            found.append((float(times[part[0]]), float("nan")))
            continue
        both: Sequence[int] = sorted({int(seen[np.argmin(values[seen])]), int(seen[np.argmax(values[seen])])})
        found += [(float(times[one]), float(values[one])) for one in both]
    line = np.array(found)
    return line[:, 0], line[:, 1]
