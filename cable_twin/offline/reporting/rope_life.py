"""Counts for the life of ropes: bends over sheaves and bullwheels with the tension there, and cycles by rainflow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.offline.lines.at_rest import haul_travel
from cable_twin.scenario import Scenario

POINTS = 64  # of a rope that are followed
STEPS = 2001  # places of a rope point along a trip
BLOCK = 2000  # frames between reductions of histories to their turning points
BULLWHEEL, TOWER = "bullwheel", "tower"


class Bend(NamedTuple):
    """Bends of a rope at one bullwheel or tower during a trip, with diameter, angle and tension.

    Attributes:
        name: of the bullwheel or tower.
        kind: `BULLWHEEL` or `TOWER`.
        sheaves: number of sheaves that bend the rope there.
        diameter: m, of a bullwheel; NaN for the rollers of a tower, whose diameter a scenario does not have.
        angle: rad, by which each sheave bends the rope, of a tower on average in the run.
        passes: times that the most bent rope point passes in a trip.
        tension: (3,) N, lowest, mean and highest in the run there.
    """

    name: str
    kind: str
    sheaves: int
    diameter: float
    angle: float
    passes: int
    tension: tuple[float, float, float]

    @property
    def cycles(self) -> int:
        """Bending cycles (straight, bent, straight) of the most bent rope point at the bullwheel or tower in a trip."""
        return self.sheaves * self.passes


@dataclass(frozen=True, slots=True)
class RopeLife:
    """Fatigue cycle counts of one closed loop of strands, or of one rope without bullwheels: bends, tension cycles.

    Attributes:
        name: of the strands.
        length: m, unstrained, of the loop; 0 for a rope without bullwheels, which has counts of the run alone.
        trip: m, of rope travel in a trip: all round, or there and back.
        circulates: whether a trip is all round.
        bends: bends of the most bent point in a trip.
        trips: trips in the run by the travel of the rope.
        per_trip: cycles of tension in a trip at the point with the largest range, along the mean tension of the run.
        in_run: cycles of tension in the run at the point with the largest range.
    """

    name: str
    length: float
    trip: float
    circulates: bool
    bends: Sequence[Bend]
    trips: float
    per_trip: Sequence[Cycle]
    in_run: Sequence[Cycle]


class _Followed:
    """Tension histories of followed points of a rope, kept as turning points for rainflow counting."""

    def __init__(self) -> None:
        self._turns: list[FloatArray] = []
        self._block: list[FloatArray] = []

    def add(self, tension: FloatArray) -> None:
        """Add the tensions (points,) in N at the followed rope points in a frame."""
        self._block.append(tension)
        if len(self._block) >= BLOCK:
            self._reduce()

    def _reduce(self) -> None:
        columns = np.array(self._block).T
        before = self._turns or [np.empty(0)] * len(columns)
        self._turns = [turning_points(np.concatenate(both)) for both in zip(before, columns, strict=True)]
        self._block = []

    def cycles(self) -> list[Cycle]:
        """Tension cycles at the followed rope point with the largest range of tension."""
        if self._block:
            self._reduce()
        counted = [one for one in self._turns if one.size]
        return rainflow_cycles(max(counted, key=np.ptp)) if counted else []


class LifeCounter:
    """Counter of bends and tension cycles of all ropes over the snapshots of a run.

    Args:
        scenario: of the run.
        layout: of the snapshots.
    """

    def __init__(self, scenario: Scenario, layout: Layout) -> None:
        self._scenario, self._layout = scenario, layout
        self._loops = [_Loop(scenario, layout, names) for names in loops_of(scenario)]
        self._resting = {name: _Followed() for name in scenario.cables if name not in scenario.strands}
        size = layout.arc_lengths.size
        self._low, self._high, self._sum = np.full(size, np.inf), np.full(size, -np.inf), np.zeros(size)
        self._load, self._counts = np.zeros(len(layout.supports)), [0, 0]  # N, frames with ropes and with loads
        self._shape: FloatArray | None = None

    def log(self, snapshot: Snapshot) -> None:
        """Add a snapshot of the run to the counts."""
        c = snapshot.columns
        load = np.linalg.norm(c.support_force, axis=1)
        if np.isfinite(load).all():
            self._load += load
            self._counts[1] += 1
        for loop in self._loops:
            loop.move(float(c.sheave_position[loop.wheel]))
        tension = c.rope_tension
        if np.isnan(tension).any() or np.isnan(c.rope_position[:, 0]).any():
            return  # the log does not hold the ropes at this time
        if self._shape is None:
            self._shape = c.rope_position.copy()
        self._low, self._high = np.minimum(self._low, tension), np.maximum(self._high, tension)
        self._sum += tension
        self._counts[0] += 1
        for loop in self._loops:
            loop.followed.add(loop.tension_at(loop.points + loop.place, tension))
        for name, followed in self._resting.items():
            part = self._layout.ropes[name]
            followed.add(tension[part][:: max((part.stop - part.start) // POINTS, 1)])

    def lives(self) -> list[RopeLife]:
        """Bends and tension cycles of all ropes so far, for rope life; empty where the log holds no rope."""
        if self._shape is None:
            return []
        mean = self._sum / self._counts[0]
        load = self._load / max(self._counts[1], 1)
        found = [self._of_loop(loop, self._shape, mean, load) for loop in self._loops]
        for name, followed in self._resting.items():
            found.append(RopeLife(name, 0.0, 0.0, False, [], np.nan, [], followed.cycles()))
        return found

    def _of_loop(self, loop: _Loop, shape: FloatArray, mean: FloatArray, load: FloatArray) -> RopeLife:
        """Life counts of a closed loop, from mean tensions (samples,) and mean support loads (supports,) in N."""
        places = self._devices(loop, shape)
        reach = haul_reach(self._scenario, loop.names)
        trip = loop.length if reach is None else 2.0 * reach
        passes = [_passes(place, loop.points, loop.length, reach) for place in places.values()]
        total = np.sum([self._sheaves(name) * count for name, count in zip(places, passes, strict=True)], axis=0)
        worst = int(np.argmax(total)) if passes else 0
        bends = [
            self._bend(name, loop, place, int(count[worst]), mean, load)
            for (name, place), count in zip(places.items(), passes, strict=True)
        ]
        paths = [loop.tension_at(_path(point, loop.length, reach), mean) for point in loop.points]
        if reach is None:  # one and the same for all, from its peak to its peak
            profile = paths[0][:-1]
            paths = [np.append(turned := np.roll(profile, -int(np.argmax(profile))), turned[0])]
        per_trip = rainflow_cycles(max(paths, key=np.ptp))
        name = " and ".join(loop.names)
        return RopeLife(
            name, loop.length, trip, reach is None, bends, loop.travel / trip, per_trip, loop.followed.cycles()
        )

    def _devices(self, loop: _Loop, shape: FloatArray) -> dict[str, float]:
        """Places (m) of all bullwheels and towers along a loop, by name, in the order of a rope point."""
        found = {}
        for name in loop.names:
            strand, part = self._scenario.strands[name], self._layout.ropes[name]
            for tower, place in self._scenario.tower_places.items():
                if self._scenario.towers[tower].rope == name:
                    nearest = int(np.argmin(np.linalg.norm(shape[part] - place, axis=1)))
                    found[tower] = strand.offset + float(self._layout.arc_lengths[part][nearest])
            wheel = self._scenario.sheaves[strand.after]
            end = strand.offset + self._scenario.ropes[name].unstrained_length
            found[strand.after] = (end + 0.5 * wheel.wrapped) % loop.length
        return dict(sorted(found.items(), key=lambda one: one[1]))

    def _sheaves(self, name: str) -> int:
        return 1 if name in self._scenario.sheaves else self._scenario.towers[name].contacts

    def _bend(self, name: str, loop: _Loop, place: float, passes: int, mean: FloatArray, load: FloatArray) -> Bend:
        at = np.array([place])
        tension = tuple(float(loop.tension_at(at, one)[0]) for one in (self._low, mean, self._high))
        low, usual, high = tension
        wheel = self._scenario.sheaves.get(name)
        if wheel is not None:
            return Bend(name, BULLWHEEL, 1, 2.0 * wheel.radius, wheel.wrap, passes, (low, usual, high))
        count = self._sheaves(name)
        angle = float(load[self._layout.support_rows[name]]) / usual / count
        return Bend(name, TOWER, count, np.nan, angle, passes, (low, usual, high))


class _Loop:
    """Closed loop of strands, with followed rope points that move along it."""

    def __init__(self, scenario: Scenario, layout: Layout, names: Sequence[str]) -> None:
        self.names = names
        strands = [scenario.strands[name] for name in names]
        self.length = strands[0].loop_length
        self.wheel = layout.sheaves.index(_counted_wheel(scenario, [one.before for one in strands]))
        self._order = np.concatenate([np.arange(layout.ropes[name].start, layout.ropes[name].stop) for name in names])
        parts = [one.offset + layout.arc_lengths[layout.ropes[name]] for name, one in zip(names, strands, strict=True)]
        self._places = np.concatenate(parts)
        self.points = np.arange(POINTS) * self.length / POINTS
        self.place, self.travel = 0.0, 0.0  # m, since the start, and there and back
        self._last = np.nan
        self.followed = _Followed()

    def move(self, position: float) -> None:
        """Move the followed rope points of the loop, by the new rope position (m) on its bullwheel."""
        passed = position - self._last
        self._last = position
        if np.isfinite(passed):
            self.place += passed
            self.travel += abs(passed)

    def tension_at(self, places: FloatArray, tension: FloatArray) -> FloatArray:
        """Tension (n,) in N at places (n,) in m along the loop, interpolated from all rope samples."""
        found: FloatArray = np.interp(places, self._places, tension[self._order], period=self.length)
        return found


def _counted_wheel(scenario: Scenario, wheels: Sequence[str]) -> str:
    """Bullwheel of a loop by which its travel is counted: the driven one, as idle ones swing after a stop."""
    driven = {one.sheave for one in scenario.drives.values()}
    return next((name for name in wheels if name in driven), wheels[0])


def loops_of(scenario: Scenario) -> list[list[str]]:
    """Names of the strands of each closed loop of a scenario, in their order along the loop."""
    by_wheels: dict[str, list[str]] = {}
    strands = scenario.strands
    for name in strands:
        if not any(name in one for one in by_wheels.values()):
            loop, rope = [], name
            while rope not in loop:
                loop.append(rope)
                rope = scenario.sheaves[strands[rope].after].ropes[1]
            by_wheels[name] = sorted(loop, key=lambda one: strands[one].offset)
    return list(by_wheels.values())


def haul_reach(scenario: Scenario, names: Sequence[str]) -> float | None:
    """Travel (m) of a haul rope loop with vehicles clamped to it, end to end; None for a circulating loop."""
    hauled = [key for key, one in scenario.carriages.items() if set(one.clamped_to) & set(names)]
    if scenario.carriers is not None or not hauled or not scenario.drives:
        return None
    low, high = haul_travel(scenario, hauled, next(iter(scenario.drives)))
    return high - low


def _path(point: float, length: float, reach: float | None) -> FloatArray:
    """Places (m) of a rope point along a loop during a trip: all round, or there and back over the reach (m)."""
    if reach is None:
        return point + np.linspace(0.0, length, STEPS)
    there = point + np.linspace(0.0, reach, STEPS)
    return np.concatenate([there, there[-2::-1]])


def _passes(place: float, points: FloatArray, length: float, reach: float | None) -> FloatArray:
    """Count (points,) of the passes of each rope point over a place (m) of the loop in a trip."""
    if reach is None:
        return np.ones(points.size)
    turns: FloatArray = np.floor((reach - (place - points) % length) / length) + 1.0
    return 2.0 * np.maximum(turns, 0.0)


class Cycle(NamedTuple):
    """Load cycle: range and mean in the unit of the load, and weight 1 for a whole cycle, 0.5 for a half one."""

    range: float
    mean: float
    weight: float


def turning_points(values: FloatArray) -> FloatArray:
    """Peaks and valleys of a load history (n,), with its first and last value; repeated values count once."""
    values = values[np.isfinite(values)]
    if values.size:
        values = values[np.concatenate([[True], np.diff(values) != 0.0])]
    if values.size < 3:
        return values
    rises = np.diff(values) > 0.0
    turns: FloatArray = values[np.concatenate([[True], rises[1:] != rises[:-1], [True]])]
    return turns


def rainflow_cycles(values: FloatArray) -> list[Cycle]:
    """Cycles of a load history (n,) by rainflow counting, in the order of closing; half cycles of the residue last.

    Source: ASTM E1049-85, section 5.4.4.
    """
    found: list[Cycle] = []
    stack: list[float] = []
    for value in turning_points(values).tolist():
        stack.append(value)
        while len(stack) >= 3:
            last, before = abs(stack[-1] - stack[-2]), abs(stack[-2] - stack[-3])
            if last < before:
                break
            if len(stack) == 3:  # the first point is in the range
                found.append(_cycle(stack[0], stack[1], 0.5))
                del stack[0]
            else:
                found.append(_cycle(stack[-3], stack[-2], 1.0))
                del stack[-3:-1]
    return found + [_cycle(one, other, 0.5) for one, other in pairwise(stack)]


def _cycle(one: float, other: float, weight: float) -> Cycle:
    return Cycle(abs(one - other), 0.5 * (one + other), weight)
