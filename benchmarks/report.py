"""Reports of benchmarks on the screen, in Markdown and in JSON, from common rows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markdown import Markdown
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table as RichTable

from benchmarks.measure import machine

Value = float | int | str | None
HEAD = """\
# Benchmarks

Written part by part; the same numbers are in [benchmarks.json](benchmarks.json). Times of the solver are medians of
interleaved repetitions on one thread. It takes minutes, on a machine that does nothing else; one part alone takes
seconds (`python -m benchmarks exudyn --quick`, likewise `exudyn_space`, `space`, `ropes`, `scaling`, `startup`,
`frame`, `graded`, `uniform`, `loads`, `accuracy`, `convergence`, `coupled`, `learning`, `ensemble`, `outlook`,
`envelope`, `study`, `lockstep`, `emergency_stop`, `live`):

```sh
.venv/bin/pip install --quiet '.[bench,gym,ros]'
.venv/bin/python -m benchmarks --output docs                      # docs/pictures/accuracy.png among it
.venv/bin/python -m benchmarks live --minutes 10 --output docs    # docs/pictures/live.png among it
```

The ratios to [Exudyn](https://github.com/jgerstmayr/EXUDYN) are what lasts: in another hour of this virtual machine
both programs took half the time (6.9 µs and 139 µs on 24 elements).

The line below each part says when, on which machine and with which version it was measured. Elements and vehicles are
those that a scenario had then: `aerial_tramway` had 260 elements, then 102 and 61, and is shipped with 67.
"""
CUT = "…"  # behind a word that is cut
BOUNDLESS = 10_000  # characters
HEADING = 20  # characters of one beside its numbers
PICTURES = "pictures"  # directory beside the page


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of one shape; the keys are the headings, with their units."""

    title: str
    rows: list[dict[str, Value]]


@dataclass(frozen=True, slots=True)
class Part:
    """Results of one part."""

    title: str
    tables: list[Table]
    notes: list[str]
    faults: list[str] = field(default_factory=list)  # what was measured but must not be, a line each
    pictures: dict[str, bytes] = field(default_factory=dict)  # PNG by file name
    machine: dict[str, str] = field(default_factory=machine)

    def record(self) -> dict[str, Any]:
        """Plain data for JSON."""
        record = asdict(self)
        record["pictures"] = list(self.pictures)
        return record


def text(value: Value) -> str:
    """Text of a cell with three significant digits."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, int) or abs(value) >= 1000.0:
        return f"{value:.0f}"
    return f"{value:#.3g}".rstrip(".") if value == 0.0 or abs(value) >= 1e-3 else f"{value:.2g}"


def print_part(part: Part, console: Console) -> None:
    """Print the tables and notes of a part."""
    console.print(f"\n[bold]{part.title}[/bold]")
    for table in part.tables:
        shown = _beside(table)
        if _fits(shown, console):
            console.print(shown)
            continue
        left = table.rows
        while left:
            count = next((n for n in range(len(left), 1, -1) if _fits(_below(table, left[:n]), console)), 1)
            console.print(_below(table, left[:count]))
            left = left[count:]
    for note in part.notes:
        console.print(Markdown(f"- {note}"))


def _beside(table: Table) -> RichTable:
    """Table with a row for each row."""
    shown = RichTable(title=escape(table.title), title_justify="left")
    for key in table.rows[0]:
        words = any(isinstance(row[key], str) for row in table.rows)
        heading = escape(key)  # a unit in brackets is no markup
        longest = max(len(text(row[key])) for row in table.rows) if words else None
        shown.add_column(heading, justify="left" if words else "right", no_wrap=words, min_width=longest)
    for row in table.rows:
        shown.add_row(*map(text, row.values()))
    return shown


def _below(table: Table, rows: list[dict[str, Value]]) -> RichTable:
    """Table with a column for each row, for a terminal narrower than the table."""
    shown = RichTable(title=escape(table.title), title_justify="left", show_header=False)
    shown.add_column(min_width=HEADING)
    for row in rows:
        shown.add_column(justify="right", no_wrap=True, min_width=max(len(text(cell)) for cell in row.values()))
    for key in rows[0]:
        shown.add_row(escape(key), *(text(row[key]) for row in rows))
    return shown


def _fits(shown: RichTable, console: Console) -> bool:
    """Whether a table fits the terminal without cut words."""
    ample = console.options.update(width=BOUNDLESS)
    if Measurement.get(console, ample, shown).minimum > console.width:
        return False
    return not any(CUT in part.text for part in console.render(shown))  # columns may get narrower than their words


def read(directory: Path) -> dict[str, Any]:
    """Results of earlier runs in `directory`.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not one of ours.
    """
    path = directory / "benchmarks.json"
    records = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if not isinstance(records, dict) or not all(isinstance(one, dict) and "tables" in one for one in records.values()):
        raise ValueError(f"{path} is not from here; remove it or choose another directory")
    return records


def merge(earlier: Mapping[str, Any], parts: Mapping[str, Part], order: list[str]) -> dict[str, Any]:
    """Earlier results, replaced by new ones where measured."""
    records = {**earlier, **{name: part.record() for name, part in parts.items()}}
    return {name: records[name] for name in order if name in records}


def write(directory: Path, records: Mapping[str, Any], parts: Mapping[str, Part]) -> list[Path]:
    """Write benchmarks.json, benchmarks.md and the new pictures into `directory`; returns the files.

    Raises:
        OSError: the disk refuses.
    """
    (directory / PICTURES).mkdir(parents=True, exist_ok=True)
    contents = {
        "benchmarks.json": (json.dumps(records, indent=1) + "\n").encode(),
        "benchmarks.md": (HEAD + "\n".join(map(_markdown, records.values()))).encode(),
        **{f"{PICTURES}/{name}": picture for part in parts.values() for name, picture in part.pictures.items()},
    }
    for name, content in contents.items():
        (directory / name).write_bytes(content)
    return [directory / name for name in contents]


def _markdown(record: Mapping[str, Any]) -> str:
    """Markdown section of one part."""
    lines = [f"\n## {record['title']}\n"]
    for table in record["tables"]:
        keys = list(table["rows"][0])
        lines += [f"**{table['title']}**\n", f"| {' | '.join(keys)} |", f"| {' | '.join('---' for _ in keys)} |"]
        lines += [f"| {' | '.join(text(row[key]) for key in keys)} |" for row in table["rows"]]
        lines.append("")
    lines += [f"- {note}" for note in record["notes"]]
    lines += [f"\n![{record['title']}]({PICTURES}/{picture})" for picture in record["pictures"]]
    described = ", ".join(f"{key} {value}" if key != "date" else value for key, value in record["machine"].items())
    lines.append(f"\n<sub>{described}</sub>\n")
    return "\n".join(lines)
