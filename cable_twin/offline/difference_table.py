"""Tables of the differences between runs."""

from __future__ import annotations

import re
from collections.abc import Mapping

from rich import box
from rich.console import Console
from rich.table import Table

from cable_twin.basics.units import rounded, shown_unit
from cable_twin.offline.reading import Reading
from cable_twin.offline.thinned_series import Comparison, Difference, unit_of
from cable_twin.scenario.sections.vehicles import Carriers

WIDE = 110  # characters that the whole table needs


def print_differences(console: Console, a: Reading, b: Reading, comparison: Comparison, label: str = "b") -> None:
    """Print the comparison of two runs; `label` names the second one.

    On a narrow terminal, when each signal differed most, and its values then, go to a line below.
    """
    wide = console.width >= WIDE
    table = Table("signal", box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("largest difference", "rms", "unit", *(("at", "a there", f"{label} there") if wide else ())):
        table.add_column(title, justify="left" if title == "unit" else "right", no_wrap=True)
    carriers = a.scenario.carriers
    for name, difference in _worst_of_each(comparison.differences, carriers).items():
        if difference.count:
            unit, scale = shown_unit(unit_of(name), max(map(abs, difference.values)))
            numbers = [rounded(value * scale) for value in (difference.largest, difference.rms)]
            there = [rounded(value * scale, 6) for value in difference.values]
            when = f"{difference.time:.2f} s"
            if wide:
                table.add_row(name, *numbers, unit, when, *there)
            else:
                below = f"{when}, a {there[0]}, {label} {there[1]}"
                table.add_row(f"{name}\n  [dim]{below}[/]", *numbers, unit)
    print(f"differences at {comparison.frames} common frames" + (f" of a and {label}" if label != "b" else ""))
    if comparison.frames:
        console.print(table)
        if carriers is not None:
            name = carriers.name
            print(f"of {name}_1 to {name}_{carriers.count}, only the one with the largest difference is shown\n")
    for run, names in zip(("a", label), comparison.only_in, strict=True):
        if names:
            print(f"only in {run}: {', '.join(sorted(names))}")
    if abs(a.end - b.end) > 1e-3:
        print(f"a ends at {a.end:.2f} s, {label} at {b.end:.2f} s")


def _worst_of_each(differences: Mapping[str, Difference], carriers: Carriers | None) -> dict[str, Difference]:
    """Signals of the table: of carriers, for each kind of signal, only the one with the largest difference."""
    if carriers is None:
        return dict(differences)
    worst: dict[str, str] = {}
    for name, difference in differences.items():
        kind = re.sub(f"/{carriers.name}_[0-9]+(?=/|$)", "/*", name)
        if kind not in worst or difference.largest > differences[worst[kind]].largest:
            worst[kind] = name
    return {name: differences[name] for name in worst.values()}
