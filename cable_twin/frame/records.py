"""Inputs and outputs of a simulation as frozen records in SI units, without behaviour of solver or ROS.

Frame: x along the track, y lateral, z up (REP-103); a planar system has y = 0. Pitch is the right-handed angle about
the lateral axis, so a positive pitch turns x towards -z.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
T = TypeVar("T")


class Named(Mapping[str, T], Generic[T]):
    """Mapping from object names to records that are made on access."""

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


@dataclass(frozen=True, slots=True)
class Command:
    """Accepted command to the twin; together with the scenario, commands determine the whole motion."""

    kind: str  # one of the table `cable_twin.frame.commands.KINDS`
    values: Mapping[str, float]  # by name of a carriage or drive, or by axis, in the unit of the kind


@dataclass(frozen=True, slots=True)
class Goal:
    """Target places of carriages and drives to stop at; the frame loop chooses the speeds on the way."""

    places: Mapping[str, float]  # m: arc length for a carriage, travel of the cable for a drive
    at_most: Mapping[str, float]  # m/s, highest speeds on the way, where below the limits


class CommandError(ValueError):
    """Refusal of a whole command: one line with the given value, the allowed range and the unit."""


@dataclass(frozen=True, slots=True)
class AppliedCommand:
    """Command with its source and the simulated time (s) of the step boundary at which it took effect."""

    time: float
    command: Command
    source: str


@dataclass(frozen=True, slots=True)
class RefusedCommand:
    """Command refused as a whole, with time, source and reason."""

    time: float  # s, simulated
    source: str  # topic of the command, or `script`
    reason: str  # given value, allowed range and unit, in a line
    count: int  # refused commands of the run so far, with this one

    def __str__(self) -> str:
        """Text of a refused command in one line: time, source and reason."""
        return f"at {self.time:.2f} s from {self.source}: {self.reason}"


class TensionAhead(NamedTuple):
    """Lowest and highest tension along each rope that an outlook predicts until its horizon."""

    time: float  # s, simulated, of the present state
    lowest: FloatArray  # (ropes,) N, in all futures until the horizon
    highest: FloatArray  # (ropes,) N


class PlantEstimates(NamedTuple):
    """Estimates of a plant that a twin follows."""

    time: float  # s, simulated, when they came
    found: Mapping[str, tuple[float, float, str]]  # value, standard deviation and unit by name


class VehicleColumns(NamedTuple):
    """Columns of all vehicles, a row each, in the order of the scenario; see `Columns` for the units."""

    names: tuple[str, ...]
    arc_length: FloatArray  # (vehicles,) m
    speed: FloatArray  # (vehicles,) m/s
    drive_force: FloatArray  # (vehicles,) N
    position: FloatArray  # (vehicles, 3) m
    contact_force: FloatArray  # (vehicles, 3) N
    attached: FloatArray  # (vehicles,) 1 or 0
    payload: FloatArray  # (vehicles,) kg


class BodyColumns(NamedTuple):
    """Columns of all bodies, a row each, in the order of the scenario; see `Columns` for the units."""

    names: tuple[str, ...]  # VEHICLE/BODY
    position: FloatArray  # (bodies, 3) m
    orientation: FloatArray  # (bodies, 4)
    velocity: FloatArray  # (bodies, 3) m/s
    angular_velocity: FloatArray  # (bodies, 3) rad/s
    angles: FloatArray  # (bodies, 3) roll, pitch, yaw in rad


@dataclass(frozen=True, slots=True)
class BodyState:
    """State of one rigid body: centre of mass without payload, orientation, and their rates."""

    position: FloatArray  # (3,) m
    orientation: FloatArray  # (4,) unit quaternion x, y, z, w
    velocity: FloatArray  # (3,) m/s
    angular_velocity: FloatArray  # (3,) rad/s
    angles: FloatArray  # (3,) roll, pitch, yaw in rad; pitch without jumps beyond a turn

    @property
    def x(self) -> float:
        """Place of the centre of mass along the track (m)."""
        return float(self.position[0])

    @property
    def z(self) -> float:
        """Height of the centre of mass (m)."""
        return float(self.position[2])

    @property
    def roll(self) -> float:
        """Roll angle about the track axis (rad)."""
        return float(self.angles[0])

    @property
    def pitch(self) -> float:
        """Pitch angle about the lateral axis (rad)."""
        return float(self.angles[1])

    @property
    def yaw(self) -> float:
        """Yaw angle about the vertical (rad)."""
        return float(self.angles[2])


@dataclass(frozen=True, slots=True)
class CarriageState:
    """State of one carriage: place of its joint on the cable, and forces there."""

    arc_length: float  # m, unstrained, from the start of the cable
    speed: float  # m/s, rate of arc_length
    drive_force: float  # N, along the cable, on the carriage or its clamp, or on the drum of its haul rope
    contact_force: FloatArray  # (3,) N, of the cable on the carriage
    position: FloatArray  # (3,) m, of the joint
    bodies: Mapping[str, BodyState]
    attached: bool = True  # to the cable; a detached carrier hangs at rest in a station
    payload: float = 0.0  # kg
    haul_rope: HaulRopeState | None = None
    clamp_force: FloatArray | None = None  # (3,) N, of the second rope on the carriage, through its clamp
    push: float = 0.0  # N, buffer force between the carriage and the next one on the rope


@dataclass(frozen=True, slots=True)
class DriveState:
    """State of the drive of a moving cable: travel of the cable, speed, force."""

    position: float  # m, travel of the unstrained cable towards its end
    speed: float  # m/s
    force: float  # N, on the cable; times speed the power into cable and vehicles


@dataclass(frozen=True, slots=True)
class TowerState:
    """Contact state of the cable on one tower."""

    normal_load: float  # N, sum over the contacts of the tower
    lowest_load: float  # N, lowest of all steps since the start or the last reset
    rest_load: float  # N, at the start
    lifted_off: bool  # whether the cable has left all contacts: deropement
    lateral_force: float | None = None  # N, of the grooves on the cable, to the left of the track; None in a plane
    lateral_ratio: float | None = None  # -, highest of its size over the normal load since the start or the last reset;
    # none where there was no normal load

    @property
    def margin(self) -> float:
        """Ratio (-) of the normal load of a tower to its load at rest: 0 where the cable lifts off."""
        return self.normal_load / self.rest_load if self.rest_load > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class PantographState:
    """State of a pantograph, which pushes a rope from below."""

    position: FloatArray  # (3,) m, of the head
    speed: float  # m/s, along the track
    contact_force: float  # N, upwards on the rope, 0 without contact


@dataclass(frozen=True, slots=True)
class Derailment:
    """Derailment of the cable from a tower, where the cable is free until a reset."""

    tower: str
    how: str
    time: float  # s, simulated
    position: tuple[float, ...]  # (3,) m, of the tower
    ratio: float | None  # -, highest lateral over normal force until then; None without any contact

    def __str__(self) -> str:
        """Text of a derailment in one line."""
        x, y, z = self.position
        return f"{self.tower}: rope derailed {self.how} at {self.time:.3f} s, at x {x:.1f}, y {y:.1f}, z {z:.1f} m"


@dataclass(frozen=True, slots=True)
class Touch:
    """Contact of two vehicles on a rope: names, time, place, closing speed."""

    vehicle: str
    other: str  # next vehicle on the rope
    time: float  # s, simulated
    place: float  # m, unstrained arc length of the joint of `vehicle`
    speed: float  # m/s, closing speed at the contact

    def __str__(self) -> str:
        """Text of a contact of two vehicles in one line."""
        return (
            f"'{self.vehicle}' and '{self.other}' touch at {self.time:.3f} s, at {self.place:.2f} m of the cable, "
            f"with {self.speed:.3g} m/s"
        )


@dataclass(frozen=True, slots=True)
class HaulRopeState:
    """State of the haul rope of one carriage: travel, speed at its drive, force on the carriage."""

    travel: float  # m, arc length of the carriage on an inextensible haul rope
    speed: float  # m/s, of the rope at the drive sheave
    force: float  # N, of the rope on the carriage, along the cable


@dataclass(frozen=True, slots=True)
class Place:
    """Lowest point of a rope or vehicle, with its height above the ground."""

    height: float  # m, negative below the ground
    x: float  # m
    z: float  # m


@dataclass(frozen=True, slots=True)
class Clearance:
    """Least heights of ropes and vehicles above the ground."""

    rope: Place  # lowest of all ropes
    vehicles: Mapping[str, Place]
    ropes: Mapping[str, Place]


@dataclass(frozen=True, slots=True)
class SupportState:
    """State of one support: its force on the cable, and data of a tower or counterweight."""

    force: FloatArray  # (3,) N, of the support on the cable
    tower: TowerState | None = None  # of a tower, else None
    travel: float | None = None  # m, of a counterweight along its pull, from its position in the scenario


@dataclass(frozen=True, slots=True)
class CableSamples:
    """Samples of the cable at fixed arc lengths, dense enough to draw."""

    arc_lengths: FloatArray  # (n,) m, unstrained
    positions: FloatArray  # (n, 3) m
    tensions: FloatArray  # (n,) N


@dataclass(frozen=True, slots=True)
class SolverReport:
    """Statistics of the solver since the previous snapshot."""

    steps: int
    iterations: int  # Newton iterations, all steps together
    halvings: int  # steps repeated with half the length
    constraint_residual: float  # m, worst joint gap
    energy_lost: float = 0.0  # J, by the integrator, without dampers and friction
    energy_moved: float = 0.0  # J, sum of all changes of kinetic energy from step to step, as magnitudes

    def then(self, later: SolverReport) -> SolverReport:
        """Merge the solver statistics of this period with those of a later one."""
        return SolverReport(
            self.steps + later.steps,
            self.iterations + later.iterations,
            self.halvings + later.halvings,
            max(self.constraint_residual, later.constraint_residual),
            self.energy_lost + later.energy_lost,
            self.energy_moved + later.energy_moved,
        )


@dataclass(frozen=True, slots=True)
class Energy:
    """Mechanical energy (J) of the cable and its vehicles; gravitational energy is zero at z = 0.

    Without a potential of constant loads on the rope, whose work is work from outside.
    """

    kinetic: float
    elastic: float
    gravitational: float

    @property
    def total(self) -> float:
        """Sum of kinetic, elastic and gravitational energy (J)."""
        return self.kinetic + self.elastic + self.gravitational
