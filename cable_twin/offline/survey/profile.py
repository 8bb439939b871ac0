"""Survey of a line: terrain and towers in x and z, and their checks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cable_twin.frame.records import FloatArray

FEET = {"m": 1.0, "ft": 0.3048, "us-ft": 1200.0 / 3937.0}  # m, international and US survey foot
NAME = re.compile("[a-zA-Z][a-zA-Z0-9_]*")
SHORTEST, LONGEST = 20.0, 100e3  # m of terrain; the longest ropeway had 96 km
HIGHEST = 500.0  # m of a rope on a tower over the ground; the highest towers of ropeways have 214 m


class SurveyError(ValueError):
    """Errors in survey data, one line each, with the file in front."""


@dataclass(frozen=True, slots=True)
class SurveyedTower:
    """Tower of a survey; None for data that the survey does not have.

    Attributes:
        name: of the tower.
        x: m, along the line.
        z: m, height of the rope on the tower.
        where: line or feature of the file, for faults.
        contacts: sheaves, or contact points of a saddle.
        length: m, along the rope, from the first contact to the last.
        radius: m, of the circle of the contacts.
        hold_down: whether the tower holds the rope down.
        rope_assumed: whether the height of the rope over the ground is assumed.
    """

    name: str
    x: float
    z: float
    where: str
    contacts: int | None = None
    length: float | None = None
    radius: float | None = None
    hold_down: bool | None = None
    rope_assumed: bool = False


@dataclass(frozen=True, slots=True)
class Survey:
    """Survey of a line in a vertical plane: terrain, towers, stations.

    Attributes:
        terrain: (points, 2) m, x and z.
        towers: from the start of the line to its end.
        stations: x and z (m) of the rope in the stations, `start` and `end`, where the survey has them.
        notes: lines about converted or left out data.
    """

    terrain: FloatArray
    towers: tuple[SurveyedTower, ...]
    stations: dict[str, tuple[float, float]]
    notes: tuple[str, ...] = ()

    def ground(self, x: float) -> float:
        """Height (m) of the ground at x (m)."""
        return float(np.interp(x, *self.terrain.T))


def _with_valid_names(towers: Sequence[SurveyedTower]) -> tuple[list[SurveyedTower], list[str]]:
    """Rename surveyed towers whose names are not valid in a scenario; returns all towers, and a line about renaming."""
    named, changed = [], []
    for number, tower in enumerate(towers, start=1):
        name = tower.name
        if not NAME.fullmatch(name):
            inner = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
            name = f"tower_{inner or number}"
            changed.append(f"{tower.name!r} is {name}")
        named.append(replace(tower, name=name))
    return named, [f"names of towers: {', '.join(changed)}"] if changed else []


def check_terrain(file: str, points: Sequence[tuple[str, float, float]]) -> FloatArray:
    """Check surveyed terrain points, given with their place in a file; returns the terrain (points, 2) in m.

    Raises:
        SurveyError: there are fewer than two points, x does not rise, or the terrain has the length of no ropeway.
    """
    terrain = np.array([[x, z] for _, x, z in points]).reshape(-1, 2)
    rises = np.diff(terrain[:, 0])
    if len(points) < 2:
        given = f"{len(points)} point{'' if len(points) == 1 else 's'}"
        raise SurveyError(f"{file}: given {given} of terrain; allowed: at least 2")
    if len(points) > 2 and np.all(rises < 0.0):
        raise SurveyError(
            f"{file}: given terrain from x = {terrain[0, 0]:g} m down to {terrain[-1, 0]:g} m; allowed: rising x, "
            "in m: the rows the other way round"
        )
    if faults := [
        f"{file}: {points[number + 1][0]}: given x = {terrain[number + 1, 0]:g} m after {terrain[number, 0]:g} m: the "
        "terrain folds back; allowed: rising x, in m"
        for number in np.flatnonzero(rises <= 0.0).tolist()
    ]:
        raise SurveyError("\n".join(faults))
    if not SHORTEST <= (length := float(terrain[-1, 0] - terrain[0, 0])) <= LONGEST:
        allowed = f"{SHORTEST:g} to {LONGEST:g} m, as its unit is m"
        raise SurveyError(f"{file}: given {length:g} m of terrain; allowed: {allowed}")
    return terrain


def surveyed(file: str, terrain: FloatArray, towers: Sequence[SurveyedTower], notes: Sequence[str]) -> Survey:
    """Survey of a line from its terrain and towers, checked; those called start and end are the stations.

    Args:
        file: of the towers, for faults and notes.
        terrain: (points, 2) m, x and z.
        towers: with the names that the file has.
        notes: lines about what was read.

    Raises:
        SurveyError: towers do not stand on the terrain in the order of x; a line for each fault.
    """
    stations = {one.name.lower(): (one.x, one.z) for one in towers if one.name.lower() in ("start", "end")}
    named, renamed = _with_valid_names([one for one in towers if one.name.lower() not in stations])
    survey = Survey(terrain, tuple(named), stations, (*notes, *(f"{file}: {one}" for one in renamed)))
    if faults := list(_tower_faults(survey)):
        raise SurveyError("\n".join(f"{file}: {fault}" for fault in faults))
    return survey


def _tower_faults(survey: Survey) -> Iterator[str]:
    towers, (first, last) = survey.towers, survey.terrain[[0, -1], 0]
    if len(towers) > 2 and all(after.x < before.x for before, after in pairwise(towers)):
        yield (
            f"given towers from {towers[0].name} at x = {towers[0].x:g} m down to {towers[-1].name} at "
            f"{towers[-1].x:g} m; allowed: towers in rising x, in m: the rows the other way round"
        )
        return
    for before, tower in pairwise(towers):
        if tower.x <= before.x:
            yield (
                f"{tower.where}: given {tower.name} at x = {tower.x:g} m after {before.name} at {before.x:g} m; "
                "allowed: towers in rising x, in m"
            )
    seen: set[str] = set()
    for tower in towers:
        if tower.name in seen:
            yield f"{tower.where}: given {tower.name} twice; allowed: each name once"
        seen.add(tower.name)
        if not first <= tower.x <= last:
            allowed = f"the terrain, {first:g} to {last:g} m"
            yield f"{tower.where}: given {tower.name} at x = {tower.x:g} m; allowed: {allowed}"
        elif tower.z <= (ground := survey.ground(tower.x)):
            yield (
                f"{tower.where}: given {tower.name} with its rope at z = {tower.z:g} m; allowed: above the ground, "
                f"{ground:.4g} m there (heights of towers and terrain are to have one datum)"
            )
        elif tower.z - ground > HIGHEST:
            yield (
                f"{tower.where}: given {tower.name} with its rope at z = {tower.z:g} m, {tower.z - ground:.4g} m above "
                f"the ground; allowed: at most {HIGHEST:g} m (terrain and towers are to have one datum and one unit)"
            )
