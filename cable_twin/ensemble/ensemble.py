"""Ensemble of simulations: members that share one compiled system, advanced side by side by threads."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import nullcontext
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.ensemble.advancing import GOING, STATUS
from cable_twin.ensemble.blending import Turn, are_alike, blend, turn
from cable_twin.ensemble.columns import MemberColumns, figure_columns
from cable_twin.ensemble.members import MemberStates, looks_of
from cable_twin.ensemble.threads import Threads
from cable_twin.ensemble.values import Source, Values, numbers_of, put_in, values_of, with_values
from cable_twin.frame.quantities import Reader, chosen, quantities
from cable_twin.frame.records import AppliedCommand, Command, CommandError
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.language.declared import LATEST
from cable_twin.mechanics.parameters import FORCE, SPEED, FloatArray
from cable_twin.scenario import Scenario, command_limits, load_scenario
from cable_twin.simulation import SAMPLES, EquilibriumError, Simulation
from cable_twin.simulation.engine import Settings

ENDS_OF_CABLE = 2  # samples of each rope: the fewest
Chosen = int | slice | Sequence[int] | None


class Ensemble:
    """Ensemble of simulations of one scenario that share its compiled system, and differ in state and parameters.

    Each member is bit-equal to a `Simulation` of its scenario, at any number of threads, and is one row of memory;
    members with equal values share their parameters. Methods are for one thread alone.

    Args:
        scenario: name, path, mapping, or loaded scenario.
        members: number of members, at least 1.
        parameters: values by dotted key of the scenario, such as "carriages.cabin.payload.mass": a sequence with one
            for each member, or one for all.
        rest: let each member begin at the static equilibrium of its own parameters; else all begin at that of the
            scenario, and parameters change there.
        samples: points (at least 2) at which snapshots hold each rope; None for both ends, and for as many as a
            `Simulation` has where key figures are gathered, which are of these points.
        figures_period: simulated time (s) between two looks at the key figures; None for none.
        threads: number of threads; None for one a core.
        progress: whether long calls show a bar; None for where the standard error is a terminal.

    Raises:
        ScenarioError: the scenario or a value is invalid.
        EquilibriumError: a member has no static equilibrium.
        ValueError: an argument does not fit; the message is one line.
    """

    def __init__(
        self,
        scenario: Source | Scenario,
        members: int,
        *,
        parameters: Values | None = None,
        rest: bool = True,
        samples: int | None = None,
        figures_period: float | None = None,
        threads: int | None = None,
        progress: bool | None = None,
    ) -> None:
        for name, number in (("members", members), ("threads", 1 if threads is None else threads)):
            if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 1:
                raise ValueError(f"{name}: given {number!r}; allowed: a whole number from 1")
        if samples is None:
            samples = ENDS_OF_CABLE if figures_period is None else SAMPLES
        self._source: Source = scenario.resolved() if isinstance(scenario, Scenario) else scenario
        base = Simulation(load_scenario(self._source), samples=samples, on_demand=True)
        self.scenario = self._alike = base.scenario
        self._states = MemberStates(base, int(members))
        self._progress = sys.stderr.isatty() if progress is None else progress
        self._values: list[dict[str, Any]] = [{} for _ in range(len(self))]
        self._sources: list[Source] = [self._source] * len(self)  # to which the values of each belong
        self._faults: dict[int, str] = {}
        self._first = self._states.settings[0]
        self._limits, self._looks = command_limits(self.scenario), looks_of(base)
        self._threads = Threads(base.engine, usable_cores() if threads is None else int(threads))
        self._figures_steps, self._figures = 0, [KeyFigures(self.scenario)] * len(self)
        if parameters:
            self.change(parameters, rest=rest)
        if figures_period is not None:
            self._gather(figures_period)

    def __len__(self) -> int:
        """Number of members in the ensemble."""
        return self._states.size

    @property
    def layout(self) -> Layout:
        """Names and indices of the values in the row of a snapshot."""
        return self._states.base.layout

    @property
    def times(self) -> FloatArray:
        """Simulated time (members,) in s of each member."""
        return self._states.times

    @property
    def faults(self) -> Mapping[int, str]:
        """Reason why each ended member has ended, a line each: a failed step, or vehicles passed through each other.

        An ended member stays at its last good state, until it is forked or reset.
        """
        return dict(self._faults)

    @property
    def values(self) -> tuple[Mapping[str, Any], ...]:
        """Values by dotted key in which each member differs from the scenario, or from the one it was begun with."""
        return tuple(dict(one) for one in self._values)

    @property
    def memory(self) -> int:
        """Memory (bytes) of one member: its state and solver outcome, without parameters of its own."""
        return sum(array.nbytes for array in self._states.arrays) // len(self)

    def change(self, parameters: Values, members: Chosen = None, *, rest: bool = False) -> None:
        """Change parameters of members, at their present state or at a new static equilibrium.

        At the present state, the payload of a carriage, wind and temperature change where their keys are given, and
        payloads of carriers where they are still those of the start; joints keep the compliance of the rest.

        Args:
            parameters: values by dotted key: a sequence with one for each of these members, or one for all.
            members: number of a member, slice, sequence of numbers or mask of all; None for all.
            rest: begin at the static equilibrium of the new values, at time 0.

        Raises:
            ScenarioError: a value is refused, as `load_scenario` does.
            EquilibriumError: there is no static equilibrium; the message names the member.
            ValueError: a value needs another mesh, other parts or another solver; one line with the key.
        """
        rows = self._rows(members)
        wanted = values_of(len(rows), parameters)
        states, made, changed = self._states, {}, []
        with self._bar("members", len(rows)) as show:
            for member, own in zip(rows, wanted, strict=True):
                values = self._values[member] | own
                if (key := (id(self._sources[member]), repr(sorted(values.items())))) not in made:
                    made[key] = self._made(member, values, rest)
                changed.append((member, values, made[key]))
                show()
        for (member, values, (variant, state, motion, settings)), own in zip(changed, wanted, strict=True):
            before = states.variants[member].engine.vehicles.first_loads
            states.variants[member], self._values[member] = variant, values
            if rest:
                states.arrays.states[member], states.arrays.motions[member] = state, motion
                states.take([member], settings)
                self._revive([member])
            else:
                self._go_on_with(member, states.settings[member], settings, before, own)
        self._threads.forget([one.engine.bundle for one in states.variants])

    def begin(self, scenario: Scenario, member: int) -> None:
        """Start a member from the equilibrium of another scenario with equal ropes, meshes, vehicles and solver.

        Raises:
            EquilibriumError: there is no static equilibrium; the member stays as it was.
            OtherModelError: the scenario has another mesh, other parts or another solver.
        """
        row, states, engine = self._row(member), self._states, self._states.base.engine
        engine.go_to_start()
        states.variants[row] = variant = states.base.with_values(scenario)
        self._sources[row], self._values[row] = scenario.resolved(), {}
        states.leave(row, variant)
        self._revive([row])
        self._threads.forget([one.engine.bundle for one in states.variants])

    def fork(self, simulation: Simulation, members: Chosen = None, *, at: Any = None) -> None:
        """Copy the state of a simulation, at present or at given times, into members, which keep their own parameters.

        Where the values of a member name the payload of a carriage, wind or temperature, it keeps these too, and
        payloads of carriers where they have not changed in stations. A reset goes to the start of the simulation.

        Args:
            simulation: of the scenario of this ensemble.
            members: number of a member, slice, sequence of numbers or mask of all; None for all.
            at: time (s), one for all or one for each of these members, up to which the simulation runs before it is
                copied; None for the present state.

        Raises:
            ValueError: given is no simulation, or one of another scenario or already beyond a time.
            SolverError: the simulation fails on its way to a time; members of earlier times have been forked.
        """
        states, base = self._states, self._states.base
        if not isinstance(simulation, Simulation):
            raise ValueError(f"fork: given {simulation!r}; allowed: a Simulation of '{base.scenario.name}'")
        if at is not None:
            self._fork_at(simulation, self._rows(members), at)
            return
        if simulation.scenario is not self._alike and simulation.scenario.resolved() != base.scenario.resolved():
            raise ValueError(
                "fork: given a simulation of another scenario, or with other values of its keys; "
                f"allowed: a simulation of '{base.scenario.name}' with the values of the ensemble"
            )
        self._alike = simulation.scenario  # known to be: comparing takes longer than all that follows
        rows, settings = self._rows(members), simulation.engine.settings()
        states.arrays.states[rows] = simulation.engine.memory
        states.arrays.motions[rows] = simulation.engine.moving.memory
        alike = [member for member in rows if states.variants[member] is base]
        states.take(alike, settings)
        for member in [member for member in rows if states.variants[member] is not base]:
            keys = self._values[member] if self._sources[member] is self._source else ("air", "carriages")
            self._go_on_with(member, settings, states.settings[member], base.engine.vehicles.first_loads, keys)
        self._revive(rows)

    @property
    def alike(self) -> bool:
        """Whether all members have each vehicle in the same rope element, and each drive in the same mode."""
        return are_alike(self._states)

    def blend(self, weights: FloatArray) -> None:
        """Replace the state of each member by a weighted sum of the states of all; parameters stay.

        For members near each other, as a filter has them, that is a state of the system to second order.

        Args:
            weights: (members, members), each row with the sum 1.

        Raises:
            ValueError: members are not `alike`.
        """
        if not self.alike:
            raise ValueError(
                "blend: given members with vehicles in different elements or drives in different modes; "
                "allowed: members with the same elements and modes"
            )
        blend(self._states, weights)

    def swing(self, member: int, turns: Sequence[Turn]) -> None:
        """Rotate bodies of a member, with all bodies that hang below them; the rope and its joint keep their state."""
        row = self._row(member)
        turn(self._states, row, turns)

    def command(self, name: str, *, speed: Any = None, force: Any = None, members: Chosen = None) -> None:
        """Drive a carriage, or a moving cable by the name of its drive, in members until the next command.

        Args:
            name: of the carriage or the drive.
            speed: m/s along the cable, one for all or (members,).
            force: N along the cable, or at the rim of a bullwheel; one for all or (members,).
            members: number of a member, slice, sequence of numbers or mask of all; None for all.

        Raises:
            CommandError: the command is refused for a member, which the message names; no member is commanded then.
        """
        if (speed is None) == (force is None):
            raise CommandError(
                f"command for '{name}': given {'nothing' if speed is None else 'both'}; "
                "allowed: either speed (m/s) or force (N)"
            )
        rows, kind = self._rows(members), "force" if speed is None else "speed"
        given = numbers_of(len(rows), kind, force if speed is None else speed)
        alike = self._drive_alike(rows, name, kind, given)
        if alike and not self._figures_steps:
            return
        commands = [Command(kind, {name: value}) for value in given.tolist()]
        if alike:
            self._tell_figures(rows, commands)
        else:
            self._apply_each(rows, commands)

    def emergency_stop(self, active: bool = True, members: Chosen = None) -> None:
        """Stop all drives of members at their emergency deceleration, or release them."""
        self.apply(Command("emergency_stop" if active else "release", {}), members)

    def apply(self, command: Command | Sequence[Command], members: Chosen = None) -> None:
        """Apply a command of any kind to members, or one command to each.

        Raises:
            CommandError: the command is refused for a member, which the message names; no member is commanded then.
        """
        rows = self._rows(members)
        if isinstance(command, Command | str) or not isinstance(command, Iterable):
            each = [command] * len(rows)
        else:
            each = list(command)
        if len(each) != len(rows):
            raise ValueError(f"apply: given {len(each)} commands; allowed: one, or {len(rows)}, one for each member")
        self._apply_each(rows, each)

    def load(self, name: str, masses: FloatArray) -> None:
        """Begin loading a vehicle to payloads (members,) in kg, over its loading time, wherever it is."""
        states = self._states
        for member, mass in enumerate(masses.tolist()):
            simulation = states.enter(member)
            simulation.engine.vehicles.load({name: mass})
            states.leave(member, simulation)

    def advance_to(self, time: Any) -> None:
        """Run members until `time` (s), one for all or (members,), to the nearest whole step; see `faults` after it.

        Members that have ended stay where they are. After Ctrl-C each member is at a whole step, and may go on.

        Raises:
            ValueError: a time is not finite, or a step or more ago for a member.
        """
        times = numbers_of(len(self), "advance_to", time)
        states, step, clocks = self._states, self._states.base.step, self._states.clocks
        targets = np.round(np.where(np.abs(times) < LATEST * step, times, -1.0) / step).astype(np.int64)
        for member in np.flatnonzero(self._alive & (targets < clocks)).tolist():
            raise ValueError(
                f"advance_to: given {times[member]:.9g} s for member {member}; allowed: a finite time, from "
                f"{self.times[member]:.9g} s up to {LATEST * step:.3g} s"
            )
        total = int(np.maximum(targets - clocks, 0).sum())
        with self._share_bar("members advance") as show:

            def on_part() -> None:
                show(1.0 - float(np.maximum(targets - states.clocks, 0).sum()) / max(total, 1))

            states.reset_counts(slice(None))
            if not self._figures_steps:
                self._advance(targets, on_part)
                return
            while (going := np.flatnonzero(self._alive & (states.clocks < targets))).size:
                due = (states.clocks // self._figures_steps + 1) * self._figures_steps
                states.reset_counts(going)
                self._advance(np.minimum(due, targets), on_part)
                for member in going.tolist():
                    self._figures[member].update(states.read(member).snapshot)

    def observe(self, names: str | Sequence[str] | None = None) -> MemberColumns:
        """Present quantities of all members: columns (members, n) by name, with units.

        Args:
            names: of quantities, with * for any text, such as ["cabin/*", "end/tension"]; None for all.

        Raises:
            ValueError: a name matches no quantity; the message has names like it.
        """
        numbers = self.numbers()
        known = quantities(self.scenario, self.layout)
        first = Snapshot(self.layout, numbers[0], self._states.report(0))
        seen = chosen(known, ["*"] if names is None else names, first)
        return MemberColumns(list(seen), [one.unit for one in seen.values()], Reader(seen.values()).read(numbers))

    def numbers(self) -> FloatArray:
        """Values (members, n) of the present snapshots of all members, in the order of `layout`."""
        return self._states.numbers()

    def snapshot(self, member: int) -> Snapshot:
        """Snapshot of the present state of a member."""
        return self._states.read(self._row(member)).snapshot

    def snapshots(self) -> list[Snapshot]:
        """Snapshots of the present states of all members; with a single rope much faster than `snapshot` of each."""
        states = self._states
        return [Snapshot(self.layout, row, states.report(member)) for member, row in enumerate(states.numbers())]

    def simulation(self, member: int) -> Simulation:
        """Independent simulation that continues from the present state of a member, bit for bit."""
        return copy(self._states.enter(self._row(member)))

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("copy or pickle: given an Ensemble; allowed: a Simulation, as of `simulation(member)`")

    def figures(self) -> MemberColumns:
        """Key figures of all members from the start to the present time: columns (members, n) by name, with units.

        Raises:
            ValueError: the ensemble was made without `figures_period`.
        """
        if not self._figures_steps:
            raise ValueError(
                "figures: given an ensemble without key figures; allowed: with figures_period (s), such as 0.05, "
                "given when it was made"
            )
        return figure_columns([one.figures() for one in self._figures])

    def close(self) -> None:
        """End the threads of the ensemble, which cannot be used afterwards."""
        self._threads.close()

    def _made(
        self, member: int, values: Mapping[str, Any], rest: bool
    ) -> tuple[Simulation, NDArray[np.uint8], NDArray[np.uint8], Settings]:
        """Build the simulation of a member with its own scenario values; returns also state, couplings, settings."""
        base, engine, source = self._states.base, self._states.base.engine, self._sources[member]
        own = bool(values) or source is not self._source
        engine.go_to_start()
        try:
            variant = with_values(base, source, values, rest=rest) if own else base
        except EquilibriumError as error:
            raise EquilibriumError(f"member {member}: {error}") from None
        settings = variant.engine.settings() if own else self._first
        return variant, engine.memory.copy(), engine.moving.memory.copy(), settings

    def _fork_at(self, simulation: Simulation, rows: Sequence[int], at: Any) -> None:
        """Run a simulation through given times (s) in ascending order; copy its state into one member at each time."""
        times = numbers_of(len(rows), "fork: at", at)
        for member, time in zip(rows, times.tolist(), strict=True):
            if not math.isfinite(time) or time < simulation.time - 0.5 * simulation.step:
                raise ValueError(
                    f"fork: at: given {time:.9g} s for member {member}; allowed: a finite time, from "
                    f"{simulation.time:.9g} s of the simulation on"
                )
        with self._bar("members", len(rows)) as show:
            for place in np.argsort(times, kind="stable").tolist():
                simulation.advance_to(float(times[place]))
                self.fork(simulation, rows[place])
                show()

    def _go_on_with(
        self, member: int, settings: Settings, parameters: Settings, before: FloatArray, keys: Collection[str]
    ) -> None:
        """Continue a member's present state with other settings, the parameters of `parameters`, and given keys.

        Args:
            member: number of the member.
            settings: settings, except the parameters.
            parameters: settings with the parameters.
            before: (vehicles,) kg, payloads at the start that the state comes from.
            keys: keys of the member's scenario whose payloads, wind and temperature replace those of the state.
        """
        states, vehicles = self._states, settings.vehicles._replace(carried=None)
        states.take([member], settings._replace(parameters=parameters.parameters, vehicles=vehicles))
        simulation = states.enter(member)
        simulation.engine.carry_loads()
        put_in(simulation, keys, before)
        states.leave(member, simulation)

    def _advance(self, targets: NDArray[np.int64], on_part: Callable[[], object]) -> None:
        """Advance members to clocks (members,), counted in steps, and record the reason of each member that ends."""
        states, arrays, clocks = self._states, self._states.arrays, self._states.clocks.copy()
        arrays.left[:] = np.where(self._alive, np.maximum(targets - clocks, 0), 0)
        order = np.flatnonzero(arrays.left > 0)
        if not order.size:
            return
        bundles = [one.engine.bundle for one in states.variants]
        self._threads.advance(arrays, self._looks, order, bundles, self._see_to, on_part)
        looked_at = order if self._looks.before.size else np.flatnonzero(arrays.counts[:, STATUS] != GOING)
        for member in looked_at.tolist():
            if line := "" if member in self._faults else states.fault(member, int(clocks[member])):
                self._faults[member] = line

    def _see_to(self, member: int) -> None:
        """Handle an interruption of a member's steps: stop after a rollback, loading, payload changes in stations."""
        states, looks = self._states, self._looks
        simulation = states.enter(member)
        simulation.engine.stop_rolled_back()
        if states.clocks[member] % looks.period == 0 and states.arrays.counts[member, STATUS] == GOING:
            simulation.engine.vehicles.serve(looks.period * simulation.step)
        states.leave(member, simulation)

    def _apply_each(self, rows: Sequence[int], commands: Sequence[Command]) -> None:
        """Apply one command to each of some members; if any command is refused, no member is changed."""
        states, arrays = self._states, self._states.arrays
        before = arrays.states[rows].copy(), arrays.motions[rows].copy()
        settings = [states.settings[member] for member in rows]
        for member, command in zip(rows, commands, strict=True):
            simulation = states.enter(member)
            try:
                simulation.apply(command)
            except CommandError as error:
                arrays.states[rows], arrays.motions[rows] = before
                for row, old in zip(rows, settings, strict=True):
                    states.take([row], old)
                raise CommandError(f"member {member}: {error}") from None
            states.leave(member, simulation)
            if command.kind == "reset":
                self._revive([member])
        self._tell_figures(rows, commands)

    def _tell_figures(self, rows: Sequence[int], commands: Sequence[Command]) -> None:
        """Update the key figures of members, if they are gathered, with the command of each, by which stops begin."""
        if self._figures_steps:
            for member, command in zip(rows, commands, strict=True):
                self._figures[member].command(AppliedCommand(float(self.times[member]), command, "python"))

    def _drive_alike(self, rows: Sequence[int], name: str, kind: str, given: FloatArray) -> bool:
        """Drive a carriage in several members at once; False where some member would refuse the command."""
        states, vehicles = self._states, self.layout.vehicle_rows
        if name not in vehicles or any(states.variants[member] is not states.base for member in rows):
            return False
        mode, row = states.block["drives.mode"], vehicles[name]
        most = self._limits[name].of(kind) if name in self._limits else 0.0
        sound = not states.arrays.stopped[rows].any() and np.all(np.isfinite(given) & (np.abs(given) <= most))
        if not sound or most == 0.0 or (kind == "speed" and np.any(mode[rows, row] != SPEED)):
            return False
        if kind == "speed":
            states.block["drives.target"][rows, row] = given
        else:
            force = states.block["drives.force"]
            other = (mode[rows, row] != FORCE) | (force[rows, row] != given)
            states.block["0/newton_ratio"][np.asarray(rows)[other]] = 0.0  # as `Engine.forget_accelerations`
            mode[rows, row], force[rows, row] = FORCE, given
        owner = next(number for number, part in enumerate(states.base.engine.parts) if name in part.rows)
        for member, value in zip(rows, given.tolist(), strict=True):
            of_ropes = states.settings[member].of_ropes
            commands = {**of_ropes[owner], name: Command(kind, {name: value})}
            of_ropes = (*of_ropes[:owner], commands, *of_ropes[owner + 1 :])
            states.settings[member] = states.settings[member]._replace(of_ropes=of_ropes)
        return True

    def _gather(self, period: float) -> None:
        """Begin to gather the key figures of all members, from the present state on."""
        step = self._states.base.step
        steps = round(period / step) if math.isfinite(period) else 0
        if steps < 1 or abs(steps * step - period) > 1e-9:
            raise ValueError(
                f"figures_period: given {period:g} s; allowed: a whole number of solver steps of {step:g} s"
            )
        self._figures_steps = steps
        self._revive(range(len(self)))

    def _revive(self, rows: Sequence[int]) -> None:
        """Clear the failure reasons of restarted members, and restart their counts and key figures."""
        states = self._states
        for member in rows:
            self._faults.pop(member, None)
        states.reset_counts(list(rows))
        if self._figures_steps:
            for member in rows:
                self._figures[member] = KeyFigures(states.variants[member].scenario)
                self._figures[member].update(states.read(member).snapshot)

    @property
    def _alive(self) -> NDArray[np.bool_]:
        """Mask (members,) of the members that have not ended."""
        alive = np.ones(len(self), dtype=np.bool_)
        alive[list(self._faults)] = False
        return alive

    def _rows(self, members: Chosen) -> list[int]:
        """Indices of the members selected by an index, a slice, a sequence of indices, a mask, or None for all.

        Raises:
            ValueError: there is no such member, or one is given twice.
        """
        if members is None:
            return list(range(len(self)))
        if isinstance(members, slice):
            return list(range(len(self)))[members]
        given = list(members) if isinstance(members, Iterable) else [members]
        if len(given) == len(self) and all(isinstance(one, bool | np.bool_) for one in given):
            return [row for row, one in enumerate(given) if one]
        for one in given:
            if isinstance(one, bool) or not isinstance(one, int | np.integer) or not 0 <= one < len(self):
                raise ValueError(f"members: given {one!r}; allowed: 0 to {len(self) - 1}, or a mask of all {len(self)}")
        rows = [int(one) for one in given]
        if len(set(rows)) < len(rows):
            twice = next(row for row in rows if rows.count(row) > 1)
            raise ValueError(f"members: given {twice} twice; allowed: each of 0 to {len(self) - 1} once")
        return rows

    def _row(self, member: int) -> int:
        """Index of one member.

        Raises:
            ValueError: there is no such member, or several are given.
        """
        rows = self._rows(member)
        if len(rows) != 1:
            raise ValueError(f"member: given {member!r}; allowed: one of 0 to {len(self) - 1}")
        return rows[0]

    def _bar(self, things: str, count: int) -> Any:
        """Progress bar over a number of members or values, on a terminal only."""
        if not self._progress:
            return nullcontext(lambda: None)
        from rich.console import Console  # noqa: PLC0415 - for a terminal alone

        from cable_twin.terminal.bars import count_shown  # noqa: PLC0415

        return count_shown(Console(stderr=True), things, count)

    def _share_bar(self, what: str) -> Any:
        """Progress bar over the completed share (0 to 1) of a call, on a terminal only."""
        if not self._progress:
            return nullcontext(lambda share: None)
        from rich.console import Console  # noqa: PLC0415 - for a terminal alone

        from cable_twin.terminal.bars import share_shown  # noqa: PLC0415

        return share_shown(Console(stderr=True), what)


def usable_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
