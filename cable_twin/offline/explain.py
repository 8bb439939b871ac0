"""Printed explanation of a key of a scenario file: `simulate --explain KEY`."""

from __future__ import annotations

from textwrap import wrap

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cable_twin.offline.figure_table import table_console
from cable_twin.scenario.reference import Entry, explained

WIDE = 120  # characters below which a table has too narrow columns to be read


def print_entries(key: str) -> None:
    """Print the entry of a key of a scenario file, or a table of a section.

    Args:
        key: dotted, as for `simulate --set`; carriages and towers may have any name.

    Raises:
        KeyError: there is no such key; one line with the nearest keys.
    """
    found = explained(key)
    console = table_console()
    if len(found) == 1:
        _print_entry(console, found[0])
        return
    if console.width < WIDE:
        for entry in found:
            _print_block(console, entry)
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in Entry._fields:
        table.add_column(title, no_wrap=title in ("key", "unit"))
    for entry in found:
        table.add_row(*map(Text, entry))
    console.print(table)


def _print_block(console: Console, entry: Entry) -> None:
    """Print the entry of a scenario key as a filled block: key with unit, meaning, default and allowed values."""
    unit = f" [{entry.unit}]" if entry.unit else ""
    rest = "; ".join(f"{title}: {text}" for title, text in zip(("default", "allowed"), entry[2:4], strict=True) if text)
    lines = [f"{entry.key}{unit}"]
    for text in (entry.meaning, rest):
        lines += wrap(text, console.width - 1, initial_indent="    ", subsequent_indent="    ")
    console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)


def _print_entry(console: Console, entry: Entry) -> None:
    unit = f" ({entry.unit})" if entry.unit else ""
    lines = f"{entry.key}{unit}: {entry.meaning}", f"default: {entry.default}", f"allowed: {entry.allowed}"
    console.print("\n  ".join(lines), markup=False, highlight=False)
