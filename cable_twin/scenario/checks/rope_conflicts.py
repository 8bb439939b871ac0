"""Consistency checks of several ropes and their couplings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from cable_twin.scenario.checks.bullwheel_conflicts import bullwheel_faults
from cable_twin.scenario.checks.fault import Fault, KeyPath, name_faults, refuse, show
from cable_twin.scenario.checks.line_conflicts import cable_faults
from cable_twin.scenario.checks.riding_conflicts import track_faults
from cable_twin.scenario.checks.vehicle_conflicts import vehicle_faults
from cable_twin.scenario.hauled import travel_faults
from cable_twin.scenario.schema import Scenario

NAMES_SHOWN = 8


def rope_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of each rope alone, and of the couplings between ropes."""
    yield from _whose(scenario)
    if not scenario.ropes:
        for key in ("sheaves", "connectors", "pantographs"):
            for name in getattr(scenario, key):
                yield Fault((key, name), "given with one cable; allowed: with several `ropes`")
        if scenario.carriers is not None and scenario.carriers.tracks:
            yield Fault(("carriers", "tracks"), "given with one cable; allowed: with several `ropes`")
        for name, carriage in scenario.carriages.items():
            if carriage.clamped_to:
                yield Fault(("carriages", name, "clamped_to"), "given with one cable; allowed: with several `ropes`")
        for key in ("mass_damping", "tension_damping", "lateral"):
            if getattr(scenario.cable, key) != 0.0:
                yield refuse(("cable", key), getattr(scenario.cable, key), "0, or several `ropes`")
        return
    if scenario.solver.integrator != "generalized_alpha":
        yield refuse(
            ("solver", "integrator"), scenario.solver.integrator, "generalized_alpha", detail=" with several ropes"
        )
    seen = set()  # what rides a loop is on each of its strands
    for name in scenario.ropes:
        yield from name_faults(("ropes", name))
        alone = scenario.of_rope(name)
        for fault in (*cable_faults(alone), *vehicle_faults(alone)):
            path: KeyPath = ("ropes", name, *fault.path[1:]) if fault.path[0] == "cable" else fault.path
            if path not in seen:
                seen.add(path)
                yield Fault(path, fault.text)
    yield from bullwheel_faults(scenario)
    if scenario.carriers is not None:
        yield from track_faults(scenario, scenario.carriers)
    yield from _connectors(scenario)
    yield from _pantographs(scenario)
    clamps = list(_clamps(scenario))
    yield from clamps
    if not clamps and not list(_whose(scenario)):
        yield from travel_faults(scenario)


def _whose(scenario: Scenario) -> Iterator[Fault]:
    """Faults of towers and carriages on unknown ropes."""
    for key, things in (("towers", scenario.towers), ("carriages", scenario.carriages)):
        for name, thing in things.items():
            if thing.rope is not None and thing.rope not in scenario.ropes:
                yield _unknown((key, name, "rope"), thing.rope, scenario)


def _unknown(path: KeyPath, rope: str, scenario: Scenario) -> Fault:
    names = [*scenario.ropes]
    known = ", ".join(names[:NAMES_SHOWN]) + (", ..." if len(names) > NAMES_SHOWN else "")
    return Fault(path, f"given the rope {show(rope)}; allowed: {known or 'null, there is one cable'}")


def _connectors(scenario: Scenario) -> Iterator[Fault]:
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


def _clamps(scenario: Scenario) -> Iterator[Fault]:
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


def _pantographs(scenario: Scenario) -> Iterator[Fault]:
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


__all__ = ["rope_faults"]
