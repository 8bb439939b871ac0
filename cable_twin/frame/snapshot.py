"""Snapshot of the twin: one frame as a row of numbers, with named columns and views of single objects.

Code that takes every number (messages, logs, key figures) works on the columns; `snapshot.carriages["cabin"]` is made
on access. Vectors are in space: position (3,) x, y, z, orientation (4,) x, y, z, w; a planar system has y = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan

from cable_twin.frame.layout import CABLE, COMMANDED, DERAILED, ENDS, Layout
from cable_twin.frame.records import (
    BodyColumns,
    BodyState,
    CableSamples,
    CarriageState,
    Derailment,
    DriveState,
    FloatArray,
    HaulRopeState,
    Named,
    PantographState,
    SolverReport,
    SupportState,
    TowerState,
    VehicleColumns,
)
from cable_twin.mechanics.readout.columns import Columns


class Snapshot:
    """State of the twin at one simulated time, source of all published, recorded and drawn data.

    Attributes:
        layout: names and indices of the numbers.
        numbers: (size,), read-only.
        solver: report of the solver since the previous snapshot.
    """

    __slots__ = ("_columns", "layout", "numbers", "solver")

    def __init__(self, layout: Layout, numbers: FloatArray, solver: SolverReport) -> None:
        self.layout, self.numbers, self.solver = layout, numbers.view(), solver
        self.numbers.flags.writeable = False
        self._columns: Columns | None = None

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return float(self.numbers[0])

    @property
    def columns(self) -> Columns:
        """All columns of the frame."""
        if self._columns is None:
            self._columns = self.layout.columns(self.numbers)
        return self._columns

    @property
    def vehicles(self) -> VehicleColumns:
        """Columns of the states of all vehicles."""
        c = self.columns
        names = (*self.layout.carriages, *self.layout.carriers)
        return VehicleColumns(
            names, c.arc_length, c.speed, c.drive_force, c.joint_position, c.contact_force, c.attached, c.payload
        )

    @property
    def bodies(self) -> BodyColumns:
        """Columns of the states of all bodies of vehicles."""
        c = self.columns
        places, turns = (c.body_position, c.body_orientation), (c.body_velocity, c.body_angular_velocity)
        return BodyColumns(self.layout.bodies, *places, *turns, c.body_angles)

    @property
    def carriages(self) -> Mapping[str, CarriageState]:
        """States of carriages and carriers by name."""
        return Named(self.layout.vehicle_rows, self._carriage)

    @property
    def supports(self) -> Mapping[str, SupportState]:
        """States of all supports by name: start, end, towers."""
        return Named(self.layout.support_rows, self._support)

    @property
    def drives(self) -> Mapping[str, DriveState]:
        """States of the drives of moving cables by name."""
        return Named(self.layout.drive_rows, self._drive)

    @property
    def cable(self) -> CableSamples:
        """Samples of the first rope: arc lengths, positions, tensions."""
        return next(iter(self.ropes.values()))

    @property
    def ropes(self) -> Mapping[str, CableSamples]:
        """Samples of all ropes by name: arc lengths, positions, tensions."""
        arc_lengths, c = self.layout.arc_lengths, self.columns
        return {
            name: CableSamples(arc_lengths[part], c.rope_position[part], c.rope_tension[part])
            for name, part in self.layout.ropes.items()
        }

    @property
    def connectors(self) -> Mapping[str, float]:
        """Pull (N) of connectors between ropes, by name."""
        return dict(zip(self.layout.connectors, self.columns.connector_force.tolist(), strict=True))

    @property
    def pantographs(self) -> Mapping[str, PantographState]:
        """States of pantographs by name."""
        c = self.columns
        rows = zip(self.layout.pantographs, c.pantograph_position, c.pantograph_speed, c.pantograph_force, strict=True)
        return {name: PantographState(place, float(speed), float(force)) for name, place, speed, force in rows}

    @property
    def derailments(self) -> list[Derailment]:
        """Derailments in the order of the towers of the scenario."""
        return derailments(self.layout, self.columns)

    def _carriage(self, index: int) -> CarriageState:
        c = self.columns
        haul = HaulRopeState(float(c.haul_travel[index]), float(c.haul_speed[index]), float(c.haul_force[index]))
        first = self.layout.first_body[index]
        return CarriageState(
            arc_length=float(c.arc_length[index]),
            speed=float(c.speed[index]),
            drive_force=float(c.drive_force[index]),
            contact_force=c.contact_force[index],
            position=c.joint_position[index],
            bodies=Named(self.layout.body_rows[index], lambda number: self._body(first + number)),
            attached=bool(c.attached[index]),
            payload=float(c.payload[index]),
            haul_rope=None if isnan(haul.travel) else haul,
            clamp_force=c.haul_pull[index] if isnan(haul.travel) and not isnan(haul.force) else None,
            push=float(c.push[index]),
        )

    def _body(self, row: int) -> BodyState:
        c = self.columns
        return BodyState(
            position=c.body_position[row],
            orientation=c.body_orientation[row],
            velocity=c.body_velocity[row],
            angular_velocity=c.body_angular_velocity[row],
            angles=c.body_angles[row],
        )

    def _support(self, index: int) -> SupportState:
        c = self.columns
        load, lowest, rest = float(c.tower_load[index]), float(c.tower_lowest_load[index]), c.tower_rest_load[index]
        travel, grooves = float(c.support_travel[index]), (c.tower_lateral[index], c.tower_lateral_ratio[index])
        across = [None if isnan(one) else float(one) for one in grooves]
        between = self.layout.supports[index] in self.layout.towers
        return SupportState(
            force=c.support_force[index],
            tower=TowerState(load, lowest, float(rest), load == 0.0, *across) if between else None,
            travel=None if isnan(travel) else travel,
        )

    def _drive(self, index: int) -> DriveState:
        c = self.columns
        position, speed = float(c.drive_position[index]), float(c.drive_speed[index])
        return DriveState(position, speed, float(c.moving_cable_force[index]))


def derailments(layout: Layout, columns: Columns) -> list[Derailment]:
    """Derailments in a frame, in the order of the towers of the scenario."""
    found = []
    for name, place in layout.grooves.items():
        row = layout.support_rows[name]
        how = columns.tower_derailed[row]
        if how > 0.0:
            ratio, time = float(columns.tower_lateral_ratio[row]), float(columns.tower_derailed_time[row])
            known = None if isnan(ratio) else ratio
            found.append(Derailment(name, DERAILED[int(how)], time, tuple(place), known))
    return found


__all__ = ["CABLE", "COMMANDED", "DERAILED", "ENDS", "Layout", "Snapshot", "derailments"]
