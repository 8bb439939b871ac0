"""Twin without interfaces: only owner of state and solver time, deterministic, without ROS."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import (
    AppliedCommand,
    Command,
    CommandError,
    SolverReport,
)
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.mechanics.language.declared import Kept
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.equilibrium import EquilibriumError
from cable_twin.mechanics.solution.runge_kutta import stable_step
from cable_twin.mechanics.state import State
from cable_twin.scenario import Scenario
from cable_twin.simulation.advance import in_parts, meeting_found, report_of, undamped
from cable_twin.simulation.compilation_watch import expect_kernels
from cable_twin.simulation.effects import take_effect
from cable_twin.simulation.element_crossing import warn_of_crossing
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.first_compilation import compiling_ahead
from cable_twin.simulation.meeting import Meeting
from cable_twin.simulation.observer import Observer, read_only
from cable_twin.simulation.pressure import check_pressure
from cable_twin.simulation.readings import Readings
from cable_twin.simulation.ropeway import Ropeway
from cable_twin.simulation.slack_frame import warn_of_frames
from cable_twin.simulation.snapshot_file import FullState, SnapshotError, read_full_state

SAMPLES = 200  # points at which a snapshot holds the cable
Meanwhile = Callable[[Scenario, Snapshot], object]
NOTHING_DONE = SolverReport(steps=0, iterations=0, halvings=0, constraint_residual=0.0)


class SolverError(RuntimeError):
    """Failure of a solver step; the simulation keeps the last good state."""


class Simulation(Readings):
    """Simulation of one scenario.

    It starts in static equilibrium with every joint held at its arc length, and lets go. Commands take effect at
    the present time, which is always a whole number of solver steps; the same scenario and the same commands at the
    same times give bit-identical snapshots, whatever the pacing was.

    Args:
        scenario: what to simulate.
        samples: points (at least 2) at which snapshots hold the cable.
        on_demand: read a snapshot when it is asked for, and not at each command: for one thread alone.
        meanwhile: gets the scenario and its first snapshot while another process may still compile the integrator.

    Raises:
        EquilibriumError: the cable finds no rest with its carriages on it, or they start within each other.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        samples: int = SAMPLES,
        on_demand: bool = False,
        meanwhile: Meanwhile | None = None,
    ) -> None:
        self.scenario = scenario
        self._engine = Engine(scenario)
        self._parts = self._engine.parts
        self._ropeway, self._meetings = self._parts[0], [Meeting(part.scenario) for part in self._parts]
        self.carriages = {name: tuple(carriage.bodies) for name, carriage in scenario.vehicles.items()}
        self.drives = tuple(scenario.drives)
        self._state = self._ropeway.state
        self._shown = read_only(self._state)
        self._observer, self._on_demand = Observer(scenario, self._engine, samples), on_demand
        self.supports = self._observer.layout.supports
        expect_kernels(self._engine)
        with compiling_ahead(scenario, self._engine):
            self._engine.find_rest()
            # compiles what reads the state, while the other process is still at it
            first = self._observer.snapshot(0.0, NOTHING_DONE)
            for part, rope in zip(self._parts, first.ropes.values(), strict=True):
                check_pressure(part.system, rope)
                warn_of_frames(part.system, rope)
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
        """Continue bit for bit from a file or stream of `save`.

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
        """Parameters and present state of each rope with its vehicles, by name; of one cable as "cable"."""
        return dict(zip(self.scenario.cables, self._parts, strict=True))

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return self._time_at(int(self._state.clock[0]))

    @property
    def step(self) -> float:
        """Solver step (s)."""
        return self.system.solver.step

    @property
    def layout(self) -> Layout:
        """Names and places of the numbers of a snapshot."""
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
        """Whether the simulation is at the start of its scenario: no step, command or snapshot since."""
        return self._at_start

    def save(self, path: str | Path) -> None:
        """Write the full state to a file, from which `load` continues bit for bit.

        Raises:
            OSError: the disk refuses; there is no file then.
        """
        self.capture().write(Path(path))

    def capture(self) -> FullState:
        """Copy of the full state of the simulation."""
        return FullState(
            self.scenario,
            self.time,
            tuple(Kept(part.state) for part in self._parts),
            tuple(Kept(part.start) for part in self._parts),
            self._ropeway.stopped,
            dict(self.commands),
            {name: mass for part in self._parts for name, mass in part.loading.items()},
            self._at_start,
            self._engine.kept(),
        )

    def restore(self, full: FullState) -> None:
        """Restore a full state from `capture` of this simulation or of another one of its scenario.

        Raises:
            SnapshotError: it does not fit the scenario; nothing is changed then.
        """
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
            raise CommandError(f"command for '{name}': give either speed (m/s) or force (N), one of them")
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
        take_effect(self._engine, self.scenario, command)
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
            ValueError: when `time` is not finite, or a step or more ago.
        """
        clock = int(self._state.clock[0])
        steps = round(time / self.step) - clock if math.isfinite(time) else -1
        if steps < 0:
            raise ValueError(f"advance_to: {time:.9g} s given; allowed: a finite time, from {self.time:.9g} s on")
        if steps == 0:
            return self.snapshot
        self._at_start = False
        try:
            outcome = in_parts(self._parts, self._meetings, steps, self._engine.advance, on_part)
        except BaseException:  # of `on_part`, or Ctrl-C
            self._show(NOTHING_DONE)
            raise
        self._show(report_of(outcome))
        if met := meeting_found(self._parts, self._meetings):
            raise SolverError(f"{met}; the state is that at {self.time:g} s")
        if not outcome.converged:
            raise SolverError(
                f"step {clock + outcome.steps + 1} (to {self._time_at(clock + outcome.steps + 1):g} s) failed: after "
                f"{self.system.solver.max_halvings} halvings of {self.step:g} s the last Newton increment was "
                f"{with_unit(outcome.increment, 'm', 3)}, largest on element {outcome.element}, "
                f"an error of {self.system.solver.tolerance:g} m may be left; {undamped(self.system.solver)}"
                f"the state is that at {self.time:g} s"
            )
        return self.snapshot


__all__ = ["SAMPLES", "EquilibriumError", "Simulation", "SnapshotError", "SolverError"]
