"""Target places of carriages and drives of a running twin: commanded once, driven to frame by frame.

Speeds go to the simulation as anybody's commands do, and into the log, so that a replay needs no goals. Whatever else
is commanded takes over. Lives in the solver's thread; knows nothing of rclpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from cable_twin.frame.commands import KINDS
from cable_twin.frame.plotted_signals import SIGNALS, driven, driven_names
from cable_twin.frame.records import Command, CommandError, Goal
from cable_twin.runtime.approach import PERIOD, Approach, target_of
from cable_twin.simulation import Simulation
from cable_twin.simulation.command_checks import check_drive

SOURCE, ARRIVAL = "goal", "arrival"  # of the speeds on the way, and of that of 0 at its end, in the log
GIVEN_UP = "goal abandoned: "


class Goals:
    """Target places under way.

    Args:
        simulation: what runs.
        tell: takes a line about an arrival, and with True about a goal that is given up.

    Attributes:
        texts: how it is with the newest goal of each carriage or drive, for people.
    """

    def __init__(self, simulation: Simulation, tell: Callable[[str, bool], object]) -> None:
        self._simulation, self._tell = simulation, tell
        self._rows = {name: row for row, name in enumerate(driven_names(simulation.layout))}
        self._commanded = {name: row for row, name in enumerate(simulation.layout.commanded)}
        self._under_way: dict[str, tuple[Approach, float]] = {}  # and since when, in s of simulated time
        self._next = 0.0  # s of simulated time
        self.texts: dict[str, str] = {}

    def take(self, goal: Goal) -> None:
        """Begin trips to all places of a goal, or with an error to none; a trip under way continues to its new place.

        Raises:
            CommandError: nothing of the name is driven, the place is not on its way, it is too fast, or all is stopped.
        """
        simulation, found = self._simulation, {}
        if simulation.emergency_stopped:
            raise CommandError("the emergency stop is in force: release it before the next command")
        for name, place in goal.places.items():
            at_most = goal.at_most.get(name)
            check_drive(Command("speed", {name: at_most or 0.0}), simulation.scenario)
            try:
                target = target_of(simulation.scenario, name, repr(place))
                found[name] = Approach(simulation.scenario, name, target, at_most)
            except ValueError as error:
                raise CommandError(str(error)) from None
        for name, approach in found.items():
            before = self._under_way[name][0] if name in self._under_way else None
            if before is not None and (before.target, before.fastest) == (approach.target, approach.fastest):
                continue  # told again
            if before is not None:
                approach.go_on_from(before)
            self._under_way[name] = approach, simulation.time
            self.texts[name] = f"on its way to {approach.target:.2f} m"
        self._next = min(self._next, simulation.time)

    def commands(self) -> Iterator[tuple[Command, str]]:
        """Speed commands due at the present time with their source, each to be applied before the next is taken."""
        simulation = self._simulation
        if not self._under_way or simulation.time < self._next - 1e-9:
            return
        self._next = simulation.time + PERIOD
        snapshot = simulation.snapshot
        state = driven(snapshot.layout, snapshot.columns)
        ways, speeds = (
            SIGNALS[name].read(snapshot.layout, snapshot.columns) for name in ("reference_position", "reference_speed")
        )
        for name, (approach, since) in list(self._under_way.items()):
            place, row = float(state.place[self._rows[name]]), self._commanded[name]
            value = approach.speed(snapshot.time, place, float(ways[row]), float(speeds[row]))
            if fault := approach.stalled(snapshot.time, place):
                self.give_up(name, fault)
                yield Command("speed", {name: 0.0}), SOURCE
            elif value is None:
                del self._under_way[name]
                away = f"{abs(approach.target - place):.2f} m from {approach.target:.2f} m"
                self.texts[name] = f"arrived at {place:.2f} m, {away}"
                self._tell(f"{name} has {self.texts[name]}, after {snapshot.time - since:.1f} s", False)
                yield Command("speed", {name: 0.0}), ARRIVAL
            else:
                yield Command("speed", {name: value}), SOURCE

    def note(self, command: Command, source: str) -> None:
        """Record a command that has taken effect, and give up goals that it overrides."""
        kind = KINDS[command.kind]
        if source not in (SOURCE, ARRIVAL) and (kind.drives or kind.halts):
            for name in list(self._under_way):
                if kind.halts or name in command.values:
                    self.give_up(name, f"{command.kind.replace('_', ' ')} from {source} took over")

    def give_up(self, name: str, why: str) -> None:
        """Abandon the goal of a carriage or drive."""
        del self._under_way[name]
        self.texts[name] = f"abandoned: {why}"
        self._tell(f"{GIVEN_UP}{name}: {why}", True)


__all__ = ["ARRIVAL", "GIVEN_UP", "SOURCE", "Goals"]
