"""A frame of the twin as one row of numbers, with names for its columns and views of single things.

Whoever takes every number (messages, logs, key figures) works on the columns; `snapshot.carriages["cabin"]` is made
when somebody asks. All is in space: position (3,) x, y, z, orientation (4,) x, y, z, w; a planar system has y = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from math import isnan, prod
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from cable_twin.mechanics.readout.columns import Columns
from cable_twin.records import (
    BodyState,
    CableSamples,
    CarriageState,
    DriveState,
    FloatArray,
    HaulRopeState,
    SolverReport,
    SupportState,
    TowerState,
)
from cable_twin.scenario import Scenario

ENDS = ("start", "end")  # the first two supports of every rope
CABLE = "cable"  # name of the only rope
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
    "drive_position": ("drives",),
    "drive_speed": ("drives",),
    "moving_cable_force": ("drives",),
    "rope_position": ("samples", 3),
    "rope_tension": ("samples",),
    "wind": (3,),
}
T = TypeVar("T")


class Layout:
    """Which number of a frame is what, for one scenario.

    Attributes:
        vehicles: names of the bodies by name of their vehicle, in the order of the scenario: carriages, then carriers.
        carriages: names of the vehicles that are named one by one.
        carriers, hauled: names of those of which there are many of one kind, and of those that a haul rope pulls.
        supports: names of what holds the cable: start, end, towers.
        drives: names of the drives that move a cable.
        space: whether things move across the track too.
        arc_lengths: (samples,) m, unstrained, where the cable is shown.
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
        space: bool = False,
    ) -> None:
        """Lay out frames; the last so many of the vehicles are carriers, and those named have haul ropes."""
        self.vehicles = {name: tuple(bodies) for name, bodies in vehicles.items()}
        self.space = space
        names = tuple(self.vehicles)
        self.carriages, self.carriers = names[: len(names) - carriers], names[len(names) - carriers :]
        self.supports, self.drives, self.hauled = tuple(supports), tuple(drives), tuple(hauled)
        self.arc_lengths = np.array(arc_lengths, dtype=np.float64)
        self.arc_lengths.setflags(write=False)
        self.bodies = tuple(f"{name}/{body}" for name, bodies in self.vehicles.items() for body in bodies)
        self.first_body = [0, *np.cumsum([len(bodies) for bodies in self.vehicles.values()], dtype=int).tolist()]
        counts: dict[str | int, int] = {
            "vehicles": len(self.vehicles),
            "bodies": len(self.bodies),
            "supports": len(self.supports),
            "drives": len(self.drives),
            "samples": self.arc_lengths.size,
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
        """Layout of the frames of a scenario, with so many points (at least 2) of its cable."""
        return cls(
            {name: tuple(vehicle.bodies) for name, vehicle in scenario.vehicles.items()},
            (*ENDS, *scenario.towers),
            tuple(scenario.drives),
            np.linspace(0.0, scenario.cable.unstrained_length, samples, dtype=np.float64),
            carriers=0 if scenario.carriers is None else scenario.carriers.count,
            hauled=tuple(name for name, one in scenario.carriages.items() if one.drive.haul_rope is not None),
            space=scenario.dim == 3,
        )

    def columns(self, numbers: FloatArray) -> Columns:
        """Views of the columns of a frame (size,), or of several (..., size) with their axes in front."""
        leading = numbers.shape[:-1]
        return Columns(*(numbers[..., first:last].reshape(leading + shape) for first, last, shape in self._places))


def numbered(names: Iterable[str]) -> dict[str, int]:
    """Number of each name."""
    return {name: number for number, name in enumerate(names)}


class VehicleColumns(NamedTuple):
    """All vehicles, a row each, in the order of the scenario; see `Columns` for the units."""

    names: tuple[str, ...]
    arc_length: FloatArray  # (vehicles,) m
    speed: FloatArray  # (vehicles,) m/s
    drive_force: FloatArray  # (vehicles,) N
    position: FloatArray  # (vehicles, 3) m
    contact_force: FloatArray  # (vehicles, 3) N
    attached: FloatArray  # (vehicles,) 1 or 0
    payload: FloatArray  # (vehicles,) kg


class BodyColumns(NamedTuple):
    """All bodies, a row each, in the order of the scenario; see `Columns` for the units."""

    names: tuple[str, ...]  # VEHICLE/BODY
    position: FloatArray  # (bodies, 3) m
    orientation: FloatArray  # (bodies, 4)
    velocity: FloatArray  # (bodies, 3) m/s
    angular_velocity: FloatArray  # (bodies, 3) rad/s
    angles: FloatArray  # (bodies, 3) roll, pitch, yaw in rad


class Named(Mapping[str, T], Generic[T]):
    """Things by name, each made when it is asked for."""

    __slots__ = ("_make", "_names")

    def __init__(self, names: Mapping[str, int], make: Callable[[int], T]) -> None:
        self._names, self._make = names, make

    def __getitem__(self, name: str) -> T:
        return self._make(self._names[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return repr(dict(self))


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
        return CableSamples(self.layout.arc_lengths, self.columns.rope_position, self.columns.rope_tension)

    @property
    def ropes(self) -> Mapping[str, CableSamples]:
        """All ropes by name."""
        return {CABLE: self.cable}

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
        travel = float(c.support_travel[index])
        return SupportState(
            force=c.support_force[index],
            tower=TowerState(load, lowest, float(rest), load == 0.0) if index >= len(ENDS) else None,
            travel=None if isnan(travel) else travel,
        )

    def _drive(self, index: int) -> DriveState:
        c = self.columns
        position, speed = float(c.drive_position[index]), float(c.drive_speed[index])
        return DriveState(position, speed, float(c.moving_cable_force[index]))


__all__ = ["CABLE", "ENDS", "BodyColumns", "Layout", "Snapshot", "VehicleColumns"]
