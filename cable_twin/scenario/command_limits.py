"""Limits of commands to carriages and drives: one source for refusals, robot_description, lists and gym."""

from __future__ import annotations

from math import exp, inf, isfinite
from typing import NamedTuple

from cable_twin.basics.printable import printable
from cable_twin.basics.units import rounded, with_unit
from cable_twin.scenario.builders.vehicles import stop_stroke
from cable_twin.scenario.schema import Scenario

SAFETY = 4.5  # -, of a haul rope in operation
BREAKING_STRAIN = 0.02  # -, of a rope whose breaking force is not given; assumed


class CommandLimits(NamedTuple):
    """Largest commands in either direction; inf without a limit, a force of 0 where no force command is accepted."""

    speed: float  # m/s
    force: float  # N

    def of(self, kind: str) -> float:
        """Limit of commands of a kind, speed (m/s) or force (N)."""
        return self.speed if kind == "speed" else self.force


def command_limits(scenario: Scenario) -> dict[str, CommandLimits]:
    """Command limits by name: drives of ropes, then self-propelled carriages."""
    found = {name: limits_of(scenario, name) for name in (*scenario.drives, *scenario.carriages)}
    return {name: limits for name, limits in found.items() if limits is not None}


def limits_of(scenario: Scenario, name: str) -> CommandLimits | None:
    """Command limits of a drive or carriage; None for a name that accepts no commands."""
    if (drive := scenario.drives.get(name)) is not None:
        force = 0.0 if drive.sheave is None else most_by_drive(scenario, name)
        return CommandLimits(_or_none(drive.limits.speed), force)
    carriage = scenario.carriages.get(name)
    if carriage is None or carriage.joint != "sliding" or carriage.clamped_to:
        return None
    return CommandLimits(_or_none(carriage.drive.limits.speed), _or_none(carriage.drive.limits.force))


def command_fault(scenario: Scenario, kind: str, unit: str, name: str, value: float) -> str | None:
    """Reason in a line for refusing a speed or force of a drive or carriage; None if it is allowed.

    Args:
        scenario: scenario of the twin.
        kind: "speed" or "force".
        unit: unit of the value, m/s or N.
        name: name of a drive or carriage.
        value: commanded value.
    """
    if (limits := limits_of(scenario, name)) is None:
        return _not_commanded(scenario, name)
    if (limit := limits.of(kind)) == 0.0:
        return f"force of '{name}': given {with_unit(value, 'N')}; allowed: none, as this drive takes speeds only (m/s)"
    if not isfinite(value):
        return f"{kind} of '{name}': given {value} {unit}; allowed: a finite number"
    if abs(value) > limit:
        most = rounded(limit, 6)
        return f"{kind} of '{name}': given {rounded(value, 6)} {unit}; allowed: -{most} to {most} {unit}"
    return None


def _not_commanded(scenario: Scenario, name: str) -> str:
    """Error message about a vehicle, or an unknown name, that accepts no speed or force commands."""
    if name not in scenario.vehicles:
        return unknown_name(scenario, name)
    carriage, drives = scenario.vehicles[name], ", ".join(scenario.drives) or "none in this scenario"
    if carriage.joint == "clamped":
        return f"'{name}' moves with the cable and takes no command; allowed drives: {drives}"
    if carriage.clamped_to:
        return f"'{name}' is clamped to {' and '.join(carriage.clamped_to)}, which pulls it; allowed drives: {drives}"
    return f"'{name}' is fixed to the cable and takes no command; allowed: a carriage that slides, or a drive"


def unknown_name(scenario: Scenario, name: str) -> str:
    """Message for a command to a name that the scenario does not have."""
    own = [other for other, one in scenario.vehicles.items() if one.joint != "clamped" and not one.clamped_to]
    known = ", ".join([*scenario.drives, *own]) or "none in this scenario"
    return f"carriage or drive: given '{printable(name)}'; allowed: {known}"


def places_of(scenario: Scenario, name: str) -> tuple[float, float]:
    """Range (m) of position commands: arc lengths between the end stops, or rope travel of a drive.

    Args:
        scenario: scenario of the twin.
        name: name of a drive or carriage.

    Returns:
        Lowest and highest place; infinite for a drive without `travel`.
    """
    if (drive := scenario.drives.get(name)) is not None:
        return drive.travel or (-inf, inf)
    carriage = scenario.carriages[name]
    if carriage.joint == "fixed":
        return carriage.arc_length, carriage.arc_length
    alone = scenario.of_rope(scenario.rope_of(carriage))
    stroke = stop_stroke(alone, carriage)
    return stroke, alone.cable.unstrained_length - stroke


def most_by_drive(scenario: Scenario, name: str) -> float:
    """Force (N) on a bullwheel that its drive gives, and above which the rope slips at its highest allowed tension."""
    drive = scenario.drives[name]
    sheave = scenario.sheaves[str(drive.sheave)]
    ropes = [scenario.ropes[name] for name in sheave.ropes]
    breaking = [BREAKING_STRAIN * rope.axial_stiffness for rope in ropes]
    breaking += [rope.breaking_force for rope in ropes if rope.breaking_force is not None]
    by_friction = min(breaking) / SAFETY * (1.0 - exp(-sheave.friction * sheave.wrap))
    return min(by_friction, _or_none(drive.limits.force))


def unbraked(scenario: Scenario) -> frozenset[str]:
    """Names of carriages without a brake in an emergency stop, which coast on in one while their drive is free."""
    drives = {name: one.drive for name, one in scenario.carriages.items()}
    return frozenset(
        name for name, drive in drives.items() if not any(getattr(drive, means, None) for means in drive.emergency_stop)
    )


def _or_none(limit: float | None) -> float:
    return inf if limit is None else limit


class TravelRange(NamedTuple):
    """Range of travel of a haul rope, from its initial position, that keeps its carriage between the end stops."""

    low: float  # m
    high: float  # m


def travel_between_stops(scenario: Scenario, name: str) -> TravelRange:
    """Travel of the haul rope between the end stops of a clamped carriage, for inextensible ropes."""
    carriage = scenario.carriages[name]
    track = scenario.rope_of(carriage)
    stroke, length = stop_stroke(scenario.of_rope(track), carriage), scenario.ropes[track].unstrained_length
    ends = (sense_of(scenario, name) * (end - carriage.arc_length) for end in (stroke, length - stroke))
    return TravelRange(*sorted(ends))


def sense_of(scenario: Scenario, name: str) -> float:
    """Sense of a carriage's track rope relative to its haul rope: 1 where both run in one direction, else -1."""
    carriage = scenario.carriages[name]
    haul = scenario.ropes[next(iter(carriage.clamped_to))]
    track = scenario.ropes[scenario.rope_of(carriage)]
    lengths = [rope.end.position[0] - rope.start.position[0] for rope in (track, haul)]
    return 1.0 if lengths[0] * lengths[1] >= 0.0 else -1.0
