"""Shapes of bodies from size, pivots and inertia: outlines in the vertical plane, triangle meshes in space."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from math import dist
from typing import NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.scenario.builders.outlines import body_outline
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.vehicles import Body

CORNERS = 4  # of a box; a line has fewer points
LATERAL = 0.8  # width of a box over the shorter of its other sides; assumed, as a plane has none


def body_outlines(scenario: Scenario) -> dict[str, dict[str, FloatArray]]:
    """Outlines (n, 2) in m of all bodies, by name of the carriage and of the body; see `body_outline`."""
    return {
        name: {body_name: body_outline(body) for body_name, body in carriage.bodies.items()}
        for name, carriage in scenario.vehicles.items()
    }


def body_box(body: Body) -> FloatArray | None:
    """Length, width and height (3,) in m of a body's bounding box about its centre of mass; None if only a line."""
    outline = body_outline(body)
    if body.size is None and len(outline) < CORNERS:
        return None
    length, height = np.ptp(outline[1:], axis=0) if body.size is None else body.size
    return np.array([length, LATERAL * min(length, height), height], dtype=np.float64)


THICK = 0.06  # thickness of a bar over its length
LEAST = 1e-9  # m, of a bar
SIDES = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])  # normals of a box


class Bar(NamedTuple):
    """Straight part of a body, in its axes x and z from the centre of mass without payload."""

    start: tuple[float, float]  # m
    end: tuple[float, float]  # m

    @property
    def length(self) -> float:
        """Length (m) of the bar."""
        return dist(self.start, self.end)

    @property
    def centre(self) -> tuple[float, float]:
        """Middle (m) of the bar, in its body's axes x and z."""
        return 0.5 * (self.start[0] + self.end[0]), 0.5 * (self.start[1] + self.end[1])

    @property
    def pitch(self) -> float:
        """Rotation (rad) about y from the z axis to the direction of the bar."""
        return float(np.arctan2(self.end[0] - self.start[0], self.end[1] - self.start[1]))


class Solid(NamedTuple):
    """Triangle mesh in the axes of a body."""

    vertices: FloatArray  # (n, 3) m
    normals: FloatArray  # (n, 3)
    triangles: FloatArray  # (m, 3) numbers of vertices


def body_bars(body: Body) -> list[Bar]:
    """Straight bars of a body from its box (without a box: from its centre of mass) to its pivots."""
    box = body_box(body)
    height = 0.0 if box is None else 0.5 * float(box[2])
    top, low = ((v[0], v[-1]) if v else None for v in (body.upper_pivot, body.lower_pivot))
    bars = [] if top is None else [Bar((0.0, height), top)]
    if low is not None:
        bars.append(Bar((0.0, -height), low))
    elif top is not None and box is None:
        bars.append(Bar((0.0, 0.0), (-top[0], -top[1])))  # a rod, as long on the other side
    return [bar for bar in bars if bar.length > LEAST]


def body_solids(scenario: Scenario) -> Mapping[str, Mapping[str, Solid]]:
    """Triangle meshes of all bodies, by name of the vehicle and of the body."""
    return {
        name: {body_name: body_solid(body) for body_name, body in vehicle.bodies.items()}
        for name, vehicle in scenario.vehicles.items()
    }


def body_solid(body: Body) -> Solid:
    """Triangle mesh of a body: its box and its bars, or a small cube without either."""
    box = body_box(body)
    parts = [] if box is None else [_block(box, (0.0, 0.0), 0.0)]
    for bar in body_bars(body):
        wide = THICK * bar.length
        parts.append(_block(np.array([wide, wide, bar.length]), bar.centre, bar.pitch))
    if not parts:
        parts = [_block(np.full(3, 0.2), (0.0, 0.0), 0.0)]
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Solid(
        np.vstack([part.vertices for part in parts]),
        np.vstack([part.normals for part in parts]),
        np.vstack([part.triangles + first for part, first in zip(parts, firsts, strict=True)]),
    )


def _block(size: FloatArray, centre: tuple[float, float], pitch: float) -> Solid:
    """Box of a size (3,) in m around a centre x, z (m), rotated about y (rad): four vertices a side."""
    vertices, triangles = [], []
    for number, normal in enumerate(SIDES):
        others = [axis for axis in range(3) if normal[axis] == 0.0]
        for signs in product((-1.0, 1.0), repeat=2):
            corner = normal.copy()
            corner[others] = signs
            vertices.append(0.5 * size * corner)
        triangles += [[4 * number + corner for corner in triangle] for triangle in ((0, 1, 2), (1, 3, 2))]
    cos, sin = np.cos(pitch), np.sin(pitch)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    place = np.array([centre[0], 0.0, centre[1]])
    return Solid(np.array(vertices) @ turn.T + place, np.repeat(SIDES, 4, axis=0) @ turn.T, np.array(triangles))
