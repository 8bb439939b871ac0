"""What goes into a simulation and what comes out of it: frozen records, SI units, no behaviour of solver or ROS.

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


@dataclass(frozen=True, slots=True)
class Command:
    """One accepted instruction to the twin; together with the scenario it determines the whole motion."""

    kind: str  # one of the table `cable_twin.commands.KINDS`
    values: Mapping[str, float]  # by name of a carriage or drive, or by axis, in the unit of the kind


@dataclass(frozen=True, slots=True)
class Goal:
    """Places to go to, and to stop at: what speeds that takes is for whoever carries it out."""

    places: Mapping[str, float]  # m along the cable by carriage, m of cable gone by of a drive
    at_most: Mapping[str, float]  # m/s on the way, of those that are not to go as fast as their limits allow


class CommandError(ValueError):
    """A command that is refused whole: one line with what was given, what is allowed and the unit."""


@dataclass(frozen=True, slots=True)
class AppliedCommand:
    """A command with the simulated time (s) of the step boundary at which it took effect, and who gave it."""

    time: float
    command: Command
    source: str


@dataclass(frozen=True, slots=True)
class RefusedCommand:
    """A command that was refused whole."""

    time: float  # s, simulated
    source: str  # topic that brought it, or `script`
    reason: str  # a line: what was given, what is allowed, the unit
    count: int  # commands of the run that were refused so far, this one included

    def __str__(self) -> str:
        """Time, source and reason, for people."""
        return f"at {self.time:.2f} s from {self.source}: {self.reason}"


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


@dataclass(frozen=True, slots=True)
class BodyState:
    """One rigid body: its centre of mass without payload, its orientation, and their rates."""

    position: FloatArray  # (3,) m
    orientation: FloatArray  # (4,) unit quaternion x, y, z, w
    velocity: FloatArray  # (3,) m/s
    angular_velocity: FloatArray  # (3,) rad/s
    angles: FloatArray  # (3,) roll, pitch, yaw in rad; pitch goes on beyond a turn

    @property
    def x(self) -> float:
        """Place along the track (m)."""
        return float(self.position[0])

    @property
    def z(self) -> float:
        """Height (m)."""
        return float(self.position[2])

    @property
    def roll(self) -> float:
        """Angle about the track (rad)."""
        return float(self.angles[0])

    @property
    def pitch(self) -> float:
        """Angle about the lateral axis (rad)."""
        return float(self.angles[1])

    @property
    def yaw(self) -> float:
        """Angle about the vertical (rad)."""
        return float(self.angles[2])


@dataclass(frozen=True, slots=True)
class CarriageState:
    """One carriage: where its joint is on the cable and what acts there."""

    arc_length: float  # m, unstrained, from the start of the cable
    speed: float  # m/s, rate of arc_length
    drive_force: float  # N, along the cable, on the carriage, also by its clamp; or on the sheave of its haul rope
    contact_force: FloatArray  # (3,) N, of the cable on the carriage
    position: FloatArray  # (3,) m, of the joint
    bodies: Mapping[str, BodyState]
    attached: bool = True  # to the cable; a carrier that is not hangs at rest in a station
    payload: float = 0.0  # kg
    haul_rope: HaulRopeState | None = None
    clamp_force: FloatArray | None = None  # (3,) N, of the rope to which it is clamped on the carriage
    push: float = 0.0  # N, with which it and what is after it on the rope push each other


@dataclass(frozen=True, slots=True)
class DriveState:
    """The drive of a cable that moves along itself."""

    position: float  # m, unstrained cable that has gone by, towards the end
    speed: float  # m/s
    force: float  # N, on the cable; times speed the power into it and what hangs on it


@dataclass(frozen=True, slots=True)
class TowerState:
    """How firmly the cable lies on one tower."""

    normal_load: float  # N, sum over its contacts
    lowest_load: float  # N, the least of all steps since the start or the last reset
    rest_load: float  # N, at the start
    lifted_off: bool  # whether the cable has left all of its contacts: deropement
    lateral_force: float | None = None  # N, of its grooves on the cable, to the left of the track; none in a plane
    lateral_ratio: float | None = None  # -, highest of its size over the normal load since the start or the last reset;
    # none where there was no normal load

    @property
    def margin(self) -> float:
        """Load over that at rest (-): 0 where the cable lifts off."""
        return self.normal_load / self.rest_load if self.rest_load > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class PantographState:
    """What pushes a rope from below."""

    position: FloatArray  # (3,) m, of the head
    speed: float  # m/s, along the track
    contact_force: float  # N, upwards on the rope, 0 where it has lost it


@dataclass(frozen=True, slots=True)
class Derailment:
    """The cable has come out of the grooves of a tower, and is free there until a reset."""

    tower: str
    how: str
    time: float  # s, simulated
    position: tuple[float, ...]  # (3,) m, of the tower
    ratio: float | None  # -, highest of lateral over normal force until then; none where it never lay on the tower

    def __str__(self) -> str:
        """One line for people."""
        x, y, z = self.position
        return f"{self.tower}: rope derailed {self.how} at {self.time:.3f} s, at x {x:.1f}, y {y:.1f}, z {z:.1f} m"


@dataclass(frozen=True, slots=True)
class Touch:
    """Two vehicles on a rope have met."""

    vehicle: str
    other: str  # after it on the rope
    time: float  # s, simulated
    place: float  # m, unstrained arc length of the joint of the first
    speed: float  # m/s, at which they came together

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"'{self.vehicle}' and '{self.other}' touch at {self.time:.3f} s, at {self.place:.2f} m of the cable, "
            f"with {self.speed:.3g} m/s"
        )


@dataclass(frozen=True, slots=True)
class HaulRopeState:
    """The haul rope of one carriage, and the sheave that drives it."""

    travel: float  # m, arc length at which the carriage would be if the rope did not stretch
    speed: float  # m/s, of the rope at the sheave
    force: float  # N, of the rope on the carriage, along the cable


@dataclass(frozen=True, slots=True)
class Place:
    """A point of rope or vehicle, and its height above the ground."""

    height: float  # m, negative below the ground
    x: float  # m
    z: float  # m


@dataclass(frozen=True, slots=True)
class Clearance:
    """Least heights above the ground."""

    rope: Place  # the lowest of all
    vehicles: Mapping[str, Place]
    ropes: Mapping[str, Place]


@dataclass(frozen=True, slots=True)
class SupportState:
    """What holds the cable at one support."""

    force: FloatArray  # (3,) N, of the support on the cable
    tower: TowerState | None = None  # where it is a tower
    travel: float | None = None  # m, of a counterweight from its place in the scenario, in the direction of its pull


@dataclass(frozen=True, slots=True)
class CableSamples:
    """The cable at fixed arc lengths, dense enough to draw."""

    arc_lengths: FloatArray  # (n,) m, unstrained
    positions: FloatArray  # (n, 3) m
    tensions: FloatArray  # (n,) N


@dataclass(frozen=True, slots=True)
class SolverReport:
    """What the solver did since the snapshot before."""

    steps: int
    iterations: int  # Newton iterations, all steps together
    halvings: int  # steps that had to be retried in halves
    constraint_residual: float  # m, worst joint gap
    energy_lost: float = 0.0  # J, by the integrator itself, which no damper or friction has taken
    energy_moved: float = 0.0  # J, changes of kinetic energy from step to step, either way, added up


@dataclass(frozen=True, slots=True)
class Energy:
    """Mechanical energy of the cable and what is on it (J); gravitational energy is zero at z = 0."""

    kinetic: float
    elastic: float
    gravitational: float

    @property
    def total(self) -> float:
        """Sum of the three (J)."""
        return self.kinetic + self.elastic + self.gravitational
