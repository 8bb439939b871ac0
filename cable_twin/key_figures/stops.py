"""Stops from the command to standstill: of drives, of vehicles on a driven rope, and of their passengers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Set
from dataclasses import replace
from math import inf, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures.figure import KeyFigure, Subject, as_statistic, figure
from cable_twin.mechanics.parameters import FREE
from cable_twin.scenario import Scenario
from cable_twin.scenario.command_limits import unbraked
from cable_twin.scenario.sections.vehicles import Carriage

BoolArray = NDArray[np.bool_]
Rows = NDArray[np.intp]
STANDSTILL = 1e-3  # m/s
SLOWEST = 0.1  # m/s below which a command to stop is no stop, as of a vehicle that swings on a haul rope after one
SETTLED = 30.0  # s without going farther than before, after which a passenger's stop is over
EMERGENCY, STOP, NO_STOP = "emergency stop", "stop", ""
RIM = "of the rim of its bullwheel"


class Group(NamedTuple):
    """Group of vehicles with the key figures of its worst vehicle: a single carriage, or all carriers."""

    subject: Subject
    rows: tuple[int, ...]  # of the vehicles


def groups_of(scenario: Scenario) -> list[Group]:
    """Groups of the vehicles of a scenario, carriages first."""
    own = [name for name in scenario.vehicles if name in scenario.carriages]
    found = [Group(Subject(f"carriages.{name}", name), (row,)) for row, name in enumerate(own)]
    if scenario.carriers is not None:
        riding = tuple(range(len(own), len(scenario.vehicles)))
        found.append(Group(Subject("carriers", scenario.carriers.name), riding))
    return found


def is_carried(scenario: Scenario, vehicle: Carriage) -> bool:
    """Whether a vehicle is clamped to a driven rope."""
    return bool(scenario.drives) and (vehicle.joint == "clamped" or bool(vehicle.clamped_to))


def coasts(snapshot: Snapshot, row: int) -> bool:
    """Whether the drive of a carriage, by its row, is free in a frame."""
    return bool(snapshot.columns.command_kind[row] == FREE)


def ordered_stop(applied: AppliedCommand, movers: Set[str]) -> str | None:
    """Kind of stop that a command orders for given drives; NO_STOP for a command to move or reset, else None."""
    kind, values = applied.command.kind, applied.command.values
    named = movers & set(values)
    if kind == "emergency_stop":
        return EMERGENCY
    if kind == "speed" and named and not any(values[name] for name in named):
        return STOP
    return NO_STOP if kind == "reset" or (kind in ("speed", "force") and named) else None


def stop_figures(
    subject: Subject,
    speed: float,
    values: tuple[float, float],
    time: float,
    places: tuple[str, str],
    *,
    unfinished: bool = False,
) -> list[KeyFigure]:
    """Key figures of a stop from a speed (m/s) ordered at a time (s): distance, time and mean deceleration.

    A stop that is unfinished has distance and time so far, and no mean deceleration.
    """
    pairs = zip(("stopping_distance", "stopping_time"), values, places, strict=True)
    found = [figure(quantity, subject, "highest", value, time, place) for quantity, value, place in pairs]
    if unfinished:
        return [replace(one, unfinished=True) for one in found]
    if values[0] > 0.0:
        mean = speed**2 / (2.0 * values[0])
        found.append(figure("mean_deceleration", subject, "mean", mean, time, places[0]))
    return found


class WorstStops:
    """Key figures of all stops of one subject: of its emergency stops, without any of its other stops.

    Distance and time are the longest ones. The mean deceleration is that of the longest distance; of several stops the
    highest and the lowest one are kept beside it.
    """

    def __init__(self) -> None:
        self._kind, self._count = NO_STOP, 0
        self._found: dict[tuple[str, str], KeyFigure] = {}  # by quantity and statistic

    def add(self, kind: str, figures: Iterable[KeyFigure]) -> None:
        """Add the key figures of a stop of a kind that is over."""
        if kind == STOP and self._kind == EMERGENCY:
            return
        if kind != self._kind:
            self._kind, self._count, self._found = kind, 0, {}
        self._count += 1
        distance, time, *decelerations = figures
        longest, _ = self._renew(distance, 1.0), self._renew(time, 1.0)
        for one in decelerations:
            quantity = one.id.quantity
            if longest:
                self._found[quantity, "mean"] = one
            for statistic, sense in (("highest", 1.0), ("lowest", -1.0)):
                self._renew(as_statistic(one, statistic), sense)

    def figures(self, kind: str = NO_STOP, so_far: Iterable[KeyFigure] = ()) -> list[KeyFigure]:
        """Key figures of the stops that count, with those so far of a stop of a kind that is under way."""
        found = {} if kind == EMERGENCY != self._kind else dict(self._found)
        if self._count == 1:  # the mean deceleration is highest and lowest at once
            found = {key: one for key, one in found.items() if key[0] != "mean_deceleration" or key[1] == "mean"}
        for one in () if kind == STOP and self._kind == EMERGENCY else so_far:
            key = one.id.quantity, one.id.statistic
            before = found.get(key)
            found[key] = one if before is None or one.value >= before.value else replace(before, unfinished=True)
        return [*found.values()]

    def _renew(self, one: KeyFigure, sense: float) -> bool:
        """Keep a figure if it is beyond the one of its kind so far, upwards for a `sense` of 1; whether it is."""
        key = one.id.quantity, one.id.statistic
        beyond = key not in self._found or sense * one.value > sense * self._found[key].value
        if beyond:
            self._found[key] = one
        return beyond


class Stop(NamedTuple):
    """Stop of a drive that is under way."""

    kind: str
    time: float  # s, of the command
    start: float  # m, place at the command
    speed: float  # m/s at the command


class DriveStops:
    """Stops of each drive and driven vehicle: its emergency stops, without any its other stops.

    Args:
        subjects: subjects of drives and driven vehicles, by name.
        motion: function of a name that gives place (m) and speed (m/s) in the last frame.
        obeys: function of a name that gives whether it obeys an emergency stop after the last frame.
        on_bullwheels: names of drives on bullwheels, whose rim moves.
    """

    def __init__(
        self,
        subjects: dict[str, Subject],
        motion: Callable[[str], tuple[float, float]],
        obeys: Callable[[str], bool],
        on_bullwheels: Set[str],
    ) -> None:
        self._subjects, self._motion, self._obeys, self._on_bullwheels = subjects, motion, obeys, on_bullwheels
        self._braking: dict[str, Stop] = {}  # under way
        self._worst = {name: WorstStops() for name in subjects}  # of those that are over
        self._standing: dict[str, float] = {}  # s, of the standstill of what stands after a stop
        self._restarts: dict[str, tuple[float, float]] = {}  # s, shortest delay of a restart, and its time
        self._time = nan  # s, of the last frame

    def update(self, time: float) -> None:
        """Update the stops of drives by the last frame, of a time (s)."""
        self._time = time
        for name, stop in [*self._braking.items()]:
            place, speed = self._motion(name)
            if isnan(place + speed) or (abs(speed) > STANDSTILL and speed * stop.speed > 0.0):
                continue
            self._worst[name].add(stop.kind, self._figures(name, stop, place))
            del self._braking[name]
            self._standing[name] = time

    def command(self, applied: AppliedCommand) -> None:
        """Begin or end stops by a command at the time of its effect; an emergency stop replaces a stop under way."""
        for name in self._subjects:
            kind, braking = ordered_stop(applied, {name}), self._braking.get(name)
            if kind == NO_STOP:
                self._braking.pop(name, None)
                since = self._standing.pop(name, nan)
                delay = applied.time - since
                if applied.command.kind != "reset" and delay < self._restarts.get(name, (inf, nan))[0]:
                    self._restarts[name] = delay, applied.time
            elif kind and not isnan(self._time) and (braking is None or (kind == EMERGENCY != braking.kind)):
                if kind == EMERGENCY and not self._obeys(name):
                    continue
                place, speed = self._motion(name)
                if abs(speed) > SLOWEST:  # the place at the command, shortly after the frame
                    start = place + speed * (applied.time - self._time)
                    self._braking[name] = Stop(kind, applied.time, start, speed)

    def figures(self, name: str) -> list[KeyFigure]:
        """Key figures of the stops of one drive, and its shortest delay of a restart; none without a stop.

        Of a stop under way, the figures are those so far.
        """
        if name not in self._subjects:
            return []
        braking, delay = self._braking.get(name), self._restarts.get(name)
        again = [] if delay is None else [figure("restart_delay", self._subjects[name], "lowest", *delay)]
        if braking is None:
            return self._worst[name].figures() + again
        so_far = self._figures(name, braking, *self._motion(name))
        return self._worst[name].figures(braking.kind, so_far) + again

    def _figures(self, name: str, stop: Stop, place: float, still: float | None = None) -> list[KeyFigure]:
        """Key figures of a stop of a drive that ends now at a place (m), or is under way with a speed (m/s) `still`."""
        text = f"{stop.kind} from {abs(stop.speed):.2f} m/s at {stop.start:.1f} m"
        text += f", {RIM}" if name in self._on_bullwheels else ""
        text += "" if still is None else f", not over: still {abs(still):.2f} m/s"
        values, unfinished = (abs(place - stop.start), self._time - stop.time), still is not None
        places = text, text
        return stop_figures(self._subjects[name], stop.speed, values, stop.time, places, unfinished=unfinished)


class Travel:
    """Travel of one point of each vehicle along its rope, between frames that have the positions of the points.

    The direction of the rope is that of the last frame with the shapes of ropes, which logs hold at a lower rate.

    Args:
        scenario: scenario of the run.
        rows: rows of the n vehicles among all.
        bodies: rows of the n bodies on which the points are; None for the joints of the vehicles with their ropes.
        offsets: (n, 3) m from the centres of these bodies, in their axes.
    """

    def __init__(
        self, scenario: Scenario, rows: list[int], bodies: Rows | None = None, offsets: FloatArray | None = None
    ) -> None:
        self.vehicles, self._bodies, self._offsets = np.array(rows, np.intp), bodies, offsets
        members = [(one.subject, [rows.index(row) for row in one.rows if row in rows]) for one in groups_of(scenario)]
        self.groups = [(subject, found) for subject, found in members if found]  # with the indices among the n
        self._names = list(scenario.vehicles)
        self._layout: Layout | None = None  # of the frames so far
        self._numbers: list[int] = []  # places in a frame of one coordinate of each point
        self._places = _Places()  # in a frame
        self.last: Snapshot | None = None  # last frame that holds them
        self._shape: Snapshot | None = None  # last frame that holds the ropes, which logs hold in fewer frames
        self._placed: tuple[Snapshot, FloatArray] | None = None  # its points, if they are known

    def shows(self, snapshot: Snapshot) -> bool:
        """Whether a frame is later than the last one and has the positions of the points; logged frames may not.

        Frames before the first one with the shapes of ropes do not count, as no travel along a rope is known there.
        """
        if not self.groups:
            return False
        if snapshot.layout is not self._layout:
            self._layout = snapshot.layout
            self._places = self._of(snapshot)
            self._numbers = self._places.points[:, 2 if self._bodies is None else 0].tolist()
        numbers, places = snapshot.numbers, self._numbers
        if not isnan(numbers[self._places.samples[0, 0]]):
            self._shape = snapshot
        if self._shape is None:
            return False
        if isnan(numbers[places[0]]) and all(isnan(numbers[place]) for place in places):
            return False
        return self.last is None or snapshot.time > self.last.time

    def attached(self, snapshot: Snapshot) -> BoolArray:
        """Mask (n,) of the vehicles attached to a rope."""
        on: BoolArray = snapshot.numbers[self._of(snapshot).attached] == 1.0
        return on

    def steps(self, snapshot: Snapshot, members: Rows | slice = slice(None)) -> FloatArray:
        """Travel (members,) in m since the last frame; NaN for vehicles off the rope in either frame."""
        assert self.last is not None
        if self._placed is None or self._placed[0] is not self.last:
            self._placed = self.last, self._points(self.last)
        before = self._placed[1]
        after = self._points(snapshot)
        self._placed, moved = (snapshot, after), after[members] - before[members]
        steps = np.sum(moved * self._along_rope(snapshot)[members], axis=1)
        return np.where((self.attached(snapshot) & self.attached(self.last))[members], steps, nan)

    def _of(self, snapshot: Snapshot) -> _Places:
        """Indices of the values in a frame that give the points; found anew only for frames of another layout."""
        if snapshot.layout is self._places.layout:
            return self._places
        return _Places.of(snapshot.layout, self.vehicles, self._bodies)

    def _points(self, snapshot: Snapshot) -> FloatArray:
        """Positions (n, 3) in m of the points in a frame."""
        places = self._of(snapshot)
        found: FloatArray = snapshot.numbers[places.points]
        if self._offsets is None:
            return found
        turn = snapshot.numbers[places.turns]
        twice = 2.0 * _cross(turn[:, :3], self._offsets)
        moved = self._offsets + turn[:, 3:] * twice + _cross(turn[:, :3], twice)
        return found + np.where(self._offsets.any(axis=1, keepdims=True), moved, 0.0)

    def _along_rope(self, snapshot: Snapshot) -> FloatArray:
        """Unit vectors (n, 3) along the rope at the vehicles; NaN for vehicles off the rope."""
        assert self._shape is not None
        numbers, places, layout = snapshot.numbers, self._of(snapshot), self._shape.layout
        shape, samples = self._shape.numbers, self._of(self._shape).samples
        arc_length, rope = numbers[places.arc_length], numbers[places.rope]
        on = (numbers[places.attached] == 1.0) & ~np.isnan(arc_length)
        found = np.full((on.size, 3), nan)
        for number, part in enumerate(layout.ropes.values()):
            own = on & (rope == number if number else ~(rope > 0.0))
            if own.any():
                arc = layout.arc_lengths[part]
                after = np.minimum(np.maximum(np.searchsorted(arc, arc_length[own]), 1), arc.size - 1)
                found[own] = shape[samples[part][after]] - shape[samples[part][after - 1]]
        return found / np.sqrt(np.sum(found * found, axis=1, keepdims=True))

    def describe(self, member: int, members: list[int], kind: str, speed: float) -> str:
        """Text of a stop of a member of a group from a speed (m/s), with the vehicle's name in a group of several."""
        whose = f"{self._names[self.vehicles[member]]}, " if len(members) > 1 else ""
        return f"{whose}{kind} from {abs(speed):.2f} m/s"


class CarriedStops:
    """Stops of the vehicles clamped to a driven rope: stopping distance along the rope, and stopping time.

    The rim of a drive follows its command; the rope slips on it, stretches and swings. A vehicle stops when it stands
    or turns back for the first time. Its travel is along the rope, from frames that hold its position.

    Args:
        scenario: scenario of the run.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._drives = frozenset(scenario.drives)
        rows = [row for row, one in enumerate(scenario.vehicles.values()) if is_carried(scenario, one)]
        self._travel = Travel(scenario, rows)
        self._begun: tuple[str, float] | None = None  # kind and time (s) of the command, while it is under way
        self._start = np.zeros(len(rows))  # m/s at the command
        self._way = np.zeros(len(rows))  # m since then
        self._end = np.full(len(rows), nan)  # s, of the standstill
        self._worst = {subject: WorstStops() for subject, _ in self._travel.groups}  # of those that are over

    def update(self, snapshot: Snapshot) -> None:
        """Update the stops of vehicles by one snapshot, in order of time."""
        if self._travel.shows(snapshot):
            if self._begun is not None:
                assert self._travel.last is not None
                self._go_on(snapshot.time, self._travel.last.time, self._travel.steps(snapshot))
            self._travel.last = snapshot

    def command(self, applied: AppliedCommand) -> None:
        """Begin or end the stop of vehicles by a command at the time of its effect."""
        kind = ordered_stop(applied, self._drives)
        if kind == NO_STOP:
            self._begun = None
        elif kind and self._travel.last is not None and (self._begun is None or kind == EMERGENCY != self._begun[0]):
            self._begin(kind, applied.time, self._travel.last)

    def figures(self) -> Iterator[KeyFigure]:
        """Yield the key figures of the stops, distance and time, of each carriage and of the farthest carrier.

        Of a stop under way, the figures are those so far.
        """
        so_far = {} if self._begun is None else self._figures(*self._begun)
        kind = NO_STOP if self._begun is None else self._begun[0]
        for subject, worst in self._worst.items():
            yield from worst.figures(kind, so_far[subject]) if subject in so_far else worst.figures()

    def _begin(self, kind: str, time: float, last: Snapshot) -> None:
        speed = np.where(self._travel.attached(last), last.columns.speed[self._travel.vehicles], 0.0)
        if np.any(np.abs(speed) > SLOWEST):
            self._begun, self._start = (kind, time), speed
            self._way = -np.abs(self._start) * (time - last.time)  # from the last frame to the command
            self._end[:] = nan

    def _go_on(self, time: float, before: float, steps: FloatArray) -> None:
        """Add the steps (vehicles,) in m since the last frame to the distances of all vehicles still in motion."""
        on = np.sign(self._start) * steps
        moves = np.isnan(self._end) & (np.abs(self._start) > STANDSTILL)
        goes = moves & (on > STANDSTILL * (time - before))
        self._way[goes] += on[goes]
        self._end[moves & ~goes] = time
        self._end[moves & np.isnan(on)] = -np.inf  # has left the rope
        if not np.any(goes):
            self._finish()

    def _finish(self) -> None:
        assert self._begun is not None
        begun, self._begun = self._begun, None
        for subject, figures in self._figures(*begun).items():
            self._worst[subject].add(begun[0], figures)

    def _figures(self, kind: str, time: float) -> dict[Subject, list[KeyFigure]]:
        """Key figures of the last stop, of a kind and from a time (s) on, by group; those so far while it goes on."""
        found = {}
        last = self._travel.last
        for subject, members in self._travel.groups:
            moving = [one for one in members if isnan(self._end[one]) and abs(self._start[one]) > SLOWEST]
            counted = [*moving, *(one for one in members if self._end[one] > time)]
            if not counted or last is None:
                continue
            member, under_way = max(counted, key=lambda one: self._way[one]), bool(moving)
            where = f"{self._travel.describe(member, members, kind, self._start[member])}, of its clamp along the rope"
            end, until = float(np.max(self._end[counted])), f"{kind}, until the last vehicle stands still"
            if under_way:
                speed = max(abs(float(last.columns.speed[self._travel.vehicles[one]])) for one in moving)
                where, end = f"{where}, not over: still {speed:.2f} m/s", last.time
                until = f"{kind}, not over: still {speed:.2f} m/s"
            values = float(self._way[member]), end - time
            places, speed = (where, until), float(self._start[member])
            found[subject] = stop_figures(subject, speed, values, time, places, unfinished=under_way)
        return found


class Farthest(NamedTuple):
    """Load of the vehicle of a group that has travelled farthest in a stop."""

    number: int  # of its vehicle among those with loads
    kind: str  # of the stop
    speed: float  # m/s at the command
    way: float  # m since then
    begun: float  # s, of the command


class SeatStops:
    """Farthest forward travel along the rope of the load of each vehicle after a command to stop.

    The load is the place of the payload, or the centre of mass of the last body. Its travel is summed along the rope
    from frame to frame, forward and back as the load swings after clamp and rim have stopped; the farthest travel until
    the next command to move counts, and of several stops the farthest, as in `WorstStops`.

    Args:
        scenario: scenario of the run.
    """

    def __init__(self, scenario: Scenario) -> None:
        rows, bodies, offsets, first = [], [], [], 0
        self._movers: list[frozenset[str]] = []  # of each load, what commands its stop
        free = unbraked(scenario)
        self._coasting: list[int] = []  # numbers of those that obey no emergency stop while their drive is free
        for row, (name, one) in enumerate(scenario.vehicles.items()):
            if one.bodies:
                number, offset = _load(one)
                rows.append(row)
                bodies.append(first + number)
                offsets.append(offset)
                if name in free and not is_carried(scenario, one):
                    self._coasting.append(len(self._movers))
                self._movers.append(frozenset(scenario.drives) if is_carried(scenario, one) else frozenset((name,)))
            first += len(one.bodies)
        loads, arms = np.array(bodies, np.intp), np.array(offsets).reshape(-1, 3)
        self._travel = Travel(scenario, rows, loads, arms)
        count = len(rows)
        self._under_way = False  # any stop
        self._over: BoolArray = np.ones(count, np.bool_)  # no stop is under way
        self._kinds = [""] * count  # of the last stop
        self._stands: BoolArray = np.zeros(count, np.bool_)  # commanded to stop, and not to move since
        self._start = np.zeros(count)  # m/s along the rope at the command
        self._begun, self._farthest_at = np.full(count, nan), np.full(count, nan)  # s
        self._way, self._farthest = np.zeros(count), np.zeros(count)  # m
        self._found: dict[Subject, Farthest] = {}  # of each group, of the stop that counts

    def update(self, snapshot: Snapshot) -> None:
        """Update the travel of passengers' loads in stops by one snapshot, in order of time."""
        if self._travel.shows(snapshot):
            if self._under_way:
                self._go_on(snapshot)
                self._under_way = not self._over.all()
            self._travel.last = snapshot

    def command(self, applied: AppliedCommand) -> None:
        """Begin or end the stops of vehicles' loads by a command at the time of its effect."""
        for number, movers in enumerate(self._movers):
            kind = ordered_stop(applied, movers)
            if kind == NO_STOP:
                self._over[number], self._stands[number] = True, False
            elif kind and (last := self._travel.last) is not None:
                if kind == EMERGENCY and number in self._coasting and coasts(last, int(self._travel.vehicles[number])):
                    continue
                again = self._stands[number] and kind in (STOP, self._kinds[number])
                if not again:
                    self._begin(number, kind, applied.time, last)

    def figures(self) -> Iterator[KeyFigure]:
        """Yield the passenger's stopping distance of each carriage, and of the carrier whose load went farthest."""
        for subject, members in self._travel.groups:
            if (one := self._found.get(subject)) is not None:
                stop = self._travel.describe(one.number, members, one.kind, one.speed)
                where = f"{stop}, its load along the rope, swing included"
                found = figure("passenger_stopping_distance", subject, "highest", one.way, one.begun, where)
                under_way = [number for number in members if self._goes_on(number, one.kind)]
                if one.number in under_way and self._begun[one.number] == one.begun:
                    where = f"{where}, not over"
                yield replace(found, place=where, unfinished=bool(under_way))

    def _goes_on(self, number: int, kind: str) -> bool:
        """Whether a stop of a load, of a kind, is under way: its vehicle in motion, and the load farther than ever."""
        last = self._travel.last
        if self._over[number] or self._kinds[number] != kind:
            return False
        if last is None or self._farthest_at[number] < last.time:
            return False
        return abs(float(last.columns.speed[self._travel.vehicles[number]])) > SLOWEST

    def _begin(self, number: int, kind: str, time: float, last: Snapshot) -> None:
        """Begin the stop of one moving vehicle, by index."""
        row, self._stands[number] = self._travel.vehicles[number], True
        speed = float(last.columns.speed[row])
        if abs(speed) > SLOWEST and last.columns.attached[row] == 1.0:
            self._kinds[number], self._over[number], self._under_way = kind, False, True
            self._start[number], self._begun[number] = speed, time
            self._way[number] = -abs(speed) * (time - last.time)  # from the last frame to the command
            self._farthest[number], self._farthest_at[number] = 0.0, time

    def _go_on(self, snapshot: Snapshot) -> None:
        """Add the travel of loads since the last frame to the stops under way."""
        numbers = np.flatnonzero(~self._over)
        steps = self._travel.steps(snapshot, numbers) * np.sign(self._start[numbers])
        self._way[numbers] += steps
        farther = numbers[self._way[numbers] > self._farthest[numbers]]
        self._farthest[farther], self._farthest_at[farther] = self._way[farther], snapshot.time
        self._over[numbers[np.isnan(steps) | (snapshot.time - self._farthest_at[numbers] > SETTLED)]] = True
        self._renew(farther)

    def _renew(self, farther: Rows) -> None:
        """Renew the farthest travel of groups by the loads (indices) that have travelled farther."""
        for subject, members in self._travel.groups:
            moved = [number for number in farther.tolist() if number in members]
            if not moved:
                continue
            number = max(moved, key=lambda one: float(self._farthest[one]))
            kind, before = self._kinds[number], self._found.get(subject)
            heavier = before is None or (before.kind, kind) == (STOP, EMERGENCY)
            if before is not None and not heavier and (before.kind != kind or before.way >= self._farthest[number]):
                continue
            way, begun = float(self._farthest[number]), float(self._begun[number])
            self._found[subject] = Farthest(number, kind, float(self._start[number]), way, begun)


class _Places(NamedTuple):
    """Indices in a frame of the values from which the travel of n points is calculated."""

    layout: Layout | None = None
    points: Rows = np.zeros((0, 3), np.intp)  # (n, 3) m, of the points or of the centres of their bodies
    turns: Rows = np.zeros((0, 4), np.intp)  # (n, 4) orientations of these bodies
    attached: Rows = np.zeros(0, np.intp)  # (n,)
    arc_length: Rows = np.zeros(0, np.intp)  # (n,) m
    rope: Rows = np.zeros(0, np.intp)  # (n,)
    samples: Rows = np.zeros((0, 3), np.intp)  # (samples, 3) m, of all ropes

    @classmethod
    def of(cls, layout: Layout, vehicles: Rows, bodies: Rows | None) -> _Places:
        """Indices of the values in frames of a layout that give points of vehicles or bodies, both given by rows."""
        c = layout.places
        points = c.joint_position[vehicles] if bodies is None else c.body_position[bodies]
        turns = c.body_orientation[[] if bodies is None else bodies]
        found = points, turns, c.attached[vehicles], c.arc_length[vehicles], c.vehicle_rope[vehicles], c.rope_position
        return cls(layout, *(one.astype(np.intp) for one in found))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products (n, 3) of the rows of two arrays (n, 3), with less overhead than `numpy.cross`."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


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
