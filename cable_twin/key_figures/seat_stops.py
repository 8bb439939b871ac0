"""Stopping distance of passengers, who swing on after clamp and rim have stopped."""

from __future__ import annotations

from collections.abc import Iterator
from math import isnan, nan

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures.figure import KeyFigure
from cable_twin.key_figures.stops import SLOWEST, along_rope
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.vehicles import Carriage

SETTLED = 30.0  # s without going farther than before, after which a stop is over


class SeatStops:
    """Farthest forward travel along the rope of the load of each vehicle after a command to stop.

    The load is the place of the payload, or the centre of mass of the last body. Its way is summed along the rope from
    frame to frame, and swings forward and back; what counts is the farthest until the vehicle is told to move again.

    Args:
        scenario: what runs.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._names, rows, bodies, offsets, movers = [], [], [], [], []
        first = 0
        for row, (name, one) in enumerate(scenario.vehicles.items()):
            if one.bodies:
                self._names.append(name)
                rows.append(row)
                number, offset = _load(one)
                bodies.append(first + number)
                offsets.append(offset)
                carried = bool(scenario.drives) and (
                    one.joint == "clamped" or one.clamped_to or name not in scenario.carriages
                )
                movers.append(frozenset(scenario.drives) if carried else frozenset((name,)))
            first += len(one.bodies)
        self._rows, self._bodies = np.array(rows, np.intp), np.array(bodies, np.intp)
        self._offsets, self._movers = np.array(offsets).reshape(-1, 3), movers
        riding = [number for number, name in enumerate(self._names) if name not in scenario.carriages]
        self._groups = {name: [number] for number, name in enumerate(self._names) if name in scenario.carriages}
        if riding:
            assert scenario.carriers is not None
            self._groups[scenario.carriers.name] = riding
        count = len(rows)
        self._layout: Layout | None = None  # of the frames so far
        self._shown = 0  # number of a frame that is there where poses are
        self._last: Snapshot | None = None  # that shows where they are
        self._under_way = False  # any stop
        self._over: NDArray[np.bool_] = np.ones(count, np.bool_)  # no stop is under way
        self._kinds = [""] * count  # of the last stop
        self._stands: NDArray[np.bool_] = np.zeros(count, np.bool_)  # told to, and not to move since
        self._start = np.zeros(count)  # m/s along the rope at the command
        self._begun, self._farthest_at = np.full(count, nan), np.full(count, nan)  # s
        self._way, self._farthest = np.zeros(count), np.zeros(count)  # m
        self._place = np.full((count, 3), nan)  # m, in the last frame of a stop
        self._found: dict[str, KeyFigure] = {}  # of each group, of the stop that counts
        self._counts: dict[str, str] = {}  # its kind

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        if not self._names:
            return
        if snapshot.layout is not self._layout:
            self._layout = snapshot.layout
            self._shown = int(self._layout.places.body_position[self._bodies[0], 0])
        last = self._last
        if isnan(snapshot.numbers[self._shown]):
            return  # a frame without poses
        if last is None or snapshot.time > last.time:
            self._last = snapshot
            if self._under_way:
                self._go_on(snapshot)
                self._under_way = not self._over.all()

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command at the time of its effect."""
        kind, values = applied.command.kind, applied.command.values
        for number, movers in enumerate(self._movers):
            told = movers & set(values)
            if kind == "emergency_stop":
                self._begin(number, "emergency stop", applied.time)
            elif kind == "speed" and told and not any(values[name] for name in told):
                self._begin(number, "stop", applied.time)
            elif kind == "reset" or (kind in ("speed", "force") and told):
                self._over[number], self._stands[number] = True, False

    def figures(self) -> Iterator[KeyFigure]:
        """Yield the stopping distance of each carriage, and of the carrier whose load went farthest."""
        yield from self._found.values()

    def _begin(self, number: int, kind: str, time: float) -> None:
        """Begin the stop of one vehicle, by index, if it moves and has not been commanded to stop before."""
        last = self._last
        again = self._stands[number] and (kind == "stop" or self._kinds[number] == kind)
        if last is None or again:
            return
        row, self._stands[number] = self._rows[number], True
        speed = float(last.columns.speed[row])
        if abs(speed) > SLOWEST and last.columns.attached[row] == 1.0:
            self._kinds[number], self._over[number], self._under_way = kind, False, True
            self._start[number], self._begun[number] = speed, time
            self._way[number] = -abs(speed) * (time - last.time)  # gone since the last frame, before the command
            self._farthest[number], self._farthest_at[number] = 0.0, time
            self._place[number] = self._loads(last)[number]

    def _go_on(self, snapshot: Snapshot) -> None:
        """Add the travel since the last frame to the stops under way."""
        place = self._loads(snapshot)
        numbers = np.flatnonzero(~self._over)
        along = along_rope(snapshot, self._rows[numbers])
        steps = np.sum((place[numbers] - self._place[numbers]) * along, axis=1) * np.sign(self._start[numbers])
        self._place[numbers] = place[numbers]
        self._way[numbers] += steps
        farther = numbers[self._way[numbers] > self._farthest[numbers]]
        self._farthest[farther], self._farthest_at[farther] = self._way[farther], snapshot.time
        for number in numbers[np.isnan(steps) | (snapshot.time - self._farthest_at[numbers] > SETTLED)]:
            self._over[number] = True
        self._tell(farther)

    def _tell(self, farther: NDArray[np.intp]) -> None:
        """Renew the figures of groups with loads, by index, that have gone farther."""
        for name, numbers in self._groups.items():
            moved = [number for number in farther.tolist() if number in numbers]
            if not moved:
                continue
            number = max(moved, key=lambda one: float(self._farthest[one]))
            kind, before = self._kinds[number], self._found.get(name)
            if before is not None:
                counts = self._counts[name] == "emergency stop" and kind == "stop"
                if counts or (before.time == self._begun[number] and before.value >= self._farthest[number]):
                    continue
            whose = f"{self._names[number]}, " if len(numbers) > 1 else ""
            where = f"{whose}{kind} from {abs(self._start[number]):.2f} m/s, its load along the rope, swing included"
            way = float(self._farthest[number])
            self._counts[name] = kind
            self._found[name] = KeyFigure(
                f"{name}: passenger's stopping distance", way, "m", float(self._begun[number]), where
            )

    def _loads(self, snapshot: Snapshot) -> FloatArray:
        """Positions (vehicles, 3) in m of the loads."""
        c = snapshot.columns
        turn, offset = c.body_orientation[self._bodies], self._offsets
        twice = 2.0 * np.cross(turn[:, :3], offset)
        moved = offset + turn[:, 3:] * twice + np.cross(turn[:, :3], twice)
        loads: FloatArray = c.body_position[self._bodies] + np.where(offset.any(axis=1, keepdims=True), moved, 0.0)
        return loads


def _load(vehicle: Carriage) -> tuple[int, FloatArray]:
    """Return the index of the load-bearing body and the offset (3,) in m of the load from its centre of mass.

    The offset is in the axes of the body.
    """
    names, payload = list(vehicle.bodies), vehicle.payload
    if payload is None:
        return len(names) - 1, np.zeros(3)
    place = np.array(payload.position, dtype=np.float64)
    offset = place if place.size == 3 else np.insert(place, 1, 0.0)
    return (len(names) - 1 if payload.body is None else names.index(payload.body)), offset


__all__ = ["SeatStops"]
