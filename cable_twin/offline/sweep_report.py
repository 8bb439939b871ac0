"""A sweep for people and for other programs: tables, the operating limit, CSV and JSON."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TextIO

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cable_twin.offline.export import STDOUT, figure_columns
from cable_twin.offline.figure_table import shown, shown_unit
from cable_twin.offline.sweep_limits import OperatingLimit, SweptFigure
from cable_twin.offline.sweep_runs import SweptRun

COLUMN = 17  # characters of a column of the table
MOST_COLUMNS = 9


def print_sweep(console: Console, title: str, runs: Sequence[SweptRun], figures: Sequence[SweptFigure]) -> None:
    """Print a row for each value with the figures that come nearest to their limits, and where limits are passed."""
    room = min(max((console.width - 14) // COLUMN, 2), MOST_COLUMNS)
    nearest = figures[:room]
    table = Table(escape(title), box=box.SIMPLE_HEAD, pad_edge=False)
    scales = []
    for figure in nearest:
        unit, scale = _unit_of(figure)
        scales.append(scale)
        head = f"{figure.name}\n[dim]{_bound(figure, scale)}[/]"
        table.add_column(f"{head} [dim]{'' if unit == '-' else unit}[/]", justify="right", max_width=COLUMN)
    for number, run in enumerate(runs):
        cells = [_cell(figure, number, scale) for figure, scale in zip(nearest, scales, strict=True)]
        table.add_row(f"{run.value:g}", *cells)
    console.print(table)
    passed = [(figure, figure.passed_at) for figure in figures if figure.passed_at is not None]
    lines = ["* the limit is not kept"] if passed else []
    if len(figures) > room:
        lines.append(f"{len(figures) - room} more figures with limits are farther from them; --csv and --json have all")
    if lines:
        console.print("\n".join(f"  {line}" for line in lines), markup=False)
    if not passed:
        return
    rising = runs[-1].value >= runs[0].value
    below = Table("passes its limit", "", escape(title), "limit", "source", box=box.SIMPLE_HEAD, pad_edge=False)
    for figure, value in sorted(passed, key=lambda item: item[1] if rising else -item[1]):
        unit, scale = _unit_of(figure)
        limit = f"{_bound(figure, scale)} {'' if unit == '-' else unit}".strip()
        below.add_row(figure.name, "from" if value == runs[0].value else "at", f"{value:.4g}", limit, figure.source)
    console.print(below)


def _unit_of(figure: SweptFigure) -> tuple[str, float]:
    sizes = [abs(one.value) for one in figure.figures if one is not None]
    return shown_unit(figure.unit, max([*sizes, abs(figure.limit)]))


def _bound(figure: SweptFigure, scale: float) -> str:
    return f"{figure.bound} {figure.limit * scale:.4g}"


def _cell(figure: SweptFigure, number: int, scale: float) -> str:
    one = figure.figures[number]
    if one is None:
        return ""
    text = shown(one.value, scale)
    return f"[bold red]{text} *[/]" if one.kept is False else text


def limit_line(key: str, unit: str, runs: Sequence[SweptRun], limit: OperatingLimit | None) -> str:
    """The operating limit in one line."""
    unit = "" if unit in ("", "-") else f" {unit}"
    first, last = runs[0].value, runs[-1].value
    if limit is None:
        return f"operating limit of {key}: none from {first:g} to {last:g}{unit}, all limits are kept"
    figure = limit.figure
    scaled, scale = _unit_of(figure)
    what = f"{figure.name}, {_bound(figure, scale)} {'' if scaled == '-' else scaled}".rstrip()
    if limit.value == first:
        return f"operating limit of {key}: below {first:g}{unit}, the first value: {what}"
    return f"operating limit of {key}: {limit.value:.4g}{unit}: {what}"


def write_csv(path: str, key: str, runs: Sequence[SweptRun]) -> None:
    """Write all key figures of all runs, a row each.

    Raises:
        OSError: it cannot be written.
    """
    with _opened(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        head = False
        for run in runs:
            for figure in run.figures:
                row = figure_columns(figure)
                if not head:
                    writer.writerow([key, *row])
                    head = True
                writer.writerow([run.value, *row.values()])


def write_json(path: str, sweep: dict[str, Any], runs: Sequence[SweptRun], limit: OperatingLimit | None) -> None:
    """Write the sweep, all key figures of its runs and the operating limit.

    Raises:
        OSError: it cannot be written.
    """
    found = [
        {"value": run.value, "fault": run.fault or None, "key_figures": [figure_columns(one) for one in run.figures]}
        for run in runs
    ]
    operating = None if limit is None else {"value": limit.value, "key_figure": limit.figure.name}
    with _opened(path) as file:
        json.dump({"sweep": sweep, "operating_limit": operating, "runs": found}, file, indent=1, allow_nan=False)
        file.write("\n")


def _opened(path: str) -> Any:
    if path == STDOUT:
        stream: TextIO = sys.stdout
        return nullcontext(stream)
    return Path(path).open("w", encoding="utf-8", newline="")


__all__ = ["limit_line", "print_sweep", "write_csv", "write_json"]
