"""Commands of a script given at a place instead of a time."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from math import copysign
from typing import TYPE_CHECKING, Any, NamedTuple

from cable_twin.frame.records import CommandError
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation

if TYPE_CHECKING:
    from cable_twin.offline.script import ScriptedCommand

ALLOWED = "allowed: {name: VEHICLE or DRIVE, position: m along the cable}"
FASTER = 5.0  # m/s by which nothing gets faster within a frame


class Place(NamedTuple):
    """Place of a command: reached when the joint of a vehicle, or the cable of a drive, passes in either direction."""

    name: str
    position: float  # m, arc length of a vehicle, cable that has gone by of a drive


def place_of(given: Any) -> Place:
    """Parse the value of `at` in a script.

    Raises:
        ValueError: it is no place; the line has what is allowed.
    """
    if not isinstance(given, dict) or set(given) != {"name", "position"}:
        raise ValueError(f"at {dict(given) if isinstance(given, dict) else given!r} given; {ALLOWED}")
    name, position = given["name"], given["position"]
    if not isinstance(name, str) or isinstance(position, bool) or not isinstance(position, int | float):
        raise ValueError(f"at {dict(given)} given; {ALLOWED}")
    if not abs(position) <= sys.float_info.max:  # isfinite fails for a whole number of four hundred digits
        raise ValueError(f"at position {position} given; allowed: a finite number, in m")
    return Place(name, float(position))


def check_place(place: Place, scenario: Scenario) -> None:
    """Refuse a place that cannot be passed.

    Raises:
        CommandError: there is no such vehicle or drive, or its cable does not reach there.
    """
    length = scenario.cable.unstrained_length
    if place.name in scenario.drives:
        return
    if place.name not in scenario.vehicles:
        known = ", ".join([*scenario.drives, *scenario.vehicles]) or "none in this scenario"
        raise CommandError(f"at '{place.name}'; known: {known}")
    if not 0.0 <= place.position <= length:
        raise CommandError(f"at {place.position:g} m of '{place.name}'; allowed: 0 to {length:g} m, on the cable")


class PlaceWatch:
    """Commands that wait for a place; each is given once.

    Args:
        script: those with a place; each waits from its time on.
    """

    def __init__(self, script: Iterable[ScriptedCommand]) -> None:
        self._waiting: list[tuple[ScriptedCommand, float]] = []  # with the side on which it was, 0 where not looked at
        self._later = sorted(script, key=lambda item: item.time)

    @property
    def left(self) -> list[str]:
        """Messages about commands whose place has not been reached."""
        waiting = [*(item for item, _ in self._waiting), *self._later]
        return [f"{one.place}: '{one.at.name}' has not passed {one.at.position:g} m" for one in waiting if one.at]

    def reached(self, simulation: Simulation) -> list[ScriptedCommand]:
        """Commands whose place has been reached since the last call, removed from the waiting ones."""
        while self._later and self._later[0].time <= simulation.time + 0.5 * simulation.step:
            self._waiting.append((self._later.pop(0), 0.0))
        found, waiting = [], []
        for item, before in self._waiting:
            distance = _distance(item, simulation)[0]
            if distance == 0.0 or (distance * before < 0.0 and abs(distance - before) < _half(simulation)):
                found.append(item)
            else:
                waiting.append((item, distance))
        self._waiting = waiting
        return found

    def near(self, simulation: Simulation, duration: float) -> bool:
        """Whether a place may be reached within `duration` (s), and each step has to be checked."""
        if self._later and self._later[0].time <= simulation.time + duration:
            return True
        for item, _ in self._waiting:
            distance, speed = _distance(item, simulation)
            if abs(distance) <= (abs(speed) + FASTER) * duration:
                return True
        return False


def _half(simulation: Simulation) -> float:
    """Half the rope length (m); a larger jump of a place means the change to the other strand."""
    return 0.5 * simulation.scenario.cable.unstrained_length


def _distance(item: ScriptedCommand, simulation: Simulation) -> tuple[float, float]:
    """Distance (m) past the place of a command, negative before it, and speed (m/s)."""
    assert item.at is not None
    columns, layout = simulation.snapshot.columns, simulation.layout
    name, position = item.at
    if (row := layout.drive_rows.get(name)) is not None:
        return float(columns.drive_position[row]) - position, float(columns.drive_speed[row])
    row = layout.vehicle_rows[name]
    place = float(columns.arc_length[row])
    if not columns.attached[row]:  # in a station: on neither side
        return copysign(_half(simulation) + abs(place - position), place - position), 0.0
    return place - position, float(columns.speed[row])


__all__ = ["Place", "PlaceWatch", "check_place", "place_of"]
