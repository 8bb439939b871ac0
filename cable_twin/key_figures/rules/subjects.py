"""Roles of the things in a scenario, by which a rule names what it is about."""

from __future__ import annotations

from cable_twin.key_figures.stops import groups_of
from cable_twin.scenario import Scenario

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


def rope_role(scenario: Scenario, rope: str) -> str:
    """Role of a rope: track_ropes, haul_ropes or carrying_hauling_ropes."""
    alone = scenario.of_rope(rope)
    if alone.hauls:
        return "haul_ropes"
    return "carrying_hauling_ropes" if alone.strand is not None or alone.drives else "track_ropes"


def has_role(scenario: Scenario, role: str, subject: str) -> bool:
    """Whether the subject of a figure has a role; a part of a rope, as a span, has that of its rope."""
    kind, _, name = subject.partition(".")
    if role == "pairs":
        return "+" in subject and kind != "ropes"
    if role == "line":
        return subject == "line"
    if role.endswith("ropes"):
        own = rope_role(scenario, name.partition(".")[0]) if kind == "ropes" else ""
        return bool(own) and (role in ("ropes", own) or (role == "moving_ropes" and own != "track_ropes"))
    if role.endswith("towers") or role == "saddles":
        return kind == "towers" and name in scenario.towers and _tower_has(scenario, role, name)
    if role == "drives":
        return kind == "drives" if scenario.drives else subject in {one.subject.key for one in groups_of(scenario)}
    if role == "vehicles":
        return subject in {one.subject.key for one in groups_of(scenario)}
    if role == "drive_bullwheels":
        return kind == "sheaves" and any(drive.sheave == name for drive in scenario.drives.values())
    return kind == "sheaves" and "." not in name


def _tower_has(scenario: Scenario, role: str, name: str) -> bool:
    tower = scenario.towers[name]
    on_track = rope_role(scenario, scenario.rope_of(tower)) == "track_ropes"
    return {
        "towers": True,
        "track_towers": on_track,
        "saddles": on_track and tower.kind == "saddle",
        "sheave_towers": not on_track and tower.kind == "sheaves",
        "hold_down_towers": tower.hold_down,
    }[role]
