"""Stations of a surveyed line, and keys of towers and ropes common to scenarios of all kinds of ropeway."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey.marked import Marked, assumed, derived, given_number
from cable_twin.offline.survey.profile import Survey, SurveyedTower, SurveyError
from cable_twin.scenario.spans import Spans

INSIDE, ABOVE = 20.0, 6.0  # m, assumed place of a station: inside the terrain, and the rope over the ground

Place = tuple[float, float]
Why = tuple[str, bool]  # and whether it is assumed


class Ends(NamedTuple):
    """Ends of a surveyed line, at which the rope leaves the stations: x and z in m, with their origin."""

    start: Place
    end: Place
    start_why: Why
    end_why: Why


def ends_of(survey: Survey, start: Place | None, end: Place | None) -> Ends:
    """Find the ends of a surveyed line: given, surveyed, or assumed a little inside the terrain.

    Args:
        survey: terrain and towers.
        start: given x and z in m; None: as surveyed, else assumed.
        end: as `start`.

    Raises:
        SurveyError: an end is not on the terrain, or a tower is beyond it; one line.
    """
    places, whys = [], []
    for name, given, edge, inside in (
        ("start", start, survey.terrain[0, 0], INSIDE),
        ("end", end, survey.terrain[-1, 0], -INSIDE),
    ):
        if given is not None:
            places.append(given)
            whys.append(("m, given", False))
        elif name in survey.stations:
            places.append(survey.stations[name])
            whys.append(("m, survey", False))
        else:
            x = float(edge) + inside
            places.append((x, round(survey.ground(x) + ABOVE, 3)))
            whys.append((f"m: {INSIDE:g} m inside the terrain, {ABOVE:g} m over the ground", True))
    (first, _), (last, _) = places
    low, high = survey.terrain[[0, -1], 0]
    if not low <= first < last <= high:
        raise SurveyError(
            f"stations: given x = {first:g} m and {last:g} m; allowed: start before end on the terrain, "
            f"{low:g} to {high:g} m"
        )
    for tower in survey.towers:
        if not first < tower.x < last:
            raise SurveyError(
                f"stations: given x = {first:g} m and {last:g} m, and {tower.name} at {tower.x:g} m; allowed: towers "
                "between the stations (--start and --end set these)"
            )
    return Ends(places[0], places[1], whys[0], whys[1])


def lower_first(survey: Survey, ends: Ends) -> FloatArray:
    """Positions (corners, 2) in m of the ends and towers of a surveyed line; x is the distance from the lower end."""
    corner = np.array([ends.start, *((tower.x, tower.z) for tower in survey.towers), ends.end])
    if ends.end[1] < ends.start[1]:
        corner = corner[::-1].copy()
    corner[:, 0] = np.abs(corner[:, 0] - corner[0, 0])
    return corner


def terrain_along(terrain: FloatArray, x: float, sense: float) -> FloatArray:
    """Terrain (points, 2) in m, in rising distance from its end at `x` (m); `sense`: 1 or -1, along x or back."""
    found = terrain[:: int(sense)].copy()
    found[:, 0] = sense * (found[:, 0] - x)
    return found


def bends(spans: Spans) -> FloatArray:
    """Angles (spans - 1,) in rad by which a rope bends on its inner supports."""
    before, after = (np.arctan2(pull[:, 1], pull[:, 0]) for pull in (spans.pull_after[:-1], spans.pull[1:]))
    return np.asarray(np.abs(after - before))


def tower_keys(tower: SurveyedTower, contacts: int, pitch: float, radius: float) -> dict[str, Any]:
    """Scenario keys of a surveyed tower, assumed where the survey does not have them.

    Args:
        tower: of a survey.
        contacts: assumed number of contacts.
        pitch: m, between contacts.
        radius: m, of the circle of the contacts.
    """
    number = tower.contacts or contacts
    length = tower.length if tower.length is not None else round(number * pitch, 3)
    height = [tower.x, round(tower.z, 3)]
    return {
        "position": assumed(height, "m: height of the rope over the ground") if tower.rope_assumed else height,
        "contacts": derived(number, "survey") if tower.contacts else assumed(number, "for the bend of the loaded rope"),
        "length": derived(length, "m, survey") if tower.length is not None else assumed(length, f"m, {pitch:g} each"),
        "radius": derived(tower.radius, "m, survey")
        if tower.radius is not None
        else assumed(max(radius, round(length, 1)), "m"),
    }


def origin(place: Place, why: Why) -> Marked:
    """Mark the position of an end of a surveyed line with its origin."""
    return Marked(list(place), *why)


def given_rope(usual: Mapping[str, float], path: str, changes: Mapping[str, Any]) -> dict[str, float]:
    """Properties of a rope by key: usual values, replaced by given numbers of dotted keys below `path`.

    Raises:
        SurveyError: one of them is no number above 0; one line.
    """
    return {key: given_number(changes, f"{path}.{key}", value) for key, value in usual.items()}


def rope_keys(rope: Mapping[str, float], usual: Mapping[str, float], why: str) -> dict[str, Marked]:
    """Properties of a rope by key, marked as assumed where usual, else as given."""
    return {key: assumed(value, why) if value == usual[key] else derived(value, "given") for key, value in rope.items()}
