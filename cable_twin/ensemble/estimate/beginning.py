"""Scenario values with which a twin begins at the places and speeds of its plant, at rest or under way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_twin.ensemble.estimate.quantities import Reading
from cable_twin.scenario import Scenario

MOVED = 1.0  # m, from which on a plant has moved
Motion = Mapping[str, tuple[float, float]]  # place (m) and speed (m/s) by name of a carriage or drive


def values_at(scenario: Scenario, motion: Motion) -> tuple[dict[str, Any], dict[str, float]]:
    """Scenario values by dotted key that put vehicles where encoders measure them.

    Carriers are moved round their loop, modulo its length. Carriages clamped to a strand are moved with it; the static
    equilibrium finds their places on the track ropes.

    Args:
        scenario: of the twin.
        motion: of carriages by their arc length, and of drives by the length of rope that has passed them.

    Returns:
        The values, and for each drive the reading (m) of the plant's encoder where the twin's encoder begins with 0.
    """
    values: dict[str, Any] = {}
    offsets: dict[str, float] = {}
    for name, (place, speed) in motion.items():
        if name in scenario.carriages:
            values |= {f"carriages.{name}.arc_length": place, f"carriages.{name}.speed": speed}
        elif name in scenario.drives:
            offsets[name] = place
            values[f"drives.{name}.speed"] = speed
            values |= _gone_by(scenario, name, place)
    return values, offsets


def start_of(scenario: Scenario, name: str) -> float:
    """Place (m) at which the encoder of a carriage or drive begins in a scenario."""
    return scenario.carriages[name].arc_length if name in scenario.carriages else 0.0


def has_moved(scenario: Scenario, motion: Motion) -> bool:
    """Whether a plant is not where its scenario begins, so that its towers hold the rope by an unknown friction."""
    return any(speed != 0.0 or abs(place - start_of(scenario, name)) > MOVED for name, (place, speed) in motion.items())


def with_offsets(
    readings: Mapping[str, Reading], scenario: Scenario, offsets: Mapping[str, float]
) -> dict[str, Reading]:
    """Readings of encoders by name with the offsets (m) of their drives, as `values_at` returns them."""
    of = {name: scenario.sensors[name].of for name in readings if scenario.sensors[name].kind == "encoder"}
    return {name: readings[name]._replace(offset=offsets.get(drive, 0.0)) for name, drive in of.items()}


def _gone_by(scenario: Scenario, drive: str, place: float) -> dict[str, Any]:
    """Scenario values by dotted key of a drive and its vehicles after a length (m) of rope has passed the drive."""
    values: dict[str, Any] = {}
    if (travel := scenario.drives[drive].travel) is not None:
        values[f"drives.{drive}.travel"] = [travel[0] - place, travel[1] - place]
    if scenario.carriers is not None:
        first = scenario.carriers.first
        first = 0.5 * scenario.spacing if first is None else first
        values["carriers.first"] = float((first + place) % scenario.loop_length)
    for name, one in scenario.carriages.items():
        if not one.clamped_to:
            continue
        key, ropes = f"carriages.{name}", scenario.ropes
        strand, track = (ropes[rope].ends for rope in (next(iter(one.clamped_to)), scenario.rope_of(one)))
        along, beside = (np.subtract(ends["end"].position, ends["start"].position) for ends in (strand, track))
        length = ropes[scenario.rope_of(one)].unstrained_length
        moved = one.arc_length + place * float(np.sign(along @ beside))
        margin = 0.5 * min(one.arc_length, length - one.arc_length)
        values[f"{key}.arc_length"] = float(np.clip(moved, margin, length - margin))
        values |= {f"{key}.clamped_to.{rope}": at + place for rope, at in one.clamped_to.items()}
    return values


__all__ = ["Motion", "has_moved", "start_of", "values_at", "with_offsets"]
