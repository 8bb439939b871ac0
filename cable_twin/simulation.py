"""The twin without its doors: the only owner of state and solver time. Deterministic, and no ROS needed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import IO

import numpy as np

from cable_twin.mechanics.equilibrium import EquilibriumError, lay_straight, settle
from cable_twin.mechanics.generalized_alpha import advance
from cable_twin.mechanics.modes import natural_modes
from cable_twin.mechanics.parameters import FORCE, FREE, SPEED, FloatArray, System
from cable_twin.mechanics.readout import energies, sample_positions, sample_tensions, support_forces
from cable_twin.mechanics.runge_kutta import advance_explicitly, stable_step
from cable_twin.mechanics.state import allocate_state, allocate_workspace, clone_state, copy_state
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    Command,
    CommandError,
    Energy,
    Snapshot,
    SolverReport,
    SupportState,
)
from cable_twin.scenario import Scenario, build_system
from cable_twin.snapshot_file import FullState, SnapshotError, read_full_state

INTEGRATORS = {"generalized_alpha": advance, "runge_kutta": advance_explicitly}
DRIVE_MODES = {"free": FREE, "force": FORCE, "speed": SPEED}
SAMPLES = 200  # points at which a snapshot holds the cable
NOTHING_DONE = SolverReport(steps=0, iterations=0, halvings=0, constraint_residual=0.0)


class SolverError(RuntimeError):
    """The solver could not take a step; the simulation keeps the last good state."""


class Simulation:
    """One scenario in motion.

    It starts in static equilibrium with every joint held at its arc length, and lets go. Commands take effect at
    the present time, which is always a whole number of solver steps; the same scenario and the same commands at the
    same times give bit-identical snapshots, whatever the pacing was.

    Args:
        scenario: what to simulate.
        samples: points (at least 2) at which snapshots hold the cable.

    Raises:
        EquilibriumError: when the cable finds no rest with its carriages on it.
    """

    def __init__(self, scenario: Scenario, *, samples: int = SAMPLES) -> None:
        self.scenario = scenario
        self.system: System = build_system(scenario)
        self.carriages = {name: tuple(carriage.bodies) for name, carriage in scenario.carriages.items()}
        self._index = {name: index for index, name in enumerate(self.carriages)}
        self._state = allocate_state(self.system)
        self._work = allocate_workspace(self.system)
        for index, carriage in enumerate(scenario.carriages.values()):
            self._state.sliding_coordinate[index] = carriage.arc_length
            if carriage.joint == "sliding":
                self._state.drive_mode[index] = DRIVE_MODES[carriage.drive.mode]
        if scenario.cable.initial_shape == "straight":
            ends = np.array([scenario.cable.start.position, scenario.cable.end.position])
            lay_straight(self.system, self._state, ends[0], ends[1])
        else:
            settle(self.system, self._state, self._work)
        self._initial = clone_state(self._state)
        self._good = clone_state(self._state)
        self._before = clone_state(self._state)
        self._stopped = False
        self._commands: dict[str, Command] = {}
        self._at_start = True
        self._arc_lengths = np.linspace(0.0, self.system.cable.unstrained_length, samples, dtype=np.float64)
        self._arc_lengths.setflags(write=False)
        self._means = np.empty(self.system.cable.element_count)
        self._advance = INTEGRATORS[scenario.solver.integrator]
        self._advance(self.system, self._state, self._good, self._before, self._work, 0)  # compile, if still to do
        if scenario.solver.integrator == "runge_kutta" and self.step > stable_step(self.system):
            warnings.warn(
                f"solver.step of {self.step:g} s is above the largest stable one of runge_kutta on this mesh, "
                f"{stable_step(self.system):.3g} s: the motion will not stay finite",
                stacklevel=2,
            )
        self._snapshot = self._observe(NOTHING_DONE)

    @classmethod
    def load(cls, source: str | Path | IO[bytes], *, samples: int = SAMPLES) -> Simulation:
        """Go on from a file of `save`, or a stream of one, with the same bits as the simulation that was saved.

        Raises:
            SnapshotError: one line: no such file, not a snapshot, damaged, or from a version with another state.
        """
        name = str(source) if isinstance(source, str | Path) else "snapshot"
        full = read_full_state(Path(source) if isinstance(source, str) else source, name)
        simulation = cls(full.scenario, samples=samples)
        try:
            simulation.restore(full)
        except SnapshotError as error:
            raise SnapshotError(f"{name}: {error}") from None
        return simulation

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return self._time_at(int(self._state.clock[0]))

    @property
    def step(self) -> float:
        """Solver step (s)."""
        return self.system.solver.step

    @property
    def snapshot(self) -> Snapshot:
        """The present state."""
        return self._snapshot

    @property
    def emergency_stopped(self) -> bool:
        """Whether an emergency stop is in force."""
        return self._stopped

    @property
    def commands(self) -> Mapping[str, Command]:
        """The last drive command of each carriage that has one in force."""
        return self._commands

    @property
    def at_start(self) -> bool:
        """Whether this is the start of the scenario: no step, no command and no snapshot since."""
        return self._at_start

    def save(self, path: str | Path) -> None:
        """Write the full state to a file, from which `load` goes on with the same bits.

        Raises:
            OSError: the disk refuses; there is no file then.
        """
        self.capture().write(Path(path))

    def capture(self) -> FullState:
        """A copy of everything that changes while the simulation runs."""
        return FullState(
            self.scenario,
            self.time,
            clone_state(self._state),
            clone_state(self._initial),
            self._stopped,
            dict(self._commands),
        )

    def restore(self, full: FullState) -> None:
        """Go to what `capture` gave, of this simulation or another one of the same scenario.

        Raises:
            SnapshotError: it does not fit the scenario; nothing is changed then.
        """
        full.copy_to(self._state, self._initial, tuple(self.carriages))
        self._stopped, self._commands = full.emergency_stopped, dict(full.commands)
        self._at_start = False
        self._snapshot = self._observe(NOTHING_DONE)

    def command(self, name: str, *, speed: float | None = None, force: float | None = None) -> AppliedCommand:
        """Drive one carriage at a speed (m/s) or with a force (N) along the cable, until the next command.

        Raises:
            CommandError: when it is refused: unknown carriage, not finite, over the limit, emergency stop in force.
        """
        if (speed is None) == (force is None):
            raise CommandError(f"command for '{name}': give either speed (m/s) or force (N), one of them")
        if speed is not None:
            return self.apply(Command("speed", {name: speed}))
        assert force is not None
        return self.apply(Command("force", {name: force}))

    def emergency_stop(self, active: bool = True) -> AppliedCommand:
        """Bring every driven carriage to rest at its emergency deceleration, and refuse commands until released."""
        return self.apply(Command("emergency_stop" if active else "release", {}))

    def reset(self) -> AppliedCommand:
        """Put the state back to the start; time runs on, drives are as the scenario has them."""
        return self.apply(Command("reset", {}))

    def apply(self, command: Command, source: str = "python") -> AppliedCommand:
        """Carry out a command at the present time: whole or, with an error, not at all.

        Raises:
            CommandError: one line with what was given and what is allowed.
        """
        if command.kind in ("speed", "force"):
            self._check(command)
            for name, value in command.values.items():
                self._drive(self._index[name], command.kind, value)
                self._commands[name] = Command(command.kind, {name: value})
        elif command.kind == "emergency_stop":
            self._stopped = True
            self._commands.clear()
            for index in range(len(self.carriages)):
                if self._state.drive_mode[index] in (SPEED, FORCE):
                    self._drive(index, "speed", 0.0)
                    self._state.drive_braking[index] = True
        elif command.kind == "release":
            self._stopped = False
            self._state.drive_braking[:] = False
        else:
            self._stopped = False
            self._commands.clear()
            clock = int(self._state.clock[0])
            copy_state(self._initial, self._state)
            self._state.clock[0] = clock
        self._at_start = False
        applied = AppliedCommand(self.time, command, source)
        self._snapshot = self._observe(NOTHING_DONE)
        return applied

    def advance_to(self, time: float) -> Snapshot:
        """Run until `time` (s), to the nearest whole step; never back.

        Raises:
            SolverError: when a step fails; `snapshot` then is the last good one.
            ValueError: when `time` is not finite.
        """
        if not math.isfinite(time):
            raise ValueError(f"advance_to: {time} s given, a finite time is needed")
        clock = int(self._state.clock[0])
        steps = max(round(time / self.step) - clock, 0)
        if steps == 0:
            return self._snapshot
        self._at_start = False
        outcome = self._advance(self.system, self._state, self._good, self._before, self._work, steps)
        self._snapshot = self._observe(
            SolverReport(
                steps=int(outcome.steps),
                iterations=int(outcome.iterations),
                halvings=int(outcome.halvings),
                constraint_residual=float(outcome.gap),
            )
        )
        if not outcome.converged:
            raise SolverError(
                f"step {clock + outcome.steps + 1} (to {self._time_at(clock + outcome.steps + 1):g} s) failed: after "
                f"{self.system.solver.max_halvings} halvings of {self.step:g} s the last Newton increment was "
                f"{outcome.increment:.3g} m, largest on element {outcome.element}, "
                f"allowed are {self.system.solver.tolerance:g} m; "
                f"the state is that at {self.time:g} s"
            )
        return self._snapshot

    def cable_positions(self, arc_lengths: FloatArray) -> FloatArray:
        """Points (n, dim) in m of the cable at unstrained arc lengths (n,) in m."""
        arc_lengths = np.ascontiguousarray(arc_lengths, dtype=np.float64)
        positions = np.empty((arc_lengths.size, len(self.system.cable.gravity)))
        sample_positions(self.system.cable, self._state, arc_lengths, positions)
        return positions

    def cable_tension(self, arc_lengths: FloatArray) -> FloatArray:
        """Tension (n,) in N at unstrained arc lengths (n,) in m: linear between the means of the elements."""
        arc_lengths = np.ascontiguousarray(arc_lengths, dtype=np.float64)
        tensions = np.empty(arc_lengths.size)
        sample_tensions(self.system.cable, self._state, arc_lengths, tensions, self._means)
        return tensions

    def energy(self) -> Energy:
        """Mechanical energy now (J)."""
        return Energy(*energies(self.system, self._state))

    def natural_frequencies(self, count: int) -> FloatArray:
        """Lowest natural frequencies (count,) in Hz about the present shape, every joint held.

        Raises:
            ValueError: when there are fewer.
        """
        return natural_modes(self.system, self._state, count)[0]

    def mode_shapes(self, count: int, arc_lengths: FloatArray) -> FloatArray:
        """Shapes (count, n, dim) of the lowest natural modes at unstrained arc lengths (n,) in m, largest entry 1.

        Raises:
            ValueError: when there are fewer.
        """
        _, shapes = natural_modes(self.system, self._state, count)
        arc_lengths = np.ascontiguousarray(arc_lengths, dtype=np.float64)
        result = np.empty((count, arc_lengths.size, len(self.system.cable.gravity)))
        for shape, positions in zip(shapes, result, strict=True):
            mode = self._state._replace(nodal_coordinates=np.ascontiguousarray(shape))
            sample_positions(self.system.cable, mode, arc_lengths, positions)
        return result / np.abs(result).max(axis=(1, 2), keepdims=True)

    def _time_at(self, clock: int) -> float:
        """Time (s) after `clock` steps, as a whole number of nanoseconds so that a log gives it back exactly."""
        return round(clock * self.step * 1e9) / 1e9

    def _check(self, command: Command) -> None:
        """Refuse a speed or force command that cannot be carried out whole."""
        if self._stopped:
            raise CommandError("the emergency stop is in force: release it before the next command")
        if not command.values:
            raise CommandError("a command without a carriage")
        unit = "m/s" if command.kind == "speed" else "N"
        for name, value in command.values.items():
            if name not in self._index:
                known = ", ".join(self.carriages) or "none in this scenario"
                raise CommandError(f"unknown carriage '{name}'; known: {known}")
            if self.system.carriages.fixed[self._index[name]]:
                raise CommandError(f"'{name}' is fixed to the cable and takes no command")
            if not math.isfinite(value):
                raise CommandError(f"{command.kind} of '{name}' is {value} {unit}; a finite number is needed")
            limits = self.scenario.carriages[name].drive.limits
            limit = limits.speed if command.kind == "speed" else limits.force
            if limit is not None and abs(value) > limit:
                raise CommandError(
                    f"{command.kind} of '{name}' is {value:g} {unit}; allowed are -{limit:g} to {limit:g} {unit}"
                )

    def _drive(self, index: int, kind: str, value: float) -> None:
        """Set mode and target of one drive; a driven joint takes over from the present motion."""
        state = self._state
        if kind == "force":
            state.drive_mode[index] = FORCE
            state.drive_force[index] = value
            return
        if state.drive_mode[index] != SPEED:
            state.drive_mode[index] = SPEED
            state.reference[index] = state.sliding_coordinate[index], state.sliding_velocity[index], 0.0
        state.drive_target[index] = value

    def _observe(self, report: SolverReport) -> Snapshot:
        """Read everything that a snapshot holds."""
        forces = np.empty((2, len(self.system.cable.gravity)))
        support_forces(self.system, self._state, self._work, forces)
        return Snapshot(
            time=self.time,
            carriages={name: self._carriage(index, bodies) for (name, bodies), index in self._ordered()},
            supports={"start": SupportState(forces[0]), "end": SupportState(forces[1])},
            cable=CableSamples(
                arc_lengths=self._arc_lengths,
                positions=self.cable_positions(self._arc_lengths),
                tensions=self.cable_tension(self._arc_lengths),
            ),
            solver=report,
        )

    def _ordered(self) -> list[tuple[tuple[str, tuple[str, ...]], int]]:
        return [(item, index) for index, item in enumerate(self.carriages.items())]

    def _carriage(self, index: int, bodies: tuple[str, ...]) -> CarriageState:
        state = self._state
        first = int(self.system.carriages.body_offset[index])
        coordinates = state.body_coordinates[first : first + len(bodies)].tolist()
        velocities = state.body_velocities[first : first + len(bodies)].tolist()
        states: Mapping[str, BodyState] = {
            name: BodyState(*q, *q_dot) for name, q, q_dot in zip(bodies, coordinates, velocities, strict=True)
        }
        return CarriageState(
            arc_length=float(state.sliding_coordinate[index]),
            speed=float(state.sliding_velocity[index]),
            drive_force=float(state.drive_force[index]),
            contact_force=state.multipliers[first].copy(),
            position=self.cable_positions(state.sliding_coordinate[index : index + 1])[0],
            bodies=states,
        )


__all__ = ["SAMPLES", "EquilibriumError", "Simulation", "SnapshotError", "SolverError"]
