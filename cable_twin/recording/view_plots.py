"""What is plotted and written of a snapshot: its numbers, and those of the commands."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import rerun as rr

from cable_twin.recording.view_geometry import entity_path
from cable_twin.records import AppliedCommand, Snapshot, TowerState

PLOT_COLORS = (0x4CC9F0FF, 0xFFD166FF, 0xFF6B6BFF, 0x80ED99FF, 0xC8B6FFFF, 0xFFADADFF)
DEGREES = 180.0 / np.pi


class Plot:
    """The lines of one entity in a plot."""

    def __init__(self, path: str, names: list[str], colors: list[int]) -> None:
        self.path = path
        self.names = names
        self.colors = colors
        # Wider below narrower: lines that coincide stay visible.
        self.widths = np.linspace(3.0, 1.5, len(names)) if len(names) > 1 else np.array([1.5])


class Plots:
    """All plots of a run: a row of values for each snapshot, the speeds that are commanded among them."""

    def __init__(self, snapshot: Snapshot, force_scale: float) -> None:
        self._plots = _lines(snapshot)
        self._scale = force_scale
        self._commanded: dict[str, float] = {}

    def __iter__(self) -> Iterator[Plot]:
        return iter(self._plots)

    def begin(self, stream: rr.RecordingStream) -> None:
        """Name and colour the lines."""
        for plot in self._plots:
            colors = np.array(plot.colors, dtype=np.uint32)
            stream.log(plot.path, rr.SeriesLines(names=plot.names, colors=colors, widths=plot.widths), static=True)

    def send(self, stream: rr.RecordingStream, times: rr.TimeColumn, rows: list[list[float]]) -> None:
        """Send the rows of so many times."""
        table = np.array(rows, dtype=np.float64)
        first = 0
        for plot in self._plots:
            last = first + len(plot.names)
            stream.send_columns(plot.path, [times], rr.Scalars.columns(scalars=table[:, first:last]), strict=True)
            first = last
            time.sleep(0)  # the frame loop may be waiting for the interpreter

    def row(self, snapshot: Snapshot) -> list[float]:
        """Return the values of all plots: speeds, tensions, swings, drive forces, tower loads."""
        scale = self._scale
        tensions = snapshot.cable.tensions
        row: list[float] = []
        driven = _driven(snapshot)
        for name, (_, speed, _) in driven.items():
            row += (speed, self._commanded.get(name, np.nan))
        row += (tensions.max() * scale, tensions[0] * scale, tensions[-1] * scale)
        for state in snapshot.carriages.values():
            row += [body.pitch * DEGREES if state.attached else np.nan for body in state.bodies.values()]
        row += [force * scale for _, _, force in driven.values()]
        row += [tower.normal_load * scale for tower in _towers(snapshot).values()]
        return row

    def obey(self, applied: AppliedCommand) -> None:
        """Take a command over into the commanded speeds; no number where no speed is commanded."""
        command = applied.command
        if command.kind == "speed":
            self._commanded.update(command.values)
        elif command.kind == "force":
            self._commanded.update(dict.fromkeys(command.values, np.nan))
        elif command.kind == "emergency_stop":
            self._commanded = dict.fromkeys(self._commanded, 0.0)
        elif command.kind in ("release", "reset"):
            self._commanded = {}


def _lines(snapshot: Snapshot) -> list[Plot]:
    """Return the plots in the order in which `Plots.row` gives their values."""
    plots = []
    carriages = snapshot.carriages
    lone = len(carriages) == 1
    driven = list(_driven(snapshot))
    tints = iter(PLOT_COLORS * (1 + 2 * len(driven)))
    for name in driven:
        titles = ["speed", "commanded"] if len(driven) == 1 else [name, f"{name} commanded"]
        plots.append(Plot(entity_path("plots/speed", name), titles, [next(tints), next(tints)]))
    titles = ["highest", "at the start", "at the end"]
    plots.append(Plot("plots/tension", titles, [*PLOT_COLORS[2:0:-1], PLOT_COLORS[0]]))
    tints = iter(PLOT_COLORS * (1 + sum(len(c.bodies) for c in carriages.values())))
    for name, state in carriages.items():
        if state.bodies:
            titles = [body if lone else f"{name} {body}" for body in state.bodies]
            plots.append(Plot(entity_path("plots/swing", name), titles, [next(tints) for _ in titles]))
    tints = iter(PLOT_COLORS * (1 + len(driven)))
    plots.extend(Plot(entity_path("plots/drive_force", name), [name], [next(tints)]) for name in driven)
    tints = iter(PLOT_COLORS * (1 + len(snapshot.supports)))
    plots.extend(Plot(entity_path("plots/tower_load", name), [name], [next(tints)]) for name in _towers(snapshot))
    return plots


def describe_moment(snapshot: Snapshot, title: str, scale: float, unit: str) -> str:
    """Return the numbers of this moment as Markdown, forces times `scale` in `unit`."""
    tensions = snapshot.cable.tensions
    lines = [f"## {title}", f"| time | {snapshot.time:.2f} s |", "| :-- | --: |"]
    for name, (place, speed, force) in _driven(snapshot).items():
        lines += (
            f"| {name} {'by' if snapshot.drives else 'at'} | **{place:.2f} m** |",
            f"| speed | **{speed:.2f} m/s** |",
            f"| drive force | **{force * scale:.3g} {unit}** |",
        )
    if snapshot.drives:
        on_line = [state for state in snapshot.carriages.values() if state.attached]
        swing = max((abs(body.pitch) for state in on_line for body in state.bodies.values()), default=0.0)
        lines += (
            f"| on the line | **{len(on_line)} of {len(snapshot.carriages)}** |",
            f"| largest swing | **{swing * DEGREES:.1f} deg** |",
        )
    lines.append(f"| tension | **{tensions.min() * scale:.4g} … {tensions.max() * scale:.4g} {unit}** |")
    for name, tower in _towers(snapshot).items():
        load = "lifted off" if tower.lifted_off else f"{tower.normal_load * scale:.4g} {unit}"
        lines.append(f"| {name} | **{load}** |")
    travels = [support.travel for support in snapshot.supports.values() if support.travel is not None]
    lines += [f"| counterweight | **{travel:+.3f} m** |" for travel in travels]
    return "\n".join(lines)


def describe_command(applied: AppliedCommand) -> str:
    """Return a command in one line: what, for whom, with unit, from where."""
    command = applied.command
    unit = {"speed": "m/s", "force": "N", "payload": "kg", "wind": "m/s"}.get(command.kind, "")
    values = ", ".join(f"{name} {value:g} {unit}" for name, value in command.values.items())
    kind = command.kind.replace("_", " ")
    return f"{kind} {values} ({applied.source})" if values else f"{kind} ({applied.source})"


def _towers(snapshot: Snapshot) -> dict[str, TowerState]:
    """Return the towers among the supports."""
    return {name: support.tower for name, support in snapshot.supports.items() if support.tower is not None}


def _driven(snapshot: Snapshot) -> dict[str, tuple[float, float, float]]:
    """Return place (m), speed (m/s) and drive force (N) by name: of a moving cable, else of each carriage."""
    if snapshot.drives:
        return {name: (drive.position, drive.speed, drive.force) for name, drive in snapshot.drives.items()}
    return {name: (one.arc_length, one.speed, one.drive_force) for name, one in snapshot.carriages.items()}
