"""Table of the quantities of a plant: topics, message fields, and units with their conversion to SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

JOINTS, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"
IMU, VECTOR = "sensor_msgs/msg/Imu", "geometry_msgs/msg/Vector3Stamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"
STANDARD_GRAVITY = 9.80665  # m/s^2, exact
XYZ = ("x", "y", "z")

# factor and offset to SI: value * factor + offset
UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "m": {"m": (1.0, 0.0), "mm": (1e-3, 0.0), "cm": (1e-2, 0.0), "km": (1e3, 0.0), "ft": (0.3048, 0.0)},
    "m/s": {
        "m/s": (1.0, 0.0),
        "mm/s": (1e-3, 0.0),
        "m/min": (1.0 / 60.0, 0.0),
        "km/h": (1.0 / 3.6, 0.0),
        "ft/min": (0.3048 / 60.0, 0.0),
        "kn": (1852.0 / 3600.0, 0.0),
    },
    "N": {
        "N": (1.0, 0.0),
        "daN": (10.0, 0.0),
        "kN": (1e3, 0.0),
        "MN": (1e6, 0.0),
        "kgf": (STANDARD_GRAVITY, 0.0),
        "tf": (1e3 * STANDARD_GRAVITY, 0.0),
        "lbf": (4.4482216152605, 0.0),
    },
    "N m": {"N m": (1.0, 0.0), "kN m": (1e3, 0.0)},
    "Pa": {"Pa": (1.0, 0.0), "kPa": (1e3, 0.0), "bar": (1e5, 0.0), "MPa": (1e6, 0.0)},
    "kg": {"kg": (1.0, 0.0), "t": (1e3, 0.0)},
    "rad": {"rad": (1.0, 0.0), "mrad": (1e-3, 0.0), "deg": (math.pi / 180.0, 0.0)},
    "rad/s": {"rad/s": (1.0, 0.0), "deg/s": (math.pi / 180.0, 0.0)},
    "m/s^2": {"m/s^2": (1.0, 0.0), "g": (STANDARD_GRAVITY, 0.0)},
    "degC": {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5.0 / 9.0, -160.0 / 9.0)},
}
HINTS = {  # words for what stands for two units, or is written otherwise
    "lb": "a mass or a force; as a force lbf",
    "lbs": "a mass or a force; as a force lbf",
    "Nm": "written N m",
    "kNm": "written kN m",
    "°": "written deg",
    "°C": "written degC",
    "C": "written degC",
    "F": "written degF",
    "kph": "written km/h",
    "kmh": "written km/h",
    "knots": "written kn",
    "feet": "written ft",
    "fpm": "written ft/min",
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """Measured quantity of a plant: meaning, unit, and its place in a ROS message.

    Attributes:
        help: meaning.
        unit: SI unit on the topic.
        topic: below the namespace of a plant, with OF for the measured object.
        message: type of the ROS message.
        part: part of the message: a field of a JointState, or a vector, or a scalar.
        of: kind of the measured object: driven (vehicle or drive), vehicle, body, support, wheel, place, or empty.
        axes: axes of a vector.
        default_axis: axis of a tag that gives none; empty where a tag has to give one.
        lead: whether its samples make a message; samples of others go along with the next message.
    """

    help: str
    unit: str
    topic: str
    message: str
    part: str
    of: str = ""
    axes: tuple[str, ...] = ()
    default_axis: str = ""
    lead: bool = True


QUANTITIES: Mapping[str, Quantity] = {
    "position": Quantity("place along the rope, or rope travel", "m", "joint_states", JOINTS, "position", "driven"),
    "speed": Quantity("speed along the rope", "m/s", "joint_states", JOINTS, "velocity", "driven", lead=False),
    "drive_force": Quantity(
        "force of a drive at the rope, from a torque with `radius`", "N", "joint_states", JOINTS, "effort", "driven"
    ),
    "support_force": Quantity(
        "force of a support on the rope, from a pressure with `area`",
        "N",
        "supports/OF/force",
        WRENCH,
        "force",
        "support",
        XYZ,
        "z",
    ),
    "pitch": Quantity("pitch of a body", "rad", "inclinometer/OF", IMU, "pitch", "body"),
    "roll": Quantity("roll of a body, across the track", "rad", "inclinometer/OF/roll", IMU, "roll", "body"),
    "angular_velocity": Quantity("angular velocity", "rad/s", "imu/OF", IMU, "angular_velocity", "body", XYZ),
    "acceleration": Quantity(
        "acceleration minus gravity, in the axes of the body", "m/s^2", "imu/OF", IMU, "acceleration", "body", XYZ
    ),
    "wind": Quantity(
        "wind along the track (x), to its left (y), upwards (z)", "m/s", "wind", VECTOR, "wind", "place", XYZ
    ),
    "wind_speed": Quantity("horizontal wind, with `wind_direction`", "m/s", "wind", VECTOR, "wind_speed", "place"),
    "wind_direction": Quantity(
        "direction from which the wind blows, clockwise from north",
        "rad",
        "wind",
        VECTOR,
        "wind_direction",
        "place",
        lead=False,
    ),
    "payload": Quantity("payload by weighing", "kg", "payload", JOINTS, "effort", "vehicle"),
    "wheel_travel": Quantity("rope travel over a bullwheel", "m", "sheaves", JOINTS, "position", "wheel"),
    "wheel_speed": Quantity("rope speed over a bullwheel", "m/s", "sheaves", JOINTS, "velocity", "wheel"),
    "wheel_force": Quantity(
        "force of a bullwheel's drive at the rim, from a torque with `radius`",
        "N",
        "sheaves",
        JOINTS,
        "effort",
        "wheel",
    ),
    "temperature": Quantity("temperature of the ropes", "degC", "temperature", TEMPERATURE, "temperature"),
    "speed_command": Quantity("speed that a drive is commanded", "m/s", "joint_commands", JOINTS, "velocity", "driven"),
    "force_command": Quantity("force that a drive is commanded", "N", "joint_commands", JOINTS, "effort", "driven"),
}
POLAR = ("wind_speed", "wind_direction")
PER_LENGTH, PER_AREA = {"N": "N m"}, {"N": "Pa"}  # units that are a force with `radius` (m) and `area` (m^2)
RADIUS = ("drive_force", "wheel_force", "force_command")  # quantities that may come as a torque
AREA = ("support_force",)


def units_of(name: str) -> list[str]:
    """Units in which a tag may give a quantity."""
    unit = QUANTITIES[name].unit
    more = [*(UNITS["N m"] if name in RADIUS else ()), *(UNITS["Pa"] if name in AREA else ())]
    return [*UNITS[unit], *more]


def conversion(name: str, unit: str, radius: float | None = None, area: float | None = None) -> tuple[float, float]:
    """Factor and offset from a unit to the SI unit of a quantity.

    Args:
        name: name of the quantity.
        unit: one of `units_of`.
        radius: m, at which a torque acts.
        area: m^2, on which a pressure acts.
    """
    own = UNITS[QUANTITIES[name].unit]
    if unit in own:
        return own[unit]
    if unit in UNITS["N m"]:
        return UNITS["N m"][unit][0] / (radius or math.nan), 0.0
    return UNITS["Pa"][unit][0] * (area or math.nan), 0.0
