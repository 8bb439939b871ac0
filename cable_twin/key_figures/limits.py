"""Limits of key figures, and where they come from: the scenario, or a standard where it gives none."""

from __future__ import annotations

from typing import cast

from cable_twin.key_figures.figure import Bound, KeyFigure, with_limit
from cable_twin.scenario import Scenario

TRACK_ROPE_SAFETY_FACTOR, HAUL_ROPE_SAFETY_FACTOR = 3.15, 4.5  # -
TENSION_PER_TRANSVERSE_LOAD = 10.0  # -, of carriages that roll on a rope
# keys whose usual limit depends on the rope or the vehicle: null in a scenario stands for that, 0 for no limit
BY_WHAT_IT_IS = ("rope_safety_factor", "tension_per_transverse_load")
SAFETY = "EN 12927 and CEN practice: 3.15 to 3.5 track rope, 4.5 to 5 haul rope"
VORARLBERG = "Vorarlberg's ordinance on ropeways (RIS LVB20000550), section 6"
SOURCES = {  # of the default limits
    "rope_safety_factor": SAFETY,
    "haul_rope_safety_factor": SAFETY,
    "tension_per_transverse_load": "CEN practice for carriages that roll on a track rope, at least 10",
    "swing": "assumed: clearance usually allows for 0.35 rad (20 deg)",
    "lateral_swing": f"{VORARLBERG}: 20 % across",
    "tower_clearance": f"{VORARLBERG}: 0.5 m to the side",
    "acceleration": "assumed: emergency stops usually have 1 to 1.5 m/s^2",
    "rope_clearance": "assumed: nothing may touch the ground",
    "vehicle_clearance": "assumed: nothing may touch the ground",
    "energy_lost": "assumed: equivalent to a damping ratio of 0.08 %, less than that of the rope itself",
    "roller_load": "assumed: 500 N on each roller, so that a rope that swings does not leave it",
    "deropement_margin": "assumed: a tenth of the load at rest; the cable lifts off at 0",
}


def standard_limit(scenario: Scenario, key: str, *, clamped: bool = False) -> float | None:
    """Limit of a key of `limits` where a scenario gives none: for some by what a rope, or a vehicle, is."""
    if key == "rope_safety_factor":
        return HAUL_ROPE_SAFETY_FACTOR if scenario.drives or scenario.strand else TRACK_ROPE_SAFETY_FACTOR
    if key == "tension_per_transverse_load":
        return None if clamped else TENSION_PER_TRANSVERSE_LOAD
    return cast(float | None, type(scenario.limits).model_fields[key].default)


def limited(
    scenario: Scenario, figure: KeyFigure, key: str, bound: Bound = "at most", *, clamped: bool = False
) -> KeyFigure:
    """The figure with the limit of a scenario of that key of `limits`, and where that comes from.

    Args:
        scenario: That has limits.
        figure: Without one.
        key: Of `limits`.
        bound: On which side of the limit the figure has to be.
        clamped: Whether the figure is of vehicles that are clamped to the rope.
    """
    if key == "rope_safety_factor" and scenario.hauls:  # beside a track rope, whose factor is not enough for it
        key = "haul_rope_safety_factor"
    given, standard = getattr(scenario.limits, key), standard_limit(scenario, key, clamped=clamped)
    limit = (standard if given is None else given or None) if key in BY_WHAT_IT_IS else given
    return with_limit(figure, limit, SOURCES.get(key, "") if limit == standard else f"scenario: limits.{key}", bound)


__all__ = ["HAUL_ROPE_SAFETY_FACTOR", "SOURCES", "limited", "standard_limit"]
