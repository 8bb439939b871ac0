"""Consistency checks of ropes with each other: bullwheels, loops and tracks, connectors, clamps and pantographs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import dist, hypot

import numpy as np

from cable_twin.scenario.checks.fault import Fault, KeyPath, Phrase, listed, name_faults, refuse, show
from cable_twin.scenario.command_limits import travel_between_stops
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.couplings import Sheave
from cable_twin.scenario.sections.quantities import in_space
from cable_twin.scenario.sections.vehicles import Carriers

APART = 0.05  # of the diameter, by which joined ends may be further apart
FARTHEST = 5.0  # m, of the strand from the clamps of carriers at the ends of their track
ROUNDING = 0.01  # m, to which limits of travel are told
SEVERAL = "only with several `ropes`"


def coupling_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's couplings between ropes, and its keys that are not allowed with a single cable."""
    foreign = list(_foreign_ropes(scenario))
    yield from foreign
    if not scenario.ropes:
        yield from _single_rope(scenario)
        return
    integrator = scenario.solver.integrator
    if integrator != "generalized_alpha":
        yield refuse(("solver", "integrator"), integrator, "generalized_alpha", "with several ropes")
    yield from _bullwheels(scenario)
    if scenario.carriers is not None:
        yield from _carriers_on_loop(scenario, scenario.carriers)
        yield from _tracks(scenario, scenario.carriers)
    yield from _connectors(scenario)
    yield from _pantographs(scenario)
    clamps = list(_clamps(scenario))
    yield from clamps
    if not clamps and not foreign:
        yield from _travel(scenario)


def _foreign_ropes(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's towers and carriages: ropes that are not in the scenario."""
    for key, things in (("towers", scenario.towers), ("carriages", scenario.carriages)):
        for name, thing in things.items():
            if thing.rope is not None and thing.rope not in scenario.ropes:
                yield _unknown((key, name, "rope"), thing.rope, scenario)


def _unknown(path: KeyPath, rope: str, scenario: Scenario) -> Fault:
    """Error for the name of a rope that does not exist in the scenario."""
    return refuse(path, Phrase(f"the rope {show(rope)}"), listed(scenario.ropes, "null, there is one cable"))


def _single_rope(scenario: Scenario) -> Iterator[Fault]:
    """Errors of a scenario with a single cable: keys that are allowed with several ropes only."""
    for key in ("sheaves", "connectors", "pantographs"):
        for name, thing in getattr(scenario, key).items():
            yield refuse((key, name), thing, SEVERAL, "with one cable")
    if scenario.carriers is not None and scenario.carriers.tracks:
        yield refuse(("carriers", "tracks"), scenario.carriers.tracks, SEVERAL, "with one cable")
    for name, carriage in scenario.carriages.items():
        if carriage.clamped_to:
            yield refuse(("carriages", name, "clamped_to"), carriage.clamped_to, SEVERAL, "with one cable")
    for key in ("mass_damping", "tension_damping", "lateral"):
        if (given := getattr(scenario.cable, key)) != 0.0:
            yield refuse(("cable", key), given, "0, or several `ropes`")


def _bullwheels(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's entries for bullwheels: joined rope ends, tensioning devices, rollback, and loops."""
    joined: dict[str, str] = {}  # bullwheels by the ends that they join; none of ends that they join by mistake
    sound = True
    for name, sheave in scenario.sheaves.items():
        path: KeyPath = ("sheaves", name)
        yield from name_faults(path)
        faults = list(_joins(scenario, path, sheave, joined))
        sound = sound and not faults
        yield from faults
        if sheave.counterweight and sheave.hydraulics:
            yield refuse(
                (*path, "hydraulics"), sheave.hydraulics, "null with a counterweight", "a second tensioning device"
            )
        for key in ("counterweight", "hydraulics"):
            device = getattr(sheave, key)
            if device is not None and not device.travel[0] < device.travel[1]:
                yield refuse((*path, key, "travel"), device.travel, "the least travel, then a greater one, in m")
            if device is not None and not any(device.direction):
                yield refuse((*path, key, "direction"), device.direction, "a direction, not all numbers zero")
        if sheave.rollback is not None and name not in {drive.sheave for drive in scenario.drives.values()}:
            yield refuse(
                (*path, "rollback"), sheave.rollback, "null for a bullwheel without drive", "no drive turns it"
            )
        if not faults:
            misplaced = list(_placed(scenario, path, sheave))
            yield from misplaced
            yield from _pulled(scenario, path, sheave)
            if any(fault.path[-1] == "joins" for fault in misplaced):
                sound = False
                joined = {end: by for end, by in joined.items() if by != name}
    if sound and scenario.sheaves:
        yield from _loops(scenario)


def _joins(scenario: Scenario, path: KeyPath, sheave: Sheave, joined: dict[str, str]) -> Iterator[Fault]:
    """Errors in a bullwheel's list of joined rope ends: ends that do not exist, or that another bullwheel joins."""
    for number, (end, side) in enumerate(zip(sheave.joins, ("end", "start"), strict=True)):
        rope, _, which = end.partition(".")
        where = (*path, "joins", number)
        if rope not in scenario.ropes or which != side:
            known = listed([f"{name}.{side}" for name in scenario.ropes], "none")
            yield refuse(where, end, f"{known}, as rope runs from an end to the start of the next one")
        elif end in joined:
            yield refuse(where, end, "each end once", f"{joined[end]!r} joins the end already")
        elif (support := scenario.ropes[rope].ends[side].support) != "pinned":
            yield refuse(("ropes", rope, side, "support"), support, "pinned", "at a bullwheel")
        joined.setdefault(end, str(path[1]))


def _placed(scenario: Scenario, path: KeyPath, sheave: Sheave) -> Iterator[Fault]:
    """Errors in a bullwheel's geometry: rope ends away from its rim, or joined strands of different properties."""
    (first, second), radius = sheave.ropes, sheave.radius
    before, after = scenario.ropes[first], scenario.ropes[second]
    ends = [in_space(before.end.position), in_space(after.start.position)]
    if scenario.dim == 3:  # in a plane, ropes beside each other are only drawn so
        ends = [scenario.placed(name, end) for name, end in zip(sheave.ropes, ends, strict=True)]
    wide = 2.0 * radius * (1.0 + APART)
    if (apart := dist(*ends)) > wide:
        given = Phrase(f"ends that are {apart:.4g} m apart")
        yield refuse((*path, "joins"), given, f"at most the diameter of the bullwheel, {2.0 * radius:g} m")
    if sheave.position is not None:
        for end in ends:
            if (apart := dist(in_space(sheave.position), end)) > 0.5 * wide:
                allowed = f"at most its radius of {radius:g} m, or null"
                yield refuse((*path, "position"), sheave.position, allowed, f"{apart:.4g} m from an end that it joins")
                break
    equal = {"mass_per_length": "kg/m", "axial_stiffness": "N", "thermal_expansion": "1/K"}
    for key, unit in (equal | {"reference_temperature": "degC"}).items():
        here, there = getattr(before, key), getattr(after, key)
        if here != there:
            why = f"{path[1]!r} joins it to {first!r} with {here!r} {unit}"
            yield refuse(("ropes", second, key), there, "equal values on all joined ropes", why)


def _pulled(scenario: Scenario, path: KeyPath, sheave: Sheave) -> Iterator[Fault]:
    """Error in a tensioning device's direction: with the pull of the strands instead of against it."""
    device = sheave.tensioning
    if device is None or not any(device.direction):
        return
    before, after = (scenario.ropes[name] for name in sheave.ropes)
    here = [in_space(before.end.position), in_space(after.start.position)]
    there = [in_space(before.start.position), in_space(after.end.position)]
    away = [sum(places) for places in zip(*here, *([-x for x in one] for one in there), strict=True)]
    if (length := hypot(*away)) > 0.0 and sum(
        a * b for a, b in zip(away, in_space(device.direction), strict=True)
    ) <= 0.0:
        outward = [round(x / length, 3) for x in (away if len(device.direction) == 3 else away[::2])]
        yield refuse(
            (*path, "counterweight" if sheave.counterweight else "hydraulics", "direction"),
            device.direction,
            f"away from the other ends of the strands, about {outward}",
            "this direction does not pull against the strands",
        )


def _loops(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's ropes: strands that form no closed loop, or ropes without vehicle or coupling."""
    strands = scenario.strands
    for name, sheave in scenario.sheaves.items():
        for end, rope in zip(sheave.joins, sheave.ropes, strict=True):
            if rope not in strands:
                allowed = "sheaves that join all strands to a closed loop"
                yield refuse(("sheaves", name, "joins"), end, allowed, f"{rope!r} is not on a closed loop")
                return
    used = {rope for rod in scenario.connectors.values() for rope, _ in rod.ends}
    used |= {one.rope for one in scenario.pantographs.values()} | set(strands)
    used |= {scenario.rope_of(one) for one in scenario.carriages.values()}
    used |= set(scenario.carriers.tracks.values()) if scenario.carriers else set()
    for name, cable in scenario.ropes.items():
        if name not in used:
            why = "no vehicle can reach it and nothing joins it to another rope"
            yield refuse(("ropes", name), cable, "ropes with a vehicle, bullwheel, connector or pantograph", why)


def _carriers_on_loop(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Errors in a scenario's carriers: no loop, or too many for the loop."""
    path: KeyPath = ("carriers",)
    if not scenario.strands:
        yield refuse(path, carriers, "only with sheaves that join ropes to a loop", "the ropes stand still")
        return
    loop, spacing = scenario.loop_length, carriers.spacing
    if spacing is not None and carriers.count * spacing > loop * (1.0 + 1e-9):
        why = f"every {spacing:.9g} m they need {carriers.count * spacing:.6g} m"
        yield refuse(
            (*path, "count"),
            carriers.count,
            f"at most {int(loop * (1.0 + 1e-9) / spacing)}, for the loop of {loop:.6g} m",
            why,
        )


def _tracks(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Errors in the carriers' track ropes: unknown, missing for some strands, given twice, or far from a strand."""
    path: KeyPath = ("carriers", "tracks")
    tracks, strands = carriers.tracks, scenario.strands
    if tracks and carriers.station_rails:
        yield refuse(
            ("carriers", "station_rails"),
            carriers.station_rails,
            "0 m, with `tracks`",
            "the tracks have rails of their own at both ends",
        )
    if not tracks:
        if any(carriers.clamp_offset):
            yield refuse(
                ("carriers", "clamp_offset"), carriers.clamp_offset, "zeros, or with `tracks`", "without a track"
            )
        if carriers.friction.rolling or carriers.friction.viscous:
            yield refuse(
                ("carriers", "friction"),
                carriers.friction,
                "rolling and viscous of 0, or with `tracks`",
                "without a track",
            )
        return
    beside: dict[str, str] = {}
    for strand, track in tracks.items():
        own = (*path, strand)
        if strand not in strands:
            known = listed(strands, "none, there are no sheaves")
            yield refuse(own, Phrase(f"a track for {show(strand)}"), known, "no strand of a loop")
        elif track not in scenario.ropes or track in strands:
            known = listed([name for name in scenario.ropes if name not in strands], "none, all ropes are strands")
            yield refuse(own, track, f"a rope that is no strand, {known}")
        elif track in beside:
            yield refuse(own, track, "another track for each strand", f"it is the track of {beside[track]!r}")
        else:
            beside[track] = strand
            yield from _away(scenario, carriers, own, strand, track)
    bare = [name for name in strands if name not in tracks]
    if bare and tracks.keys() <= strands.keys():
        given = Phrase(f"no track for {', '.join(bare)}")
        yield refuse(path, given, "a track for each strand of the loop, or for none")


def _away(scenario: Scenario, carriers: Carriers, path: KeyPath, strand: str, track: str) -> Iterator[Fault]:
    """Error of a track rope that runs opposite to its strand, or too far away from it."""
    start, end = (np.array(in_space(one.position)) for one in scenario.ropes[strand].ends.values())
    ends = {name: np.array(in_space(one.position)) for name, one in scenario.ropes[track].ends.items()}
    if (ends["end"] - ends["start"]) @ (end - start) <= 0.0:
        yield refuse(
            path, track, "a track in the direction of its strand", f"it runs against the direction of {strand!r}"
        )
        return
    for name, place in ends.items():
        clamp = place + np.array(in_space(carriers.clamp_offset))
        share = np.clip((clamp - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
        apart = float(np.linalg.norm(start + share * (end - start) - clamp))
        if apart > FARTHEST:
            yield refuse(
                path,
                track,
                f"a distance of up to {FARTHEST:g} m",
                f"at its {name}, {strand!r} is {apart:.4g} m away from a clamp",
            )
            return


def _connectors(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's connectors between ropes: ends off the ropes, both on one rope, or crossing rods."""
    between: dict[tuple[str, str], list[tuple[float, float, str]]] = {}
    for name, rod in scenario.connectors.items():
        path: KeyPath = ("connectors", name)
        yield from name_faults(path)
        places = {}
        for key, (rope, place) in zip(("from", "to"), rod.ends, strict=True):
            if rope not in scenario.ropes:
                yield _unknown((*path, key), rope, scenario)
                continue
            length = scenario.ropes[rope].unstrained_length
            if 0.0 < place < length:
                places[rope] = place
            else:
                allowed = f"above 0 and below {length:.9g} m, between its ends"
                yield refuse((*path, key), place, allowed, f"on {rope!r}")
                places.pop(rope, None)
        if len(places) == 1 and rod.ends[0][0] == rod.ends[1][0]:
            yield refuse((*path, "to"), rod.ends[1][0], "another rope than `from`", "both ends on one rope")
        elif len(places) == 2:
            order = [rope for rope in scenario.ropes if rope in places]
            between.setdefault((order[0], order[1]), []).append((places[order[0]], places[order[1]], name))
    for rods in between.values():
        for (_, before, one), (_, after, other) in pairwise(sorted(rods)):
            if after < before:
                yield refuse(
                    ("connectors", other), Phrase(f"crossing '{one}'"), "connectors in the same order along both ropes"
                )


def _clamps(scenario: Scenario) -> Iterator[Fault]:
    """Errors in carriages' clamps to a second rope: unknown or own rope, place off the rope, or occupied place."""
    taken: dict[tuple[str, float], str] = {}
    for name, carriage in scenario.carriages.items():
        path: KeyPath = ("carriages", name, "clamped_to")
        clamped, drive = carriage.clamped_to, carriage.drive
        if clamped and (carriage.joint != "sliding" or drive.mode == "speed" or drive.haul_rope is not None):
            allowed = "only with a sliding joint, without haul_rope, and with a drive.mode other than speed"
            yield refuse(path, clamped, allowed, "a joint or drive holds the carriage")
        if not clamped and any(carriage.clamp_offset):
            own = ("carriages", name, "clamp_offset")
            yield refuse(own, carriage.clamp_offset, "zeros, or with `clamped_to`", "without a clamp")
        on = []
        for rope, place in clamped.items():
            if rope not in scenario.ropes:
                yield _unknown((*path, rope), rope, scenario)
                continue
            if rope == scenario.rope_of(carriage):
                yield refuse((*path, rope), rope, "a rope other than its own", "the carriage slides on this rope")
            if (other := taken.setdefault((rope, place), name)) != name:
                yield refuse((*path, rope), place, "another place, in m", f"{other!r} is clamped there")
            if 0.0 < place < scenario.ropes[rope].unstrained_length:
                on.append(rope)
        if clamped and clamped.keys() <= scenario.ropes.keys() and len(on) != 1:
            lengths = ", ".join(f"0 to {scenario.ropes[rope].unstrained_length:.9g} m of {rope!r}" for rope in clamped)
            given = Phrase(", ".join(f"{place:g} m" for place in clamped.values()))
            yield refuse(path, given, f"on exactly one rope, {lengths}", f"on {len(on) or 'no'} ropes")


def _pantographs(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's pantographs: unknown rope, place off the rope, or unequal numbers of stages."""
    for name, pantograph in scenario.pantographs.items():
        path: KeyPath = ("pantographs", name)
        yield from name_faults(path)
        if pantograph.rope not in scenario.ropes:
            yield _unknown((*path, "rope"), pantograph.rope, scenario)
            continue
        low, high = sorted(end.position[0] for end in scenario.ropes[pantograph.rope].ends.values())
        if not low < pantograph.position < high:
            allowed = f"above {low:g} and below {high:g} m, under its rope"
            yield refuse((*path, "position"), pantograph.position, allowed)
        if len({len(one.stages) for one in scenario.pantographs.values()}) > 1:
            given = Phrase(f"{len(pantograph.stages)} stages")
            yield refuse(
                (*path, "stages"),
                given,
                "an equal number of stages for all pantographs",
                "other pantographs have more or fewer",
            )


def _travel(scenario: Scenario) -> Iterator[Fault]:
    """Errors in drives' travel limits, which let a carriage reach its end stops; needs valid ropes and clamps."""
    hauled = [name for name, one in scenario.carriages.items() if scenario.strands.keys() & one.clamped_to.keys()]
    ranges = {name: travel_between_stops(scenario, name) for name in hauled}
    loops = sum(strand.offset == 0.0 for strand in scenario.strands.values())
    if not ranges or loops > 1:  # of several loops each would have ranges of its own
        return
    first, last = max(ranges, key=lambda name: ranges[name].low), min(ranges, key=lambda name: ranges[name].high)
    low, high = ranges[first].low, ranges[last].high
    for name, drive in scenario.drives.items():
        if drive.travel is None or drive.travel[0] > drive.travel[1]:  # a fault of its own
            continue
        if low - ROUNDING <= drive.travel[0] and drive.travel[1] <= high + ROUNDING:
            continue
        beyond = first if drive.travel[0] < low - ROUNDING else last
        why = f"{beyond!r} would run into an end stop of its track"
        yield refuse(("drives", name, "travel"), drive.travel, f"{low:.2f} to {high:.2f} m", why)
