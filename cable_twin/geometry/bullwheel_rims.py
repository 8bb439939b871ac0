"""Rims of bullwheels as polylines."""

from __future__ import annotations

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.scenario.schema import Scenario

CORNERS = 24  # of a rim


def wheel_rims(scenario: Scenario) -> dict[str, FloatArray]:
    """Rims (n, 3) in m of all bullwheels by name, at zero tensioning travel, each in the plane of its two strands.

    A bullwheel whose two strand ends coincide stands upright.
    """
    return {name: wheel_centre(scenario, name) + _around(scenario, name) for name in scenario.sheaves}


def wheel_centre(scenario: Scenario, name: str) -> FloatArray:
    """Centre (3,) in m of a bullwheel at zero tensioning travel."""
    sheave = scenario.sheaves[name]
    ends = _ends(scenario, name)
    middle: FloatArray = ends.mean(axis=0)
    if sheave.position is not None:
        middle[[0, 2]] = np.array(sheave.position)[[0, -1]]
    return middle


def _ends(scenario: Scenario, name: str) -> FloatArray:
    """Positions (2, 3) in m of the two rope ends joined by a bullwheel."""
    before, after = scenario.sheaves[name].ropes
    ropes = scenario.ropes
    return np.array(
        [scenario.placed(before, ropes[before].end.position), scenario.placed(after, ropes[after].start.position)]
    )


def _around(scenario: Scenario, name: str) -> FloatArray:
    """Rim (n, 3) in m of a bullwheel relative to its centre."""
    sheave, ends = scenario.sheaves[name], _ends(scenario, name)
    before, _ = sheave.ropes
    along = ends[0] - scenario.placed(before, scenario.ropes[before].start.position)
    across = ends[1] - ends[0]
    if not across.any():
        across = np.array([0.0, 0.0, 1.0])
    across = across / np.linalg.norm(across)
    along = along - along @ across * across
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)[:, None]
    rim: FloatArray = sheave.radius * (np.cos(angles) * along + np.sin(angles) * across)
    return rim
