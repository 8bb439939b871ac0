"""Drives and brakes of carriages and ropes in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cable_twin.scenario.sections.quantities import FromList, Section, Vector, quantity, strength


class Limits(Section):
    """Limits of a drive; null without a limit."""

    speed: float | None = quantity("m/s", "highest speed along the cable, in metres of unstrained rope", None, gt=0)
    acceleration: float = quantity("m/s^2", "highest acceleration", 0.5, gt=0)
    deceleration: float | None = quantity(
        "m/s^2",
        "deceleration of a service stop; null: as the acceleration",
        None,
        gt=0,
    )
    jerk: float | None = quantity("m/s^3", "highest rate of the acceleration", None, gt=0)
    force: float | None = quantity(
        "N",
        "highest force along the cable, or at the rim of a bullwheel; not in emergency stops",
        None,
        gt=0,
    )
    power: float | None = quantity(
        "W",
        "highest power, driving or braking: force times speed on the stretched rope; not in emergency stops",
        None,
        gt=0,
    )
    emergency_deceleration: float = quantity("m/s^2", "deceleration of an emergency stop", 1.5, gt=0)

    @property
    def service_deceleration(self) -> float:
        """Deceleration (m/s^2) of a service stop, by default as the acceleration."""
        return self.acceleration if self.deceleration is None else self.deceleration


class HaulRope(Section):
    """Haul rope between a drive in a station and a carriage."""

    axial_stiffness: float = quantity("N", "EA of the haul rope", gt=0)
    mass_per_length: float = quantity("kg/m", "mass per length of the haul rope", gt=0)
    breaking_force: float | None = strength("minimum")
    calculated_breaking_force: float | None = strength("calculated")
    tested_breaking_force: float | None = strength("tested")
    damping_ratio: float = quantity("-", "damping ratio of the carriage oscillating on the haul rope", 0.01, ge=0, le=1)
    station: Literal["start", "end"] = Field(default="end", description="end of the track with the drive sheave")
    beyond_track: float = quantity("m", "rope between the end of the track and the drive sheave", 10.0, gt=0)
    pretension: float = quantity(
        "N", "pull of the counter rope, up to which the loop can push the carriage; 0 without one", 0.0, ge=0
    )
    drive_inertia: float = quantity("kg", "mass of drive, drive sheave and counter rope, reduced to the rope", gt=0)


class Brake(Section):
    """Brake: holds up to its force and slips beyond."""

    force: float = quantity("N", "highest force along the rope", gt=0)
    rise_time: float = quantity("s", "time from the stop command to the highest force", 0.0, ge=0, le=60)


StopMeans = Literal["drive", "service_brake", "emergency_brake", "track_rope_brake"]


class Drive(Section):
    """Drive and brakes of a carriage along the cable."""

    mode: Literal["free", "speed", "force"] = Field(
        default="free", description="mode of the drive before the first command"
    )
    limits: Limits = Field(default_factory=Limits, description="limits of the drive")
    haul_rope: HaulRope | None = Field(
        default=None, description="haul rope between drive and carriage; null: the drive is on the carriage"
    )
    service_brake: Brake | None = Field(default=None, description="brake on the drive")
    emergency_brake: Brake | None = Field(default=None, description="second brake on the drive")
    track_rope_brake: Brake | None = Field(default=None, description="brake of the carriage on the cable")
    emergency_stop: Annotated[tuple[StopMeans, ...], FromList] = Field(
        default=("drive",), description="means of an emergency stop", min_length=1
    )


class DriveOfRope(Section):
    """Keys of all drives of ropes."""

    speed: float = quantity("m/s", "initial speed, kept until a command", 0.0)
    limits: Limits = Field(
        default_factory=Limits,
        description="limits of the drive; friction of the rope on its bullwheel limits its force as well",
    )
    travel: Vector | None = quantity(
        "m", "range of the rope travel from the start on, within which the drive of a bullwheel stops", None
    )


class RopeDrive(DriveOfRope):
    """Drive moving the cable along itself between its held ends; addressed by its name in commands."""

    kind: Literal["moving_cable"] = Field(description="kind of drive")
    sheave: str | None = Field(default=None, description="driven bullwheel, of several ropes")


class BullwheelDrive(DriveOfRope):
    """Drive of a bullwheel, written below the bullwheel in a file."""

    name: str | None = Field(default=None, description="name in commands; null: that of the bullwheel")
