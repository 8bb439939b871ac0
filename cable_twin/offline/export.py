"""Export of key figures and signals of runs as CSV and JSON, every frame, in SI units but angles of signals in deg.

Frames wait in a temporary file until the run ends, so that memory does not grow with a run.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stdout
from pathlib import Path
from typing import Any, TextIO

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import QUANTITIES, FigureId, KeyFigure
from cable_twin.key_figures.rules import RuleVerdict
from cable_twin.offline.verdict_table import COLUMNS, verdict_columns, verdict_rows
from cable_twin.terminal.command_line import tell

STDOUT = "-"
OTHERS = {".csv", ".json", ".parquet", ".xlsx", ".mcap", ".rrd", ".yaml", ".png"}  # of other files
FIGURES = "_key_figures"  # behind the name of the CSV file of the signals
VERDICTS = "_rules"  # the same, of verdicts of rule profiles
FIGURE_COLUMNS = (
    *("key_figure", "value", "unit", "time [s]", "place", "limit", "bound", "source", "kept", "band", "id"),
    *("uncertainty", "verdict"),
)


def opened(path: str) -> AbstractContextManager[TextIO]:
    """Text file to write for an option such as `--csv`; `-` is the standard output, which stays open.

    Raises:
        OSError: the file cannot be made.
    """
    return nullcontext(sys.stdout) if path == STDOUT else open(path, "w", encoding="utf-8", newline="")


class RunTable:
    """Table of the signals of one run, a row for each frame; `name` and `scenario` identify the run."""

    def __init__(self, name: str, scenario: str) -> None:
        self.name, self.scenario = name, scenario
        self.columns: list[str] = []
        self.figures: Sequence[KeyFigure] = ()
        self.verdicts: Sequence[RuleVerdict] = ()
        self.responses: dict[str, list[dict[str, Any]]] = {}  # of drives, by what they are
        self._lines = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed when nobody has it
        self._shown: list[tuple[str, list[int]]] = []  # signals and which of their values

    def take(self, snapshot: Snapshot) -> None:
        """Add a frame to the table of signals as a row; missing values are empty."""
        layout, c = snapshot.layout, snapshot.columns
        if not self.columns:
            self._lay_out(snapshot)
        row: list[float | None] = [snapshot.time]
        for name, places in self._shown:
            values = SIGNALS[name].values(layout, c)[places].tolist()
            row += [value if math.isfinite(value) else None for value in values]
        self._lines.write(json.dumps(row) + "\n")

    def rows(self) -> Iterator[list[float | None]]:
        """Rows of the table of signals, with a number or None for each column."""
        self._lines.seek(0)
        return map(json.loads, self._lines)

    def lines(self) -> Iterator[str]:
        """Rows of the table of signals, each as a line of JSON."""
        self._lines.seek(0)
        return (line.rstrip("\n") for line in self._lines)

    def _lay_out(self, first: Snapshot) -> None:
        """Define the columns of the table by the first frame, without those of optional signals that are NaN in it."""
        self.columns = ["time [s]"]
        for signal in SIGNALS.values():
            names, values = signal.names(first.layout), signal.values(first.layout, first.columns)
            places = [i for i in range(len(names)) if signal.everywhere or not math.isnan(values[i])]
            self.columns += [f"{signal.name}/{names[i]} [{signal.unit}]" for i in places]
            self._shown.append((signal.name, places))


class Export:
    """Writer of the files of the options `--csv` and `--json`: signals, key figures, verdicts of runs.

    Raises:
        OSError: A file cannot be made; before anything runs.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._tables: list[RunTable] = []
        self._csv: str | None = options.csv
        self._json: str | None = options.json
        for path in (self._csv, self._json):
            if path not in (None, STDOUT):
                Path(str(path)).touch()

    def add(self, name: str, scenario: str) -> RunTable | None:
        """Add a table of signals for one more run; None where no export is requested."""
        if self._csv is None and self._json is None:
            return None
        self._tables.append(RunTable(name, scenario))
        return self._tables[-1]

    def words(self) -> AbstractContextManager[Any]:
        """Context that redirects printed text to stderr where CSV or JSON goes to standard output."""
        return redirect_stdout(sys.stderr) if STDOUT in (self._csv, self._json) else nullcontext()

    def write(self, command: str) -> bool:
        """Write all tables and figures of the runs; on failure prints an error of `command` and returns False."""
        try:
            self._write_all()
        except BrokenPipeError:
            raise  # who reads the output has enough: `entry_points` ends without a word
        except OSError as error:
            tell(command, f"{error.filename or 'output'}: {error.strerror or error}")
            return False
        return True

    def _write_all(self) -> None:
        if self._csv is not None:
            self._write(self._csv, self._write_signals)
            if self._csv != STDOUT:
                path = Path(self._csv)
                self._write(str(path.with_name(f"{path.stem}{FIGURES}{path.suffix}")), self._write_figures)
                if any(table.verdicts for table in self._tables):
                    self._write(str(path.with_name(f"{path.stem}{VERDICTS}{path.suffix}")), self._write_verdicts)
        if self._json is not None:
            self._write(self._json, self._write_json)

    def _write(self, path: str, write: Callable[[TextIO], None]) -> None:
        with opened(path) as file:
            write(file)

    def _write_signals(self, file: TextIO) -> None:
        columns = list(dict.fromkeys(column for table in self._tables for column in table.columns))
        rows = ((table, dict(zip(table.columns, row, strict=True))) for table in self._tables for row in table.rows())
        self._write_rows(file, columns, ((table, [row.get(column) for column in columns]) for table, row in rows))

    def _write_figures(self, file: TextIO) -> None:
        rows = ((table, [*figure_columns(figure).values()]) for table in self._tables for figure in table.figures)
        self._write_rows(file, FIGURE_COLUMNS, rows)

    def _write_verdicts(self, file: TextIO) -> None:
        rows = ((table, row) for table in self._tables for row in verdict_rows(table.verdicts))
        self._write_rows(file, COLUMNS, rows)

    def _write_rows(self, file: TextIO, columns: Sequence[str], rows: Iterable[tuple[RunTable, list[Any]]]) -> None:
        """Write rows of runs as CSV; with several runs the first column is the name of the run."""
        several = len(self._tables) > 1
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["run", *columns] if several else columns)
        writer.writerows([table.name, *row] if several else row for table, row in rows)

    def _write_json(self, file: TextIO) -> None:
        """Write signals, figures and verdicts of all runs as one JSON object, with a line for each frame."""
        file.write('{"runs": [')
        for number, table in enumerate(self._tables):
            figures = [figure_columns(figure) for figure in table.figures]
            head = {"run": table.name, "scenario": table.scenario, "key_figures": figures, **table.responses}
            if table.verdicts:
                head["rules"] = [verdict_columns(one) for one in table.verdicts]
            file.write(f"{',' if number else ''}\n{json.dumps(head, allow_nan=False)[:-1]}, ")
            file.write(f'"signals": {{"columns": {json.dumps(table.columns)}, "rows": [')
            for row, line in enumerate(table.lines()):
                file.write(f"{',' if row else ''}\n{line}")
            file.write("]}}")
        file.write("]}\n")


def add_export(parser: argparse.ArgumentParser) -> None:
    """Add the options `--csv` and `--json` to a parser."""
    signals = "signals of every frame"
    for kind, what in (
        ("csv", f"{signals}, and key figures into NAME{FIGURES}.csv beside it"),
        ("json", f"{signals} and key figures"),
    ):
        parser.add_argument(
            f"--{kind}",
            metavar="PATH",
            help=f"write {what}, in SI units and deg; '-': to standard output",
        )


def export_fault(options: argparse.Namespace) -> str | None:
    """Error line about invalid options `--csv` and `--json`; None for valid ones."""
    if options.csv == options.json == STDOUT:
        return "--csv, --json: given - for both; allowed: standard output for one of them"
    for key, path in (("csv", options.csv), ("json", options.json)):
        if path not in (None, STDOUT) and Path(path).suffix.lower() in OTHERS - {f".{key}"}:
            return f"--{key}: given {path}; allowed: a name that ends in .{key}, or {STDOUT}"
    return None


def figure_of_columns(columns: Mapping[str, Any]) -> KeyFigure:
    """Key figure from a mapping by column name, inverse of `figure_columns`.

    Raises:
        KeyError, TypeError, ValueError: the mapping is of no key figure.
    """
    id_, time, limit = FigureId.of_text(columns["id"]), columns["time [s]"], columns["limit"]
    if id_.quantity not in QUANTITIES:
        raise ValueError(f"id: given {columns['id']!r}; allowed: ids of key figures")
    figure = KeyFigure(
        id_,
        str(columns["key_figure"]),
        math.nan if columns["value"] is None else float(columns["value"]),
        str(columns["unit"]),
        math.nan if time is None else float(time),
        str(columns["place"]),
        uncertainty=columns.get("uncertainty"),
        band=str(columns["band"]),
    )
    return figure.limited(None if limit is None else float(limit), str(columns["source"]))


def figure_columns(figure: KeyFigure) -> dict[str, Any]:
    """Key figure as a mapping by column name, of `FIGURE_COLUMNS`."""
    numbers = [value if value is None or math.isfinite(value) else None for value in (figure.value, figure.limit)]
    bound = figure.bound if figure.limit is not None else None
    time = figure.time if math.isfinite(figure.time) else None
    values = (figure.name, numbers[0], figure.unit, time, figure.place, numbers[1], bound, figure.source, figure.kept)
    whole = (*values, figure.band, str(figure.id), figure.uncertainty, figure.verdict or None)
    return dict(zip(FIGURE_COLUMNS, whole, strict=True))
