#!/usr/bin/env python3
"""Outlook of a trip, and what then happens: highest and lowest tension of the rope in three futures.

A tramway drives onto its tower. At one moment the twin looks ahead, prints which limits would be passed, and stops.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from cable_twin import Outlook, Simulation, load_scenario

SCENARIO, VEHICLE, SPEED = "aerial_tramway", "cabin", 8.0  # m/s
BEFORE, HORIZON, PERIOD = 20.0, 60.0, 0.1  # s
COLORS = {"emergency stop": "tab:red", "as commanded": "tab:blue", "announced wind": "tab:green"}
LINES = {"emergency stop": "-", "as commanded": "-", "announced wind": ":"}


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=60.0, metavar="S", help="moment of the look; default: 60")
    parser.add_argument("--output", type=Path, required=True, metavar="PATH", help="picture, as .png, .pdf or .svg")
    options = parser.parse_args()
    twin = Simulation(load_scenario(SCENARIO))
    twin.command(VEHICLE, speed=SPEED)
    past = tensions(twin, options.time - BEFORE, options.time)
    outlook = twin.outlook(horizon=HORIZON)
    print(f"{SCENARIO}, from {options.time:g} s on")
    for future in outlook.futures:
        print(f"{future.name}: {future.assumed}")
    stop = outlook["emergency stop"]
    for quantity in ("stopping_distance", "stopping_time", "swing"):
        figure = stop[f"{quantity}/carriages.{VEHICLE}/highest"]
        print(f"{figure.name}: {figure.value:.3f} {figure.unit} at {figure.time:.2f} s")
    for line in outlook.warnings:
        print(f"warning: {line}")
    twin.emergency_stop()
    happens = tensions(twin, options.time, options.time + HORIZON)
    apart = np.abs(happens[-1, 1:] - [stop.highest[-1, 0], stop.lowest[-1, 0]]).max()
    print(f"the stop that then happens, at its end: {apart:g} N from the forecast")
    draw(outlook, past, happens, options.output)
    return 0


def tensions(twin: Simulation, start: float, end: float) -> np.ndarray:
    """Time (s), highest and lowest tension (N) of a twin, a row each, from one time (s) to another."""
    rows = []
    for time in np.arange(start, end + 0.5 * PERIOD, PERIOD):
        columns = twin.advance_to(time).columns
        rows.append((time, columns.highest_tension[0, 0], columns.lowest_tension[0, 0]))
    return np.array(rows)


def draw(outlook: Outlook, past: np.ndarray, happens: np.ndarray, path: Path) -> None:
    """Draw the past, the bands of the futures, and what then happens."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - a second

    figure = Figure(figsize=(10, 5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for column, (axis, name) in enumerate(zip(axes, ("highest", "lowest"), strict=True), 1):
        axis.plot(past[:, 0], past[:, column] / 1e3, color="black", label="until now")
        for future in outlook.futures:
            axis.plot(
                future.times,
                getattr(future, name) / 1e3,
                color=COLORS[future.name],
                label=future.name,
                ls=LINES[future.name],
            )
        axis.plot(happens[::20, 0], happens[::20, column] / 1e3, "k.", markersize=4, label="the stop that then happens")
        axis.axvline(outlook.time, color="gray", linewidth=0.8)
        axis.set_ylabel(f"{name} tension [kN]")
    axes[0].legend(ncols=5, loc="upper center", bbox_to_anchor=(0.5, 1.22), frameon=False, fontsize=9)
    axes[1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
