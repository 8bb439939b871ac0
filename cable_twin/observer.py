"""What a simulation shows: snapshots out of the arrays of its state."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.mechanics.carriage import pivot
from cable_twin.mechanics.compilation import as_python
from cable_twin.mechanics.parameters import HAULED, FloatArray, Payloads, System
from cable_twin.mechanics.payload import centre_offsets
from cable_twin.mechanics.readout import Observation, allocate_observation, observe
from cable_twin.mechanics.state import State, Workspace
from cable_twin.records import (
    BodyState,
    CableSamples,
    CarriageState,
    DriveState,
    HaulRopeState,
    Snapshot,
    SolverReport,
    SupportState,
    TowerState,
)
from cable_twin.scenario import Scenario


class Observer:
    """Reads snapshots of one scenario.

    Args:
        scenario: what runs.
        empty: its system without payloads.
        payloads: where they would be.
        samples: points (at least 2) at which snapshots hold the cable.
    """

    def __init__(self, scenario: Scenario, empty: System, payloads: Payloads, samples: int) -> None:
        self._empty, self._payloads = empty, payloads
        self._carriages = {name: tuple(carriage.bodies) for name, carriage in scenario.vehicles.items()}
        self._towers, self._drives = tuple(scenario.towers), tuple(scenario.drives)
        self._arc_lengths = np.linspace(0.0, empty.cable.unstrained_length, samples, dtype=np.float64)
        self._arc_lengths.setflags(write=False)
        self._means = np.empty(empty.cable.element_count)

    def look(self, system: System, state: State, work: Workspace) -> Observation:
        """Read what has to be computed for a snapshot."""
        seen = allocate_observation(system, self._arc_lengths.size)
        observe(system, state, work, self._arc_lengths, self._means, seen)
        return seen

    def snapshot(
        self,
        time: float,
        system: System,
        state: State,
        work: Workspace,
        rest_loads: FloatArray,
        report: SolverReport,
    ) -> Snapshot:
        """Put everything that a snapshot holds together.

        Args:
            time: s.
            system: with its payloads.
            state: what is read.
            work: scratch.
            rest_loads: (towers,) N, at the start of the run.
            report: what the solver did since the snapshot before.
        """
        seen = self.look(system, state, work)
        position, speed, _ = state.rope.tolist()
        return Snapshot(
            time=time,
            carriages={
                name: self._carriage(state, index, bodies, seen)
                for index, (name, bodies) in enumerate(self._carriages.items())
            },
            supports=self._supports(system, state, rest_loads, seen),
            cable=CableSamples(arc_lengths=self._arc_lengths, positions=seen.positions, tensions=seen.tensions),
            solver=report,
            drives={name: DriveState(position, speed, float(seen.haul_force[0])) for name in self._drives},
        )

    def _supports(
        self, system: System, state: State, rest_loads: FloatArray, seen: Observation
    ) -> dict[str, SupportState]:
        """Both ends and every tower."""
        supports = {
            name: SupportState(force, travel=travel if mass > 0.0 else None)
            for name, force, travel, mass in zip(
                ("start", "end"), seen.ends, seen.travels.tolist(), system.counterweights.mass, strict=True
            )
        }
        for index, name in enumerate(self._towers):
            load, lowest = state.tower_load[index].tolist()
            supports[name] = SupportState(
                seen.towers[index], TowerState(load, lowest, float(rest_loads[index]), load == 0.0)
            )
        return supports

    def _carriage(self, state: State, index: int, bodies: tuple[str, ...], seen: Observation) -> CarriageState:
        first = int(self._empty.carriages.body_offset[index])
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


__all__ = ["Observer"]
