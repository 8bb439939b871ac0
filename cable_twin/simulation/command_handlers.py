"""Handlers of commands: checks and effects of each kind in the table `cable_twin.frame.commands.KINDS`.

A command is accepted or refused whole; a refusal names the given value and the allowed range.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import nan
from typing import Any, NamedTuple

import numpy as np

from cable_twin.basics.printable import printable
from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.parameters import COLDEST, FORCE, GUSTS, HOTTEST, STRONGEST_WIND
from cable_twin.scenario import Scenario, command_fault, wind_unfelt
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.ropeway import Ropeway, drive

GUST_SHAPES = {"gust": "one_minus_cosine", "operating_gust": "operating_gust"}  # by kind of command
GUST_DURATION = 10.5  # s, in IEC 61400-1
LONGEST_GUST = 600.0  # s; what lasts longer is a wind


def check_drive(command: Command, scenario: Scenario) -> None:
    """Refuse a speed or force command for an unknown or fixed carriage, not finite, or over the limit.

    Raises:
        CommandError: unknown carriage, fixed one, not finite, over the limit.
    """
    if not command.values:
        raise CommandError(f"{command.kind}: given no name; allowed: a carriage or drive")
    unit = KINDS[command.kind].unit
    for name, value in command.values.items():
        if fault := command_fault(scenario, command.kind, unit, name, value):
            raise CommandError(fault)


def check_room(command: Command, scenario: Scenario) -> None:
    """Refuse a payload command for an unknown carriage, one without payload in the scenario, or beyond its capacity.

    Raises:
        CommandError: unknown carriage, no room, beyond the capacity.
    """
    if not command.values:
        raise CommandError("payload: given no name; allowed: a carriage")
    for name, mass in command.values.items():
        if name not in scenario.carriages:
            known = ", ".join(key for key, one in scenario.carriages.items() if one.payload is not None)
            what = f"carrier '{name}', which carriers.payload loads in stations"
            what = what if name in scenario.vehicles else f"carriage '{printable(name)}'"
            what = f"drive '{name}'" if name in scenario.drives else what
            raise CommandError(f"payload: given for {what}; allowed: {known or 'none in this scenario'}")
        room = scenario.carriages[name].payload
        if room is None:
            raise CommandError(f"payload of '{name}': given {mass:g} kg; allowed: none, as the scenario has no payload")
        if not 0.0 <= mass <= room.capacity:
            raise CommandError(f"payload of '{name}': given {mass:g} kg; allowed: 0 to {room.capacity:g} kg")


def check_station(command: Command, ropeway: Ropeway) -> None:
    """Refuse a payload for a carriage under way or outside the stations.

    Raises:
        CommandError: outside the stations, under way.
    """
    system, state = ropeway.system, ropeway.state
    length = system.cable.unstrained_length
    for name in command.values:
        room, index = ropeway.vehicles[name].payload, ropeway.rows[name]
        assert room is not None
        place, speed = float(state.joints.position[index]), float(state.joints.velocity[index])
        distance = room.station_distance or 2.0 * float(system.carriages.stop_stroke[index])
        if min(place, length - place) > distance:
            raise CommandError(
                f"payload of '{name}': given at {place:.1f} m of {length:.1f} m; "
                f"allowed: within {distance:g} m of an end of the track"
            )
        if abs(speed) > room.station_speed:
            raise CommandError(
                f"payload of '{name}': given at a speed of {speed:.3g} m/s; allowed: up to {room.station_speed:g} m/s"
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
        raise CommandError(f"{kind}: given {printable(', '.join(values)) or 'no axis'}; allowed: x, z or x, y, z, m/s")
    for axis, speed in values.items():
        if not abs(speed) <= STRONGEST_WIND:
            raise CommandError(
                f"{kind} {axis}: given {speed:g} m/s; allowed: -{STRONGEST_WIND:g} to {STRONGEST_WIND:g} m/s"
            )
    across = values.get("y", 0.0)
    if across != 0.0 and scenario.dim == 2:
        raise CommandError(
            f"{kind} y: given {across:g} m/s; allowed: 0 m/s, as the twin moves in the plane of the track, x and z"
        )
    if any(values.values()) and (unfelt := wind_unfelt(scenario)):
        speeds = ", ".join(f"{axis} {speed:g}" for axis, speed in values.items())
        raise CommandError(f"{kind}: given {speeds} m/s: {unfelt}; allowed: 0 m/s")


def check_temperature(command: Command, _: Scenario) -> None:
    """Refuse a rope temperature (degC) that is not finite, or outside the range of outdoor temperatures.

    Raises:
        CommandError: the temperature is no number, or out of range.
    """
    value = command.values.get("ropes", nan)
    if not COLDEST <= value <= HOTTEST:
        raise CommandError(f"temperature: given {value:g} degC; allowed: {COLDEST:g} to {HOTTEST:g} degC")


def check_gust(command: Command, scenario: Scenario) -> None:
    """Refuse a gust with invalid axes, speeds (m/s) or duration (s).

    Raises:
        CommandError: axes or speeds are invalid as of a wind, or the duration is invalid.
    """
    kind = command.kind.replace("_", " ")
    speeds = {axis: value for axis, value in command.values.items() if axis != "duration"}
    _check_speeds(kind, speeds, scenario)
    duration = command.values.get("duration", 1.0)
    if not 0.0 < duration <= LONGEST_GUST:
        raise CommandError(f"{kind} duration: given {duration:g} s; allowed: more than 0 to {LONGEST_GUST:g} s")


def check_no_gust(command: Command, ropeway: Ropeway) -> None:
    """Refuse a gust during another gust.

    Raises:
        CommandError: another gust lasts; the message has the remaining time.
    """
    field = ropeway.state.wind_field
    start, duration = float(field.gust[3]), float(field.gust[4])
    left = start + duration - float(field.time[0])
    if duration > 0.0 and left > 0.5 * ropeway.system.solver.step:
        kind = command.kind.replace("_", " ")
        raise CommandError(f"{kind}: given while another one lasts; allowed: in {left:.3g} s, when that has ended")


class Handler(NamedTuple):
    """Checks and effects of one kind of command; a check raises CommandError."""

    change: Callable[[Ropeway, Command], None] | None  # effect on each rope and its vehicles
    check: Callable[[Command, Scenario], None] | None = None  # refuses commands impossible in any state
    check_motion: Callable[[Command, Ropeway], None] | None = None  # refuses by the present motion
    between: Callable[[Engine, Command], None] | None = None  # effect on bullwheels and the whole lift


def check_ahead(scenario: Scenario, command: Command, *, stopped: bool) -> Command:
    """Refuse a command impossible in any state; `stopped`: whether an emergency stop is in force by then.

    Returns:
        The command, with floats for numbers of any other type, such as those of arrays.

    Raises:
        CommandError: one line with what was given and what is allowed.
    """
    if not isinstance(command, Command):
        raise CommandError(f"command: given {command!r}; allowed: a `Command` with kind and values")
    if command.kind not in HANDLERS:
        raise CommandError(f"command: given kind {command.kind!r}; allowed: {', '.join(HANDLERS)}")
    if KINDS[command.kind].drives and stopped:
        raise CommandError("the emergency stop is in force: release it before the next command")
    command = Command(command.kind, {name: _float(command.kind, name, one) for name, one in command.values.items()})
    if (check := HANDLERS[command.kind].check) is not None:
        check(command, scenario)
    return command


def _float(kind: str, name: str, value: Any) -> float:
    """Value of a command as a float; refuses texts and arrays of several numbers."""
    if not hasattr(value, "__float__") or np.ndim(value):
        what = f"{kind.replace('_', ' ')} of '{printable(name)}'"
        raise CommandError(f"{what}: given {value!r}; allowed: a number in {KINDS[kind].unit_of(name)}")
    return float(value)


def take_effect(engine: Engine, scenario: Scenario, command: Command) -> Command:
    """Apply a command: whole or, with an error, not at all; returns it as it was applied.

    Args:
        engine: Engine with the ropes and couplings that the command acts on.
        scenario: The whole scenario.
        command: Command of any kind.

    Raises:
        CommandError: one line with what was given and what is allowed.
    """
    command = check_ahead(scenario, command, stopped=engine.parts[0].stopped)
    effect = HANDLERS[command.kind]
    shares = [(part, _share(command, part)) for part in engine.parts]
    acting = engine.acting()
    for part, share in shares:
        if effect.check_motion is not None:
            effect.check_motion(share, part)
    for part, share in shares:
        if effect.change is not None:
            effect.change(part, share)
    if effect.between is not None:
        effect.between(engine, command)
    if engine.acting() != acting:
        engine.forget_accelerations()
    return command


def _share(command: Command, part: Ropeway) -> Command:
    """Part of a command for one rope: values of vehicles and drives on it; a command without names stays whole."""
    kind = KINDS[command.kind]
    if kind.axes or not kind.quantity:
        return command
    own = {name: value for name, value in command.values.items() if name in part.rows or name in part.scenario.drives}
    return Command(command.kind, own)


def _drive(ropeway: Ropeway, command: Command) -> None:
    for name, value in command.values.items():
        if name in ropeway.scenario.drives:
            ropeway.state.rope_drive.target[0] = value
        else:
            drive(ropeway.state, ropeway.rows[name], command.kind, value)
        ropeway.commands[name] = Command(command.kind, {name: value})


def _set_wind(ropeway: Ropeway, command: Command) -> None:
    values = command.values
    wind = np.array(ropeway.scenario.vector((values["x"], values.get("y", 0.0), values["z"])))
    if ropeway.system.air.varies:  # it is elsewhere another one, as the next step finds out
        ropeway.state.wind[:] = wind
    else:
        set_wind(ropeway.state, wind)


def _gust(ropeway: Ropeway, command: Command) -> None:
    values, field = command.values, ropeway.state.wind_field
    duration = values.get("duration", GUST_DURATION)
    amplitude = values["x"], values.get("y", 0.0), values["z"]
    field.gust[:] = *amplitude, field.time[0], duration, GUSTS.index(GUST_SHAPES[command.kind])


def _set_temperature(ropeway: Ropeway, command: Command) -> None:
    ropeway.state.temperature[0] = command.values["ropes"]


def _stop(ropeway: Ropeway, _: Command) -> None:
    ropeway.stop()


def _release(ropeway: Ropeway, _: Command) -> None:
    state = ropeway.state
    ropeway.stopped = False
    for row in np.flatnonzero(state.drives.braking).tolist():
        if state.drives.mode[row] == FORCE:  # let go for its track-rope brake alone: the drive holds again
            drive(state, row, "speed", 0.0)
    state.drives.braking[:] = False
    state.rope_drive.braking[:] = False


def _reset(ropeway: Ropeway, _: Command) -> None:
    ropeway.stopped = False


HANDLERS: Mapping[str, Handler] = {
    "speed": Handler(_drive, check_drive, between=Engine.drive),
    "force": Handler(_drive, check_drive, between=Engine.drive),
    "payload": Handler(None, check_room, check_station, Engine.load),
    "wind": Handler(_set_wind, check_wind),
    "temperature": Handler(_set_temperature, check_temperature, between=Engine.follow_temperature),
    **dict.fromkeys(GUST_SHAPES, Handler(_gust, check_gust, check_no_gust)),
    "emergency_stop": Handler(_stop, between=Engine.stop),
    "release": Handler(_release, between=Engine.release),
    "reset": Handler(_reset, between=Engine.go_back),
}
assert HANDLERS.keys() == KINDS.keys(), "a kind without a handler, or a handler without a kind"
