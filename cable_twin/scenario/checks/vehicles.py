"""Consistency checks of carriages, carriers and drives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import ceil
from re import fullmatch

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.scenario.builders.vehicles import BRAKES, inertia_tensor, stop_stroke
from cable_twin.scenario.checks.fault import Fault, KeyPath, name_faults, refuse, show
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.vehicles import Body, Carriage, Carriers

SHORTEST_STAY = 0.1  # s in a station, in which what gets in and out is changed
FASTEST_ROPE = 12.0  # m/s, of a drive without a limit


def vehicle_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of carriages, carriers and drives of one rope."""
    yield from _carriages(scenario)
    yield from _joint_names(scenario)
    yield from _moving_cable(scenario)


def _joint_names(scenario: Scenario) -> Iterator[Fault]:
    """Faults of names in use: of the joint of a body, or of the frame of a carriage."""
    for name in scenario.carriages:
        if name in ("start", "end", *scenario.towers):
            yield Fault(("carriages", name), f"given the name {name!r}; allowed: any that no support of the cable has")
    taken = {*scenario.carriages, *scenario.drives}
    for name, carriage in scenario.carriages.items():
        for body in carriage.bodies:
            joint = f"{name}_{body}"
            if joint in taken:
                path = ("carriages", name, "bodies", body)
                yield refuse(path, body, f"another name, as {joint!r} is the name of another body's joint")
            taken.add(joint)


def _carriages(scenario: Scenario) -> Iterator[Fault]:
    length = scenario.cable.unstrained_length
    for name, carriage in scenario.carriages.items():
        path = ("carriages", name)
        yield from name_faults(path)
        stroke = stop_stroke(scenario, carriage)
        if carriage.joint == "clamped":
            yield from _clamped(scenario, name, carriage)
        elif scenario.drives and carriage.joint is not None:
            yield refuse((*path, "joint"), carriage.joint, "clamped", detail=" on a cable that moves")
        elif 2.0 * stroke >= length:
            yield refuse(
                (*path, "end_stop", "stroke"),
                stroke,
                f"less than {length / 2:.9g} m",
                detail=f" at both ends of a cable of {length:.9g} m",
            )
        elif carriage.arc_length < stroke or carriage.arc_length > length - stroke:
            yield refuse(
                (*path, "arc_length"),
                carriage.arc_length,
                f"{stroke:.9g} to {length - stroke:.9g} m, on the cable and between its end stops",
            )
        yield from _bodies(scenario, path, carriage.bodies)
        yield from _payload(path, carriage)
        yield from _drive(path, carriage, scenario.solver.integrator)
        if carriage.speed != 0.0 and carriage.joint != "sliding":
            where = "drives.NAME.speed moves the cable" if carriage.joint == "clamped" else "a fixed joint stays"
            yield refuse((*path, "speed"), carriage.speed, f"0, {where}")
        yield from initial_speed(path, carriage.speed, carriage.drive.limits.speed)


def initial_speed(path: KeyPath, speed: float, limit: float | None) -> Iterator[Fault]:
    """Fault of an initial speed (m/s) beyond the limit of the drive."""
    if limit is not None and abs(speed) > limit:
        yield refuse((*path, "speed"), speed, f"-{limit:g} to {limit:g} m/s, the limit of the drive")


def _bodies(scenario: Scenario, path: tuple[str, ...], bodies: Mapping[str, Body]) -> Iterator[Fault]:
    last = list(bodies)[-1:]
    for name, body in bodies.items():
        yield from name_faults((*path, "bodies", name))
        if body.lower_pivot is None and [name] != last:
            yield Fault(
                (*path, "bodies", name, "lower_pivot"),
                "nothing given, but another body hangs there; allowed: a list of 2 finite numbers, in m",
            )
        for key in ("upper_pivot", "lower_pivot"):
            given = getattr(body, key)
            if given is not None and len(given) > scenario.dim:
                yield refuse((*path, "bodies", name, key), list(given), "x, z in m", detail=" in a plane")
        yield from _inertia(scenario, (*path, "bodies", name, "inertia_tensor"), body)


def _inertia(scenario: Scenario, path: KeyPath, body: Body) -> Iterator[Fault]:
    """Fault of an impossible inertia tensor: no principal moment exceeds the sum of the other two."""
    if body.inertia_tensor is None:
        return
    given = show(list(body.inertia_tensor))
    if scenario.dim == 2:
        yield Fault(path, f"given {given} in a plane; allowed: null, as in a plane a body has `inertia`")
    elif len(body.inertia_tensor) not in (3, 6):
        yield Fault(path, f"given {given}; allowed: 3 or 6 finite numbers, in kg m^2")
    else:
        low, middle, high = np.linalg.eigvalsh(inertia_tensor(body))
        if low <= 0.0 or high > (1.0 + 1e-9) * (low + middle):
            yield Fault(
                path,
                f"given {given}, with principal moments {low:g}, {middle:g} and {high:g}; "
                "allowed: all above 0 and none more than the other two together, in kg m^2",
            )


def _clamped(scenario: Scenario, name: str, carriage: Carriage) -> Iterator[Fault]:
    """Faults of a clamped carriage: on a standing cable, off the loop, or with friction or a drive of its own."""
    path = ("carriages", name)
    if not scenario.drives:
        yield Fault(
            (*path, "joint"), "given 'clamped' on a cable that stands still; allowed: sliding, fixed, or drives"
        )
    elif carriage.arc_length < 0.0 or carriage.arc_length > scenario.loop_length:
        yield refuse(
            (*path, "arc_length"), carriage.arc_length, f"0 to {scenario.loop_length:.9g} m, on the loop of the cable"
        )
    for key in ("rolling", "viscous"):
        if getattr(carriage.friction, key) > 0.0:
            given = getattr(carriage.friction, key)
            yield refuse((*path, "friction", key), given, "0, as a clamped vehicle does not slide")
    if carriage.drive.mode not in (None, "free"):
        yield refuse((*path, "drive", "mode"), carriage.drive.mode, "free, as a clamped vehicle moves with the cable")


def _moving_cable(scenario: Scenario) -> Iterator[Fault]:
    """Faults of drives and carriers of an axially moving cable."""
    for name, drive in scenario.drives.items():
        path = ("drives", name)
        yield from name_faults(path)
        if name != next(iter(scenario.drives)):
            yield Fault(path, "given a second drive of the cable; allowed: one")
        if name in scenario.carriages:
            yield Fault(path, "given the name of a carriage; allowed: another one, as commands address both by name")
        yield from initial_speed(path, drive.speed, drive.limits.speed)
        for key, why in (
            ("force", "a moving cable keeps its speed"),
            ("power", "a moving cable keeps its speed"),
            ("deceleration", "a moving cable stops as it starts, at its acceleration"),
        ):
            given = getattr(drive.limits, key)
            if given is not None:
                yield refuse((*path, "limits", key), given, f"null, {why}")
        for key in ("travel", "sheave"):
            if (given := getattr(drive, key)) is not None:
                yield refuse((*path, key), given, "null, for the cable has no bullwheels")
    if scenario.drives:
        for end in ("start", "end"):
            if getattr(scenario.cable, end).support == "free":
                yield Fault(
                    ("cable", end, "support"),
                    "given 'free' for a cable that moves; allowed: pinned or clamped, at a station",
                )
        if scenario.solver.integrator == "runge_kutta":
            yield Fault(
                ("solver", "integrator"), "given 'runge_kutta' for a cable that moves; allowed: generalized_alpha"
            )
    if scenario.carriers is not None:
        yield from _carriers(scenario, scenario.carriers)


def _payload(path: KeyPath, carriage: Carriage) -> Iterator[Fault]:
    payload = carriage.payload
    if payload is None:
        return
    if payload.mass > payload.capacity:
        yield refuse((*path, "payload", "mass"), payload.mass, f"0 to the capacity of {payload.capacity:g} kg")
    if payload.body is not None and payload.body not in carriage.bodies:
        yield refuse((*path, "payload", "body"), payload.body, f"one of {', '.join(carriage.bodies)}")


def _drive(path: KeyPath, carriage: Carriage, integrator: str) -> Iterator[Fault]:
    drive, limits = carriage.drive, carriage.drive.limits
    path = (*path, "drive")
    if limits.deceleration is not None and limits.deceleration > limits.emergency_deceleration:
        yield refuse(
            (*path, "limits", "deceleration"),
            limits.deceleration,
            f"at most the emergency_deceleration of {limits.emergency_deceleration:g} m/s^2",
        )
    means = drive.emergency_stop
    given = [name for name in BRAKES if getattr(drive, name) is not None]
    for name in means:
        if name != "drive" and name not in given:
            yield refuse(
                (*path, "emergency_stop"),
                name,
                f"{', '.join(['drive', *given])}",
                detail=", which this drive does not have",
            )
    sheave = [name for name in means if name in BRAKES[:2]]
    if "drive" in means and sheave:
        yield Fault(
            (*path, "emergency_stop"),
            f"given 'drive' and {sheave[0]!r}; allowed: only one of the two, as the drive decelerates at "
            "emergency_deceleration with whatever force that takes",
        )
    if drive.haul_rope is not None and carriage.joint == "fixed":
        yield Fault((*path, "haul_rope"), "given for a carriage whose joint is fixed; allowed: only where it slides")
    for key, used in (("haul_rope", drive.haul_rope is not None), ("emergency_stop", tuple(means) != ("drive",))):
        if used and integrator == "runge_kutta":
            yield Fault((*path, key), "given with the integrator runge_kutta; allowed: only with generalized_alpha")


def _carriers(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    length, strand = scenario.cable.unstrained_length, scenario.strand or scenario.riding
    spacing = scenario.spacing
    if not scenario.drives and strand is None:
        yield Fault(("carriers",), "given for a cable that stands still; allowed: with a drive in drives")
    if carriers.name is not None:
        yield from name_faults(("carriers", "name"), carriers.name)
        own = f"{carriers.name}_[0-9]+({'|'.join(['', *(f'_{body}' for body in carriers.bodies)])})"
        taken = [name for name in (*scenario.carriages, *scenario.drives) if fullmatch(own, name)]
        if taken:
            yield Fault(("carriers", "name"), f"given {carriers.name!r}, which would name {taken[0]!r} twice")
    if carriers.spacing is None and strand is None:
        yield Fault(("carriers", "spacing"), "not given; allowed: a number above 0, in m")
    elif strand is None and spacing > length:
        yield refuse(("carriers", "spacing"), carriers.spacing, f"at most {length:.9g} m, the length of the cable")
    elif scenario.loop_length < length:
        yield refuse(
            ("carriers", "count"),
            carriers.count,
            f"at least {ceil(length / spacing - 1e-09)}, for the cable of {length:.9g} m to fit in",
            detail=f" every {spacing:.9g} m, a loop of {scenario.loop_length:.9g} m",
        )
    if carriers.first is not None and carriers.first > scenario.loop_length:
        yield refuse(("carriers", "first"), carriers.first, f"0 to {scenario.loop_length:.9g} m, on the loop")
    yield from _kinds(scenario, carriers)
    payloads = (carriers.payload, *(kind.payload for kind in carriers.kinds.values()))
    rooms = [room for room in payloads if room is not None]
    limits = [drive.limits.speed for drive in scenario.drives.values()]
    hidden = scenario.loop_length - length
    if rooms and limits and hidden < (least := SHORTEST_STAY * (limits[0] or FASTEST_ROPE)):
        yield Fault(
            ("carriers", "payload"),
            f"given where {with_unit(hidden, 'm', 3)} of the loop are not on the cable; allowed: at least "
            f"{with_unit(least, 'm', 3)}, "
            "so that carriers are in a station for a moment",
        )


def _kinds(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Bodies and payloads, of the only kind or of each."""
    path: KeyPath = ("carriers",)
    if bool(carriers.bodies) == bool(carriers.kinds):
        given = "both are" if carriers.bodies else "none is"
        yield Fault((*path, "bodies"), f"{given} given, bodies and kinds; allowed: bodies where all are of one kind")
    if carriers.kinds and carriers.payload is not None:
        yield Fault((*path, "payload"), "given beside kinds; allowed: a payload of each kind")
    for name in carriers.order:
        if name not in carriers.kinds:
            known = ", ".join(carriers.kinds) or "none, as there are no kinds"
            yield refuse((*path, "order"), name, known)
    for name in carriers.kinds:
        yield from name_faults(("carriers", "kinds", name))
    one = [(("carriers",), carriers.bodies, carriers.payload)]
    for where, bodies, room in one + [
        (("carriers", "kinds", n), k.bodies, k.payload) for n, k in carriers.kinds.items()
    ]:
        yield from _bodies(scenario, where, bodies)
        if room is None:
            continue
        # of a strand the others are what carriers leave its bullwheels with, as the file has it
        for key in ("on_cable",) if room.leaving else ("from_start", "from_end", "on_cable"):
            mass = getattr(room, key)
            if mass is not None and mass > room.capacity:
                yield refuse((*where, "payload", key), mass, f"0 to the capacity of {room.capacity:g} kg")
        if room.body is not None and room.body not in bodies:
            yield refuse((*where, "payload", "body"), room.body, f"one of {', '.join(bodies)}")
