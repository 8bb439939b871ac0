#!/usr/bin/env python3
"""Drawing of the markers of a recorded run like in RViz, from the side: whole and around a vehicle.

Needs matplotlib. Example, for the newest run of `sim`:

    python examples/draw_markers.py cable_twin_logs/2026-01-31_09-30-00 --time 40 --output markers.png
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import LineCollection, PolyCollection

ARROW, CUBE, LINE_STRIP, TEXT, TRIANGLE_LIST = 0, 1, 4, 9, 11  # of visualization_msgs/Marker
VIEW = np.array([[1.0, 0.0], [0.35, 0.30], [0.0, 1.0]])  # x, y, z (m) -> right and up; y goes to the back
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))  # of a box, by corner


def rotation(q: Any) -> np.ndarray:
    """Rotation (3, 3) of a quaternion."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def place_of(marker: Any, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) in m of a marker, by its pose, as (n, 2) in the picture."""
    position = marker.pose.position
    return (points @ rotation(marker.pose.orientation).T + [position.x, position.y, position.z]) @ VIEW


def draw(axes: Any, marker: Any) -> None:
    """Draw one marker."""
    color = (marker.color.r, marker.color.g, marker.color.b, marker.color.a)
    points = np.array([[point.x, point.y, point.z] for point in marker.points]).reshape(-1, 3)
    if marker.type == LINE_STRIP:
        line = place_of(marker, points)
        colors = [(c.r, c.g, c.b, c.a) for c in marker.colors[:-1]] or [color]
        axes.add_collection(LineCollection(np.stack([line[:-1], line[1:]], axis=1), colors=colors, linewidths=2.0))
    elif marker.type == TRIANGLE_LIST:
        axes.add_collection(PolyCollection(place_of(marker, points).reshape(-1, 3, 2), facecolors=color))
    elif marker.type == CUBE:
        half = 0.5 * np.array([marker.scale.x, marker.scale.y, marker.scale.z])
        corners = place_of(marker, half * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]))
        shaded = [tuple(shade * part for part in color[:3]) for shade in (0.8, 0.9, 1.0, 0.7, 0.8, 0.9)]
        axes.add_collection(PolyCollection([corners[list(face)] for face in FACES], facecolors=shaded))
    elif marker.type == ARROW:
        start, end = place_of(marker, points)
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.5})
    elif marker.type == TEXT:
        axes.text(*place_of(marker, np.zeros((1, 3)))[0], marker.text, ha="center", va="bottom", clip_on=True)


def markers_at(run: Path, time: float) -> list[Any]:
    """Markers of a run at a simulated time (s), or the last ones before.

    Raises:
        ValueError: there are none.
    """
    with AnyReader([run]) as reader:
        wanted = [connection for connection in reader.connections if connection.topic.endswith("/markers")]
        found = None
        for connection, stamp, data in reader.messages(wanted):
            if stamp - reader.start_time <= time * 1e9:
                found = reader.deserialize(data, connection.msgtype)
    if found is None:
        raise ValueError(f"{run}: no markers in it up to {time:g} s; `sim` logs them, `simulate` does not")
    return list(found.markers)


def main() -> int:
    """Draw the markers; returns 0, or 1 after a failure."""
    parser = argparse.ArgumentParser(prog="draw_markers.py", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("run", type=Path, help="directory of a run of `sim`")
    parser.add_argument("--time", type=float, default=1e9, metavar="S", help="simulated time (s); default: the end")
    parser.add_argument("--output", type=Path, default=Path("markers.png"), help="picture; default: markers.png")
    options = parser.parse_args()
    try:
        markers = markers_at(options.run, options.time)
    except (AnyReaderError, OSError, ValueError) as error:
        print(f"draw_markers.py: {error}", file=sys.stderr)
        return 1
    figure, (whole, near) = plt.subplots(1, 2, figsize=(13.0, 4.8), width_ratios=[2.6, 1.0], layout="constrained")
    for axes in (whole, near):
        for marker in markers:
            draw(axes, marker)
        axes.set_aspect("equal")
        axes.set_xlabel("x [m]")
    whole.margins(0.12)
    whole.autoscale()
    whole.set_ylabel("z [m]")
    boxes = [marker for marker in markers if marker.ns == "bodies"]
    if boxes:
        middle = place_of(boxes[0], np.zeros((1, 3)))[0]
        reach = 3.0 * max(boxes[0].scale.x, boxes[0].scale.z)
        near.set_xlim(middle[0] - reach, middle[0] + reach)
        near.set_ylim(middle[1] - reach, middle[1] + 1.2 * reach)
    figure.savefig(options.output, dpi=110)
    print(f"{len(markers)} markers drawn: {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
