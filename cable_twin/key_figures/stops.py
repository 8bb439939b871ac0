"""Stopping distance and time, from the command to standstill, of drives and of vehicles on a driven rope."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import isnan, nan

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures.figure import KeyFigure
from cable_twin.scenario import Scenario

BoolArray = NDArray[np.bool_]
STANDSTILL = 1e-3  # m/s
SLOWEST = 0.1  # m/s: a command to stop what is slower is no stop, as a vehicle on a haul rope swings so after one


@dataclass(slots=True)
class Stop:
    """Braking to standstill, under way or completed."""

    kind: str
    time: float  # s, of the command
    start: float  # m, place there
    speed: float  # m/s there
    end: float = nan  # s, of the standstill
    distance: float = nan  # m


class Stops:
    """Decisive stop of one drive: the last emergency stop, else the last stop."""

    def __init__(self) -> None:
        self.stop: Stop | None = None
        self._braking: Stop | None = None

    def begin(self, kind: str, time: float, place: float, speed: float) -> None:
        """Begin a stop at a command; an emergency stop replaces a normal stop under way."""
        if not abs(speed) > SLOWEST:
            return
        if self._braking is None or (kind == "emergency stop" and self._braking.kind != kind):
            self._braking = Stop(kind, time, place, speed)

    def cancel(self) -> None:
        """Discard the stop under way, after a command to move or a reset."""
        self._braking = None

    @property
    def braking(self) -> bool:
        """True while a stop is under way."""
        return self._braking is not None

    def update(self, time: float, place: float, speed: float) -> None:
        """Take in position (m) and speed (m/s) at a time (s)."""
        stop = self._braking
        if stop is None or isnan(place + speed) or (abs(speed) > STANDSTILL and speed * stop.speed > 0.0):
            return
        stop.end, stop.distance = time, abs(place - stop.start)
        if self.stop is None or stop.kind == "emergency stop" or self.stop.kind != "emergency stop":
            self.stop = stop
        self._braking = None


class StopsOf:
    """Decisive stops of several drives, by name.

    Args:
        names: of what is driven.
        motion: gives place (m) and speed (m/s) of one of them in the last frame.
        whose: what it is of which that is the motion, as figures say it.
    """

    def __init__(self, names: Iterable[str], motion: Callable[[str], tuple[float, float]], whose: str = "") -> None:
        self._whose = whose
        self._stops, self._motion = {name: Stops() for name in names}, motion
        self._time = nan  # s, of the last frame
        self._braking: list[str] = []  # those of which a stop is under way

    def update(self, time: float) -> None:
        """Take in the last frame, at a time (s)."""
        self._time = time
        if self._braking:
            for name in self._braking:
                self._stops[name].update(time, *self._motion(name))
            self._find_braking()

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command at the time of its effect."""
        kind, values, seen = applied.command.kind, applied.command.values, not isnan(self._time)
        for name, stops in self._stops.items():
            if kind == "reset":
                stops.cancel()
            elif seen and kind == "emergency_stop":
                stops.begin("emergency stop", applied.time, *self._motion_at(name, applied.time))
            elif seen and kind == "speed" and values.get(name) == 0.0:
                stops.begin("stop", applied.time, *self._motion_at(name, applied.time))
            elif kind in ("speed", "force") and name in values:
                stops.cancel()
        self._find_braking()

    def figures(self, name: str, limited: Callable[[KeyFigure, str], KeyFigure]) -> Iterator[KeyFigure]:
        """Yield distance and time of the decisive stop of one drive; `limited` adds the limit of a key."""
        stop = self._stops[name].stop if name in self._stops else None
        if stop is not None:
            place = f"{stop.kind} from {abs(stop.speed):.2f} m/s at {stop.start:.1f} m"
            place += f", {self._whose}" if self._whose else ""
            yield limited(
                KeyFigure(f"{name}: stopping distance", stop.distance, "m", stop.time, place), "stopping_distance"
            )
            yield limited(
                KeyFigure(f"{name}: stopping time", stop.end - stop.time, "s", stop.time, place), "stopping_time"
            )

    def _find_braking(self) -> None:
        self._braking = [name for name, stops in self._stops.items() if stops.braking]

    def _motion_at(self, name: str, time: float) -> tuple[float, float]:
        """Position (m) and speed (m/s) at a time (s) shortly after the last frame, extrapolated at constant speed."""
        place, speed = self._motion(name)
        return place + speed * (time - self._time), speed


class CarriedStops:
    """Decisive stop of vehicles on a driven rope: distance and time of each vehicle in space.

    The rim of a drive stops as it is told; the rope slips on it, gives way and swings. A vehicle goes on until it
    stands itself, or turns back, for the first time. Its way is along the rope, of frames that show where it is.

    Args:
        scenario: what runs.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._drives = set(scenario.drives)
        carried = {
            name: row
            for row, (name, one) in enumerate(scenario.vehicles.items())
            if self._drives and (one.joint == "clamped" or one.clamped_to)
        }
        self._names, self._rows = list(carried), np.array([*carried.values()], np.intp)
        own = [name for name in carried if name in scenario.carriages]
        self._groups = {name: [self._names.index(name)] for name in own}
        if riding := [row for row, name in enumerate(self._names) if name not in scenario.carriages]:
            assert scenario.carriers is not None
            self._groups[scenario.carriers.name] = riding
        count = len(carried)
        self._layout: Layout | None = None  # of the frames so far
        self._heights: list[int] = []  # numbers of a frame, of the height of each
        self._time = nan  # s, of the last frame that shows where they are
        self._last: Snapshot | None = None  # that frame
        self._begun: tuple[str, float] | None = None  # kind and time (s) of the command, while it is under way
        self._start = np.zeros(count)  # m/s at the command
        self._way = np.zeros(count)  # m since then
        self._end = np.full(count, nan)  # s, of the standstill
        self._stops: dict[str, tuple[KeyFigure, KeyFigure]] = {}  # distance and time of each group
        self._counts = ""  # kind of that stop

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot, in order of time."""
        if not self._names:
            return
        time = snapshot.time
        if time <= self._time or not self._has_places(snapshot):
            return
        if self._begun is not None:
            self._go_on(time, self._steps(snapshot))
        self._time, self._last = time, snapshot

    def command(self, applied: AppliedCommand) -> None:
        """Take in a command at the time of its effect."""
        kind, values = applied.command.kind, applied.command.values
        told = self._drives & set(values)
        if kind == "emergency_stop" or (kind == "speed" and told and not any(values[name] for name in told)):
            self._begin("emergency stop" if kind == "emergency_stop" else "stop", applied.time)
        elif kind == "reset" or (kind in ("speed", "force") and told):
            self._begun = None

    def figures(self, limited: Callable[[KeyFigure, str], KeyFigure]) -> Iterator[KeyFigure]:
        """Yield distance and time of each carriage and of the farthest carrier, with limits from `limited`."""
        for distance, duration in self._stops.values():
            yield limited(distance, "stopping_distance")
            yield limited(duration, "stopping_time")

    def _has_places(self, snapshot: Snapshot) -> bool:
        """Return whether a frame holds positions of the vehicles; frames of a log may have none."""
        if snapshot.layout is not self._layout:
            self._layout = snapshot.layout
            self._heights = self._layout.places.joint_position[self._rows, 2].tolist()
        return not all(isnan(snapshot.numbers[number]) for number in self._heights)

    def _begin(self, kind: str, time: float) -> None:
        under_way = self._begun is not None and (kind == "stop" or self._begun[0] == kind)
        if under_way or self._last is None:
            return
        speed = np.where(self._on(self._last), self._last.columns.speed[self._rows], 0.0)
        if not np.any(np.abs(speed) > SLOWEST):
            return
        self._begun, self._start = (kind, time), speed
        self._way = -np.abs(self._start) * (time - self._time)  # gone since the last frame, before the command
        self._end[:] = nan

    def _go_on(self, time: float, steps: FloatArray) -> None:
        """Add the steps (vehicles,) in m since the last frame to the distances of all vehicles still in motion."""
        on = np.sign(self._start) * steps
        moves = np.isnan(self._end) & (np.abs(self._start) > STANDSTILL)
        goes = moves & (on > STANDSTILL * (time - self._time))
        self._way[goes] += on[goes]
        self._end[moves & ~goes] = time
        self._end[moves & np.isnan(on)] = -np.inf  # has left the rope
        if not np.any(goes):
            self._finish()

    def _finish(self) -> None:
        assert self._begun is not None
        (kind, time), self._begun = self._begun, None
        if kind == "stop" and self._counts == "emergency stop":
            return
        self._counts, self._stops = kind, {}
        for name, rows in self._groups.items():
            counted = [row for row in rows if self._end[row] > time]
            if counted:
                row = max(counted, key=lambda row: self._way[row])
                whose = f"{self._names[row]}, " if len(rows) > 1 else ""
                where = f"{whose}{kind} from {abs(self._start[row]):.2f} m/s, of its clamp along the rope"
                last = float(self._end[counted].max()) - time
                self._stops[name] = (
                    KeyFigure(f"{name}: stopping distance", float(self._way[row]), "m", time, where),
                    KeyFigure(f"{name}: stopping time", last, "s", time, f"{kind}, until the last one stands"),
                )

    def _on(self, snapshot: Snapshot) -> BoolArray:
        """Mask (vehicles,) of vehicles on the rope."""
        on: BoolArray = snapshot.columns.attached[self._rows] == 1.0
        return on

    def _steps(self, snapshot: Snapshot) -> FloatArray:
        """Travel (vehicles,) in m along the rope since the last frame; NaN for vehicles off the rope in any of both."""
        assert self._last is not None
        moved = snapshot.columns.joint_position[self._rows] - self._last.columns.joint_position[self._rows]
        steps = np.sum(moved * along_rope(snapshot, self._rows), axis=1)
        return np.where(self._on(snapshot) & self._on(self._last), steps, nan)


def along_rope(snapshot: Snapshot, rows: NDArray[np.intp]) -> FloatArray:
    """Unit vectors (n, 3) along the rope at vehicles of given indices (n,); NaN for vehicles off the rope."""
    found = np.full((len(rows), 3), nan)
    c, arc, parts = snapshot.columns, snapshot.layout.arc_lengths, list(snapshot.layout.ropes.values())
    for number, row in enumerate(rows.tolist()):
        part = parts[int(np.nan_to_num(c.vehicle_rope[row]))]
        if c.attached[row] == 1.0 and not isnan(c.arc_length[row]):
            after = min(max(int(np.searchsorted(arc[part], c.arc_length[row])), 1), part.stop - part.start - 1)
            found[number] = c.rope_position[part.start + after] - c.rope_position[part.start + after - 1]
    return found / np.linalg.norm(found, axis=1, keepdims=True)


__all__ = ["STANDSTILL", "CarriedStops", "Stop", "Stops", "StopsOf", "along_rope"]
