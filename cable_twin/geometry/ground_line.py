"""Ground line drawn for scenarios without terrain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_twin.frame.records import FloatArray


def default_ground(cable: FloatArray, carriages: Sequence[FloatArray]) -> FloatArray:
    """Return a ground line below the reach of every carriage along its way, parallel to the chord of the cable.

    A load that travels along a taut rope draws a parabola: its sag, and that of the bodies, is scaled to midspan.

    Args:
        cable: (n, 2) m.
        carriages: For each carriage (m, 2) m, its joint and then the points of its bodies.
    """
    chord = cable[-1] - cable[0]
    points = np.vstack([cable, *carriages])
    span = max(abs(chord[0]), np.ptp(points[:, 0]), 1e-3)
    slope = chord[1] / chord[0] if abs(chord[0]) > abs(chord[1]) else 0.0
    depths = cable[0, 1] + slope * (points[:, 0] - cable[0, 0]) - points[:, 1]
    deepest = depths.max()
    for carriage in carriages:
        part = np.clip((carriage[0, 0] - cable[0, 0]) / chord[0], 0.02, 0.98) if slope or chord[0] else 0.5
        sag = cable[0, 1] + slope * (carriage[0, 0] - cable[0, 0]) - carriage[0, 1]
        reach = carriage[0, 1] - carriage[:, 1].min()
        deepest = max(deepest, min(sag / (4.0 * part * (1.0 - part)), 0.3 * span) + reach)
    ends = np.array([points[:, 0].min() - 0.02 * span, points[:, 0].max() + 0.02 * span])
    heights = cable[0, 1] + slope * (ends - cable[0, 0]) - deepest - max(0.1 * deepest, 0.02 * span)
    return np.column_stack([ends, heights])
