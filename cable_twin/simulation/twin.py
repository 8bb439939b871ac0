"""Simulation of a scenario: only owner of state and solver time, deterministic, without ROS.

Solver steps are taken in batches; loading, stations and vehicle contacts are handled between them, at fixed simulated
times.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from numbers import Real
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import (
    AppliedCommand,
    Command,
    CommandError,
    SolverReport,
)
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.mechanics.language.declared import LATEST, Kept, clone, write
from cable_twin.mechanics.parameters import IntArray, Solver, System
from cable_twin.mechanics.solution.bundle.records import BundleState
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.mechanics.solution.runge_kutta import stable_step
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario
from cable_twin.simulation.command_handlers import take_effect
from cable_twin.simulation.engine import Engine, Settings
from cable_twin.simulation.first_compilation import compiling_ahead, expect_kernels
from cable_twin.simulation.queries import Observer, Queries, read_only, time_of
from cable_twin.simulation.ropeway import Ropeway
from cable_twin.simulation.same_model import OtherModelError
from cable_twin.simulation.snapshot_file import FullState, SnapshotError, read_full_state
from cable_twin.simulation.start_checks import (
    check_pressure,
    warn_of_crossing,
    warn_of_frames,
    warn_of_mesh,
    warn_of_saddles,
    warn_of_short_contacts,
    warn_of_soft_towers,
    warn_of_swings,
    warn_of_units,
    with_frames_told,
)
from cable_twin.simulation.vehicle_contacts import VehicleContacts

if TYPE_CHECKING:
    from cable_twin import Forecaster, Outlook

PART = 50_000  # steps times nodes that are taken at once
PERIOD = 0.05  # s of simulated time from one look to the next; a person gets into a cabin in several of them
SURE_RADIUS = 0.8  # -, of solver.spectral_radius; with more a light load on a stiff cable fails now and then
SAMPLES = 200  # points at which a snapshot holds the cable
Meanwhile = Callable[[Scenario, Snapshot], object]
NOTHING_DONE = SolverReport(steps=0, iterations=0, halvings=0, constraint_residual=0.0)


class SolverError(RuntimeError):
    """Failure of a solver step; the simulation keeps the last good state."""


def _starts(scenario: Scenario) -> list[tuple[Any, ...]]:
    """Places and joints of all vehicles of a scenario at the start, to compare scenarios."""
    return [(one.arc_length, one.joint, one.rope, one.clamped_to) for one in scenario.vehicles.values()]


class Simulation(Queries):
    """Simulation of one scenario: static start, time integration, commands and snapshots.

    It starts in static equilibrium with every joint held at its arc length, then released. Commands take effect at
    the present time, which is always a whole number of solver steps; the same scenario and the same commands at the
    same times give bit-identical snapshots, whatever the pacing was.

    Args:
        scenario: scenario to simulate.
        samples: points (at least 2) at which snapshots hold the cable.
        on_demand: read a snapshot when it is asked for, and not at each command: for one thread alone.
        meanwhile: gets the scenario and its first snapshot while another process may still compile the integrator.

    Raises:
        EquilibriumError: the cable with its carriages has no static equilibrium, or carriages overlap at the start.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        samples: int = SAMPLES,
        on_demand: bool = False,
        meanwhile: Meanwhile | None = None,
    ) -> None:
        self._set_up(scenario, Engine(scenario), samples, on_demand)
        self._find_start(meanwhile)

    def with_values(self, scenario: Scenario, *, rest: bool = True) -> Simulation:
        """Simulation of other values of the scenario, on the compiled system, mesh and memory of this one.

        The two simulations take turns: the state of this one is overwritten; keep a copy if it is needed.

        Args:
            scenario: scenario with the same ropes, vehicles, supports and drives, meshes and solver.
            rest: find its own static equilibrium; else it begins at the present state of this simulation, and with
                the start of this one.

        Raises:
            OtherModelError: the scenario needs another mesh, other parts or another solver.
            EquilibriumError: the scenario has no static equilibrium.
        """
        other = Simulation.__new__(Simulation)
        present = Kept(self._state), Kept(self._engine.moving)
        other._set_up(scenario, Engine(scenario, self._engine), self._observer.samples, True)
        if rest:
            other._find_start(None)
            return other
        write(present[0], self._state)
        write(present[1], self._engine.moving)
        other._engine.rest_of(self._engine)
        other._at_start = False
        other._show(NOTHING_DONE)
        return other

    def near(self, scenario: Scenario) -> Simulation:
        """Simulation of another scenario at its static equilibrium, searched for from the start of this simulation.

        The equilibrium has the usual tolerance, and the search takes a fraction of the time. Where mesh or parts
        differ, vehicles start elsewhere, no equilibrium is found nearby, or the rope leaves a tower, a new simulation
        is made; else the two take turns, as with `with_values`.

        Args:
            scenario: scenario such as another load of the same line.

        Raises:
            EquilibriumError: the scenario has no static equilibrium.
        """
        self._engine.go_to_start()
        other, present = Simulation.__new__(Simulation), (Kept(*self._engine.states), clone(self._engine.moving))
        with suppress(EquilibriumError, OtherModelError):
            if _starts(scenario) != _starts(self.scenario):
                raise OtherModelError("vehicles start elsewhere")
            engine = Engine(scenario, self._engine, own_mesh=True)
            other._set_up(scenario, engine, self._observer.samples, True)
            other._find_start(None, present)
            if np.abs(other.snapshot.columns.support_force).max(axis=1).all():
                return other
        return Simulation(scenario, samples=self._observer.samples, on_demand=True)

    def _set_up(self, scenario: Scenario, engine: Engine, samples: int, on_demand: bool) -> None:
        """Set up the simulation of a scenario with its engine, before the search for equilibrium."""
        self.scenario = scenario
        self._engine = engine
        self._parts = self._engine.parts
        self._ropeway, self._contacts = (
            self._parts[0],
            [VehicleContacts(part.scenario, part.rows) for part in self._parts],
        )
        self.carriages = {name: tuple(carriage.bodies) for name, carriage in scenario.vehicles.items()}
        self.drives = tuple(scenario.drives)
        self._state = self._ropeway.state
        self._shown = read_only(self._state)
        self._observer, self._on_demand = Observer(scenario, self._engine, samples), on_demand
        self.supports = self._observer.layout.supports
        self._forecaster: Forecaster | None = None

    def _find_start(self, meanwhile: Meanwhile | None, near: tuple[Kept, BundleState] | None = None) -> None:
        """Find the static equilibrium, and start the simulation there."""
        scenario = self.scenario
        expect_kernels(self._engine)
        with compiling_ahead(scenario, self._engine):
            try:
                self._engine.find_rest(near)
            except EquilibriumError as error:
                raise with_frames_told(error, (part.system for part in self._parts)) from None
            # compiles what reads the state, while the other process is still at it
            first = self._observer.snapshot(0.0, NOTHING_DONE)
            warn_of_units(scenario)
            for part, rope in zip(self._parts, first.ropes.values(), strict=True):
                check_pressure(part.system, rope)
                warn_of_frames(part.system, rope, part.state.nodes.position)
                warn_of_mesh(part.scenario, part.system)
                warn_of_saddles(part.scenario, rope)
                warn_of_soft_towers(part.scenario, first.supports)
                warn_of_swings(part.scenario)
                warn_of_short_contacts(part.scenario)
                if scenario.solver.integrator == "generalized_alpha":
                    warn_of_crossing(part.scenario, scenario, part.system, rope)
            if meanwhile is not None:
                meanwhile(scenario, first)
        self._at_start = True
        self._engine.advance(0)  # compile, if still to do
        self._engine.begin()
        if scenario.solver.integrator == "runge_kutta" and self.step > stable_step(self.system):
            warnings.warn(
                f"solver.step of {self.step:g} s is above the largest stable one of runge_kutta on this mesh, "
                f"{stable_step(self.system):.3g} s: the motion will not stay finite",
                stacklevel=2,
            )
        self._show(NOTHING_DONE)

    @classmethod
    def load(
        cls, source: str | Path | IO[bytes], *, samples: int = SAMPLES, meanwhile: Meanwhile | None = None
    ) -> Simulation:
        """Simulation that continues bit for bit from a file or stream written by `save`.

        Raises:
            SnapshotError: one line: no such file, not a snapshot, damaged, or from a version with another state.
        """
        name = str(source) if isinstance(source, str | Path) else "snapshot"
        full = read_full_state(Path(source) if isinstance(source, str) else source, name)
        simulation = cls(full.scenario, samples=samples, meanwhile=meanwhile)
        try:
            simulation.restore(full)
        except SnapshotError as error:
            raise SnapshotError(f"{name}: {error}") from None
        return simulation

    @property
    def engine(self) -> Engine:
        """Engine with ropes, vehicles and couplings, for an ensemble of simulations."""
        return self._engine

    @property
    def observer(self) -> Observer:
        """Reader of snapshots, for an ensemble of simulations."""
        return self._observer

    @property
    def meeting_pairs(self) -> tuple[IntArray, IntArray]:
        """Rows of vehicles that can meet, (pairs,) each: the one nearer to the start of the rope, and the other."""
        before, after = zip(*(watch.pairs for watch in self._contacts), strict=True)
        return np.concatenate(before), np.concatenate(after)

    def take_over(self, settings: Settings, report: SolverReport) -> None:
        """Restore the settings and the solver report of a state that has been written into memory."""
        self._engine.take_over(settings)
        self.show(report)

    def show(self, report: SolverReport) -> None:
        """Update the snapshot for a state written into memory from outside, with its solver report."""
        self._at_start = False
        self._show(report)

    @property
    def system(self) -> System:
        """Parameters of the first rope and its vehicles, with payloads."""
        return self._ropeway.system

    @system.setter
    def system(self, system: System) -> None:
        self._ropeway.system = system

    @property
    def state(self) -> State:
        """State of the solver as a read-only view, which advances with the solver; `capture` gives a writable copy."""
        return self._shown

    @property
    def parts(self) -> Mapping[str, Ropeway]:
        """Parameters and present state of each rope with its vehicles, by rope name; a single cable is "cable"."""
        return dict(zip(self.scenario.cables, self._parts, strict=True))

    @property
    def step(self) -> float:
        """Length (s) of a solver step."""
        return self.system.solver.step

    @property
    def layout(self) -> Layout:
        """Names and indices of the values in the row of a snapshot."""
        return self._observer.layout

    @property
    def emergency_stopped(self) -> bool:
        """Whether an emergency stop is in force."""
        return self._ropeway.stopped

    @property
    def commands(self) -> Mapping[str, Command]:
        """Last drive command in force of each commanded carriage or drive."""
        held = [part.commands for part in self._parts] + [self._engine.commands]
        return {name: command for commands in held for name, command in commands.items()}

    @property
    def at_start(self) -> bool:
        """Whether the simulation is at the start of its scenario: no step, command or restored state since."""
        return self._at_start

    def __reduce__(self) -> tuple[Any, ...]:
        """Independent simulation that goes on bit for bit, for `copy` and `pickle`; it takes as long as a start."""
        return _resumed, (self.capture(), self._observer.samples, self._on_demand)

    def save(self, path: str | Path) -> None:
        """Write the full state to a file, from which `load` continues bit for bit.

        Raises:
            OSError: the disk refuses; no file is left then.
        """
        self.capture().write(Path(path))

    def capture(self) -> FullState:
        """Copy of the full state of the simulation."""
        return FullState(
            self.scenario,
            self.time,
            *self._engine.kept_states(),
            self._ropeway.stopped,
            dict(self.commands),
            dict(self._engine.vehicles.loading),
            self._at_start,
            self._engine.kept(),
        )

    def restore(self, full: FullState) -> None:
        """Restore a full state from `capture` of this simulation or of another one of its scenario.

        Raises:
            SnapshotError: it is no state, or does not fit the scenario; nothing is changed then.
        """
        if not isinstance(full, FullState):
            raise SnapshotError(f"restore: given {full!r}; allowed: a state, as of `capture`")
        if not full.fits(self.scenario):
            full.check(self.scenario, [part.system for part in self._parts], self.capture())
        self._engine.restore(full)
        self._at_start = full.at_start
        self._show(NOTHING_DONE)

    def command(self, name: str, *, speed: float | None = None, force: float | None = None) -> AppliedCommand:
        """Drive one carriage, or a moving cable by the name of its drive, until the next command.

        Args:
            name: of the carriage or the drive.
            speed: m/s along the cable, of either sign.
            force: N along the cable, or at the rim of a bullwheel; a cable without bullwheels takes only speeds.

        Raises:
            CommandError: when it is refused: unknown name, not finite, over the limit, emergency stop in force.
        """
        if (speed is None) == (force is None):
            raise CommandError(
                f"command for '{name}': given {'nothing' if speed is None else 'both'}; "
                "allowed: either speed (m/s) or force (N)"
            )
        if speed is not None:
            return self.apply(Command("speed", {name: speed}))
        assert force is not None
        return self.apply(Command("force", {name: force}))

    def emergency_stop(self, active: bool = True) -> AppliedCommand:
        """Stop all drives at their emergency deceleration, and refuse commands until released."""
        return self.apply(Command("emergency_stop" if active else "release", {}))

    def payload(self, name: str, mass: float) -> AppliedCommand:
        """Load or unload a carriage in a station until it carries `mass` (kg).

        Raises:
            CommandError: when it is refused: no room, more than the capacity, under way, outside the stations.
        """
        return self.apply(Command("payload", {name: mass}))

    def wind(self, x: float, z: float = 0.0, y: float = 0.0) -> AppliedCommand:
        """Set the wind from now on: `x` (m/s) along the track, `z` upwards and in space `y` to the left.

        Raises:
            CommandError: when it is refused: not finite, or stronger than any.
        """
        return self.apply(Command("wind", {"x": x, "z": z} | ({"y": y} if y != 0.0 else {})))

    def gust(self, x: float, z: float = 0.0, y: float = 0.0, *, duration: float = 10.5) -> AppliedCommand:
        """Add a one-minus-cosine gust to the wind: `x`, `z` and `y` (m/s) as in `wind`, for `duration` (s).

        Raises:
            CommandError: when it is refused: not finite, stronger than any, or another one is under way.
        """
        return self.apply(Command("gust", {"x": x, "z": z, "y": y, "duration": duration}))

    def temperature(self, degrees: float) -> AppliedCommand:
        """Set the temperature of all ropes (degC) from the present time on; rope lengths or tensions change at once.

        Raises:
            CommandError: when it is refused: not finite, or one that no rope has.
        """
        return self.apply(Command("temperature", {"ropes": degrees}))

    def outlook(
        self, *, horizon: float = 60.0, announced: Command | None = None, threads: int | None = None
    ) -> Outlook:
        """Simulate futures from the present state: with an emergency stop now, as commanded, and with a gust or wind.

        The first call makes members of an ensemble, which takes as long as a start; the simulation stays as it is.

        Args:
            horizon: length of the futures (s).
            announced: gust, operating gust or wind that is assumed to come now; None for a gust of 10 m/s.
            threads: number of threads; None for one a core.

        Raises:
            CommandError: the announced command is no wind, or beyond what a command may ask for.
            ValueError: the horizon is out of range; one line.
        """
        from cable_twin import Forecaster  # noqa: PLC0415 - of the ensemble, which stands on this

        if self._forecaster is None or self._forecaster.horizon != horizon:
            samples = self._observer.samples
            self._forecaster = Forecaster(self.scenario, horizon=horizon, samples=samples, threads=threads)
        return self._forecaster.outlook(self, announced)

    def reset(self) -> AppliedCommand:
        """Reset the state to the start; time runs on, drives return to their initial settings."""
        return self.apply(Command("reset", {}))

    def apply(self, command: Command, source: str = "python") -> AppliedCommand:
        """Apply a command at the present time: whole or, with an error, not at all.

        Args:
            command: of any kind of `cable_twin.frame.commands`.
            source: who gave it, for the log.

        Raises:
            CommandError: one line with what was given and what is allowed.
        """
        command = take_effect(self._engine, self.scenario, command)
        self._at_start = False
        applied = AppliedCommand(self.time, command, source)
        self._show(NOTHING_DONE)
        return applied

    def advance_to(self, time: float, on_part: Callable[[], object] = lambda: None) -> Snapshot:
        """Run until `time` (s), to the nearest whole step.

        Args:
            time: s.
            on_part: called every some tenths of a second of computing; what it raises ends the run at that step.

        Raises:
            SolverError: a step fails, `snapshot` then is the last good one; or two vehicles are pressed
                through each other.
            ValueError: when `time` is no finite number, or a step or more ago.
        """
        clock, latest = int(self._state.clock[0]), LATEST * self.step
        steps = round(time / self.step) - clock if isinstance(time, Real) and abs(time) < latest else -1
        if steps < 0:
            given = f"{time:.9g} s" if isinstance(time, Real) else repr(time)
            allowed = f"a finite time, from {self.time:.9g} s up to {latest:.3g} s"
            raise ValueError(f"advance_to: given {given}; allowed: {allowed}")
        if steps == 0:
            return self.snapshot
        self._at_start = False
        try:
            outcome = advance_in_batches(self._engine, self._contacts, steps, on_part)
        except BaseException:  # of `on_part`, or Ctrl-C
            self._show(NOTHING_DONE)
            raise
        self._show(report_of(outcome))
        if cause := penetration(self._parts, self._contacts):
            raise SolverError(f"{cause}; the simulation keeps its state at {self.time:g} s")
        if not outcome.converged:
            raise SolverError(step_failure(self.system.solver, clock, outcome))
        return self.snapshot


def _resumed(full: FullState, samples: int, on_demand: bool) -> Simulation:
    """Simulation that continues from a full state."""
    simulation = Simulation(full.scenario, samples=samples, on_demand=on_demand)
    simulation.restore(full)
    return simulation


def advance_in_batches(
    engine: Engine,
    contacts: Sequence[VehicleContacts],
    steps: int,
    on_part: Callable[[], object] = lambda: None,
) -> Outcome:
    """Take `steps` solver steps by calls of the integrator, each of some tenths of a second at most.

    Ctrl-C and `on_part` take effect between the calls.

    Args:
        engine: engine of the simulation.
        contacts: watches of vehicles that can meet, one a rope.
        steps: count of steps.
        on_part: called after each call; an exception from it ends the steps there.

    Returns:
        Outcome of all steps, or of those before a failed step or before two vehicles were pressed through each other.
    """
    parts, vehicles, advance = engine.parts, engine.vehicles, engine.advance
    most = max(PART // sum([len(part.state.nodes.position) for part in parts]), 1)  # steps of a call
    step, clock = parts[0].system.solver.step, parts[0].state.clock
    period, meeting = max(round(PERIOD / step), 1), any(one.possible for one in contacts)
    total = Outcome(True, 0, 0, 0, 0.0, 0.0, 0, 0.0, 0.0)
    while total.converged and total.steps < steps and not (meeting and penetration(parts, contacts)):
        until = steps - total.steps
        if meeting or vehicles.loading or vehicles.awaited:
            until = min(until, period - int(clock[0]) % period)
        total = _joined(total, Outcome(*advance(min(until, most))))
        on_part()
        if total.converged and int(clock[0]) % period == 0:
            vehicles.serve(period * step)
    return total


def step_failure(solver: Solver, clock: int, outcome: Outcome) -> str:
    """Message about a failed solver step, in a line.

    Args:
        solver: solver parameters of the simulation.
        clock: steps done before those of the outcome.
        outcome: outcome of the steps up to the failed one.
    """
    failed = clock + outcome.steps + 1
    return (
        f"step {failed} (to {time_of(failed, solver.step):g} s) failed: after "
        f"{solver.max_halvings} halvings of {solver.step:g} s the last Newton increment was "
        f"{with_unit(outcome.increment, 'm', 3)}, largest on element {outcome.element}, "
        f"an error of {solver.tolerance:g} m may be left; {undamped(solver)}"
        f"the simulation keeps its state at {time_of(failed - 1, solver.step):g} s"
    )


def _joined(before: Outcome, last: Outcome) -> Outcome:
    """Joined outcome of two successive calls of the integrator."""
    return last._replace(
        steps=before.steps + last.steps,
        iterations=before.iterations + last.iterations,
        halvings=before.halvings + last.halvings,
        gap=max(before.gap, last.gap),
        lost=before.lost + last.lost,
        moved=before.moved + last.moved,
    )


def penetration(parts: Sequence[Ropeway], contacts: Sequence[VehicleContacts]) -> str:
    """Message about two vehicles that have passed through each other, empty without such a pair."""
    lines = (watch.found(part.state) for part, watch in zip(parts, contacts, strict=True))
    return next((line for line in lines if line), "")


def penetration_of(simulation: Simulation) -> str:
    """Message about two vehicles of a simulation that have passed through each other, empty without such a pair."""
    return penetration(simulation._parts, simulation._contacts)


def report_of(outcome: Outcome) -> SolverReport:
    """Solver report of a snapshot from the outcome of an integrator call."""
    return SolverReport(
        int(outcome.steps),
        int(outcome.iterations),
        int(outcome.halvings),
        float(outcome.gap),
        float(outcome.lost),
        float(outcome.moved),
    )


def undamped(solver: Solver) -> str:
    """Explanation of a failed step by too little numerical damping of a stiff cable; empty with enough damping."""
    if solver.spectral_radius <= SURE_RADIUS:
        return ""
    return (
        f"solver.spectral_radius is {solver.spectral_radius:g}, which hardly damps the ringing of joints and cable: "
        f"up to {SURE_RADIUS:g} is sure; "
    )
