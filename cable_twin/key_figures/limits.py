"""Limits of key figures: given by the scenario, else standard values (`scenario.limits`)."""

from __future__ import annotations

from typing import cast

from cable_twin.key_figures.figure import KeyFigure, with_limit
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.limits import bound_of, source_of

TRACK_ROPE_SAFETY_FACTOR, HAUL_ROPE_SAFETY_FACTOR = 3.15, 4.5  # -
TENSION_PER_TRANSVERSE_LOAD = 10.0  # -, of carriages that roll on a rope
# keys whose usual limit depends on the rope or the vehicle: null in a scenario stands for that, 0 for no limit
BY_WHAT_IT_IS = ("rope_safety_factor", "tension_per_transverse_load")


def standard_limit(scenario: Scenario, key: str, *, clamped: bool = False) -> float | None:
    """Standard limit of a key of `limits`, for some keys by the kind of rope or vehicle."""
    if key == "rope_safety_factor":
        return HAUL_ROPE_SAFETY_FACTOR if scenario.drives or scenario.strand else TRACK_ROPE_SAFETY_FACTOR
    if key == "tension_per_transverse_load":
        return None if clamped else TENSION_PER_TRANSVERSE_LOAD
    return cast(float | None, type(scenario.limits).model_fields[key].default)


def limited(scenario: Scenario, figure: KeyFigure, key: str, *, clamped: bool = False) -> KeyFigure:
    """Key figure with the scenario's limit of a key of `limits`, or the standard one, and its source.

    Args:
        scenario: That has limits.
        figure: Without one.
        key: Of `limits`.
        clamped: Whether the figure is of vehicles that are clamped to the rope.
    """
    if key == "rope_safety_factor" and scenario.hauls:  # beside a track rope, whose factor is not enough for it
        key = "haul_rope_safety_factor"
    given, standard = getattr(scenario.limits, key), standard_limit(scenario, key, clamped=clamped)
    limit = (standard if given is None else given or None) if key in BY_WHAT_IT_IS else given
    source = source_of(key) if limit == standard else f"scenario: limits.{key}"
    return with_limit(figure, limit, source, bound_of(key))


__all__ = ["HAUL_ROPE_SAFETY_FACTOR", "limited", "standard_limit"]
