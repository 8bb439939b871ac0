"""Values of carriages, carriers and drives that are sound alone but not together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import ceil
from re import fullmatch

import numpy as np

from cable_twin.scenario.build import BRAKES, stop_stroke
from cable_twin.scenario.fault import Fault, KeyPath, name_faults, show
from cable_twin.scenario.schema import Body, Carriage, Carriers, Scenario


def vehicle_faults(scenario: Scenario) -> Iterator[Fault]:
    """All of them."""
    yield from _carriages(scenario)
    yield from _moving_cable(scenario)


def _carriages(scenario: Scenario) -> Iterator[Fault]:
    length = scenario.cable.unstrained_length
    for name, carriage in scenario.carriages.items():
        path = ("carriages", name)
        yield from name_faults(path)
        stroke = stop_stroke(scenario, carriage)
        if carriage.joint == "clamped":
            yield from _clamped(scenario, name, carriage)
        elif scenario.drives and carriage.joint is not None:
            yield Fault((*path, "joint"), f"given {carriage.joint!r} on a cable that moves; allowed: clamped")
        elif 2.0 * stroke >= length:
            yield Fault(
                (*path, "end_stop", "stroke"),
                f"given {stroke!r} at both ends of a cable of {length:.9g} m; allowed: less than {length / 2:.9g} m",
            )
        elif carriage.arc_length < stroke or carriage.arc_length > length - stroke:
            yield Fault(
                (*path, "arc_length"),
                f"given {carriage.arc_length!r}; allowed: {stroke:.9g} to {length - stroke:.9g} m, "
                "on the cable and between its end stops",
            )
        yield from _bodies(scenario, path, carriage.bodies)
        yield from _payload(path, carriage)
        yield from _drive(path, carriage, scenario.solver.integrator)


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
                yield Fault((*path, "bodies", name, key), f"given {show(list(given))} in a plane; allowed: x, z in m")
        yield from _inertia(scenario, (*path, "bodies", name, "inertia"), body)


def _inertia(scenario: Scenario, path: KeyPath, body: Body) -> Iterator[Fault]:
    """Inertia that no body has: of its principal moments, none is more than the other two together."""
    if not isinstance(body.inertia, tuple):
        return
    given = show([list(row) if isinstance(row, tuple) else row for row in body.inertia])
    if scenario.dim == 2:
        yield Fault(path, f"given {given} in a plane; allowed: a number above 0, in kg m^2")
        return
    tensor = np.array(body.inertia, dtype=np.float64)
    if tensor.ndim == 2 and (tensor.shape != (3, 3) or not np.array_equal(tensor, tensor.T)):
        yield Fault(path, f"given {given}; allowed: three numbers, or the three rows of a symmetric tensor, in kg m^2")
        return
    low, middle, high = np.sort(np.linalg.eigvalsh(tensor)) if tensor.ndim == 2 else np.sort(tensor)
    if low <= 0.0 or high > (1.0 + 1e-9) * (low + middle):
        yield Fault(
            path,
            f"given {given}, with principal moments {low:g}, {middle:g} and {high:g}; "
            "allowed: all above 0 and none more than the other two together, in kg m^2",
        )


def _clamped(scenario: Scenario, name: str, carriage: Carriage) -> Iterator[Fault]:
    """What of a carriage does not go with a moving cable."""
    path = ("carriages", name)
    if not scenario.drives:
        yield Fault(
            (*path, "joint"), "given 'clamped' on a cable that stands still; allowed: sliding, fixed, or drives"
        )
    elif carriage.arc_length < 0.0 or carriage.arc_length > scenario.loop_length:
        yield Fault(
            (*path, "arc_length"),
            f"given {carriage.arc_length!r}; allowed: 0 to {scenario.loop_length:.9g} m, on the loop of the cable",
        )
    for key in ("rolling", "viscous"):
        if getattr(carriage.friction, key) > 0.0:
            given = getattr(carriage.friction, key)
            yield Fault((*path, "friction", key), f"given {given!r}; allowed: 0, what is clamped does not slide")
    if carriage.drive.mode not in (None, "free"):
        yield Fault(
            (*path, "drive", "mode"),
            f"given {carriage.drive.mode!r}; allowed: free, what is clamped goes with the cable",
        )


def _moving_cable(scenario: Scenario) -> Iterator[Fault]:
    """Drive and carriers of a cable that moves along itself."""
    for name, drive in scenario.drives.items():
        path = ("drives", name)
        yield from name_faults(path)
        if name != next(iter(scenario.drives)):
            yield Fault(path, "given a second drive of the cable; allowed: one")
        if name in scenario.carriages:
            yield Fault(path, "given the name of a carriage; allowed: another one, for commands name both")
        for key, why in (
            ("force", "a moving cable keeps its speed"),
            ("power", "a moving cable keeps its speed"),
            ("deceleration", "a moving cable stops as it starts, at its acceleration"),
        ):
            given = getattr(drive.limits, key)
            if given is not None:
                yield Fault((*path, "limits", key), f"given {given!r}; allowed: null, {why}")
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
        yield Fault(
            (*path, "payload", "mass"), f"given {payload.mass!r}; allowed: 0 to the capacity of {payload.capacity:g} kg"
        )
    if payload.body is not None and payload.body not in carriage.bodies:
        yield Fault(
            (*path, "payload", "body"), f"given {show(payload.body)}; allowed: one of {', '.join(carriage.bodies)}"
        )


def _drive(path: KeyPath, carriage: Carriage, integrator: str) -> Iterator[Fault]:
    drive, limits = carriage.drive, carriage.drive.limits
    path = (*path, "drive")
    if limits.deceleration is not None and limits.deceleration > limits.emergency_deceleration:
        yield Fault(
            (*path, "limits", "deceleration"),
            f"given {limits.deceleration!r}; allowed: at most the emergency_deceleration of "
            f"{limits.emergency_deceleration:g} m/s^2",
        )
    means = drive.emergency_stop
    given = [name for name in BRAKES if getattr(drive, name) is not None]
    for name in means:
        if name != "drive" and name not in given:
            yield Fault(
                (*path, "emergency_stop"),
                f"given {name!r}, which this drive does not have; allowed: {', '.join(['drive', *given])}",
            )
    sheave = [name for name in means if name in BRAKES[:2]]
    if "drive" in means and sheave:
        yield Fault(
            (*path, "emergency_stop"),
            f"given 'drive' and {sheave[0]!r}; allowed: either, for the drive decelerates at emergency_deceleration "
            "with whatever force that takes",
        )
    if drive.haul_rope is not None and carriage.joint == "fixed":
        yield Fault((*path, "haul_rope"), "given for a carriage whose joint is fixed; allowed: only where it slides")
    for key, used in (("haul_rope", drive.haul_rope is not None), ("emergency_stop", tuple(means) != ("drive",))):
        if used and integrator == "runge_kutta":
            yield Fault((*path, key), "given with the integrator runge_kutta; allowed: only with generalized_alpha")


def _carriers(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    length = scenario.cable.unstrained_length
    if not scenario.drives:
        yield Fault(("carriers",), "given for a cable that stands still; allowed: with a drive in drives")
    if carriers.name is not None:
        yield from name_faults(("carriers", "name"), carriers.name)
        taken = [name for name in (*scenario.carriages, *scenario.drives) if fullmatch(f"{carriers.name}_[0-9]+", name)]
        if taken:
            yield Fault(("carriers", "name"), f"given {carriers.name!r}, which would name {taken[0]!r} twice")
    if carriers.spacing > length:
        yield Fault(
            ("carriers", "spacing"),
            f"given {carriers.spacing!r}; allowed: at most {length:.9g} m, the length of the cable",
        )
    elif scenario.loop_length < length:
        yield Fault(
            ("carriers", "count"),
            f"given {carriers.count!r} every {carriers.spacing:.9g} m, a loop of {scenario.loop_length:.9g} m; "
            f"allowed: at least {ceil(length / carriers.spacing - 1e-9)}, for the cable of {length:.9g} m to fit in",
        )
    if carriers.first is not None and carriers.first > scenario.loop_length:
        yield Fault(
            ("carriers", "first"), f"given {carriers.first!r}; allowed: 0 to {scenario.loop_length:.9g} m, on the loop"
        )
    yield from _bodies(scenario, ("carriers",), carriers.bodies)
