"""A frame of the twin as one row of numbers, with names for its columns and views of single things.

Whoever takes every number (messages, logs, key figures) works on the columns; `snapshot.carriages["cabin"]` is made
when somebody asks. All is in space: position (3,) x, y, z, orientation (4,) x, y, z, w; a planar system has y = 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from math import isnan, prod

import numpy as np

from cable_twin.mechanics.readout.columns import Columns
from cable_twin.records import (
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
from cable_twin.scenario import Scenario, in_space

ENDS = ("start", "end")  # the first two supports of every rope
CABLE = "cable"  # name of the only rope
DERAILED = ("", "outward to the left", "outward to the right", "by lifting off")  # by the number in `tower_derailed`
SHAPES: Mapping[str, tuple[str | int, ...]] = {  # of the columns, in their order
    "time": (1,),
    "arc_length": ("vehicles",),
    "speed": ("vehicles",),
    "drive_force": ("vehicles",),
    "joint_position": ("vehicles", 3),
    "contact_force": ("vehicles", 3),
    "attached": ("vehicles",),
    "payload": ("vehicles",),
    "haul_travel": ("vehicles",),
    "haul_speed": ("vehicles",),
    "haul_force": ("vehicles",),
    "haul_pull": ("vehicles", 3),
    "body_position": ("bodies", 3),
    "body_orientation": ("bodies", 4),
    "body_velocity": ("bodies", 3),
    "body_angular_velocity": ("bodies", 3),
    "body_angles": ("bodies", 3),
    "support_force": ("supports", 3),
    "support_travel": ("supports",),
    "tower_load": ("supports",),
    "tower_lowest_load": ("supports",),
    "tower_rest_load": ("supports",),
    "tower_lateral": ("supports",),
    "tower_lateral_ratio": ("supports",),
    "tower_derailed": ("supports",),
    "tower_derailed_time": ("supports",),
    "drive_position": ("drives",),
    "drive_speed": ("drives",),
    "moving_cable_force": ("drives",),
    "rope_position": ("samples", 3),
    "rope_tension": ("samples",),
    "wind": (3,),
    "connector_force": ("connectors",),
    "pantograph_force": ("pantographs",),
    "pantograph_position": ("pantographs", 3),
    "pantograph_speed": ("pantographs",),
}


class Layout:
    """Which number of a frame is what, for one scenario.

    Attributes:
        vehicles: names of the bodies by name of their vehicle, in the order of the scenario: carriages, then carriers.
        carriages: names of the vehicles that are named one by one.
        carriers, hauled: names of those of which there are many of one kind, and of those that a haul rope pulls.
        supports: names of what holds the cable: start, end, towers.
        drives: names of the drives that move a cable.
        towers: names of those of them that are between the ends of a rope.
        space: whether it is one in space.
        grooves: places (3,) in m of the towers that hold a rope sideways, in space, by name.
        arc_lengths: (samples,) m, unstrained, where the ropes are shown, one after the other.
        ropes: which of these are of which rope, by its name.
        connectors, pantographs: names of what hangs between ropes, and of what pushes one from below.
        bodies: names of all bodies, VEHICLE/BODY.
        first_body: (vehicles + 1,) number of the first body of each vehicle.
        vehicle_rows, support_rows, drive_rows: number by name.
        body_rows: the same of the bodies of each vehicle, from its first one on.
        size: numbers of a frame.
    """

    def __init__(
        self,
        vehicles: Mapping[str, Sequence[str]],
        supports: Sequence[str],
        drives: Sequence[str],
        arc_lengths: FloatArray,
        *,
        carriers: int = 0,
        hauled: Sequence[str] = (),
        towers: Sequence[str] | None = None,
        ropes: Mapping[str, slice] | None = None,
        connectors: Sequence[str] = (),
        pantographs: Sequence[str] = (),
        space: bool = False,
        grooves: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Lay out frames; the last so many of the vehicles are carriers, and those named have haul ropes."""
        self.space, self.grooves = space, dict(grooves or {})
        self.vehicles = {name: tuple(bodies) for name, bodies in vehicles.items()}
        names = tuple(self.vehicles)
        self.carriages, self.carriers = names[: len(names) - carriers], names[len(names) - carriers :]
        self.supports, self.drives, self.hauled = tuple(supports), tuple(drives), tuple(hauled)
        self.arc_lengths = np.array(arc_lengths, dtype=np.float64)
        self.arc_lengths.setflags(write=False)
        self.towers = self.supports[len(ENDS) :] if towers is None else tuple(towers)
        self.ropes = {CABLE: slice(0, self.arc_lengths.size)} if ropes is None else dict(ropes)
        self.connectors, self.pantographs = tuple(connectors), tuple(pantographs)
        self.bodies = tuple(f"{name}/{body}" for name, bodies in self.vehicles.items() for body in bodies)
        self.first_body = [0, *np.cumsum([len(bodies) for bodies in self.vehicles.values()], dtype=int).tolist()]
        counts: dict[str | int, int] = {
            "vehicles": len(self.vehicles),
            "bodies": len(self.bodies),
            "supports": len(self.supports),
            "drives": len(self.drives),
            "samples": self.arc_lengths.size,
            "connectors": len(self.connectors),
            "pantographs": len(self.pantographs),
        }
        shapes = [tuple(counts.get(count, count) for count in SHAPES[name]) for name in Columns._fields]
        ends = [0, *np.cumsum([prod(shape) for shape in shapes], dtype=int).tolist()]  # type: ignore[arg-type]
        self._places = [(first, last, shape) for (first, last), shape in zip(pairwise(ends), shapes, strict=True)]
        self.size: int = ends[-1]
        self.vehicle_rows, self.support_rows = numbered(self.vehicles), numbered(self.supports)
        self.drive_rows = numbered(self.drives)
        self.body_rows = tuple(numbered(bodies) for bodies in self.vehicles.values())

    @classmethod
    def of(cls, scenario: Scenario, samples: int) -> Layout:
        """Layout of the frames of a scenario, with so many points (at least 2) of each of its ropes."""
        names = tuple(scenario.ropes)
        alone = [scenario.of_rope(name) for name in names] or [scenario]
        supports = [
            [*(f"{name}/{end}" if name else end for end in ENDS), *one.towers]
            for name, one in zip(names or ("",), alone, strict=True)
        ]
        return cls(
            {name: tuple(vehicle.bodies) for name, vehicle in scenario.vehicles.items()},
            [name for own in supports for name in own],
            tuple(scenario.drives),
            np.concatenate([np.linspace(0.0, one.cable.unstrained_length, samples) for one in alone]),
            carriers=0 if scenario.carriers is None else scenario.carriers.count,
            hauled=tuple(name for name, one in scenario.carriages.items() if one.drive.haul_rope is not None),
            towers=[name for own in supports for name in own[len(ENDS) :]],
            ropes={name: slice(row * samples, (row + 1) * samples) for row, name in enumerate(names or (CABLE,))},
            connectors=tuple(scenario.connectors),
            pantographs=tuple(scenario.pantographs),
            space=scenario.dim == 3,
            grooves={n: in_space(tower.position) for n, tower in scenario.towers.items() if scenario.dim == 3},
        )

    def of_rope(self, columns: Columns, name: str, supports: slice, vehicles: slice) -> Columns:
        """Views of what is of one rope in the columns of a frame, from its supports and vehicles."""
        bodies = slice(self.first_body[vehicles.start], self.first_body[vehicles.stop])
        rows = {"supports": supports, "vehicles": vehicles, "bodies": bodies, "samples": self.ropes[name]}
        return Columns(*(field[rows.get(str(SHAPES[key][0]), slice(None))] for key, field in columns._asdict().items()))

    def columns(self, numbers: FloatArray) -> Columns:
        """Views of the columns of a frame (size,), or of several (..., size) with their axes in front."""
        leading = numbers.shape[:-1]
        return Columns(*(numbers[..., first:last].reshape(leading + shape) for first, last, shape in self._places))


def numbered(names: Iterable[str]) -> dict[str, int]:
    """Number of each name."""
    return {name: number for number, name in enumerate(names)}


class Snapshot:
    """The twin at one simulated time; everything that is published, recorded or drawn comes from here.

    Attributes:
        layout: which number is what.
        numbers: (size,), which cannot be written.
        solver: what the solver did since the snapshot before.
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
        """All columns."""
        if self._columns is None:
            self._columns = self.layout.columns(self.numbers)
        return self._columns

    @property
    def vehicles(self) -> VehicleColumns:
        """All vehicles as columns."""
        c = self.columns
        names = (*self.layout.carriages, *self.layout.carriers)
        return VehicleColumns(
            names, c.arc_length, c.speed, c.drive_force, c.joint_position, c.contact_force, c.attached, c.payload
        )

    @property
    def bodies(self) -> BodyColumns:
        """All bodies as columns."""
        c = self.columns
        places, turns = (c.body_position, c.body_orientation), (c.body_velocity, c.body_angular_velocity)
        return BodyColumns(self.layout.bodies, *places, *turns, c.body_angles)

    @property
    def carriages(self) -> Mapping[str, CarriageState]:
        """Carriages and carriers by name."""
        return Named(self.layout.vehicle_rows, self._carriage)

    @property
    def supports(self) -> Mapping[str, SupportState]:
        """What holds the cable, by name: start, end, towers."""
        return Named(self.layout.support_rows, self._support)

    @property
    def drives(self) -> Mapping[str, DriveState]:
        """Drives that move a cable, by name."""
        return Named(self.layout.drive_rows, self._drive)

    @property
    def cable(self) -> CableSamples:
        """The first rope."""
        return next(iter(self.ropes.values()))

    @property
    def ropes(self) -> Mapping[str, CableSamples]:
        """All ropes by name."""
        arc_lengths, c = self.layout.arc_lengths, self.columns
        return {
            name: CableSamples(arc_lengths[part], c.rope_position[part], c.rope_tension[part])
            for name, part in self.layout.ropes.items()
        }

    @property
    def connectors(self) -> Mapping[str, float]:
        """Pull (N) of what hangs between ropes, by name."""
        return dict(zip(self.layout.connectors, self.columns.connector_force.tolist(), strict=True))

    @property
    def pantographs(self) -> Mapping[str, PantographState]:
        """What pushes a rope from below, by name."""
        c = self.columns
        rows = zip(self.layout.pantographs, c.pantograph_position, c.pantograph_speed, c.pantograph_force, strict=True)
        return {name: PantographState(place, float(speed), float(force)) for name, place, speed, force in rows}

    @property
    def derailments(self) -> list[Derailment]:
        """Towers of which the cable has come out, in the order of the scenario."""
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
        across = map(float, grooves) if self.layout.space else ()
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
    """Towers of which the cable has come out in a frame, in the order of the scenario."""
    found = []
    for name, place in layout.grooves.items():
        row = layout.support_rows[name]
        how = columns.tower_derailed[row]
        if how > 0.0:
            ratio, time = float(columns.tower_lateral_ratio[row]), float(columns.tower_derailed_time[row])
            found.append(Derailment(name, DERAILED[int(how)], time, tuple(place), ratio))
    return found


__all__ = ["CABLE", "DERAILED", "ENDS", "Layout", "Snapshot", "derailments"]
