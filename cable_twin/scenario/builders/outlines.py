"""Outlines of bodies in the vertical plane from size, pivots and inertia, and the length of a chain of bodies."""

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario.sections.vehicles import Body


def body_outline(body: Body) -> FloatArray:
    """Outline (n, 2) in m of a body in its axes, from its centre of mass without payload.

    A body with a size is that box around the centre of mass, with a line to each pivot; for a body without a size see
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


def outline_from_pivots(
    upper_pivot: ArrayLike, lower_pivot: ArrayLike | None = None, *, gyration_radius: float | None = None
) -> FloatArray:
    """Return an outline of a body from its pivots and inertia alone.

    A body that carries another one is a line from pivot to pivot through the centre of mass. The last body of a
    chain is a slender rod if its inertia is that of a rod, else the square box of its inertia, hung from its
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


def reach_along(bodies: Iterable[Body]) -> tuple[float, float]:
    """Extent (m) of a chain of bodies, hanging upright, from its joint, towards the start and the end of the track."""
    low, high, pin = 0.0, 0.0, 0.0
    for body in bodies:
        centre = pin - body.upper_pivot[0]
        outline = centre + body_outline(body)[:, 0]
        low, high = min(low, float(outline.min())), max(high, float(outline.max()))
        pin = centre + (body.lower_pivot or (0.0, 0.0))[0]
    return -low, high
