"""Point-to-point motion: goals of carriages and drives, commanded once, with a trapezoidal speed profile to each.

The profile follows the reference position of the drive, so that an elastic haul rope is not excited by a loop over it.
The offset of the vehicle from there, the stretch of that rope, is low-pass filtered and added: on arrival the drive
rests, and the place around which the vehicle may still swing, for minutes on a long rope, is the goal.

Speeds are applied as commands are, and logged, so that a replay needs no goals. Any other drive command abandons the
goal. All runs in the solver's thread.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

from cable_twin.frame.commands import KINDS
from cable_twin.frame.plotted_signals import SIGNALS, driven, driven_names
from cable_twin.frame.records import Command, CommandError, Goal
from cable_twin.scenario import Scenario, places_of
from cable_twin.simulation import Simulation
from cable_twin.simulation.command_handlers import check_drive

TOLERANCE = 0.1  # m, largest distance from the goal on arrival
RESTING = 0.05  # m/s, speed of the drive below which it counts as at rest
SETTLED = 2.0  # s of simulated time within both, until arrival
SHARE = 0.7  # of the drive's acceleration and deceleration that the profile uses, so that the drive can follow
LANDING = 0.5  # s, time constant of the last decimetres
STRETCHING, STIFF = 3.0, 1.0  # s, time constant of the filter with an elastic haul rope, and without
STALLED = 60.0  # s of simulated time without progress, after which a goal is abandoned
TOLD = 60.0  # s of simulated time, for which the reason of an abandoned goal is told
PERIOD = 0.05  # s of simulated time between two speeds
STATIONS = ("start", "end", "lower_station", "upper_station")
SOURCE, ARRIVAL = "goal", "arrival"  # logged source of speeds on the way, and of the speed 0 on arrival
ABANDONED = "goal abandoned: "  # begin of the message


class PointToPoint:
    """Speed profile that brings a carriage, or the cable of a drive, to a place.

    Args:
        scenario: running scenario.
        name: name of the carriage or drive.
        target: arc length (m) of the place; of a drive, its cable travel (m).
        at_most: highest speed (m/s); None for the limit of the drive.

    Raises:
        ValueError: neither the drive nor `at_most` limits the speed, or that is 0; the message is one line.
    """

    def __init__(self, scenario: Scenario, name: str, target: float, at_most: float | None) -> None:
        drive = scenario.drives.get(name)
        limits = drive.limits if drive is not None else scenario.carriages[name].drive.limits
        if at_most == 0.0:
            raise ValueError(
                f"speed of '{name}': given 0 m/s; allowed: the highest speed of the trip, above 0, or NaN or no "
                "velocity at all for that of its drive"
            )
        fastest = at_most or limits.speed
        if not fastest:
            allowed = "the highest speed of the trip, in m/s, as its drive has no limit"
            raise ValueError(f"speed of '{name}': given nothing; allowed: {allowed}")
        self.name, self.target, self.fastest = name, target, fastest
        self._gaining = SHARE * limits.acceleration
        self._slowing = SHARE * min(limits.acceleration, limits.service_deceleration)
        self._landing = LANDING + (0.0 if limits.jerk is None else self._slowing / limits.jerk)
        elastic = drive is None and scenario.carriages[name].drive.haul_rope is not None
        self._filter_time = STRETCHING if elastic else STIFF
        self._last = (math.nan, 0.0)  # time (s) and value (m/s) of the newest speed
        self._filters = (math.nan, math.nan)  # m, offset of the place from the reference after one and two filters
        self._filtered = math.nan  # time (s) of the newest offset
        self._near_since: float | None = None  # s
        self._mean = (0.0, 0)  # mean place (m) since then, and number of places in it
        self._nearest = (math.inf, math.nan)  # smallest distance (m), and its time (s)
        self._side = 0.0  # m, distance at that time with its sign

    def speed(self, time: float, place: float, reference: float, reference_speed: float) -> float | None:
        """Speed (m/s) due now on the way to a place; None after arrival.

        Args:
            time: simulated time (s).
            place: arc length (m) of the vehicle, or cable travel (m).
            reference: reference position (m) of the drive.
            reference_speed: reference speed (m/s) of the drive.
        """
        if math.isnan(self._last[0]):
            self._last = time, reference_speed
        left = self.target - reference - self._filter(time, place - reference)
        if abs(left) > TOLERANCE or abs(reference_speed) > RESTING:
            self._near_since, self._mean = None, (0.0, 0)
        else:
            mean, count = self._mean
            self._mean = mean + (place - mean) / (count + 1), count + 1
            self._near_since = time if self._near_since is None else self._near_since
            if time - self._near_since >= SETTLED and abs(self.target - self._mean[0]) <= TOLERANCE:
                return None
        slowing, landing = self._slowing, self._landing
        size = min(self.fastest, slowing * (math.sqrt(landing**2 + 2.0 * abs(left) / slowing) - landing))
        gained = self._gaining * max(time - self._last[0], PERIOD)
        self._last = time, math.copysign(min(size, abs(self._last[1]) + gained), left)
        return self._last[1]

    def continue_from(self, before: PointToPoint) -> None:
        """Continue from the speed and the swing filter of a previous motion to another place."""
        self._last, self._filters, self._filtered = before._last, before._filters, before._filtered

    def stalled(self, time: float, place: float) -> str:
        """Message about a motion without progress, empty during progress."""
        left = self.target - place
        distance, passed = abs(left), left * self._side < 0.0
        if passed or distance < self._nearest[0] - 1e-3 or distance <= TOLERANCE:
            self._nearest, self._side = (distance, time), left
        if time - self._nearest[1] <= STALLED:
            return ""
        return (
            f"'{self.name}' has come no nearer than {self._nearest[0]:.2f} m to {self.target:.2f} m "
            f"for {STALLED:g} s of simulated time: it may be held, or its drive too weak"
        )

    def _filter(self, time: float, offset: float) -> float:
        """Offset (m) of the place from the reference, after two first-order filters that suppress vehicle swing."""
        if math.isnan(self._filtered):
            self._filters, self._filtered = (offset, offset), time
        share = 1.0 - math.exp(-max(time - self._filtered, 0.0) / self._filter_time)
        first = self._filters[0] + share * (offset - self._filters[0])
        self._filters, self._filtered = (first, self._filters[1] + share * (first - self._filters[1])), time
        return self._filters[1]


def target_of(scenario: Scenario, name: str, place: str | float, towers: Mapping[str, float] | None = None) -> float:
    """Convert a place to drive to into an arc length (m) of a carriage, or a cable travel (m) of a drive.

    Args:
        scenario: running scenario.
        name: name of the carriage or drive.
        place: metres; or as a text metres, a tower, or one of `STATIONS`, before whose end stop a carriage stops; for
            a drive, "start" and "end" are the ends of its travel.
        towers: arc length (m) of the cable at each tower, by name.

    Raises:
        ValueError: the place is out of reach; the message is one line.
    """
    try:
        metres = float(place)
    except ValueError:
        metres = math.nan
    low, high = places_of(scenario, name)
    given = f"{place:g} m" if isinstance(place, float) else repr(place)
    if name in scenario.drives:
        metres = {"start": low, "end": high}.get(str(place), metres)
        if math.isfinite(metres) and low <= metres <= high:
            return metres
        names = ", or start, end" if isinstance(place, str) else ""
        allowed = f"{low:g} to {high:g} m of cable travel{names}" if math.isfinite(low) else "cable travel, in m"
        raise ValueError(f"place for '{name}': given {given}; allowed: {allowed}")
    rope = scenario.carriages[name].rope
    cable = scenario.cable if rope is None else scenario.ropes[rope]
    ends = {"start": low, "end": high}
    downwards = cable.start.position[-1] > cable.end.position[-1]
    ends["lower_station"], ends["upper_station"] = sorted(ends.values(), reverse=downwards)
    target = {**(towers or {}), **ends}.get(str(place), metres)
    if not low <= target <= high:
        names = f", or {', '.join((*STATIONS, *scenario.towers))}" if isinstance(place, str) else ""
        allowed = f"{low:.6g} to {high:.6g} m along the cable{names}"
        raise ValueError(f"place for '{name}': given {given}; allowed: {allowed}")
    return target


class Goals:
    """Goals (places to drive to) of the carriages and drives of a simulation, with a motion to each goal.

    Args:
        simulation: running simulation.
        tell: called with a message about an arrival (False) or an abandoned goal (True).

    Attributes:
        texts: state of the goal of each carriage or drive, in words; of an arrival until it is commanded otherwise, of
            an abandoned goal for `TOLD`. Replaced as a whole, for readers in other threads.
    """

    def __init__(self, simulation: Simulation, tell: Callable[[str, bool], object]) -> None:
        self._simulation, self._tell = simulation, tell
        self._rows = {name: row for row, name in enumerate(driven_names(simulation.layout))}
        self._commanded = {name: row for row, name in enumerate(simulation.layout.commanded)}
        self._under_way: dict[str, tuple[PointToPoint, float]] = {}  # motion and its start (s of simulated time)
        self._abandoned: dict[str, float] = {}  # simulated time (s)
        self._next = 0.0  # simulated time (s) of the next speeds
        self.texts: dict[str, str] = {}

    def take(self, goal: Goal) -> None:
        """Begin motions to all places of a goal, or to none after an error; a motion under way is redirected.

        Raises:
            CommandError: unknown name, place out of reach, speed above the limit, or emergency stop in force.
        """
        simulation, found = self._simulation, {}
        if simulation.emergency_stopped:
            raise CommandError("the emergency stop is in force: release it before the next command")
        for name, place in goal.places.items():
            at_most = goal.at_most.get(name)
            check_drive(Command("speed", {name: at_most or 0.0}), simulation.scenario)
            try:
                target = target_of(simulation.scenario, name, place)
                found[name] = PointToPoint(simulation.scenario, name, target, at_most)
            except ValueError as error:
                raise CommandError(str(error)) from None
        for name, motion in found.items():
            before = self._under_way[name][0] if name in self._under_way else None
            if before is not None and (before.target, before.fastest) == (motion.target, motion.fastest):
                continue  # the present goal again
            if before is not None:
                motion.continue_from(before)
            self._under_way[name] = motion, simulation.time
            self._say(name, f"on its way to {motion.target:.2f} m")
        self._next = min(self._next, simulation.time)

    def commands(self) -> Iterator[tuple[Command, str]]:
        """Speed commands due at the present time with their source, each to be applied before the next is taken."""
        simulation = self._simulation
        for name in [name for name, since in self._abandoned.items() if simulation.time - since > TOLD]:
            self._say(name)
        if not self._under_way or simulation.time < self._next - 1e-9:
            return
        self._next = simulation.time + PERIOD
        snapshot = simulation.snapshot
        state = driven(snapshot.layout, snapshot.columns)
        references, speeds = (
            SIGNALS[name].read(snapshot.layout, snapshot.columns) for name in ("reference_position", "reference_speed")
        )
        for name, (motion, since) in list(self._under_way.items()):
            place, row = float(state.place[self._rows[name]]), self._commanded[name]
            value = motion.speed(snapshot.time, place, float(references[row]), float(speeds[row]))
            if fault := motion.stalled(snapshot.time, place):
                self.abandon(name, fault)
                yield Command("speed", {name: 0.0}), SOURCE
            elif value is None:
                del self._under_way[name]
                away = f"{abs(motion.target - place):.2f} m from {motion.target:.2f} m"
                self._say(name, f"arrived at {place:.2f} m, {away}")
                self._tell(f"{name} has {self.texts[name]}, after {snapshot.time - since:.1f} s", False)
                yield Command("speed", {name: 0.0}), ARRIVAL
            else:
                yield Command("speed", {name: value}), SOURCE

    def note(self, command: Command, source: str) -> None:
        """Record an applied command: goals that it overrides are abandoned, and arrivals before it told no more."""
        kind = KINDS[command.kind]
        if source not in (SOURCE, ARRIVAL) and (kind.drives or kind.halts):
            for name in [name for name in self.texts if name not in self._abandoned]:
                if kind.halts or name in command.values:
                    if name in self._under_way:
                        self.abandon(name, f"{command.kind.replace('_', ' ')} from {source} took over")
                    else:
                        self._say(name)

    def abandon(self, name: str, why: str) -> None:
        """Abandon the goal of a carriage or drive."""
        del self._under_way[name]
        self._say(name, f"abandoned: {why}")
        self._abandoned[name] = self._simulation.time
        self._tell(f"{ABANDONED}{name}: {why}", True)

    def _say(self, name: str, text: str = "") -> None:
        """Set the text about a goal; without one, remove it."""
        self._abandoned.pop(name, None)
        others = {other: said for other, said in self.texts.items() if other != name}
        self.texts = {**others, name: text} if text else others
