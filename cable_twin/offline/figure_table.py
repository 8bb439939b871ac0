"""Printed table of key figures, of one run or of several runs side by side."""

from __future__ import annotations

import string
import sys
from collections import Counter
from collections.abc import Sequence
from textwrap import fill

from rich import box
from rich.console import Console
from rich.table import Table

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.key_figures import KeyFigure
from cable_twin.key_figures.shown import digits_of, shown

WIDE = 140  # characters that a table with limits, times and places needs
LABELS = string.ascii_lowercase  # of runs beside each other


def table_console() -> Console:
    """Console for printed tables, with a fixed width where output is no terminal."""
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def print_figures(
    console: Console, figures: Sequence[Sequence[KeyFigure]], *, at: str = "at", unit_at: str = "s", ended: str = ""
) -> None:
    """Print a table of key figures with a column for each run; time and place only for a single run.

    `at` and `unit_at` are name and unit of the `time` of a figure, which is a place for a line at rest; `ended` is
    the time, with its unit, of a run that ended early. On a narrow terminal limit, time and place go to a line below.
    """
    wide = console.width >= WIDE
    runs = [{figure.id: figure for figure in run} for run in figures]
    lone = len(runs) == 1
    table = Table("key figure", box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("value",) if lone else LABELS[: len(runs)]:
        table.add_column(title, justify="right", no_wrap=True)
    for title in ("unit", *(("limit",) if wide else ()), "", *((at, "where") if lone and wide else ())):
        table.add_column(title, justify="right" if title in ("limit", at) else "left", no_wrap=title != "where")
    every = [figure for run in runs for figure in run.values()]
    usual = Counter(figure.band for figure in every).most_common(1)[0][0] if every else ""
    notes = list(dict.fromkeys(figure.source for figure in every if figure.source))
    notes += list(dict.fromkeys(figure.band for figure in every if figure.band not in ("", usual)))
    for key in dict.fromkeys(key for run in runs for key in run):
        found = [run.get(key) for run in runs]
        present = [figure for figure in found if figure is not None]
        name = present[0].name
        sizes = [abs(number) for figure in present for number in (figure.value, figure.limit) if number is not None]
        unit, scale = shown_unit(present[0].unit, max(sizes))
        digits = max(digits_of(figure, scale) for figure in present)
        values = ["" if figure is None else _value(figure, scale, digits, so_far=not lone) for figure in found]
        limits = dict.fromkeys(_limit(figure, scale, notes, digits) for figure in present)
        if present[0].band in notes:
            unit = f"{unit} ({notes.index(present[0].band) + 1})"
        when = f"{present[0].time:.2f} {unit_at}"
        when = when if wide or at == "at" else f"{at} {when}"
        where = [when, present[0].place] if lone else []
        limit = "; ".join(limits)
        if wide:
            table.add_row(name, *values, unit, limit, _verdict(found, scale), *where)
        else:
            below = ", ".join(filter(None, (limit, *where)))
            table.add_row(f"{name}\n  [dim]{below}[/]" if below else name, *values, unit, _verdict(found, scale))
    console.print(table)
    usually = f"highest and lowest values are those of {usual}, unless a note beside the unit says otherwise"
    print_notes(console, notes, usually if usual else "")
    console.print()
    for line in verdict_lines(figures, at, unit_at, ended):
        style = "bold red" if line.endswith(" not kept:") else None
        wrapped = fill(line, console.width, subsequent_indent="    ")
        console.print(wrapped, markup=False, soft_wrap=True, style=style)


def _value(figure: KeyFigure, scale: float, digits: int, *, so_far: bool) -> str:
    """Printed value of a key figure; `so_far` marks one that still grew, where no column says its place."""
    return shown(figure.value, scale, digits) + (" so far" if so_far and figure.unfinished else "")


def print_notes(console: Console, notes: Sequence[str], last: str = "") -> None:
    """Print the numbered notes below a table, and a last note without a number."""
    told = [f"({number}) {note}" for number, note in enumerate(notes, start=1)] + ([last] if last else [])
    for line in told:
        below = " " * (6 if line.startswith("(") else 2)
        filled = fill(line, console.width, initial_indent="  ", subsequent_indent=below)
        console.print(filled, markup=False, soft_wrap=True)


def verdict_lines(
    figures: Sequence[Sequence[KeyFigure]], at: str = "at", unit_at: str = "s", ended: str = ""
) -> list[str]:
    """Summary lines of a table of key figures: limits that are not kept; arguments as in `print_figures`."""
    runs = [{figure.id: figure for figure in run if figure.limit is not None} for run in figures]
    ids = dict.fromkeys(key for run in runs for key in run)
    if not ids:
        return []
    lines = []
    for key in ids:
        found = [run.get(key) for run in runs]
        passed = [one for one in found if one is not None and one.verdict not in ("", "kept")]
        if passed:
            verdicts = dict.fromkeys(one.verdict for one in passed)
            labels = [label for label, one in zip(LABELS, found, strict=False) if one in passed]
            who = f" by {' and '.join(labels)}" if len(runs) > 1 else ""
            each = "; ".join(_passed(one, at, unit_at, brief=len(runs) > 1) for one in passed)
            lines.append(f"  {passed[0].name}: {' or '.join(verdicts)}{who}: {each}")
    if not lines:
        until = f" up to {ended}, where the run ended early" if ended else ""
        return [(f"all {len(ids)} limits are kept" if len(ids) > 1 else "the limit is kept") + until]
    return [f"{len(lines)} of {len(ids)} limits {'is' if len(lines) == 1 else 'are'} not kept:", *lines]


def _passed(figure: KeyFigure, at: str, unit_at: str, *, brief: bool) -> str:
    """Text about a key figure that does not keep its limit: value and limit, and unless `brief` also time and place."""
    assert figure.limit is not None
    unit, scale = shown_unit(figure.unit, max(abs(figure.value), abs(figure.limit)))
    unit = "" if unit == "-" else f" {unit}"
    digits = digits_of(figure, scale)
    text = f"{shown(figure.value, scale, digits)}{unit}, {figure.bound} {rounded(figure.limit * scale, digits)}{unit}"
    return text if brief else ", ".join(filter(None, (text, f"{at} {figure.time:.2f} {unit_at}", figure.place)))


def _uncertainty(figure: KeyFigure, scale: float) -> str:
    """Text of the uncertainty of a key figure, two digits; 0 within rounding error."""
    assert figure.uncertainty is not None
    return shown(figure.uncertainty, scale, 2)


def _limit(figure: KeyFigure, scale: float, sources: Sequence[str], digits: int) -> str:
    """Text of the limit of a key figure, with the number of the note about its source."""
    if figure.limit is None:
        return ""
    note = f" ({sources.index(figure.source) + 1})" if figure.source else ""
    return f"{figure.bound} {rounded(figure.limit * scale, digits)}{note}"


def _verdict(figures: Sequence[KeyFigure | None], scale: float) -> str:
    """Text of the verdict on a key figure of one or more runs: kept, or by which run not; uncertainty if any."""
    lone = figures[0] if len(figures) == 1 else None
    if lone is not None and lone.uncertainty is not None:
        word = f"[bold red]{lone.verdict}[/]" if lone.verdict == "not kept" else lone.verdict
        return ", ".join(filter(None, (word, f"± {_uncertainty(lone, scale)}")))
    kept = [figure.kept if figure is not None else None for figure in figures]
    if False not in kept:
        return "kept" if True in kept else ""
    broken = " and ".join(label for label, keeps in zip(LABELS, kept, strict=False) if keeps is False)
    return f"[bold red]not kept{f' by {broken}' if len(figures) > 1 else ''}[/]"
