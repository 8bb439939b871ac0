"""Several ropes: carriages that slide on one rope and are clamped to another."""

from __future__ import annotations

from math import cos, hypot
from typing import Any

import numpy as np

SPAN, RISE = 300.0, 90.0  # m
TRACK = {"mass_per_length": 10.0, "axial_stiffness": 1.6e8, "bending_stiffness": 2e4}
HAUL = {"mass_per_length": 2.5, "axial_stiffness": 3e7, "bending_stiffness": 1e3}
GRAVITY = 9.81


def unstrained(weight: float, stiffness: float, tension: float) -> float:
    """Unstrained length (m) of a rope in the span with about this tension (N): a parabola's."""
    chord = hypot(SPAN, RISE)
    load = weight * GRAVITY * cos(np.arctan2(RISE, SPAN))
    return float((chord + load**2 * chord**3 / (24.0 * tension**2)) * (1.0 - tension / stiffness))


def clamped(*, places: tuple[float, ...] = (150.0,), elements: int = 24, y: float | None = None, **changes: Any) -> Any:
    """Carriages on a track rope that are clamped to a haul rope beside it, as plain data of a scenario."""

    def at(x: float, z: float) -> list[float]:
        return [x, z] if y is None else [x, y, z]

    held = {"elements": elements, "start": {"position": at(0.0, 0.0)}, "end": {"position": at(SPAN, RISE)}}
    lengths = {"track": unstrained(10.0, 1.6e8, 4e5), "haul": unstrained(2.5, 3e7, 6e4)}
    body = {"mass": 4000.0, "inertia": 9000.0, "upper_pivot": at(0.0, 4.0)}
    return {
        "ropes": {
            "track": TRACK | held | {"unstrained_length": lengths["track"]},
            "haul": HAUL | held | {"unstrained_length": lengths["haul"]},
        },
        "carriages": {
            f"cabin_{number + 1}": {
                "rope": "track",
                "arc_length": place,
                "clamped_to": {"haul": place * lengths["haul"] / lengths["track"]},
                "bodies": {"cabin": body},
            }
            for number, place in enumerate(places)
        },
        **changes,
    }
