"""Live following of a plant: measurements in order, places of vehicles, silences and restarts of the twin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from cable_twin.ensemble.estimate.arrivals import HORIZON, Arrivals, Item
from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.detectors.emergency_stops import EmergencyStops, Stop, decelerations
from cable_twin.ensemble.estimate.detectors.silences import Silences
from cable_twin.ensemble.estimate.followers import AnyFollower, follower_of
from cable_twin.ensemble.estimate.pursuit import APART, pursuit_of
from cable_twin.ensemble.estimate.waves import Unheard
from cable_twin.frame.records import AppliedCommand, Command, CommandError
from cable_twin.frame.sensors import Measurement
from cable_twin.scenario import Scenario, command_limits
from cable_twin.simulation import EquilibriumError

SILENT = 2.0  # s without a measurement, after which the twin goes on by its model, or listens anew while it waits
LISTENING = 1.0  # s of measurements before the twin begins where the plant is
STEADY, LONGEST_WAIT = 0.05, 900.0  # m/s^2, up to which a plant moves steadily; s, for which it is waited for
MOVES = 0.1  # m/s, from which on a plant moves
ELSEWHERE = 20.0  # m, by which a plant is too far away to be pursued
TIMES = 5  # samples, one after the other, that say so
PROVEN = 60.0  # s, after which a beginning was not at a wrong place or speed, unless the plant was elsewhere till then
FIRST = 3  # windows without a contradiction, the first ones, that say so before
STOPPING = 2.0  # s, by which an emergency stop lasts longer than by its mean deceleration
BROUGHT = 8.0  # s, in which a twin is brought to the place of its plant behind such a stop, or for which it goes on
CALMED = 60.0  # s, for which a plant that has moved swings
BEHIND, TOO_FAR = 5.0, 20.0  # s, by which it is behind its plant: told, and begun anew where the plant is now
UNHEARD = 3.0  # times the waves of a stop that a plant has after a silence in which it moved, beside its twin
SOURCE = "plant"
WAITING, FOLLOWING, ALONE = "waits for a plant", "follows", "goes on by its model"


class News(NamedTuple):
    """Report of a tracker at a time (s): a correction of the estimate, and lines to log."""

    time: float
    correction: Correction | None
    notes: tuple[str, ...]  # of what is normal: the twin waits, begins, follows again
    warnings: tuple[str, ...]  # of what is doubted, left out, or goes wrong

    @property
    def lines(self) -> tuple[str, ...]:
        """All lines to log."""
        return (*self.notes, *self.warnings)


class Tracker:
    """Twin that follows a live plant, started at any place and speed of the plant.

    Attributes:
        state: whether the twin waits, follows, or goes on by its model.
        arrivals: measurements and commands that come from the plant.
        sensors: of the plant by name.
        behind: s, by which the twin is behind the plant, as on a machine that is too slow.

    Args:
        scenario: of the twin, with the sensors of the plant.
        threads: of the ensemble.
        relief: what gives a twin that is behind its plant more of this machine, in words; empty where nothing does.
    """

    def __init__(self, scenario: Scenario, threads: int = 1, relief: str = "") -> None:
        follower: AnyFollower = follower_of(scenario, threads)
        self.follower, self.arrivals, self.state = follower, Arrivals(), WAITING
        self._most = {name: one.speed for name, one in command_limits(scenario).items()}
        self.sensors = scenario.sensors
        self._pursuit, self._stops = pursuit_of(scenario), EmergencyStops(scenario)
        slowing = max((decelerations(scenario, name)[0] for name in self._most), default=0.0)
        self._unheard = Unheard(slowing / scenario.gravity if scenario.gravity else 0.0)
        self._stop: Stop | None = None  # of the plant, until its time comes for the twin
        self._bringing = False  # whether the twin is brought to a plant that has moved on while the twin had stopped
        self._brought = 0.0  # s, until when at least
        self._moved = -np.inf  # s, when the plant was last seen, or commanded, to move
        self._silences = Silences()
        self._encoders = {name: one.of for name, one in scenario.sensors.items() if one.kind == "encoder"}
        self._forces = {name: one.of for name, one in scenario.sensors.items() if one.kind == "drive_force"}
        self._first, self._waits = 0.0, False  # s, of the first measurement since it listens; whether it said why
        self._cannot = False  # whether it said why it cannot begin
        self._heard = -np.inf  # s, of the newest measurements while it waits
        self._begun, self._learned = -np.inf, self.follower.learned  # s, and what was known then
        self._agreed, self._contradicted = 0, False  # first windows that agreed, and whether one did not
        self._far: dict[str, int] = {}  # samples of each encoder that were elsewhere
        self._newest: dict[str, float] = {}  # m, of each encoder
        self._left: dict[str, float] = {}  # m, the same of those that were left out, before a silence
        self._refused: set[str] = set()
        self.behind, self._told_behind, self._relief = 0.0, False, relief and f"; {relief}"
        self._notes: list[str] = []  # of what is normal, not told yet
        self._taken = 0.0  # s, of the last measurements that the twin took

    @property
    def wanted(self) -> str:
        """Motion of a plant at which following it can begin, in words: it stands still, or keeps a constant speed."""
        return "stands still" if self.follower.needs_rest else "moves at a constant speed"

    def measure(self, measurements: Sequence[Measurement], arrival: float) -> None:
        """Accept measurements that arrive at a time (s) of this computer's clock."""
        for one in self.arrivals.put(measurements, arrival):
            if self.state != FOLLOWING or one.sensor in self.follower.left_out:
                continue
            if one.sensor in self._forces:
                self._stops.pull(one.time, self._forces[one.sensor], one.values[0])
            if one.sensor not in self._encoders:
                continue
            stop = self._stops.measure(one.time, self._encoders[one.sensor], one.values[0])
            if stop is not None and not self._pursuit.stopped:
                self._stop = stop  # measurements wait longer for others than a stop takes to show
                self.arrivals.command(AppliedCommand(stop.time, Command("emergency_stop", {}), SOURCE))

    def command(self, speeds: Mapping[str, float], arrival: float) -> None:
        """Accept the commanded speeds (m/s) of the plant at a time (s) of this computer's clock."""
        time = self.arrivals.now(arrival)
        self.arrivals.command(AppliedCommand(time, Command("speed", dict(speeds)), SOURCE))

    def readmit(self, sensor: str) -> None:
        """Let a sensor that is left out or swapped count again, as somebody has looked at it; others are left alone."""
        doubts, other = self.follower.doubts, self.follower.doubts.swapped.get(sensor, "")
        if sensor not in doubts.left_out and not other:
            return
        doubts.readmit(sensor)
        self._left.pop(sensor, None)
        again = f"sensors {sensor} and {other} count for themselves" if other else f"sensor {sensor} counts again"
        self._notes.append(f"{again}, as asked for")
        if sensor in self._encoders and self.state == FOLLOWING:
            place = self.follower.place_of(sensor)
            if abs(self._newest.get(sensor, place) - place) > APART:
                self._bring(self.follower.time, True)

    def advance(self, arrival: float, present: float | None = None) -> Iterator[News]:
        """Advance the twin to a time (s) of this computer's clock; yields corrections and lines to log.

        Args:
            arrival: s, up to which what has arrived is taken.
            present: s, present time of that clock, if it is later.
        """
        present = arrival if present is None else present
        self.behind = 0.0
        if self.state == FOLLOWING:
            self.behind = max(self.arrivals.now(present) - HORIZON - self.follower.time, 0.0)
        yield from self._say_behind(present)
        if self.behind > TOO_FAR:
            arrival = present
        for time, group in groupby(self.arrivals.due(arrival), key=_time):
            yield from self._take(time, list(group))
        if self.arrivals.notes or self._notes:
            lines, self.arrivals.notes = self.arrivals.notes, []
            yield self._news(self.follower.time, None, lines)
        silence = arrival - self.arrivals.last
        if self.state != WAITING and silence > SILENT:
            yield from self._go_on_alone(self.arrivals.newest + silence - SILENT)

    def _take(self, time: float, items: Sequence[Item]) -> Iterator[News]:
        """Process the commands and measurements of one time (s); yields corrections and lines to log."""
        measured, lines = [item for item in items if isinstance(item, Measurement)], list[str]()
        for item in items:
            if isinstance(item, AppliedCommand) and item.command.kind == "emergency_stop":
                lines += self._begin_stop(time)
            elif isinstance(item, AppliedCommand):
                self._pursuit.command(time, item.command.values)
                self._moved = time if any(abs(one) > MOVES for one in item.command.values.values()) else self._moved
                for name in item.command.values if self.state != WAITING else ():
                    sensor = next((one for one, of in self._encoders.items() if of == name), "")
                    place = self.follower.place_of(sensor) if sensor and self.state == FOLLOWING else 0.0
                    if sensor in self.follower.left_out:
                        self._pursuit.leave(name)
                    now = max(time, self.follower.time)
                    if self._pursuit.moves_again(now, name, None):
                        self._release(now)
                    if fault := self._drive(now, name, place):
                        lines.append(fault)
        if measured and self.state == WAITING:
            self._listen(time)
        for one in measured:
            if one.sensor in self._encoders and one.sensor not in self.follower.left_out:
                self._pursuit.measure(time, self._encoders[one.sensor], one.values[0])
                speed = self._pursuit.speed_of(self._encoders[one.sensor])
                self._moved = time if speed is not None and abs(speed) > MOVES else self._moved
        if self.state == WAITING:
            if measured:
                yield from self._begin(time)
            return
        if time < self.follower.time - 1e-6 and measured:
            return  # the twin has gone on alone beyond it
        if self.state == ALONE and measured:
            self.state = FOLLOWING
            moved = time - self._moved < CALMED
            self.follower.doubt_swing(waves=UNHEARD if moved else 1.0)
            if moved:
                self._bring(time, True)
            self._notes.append(f"the plant is back at {time:.1f} s: the twin follows again")
        zeros = dict(self.follower.zeros)
        if self._bringing and time >= self._brought:
            self._bring(time, self._pursuit.catching_up)
        told = [one for one in measured if not (self._bringing and one.sensor in self._encoders)]
        correction = self.follower.take(time, told) if measured else None
        if measured:
            self._taken = time
            silent, back = self._silences.note(time, measured, self.follower.left_out)
            lines += silent
            self._notes += back
        self._note(correction)
        if self.follower.zeros != zeros:
            lines += self._move(time)
        lines += self._pursue(time, measured)
        if correction is not None or lines or self._notes:
            yield self._news(time, correction, lines)

    def _news(self, time: float, correction: Correction | None, warnings: Sequence[str]) -> News:
        """Report at a time (s), with the notes that are not told yet."""
        notes, self._notes = tuple(self._notes), []
        return News(time, correction, notes, tuple(warnings))

    def _note(self, correction: Correction | None) -> None:
        """Note a correction of a followed plant, and whether one of the first ones contradicts the beginning."""
        if correction is None:
            return
        self._unheard.followed(correction)
        if self._agreed < FIRST and not self._contradicted:
            self._contradicted = bool(self.follower.doubts.suspects)
            self._agreed += not self._contradicted

    def _begin_stop(self, time: float) -> list[str]:
        """Begin the emergency stop of the plant in the twin, if it follows; returns lines to log."""
        stop, self._stop = self._stop, None
        if stop is None or self.state == WAITING:
            return []
        time = max(time, self.follower.time)
        self.follower.command(AppliedCommand(time, Command("emergency_stop", {}), SOURCE))
        self.follower.doubt_swing(stop.time + stop.lasts + STOPPING)
        self._pursuit.stop(stop)
        return [f"the plant is stopped at {stop.time:.1f} s by an emergency stop, and the twin as well"]

    def _release(self, time: float) -> None:
        """Release the emergency stop in the twin, and note it."""
        self._pursuit.release()
        self.follower.command(AppliedCommand(max(time, self.follower.time), Command("release", {}), SOURCE))
        self._notes.append(
            f"the emergency stop of the twin is released at {time:.1f} s, as the plant moves or is elsewhere"
        )

    def _bring(self, time: float, bringing: bool) -> None:
        """Let encoders not count, and swing alone be corrected, while the twin is brought to the place of its plant."""
        self._bringing, self._brought = bringing, time + BROUGHT
        if bringing:
            self.follower.doubt_swing(self._brought)

    def _move(self, time: float) -> list[str]:
        """Put the twin where its plant is by an encoder with another zero: at once where that stands, else by speed."""
        if any(abs(self._pursuit.speed_of(name) or 0.0) > MOVES for name in self._encoders.values()):
            self._bring(time, True)
            return []
        return self._begin_at(time)

    def _say_behind(self, present: float) -> Iterator[News]:
        """Report that the twin is behind its plant in time; restart the twin where it is too far behind."""
        if self.behind > TOO_FAR:
            self.arrivals.drop(self.arrivals.now(present) - HORIZON - LISTENING)
            self._wait()
            self._told_behind = False
            text = f"{self.behind:.0f} s behind the plant, as this machine is too slow: begins anew at the present"
            yield self._news(self.follower.time, None, [text + self._relief])
        elif self.behind > BEHIND and not self._told_behind:
            self._told_behind = True
            yield self._news(self.follower.time, None, [f"{self.behind:.1f} s behind the plant{self._relief}"])
        elif self.behind < 0.5 * BEHIND:
            self._told_behind = False

    def _wait(self) -> None:
        """Forget the places of the plant, and wait until the twin can begin anew where it is."""
        self._forget()
        if self._pursuit.stopped:
            self._release(self.follower.time)
        self.state, self._heard, self._waits, self._stop = WAITING, -np.inf, False, None

    def _forget(self) -> None:
        """Forget what was measured, as before a gap."""
        self._pursuit.forget()
        self._stops.clear()
        self._silences.clear()

    def _listen(self, time: float) -> None:
        """Note that a twin that waits has measurements of a time (s); what was before a gap in them is forgotten."""
        if abs(time - self._heard) > SILENT:
            self._pursuit.forget()
            self._first = time
        self._heard = time

    def _begin(self, time: float) -> Iterator[News]:
        """Start the twin at the places of the plant's vehicles, after measurements of `LISTENING` (s) without a gap."""
        if time - self._first < LISTENING:
            return
        changing = [name for name in self._encoders.values() if not self._is_steady(time, name)]
        if changing and time - self._first < LONGEST_WAIT:
            if not self._waits:
                self._waits = True
                names, then = ", ".join(changing), "stop it" if self.follower.needs_rest else "keep its speed"
                text = f"waits until {names} of the plant {self.wanted}: {then} for some seconds, to have estimates"
                self._notes.append(text)
                yield self._news(time, None, [])
            return
        yield self._news(time, None, self._begin_at(time))

    def _is_steady(self, time: float, name: str) -> bool:
        """Whether a carriage or drive of the plant stands, or moves at a constant speed where that is enough to begin.

        Ropes swing after an acceleration and the force of a drive is another one, which a twin in steady motion would
        put down to payload, ice and friction. One that is commanded to move turns round, or starts, unless it is held.
        """
        speed, acceleration = self._pursuit.speed_of(name), self._pursuit.acceleration_of(name)
        if speed is None:
            return not self._pursuit.knows(name)  # an encoder of which nothing is ever heard is not waited for
        steady = acceleration is not None and abs(acceleration) < STEADY
        if abs(speed) < MOVES and self._pursuit.is_asked(time, name) and not self._pursuit.is_held(time, name):
            return False
        return steady and (abs(speed) < MOVES or not self.follower.needs_rest)

    def _begin_at(self, time: float) -> list[str]:
        motion = {}
        for name in self._encoders.values():
            place, speed = self._pursuit.place_of(name), self._pursuit.speed_of(name)
            if place is not None:
                most = self._most.get(name, np.inf)
                motion[name] = place, 0.0 if speed is None or abs(speed) < MOVES else float(np.clip(speed, -most, most))
        where = ", ".join(f"{name} at {place:.2f} m with {speed:.2f} m/s" for name, (place, speed) in motion.items())
        self._begun, self._learned = time, self.follower.learned
        self._agreed, self._contradicted = 0, False
        self._unheard.forget()
        try:
            self.follower.begin_at(time, motion)
        except (EquilibriumError, ValueError) as error:
            self._first, told, self._cannot = time, self._cannot, True  # it listens anew
            return [] if told else [f"cannot begin where the plant is ({where}): {str(error).splitlines()[0]}"]
        self.state, self._cannot = FOLLOWING, False
        if time - self._moved < CALMED:
            self.follower.doubt_swing()
        self._notes.append(f"follows the plant from {time:.1f} s on: {where or 'no encoder tells where it is'}")
        standing = not any(speed for _, speed in motion.values())
        if standing and (held := [name for name in motion if self._pursuit.is_held(time, name)]):
            self._stop = Stop(held[0], time, 0.0, 0.0)
            return self._begin_stop(time)
        return []

    def _pursue(self, time: float, measured: Sequence[Measurement]) -> list[str]:
        """Command the drives of the twin to follow the encoders; restart where the plant is far from the twin."""
        lines = list[str]()
        for one in measured:
            name = self._encoders.get(one.sensor)
            if name is None:
                continue
            self._newest[one.sensor] = one.values[0]
            trusted = one.sensor not in self.follower.left_out
            if not trusted and abs(one.values[0] - self._left.get(one.sensor, one.values[0])) <= ELSEWHERE:
                continue  # there was no silence, or it still reads what it did before it
            place = self.follower.place_of(one.sensor)
            apart = one.values[0] - place
            self._far[name] = self._far.get(name, 0) + 1 if abs(apart) > ELSEWHERE else 0
            if self._far[name] >= TIMES:
                self._far.clear()
                self._wait()
                text = f"{name} is {apart:+.1f} m from the twin, which begins anew there"
                if not trusted:
                    self.follower.doubts.readmit(one.sensor)
                    text += f"; sensor {one.sensor}, which was left out, counts again"
                if time - self._begun < PROVEN and self._agreed < FIRST:
                    self.follower.learned = self._learned
                    text += f"; what was learned since {self._begun:.1f} s is forgotten"
                return [*lines, text]
            if not trusted:
                continue
            if self._pursuit.moves_again(time, name, place):
                self._release(time)
                self._bring(time, True)
            if fault := self._drive(time, name, place):
                lines.append(fault)
        return lines

    def _drive(self, time: float, name: str, place: float) -> str:
        """Command a drive of the twin to follow the plant; returns the reason for its first refusal, else empty."""
        speed = self._pursuit.wanted(time, name, place)
        if speed is None:
            return ""
        try:
            self.follower.command(AppliedCommand(time, Command("speed", {name: speed}), SOURCE))
        except CommandError as error:
            line = f"the twin refuses a speed of the plant: {error}"
            new = name not in self._refused
            self._refused.add(name)
            return line if new else ""
        return ""

    def _go_on_alone(self, until: float) -> Iterator[News]:
        """Advance the twin by its model while the plant is silent, window by window, with growing variances."""
        if self.state == FOLLOWING:
            self.state = ALONE
            self._forget()
            self._left = {name: place for name, place in self._newest.items() if name in self.follower.left_out}
            since = self.arrivals.newest
            text = f"nothing from the plant since {since:.1f} s: the twin goes on by its model"
            yield self._news(since, None, [text])
        if self._taken + self.follower.window <= until:  # commands alone may have brought the twin beyond it
            self._taken = time = round(max(self._taken + self.follower.window, self.follower.time), 6)
            correction = self.follower.take(time, [])
            if correction is not None:
                yield self._news(time, self._unheard.widened(correction, time - self.arrivals.newest), [])


def _time(item: Item) -> float:
    """Time (s) of a command or measurement, to the microsecond."""
    return round(item.time, 6)
