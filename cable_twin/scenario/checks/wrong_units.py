"""Checks for values that no rope and no vehicle has, as those in another unit: mm for m, kN for N, t for kg.

Limits are wide enough for studies: ropes without mass, soft or stiff ones, and points as vehicles.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, inf, nan, pi, sqrt

from cable_twin.basics.units import rounded, with_unit
from cable_twin.scenario.checks.fault import Fault, KeyPath, refuse, show, unit_of
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.drives import HaulRope
from cable_twin.scenario.sections.line import Cable
from cable_twin.scenario.sections.vehicles import Body, Carriage, CarrierKind

DENSITIES = 1.0, 25e3  # kg/m^3 by the diameter or metal_area; of steel 4500 to 8500, of a rope without mass less
STRAINS = 1e-4, 2.0  # at the breaking force; of steel ropes 0.005 to 0.03, and by a force or EA in kN 1000 times off
STIFFEST = 1e4  # times a solid bar of the same diameter, the most that a rope has; in N mm^2 10^6 times off
WIDEST = 20.0  # m, radius of gyration of a body; of cabins 1 to 2, and with a mass in t 30 times that
FARTHEST = 100.0  # m, of a pivot from the centre of mass


def rope_faults(cable: Cable) -> Iterator[Fault]:
    """Errors of a rope's diameter, metal area, breaking forces and bending stiffness beside its mass and stiffness."""
    mass, stiffness = cable.mass_per_length, cable.axial_stiffness
    with_mass = f"with the mass_per_length of {show(mass, 'kg/m')}"
    for key, power, factor in (("diameter", 2, 0.25 * pi), ("metal_area", 1, 1.0)):
        given = getattr(cable, key)
        if given is None or not (density := mass / (factor * given**power)):
            continue
        if density < DENSITIES[0] or density > DENSITIES[1]:
            most, least = ((mass / (factor * limit)) ** (1.0 / power) for limit in DENSITIES)
            size = f"{rounded(least, 3)} to {rounded(most, 3)} {unit_of(('cable', key))}"
            allowed = f"{size}, for {DENSITIES[0]:g} to {DENSITIES[1]:g} kg/m^3"
            yield refuse(("cable", key), given, allowed, f"{with_mass} a density of {density:.3g} kg/m^3")
    yield from breaking_faults(("cable",), cable)
    bar = stiffness * (nan if cable.diameter is None else cable.diameter) ** 2 / 16.0
    if cable.bending_stiffness > STIFFEST * bar:
        why = f"a solid bar of its diameter and axial_stiffness has {rounded(bar, 3)} N m^2"
        allowed = f"up to {rounded(STIFFEST * bar, 3)} N m^2, {STIFFEST:g} times that"
        yield refuse(("cable", "bending_stiffness"), cable.bending_stiffness, allowed, why)


def breaking_faults(path: KeyPath, rope: Cable | HaulRope) -> Iterator[Fault]:
    """Errors of a rope's breaking forces beside its stiffness."""
    stiffness = rope.axial_stiffness
    for key in ("breaking_force", "calculated_breaking_force", "tested_breaking_force"):
        given = getattr(rope, key)
        if given is not None and (given < STRAINS[0] * stiffness or given > STRAINS[1] * stiffness):
            low, high = (rounded(strain * stiffness, 3) for strain in STRAINS)
            allowed = f"{low} to {high} N, for {100.0 * STRAINS[0]:g} to {100.0 * STRAINS[1]:g} %"
            strain = rounded(100.0 * given / stiffness, 3)
            why = (
                f"with the axial_stiffness of {show(stiffness, 'N')} a strain of {strain} %, of steel ropes 0.5 to 3 %"
            )
            yield refuse((*path, key), given, allowed, why)


def body_faults(path: KeyPath, body: Body) -> Iterator[Fault]:
    """Errors of a body's pivots far from its centre of mass, and of an inertia that is too large for its mass."""
    for key in ("upper_pivot", "lower_pivot"):
        given = getattr(body, key)
        if given is not None and hypot(*given) > FARTHEST:
            yield refuse((*path, key), given, f"within {FARTHEST:g} m of the centre of mass")
    if body.inertia > (most := body.mass * WIDEST**2):
        radius = sqrt(body.inertia / body.mass)
        why = f"with the mass of {show(body.mass, 'kg')} a radius of gyration of {rounded(radius, 3)} m"
        yield refuse((*path, "inertia"), body.inertia, f"up to {rounded(most, 3)} kg m^2, for {WIDEST:g} m", why)


def overload_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors of vehicles and tensioning devices that weigh or pull more than their ropes bear before they break."""
    ropes = {
        name: inf if rope.breaking_force is None else rope.breaking_force for name, rope in scenario.cables.items()
    }
    for name, rope in scenario.cables.items():
        for end, support in rope.ends.items():
            if support.support == "counterweight":
                path = (*scenario.rope_key(name).split("."), end)
                yield from _overload(path, support.mass, support.force, scenario.gravity, ropes[name])
    for name, sheave in scenario.sheaves.items():
        strength = sum(ropes.get(end.partition(".")[0], inf) for end in sheave.joins) or inf
        if (weight := sheave.counterweight) is not None:
            path = ("sheaves", name, "counterweight")
            yield from _overload(path, weight.mass, weight.force, scenario.gravity, strength)
        if (cylinder := sheave.hydraulics) is not None:
            yield from _overload(("sheaves", name, "hydraulics"), None, cylinder.force, scenario.gravity, strength)
    kinds: dict[KeyPath, Carriage | CarrierKind] = {
        ("carriages", name): one for name, one in scenario.carriages.items()
    }
    if scenario.carriers is not None:
        kinds.update(scenario.carriers.kinds_by_path.items())
    strongest = max(ropes.values())
    for at, kind in kinds.items():
        full = sum(body.mass for body in kind.bodies.values()) + (kind.payload.capacity if kind.payload else 0.0)
        if full * scenario.gravity > strongest:
            heavy = {(*at, "bodies", name, "mass"): body.mass for name, body in kind.bodies.items()}
            heavy |= {(*at, "payload", "capacity"): kind.payload.capacity} if kind.payload else {}
            heaviest = max(heavy, key=lambda path: heavy[path])
            why = f"the vehicle weighs {with_unit(full * scenario.gravity, 'N')} in all"
            allowed = f"a vehicle of less than {with_unit(strongest, 'N')}, with which its rope breaks"
            yield refuse(heaviest, heavy[heaviest], allowed, why)


def _overload(
    path: KeyPath, mass: float | None, force: float | None, gravity: float, strength: float
) -> Iterator[Fault]:
    """Error of a tensioning device that pulls with more than the breaking force (N) of its rope or strands."""
    pull = (mass or nan) * gravity if force is None else force
    if pull > strength:
        key, given = ("mass", mass) if force is None else ("force", force)
        allowed = f"less than {with_unit(strength, 'N')}, with which its rope breaks"
        yield refuse((*path, key), given, allowed, f"a pull of {with_unit(pull, 'N')}")
