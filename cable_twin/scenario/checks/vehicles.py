"""Consistency checks of vehicles and drives: carriages and carriers, their names, and the drives of ropes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import ceil
from re import fullmatch

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.scenario.builders.outlines import reach_along
from cable_twin.scenario.builders.vehicles import BRAKES, inertia_tensor, stop_stroke
from cable_twin.scenario.checks.fault import (
    NOTHING,
    Fault,
    KeyPath,
    Phrase,
    listed,
    name_faults,
    of_space,
    refuse,
    show,
)
from cable_twin.scenario.checks.wrong_units import body_faults, breaking_faults
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.drives import Limits
from cable_twin.scenario.sections.vehicles import Body, Carriage, CarrierPayload, Carriers, Payload

SHORTEST_STAY = 0.1  # s in a station, in which passengers get in and out
FASTEST_ROPE = 12.0  # m/s, of a drive without a limit
Bodies = Mapping[str, Body]  # of a vehicle, by name


def vehicle_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario of one rope: its vehicles, and the supports of a moving rope; paths from `cable`."""
    for name, carriage in scenario.carriages.items():
        yield from _carriage(scenario, ("carriages", name), carriage)
    if scenario.drives:
        for name, end in scenario.cable.ends.items():
            if end.support == "free":
                allowed = "pinned or clamped, at a station"
                yield refuse(("cable", name, "support"), end.support, allowed, "an end of a cable that moves")
        if scenario.solver.integrator == "runge_kutta":
            path = ("solver", "integrator")
            yield refuse(path, scenario.solver.integrator, "generalized_alpha", "this cable moves")
    if scenario.carriers is not None:
        yield from _spacing(scenario, scenario.carriers)


def name_conflicts(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's names that occur twice: supports, drives, joints of bodies, numbered carriers."""
    taken = {*scenario.carriages, *scenario.drives}
    for name, carriage in scenario.carriages.items():
        if name in ("start", "end", *scenario.towers):
            path: KeyPath = ("carriages", name)
            yield refuse(path, Phrase(f"the name {name!r}"), "another name", "a support of the cable has this name")
        for body in carriage.bodies:
            if (joint := f"{name}_{body}") in taken:
                path = ("carriages", name, "bodies", body)
                why = f"{joint!r} is the name of another body's joint"
                yield refuse(path, Phrase(f"the name {body!r}"), "another name", why)
            taken.add(joint)
    for name in scenario.drives:
        if name in scenario.carriages:
            allowed = "another name, as commands address both by name"
            yield refuse(("drives", name), Phrase(f"the name {name!r}"), allowed, "a carriage has this name")
    carriers = scenario.carriers
    if carriers is not None and carriers.name is not None:
        path = ("carriers", "name")
        yield from name_faults(path, carriers.name)
        bodies = [body for kind in carriers.kinds_by_path.values() for body in kind.bodies]
        own = f"{carriers.name}_[0-9]+({'|'.join(['', *(f'_{body}' for body in bodies)])})"
        if same := [name for name in (*scenario.carriages, *scenario.drives) if fullmatch(own, name)]:
            yield refuse(path, carriers.name, "another name", f"a carrier would have the name {same[0]!r} as well")


def drive_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's drives of ropes: bullwheels, speeds and limits."""
    turned: dict[str, str] = {}
    for name, drive in scenario.drives.items():
        path: KeyPath = ("drives", name)
        yield from name_faults(path)
        yield from _initial_speed(path, drive.speed, drive.limits.speed)
        yield from _deceleration(path, drive.limits)
        if not scenario.ropes:
            for key in ("force", "power"):
                if (given := getattr(drive.limits, key)) is not None:
                    allowed = "null: a drive without a bullwheel moves the cable with any force that it needs"
                    yield refuse((*path, "limits", key), given, allowed)
            if name != next(iter(scenario.drives)):
                yield refuse(path, Phrase("a second drive of the cable"), "one drive for the cable")
            for key in ("travel", "sheave"):
                if (given := getattr(drive, key)) is not None:
                    yield refuse((*path, key), given, "null", "the cable has no bullwheels")
            continue
        known = listed(scenario.sheaves, "none, as there are no sheaves")
        if drive.sheave is None:
            yield refuse((*path, "sheave"), NOTHING, known, "with several ropes a drive turns a bullwheel")
        elif drive.sheave not in scenario.sheaves:
            yield refuse((*path, "sheave"), drive.sheave, known)
        elif (other := turned.setdefault(drive.sheave, name)) != name:
            yield refuse((*path, "sheave"), drive.sheave, "one drive for each bullwheel", f"{other!r} turns it")
        if drive.travel is not None and not drive.travel[0] <= 0.0 <= drive.travel[1] != drive.travel[0]:
            allowed = "the least travel, then the greatest, in m, with the 0 of the start between them"
            yield refuse((*path, "travel"), drive.travel, allowed)


def carrier_faults(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Errors in a scenario's kinds of carriers: names, bodies and payloads."""
    path: KeyPath = ("carriers",)
    if bool(carriers.bodies) == bool(carriers.kinds):
        given = Phrase("both bodies and kinds" if carriers.bodies else "neither bodies nor kinds")
        yield refuse((*path, "bodies"), given, "bodies where all are of one kind, else kinds")
    if carriers.kinds and carriers.payload is not None:
        yield refuse(
            (*path, "payload"), carriers.payload, "null; the payload of each kind instead", "together with kinds"
        )
    for name in carriers.order:
        if name not in carriers.kinds:
            yield refuse((*path, "order"), name, listed(carriers.kinds, "none, as there are no kinds"))
    if beyond := [number for number in carriers.loaded or () if not 1 <= number <= carriers.count]:
        yield refuse((*path, "loaded"), beyond[0], f"numbers of carriers from 1 to {carriers.count}")
    for name in carriers.kinds:
        yield from name_faults(("carriers", "kinds", name))
    for path, kind in carriers.kinds_by_path.items():
        yield from _bodies(scenario, path, kind.bodies)
        if kind.payload is not None:
            own = (*path, "payload")
            yield from _payload(own, kind.payload, ("from_start", "from_end", "on_cable"), kind.bodies)
            yield from _exchanged(scenario, own, kind.payload)


def _exchanged(scenario: Scenario, path: KeyPath, payload: CarrierPayload) -> Iterator[Fault]:
    """Errors in the payloads of carriers after bullwheels: unknown ones, above the capacity, or given a second time."""
    for name, mass in payload.leaving.items():
        own = (*path, "leaving", name)
        if name not in scenario.sheaves:
            yield refuse(own, name, listed(scenario.sheaves, "none, as there are no sheaves"), "no such bullwheel")
        elif not 0.0 <= mass <= payload.capacity:
            yield refuse(own, mass, f"0 to {payload.capacity:g} kg")
    for key in ("from_start", "from_end") if payload.leaving else ():
        if (given := getattr(payload, key)) is not None:
            why = "`leaving` has the payload after each bullwheel"
            yield refuse((*path, key), given, "null, or no `leaving`", why)


def _payload(
    path: KeyPath, payload: Payload | CarrierPayload, masses: Sequence[str], bodies: Bodies
) -> Iterator[Fault]:
    """Errors in a vehicle's payload: masses (of given keys) above the capacity, or an unknown body."""
    for key in masses:
        mass = getattr(payload, key)
        if mass is not None and mass > payload.capacity:
            yield refuse((*path, key), mass, f"0 to the capacity of {payload.capacity:g} kg")
    if payload.body is not None and payload.body not in bodies:
        yield refuse((*path, "body"), payload.body, listed(bodies, "null, as there are no bodies"))


def _carriage(scenario: Scenario, path: KeyPath, carriage: Carriage) -> Iterator[Fault]:
    """Errors in a scenario's entry for a carriage: place on the rope, bodies, payload and drive."""
    yield from name_faults(path)
    length, stroke = scenario.cable.unstrained_length, stop_stroke(scenario, carriage)
    if carriage.joint == "clamped":
        yield from _clamped(scenario, path, carriage)
    elif scenario.drives and carriage.joint is not None:
        yield refuse((*path, "joint"), carriage.joint, "clamped", "on a cable that moves")
    elif 2.0 * stroke >= length:
        why = f"at both ends of a cable of {length:.9g} m"
        yield refuse((*path, "end_stop", "stroke"), stroke, f"less than {length / 2:.9g} m", why)
    elif carriage.arc_length < stroke or carriage.arc_length > length - stroke:
        allowed = f"{stroke:.9g} to {length - stroke:.9g} m, on the cable and between its end stops"
        yield refuse((*path, "arc_length"), carriage.arc_length, allowed)
    yield from _bodies(scenario, path, carriage.bodies)
    if carriage.payload is not None:
        yield from _payload((*path, "payload"), carriage.payload, ("mass",), carriage.bodies)
    yield from _drive((*path, "drive"), carriage, scenario.solver.integrator)
    if carriage.speed != 0.0 and carriage.joint != "sliding":
        where = (
            "as drives.NAME.speed moves the cable" if carriage.joint == "clamped" else "as a fixed joint does not move"
        )
        yield refuse((*path, "speed"), carriage.speed, f"0 m/s, {where}")
    yield from _initial_speed(path, carriage.speed, carriage.drive.limits.speed)


def _initial_speed(path: KeyPath, speed: float, limit: float | None) -> Iterator[Fault]:
    """Error of an initial speed (m/s) in a scenario beyond the drive's speed limit."""
    if limit is not None and abs(speed) > limit:
        yield refuse((*path, "speed"), speed, f"-{limit:g} to {limit:g} m/s, the limit of the drive")


def _bodies(scenario: Scenario, path: KeyPath, bodies: Bodies) -> Iterator[Fault]:
    """Errors in a vehicle's chain of bodies: names, pivots and inertia."""
    last = list(bodies)[-1:]
    for name, body in bodies.items():
        own = (*path, "bodies", name)
        yield from name_faults(own)
        if body.lower_pivot is None and [name] != last:
            yield refuse((*own, "lower_pivot"), NOTHING, "a list of 2 finite numbers, in m", "another body hangs there")
        for key in ("upper_pivot", "lower_pivot"):
            given = getattr(body, key)
            if given is not None and len(given) > scenario.dim:
                yield refuse((*own, key), given, "x, z in m", "three numbers in a plane")
        yield from _inertia(scenario, (*own, "inertia_tensor"), body)
        yield from body_faults(own, body)
        if scenario.dim == 2:
            yield from of_space(own, body, ("turns", "roll_damping"))
            if isinstance(body.drag_area, tuple | list) and body.drag_area[1] != 0.0:
                x, _, z = body.drag_area
                allowed = f"{show([x, 0.0, z], 'm^2')}; a y of its own in space only"
                yield refuse((*own, "drag_area"), body.drag_area, allowed, "in a plane")


def _inertia(scenario: Scenario, path: KeyPath, body: Body) -> Iterator[Fault]:
    """Error of a body's impossible inertia tensor: a principal moment not above 0, or above the sum of the others."""
    given = body.inertia_tensor
    if given is None:
        return
    if scenario.dim == 2:
        yield refuse(path, given, "null, as a body in a plane has `inertia`", "in a plane")
    elif len(given) not in (3, 6):
        yield refuse(path, given, "3 or 6 finite numbers, in kg m^2")
    else:
        low, middle, high = np.linalg.eigvalsh(inertia_tensor(body))
        if low <= 0.0 or high > (1.0 + 1e-9) * (low + middle):
            allowed = "all above 0 and none more than the other two together, in kg m^2"
            yield refuse(path, given, allowed, f"principal moments {low:g}, {middle:g} and {high:g}")


def _clamped(scenario: Scenario, path: KeyPath, carriage: Carriage) -> Iterator[Fault]:
    """Errors in a clamped carriage: a cable without drive, a place off the loop, friction, or its own drive."""
    if not scenario.drives:
        yield refuse(
            (*path, "joint"),
            carriage.joint,
            "sliding or fixed; clamped only with `drives`",
            "on a cable that stands still",
        )
    elif carriage.arc_length < 0.0 or carriage.arc_length > scenario.loop_length:
        allowed = f"0 to {scenario.loop_length:.9g} m, on the loop of the cable"
        yield refuse((*path, "arc_length"), carriage.arc_length, allowed)
    for key in ("rolling", "viscous"):
        if (given := getattr(carriage.friction, key)) > 0.0:
            yield refuse((*path, "friction", key), given, "0, as a clamped vehicle does not slide")
    if carriage.drive.mode not in (None, "free"):
        yield refuse((*path, "drive", "mode"), carriage.drive.mode, "free, as a clamped vehicle moves with the cable")


def _deceleration(path: KeyPath, limits: Limits) -> Iterator[Fault]:
    """Error where a service stop would be harder than an emergency stop."""
    if limits.deceleration is not None and limits.deceleration > limits.emergency_deceleration:
        allowed = f"at most the emergency_deceleration of {limits.emergency_deceleration:g} m/s^2"
        yield refuse((*path, "limits", "deceleration"), limits.deceleration, allowed)


def _drive(path: KeyPath, carriage: Carriage, integrator: str) -> Iterator[Fault]:
    """Errors in the drive of a carriage: decelerations, brakes of the emergency stop, haul rope, integrator."""
    drive, means = carriage.drive, carriage.drive.emergency_stop
    yield from _deceleration(path, drive.limits)
    brakes = [name for name in BRAKES if getattr(drive, name) is not None]
    for name in means:
        if name != "drive" and name not in brakes:
            yield refuse((*path, "emergency_stop"), name, ", ".join(["drive", *brakes]), "this drive does not have it")
    on_drive = [name for name in means if name in BRAKES[:2]]
    if "drive" in means and on_drive:
        allowed = "only one of the two, as the drive decelerates at emergency_deceleration with any force that it needs"
        yield refuse((*path, "emergency_stop"), Phrase(f"'drive' and {on_drive[0]!r}"), allowed)
    if drive.haul_rope is not None:
        yield from breaking_faults((*path, "haul_rope"), drive.haul_rope)
    if drive.haul_rope is not None and carriage.joint == "fixed":
        yield refuse((*path, "haul_rope"), drive.haul_rope, "null; only where the joint slides", "the joint is fixed")
    if integrator == "runge_kutta":
        only, why = "only with generalized_alpha", "with the integrator runge_kutta"
        if drive.haul_rope is not None:
            yield refuse((*path, "haul_rope"), drive.haul_rope, only, why)
        if tuple(means) != ("drive",):
            yield refuse((*path, "emergency_stop"), means, only, why)


def _spacing(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Errors in the spacing of carriers along a loop, and of loops without room for stations."""
    length, loop, spacing = scenario.cable.unstrained_length, scenario.loop_length, scenario.spacing
    strand = scenario.strand or scenario.riding
    path: KeyPath = ("carriers",)
    if not scenario.drives and strand is None:
        yield refuse(path, carriers, "only with an entry in `drives`", "the cable stands still")
    if carriers.spacing is None and strand is None:
        yield refuse((*path, "spacing"), NOTHING, "a number above 0, in m")
    elif strand is None and spacing > length:
        yield refuse((*path, "spacing"), carriers.spacing, f"at most {length:.9g} m, the length of the cable")
    elif loop < length:
        allowed = f"at least {ceil(length / spacing - 1e-09)}, for the cable of {length:.9g} m to fit in"
        reason = f"carriers every {spacing:.9g} m fill a loop of {loop:.9g} m"
        yield refuse((*path, "count"), carriers.count, allowed, reason)
    else:
        yield from _overlap(scenario, carriers)
    if carriers.first is not None and carriers.first > loop:
        yield refuse((*path, "first"), carriers.first, f"0 to {loop:.9g} m, on the loop")
    rooms = [kind.payload for kind in carriers.kinds_by_path.values() if kind.payload is not None]
    limits = [drive.limits.speed for drive in scenario.drives.values()]
    hidden = loop - length
    if rooms and limits and hidden < (least := SHORTEST_STAY * (limits[0] or FASTEST_ROPE)):
        allowed = f"at least {with_unit(least, 'm', 3)}, so that carriers are in a station for a moment"
        why = f"only {with_unit(hidden, 'm', 3)} of the loop are not on the cable"
        yield refuse((*path, "payload"), rooms[0], allowed, why)


def _overlap(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Error of carriers that are nearer to each other than their bodies are long, hanging upright."""
    order = [carriers.kinds.get(name) for name in carriers.order or tuple(carriers.kinds)] or [carriers.kind(0)]
    if not isinstance(carriers.count, int) or carriers.count < 2 or None in order:
        return
    reach = [reach_along(kind.bodies.values()) for kind in order if kind is not None]
    behind = [reach[number % len(reach)] for number in range(min(carriers.count, len(reach) + 1))]
    length = max(one[1] + other[0] for one, other in pairwise(behind))
    if not scenario.spacing < length:
        return
    if carriers.spacing is not None:
        allowed = f"at least {with_unit(length, 'm')}, the length of a carrier"
        yield refuse(("carriers", "spacing"), carriers.spacing, allowed, "carriers overlap")
    else:
        allowed = f"at most {int(scenario.loop_length / length)}, as a carrier is {with_unit(length, 'm')} long"
        why = f"carriers overlap, every {with_unit(scenario.spacing, 'm', 3)} of the loop"
        yield refuse(("carriers", "count"), carriers.count, allowed, why)
