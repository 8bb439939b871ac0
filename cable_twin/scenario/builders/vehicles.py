"""Constants of vehicles and haul ropes for the mechanics, built from a scenario."""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

import numpy as np

from cable_twin.mechanics import parameters
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario.builders import columns, floats
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.drives import Brake, Drive, HaulRope, Limits
from cable_twin.scenario.sections.vehicles import Body, Carriage, EndStop, Friction, VehicleBuffer

PRESLIDING = 1e-3  # m, elastic displacement of a joint with rolling friction before it slides
DEFAULT_STROKE = 0.005  # of the cable's length
NO_BRAKE = Brake.model_construct(force=0.0, rise_time=0.0)
NO_HAUL_ROPE = HaulRope.model_construct(
    axial_stiffness=0.0, mass_per_length=0.0, damping_ratio=0.0, station="start", beyond_track=1.0, drive_inertia=0.0
)
BRAKES = ("service_brake", "emergency_brake", "track_rope_brake")  # in the columns of `parameters`
BUFFER_DEPTH = 0.2  # m, compression of a buffer between vehicles at the speed limit; assumed
USED_STROKE = 0.6  # of the stroke, to stop the carriage at the reference speed without damping


def stop_stroke(scenario: Scenario, carriage: Carriage) -> float:
    """Length (m) of the end stops of a carriage, 0.5 % of the cable's length by default; 0 for a clamped carriage."""
    if carriage.joint == "clamped" or scenario.riding is not None:
        return 0.0
    given = carriage.end_stop.stroke
    return DEFAULT_STROKE * scenario.cable.unstrained_length if given is None else given


def end_stop(scenario: Scenario, carriage: Carriage) -> tuple[float, float, float]:
    """Stroke (m), stiffness (N/m) and damping (s/m) of the end stops of a carriage.

    Defaults follow from the reference speed v: the drive's limit, or sqrt(g L) / 2 without one. The stiffness stops
    the whole carriage from v within 60 % of the stroke, and holds its whole weight there as well, which counts only
    for slow drives; the damping is 0.5 / v. Vehicles that are clamped to a moving cable have no end stops.
    """
    if carriage.joint == "clamped" or scenario.riding is not None:
        return 0.0, 0.0, 0.0
    stroke = stop_stroke(scenario, carriage)
    return stroke, *_buffer(scenario, carriage, carriage.end_stop, USED_STROKE * stroke)


def vehicle_buffer(scenario: Scenario, carriage: Carriage, length: float) -> tuple[float, float]:
    """Stiffness (N/m) and damping (s/m) of the buffer of a carriage of a `length` (m) against others.

    Defaults are those of end stops; a vehicle without length has an infinite stiffness, in series with the other one.
    """
    if length == 0.0 and carriage.buffers.stiffness is None:
        return inf, 0.0
    return _buffer(scenario, carriage, carriage.buffers, min(BUFFER_DEPTH, length / 4.0) or BUFFER_DEPTH)


def _buffer(scenario: Scenario, carriage: Carriage, given: EndStop | VehicleBuffer, used: float) -> tuple[float, float]:
    """Stiffness (N/m) and damping (s/m) of a buffer; by default it stops the loaded carriage within `used` (m)."""
    speed = carriage.drive.limits.speed
    if speed is None:
        speed = 0.5 * sqrt(scenario.gravity * scenario.cable.unstrained_length) or 1.0
    mass = sum(body.mass for body in carriage.bodies.values())
    if carriage.payload is not None:
        mass += carriage.payload.capacity
    least = mass * max(speed**2 / used**2, scenario.gravity / used)
    stiffness = least if given.stiffness is None else given.stiffness
    return stiffness, 0.5 / speed if given.damping is None else given.damping


def build_carriages(scenario: Scenario) -> parameters.Carriages:
    """Build all vehicles: the carriages of the file, then the carriers."""
    record, dim = parameters.Carriages, scenario.dim
    carriages = list(scenario.vehicles.values())
    bodies = [body for carriage in carriages for body in carriage.bodies.values()]
    drives = [carriage.drive for carriage in carriages]
    limits = [drive.limits for drive in drives]
    stops = floats([end_stop(scenario, carriage) for carriage in carriages], 3)
    rails = 0.0 if scenario.carriers is None else scenario.carriers.station_rails
    brakes = columns(record, Brake, [brake for drive in drives for brake in _brakes(drive)], "brake_{}")
    copied = {
        **columns(record, Body, bodies, "hinge_{}"),
        **columns(record, Friction, [carriage.friction for carriage in carriages], "{}_friction"),
        **{name: column.reshape(-1, len(BRAKES)) for name, column in brakes.items()},
    }
    own: dict[str, Any] = {
        "body_offset": np.cumsum([0, *(len(carriage.bodies) for carriage in carriages)], dtype=np.int64),
        "inertia": _inertias(scenario, bodies),
        "upper_pivot": floats([scenario.vector(body.upper_pivot) for body in bodies], dim),
        "lower_pivot": floats([scenario.vector(body.lower_pivot or (0.0, 0.0)) for body in bodies], dim),
        "held": np.array(_held(scenario), dtype=np.int64),
        "centre_offset": np.zeros((len(bodies), dim)),
        "fixed": np.array([carriage.joint == "fixed" for carriage in carriages], dtype=np.bool_),
        "clamped": np.array([carriage.joint == "clamped" for carriage in carriages], dtype=np.bool_),
        "loop_place": floats([carriage.arc_length for carriage in carriages]),
        "rails": floats([rails * (carriage.joint == "clamped") for carriage in carriages]),
        "presliding": np.full(len(carriages), PRESLIDING),
        "limits": build_limits(limits),
        "drive_stops": np.array(["drive" in drive.emergency_stop for drive in drives], dtype=np.bool_),
        "stop_stroke": stops[:, 0].copy(),
        "stop_stiffness": stops[:, 1].copy(),
        "stop_damping": stops[:, 2].copy(),
    }
    return record(**(copied | own))


def build_limits(limits: list[Limits]) -> parameters.DriveLimits:
    """Build the limits of drives; a service stop decelerates as the drive accelerates by default."""
    given = columns(parameters.DriveLimits, Limits, limits)
    slowing = floats([limit.service_deceleration for limit in limits])
    return parameters.DriveLimits(**given | {"deceleration": slowing})


def _inertias(scenario: Scenario, bodies: list[Body]) -> FloatArray:
    """Inertias (bodies,) in kg m² about y, or in space tensors (bodies, 9) in the axes of each body."""
    if scenario.dim == 2:
        return floats([body.inertia for body in bodies])
    return np.array([inertia_tensor(body) for body in bodies]).reshape(-1, 9)


def inertia_tensor(body: Body) -> FloatArray:
    """Tensor (3, 3) in kg m² of a body in space."""
    xx, yy, zz, xy, xz, yz = [*(body.inertia_tensor or (body.inertia,) * 3), 0.0, 0.0, 0.0][:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _held(scenario: Scenario) -> list[int]:
    """Number of angles constrained by each body's upper joint: none in a plane; in space yaw, and roll at a hinge."""
    found = []
    for carriage in scenario.vehicles.values():
        for number, body in enumerate(carriage.bodies.values()):
            found.append(0 if scenario.dim == 2 else 2 if number > 0 and body.turns == "revolute" else 1)
    return found


def _brakes(drive: Drive) -> list[Brake]:
    """All kinds of brakes of a drive in fixed order, those not applied by an emergency stop replaced by `NO_BRAKE`."""
    applied = [getattr(drive, name) if name in drive.emergency_stop else None for name in BRAKES]
    return [brake or NO_BRAKE for brake in applied]


def build_haul_ropes(scenario: Scenario) -> parameters.HaulRopes:
    """Build the haul rope of each carriage; stiffness 0 without one."""
    ropes = [carriage.drive.haul_rope or NO_HAUL_ROPE for carriage in scenario.vehicles.values()]
    stations = {"start": parameters.START, "end": parameters.END}
    return parameters.HaulRopes(
        **columns(parameters.HaulRopes, HaulRope, ropes),
        station=np.array([stations[rope.station] for rope in ropes], dtype=np.int64),
        present=any(rope is not NO_HAUL_ROPE for rope in ropes),
    )
