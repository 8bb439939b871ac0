"""Limits of key figures: one table with unit, bound, default, source and clause of each.

The table of all quantities, `key_figures/quantities.py`, refers to it by key.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, cast

from pydantic import Field

from cable_twin.scenario.sections.quantities import FromList, Section, quantity

Bound = Literal["at most", "at least"]
SAFETY = "EN 12927 and CEN practice: 3.15 to 3.5 track rope, 4.5 to 5 haul rope"
VORARLBERG = "Vorarlberg's ordinance on ropeways (RIS LVB20000550)"
TOUCHES = "assumed: nothing may touch the ground"


def limit(
    unit: str,
    description: str,
    default: float | None = None,
    *,
    bound: Bound = "at most",
    source: str = "",
    clause: str = "",
    **bounds: float,
) -> Any:
    """Schema field for the limit of a key figure; null without a limit.

    Args:
        unit: SI unit, "-" for a plain number.
        description: meaning, without the unit, which is added.
        default: default value.
        bound: side of the limit on which the figure has to be.
        source: source of the default: a standard, or an assumption with its reason.
        clause: paragraph of the standard, with its number.
        **bounds: `gt`, `ge`, `lt` and `le`, as pydantic has them.

    Returns:
        The pydantic field.
    """
    extra: dict[str, Any] = {"unit": unit, "bound": bound, "source": source} | ({"clause": clause} if clause else {})
    return Field(default, description=f"{description} ({unit})", json_schema_extra=extra, **cast(Any, bounds))


class Installation(Section):
    """Properties of the installation on which rules depend and which the model does not have; null: not stated."""

    carries: Literal["persons", "goods"] | None = Field(default=None, description="load that is carried")
    existing: bool | None = Field(default=None, description="true: it stood before the rule came into force")
    grip: Literal["fixed", "detachable"] | None = Field(default=None, description="grip of carriers on a moving rope")
    vehicle: Literal["chair", "closed", "open"] | None = Field(
        default=None, description="kind of vehicle: chair, closed car, or open car"
    )
    persons: int | None = quantity("-", "persons in a vehicle, or seats of a chair", None, ge=1, le=500)
    passengers: Literal["skiers", "pedestrians"] | None = Field(default=None, description="passengers that board")
    attended: bool | None = Field(default=None, description="true: an attendant rides in each car")
    loading_aid: bool | None = Field(default=None, description="true: passengers are helped to board and to leave")
    turn_at_loading: bool | None = Field(
        default=None, description="true: passengers turn where they board, skiers by 30 degrees, others by 90 or more"
    )
    automatic_deceleration_control: bool | None = Field(
        default=None, description="true: the drive's deceleration is watched and controlled automatically"
    )
    swing_damper: bool | None = Field(default=None, description="true: a damper on the swing along the track")
    lining: Literal["none", "leather_or_wood", "rubber"] | None = Field(
        default=None, description="lining of the grooves of bullwheels"
    )
    ground: Literal["drivable", "undrivable", "road"] | None = Field(
        default=None, description="ground under the line where clearance is least"
    )
    fenced: bool | None = Field(default=None, description="true: the ground under the line is fenced off there")
    snow: float | None = quantity("m", "depth of snow on the terrain, as a rule has it", None, ge=0, le=50)
    wheels: int | None = quantity("-", "wheels of a vehicle on its track rope", None, ge=1, le=200)
    grip_force: float | None = quantity("N", "pull at which a grip or clamp slips on the rope", None, gt=0)


class KeyFigureLimits(Section):
    """Limits of key figures; null is no limit unless the key says otherwise."""

    rope_safety_factor: float | None = limit(
        "-",
        "lowest breaking force over tension; null: 3.15, and 4.5 for a rope that moves; 0: no limit",
        bound="at least",
        source=SAFETY,
        ge=0,
    )
    haul_rope_safety_factor: float | None = limit(
        "-",
        "lowest breaking force over tension of a haul rope beside track ropes",
        4.5,
        bound="at least",
        source=SAFETY,
        gt=0,
    )
    tension_per_transverse_load: float | None = limit(
        "-",
        "lowest tension over transverse load; null: 10 for carriages that roll on the rope, no limit for clamped ones; "
        "0: no limit",
        bound="at least",
        source="CEN practice for carriages that roll on a track rope, at least 10",
        ge=0,
    )
    swing: float | None = limit(
        "rad",
        "highest swing of a carriage along the track",
        0.35,
        source="assumed: clearance usually allows for 0.35 rad (20 deg)",
        gt=0,
        le=3.14,
    )
    lateral_swing: float | None = limit(
        "rad",
        "highest swing across the track, in space",
        0.1974,  # atan(0.2): inclinations in % are tangents, as France's rules of 1985 say in art. 24
        source=VORARLBERG,
        clause="section 6: 20 % across, 11.31 deg",
        gt=0,
        le=1.57,
    )
    tower_clearance: float | None = limit(
        "m",
        "least distance of a vehicle from a mast, in space",
        0.5,
        bound="at least",
        source=VORARLBERG,
        clause="section 6: 0.5 m to the side",
        ge=0,
    )
    vehicle_separation: float | None = limit(
        "m",
        "least distance of vehicles on different ropes from each other, in space",
        1.0,
        bound="at least",
        source="assumed: reach of a passenger who leans out, with a reserve",
        ge=0,
    )
    acceleration: float | None = limit(
        "m/s^2",
        "highest acceleration of the last body of a carriage",
        1.5,
        source="assumed: emergency stops usually have 1 to 1.5 m/s^2",
        gt=0,
    )
    stopping_distance: float | None = limit("m", "longest stopping distance", gt=0)
    stopping_time: float | None = limit("s", "longest stopping time", gt=0)
    sag: float | None = limit("m", "largest depth of the cable below its chord, of each span", gt=0)
    dynamic_amplification: float | None = limit("-", "highest tension over the initial tension", gt=0)
    rope_clearance: float | None = limit(
        "m", "least height of the cable over the terrain", 0.0, bound="at least", source=TOUCHES, ge=0
    )
    vehicle_clearance: float | None = limit(
        "m", "least height of a vehicle over the terrain", 0.0, bound="at least", source=TOUCHES, ge=0
    )
    support_load: float | None = limit("N", "highest force of the cable on a support", gt=0)
    deropement_margin: float | None = limit(
        "-",
        "least load of a tower over its load in equilibrium",
        0.1,
        bound="at least",
        source="assumed: a tenth of the load in equilibrium; the cable lifts off at 0",
        ge=0,
        le=1,
    )
    roller_load: float | None = limit(
        "N",
        "least load of a sheave of a tower, as the mean of all its sheaves",
        500.0,
        bound="at least",
        source="assumed: 500 N on each sheave, so that a swinging rope stays on it",
        ge=0,
    )
    energy_lost: float | None = limit(
        "-",
        "largest energy lost or gained by the solver in 5 s, over the kinetic energy exchanged",
        0.005,
        source="assumed: equivalent to a damping ratio of 0.08 %, less than that of the rope itself",
        gt=0,
    )
    profile: Annotated[tuple[str, ...], FromList] = Field(
        default=(),
        description="rule profiles that figures are judged by beside these limits; `rules` lists them",
        json_schema_extra={"allowed": "a list of names that `rules` lists, or of paths of YAML files of the same form"},
    )
    installation: Installation = Field(default_factory=Installation, description="what rules ask of the installation")
    load_cases: Annotated[tuple[str, ...], FromList] = Field(
        default=(),
        description="load cases of profiles that this scenario models, as in france_1985.uplift",
        json_schema_extra={"allowed": "a list of PROFILE.LOAD_CASE, of the given profiles"},
    )


class LimitRow(NamedTuple):
    """Limit of a key figure in the table of limits: unit, bound, default, source and clause."""

    meaning: str
    unit: str
    bound: Bound
    default: float | None
    source: str
    clause: str = ""

    @property
    def text(self) -> str:
        """Source of a default limit with its clause; empty without a default."""
        return ", ".join(filter(None, (self.source, self.clause)))


@cache
def limit_row(key: str) -> LimitRow:
    """Row of the table of limits for a key of `limits`."""
    field = KeyFigureLimits.model_fields[key]
    extra = cast(dict[str, Any], field.json_schema_extra)
    meaning = str(field.description).removesuffix(f" ({extra['unit']})")
    return LimitRow(meaning, default=field.default, **extra)
