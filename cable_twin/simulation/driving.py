"""Effects of commands on drives and brakes of carriages, in the arrays of the state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import Command
from cable_twin.mechanics.drives.haul_rope import hang_in_rope
from cable_twin.mechanics.drives.initial_speed import set_going
from cable_twin.mechanics.drives.motion import take_over
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.parameters import DRUM, FORCE, FREE, SPEED, TRACK_ROPE, System
from cable_twin.mechanics.solution.equilibrium import EquilibriumError
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario


def drive(state: State, index: int, kind: str, value: float) -> None:
    """Set mode ("speed" or "force") and target (m/s or N) of a drive, starting from its present motion."""
    if kind == "force":
        state.drives.mode[index] = FORCE
        state.drives.force[index] = value
        return
    if state.drives.mode[index] != SPEED:
        state.drives.mode[index] = SPEED
        as_python(take_over)(state, index)
    state.drives.target[index] = value


def brake(system: System, state: State, index: int) -> None:
    """Stop one carriage by the means of its scenario: its drive, brakes on it, or the track-rope brake alone."""
    drives = system.carriages
    if drives.clamped[index]:
        return
    braked = bool(drives.brake_force[index].any())
    if state.drives.mode[index] == FREE and not braked:
        return
    stoppable = drives.drive_stops[index] or drives.brake_force[index, :TRACK_ROPE].any()
    if state.drives.mode[index] != FREE or stoppable:
        drive(state, index, "speed" if stoppable else "force", 0.0)
    state.drives.braking[index] = True


def hang_in_ropes(system: System, state: State, names: Sequence[str]) -> None:
    """Initialise every haul rope with the force that holds its carriage.

    Raises:
        EquilibriumError: when a haul rope would have to push; the line names the carriage.
    """
    for index, name in enumerate(names):
        if state.axis[index] != DRUM:
            continue
        force = float(state.drives.force[index])
        if not hang_in_rope(system, state, index, force):
            raise EquilibriumError(
                f"carriages.{name}.drive.haul_rope: it would have to push with {with_unit(abs(force), 'N')} to hold "
                f"the carriage at its start; allowed: a pretension of as much, in N, or the drive at the other station"
            )
        if state.drives.mode[index] != SPEED:
            state.drives.force[index] = 0.0


def set_in_motion(system: System, state: State, scenario: Scenario) -> dict[str, Command]:
    """Set the initial speeds of the scenario; returns the commands that keep them, by carriage or drive."""
    held = {}
    for name, drive in scenario.drives.items():
        if drive.speed != 0.0:
            state.rope.velocity[:] = state.rope_drive.target[0] = drive.speed
            held[name] = Command("speed", {name: drive.speed})
            for index in np.flatnonzero(system.carriages.clamped & state.attached).tolist():
                set_going(system, state, index, drive.speed)
    for index, (name, vehicle) in enumerate(scenario.vehicles.items()):
        if vehicle.speed != 0.0:
            set_going(system, state, index, vehicle.speed)
            if state.drives.mode[index] == SPEED:
                state.drives.target[index] = vehicle.speed
                held[name] = Command("speed", {name: vehicle.speed})
    return held


__all__ = ["brake", "drive", "hang_in_ropes", "set_in_motion"]
