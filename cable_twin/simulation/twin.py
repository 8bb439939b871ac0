"""The twin without its doors: the only owner of state and solver time. Deterministic, and no ROS needed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import IO

import numpy as np

from cable_twin.geometry.clearance import clearance_seen, ground_of
from cable_twin.mechanics.drives.command import set_drive_mode
from cable_twin.mechanics.drives.moving_rope import park
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.on_rope.payload import load_bodies, shift_centres
from cable_twin.mechanics.parameters import FORCE, FREE, SPEED, FloatArray, Payloads, System
from cable_twin.mechanics.readout.columns import energies, groups, sample_positions, sample_tensions
from cable_twin.mechanics.readout.ground import Ground, look_at_ground
from cable_twin.mechanics.solution.catenary import check_rest
from cable_twin.mechanics.solution.equilibrium import EquilibriumError, lay_straight, settle
from cable_twin.mechanics.solution.integrators import integrator_named
from cable_twin.mechanics.solution.runge_kutta import stable_step
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.mechanics.state import allocate_state, allocate_workspace, clone_state, write_state
from cable_twin.records import (
    AppliedCommand,
    Clearance,
    Command,
    CommandError,
    Energy,
    SolverReport,
)
from cable_twin.scenario import Scenario, build_payloads, build_system
from cable_twin.simulation.command_checks import check_drive, check_payload, check_wind
from cable_twin.simulation.driving import brake, drive, drive_mode, hang_in_ropes
from cable_twin.simulation.first_compilation import compiling_ahead
from cable_twin.simulation.observer import Observer
from cable_twin.simulation.snapshot_file import FullState, SnapshotError, read_full_state
from cable_twin.snapshot import CABLE, Layout, Snapshot

DRIVE_MODES = {"free": FREE, "force": FORCE, "speed": SPEED}
ROPE_POINTS = 10  # of an element, at which its clearance is taken
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
        self._empty: System = build_system(scenario)
        self._payloads: Payloads = build_payloads(scenario)
        self.carriages = {name: tuple(carriage.bodies) for name, carriage in scenario.vehicles.items()}
        self.drives = tuple(scenario.drives)
        self.supports = ("start", "end", *scenario.towers)
        self._index = {name: index for index, name in enumerate(self.carriages)}
        self._state = allocate_state(self._empty)
        self._work = allocate_workspace(self._empty)
        self._state.wind[:] = scenario.air.wind
        loads = [carriage.payload.mass if carriage.payload else 0.0 for carriage in scenario.vehicles.values()]
        self._load(np.array(loads, dtype=np.float64))
        for index, carriage in enumerate(scenario.vehicles.values()):
            self._state.joints.position[index] = carriage.arc_length
            if carriage.joint == "clamped" and carriage.arc_length > scenario.cable.unstrained_length:
                park(self.system, self._state, index, carriage.arc_length)
            if carriage.joint == "sliding":
                as_python(set_drive_mode)(self._state, index, DRIVE_MODES[carriage.drive.mode])
        self._observer = Observer(scenario, self._empty, samples)
        self._means = np.empty(groups(self._empty.cable))
        with compiling_ahead(scenario.solver.integrator):
            if scenario.cable.initial_shape == "straight":
                ends = np.array([scenario.cable.start.position, scenario.cable.end.position])
                lay_straight(self.system, self._state, ends[0], ends[1])
            else:
                check_rest(self.system, tuple(scenario.towers))
                settle(self.system, self._state, self._work)
            self._state.payload[:] = loads
            hang_in_ropes(self.system, self._state, [*self._index])
            # compiles what reads the state, while the other process is still at it
            self._observer.snapshot(0.0, self.system, self._state, self._state.tower_load, NOTHING_DONE)
        self._packed_state = pack(self._state)
        self._scratch = pack(clone_state(self._state)), pack(clone_state(self._state)), pack(self._work)
        self._stopped = False
        self._commands: dict[str, Command] = {}
        self._at_start = True
        self._advance = integrator_named(scenario.solver.integrator)
        self._advance(self._packed_system, self._packed_state, *self._scratch, 0)  # compile, if still to do
        self._initial = clone_state(self._state)
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
    def system(self) -> System:
        """Parameters, with payloads."""
        return self._system

    @system.setter
    def system(self, system: System) -> None:
        self._system, self._packed_system = system, pack(system)

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
    def layout(self) -> Layout:
        """Which number of a snapshot is what."""
        return self._observer.layout

    @property
    def emergency_stopped(self) -> bool:
        """Whether an emergency stop is in force."""
        return self._stopped

    @property
    def commands(self) -> Mapping[str, Command]:
        """The last drive command in force of each carriage or drive that has one."""
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
            self._at_start,
        )

    def restore(self, full: FullState) -> None:
        """Go to what `capture` gave, of this simulation or another one of the same scenario.

        Raises:
            SnapshotError: it does not fit the scenario; nothing is changed then.
        """
        full.copy_to(self._state, self._initial, self.scenario)
        self._load(self._state.payload)
        self._stopped, self._commands = full.emergency_stopped, dict(full.commands)
        self._at_start = full.at_start
        self._snapshot = self._observe(NOTHING_DONE)

    def command(self, name: str, *, speed: float | None = None, force: float | None = None) -> AppliedCommand:
        """Drive one carriage, or a moving cable by the name of its drive, until the next command.

        Args:
            name: of the carriage or the drive.
            speed: m/s along the cable, of either sign.
            force: N along the cable; a moving cable takes only speeds.

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
        """Bring all that is driven to rest at its emergency deceleration, and refuse commands until released."""
        return self.apply(Command("emergency_stop" if active else "release", {}))

    def payload(self, name: str, mass: float) -> AppliedCommand:
        """Let a carriage that stands in a station carry `mass` (kg) from now on.

        Raises:
            CommandError: when it is refused: no room, more than the capacity, under way, outside the stations.
        """
        return self.apply(Command("payload", {name: mass}))

    def wind(self, x: float, z: float = 0.0) -> AppliedCommand:
        """Let the wind blow with `x` (m/s) along the track and `z` upwards from now on.

        Raises:
            CommandError: when it is refused: not finite, or stronger than any.
        """
        return self.apply(Command("wind", {"x": x, "z": z}))

    def reset(self) -> AppliedCommand:
        """Put the state back to the start; time runs on, drives are as the scenario has them."""
        return self.apply(Command("reset", {}))

    def apply(self, command: Command, source: str = "python") -> AppliedCommand:
        """Carry out a command at the present time: whole or, with an error, not at all.

        Raises:
            CommandError: one line with what was given and what is allowed.
        """
        if command.kind in ("speed", "force"):
            if self._stopped:
                raise CommandError("the emergency stop is in force: release it before the next command")
            check_drive(command, self.scenario)
            for name, value in command.values.items():
                if name in self.drives:
                    self._state.rope_target[0] = value
                else:
                    drive(self._state, self._index[name], command.kind, value)
                self._commands[name] = Command(command.kind, {name: value})
        elif command.kind == "emergency_stop":
            if not self._stopped:
                self._state.braking_time[:] = 0.0
            self._stopped = True
            self._commands.clear()
            self._state.rope_target[0] = 0.0
            self._state.rope_braking[0] = True
            for index in range(len(self.carriages)):
                brake(self.system, self._state, index)
        elif command.kind == "release":
            self._stopped = False
            for index in np.flatnonzero(self._state.drive_braking).tolist():
                if (
                    drive_mode(self._state, index) == FORCE
                ):  # let go for its track-rope brake alone: the drive holds again
                    drive(self._state, index, "speed", 0.0)
            self._state.drive_braking[:] = False
            self._state.rope_braking[:] = False
        elif command.kind == "payload":
            check_payload(command, self.scenario, self.system, self._state)
            self._change_payload(command)
        elif command.kind == "wind":
            check_wind([*command.values.items()])
            self._state.wind[0], self._state.wind[-1] = command.values["x"], command.values["z"]
        else:
            self._stopped = False
            self._commands.clear()
            clock = int(self._state.clock[0])
            write_state(self._initial, self._state)  # not the kernel, which this would be the first to call from Python
            self._state.clock[0] = clock
            self._load(self._state.payload)
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
        outcome = Outcome(*self._advance(self._packed_system, self._packed_state, *self._scratch, steps))
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
                f"an error of {self.system.solver.tolerance:g} m may be left; "
                f"the state is that at {self.time:g} s"
            )
        return self._snapshot

    def cable_positions(self, arc_lengths: FloatArray, rope: str | None = None) -> FloatArray:
        """Points (n, 3) in m of a rope at unstrained arc lengths (n,) in m; without `rope`, of the first one.

        Raises:
            ValueError: when there is no rope of that name.
        """
        _check_rope(rope)
        arc_lengths = np.ascontiguousarray(arc_lengths, dtype=np.float64)
        positions = np.empty((arc_lengths.size, 3))
        sample_positions(self.system.cable, self._state, arc_lengths, positions)
        return positions

    def cable_tension(self, arc_lengths: FloatArray, rope: str | None = None) -> FloatArray:
        """Tension (n,) in N of a rope at unstrained arc lengths (n,) in m: linear between the means of the elements.

        Raises:
            ValueError: when there is no rope of that name.
        """
        _check_rope(rope)
        arc_lengths = np.ascontiguousarray(arc_lengths, dtype=np.float64)
        tensions = np.empty(arc_lengths.size)
        sample_tensions(self.system.cable, self._state, arc_lengths, tensions, self._means)
        return tensions

    def clearance(self) -> Clearance:
        """Least heights of rope and vehicles above the ground, with their places.

        Raises:
            ValueError: when the scenario has no terrain.
        """
        if not self.scenario.terrain:
            raise ValueError("clearance: the scenario has no terrain")
        cable = self.system.cable
        points = np.linspace(0.0, cable.unstrained_length, ROPE_POINTS * cable.element_count + 1, dtype=np.float64)
        seen = self._snapshot.columns
        rope = self.cable_positions(points)
        look_at_ground(self._ground, rope, seen.attached, seen.body_position, seen.body_angles)
        return clearance_seen(self._ground, self.carriages, seen.attached)

    @cached_property
    def _ground(self) -> Ground:
        """The ground, made when somebody asks for the clearance."""
        return ground_of(self.scenario)

    def energy(self) -> Energy:
        """Mechanical energy now (J)."""
        return Energy(*energies(self.system, self._state))

    def natural_frequencies(self, count: int) -> FloatArray:
        """Lowest natural frequencies (count,) in Hz about the present shape, every joint held.

        Raises:
            ValueError: when there are fewer.
        """
        return self._modes(count)[0]

    def mode_shapes(self, count: int, arc_lengths: FloatArray) -> FloatArray:
        """Shapes (count, n, 3) of the lowest natural modes at unstrained arc lengths (n,) in m, largest entry 1.

        Raises:
            ValueError: when there are fewer.
        """
        _, shapes = self._modes(count)
        arc_lengths = np.ascontiguousarray(arc_lengths, dtype=np.float64)
        result = np.empty((count, arc_lengths.size, 3))
        for shape, positions in zip(shapes, result, strict=True):
            mode = self._state._replace(nodes=self._state.nodes._replace(position=np.ascontiguousarray(shape)))
            sample_positions(self.system.cable, mode, arc_lengths, positions)
        return result / np.abs(result).max(axis=(1, 2), keepdims=True)

    def _modes(self, count: int) -> tuple[FloatArray, FloatArray]:
        from cable_twin.mechanics.solution.modes import natural_modes  # noqa: PLC0415 - sparse solvers, which no start needs

        return natural_modes(self.system, self._state, count)

    def _time_at(self, clock: int) -> float:
        """Time (s) after `clock` steps, as a whole number of nanoseconds so that a log gives it back exactly."""
        return round(clock * self.step * 1e9) / 1e9

    def _load(self, masses: FloatArray) -> None:
        """Put payloads (carriages,) in kg into the system."""
        self.system = self._empty._replace(carriages=load_bodies(self._empty.carriages, self._payloads, masses))

    def _change_payload(self, command: Command) -> None:
        before = self.system.carriages.centre_offset
        for name, mass in command.values.items():
            self._state.payload[self._index[name]] = mass
        self._load(self._state.payload)
        shift_centres(self._state, self.system.carriages.centre_offset - before)

    def _observe(self, report: SolverReport) -> Snapshot:
        """What there is to see now."""
        return self._observer.snapshot(
            self.time, self._packed_system, self._packed_state, self._initial.tower_load, report
        )


def _check_rope(rope: str | None) -> None:
    """Refuse a rope that there is not."""
    if rope not in (None, CABLE):
        raise ValueError(f"rope {rope!r} is unknown; known: {CABLE}")


__all__ = ["SAMPLES", "EquilibriumError", "Simulation", "SnapshotError", "SolverError"]
