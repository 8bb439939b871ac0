#!/usr/bin/env python3
"""Emergency stops of one trip at random places, side by side: swing and stopping distance over the place.

A single twin drives along the line, and at each of the random times a member of an ensemble takes over its state. All
members then stop, and are advanced and observed together.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from cable_twin import Ensemble, Simulation, load_scenario

SCENARIO, VEHICLE, SPEED = "aerial_tramway", "cabin", 10.0  # m/s
FIRST, LAST = 40.0, 105.0  # s, between which the stops begin, all at that speed
AFTER, PERIOD = 25.0, 0.1  # s that each stop is watched, and from one look to the next


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=200, metavar="N", help="number of stops; default: 200")
    parser.add_argument("--seed", type=int, default=7, metavar="N", help="of their times; default: 7")
    parser.add_argument("--output", type=Path, required=True, metavar="PATH", help="picture, as .png, .pdf or .svg")
    options = parser.parse_args()
    times = np.random.default_rng(options.seed).uniform(FIRST, LAST, options.stops)

    twin = Simulation(load_scenario(SCENARIO))
    twin.command(VEHICLE, speed=SPEED)
    ensemble = Ensemble(SCENARIO, options.stops)
    ensemble.fork(twin, at=times)
    ensemble.emergency_stop()

    looks = np.arange(0.0, AFTER + 0.5 * PERIOD, PERIOD)
    places, swings = np.empty((2, len(looks), options.stops))
    for look, after in enumerate(looks):
        ensemble.advance_to(times + after)
        seen = ensemble.observe([f"{VEHICLE}/arc_length", f"{VEHICLE}/{VEHICLE}/pitch"])
        places[look], swings[look] = seen.array.T
    ensemble.close()
    for member, line in ensemble.faults.items():
        print(f"stop {member}: {line}", file=sys.stderr)

    highest, distances = np.degrees(np.abs(swings).max(axis=0)), places[-1] - places[0]
    worst = int(highest.argmax())
    print(f"{SCENARIO}: {options.stops} emergency stops from {SPEED:g} m/s")
    print(f"swing along the track: {highest.min():.1f} deg to {highest.max():.1f} deg")
    print(f"highest swing: stop at {places[0, worst]:.0f} m")
    print(f"stopping distance of the cabin along the rope: {distances.min():.1f} to {distances.max():.1f} m")
    draw(looks, places, swings, options.output)
    return 0


def draw(looks: np.ndarray, places: np.ndarray, swings: np.ndarray, path: Path) -> None:
    """Draw the swing over time of all stops, and highest swing and stopping distance over the place of the stop."""
    import matplotlib as mpl  # noqa: PLC0415 - a second, which wrong options need not wait for

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    degrees, begun = np.degrees(swings), places[0]
    worst = int(np.abs(degrees).max(axis=0).argmax())
    figure, (time, most, way) = plt.subplots(
        1, 3, figsize=(13.0, 4.2), width_ratios=[1.5, 1.0, 1.0], layout="constrained"
    )
    shades = mpl.colormaps["viridis"](mpl.colors.Normalize()(begun))
    for stop in range(degrees.shape[1]):
        time.plot(looks, degrees[:, stop], color=shades[stop], lw=0.5, alpha=0.5)
    time.plot(looks, degrees[:, worst], color="#D55E00", lw=1.8, label=f"stop at {begun[worst]:.0f} m")
    time.set(
        xlabel="time since the stop (s)", ylabel="swing of the cabin (deg)", xlim=(0.0, looks[-1]), ylim=(-24.0, 24.0)
    )
    time.legend(loc="upper right", frameon=False)
    for axes, values, label in (
        (most, np.abs(degrees).max(axis=0), "highest swing (deg)"),
        (way, places[-1] - begun, "stopping distance (m)"),
    ):
        axes.scatter(begun, values, c=shades, s=12)
        axes.plot(begun[worst], values[worst], "o", ms=7, mfc="none", mec="#D55E00", mew=1.8)
        axes.set(xlabel="place of the stop along the rope (m)", ylabel=label)
    for axes in (time, most, way):
        axes.grid(color="#DDDDDD", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
