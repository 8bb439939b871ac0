"""The twin without its doors: the only owner of state and solver time. Deterministic, and no ROS needed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping

import numpy as np

from cable_twin.clearance import find_clearance
from cable_twin.command_checks import check_drive, check_payload, check_wind
from cable_twin.first_compilation import INTEGRATORS, compiling_ahead
from cable_twin.mechanics.carriage import pivot
from cable_twin.mechanics.catenary import check_rest
from cable_twin.mechanics.compilation import as_python
from cable_twin.mechanics.equilibrium import EquilibriumError, lay_straight, settle
from cable_twin.mechanics.generalized_alpha import set_drive_mode, take_over
from cable_twin.mechanics.haul_rope import hang_in_rope
from cable_twin.mechanics.modes import natural_modes
from cable_twin.mechanics.moving_cable import park
from cable_twin.mechanics.parameters import FORCE, FREE, HAULED, SPEED, TRACK_ROPE, FloatArray, Payloads, System
from cable_twin.mechanics.payload import centre_offsets, load_bodies, shift_centres
from cable_twin.mechanics.readout import (
    Observation,
    allocate_observation,
    energies,
    observe,
    sample_positions,
    sample_tensions,
)
from cable_twin.mechanics.runge_kutta import stable_step
from cable_twin.mechanics.state import allocate_state, allocate_workspace, clone_state
from cable_twin.outlines import body_outlines
from cable_twin.records import (
    AppliedCommand,
    BodyState,
    CableSamples,
    CarriageState,
    Clearance,
    Command,
    CommandError,
    DriveState,
    Energy,
    HaulRopeState,
    Snapshot,
    SolverReport,
    SupportState,
    TowerState,
)
from cable_twin.scenario import Scenario, build_payloads, build_system

DRIVE_MODES = {"free": FREE, "force": FORCE, "speed": SPEED}
ROPE_POINTS = 10  # of an element, at which its clearance is taken
SAMPLES = 200  # points at which a snapshot holds the cable
START = SolverReport(steps=0, iterations=0, halvings=0, constraint_residual=0.0)  # nothing done yet


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
        self._index = {name: index for index, name in enumerate(self.carriages)}
        self._state = allocate_state(self._empty)
        self._work = allocate_workspace(self._empty)
        self._state.wind[:] = scenario.air.wind
        loads = [carriage.payload.mass if carriage.payload else 0.0 for carriage in scenario.vehicles.values()]
        self.system = self._load(np.array(loads, dtype=np.float64))
        for index, carriage in enumerate(scenario.vehicles.values()):
            self._state.sliding_coordinate[index] = carriage.arc_length
            if carriage.joint == "clamped" and carriage.arc_length > scenario.cable.unstrained_length:
                park(self.system, self._state, index, carriage.arc_length)
            if carriage.joint == "sliding":
                as_python(set_drive_mode)(self._state, index, DRIVE_MODES[carriage.drive.mode])
        self._arc_lengths = np.linspace(0.0, self.system.cable.unstrained_length, samples, dtype=np.float64)
        self._arc_lengths.setflags(write=False)
        self._means = np.empty(self.system.cable.element_count)
        with compiling_ahead(scenario.solver.integrator):
            if scenario.cable.initial_shape == "straight":
                ends = np.array([scenario.cable.start.position, scenario.cable.end.position])
                lay_straight(self.system, self._state, ends[0], ends[1])
            else:
                check_rest(self.system, tuple(scenario.towers))
                settle(self.system, self._state, self._work)
            self._state.payload[:] = loads
            self._hang_in_ropes()
            self._initial = clone_state(self._state)
            self._observe(START)  # compiles what reads the state, while the other process is still at it
        self._good = clone_state(self._state)
        self._before = clone_state(self._state)
        self._stopped = False
        self._advance = INTEGRATORS[scenario.solver.integrator]
        self._advance(self.system, self._state, self._good, self._before, self._work, 0)  # compile, if still to do
        self._initial = clone_state(self._state)
        if scenario.solver.integrator == "runge_kutta" and self.step > stable_step(self.system):
            warnings.warn(
                f"solver.step of {self.step:g} s is above the largest stable one of runge_kutta on this mesh, "
                f"{stable_step(self.system):.3g} s: the motion will not stay finite",
                stacklevel=2,
            )
        self._snapshot = self._observe(START)

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
                    self._drive(self._index[name], command.kind, value)
        elif command.kind == "emergency_stop":
            if not self._stopped:
                self._state.braking_time[:] = 0.0
            self._stopped = True
            self._state.rope_target[0] = 0.0
            self._state.rope_braking[0] = True
            for index in range(len(self.carriages)):
                self._brake(index)
        elif command.kind == "release":
            self._stopped = False
            for index in np.flatnonzero(self._state.drive_braking).tolist():
                if self._drive_mode(index) == FORCE:  # let go for its track-rope brake alone: the drive holds again
                    self._drive(index, "speed", 0.0)
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
            clock = int(self._state.clock[0])
            for array, start in zip(self._state, self._initial, strict=True):
                array[...] = start  # not the kernel, which this would be the first to call from Python
            self._state.clock[0] = clock
            self.system = self._load(self._state.payload)
        applied = AppliedCommand(self.time, command, source)
        self._snapshot = self._observe(START)
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
                f"an error of {self.system.solver.tolerance:g} m may be left; "
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

    def clearance(self) -> Clearance:
        """Least heights of rope and vehicles above the ground, with their places.

        Raises:
            ValueError: when the scenario has no terrain.
        """
        if not self.scenario.terrain:
            raise ValueError("clearance: the scenario has no terrain")
        cable = self.system.cable
        points = np.linspace(0.0, cable.unstrained_length, ROPE_POINTS * cable.element_count + 1, dtype=np.float64)
        rope = self.cable_positions(points)[:, [0, -1]]
        terrain = np.array(self.scenario.terrain, dtype=np.float64)
        return find_clearance(terrain, rope, self._snapshot.carriages, body_outlines(self.scenario))

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

    def _drive(self, index: int, kind: str, value: float) -> None:
        """Set mode and target of one drive; a driven joint takes over from the present motion."""
        state = self._state
        if kind == "force":
            as_python(set_drive_mode)(state, index, FORCE)
            state.drive_force[index] = value
            return
        if self._drive_mode(index) != SPEED:
            as_python(set_drive_mode)(state, index, SPEED)
            as_python(take_over)(state, index)
        state.drive_target[index] = value

    def _drive_mode(self, index: int) -> int:
        """Mode of a drive, be it on the carriage itself or on a sheave."""
        state = self._state
        return int(state.sheave_mode[index] if state.drive_mode[index] == HAULED else state.drive_mode[index])

    def _brake(self, index: int) -> None:
        """Stop one carriage with what its scenario says: its drive, brakes on it, or the track-rope brake alone."""
        drives = self.system.carriages
        if drives.clamped[index]:
            return
        braked = bool(drives.brake_force[index].any())
        if self._drive_mode(index) == FREE and not braked:
            return
        stoppable = drives.drive_stops[index] or drives.brake_force[index, :TRACK_ROPE].any()
        if self._drive_mode(index) != FREE or stoppable:
            self._drive(index, "speed" if stoppable else "force", 0.0)
        self._state.drive_braking[index] = True

    def _hang_in_ropes(self) -> None:
        """Start every haul rope with the force that holds its carriage."""
        for name, index in self._index.items():
            if self._state.drive_mode[index] != HAULED:
                continue
            force = float(self._state.drive_force[index])
            if not hang_in_rope(self.system, self._state, index, force):
                raise EquilibriumError(
                    f"carriages.{name}.drive.haul_rope: it would have to push with {abs(force):.4g} N to hold the "
                    f"carriage at its start; allowed: a pretension of as much, in N, or the drive at the other station"
                )
            if self._drive_mode(index) != SPEED:
                self._state.drive_force[index] = 0.0

    def _load(self, masses: FloatArray) -> System:
        """The system under payloads (carriages,) in kg."""
        return self._empty._replace(carriages=load_bodies(self._empty.carriages, self._payloads, masses))

    def _change_payload(self, command: Command) -> None:
        before = self._state.payload.copy()
        for name, mass in command.values.items():
            self._state.payload[self._index[name]] = mass
        shifts = [centre_offsets(self._empty.carriages, self._payloads, x) for x in (before, self._state.payload)]
        shift_centres(self._state, shifts[1] - shifts[0])
        self.system = self._load(self._state.payload)

    def _observe(self, report: SolverReport) -> Snapshot:
        """Read everything that a snapshot holds."""
        seen = allocate_observation(self.system, self._arc_lengths.size)
        observe(self.system, self._state, self._work, self._arc_lengths, self._means, seen)
        position, speed, _ = self._state.rope.tolist()
        return Snapshot(
            time=self.time,
            carriages={
                name: self._carriage(index, bodies, seen) for index, (name, bodies) in enumerate(self.carriages.items())
            },
            supports=self._supports(seen),
            cable=CableSamples(arc_lengths=self._arc_lengths, positions=seen.positions, tensions=seen.tensions),
            solver=report,
            drives={name: DriveState(position, speed, float(seen.haul_force[0])) for name in self.drives},
        )

    def _supports(self, seen: Observation) -> dict[str, SupportState]:
        """Both ends and every tower."""
        supports = {
            name: SupportState(force, travel=travel if mass > 0.0 else None)
            for name, force, travel, mass in zip(
                ("start", "end"), seen.ends, seen.travels.tolist(), self.system.counterweights.mass, strict=True
            )
        }
        for index, name in enumerate(self.scenario.towers):
            load, lowest = self._state.tower_load[index].tolist()
            rest = float(self._initial.tower_load[index, 0])
            supports[name] = SupportState(seen.towers[index], TowerState(load, lowest, rest, load == 0.0))
        return supports

    def _carriage(self, index: int, bodies: tuple[str, ...], seen: Observation) -> CarriageState:
        state = self._state
        first = int(self.system.carriages.body_offset[index])
        coordinates = state.body_coordinates[first : first + len(bodies)].tolist()
        velocities = state.body_velocities[first : first + len(bodies)].tolist()
        if state.payload[index] > 0.0:
            number = int(self._payloads.body[index])
            offset = centre_offsets(self._empty.carriages, self._payloads, state.payload)[number]
            body = number - first
            arm_x, arm_z, turn_x, turn_z = as_python(pivot)(coordinates[body][2], offset)
            spin = velocities[body][2]
            for row, x, z in ((coordinates[body], arm_x, arm_z), (velocities[body], turn_x * spin, turn_z * spin)):
                row[0], row[1] = row[0] - x, row[1] - z
        states: Mapping[str, BodyState] = {
            name: BodyState(*q, *q_dot) for name, q, q_dot in zip(bodies, coordinates, velocities, strict=True)
        }
        haul_rope = None
        if state.drive_mode[index] == HAULED:
            travel, rate = state.sheave[index, :2].tolist()
            haul_rope = HaulRopeState(travel, rate, float(seen.rope_forces[index]))
        return CarriageState(
            arc_length=float(state.sliding_coordinate[index]),
            speed=float(state.sliding_velocity[index]),
            drive_force=float(state.drive_force[index]),
            contact_force=state.multipliers[first].copy(),
            position=seen.joints[index],
            bodies=states,
            attached=bool(state.attached[index]),
            payload=float(state.payload[index]),
            haul_rope=haul_rope,
        )


__all__ = ["SAMPLES", "EquilibriumError", "Simulation", "SolverError"]
