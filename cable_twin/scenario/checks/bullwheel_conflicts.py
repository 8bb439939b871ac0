"""Consistency checks of bullwheels, loops and their carriers."""

from __future__ import annotations

from collections.abc import Iterator
from math import dist, hypot

from cable_twin.scenario.checks.fault import Fault, KeyPath, name_faults, refuse
from cable_twin.scenario.checks.vehicle_conflicts import initial_speed
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.bullwheels import Sheave
from cable_twin.scenario.sections.carriers import CarrierPayload, Carriers
from cable_twin.scenario.sections.quantities import in_space

APART = 0.05  # of the diameter, by which joined ends may be further apart


def bullwheel_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of bullwheels, drives, loops and carriers in a scenario of several ropes."""
    joined: dict[str, str] = {}
    sound = True
    for name, sheave in scenario.sheaves.items():
        path: KeyPath = ("sheaves", name)
        yield from name_faults(("sheaves", name))
        faults = list(_joins(scenario, path, sheave, joined))
        sound = sound and not faults
        yield from faults
        if sheave.counterweight and sheave.hydraulics:
            yield Fault((*path, "hydraulics"), "given beside a counterweight; allowed: only one of the two")
        for key in ("counterweight", "hydraulics"):
            device = getattr(sheave, key)
            if device is not None and not device.travel[0] < device.travel[1]:
                yield Fault((*path, key, "travel"), f"given {list(device.travel)}; allowed: least, then most, in m")
            if device is not None and not any(device.direction):
                yield Fault((*path, key, "direction"), "given a vector of length 0; allowed: a direction")
        if sheave.rollback is not None and name not in {drive.sheave for drive in scenario.drives.values()}:
            yield refuse((*path, "rollback"), sheave.rollback, "null", detail=" m, but no drive turns it")
        if not faults:
            yield from _placed(scenario, path, sheave)
            yield from _pulled(scenario, path, sheave)
    yield from _drives(scenario)
    if sound and scenario.sheaves:
        yield from _loops(scenario)
    if scenario.carriers is not None:
        yield from _riders(scenario, scenario.carriers)


def _joins(scenario: Scenario, path: KeyPath, sheave: Sheave, joined: dict[str, str]) -> Iterator[Fault]:
    """Faults of joined ends: unknown ends, or ends joined by another bullwheel."""
    for number, (end, side) in enumerate(zip(sheave.joins, ("end", "start"), strict=True)):
        rope, _, which = end.partition(".")
        where = (*path, "joins", number)
        if rope not in scenario.ropes or which != side:
            known = ", ".join(f"{name}.{side}" for name in scenario.ropes)
            yield refuse(where, end, f"{known}, as rope runs from an end to the start of the next one")
        elif end in joined:
            yield refuse(where, end, "each end once", detail=f", which {joined[end]!r} joins already")
        elif getattr(scenario.ropes[rope], side).support != "pinned":
            given = getattr(scenario.ropes[rope], side).support
            yield refuse(("ropes", rope, side, "support"), given, "pinned", detail=" at a bullwheel")
        joined.setdefault(end, str(path[1]))


def _placed(scenario: Scenario, path: KeyPath, sheave: Sheave) -> Iterator[Fault]:
    """Faults of geometry: ends away from the rim, and joined strands of different rope."""
    ropes = [scenario.ropes[end.partition(".")[0]] for end in sheave.joins]
    ends = [in_space(ropes[0].end.position), in_space(ropes[1].start.position)]
    if scenario.dim == 3:  # there ropes are beside each other, and not just drawn so
        names = [end.partition(".")[0] for end in sheave.joins]
        ends = [scenario.placed(name, end) for name, end in zip(names, ends, strict=True)]
    wide = 2.0 * sheave.radius * (1.0 + APART)
    if (apart := dist(*ends)) > wide:
        yield Fault(
            (*path, "joins"),
            f"given ends that are {apart:.4g} m apart; allowed: at most the diameter of {2.0 * sheave.radius:g} m",
        )
    if sheave.position is not None:
        for end in ends:
            if (apart := dist(in_space(sheave.position), end)) > 0.5 * wide:
                yield Fault(
                    (*path, "position"),
                    f"given {list(sheave.position)}, {apart:.4g} m from an end that it joins; allowed: at most its "
                    f"radius of {sheave.radius:g} m, or null",
                )
                break
    first, second = (end.partition(".")[0] for end in sheave.joins)
    for key, unit in (("mass_per_length", "kg/m"), ("axial_stiffness", "N")):
        here, there = (getattr(rope, key) for rope in ropes)
        if here != there:
            yield refuse(
                ("ropes", second, key),
                there,
                "equal values, as it is one rope",
                detail=f" {unit}, joined by {path[1]!r} to {first!r} with {here!r}",
            )


def _pulled(scenario: Scenario, path: KeyPath, sheave: Sheave) -> Iterator[Fault]:
    """Fault of a tensioning device that pulls along with its strands instead of against them."""
    if sheave.tensioning is None or not any(sheave.tensioning.direction):
        return
    ropes = [scenario.ropes[end.partition(".")[0]] for end in sheave.joins]
    here = [in_space(ropes[0].end.position), in_space(ropes[1].start.position)]
    there = [in_space(ropes[0].start.position), in_space(ropes[1].end.position)]
    away = [sum(places) for places in zip(*here, *([-x for x in one] for one in there), strict=True)]
    direction = in_space(sheave.tensioning.direction)
    if (length := hypot(*away)) > 0.0 and sum(a * b for a, b in zip(away, direction, strict=True)) <= 0.0:
        outward = [round(x / length, 3) for x in (away if len(sheave.tensioning.direction) == 3 else away[::2])]
        yield Fault(
            (*path, "counterweight" if sheave.counterweight else "hydraulics", "direction"),
            f"given {list(sheave.tensioning.direction)}, which does not pull against its strands; allowed: away from "
            f"their other ends, about {outward}",
        )


def _drives(scenario: Scenario) -> Iterator[Fault]:
    """Faults of drives: without a bullwheel, or two on one bullwheel."""
    turned: dict[str, str] = {}
    for name, drive in scenario.drives.items():
        path: KeyPath = ("drives", name)
        yield from name_faults(("drives", name))
        known = ", ".join(scenario.sheaves) or "none, there are no sheaves"
        if drive.sheave is None:
            yield Fault((*path, "sheave"), f"not given, with several ropes; allowed: {known}")
        elif drive.sheave not in scenario.sheaves:
            yield refuse((*path, "sheave"), drive.sheave, known)
        elif drive.sheave in turned:
            yield refuse(
                (*path, "sheave"), drive.sheave, "one drive for each", detail=f", which {turned[drive.sheave]!r} turns"
            )
        else:
            turned[drive.sheave] = name
        if name in scenario.carriages:
            yield Fault(path, "given the name of a carriage; allowed: another one, as commands address both by name")
        yield from initial_speed(path, drive.speed, drive.limits.speed)
        if drive.travel is not None and not drive.travel[0] <= 0.0 <= drive.travel[1] != drive.travel[0]:
            yield Fault(
                (*path, "travel"),
                f"given {list(drive.travel)}; allowed: least, then most, in m, with 0 of the start between them",
            )
        for key in ("force", "power", "deceleration"):
            given = getattr(drive.limits, key)
            if given is not None:
                yield refuse((*path, "limits", key), given, "null at the drive of a bullwheel")


def _loops(scenario: Scenario) -> Iterator[Fault]:
    """Faults of strands outside a closed loop, and of ropes without vehicle or coupling."""
    strands = scenario.strands
    for name, sheave in scenario.sheaves.items():
        for end in sheave.joins:
            rope = end.partition(".")[0]
            if rope not in strands:
                yield refuse(
                    ("sheaves", name, "joins"),
                    end,
                    "sheaves that join strand to strand until the first one comes again",
                    detail=f", but {rope!r} is not on a closed loop",
                )
                return
    used = {rope for rod in scenario.connectors.values() for rope, _ in rod.ends}
    used |= {one.rope for one in scenario.pantographs.values()} | set(strands)
    used |= {one.rope or next(iter(scenario.ropes)) for one in scenario.carriages.values()}
    used |= set(scenario.carriers.tracks.values()) if scenario.carriers else set()
    for rope in scenario.ropes:
        if rope not in used:
            yield Fault(
                ("ropes", rope),
                "given, but no vehicle can reach it and nothing joins it to another rope; allowed: leave it out",
            )


def _riders(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Faults of carriers without a loop or too many for its length, and of loads at unknown stations."""
    if not scenario.strands:
        yield Fault(("carriers",), "given for ropes that stand still; allowed: with sheaves that join them to a loop")
        return
    loop = scenario.loop_length
    if carriers.spacing is not None and carriers.count * carriers.spacing > loop * (1.0 + 1e-9):
        yield refuse(
            ("carriers", "count"),
            carriers.count,
            f"at most the loop of {loop:.6g} m",
            detail=f" every {carriers.spacing:.9g} m, {carriers.count * carriers.spacing:.6g} m",
        )
    rooms: dict[KeyPath, CarrierPayload | None] = {("carriers", "payload"): carriers.payload}
    rooms |= {("carriers", "kinds", name, "payload"): kind.payload for name, kind in carriers.kinds.items()}
    for path, room in rooms.items():
        for name, mass in (room.leaving if room else {}).items():
            if name not in scenario.sheaves:
                yield Fault((*path, "leaving", name), f"no such bullwheel; allowed: {', '.join(scenario.sheaves)}")
            elif room and not 0.0 <= mass <= room.capacity:
                yield refuse((*path, "leaving", name), mass, f"0 to {room.capacity:g} kg")


__all__ = ["bullwheel_faults"]
