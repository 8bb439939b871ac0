"""Limits of key figures, and where they come from: the scenario, or a standard where it gives none."""

from __future__ import annotations

from cable_twin.key_figures.figure import Bound, KeyFigure, with_limit
from cable_twin.scenario import Scenario

HAUL_ROPE_SAFETY_FACTOR = 4.5  # -, instead of that of a track rope where the cable moves and the scenario gives none
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
    "energy_lost": "assumed: as a damping of 0.08 % of the critical one would take, less than a rope's own",
    "roller_load": "assumed: 500 N on each roller, so that a rope that swings does not leave it",
    "deropement_margin": "assumed: a tenth of the load at rest, the cable lifts off at 0",
}


def is_given(scenario: Scenario, key: str) -> bool:
    """Whether a scenario has another limit of that key of `limits` than the default."""
    return bool(getattr(scenario.limits, key) != type(scenario.limits).model_fields[key].default)


def limited(scenario: Scenario, figure: KeyFigure, key: str, bound: Bound = "at most") -> KeyFigure:
    """The figure with the limit of a scenario of that key of `limits`, and where that comes from."""
    limits = scenario.limits
    if key == "rope_safety_factor" and scenario.hauls:  # beside a track rope, whose factor is not enough for it
        key = "haul_rope_safety_factor"
    limit = getattr(limits, key)
    own = is_given(scenario, key)
    if key == "rope_safety_factor" and (scenario.drives or scenario.strand) and not own:
        limit = HAUL_ROPE_SAFETY_FACTOR
    return with_limit(figure, limit, f"scenario: limits.{key}" if own else SOURCES.get(key, ""), bound)


__all__ = ["HAUL_ROPE_SAFETY_FACTOR", "SOURCES", "is_given", "limited"]
