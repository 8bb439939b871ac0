"""Roles of ropes, towers and vehicles of a scenario, by which a rule names its subjects."""

from __future__ import annotations

from itertools import pairwise

from cable_twin.key_figures.stops import groups_of
from cable_twin.scenario import Scenario, in_space

ROLES = {
    "ropes": "every rope",
    "track_ropes": "ropes on which vehicles roll",
    "haul_ropes": "ropes that pull vehicles along track ropes",
    "moving_ropes": "ropes that pull vehicles, or carry and pull them",
    "carrying_hauling_ropes": "ropes that carry and pull their vehicles",
    "towers": "every tower",
    "track_towers": "towers of track ropes",
    "saddles": "towers of track ropes that are saddles",
    "sheave_towers": "towers with sheaves, of ropes that move",
    "hold_down_towers": "towers that hold the rope down",
    "vehicles": "carriages, and all carriers as one",
    "drives": "drives of ropes, else those of carriages",
    "bullwheels": "every bullwheel",
    "drive_bullwheels": "bullwheels with a drive",
    "pairs": "pairs of vehicles that pass each other",
    "line": "the line as a whole",
}


def rope_roles(scenario: Scenario) -> dict[str, str]:
    """Role of each rope by name: track_ropes, haul_ropes or carrying_hauling_ropes."""
    strands = scenario.strands
    moving = set(strands) if scenario.sheaves else set(scenario.cables) if scenario.drives else set()
    pulling = "haul_ropes" if len(strands) and len(moving) < len(scenario.cables) else "carrying_hauling_ropes"
    return {rope: pulling if rope in moving else "track_ropes" for rope in scenario.cables}


def _chords(corners: list[tuple[float, ...]]) -> list[tuple[float, float, float]]:
    """Vectors (3,) in m of the chords between successive corners (supports) of a rope."""
    return [(end[0] - start[0], end[1] - start[1], end[2] - start[2]) for start, end in pairwise(corners)]


class Subjects:
    """Subjects of the key figures of a scenario: ropes, towers and vehicles with their roles, chords and supports.

    Attributes:
        rope_roles: role of each rope.
        groups: carriages, and all carriers as one.
        vehicles: all vehicles by name.
        spacing: m, of carriers; 0 without them.
        chords: vectors (3,) in m from support to support, of each rope.
        supports: names of the supports along each rope: start, towers, end.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, self.rope_roles = scenario, rope_roles(scenario)
        self.groups, self.vehicles, self.spacing = groups_of(scenario), scenario.vehicles, scenario.spacing
        ropes = {rope: scenario.of_rope(rope) for rope in scenario.cables}
        self.supports = {rope: ("start", *alone.towers, "end") for rope, alone in ropes.items()}
        self.chords = {rope: _chords([*map(in_space, alone.corners)]) for rope, alone in ropes.items()}
        self._vehicles = {one.subject.key for one in self.groups}
        self._haul_ropes = {scenario.haul_rope_key(name) for name in scenario.haul_ropes}
        self._driven = {drive.sheave for drive in scenario.drives.values()}

    def has(self, role: str, subject: str) -> bool:
        """Whether the subject of a key figure has a role; a part of a rope, as a span, has the role of its rope."""
        kind, _, name = subject.partition(".")
        if role == "pairs":
            return "+" in subject and kind != "ropes"
        if role == "line":
            return subject == "line"
        if role.endswith("ropes"):
            own = self.rope_roles.get(name.partition(".")[0], "") if kind == "ropes" else ""
            own = "haul_ropes" if subject in self._haul_ropes else own
            return bool(own) and (role in ("ropes", own) or (role == "moving_ropes" and own != "track_ropes"))
        if role.endswith("towers") or role == "saddles":
            return kind == "towers" and name in self._scenario.towers and self._tower_has(role, name)
        if role == "drives" and self._scenario.drives:
            return kind == "drives"
        if role in ("vehicles", "drives"):
            return subject in self._vehicles
        return kind == "sheaves" and "." not in name and (role == "bullwheels" or name in self._driven)

    def _tower_has(self, role: str, name: str) -> bool:
        tower = self._scenario.towers[name]
        on_track = self.rope_roles[self._scenario.rope_of(tower)] == "track_ropes"
        return {
            "towers": True,
            "track_towers": on_track,
            "saddles": on_track and tower.kind == "saddle",
            "sheave_towers": not on_track and tower.kind == "sheaves",
            "hold_down_towers": tower.hold_down,
        }[role]
