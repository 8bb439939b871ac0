"""Report of a sweep: tables, windows with all limits kept, CSV and JSON."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Collection, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.key_figures.shown import shown
from cable_twin.offline.export import figure_columns, opened
from cable_twin.offline.figure_table import print_notes
from cable_twin.offline.sweep_limits import Edge, SweptFigure, SweptRun, Window, keeps_all

COLUMN = 17  # characters of a column of the table
MOST_COLUMNS = 9
DIGITS = 5  # of a swept value


def print_sweep(
    console: Console, title: str, runs: Sequence[SweptRun], figures: Sequence[SweptFigure], rows: Collection[float]
) -> None:
    """Print a sweep: for each value in `rows` a row of the first figures beyond a limit, then ranges of these."""
    room = min(max((console.width - 14) // COLUMN, 2), MOST_COLUMNS)
    shown_figures = figures[:room]
    table = Table(escape(_on_lines(title)), box=box.SIMPLE_HEAD, pad_edge=False)
    scales = []
    for figure in shown_figures:
        unit, scale = _unit_of(figure)
        scales.append(scale)
        head = f"{figure.name}\n[dim]{_bound(figure, scale)}[/]"
        table.add_column(f"{head} [dim]{'' if unit == '-' else unit}[/]", justify="right", max_width=COLUMN)
    for place, run in enumerate(runs):
        if run.value in rows:
            cells = [_cell(figure, place, scale) for figure, scale in zip(shown_figures, scales, strict=True)]
            table.add_row(rounded(run.value, DIGITS), *cells)
    console.print(table)
    passed = [figure for figure in figures if figure.passed_at is not None]
    lines = ["* limit not kept"] if passed else []
    if len(figures) > room:
        lines.append(f"{len(figures) - room} more figures have limits; --csv and --json contain all")
    if lines:
        console.print("\n".join(f"  {line}" for line in lines), markup=False)
    if not passed:
        return
    below = Table("limit not kept", escape(_on_lines(title)), "limit", box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("worst", "at"):
        below.add_column(head, justify="right")
    sources = list(dict.fromkeys(figure.source for figure in passed if figure.source))
    for figure in passed:
        unit, scale = _unit_of(figure)
        where, worst = figure.worst
        note = f"({sources.index(figure.source) + 1})" if figure.source else ""
        limit = " ".join(filter(None, (_bound(figure, scale), "" if unit == "-" else unit, note)))
        stretches = "; ".join(map(_stretch, figure.passed()))
        below.add_row(figure.name, stretches, limit, shown(worst.value, scale), rounded(where))
    console.print(below)
    print_notes(console, sources)


def _on_lines(title: str) -> str:
    """Break the dotted key and unit of a sweep into lines that fit a column of its table."""
    lines = [""]
    for part in title.replace(".", ".\n").replace(" [", "\n [").split("\n"):
        if len(lines[-1] + part) > COLUMN and lines[-1]:
            lines.append("")
        lines[-1] += part
    return "\n".join(line.strip() for line in lines)


def _stretch(stretch: tuple[float, float]) -> str:
    low, high = (rounded(value) if math.isfinite(value) else "" for value in stretch)
    return f"{low} to {high}" if low and high else f"above {low}" if low else f"below {high}" if high else "throughout"


def _unit_of(figure: SweptFigure) -> tuple[str, float]:
    sizes = [abs(one.value) for one in figure.figures if one is not None]
    return shown_unit(figure.unit, max([*sizes, *map(abs, figure.limits)]))


def _bound(figure: SweptFigure, scale: float) -> str:
    least, most = (rounded(limit * scale) for limit in figure.limits)
    return f"{figure.bound} {least}" if least == most else f"{figure.bound} {least} to {most}"


def _cell(figure: SweptFigure, place: int, scale: float) -> str:
    one = figure.figures[place]
    if one is None:
        return ""
    text = shown(one.value, scale)
    return f"[bold red]{text} *[/]" if one.kept is False else text


def window_lines(
    key: str, unit: str, runs: Sequence[SweptRun], figures: Sequence[SweptFigure], windows: Sequence[Window]
) -> list[str]:
    """Lines about the windows of a sweep with all limits kept, and the limits at their ends."""
    unit = "" if unit in ("", "-") else f" {unit}"
    first, last = runs[0].value, runs[-1].value
    if not windows:
        here = [figure for figure in figures if figure.passed_at is not None]
        worst = (
            f": {_limit(here[0])}, and {len(here) - 1} more"
            if len(here) > 1
            else f": {_limit(here[0])}"
            if here
            else ""
        )
        return [f"{key}: no value from {rounded(first)} to {rounded(last)}{unit} keeps all limits{worst}"]
    found = []
    for window in windows:
        near, far = sorted((window.low, window.high), key=lambda one: abs(one.value - first))
        if near.value == first and far.figure is not None:
            found.append(f"operating limit of {key}: {rounded(far.value)}{unit}: {_limit(far.figure)}")
        elif {near.value, far.value} == {first, last}:
            found.append(
                f"operating limit of {key}: none from {rounded(first)} to {rounded(last)}{unit}, all limits are kept"
            )
        else:
            ends = [
                f"{side}, {_limit(one.figure)}"
                for side, one in (("below", window.low), ("above", window.high))
                if one.figure is not None
            ]
            found.append(
                f"{key}: all limits are kept from {rounded(window.low.value)} to {rounded(window.high.value)}{unit}; "
                + "; ".join(ends)
            )
    return found


def _limit(figure: SweptFigure) -> str:
    unit, scale = _unit_of(figure)
    return f"{figure.name}, {_bound(figure, scale)} {'' if unit == '-' else unit}".rstrip()


def write_csv(path: str, key: str, runs: Sequence[SweptRun]) -> None:
    """Write all key figures of all runs of a sweep as CSV, a row for each.

    Raises:
        OSError: the file cannot be written.
    """
    with opened(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        head = False
        for run in runs:
            for figure in run.figures:
                row = figure_columns(figure)
                if not head:
                    writer.writerow([key, *row])
                    head = True
                writer.writerow([run.value, *row.values()])


def write_json(path: str, sweep: dict[str, Any], runs: Sequence[SweptRun], windows: Sequence[Window]) -> None:
    """Write a sweep as JSON: key figures of all runs, operating limit, and windows with all limits kept.

    Raises:
        OSError: the file cannot be written.
    """
    found = [
        {"value": run.value, "fault": run.fault or None, "key_figures": [figure_columns(one) for one in run.figures]}
        for run in runs
    ]
    stretches = [{"low": _edge(window.low), "high": _edge(window.high)} for window in windows]
    operating = None  # end of the window in which the sweep begins
    if windows and keeps_all(runs[0]):
        far = windows[0].high if runs[-1].value >= runs[0].value else windows[0].low
        operating = _edge(far) if far.figure is not None else None
    with opened(path) as file:
        content = {"sweep": sweep, "operating_limit": operating, "windows": stretches, "runs": found}
        json.dump(content, file, indent=1, allow_nan=False)
        file.write("\n")


def _edge(one: Edge) -> dict[str, Any]:
    name, key = (None, None) if one.figure is None else (one.figure.name, str(one.figure.id))
    return {"value": one.value, "key_figure": name, "id": key}
