"""Consistency checks of bullwheels, loops and their carriers, connectors, clamps and pantographs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import dist, hypot

import numpy as np

from cable_twin.scenario.checks.fault import Fault, KeyPath, name_faults, refuse, show
from cable_twin.scenario.checks.vehicles import initial_speed
from cable_twin.scenario.command_limits import way_between_stops
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.couplings import Sheave
from cable_twin.scenario.sections.quantities import in_space
from cable_twin.scenario.sections.vehicles import CarrierPayload, Carriers

NAMES_SHOWN = 8


def unknown_rope_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of towers and carriages on unknown ropes."""
    for key, things in (("towers", scenario.towers), ("carriages", scenario.carriages)):
        for name, thing in things.items():
            if thing.rope is not None and thing.rope not in scenario.ropes:
                yield _unknown((key, name, "rope"), thing.rope, scenario)


def _unknown(path: KeyPath, rope: str, scenario: Scenario) -> Fault:
    names = [*scenario.ropes]
    known = ", ".join(names[:NAMES_SHOWN]) + (", ..." if len(names) > NAMES_SHOWN else "")
    return Fault(path, f"given the rope {show(rope)}; allowed: {known or 'null, there is one cable'}")


def connector_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of connectors: ends beyond the ropes, both ends on one rope, or crossing rods."""
    between: dict[tuple[str, str], list[tuple[float, float, str]]] = {}
    for name, rod in scenario.connectors.items():
        yield from name_faults(("connectors", name))
        places = {}
        for key, (rope, place) in zip(("from", "to"), rod.ends, strict=True):
            if rope not in scenario.ropes:
                yield _unknown(("connectors", name, key), rope, scenario)
                continue
            length = scenario.ropes[rope].unstrained_length
            places[rope] = place
            if not 0.0 < place < length:
                yield refuse(
                    ("connectors", name, key),
                    place,
                    f"above 0 and below {length:.9g} m, between its ends",
                    detail=f" on {rope!r}",
                )
                places.pop(rope)
        if len(places) == 1 and rod.ends[0][0] == rod.ends[1][0]:
            yield refuse(("connectors", name, "to"), rod.ends[1][0], "another rope than `from`", detail=" twice")
        elif len(places) == 2:
            order = [rope for rope in scenario.ropes if rope in places]
            between.setdefault((order[0], order[1]), []).append((places[order[0]], places[order[1]], name))
    for rods in between.values():
        for (_, before, one), (_, after, other) in pairwise(sorted(rods)):
            if after < before:
                yield Fault(("connectors", other), f"given across '{one}'; allowed: the same order on both ropes")


def clamp_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of clamps: to unknown ropes, to the carriage's own rope, beyond a rope, or at an occupied place."""
    taken: dict[tuple[str, float], str] = {}
    for name, carriage in scenario.carriages.items():
        path, own = ("carriages", name), carriage.rope or next(iter(scenario.ropes))
        clamped = carriage.clamped_to
        held = carriage.joint != "sliding" or carriage.drive.mode == "speed" or carriage.drive.haul_rope is not None
        if clamped and held:
            text = "given beside a joint or drive that holds it; allowed: one that slides, its drive free or a force"
            yield Fault((*path, "clamped_to"), text)
        if not clamped and any(carriage.clamp_offset):
            yield Fault((*path, "clamp_offset"), "given without a clamp; allowed: beside `clamped_to`")
        on = []
        for rope, place in clamped.items():
            if rope not in scenario.ropes:
                yield _unknown((*path, "clamped_to", rope), rope, scenario)
                continue
            if rope == own:
                yield refuse((*path, "clamped_to", rope), rope, "another rope", detail=", on which it slides")
            other = taken.setdefault((rope, place), name)
            if other != name:
                yield Fault(
                    (*path, "clamped_to", rope),
                    f"given {place:g} m, the place of {other!r} too; allowed: another place",
                )
            if 0.0 < place < scenario.ropes[rope].unstrained_length:
                on.append(rope)
        if clamped.keys() <= scenario.ropes.keys() and clamped and len(on) != 1:
            lengths = ", ".join(f"0 to {scenario.ropes[rope].unstrained_length:.9g} m of {rope!r}" for rope in clamped)
            given = ", ".join(f"{place:g} m" for place in clamped.values())
            yield Fault(
                (*path, "clamped_to"),
                f"given {given}, between the ends of {len(on) or 'no'} ropes; allowed: of one, {lengths}",
            )


def pantograph_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of pantographs: on unknown ropes, beyond their rope, or with unequal numbers of stages."""
    for name, pantograph in scenario.pantographs.items():
        yield from name_faults(("pantographs", name))
        if pantograph.rope not in scenario.ropes:
            yield _unknown(("pantographs", name, "rope"), pantograph.rope, scenario)
            continue
        rope = scenario.ropes[pantograph.rope]
        low, high = sorted((rope.start.position[0], rope.end.position[0]))
        if not low < pantograph.position < high:
            yield refuse(
                ("pantographs", name, "position"),
                pantograph.position,
                f"above {low:g} and below {high:g} m, under its rope",
            )
        stages = {len(one.stages) for one in scenario.pantographs.values()}
        if len(stages) > 1:
            yield Fault(
                ("pantographs", name, "stages"),
                "given a number of stages that differs from that of another pantograph; allowed: equal numbers",
            )


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


FARTHEST = 5.0  # m, of the strand from the clamps of carriers at the ends of their track


def track_faults(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Faults of tracks: unknown ropes, missing for some strands, given twice, or away from their strand."""
    tracks, strands = carriers.tracks, scenario.strands
    if not tracks:
        if any(carriers.clamp_offset):
            yield Fault(("carriers", "clamp_offset"), "given without a track; allowed: beside `tracks`")
        if carriers.friction.rolling or carriers.friction.viscous:
            yield Fault(("carriers", "friction"), "given without a track; allowed: beside `tracks`")
        return
    beside: dict[str, str] = {}
    for strand, track in tracks.items():
        path: KeyPath = ("carriers", "tracks", strand)
        if strand not in strands:
            known = ", ".join(strands) or "none, there are no sheaves"
            yield Fault(path, f"given for {show(strand)}, which is no strand of a loop; allowed: {known}")
        elif track not in scenario.ropes or track in strands:
            known = ", ".join(name for name in scenario.ropes if name not in strands) or "none, all ropes are strands"
            yield refuse(path, track, f"a rope that is no strand, {known}")
        elif track in beside:
            yield refuse(path, track, "a track for each strand", detail=f", as for {beside[track]!r}")
        else:
            beside[track] = strand
            yield from _away(scenario, carriers, path, strand, track)
    bare = [name for name in strands if name not in tracks]
    if bare and tracks.keys() <= strands.keys():
        text = f"not given for {', '.join(bare)}; allowed: a track for each strand of the loop, or for none"
        yield Fault(("carriers", "tracks"), text)


def _away(scenario: Scenario, carriers: Carriers, path: KeyPath, strand: str, track: str) -> Iterator[Fault]:
    """Fault of a track that runs against its strand or too far beside it."""
    ropes = scenario.ropes
    start, end = (np.array(in_space(one.position)) for one in (ropes[strand].start, ropes[strand].end))
    ends = [np.array(in_space(one.position)) for one in (ropes[track].start, ropes[track].end)]
    if (ends[1] - ends[0]) @ (end - start) <= 0.0:
        yield refuse(path, track, "the same way", detail=f", which runs the other way than {strand!r}")
        return
    for which, place in zip(("start", "end"), ends, strict=True):
        clamp = place + np.array(in_space(carriers.clamp_offset))
        share = np.clip((clamp - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
        apart = float(np.linalg.norm(start + share * (end - start) - clamp))
        if apart > FARTHEST:
            text = f"given {show(track)}, at whose {which} {strand!r} is {apart:.4g} m away from a clamp; allowed: "
            yield Fault(path, f"{text}up to {FARTHEST:g} m")
            return


ROUNDING = 0.01  # m, to which the limits are told


def travel_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of drives whose travel pulls a carriage into its end stops, for ropes and clamps without faults."""
    hauled = [name for name, one in scenario.carriages.items() if scenario.strands.keys() & one.clamped_to.keys()]
    ways = {name: way_between_stops(scenario, name) for name in hauled}
    loops = sum(strand.offset == 0.0 for strand in scenario.strands.values())
    if not ways or loops > 1:  # of several loops each would have ways of its own
        return
    first, last = max(ways, key=lambda name: ways[name].low), min(ways, key=lambda name: ways[name].high)
    low, high = ways[first].low, ways[last].high
    for name, drive in scenario.drives.items():
        if drive.travel is None or drive.travel[0] > drive.travel[1]:  # which is told elsewhere
            continue
        if low - ROUNDING <= drive.travel[0] and drive.travel[1] <= high + ROUNDING:
            continue
        beyond = first if drive.travel[0] < low - ROUNDING else last
        yield Fault(
            ("drives", name, "travel"),
            f"given {list(drive.travel)} m, with which {beyond!r} would run into an end stop of its track; allowed: "
            f"{low:.2f} to {high:.2f} m",
        )
