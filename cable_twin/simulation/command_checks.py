"""Checks of commands: each is accepted or refused whole, with the given value and the allowed range."""

from __future__ import annotations

from collections.abc import Mapping

from cable_twin.basics.printable import printable
from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.mechanics.parameters import STRONGEST_WIND, System
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario, command_fault, unknown_name, wind_unfelt
from cable_twin.scenario.sections.vehicles import Carriage

LONGEST_GUST = 600.0  # s; what lasts longer is a wind


def check_drive(command: Command, scenario: Scenario) -> None:
    """Refuse a speed or force command for an unknown or fixed carriage, not finite, or over the limit.

    Raises:
        CommandError: unknown carriage, fixed one, not finite, over the limit.
    """
    if not command.values:
        raise CommandError("a command without a name")
    unit = KINDS[command.kind].unit
    for name, value in command.values.items():
        if fault := command_fault(scenario, command.kind, unit, name, value):
            raise CommandError(fault)


def check_room(command: Command, scenario: Scenario) -> None:
    """Refuse a payload of an unknown carriage, without a payload in the scenario, or beyond the capacity.

    Raises:
        CommandError: unknown carriage, no room, beyond the capacity.
    """
    if not command.values:
        raise CommandError("a payload is given without the name of a carriage")
    for name, mass in command.values.items():
        if name not in scenario.carriages:
            known = ", ".join(key for key, one in scenario.carriages.items() if one.payload is not None)
            what = f"'{name}' is a carrier, loaded in stations as carriers.payload says"
            what = what if name in scenario.vehicles else f"unknown carriage '{printable(name)}'"
            what = f"'{name}' is a drive and carries nothing" if name in scenario.drives else what
            raise CommandError(f"{what}; known: {known or 'none in this scenario'}")
        room = scenario.carriages[name].payload
        if room is None:
            raise CommandError(f"'{name}' has no payload in the scenario")
        if not 0.0 <= mass <= room.capacity:
            raise CommandError(f"payload of '{name}' is {mass:g} kg; allowed are 0 to {room.capacity:g} kg")


def check_station(command: Command, scenario: Scenario, system: System, state: State) -> None:
    """Refuse a payload for a carriage under way or outside the stations.

    Raises:
        CommandError: outside the stations, under way.
    """
    length = system.cable.unstrained_length
    for name in command.values:
        room = scenario.vehicles[name].payload
        assert room is not None
        index = list(scenario.vehicles).index(name)
        place, speed = float(state.joints.position[index]), float(state.joints.velocity[index])
        distance = room.station_distance or 2.0 * float(system.carriages.stop_stroke[index])
        if min(place, length - place) > distance:
            raise CommandError(
                f"payload of '{name}', which is at {place:.1f} m of {length:.1f} m; "
                f"allowed within {distance:g} m of an end of the track"
            )
        if abs(speed) > room.station_speed:
            raise CommandError(
                f"payload of '{name}', which moves at {speed:.3g} m/s; allowed up to {room.station_speed:g} m/s"
            )


def check_wind(command: Command, scenario: Scenario) -> None:
    """Refuse a wind with invalid axes or speeds (m/s).

    Raises:
        CommandError: other axes than x and z, and y in space, not finite, too strong, or felt by nothing.
    """
    _check_speeds(command.kind, command.values, scenario)


def _check_speeds(kind: str, values: Mapping[str, float], scenario: Scenario) -> None:
    """Refuse wind speeds (m/s) by axis that are incomplete, too high, across a planar track or without any effect."""
    if not {"x", "z"} <= {*values} <= {"x", "y", "z"}:
        raise CommandError(f"{kind} given with {printable(', '.join(values)) or 'no axis'}; needed are x and z, in m/s")
    for axis, speed in values.items():
        if not abs(speed) <= STRONGEST_WIND:
            raise CommandError(
                f"{kind} {axis} is {speed:g} m/s; allowed are -{STRONGEST_WIND:g} to {STRONGEST_WIND:g} m/s"
            )
    across = values.get("y", 0.0)
    if across != 0.0 and scenario.dim == 2:
        raise CommandError(
            f"{kind} y is {across:g} m/s; allowed is 0: the twin moves in the plane of the track, x and z"
        )
    if any(values.values()) and (unfelt := wind_unfelt(scenario)):
        speeds = ", ".join(f"{axis} {speed:g}" for axis, speed in values.items())
        raise CommandError(f"{kind} {speeds} m/s, but {unfelt}; allowed: 0 m/s")


def check_gust(command: Command, scenario: Scenario) -> None:
    """Refuse a gust with invalid axes, speeds (m/s) or duration (s).

    Raises:
        CommandError: as a wind, or with a duration that is none.
    """
    kind = command.kind.replace("_", " ")
    speeds = {axis: value for axis, value in command.values.items() if axis != "duration"}
    _check_speeds(kind, speeds, scenario)
    duration = command.values.get("duration", 1.0)
    if not 0.0 < duration <= LONGEST_GUST:
        raise CommandError(f"{kind} duration is {duration:g} s; allowed are more than 0 to {LONGEST_GUST:g} s")


def check_no_gust(command: Command, scenario: Scenario, system: System, state: State) -> None:
    """Refuse a gust during another gust.

    Raises:
        CommandError: with how long it still lasts.
    """
    start, duration = float(state.wind_field.gust[3]), float(state.wind_field.gust[4])
    left = start + duration - float(state.wind_field.time[0])
    if duration > 0.0 and left > 0.5 * system.solver.step:
        kind = command.kind.replace("_", " ")
        raise CommandError(f"{kind} given while another one lasts; allowed: in {left:.3g} s, when that one has ended")


def _known(name: str, scenario: Scenario) -> Carriage:
    if name not in scenario.vehicles:
        raise CommandError(unknown_name(scenario, name))
    return scenario.vehicles[name]
