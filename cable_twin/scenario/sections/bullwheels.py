"""Bullwheels joining strands of rope to a loop: section `sheaves` of a scenario file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from cable_twin.scenario.checks.fault import Fault, KeyPath, refuse
from cable_twin.scenario.sections.drives import Brake
from cable_twin.scenario.sections.quantities import FromList, Place, Section, Vector, quantity

EDGE = 0.005  # of a strand, at both ends, where what rides it is in a station at the start
FILE_SECTIONS = "sheaves", "towers", "ropes"
ROPES_EXAMPLE = "{up: {}, down: {}}"
Joined = Annotated[tuple[str, str], FromList]


class SheaveCounterweight(Section):
    """Counterweight: pulls the carriage of a bullwheel, and with it both strands, with a constant force."""

    direction: Place = quantity("-", "direction in which it pulls, any length")
    mass: float = quantity("kg", "mass of the counterweight, of both strands together", gt=0)
    force: float | None = quantity("N", "its pull on the carriage; its weight where none is given", None, gt=0)
    carriage_mass: float = quantity("kg", "mass of the bullwheel and what it runs on", 0.0, ge=0)
    travel: Vector = quantity("m", "least and most travel of the carriage in that direction", (-5.0, 5.0))
    buffer_damping: float = quantity(
        "s/m", "damping of the buffers at both limits: force = stiffness d (1 + damping d_dot)", 1.0, ge=0
    )


class SheaveHydraulics(Section):
    """Hydraulic cylinder: moves the carriage of a bullwheel when the pull of both strands has left a band."""

    direction: Place = quantity("-", "direction in which it pulls, any length")
    force: float = quantity("N", "the pull that it keeps, of both strands together", gt=0)
    band: float = quantity("N", "by which the pull may be off before it moves", gt=0)
    rate: float = quantity("m/s", "its speed when it does", 0.01, gt=0)
    travel: Vector = quantity("m", "least and most travel of the carriage in that direction", (-5.0, 5.0))
    locked: bool = Field(default=False, description="it has failed and holds the carriage where it starts")


class Sheave(Section):
    """Bullwheel: turns the rope from the end of one strand to the start of another one."""

    position: Place | None = quantity("m", "its middle; null: midway between the ends that it joins", None)
    radius: float = quantity("m", "its radius", gt=0)
    joins: Joined = Field(
        description="the end of one rope and the start of another: [up.end, down.start]",
        json_schema_extra={"allowed": "a list of two texts, ROPE.end and ROPE.start"},
    )
    wrap: float = quantity("rad", "angle over which the rope lies on it", pi, gt=0, le=20)
    friction: float = quantity("-", "friction of the rope on its lining", 0.22, gt=0, le=2)
    inertia: float = quantity("kg m^2", "moment of inertia of all that turns with it, about its axis", gt=0)
    resistance: float = quantity("N m", "torque that its bearings take", 0.0, ge=0)
    counterweight: SheaveCounterweight | None = Field(default=None, description="weight that tensions the loop")
    hydraulics: SheaveHydraulics | None = Field(default=None, description="cylinder that tensions the loop")
    brake: Brake | None = Field(
        default=None, description="brake on it, force at the rim, which an emergency stop applies instead of the drive"
    )

    rollback: float | None = quantity(
        "m",
        "way back, against the sense in which its drive turned it last, after which an emergency stop begins where no "
        "drive holds it to a speed; null: none",
        None,
        gt=0,
    )

    @property
    def wrapped(self) -> float:
        """Length (m) of rope on the bullwheel."""
        return self.radius * self.wrap

    @property
    def tensioning(self) -> SheaveCounterweight | SheaveHydraulics | None:
        """Tensioning device of the bullwheel; None for a fixed one."""
        return self.counterweight or self.hydraulics


class Strand(NamedTuple):
    """Position of a strand on its loop, with the bullwheels at its ends."""

    loop_length: float  # m, unstrained
    offset: float  # m, place on the loop of its start
    before: str  # the bullwheel off which rope comes onto its start
    after: str  # and that onto which its end runs


class Riding(NamedTuple):
    """Track rope of carriers: strand of the carriers' clamps, and position of the strand on its loop."""

    strand: str  # to which they are clamped there
    length: float  # m, of that
    loop_length: float  # m, unstrained
    offset: float  # m, place on the loop of the start of the strand

    def on_track(self, place: float) -> bool:
        """Return whether a vehicle at a `place` (m) of the strand is on the track, not in a station."""
        return EDGE < place / self.length < 1.0 - EDGE


def strands_of(lengths: Mapping[str, float], sheaves: Mapping[str, Sheave]) -> dict[str, Strand]:
    """Strands of each closed loop, in order along the loop.

    Args:
        lengths: unstrained length (m) of each rope by name.
        sheaves: by name.
    """
    onto = {sheave.joins[0]: name for name, sheave in sheaves.items()}
    found: dict[str, Strand] = {}
    for first in lengths:
        loop: list[tuple[str, float, str]] = []
        rope, place = first, 0.0
        while rope not in found and f"{rope}.end" in onto and rope not in [name for name, _, _ in loop]:
            if rope not in lengths:
                break  # a fault of its own
            sheave = onto[f"{rope}.end"]
            loop.append((rope, place, sheave))
            place += lengths[rope] + sheaves[sheave].wrapped
            rope = sheaves[sheave].joins[1].partition(".")[0]
        if loop and rope == first:
            befores = [loop[-1][2], *(sheave for _, _, sheave in loop)]
            for (name, offset, after), before in zip(loop, befores, strict=False):
                found[name] = Strand(place, offset, before, after)
    return found


def faults_in_file(data: dict[str, Any]) -> Iterator[Fault]:
    """Faults of keys that exist in a file only and are rewritten by `expand_bullwheels`."""
    sheaves, towers, ropes = (given if isinstance(given := data.get(key), dict) else {} for key in FILE_SECTIONS)
    drives = data.get("drives")
    called = set(drives if isinstance(drives, dict) else ())
    for name, sheave in sheaves.items():
        if not isinstance(sheave, dict) or "drive" not in sheave:
            continue
        drive, path = sheave["drive"], ("sheaves", name, "drive")
        if not isinstance(drive, dict):
            yield refuse(path, drive, "a mapping with the keys of a drive")
        elif not isinstance(drive.get("name"), str | None) or drive.get("name") == "":
            yield refuse((*path, "name"), drive["name"], "a text, not empty")
        elif (own := drive.get("name") or name) in called:
            yield refuse((*path, "name"), own, "another name", detail=", as another drive is called")
        else:
            called.add(own)
    for name, tower in towers.items():
        if isinstance(tower, dict) and "ropes" in tower:
            yield from _faults_of_tower(name, tower["ropes"], towers, ropes)


def _faults_of_tower(name: str, own: Any, towers: dict[str, Any], ropes: dict[str, Any]) -> Iterator[Fault]:
    """Faults of the keys that a tower has for each of its ropes."""
    path: KeyPath = ("towers", name, "ropes")
    if not isinstance(own, dict):
        yield refuse(path, own, f"a mapping of ropes to what is another there: {ROPES_EXAMPLE}")
        return
    for rope, differs in own.items():
        if rope not in ropes:
            yield Fault((*path, rope), f"no such rope; allowed: {', '.join(ropes) or 'none, there is one cable'}")
        elif differs is not None and not isinstance(differs, dict):
            yield refuse((*path, rope), differs, "a mapping of keys of a tower, or null")
        elif f"{name}_{rope}" in towers:
            yield Fault((*path, rope), f"it is called '{name}_{rope}', as another tower is; allowed: another name")
        else:
            for key in {"rope", "ropes"} & (differs := differs or {}).keys():
                yield refuse((*path, rope, key), differs[key], f"nothing, {rope!r} is the rope")


def expand_bullwheels(data: dict[str, Any]) -> dict[str, Any]:
    """Move drives of bullwheels to `drives`, and split towers of several ropes into one tower per rope."""
    sheaves, drives = data.get("sheaves"), data.get("drives", {})
    if isinstance(sheaves, dict) and isinstance(drives, dict):
        plain, drives = {}, dict(drives)
        for name, sheave in sheaves.items():
            plain[name] = sheave
            if isinstance(sheave, dict) and isinstance(sheave.get("drive"), dict):
                plain[name] = {key: value for key, value in sheave.items() if key != "drive"}
                given = dict(sheave["drive"])
                called = given.pop("name", None) or name
                drives[called] = {"kind": "moving_cable", "sheave": name, **given}
        data = {**data, "sheaves": plain} | ({"drives": drives} if drives else {})
    towers = data.get("towers")
    if isinstance(towers, dict):
        plain = {}
        for name, tower in towers.items():
            ropes = tower.get("ropes") if isinstance(tower, dict) else None
            if not isinstance(ropes, dict):
                plain[name] = tower
                continue
            common = {key: value for key, value in tower.items() if key != "ropes"}
            for rope, own in ropes.items():
                plain[f"{name}_{rope}"] = {**common, **(own or {}), "rope": rope}
        data = {**data, "towers": plain}
    return data
