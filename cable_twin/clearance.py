"""Height of rope and vehicles above the ground of the scenario."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.outlines import FloatArray
from cable_twin.records import CarriageState, Clearance, Place


def find_clearance(
    terrain: FloatArray,
    rope: FloatArray,
    carriages: Mapping[str, CarriageState],
    outlines: Mapping[str, Mapping[str, FloatArray]],
) -> Clearance:
    """Least vertical distances from the ground, with where they are.

    The ground is straight between its points. Rope and outlines are taken at their points and, between them, above
    the points of the ground: all that a minimum of straight lines over straight lines can be at.

    Args:
        terrain: (n, 2) m, x rising.
        rope: (m, 2) m, points of the rope.
        carriages: the vehicles; those in a station have none.
        outlines: (k, 2) m of each of their bodies, in its axes.
    """
    vehicles: dict[str, Place] = {}
    for name, carriage in carriages.items():
        if not carriage.attached:
            continue
        lines = []
        for body_name, body in carriage.bodies.items():
            cos, sin = np.cos(body.pitch), np.sin(body.pitch)
            turned = outlines[name][body_name] @ np.array([(cos, -sin), (sin, cos)])
            lines.append(turned + np.array([body.x, body.z]))
        vehicles[name] = min((_lowest(terrain, line) for line in lines), key=lambda place: place.height)
    return Clearance(rope=_lowest(terrain, rope), vehicles=vehicles)


def _lowest(terrain: FloatArray, line: FloatArray) -> Place:
    """Point of a line (n, 2) that is least above the ground; the ground goes on level beyond its ends."""
    starts, ends = line[:-1], line[1:]
    low, high = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    segment, point = np.nonzero((terrain[:, 0] > low[:, None]) & (terrain[:, 0] < high[:, None]))
    first, last, x = starts[segment], ends[segment], terrain[point, 0]
    share = (x - first[:, 0]) / (last[:, 0] - first[:, 0])
    every = np.vstack([line, np.column_stack([x, first[:, 1] + share * (last[:, 1] - first[:, 1])])])
    heights = every[:, 1] - np.interp(every[:, 0], terrain[:, 0], terrain[:, 1])
    lowest = int(np.argmin(heights))
    return Place(height=float(heights[lowest]), x=float(every[lowest, 0]), z=float(every[lowest, 1]))
