"""Text of the rerun view: the numbers of a moment, and the commands."""

from __future__ import annotations

from math import isnan

import numpy as np

from cable_twin.basics.units import rounded
from cable_twin.frame.commands import KINDS
from cable_twin.frame.plotted_signals import driven, driven_names
from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.snapshot import Columns, Layout

LARGEST = len("-1000.00 m")
SLIPPED = 1e-3  # m, above which slip is written


def describe_moment(layout: Layout, c: Columns, title: str, scale: float, unit: str) -> str:
    """Return the known numbers of a frame as Markdown, forces times `scale` in `unit`."""
    lines: list[tuple[str, float, str]] = []
    movers = driven(layout, c)
    at = "by" if layout.drives else "at"
    for name, place, speed, force in zip(driven_names(layout), *(row.tolist() for row in movers), strict=True):
        lines += (
            (f"{name} {at}", place, f"{place:.2f} m"),
            ("speed", speed, f"{speed:.2f} m/s"),
            ("drive force", force, f"{rounded(force * scale, 3)} {unit}"),
        )
    if layout.drives:
        on_line = c.attached == 1.0
        bodies = np.repeat(on_line, np.diff(layout.first_body))
        swing = float(np.abs(c.body_angles[bodies, 1]).max(initial=0.0))
        lines += (
            ("on the line", 0.0, f"{on_line.sum()} of {len(layout.vehicles)}"),
            ("largest swing", swing, f"{np.rad2deg(swing):.1f} deg"),
        )
    if layout.space:
        roll = float(np.degrees(np.abs(c.body_angles[:, 0]).max(initial=0.0)))
        lines += (
            ("swing across", roll, f"{roll:.1f} deg"),
            ("wind along", float(c.wind[0]), f"{c.wind[0]:.1f} m/s"),
            ("wind across", float(c.wind[1]), f"{c.wind[1]:.1f} m/s"),
        )
    low, high = float(c.lowest_tension[:, 0].min()) * scale, float(c.highest_tension[:, 0].max()) * scale
    lines += [
        (f"{which} tension", value, f"{rounded(value)} {unit}") for which, value in (("lowest", low), ("highest", high))
    ]
    for name, load in zip(layout.towers, c.tower_load[layout.tower_rows].tolist(), strict=True):
        lines.append((name, load, "lifted off" if load == 0.0 else f"{rounded(load * scale)} {unit}"))
    lines += [("counterweight", travel, f"{travel:+.3f} m") for travel in c.support_travel.tolist()]
    for name, (on, off), slip, travel in zip(
        layout.sheaves, c.sheave_tension.tolist(), c.sheave_slip.tolist(), c.sheave_travel.tolist(), strict=True
    ):
        lines += [
            (f"{name} {side}", pull, f"{rounded(pull * scale)} {unit}") for side, pull in (("on", on), ("off", off))
        ]
        lines += [(f"{name} slip", slip, f"{slip:.3f} m")] if abs(slip) > SLIPPED else []
        lines += [(f"{name} travel", travel, f"{travel:+.3f} m")]
    shown = [f"| {name} | **{text}** |" for name, value, text in lines if not isnan(value)]
    return "\n".join([f"## {title}", f"| time | {c.time[0]:.2f} s |", "| :-- | --: |", *shown])


def table_columns(text: str) -> tuple[int, int]:
    """Return the widths in letters of both columns of a `describe_moment` text, with room for larger numbers."""
    rows = [[cell.strip(" *") for cell in line.split("|")[1:3]] for line in text.splitlines()[1:]]
    names, values = (max(len(row[column]) for row in rows) for column in (0, 1))
    return names, max(values, LARGEST)


def describe_command(applied: AppliedCommand) -> str:
    """Return a command in one line: kind, names and values with unit, source."""
    command = applied.command
    unit_of = KINDS[command.kind].unit_of
    values = ", ".join(f"{name} {value:g} {unit_of(name)}" for name, value in command.values.items())
    kind = command.kind.replace("_", " ")
    return f"{kind} {values} ({applied.source})" if values else f"{kind} ({applied.source})"
