"""Vehicles that can meet on one rope: buffers between them, and detection of vehicles that pass through each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from typing import NamedTuple

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.on_rope.buffer import CLOSEST
from cable_twin.mechanics.parameters import IntArray, System, VehicleBuffers
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario, vehicle_buffer
from cable_twin.scenario.builders.outlines import reach_along

ROUNDING = 1e-6  # m, more than two vehicles that touch are apart


class Pair(NamedTuple):
    """Two vehicles that can meet, by row, the one nearer to the start of the rope first."""

    before: int
    after: int
    room: float  # m, distance of their joints at first contact
    stiffness: float  # N/m
    damping: float  # s/m


class VehicleContacts:
    """Detector of vehicles that have passed through each other: only a drive without force limit overcomes buffers.

    Attributes:
        possible: whether there are vehicles that could meet.

    Args:
        scenario: scenario of one rope.
        rows: row of each of its vehicles among those of all ropes, by name.

    Raises:
        EquilibriumError: two vehicles overlap at the start; the message has the key.
    """

    def __init__(self, scenario: Scenario, rows: Mapping[str, int]) -> None:
        pairs = list(meeting_pairs(scenario))
        names, places = list(scenario.vehicles), [one.arc_length for one in scenario.vehicles.values()]
        self._names = {row: name for name, row in rows.items()}
        self._before = np.array([rows[names[pair.before]] for pair in pairs], dtype=np.int64)
        self._after = np.array([rows[names[pair.after]] for pair in pairs], dtype=np.int64)
        self.possible = bool(pairs)
        for before, after, room, *_ in pairs:
            if places[after] - places[before] < room:
                raise EquilibriumError(
                    f"carriages.{names[after]}.arc_length: given {places[after]:.7g} m, too near to "
                    f"'{names[before]}' at {places[before]:.7g} m; allowed: at least {with_unit(room, 'm', 3)} apart"
                )

    @property
    def pairs(self) -> tuple[IntArray, IntArray]:
        """Rows of vehicles that can meet, (pairs,) each: the one nearer to the start of the rope, and the other."""
        return self._before, self._after

    def found(self, state: State) -> str:
        """Message about two vehicles that have passed through each other, empty without such a pair."""
        if not self.possible:
            return ""
        places, push = state.joints.position, state.push[:, 0]
        for number in np.flatnonzero(places[self._after] - places[self._before] < CLOSEST)[:1].tolist():
            one, other = int(self._before[number]), int(self._after[number])
            return (
                f"'{self._names[one]}' and '{self._names[other]}' are pressed through each other at "
                f"{places[one]:.2f} m of the cable, with {with_unit(push[one], 'N', 3)}; allowed: drives with "
                "limits.force (N), or buffers.stiffness (N/m) that holds them apart"
            )
        return ""


def places_between(scenario: Scenario, name: str) -> tuple[float, float]:
    """Lowest and highest arc length (m) of a vehicle between those beside it on its rope; infinite without any."""
    alone = scenario.of_rope(scenario.rope_of(scenario.vehicles[name]))
    row, vehicles = list(alone.vehicles).index(name), list(alone.vehicles.values())
    low, high = -inf, inf
    for before, after, room, *_ in meeting_pairs(alone):
        if after == row:
            low = max(low, vehicles[before].arc_length + room + ROUNDING)
        elif before == row:
            high = min(high, vehicles[after].arc_length - room - ROUNDING)
    return low, high


def with_buffers(system: System, scenario: Scenario) -> System:
    """System with added buffers between the vehicles of a scenario of one rope."""
    pairs = list(meeting_pairs(scenario))
    count = len(scenario.vehicles)
    entries = sorted(
        [(pair.before, pair.after, 1.0, pair) for pair in pairs]
        + [(pair.after, pair.before, -1.0, pair) for pair in pairs]
    )
    owners = np.array([owner for owner, *_ in entries], dtype=np.int64)
    return system._replace(
        buffers=VehicleBuffers(
            offset=np.searchsorted(owners, np.arange(count + 1)).astype(np.int64),
            other=np.array([other for _, other, _, _ in entries], dtype=np.int64),
            side=np.array([side for _, _, side, _ in entries], dtype=np.float64),
            room=np.array([pair.room for *_, pair in entries], dtype=np.float64),
            stiffness=np.array([pair.stiffness for *_, pair in entries], dtype=np.float64),
            damping=np.array([pair.damping for *_, pair in entries], dtype=np.float64),
            present=bool(pairs),
        )
    )


def meeting_pairs(scenario: Scenario) -> Iterator[Pair]:
    """Pairs of vehicles that can meet: neighbours on the rope, and those with only vehicles of no length between.

    Bodies count as they hang upright; two points, of a `size` of 0, do not meet. Vehicles that are clamped to a moving
    cable or ride a loop keep their distance.
    """
    if scenario.riding is not None:
        return
    vehicles = list(scenario.vehicles.values())
    rows = [row for row, vehicle in enumerate(vehicles) if vehicle.joint != "clamped"]
    rows.sort(key=lambda row: vehicles[row].arc_length)
    reach = {row: reach_along(vehicles[row].bodies.values()) for row in rows}
    buffers = {row: vehicle_buffer(scenario, vehicles[row], sum(reach[row])) for row in rows}
    for number, one in enumerate(rows):
        for other in rows[number + 1 :]:
            room = reach[one][1] + reach[other][0]
            if room > 0.0:
                yield Pair(one, other, room, *_in_series(*buffers[one], *buffers[other]))
            if sum(reach[other]) > 0.0:
                break


def _in_series(stiffness: float, damping: float, other_stiffness: float, other_damping: float) -> tuple[float, float]:
    """Stiffness (N/m) and damping (s/m) of two buffers in series; a stiffness of inf means no buffer."""
    both = 1.0 / (1.0 / stiffness + 1.0 / other_stiffness)
    # each yields its share of depth and rate, and takes as much power as k d c d_dot² of that
    return both, damping * (both / stiffness) ** 2 + other_damping * (both / other_stiffness) ** 2
