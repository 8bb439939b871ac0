"""Checks and effects of each kind of command, for the table of kinds in `cable_twin.frame.commands`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.mechanics.on_rope.wind import set_wind
from cable_twin.mechanics.parameters import FORCE, GUSTS, System
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario
from cable_twin.simulation.command_checks import (
    check_drive,
    check_gust,
    check_no_gust,
    check_room,
    check_station,
    check_wind,
)
from cable_twin.simulation.driving import drive
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.loading import load
from cable_twin.simulation.ropeway import Ropeway

GUST_SHAPES = {"gust": "one_minus_cosine", "operating_gust": "operating_gust"}  # by kind of command
GUST_DURATION = 10.5  # s, in IEC 61400-1


class Effect(NamedTuple):
    """Checks and effects of one kind of command; a check raises CommandError."""

    change: Callable[[Ropeway, Command], None]  # on each rope
    check: Callable[[Command, Scenario], None] | None = None  # refuses what no motion makes possible
    check_motion: Callable[[Command, Scenario, System, State], None] | None = None  # what the present one forbids
    between: Callable[[Engine, Command], None] | None = None  # on no rope alone, as on the bullwheels of a loop


def check_ahead(scenario: Scenario, command: Command, *, stopped: bool) -> None:
    """Refuse a command impossible in any state; `stopped` tells of an emergency stop in force by then.

    Raises:
        CommandError: one line with what was given and what is allowed.
    """
    if command.kind not in EFFECTS:
        raise CommandError(f"a command of kind {command.kind!r}; known: {', '.join(EFFECTS)}")
    if KINDS[command.kind].drives and stopped:
        raise CommandError("the emergency stop is in force: release it before the next command")
    if (check := EFFECTS[command.kind].check) is not None:
        check(command, scenario)


def take_effect(engine: Engine, scenario: Scenario, command: Command) -> None:
    """Apply a command: whole or, with an error, not at all.

    Args:
        engine: What it acts on.
        scenario: The whole of it.
        command: Of any kind.

    Raises:
        CommandError: one line with what was given and what is allowed.
    """
    check_ahead(scenario, command, stopped=engine.parts[0].stopped)
    effect = EFFECTS[command.kind]
    shares = [(part, _share(command, part)) for part in engine.parts]
    for part, share in shares:
        if effect.check_motion is not None:
            effect.check_motion(share, part.scenario, part.system, part.state)
    for part, share in shares:
        effect.change(part, share)
    if effect.between is not None:
        effect.between(engine, command)


def _share(command: Command, part: Ropeway) -> Command:
    """Share of a command for one rope: values for its vehicles and drives, all of a command without names."""
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


def _load(ropeway: Ropeway, command: Command) -> None:
    load(ropeway, command.values)


def _blow(ropeway: Ropeway, command: Command) -> None:
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
    ropeway.go_back()


EFFECTS: Mapping[str, Effect] = {
    "speed": Effect(_drive, check_drive, between=Engine.drive),
    "force": Effect(_drive, check_drive, between=Engine.drive),
    "payload": Effect(_load, check_room, check_station),
    "wind": Effect(_blow, check_wind),
    **dict.fromkeys(GUST_SHAPES, Effect(_gust, check_gust, check_no_gust)),
    "emergency_stop": Effect(_stop, between=Engine.stop),
    "release": Effect(_release, between=Engine.release),
    "reset": Effect(_reset, between=Engine.go_back),
}
assert EFFECTS.keys() == KINDS.keys(), "a kind without an effect, or an effect without a kind"


__all__ = ["check_ahead", "take_effect"]
