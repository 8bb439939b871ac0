"""Outlines of bodies in the vertical plane, from their given size or from pivots and inertia."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.vehicles import Body

FloatArray = NDArray[np.float64]
CORNERS = 4  # of a box; a line has fewer points
LATERAL = 0.8  # width of a box over the shorter of its other sides; assumed, as a plane has none


def body_outlines(scenario: Scenario) -> dict[str, dict[str, FloatArray]]:
    """Outlines (n, 2) in m of all bodies, by name of the carriage and of the body; see `body_outline`."""
    return {
        name: {body_name: body_outline(body) for body_name, body in carriage.bodies.items()}
        for name, carriage in scenario.vehicles.items()
    }


def body_outline(body: Body) -> FloatArray:
    """Outline (n, 2) in m of a body in its axes, from its centre of mass without payload.

    With a size it is that box around the centre of mass, and a line from it to each pivot. Without one, see
    `outline_from_pivots`.
    """
    upper = body.upper_pivot[:: len(body.upper_pivot) - 1]
    lower = None if body.lower_pivot is None else body.lower_pivot[:: len(body.lower_pivot) - 1]
    if body.size is None:
        return outline_from_pivots(upper, lower, gyration_radius=sqrt(body.inertia / body.mass))
    width, height = body.size[0] / 2.0, body.size[1] / 2.0
    box = [(0.0, height), (width, height), (width, -height), (-width, -height), (-width, height), (0.0, height)]
    below = [] if lower is None else [(0.0, -height), lower]
    return np.array([upper, *box, *below], dtype=np.float64)


def body_box(body: Body) -> FloatArray | None:
    """Length, width and height (3,) in m of the bounding box of a body about its centre of mass; None for a line."""
    outline = body_outline(body)
    if body.size is None and len(outline) < CORNERS:
        return None
    length, height = np.ptp(outline[1:], axis=0) if body.size is None else body.size
    return np.array([length, LATERAL * min(length, height), height], dtype=np.float64)


def outline_from_pivots(
    upper_pivot: ArrayLike, lower_pivot: ArrayLike | None = None, *, gyration_radius: float | None = None
) -> FloatArray:
    """Return an outline of a body from its pivots and inertia alone.

    A body that carries another one is a line from pivot to pivot through the centre of mass. The last body of a
    chain is a slender rod where its inertia is that of one, else the square box of that inertia, hung from its
    pivot.

    Args:
        upper_pivot: (2,) m, from the centre of mass in the body's axes.
        lower_pivot: (2,) m, where the next body hangs; None for the last one of the chain.
        gyration_radius: m, square root of inertia over mass; None draws a box as high as the pivot is above the
            centre of mass.

    Returns:
        (n, 2) m, one line in the body's axes.
    """
    top = np.asarray(upper_pivot, dtype=np.float64)
    if lower_pivot is not None:
        return np.array([top, (0.0, 0.0), np.asarray(lower_pivot, dtype=np.float64)])
    length = float(np.hypot(*top))
    if gyration_radius is not None and abs(gyration_radius * np.sqrt(12.0) - 2.0 * length) < 0.1 * length:
        return np.array([top, -top])
    half = (length if gyration_radius is None else gyration_radius * np.sqrt(6.0)) / 2.0
    box = np.array([(0.0, half), (half, half), (half, -half), (-half, -half), (-half, half), (0.0, half)])
    return np.vstack([top, box])
