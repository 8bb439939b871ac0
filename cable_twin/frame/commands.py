"""Table of command kinds: quantities, topics, services and message fields of each.

Node, terminal, scripts, bags and replay read this table. What a kind does to the twin stands in
`cable_twin.simulation.command_handlers`: a new kind is a row here and a handler there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from cable_twin.frame.records import AppliedCommand

JOINT_COMMANDS = "joint_commands"
JOINT_STATE, VECTOR = "sensor_msgs/msg/JointState", "geometry_msgs/msg/Vector3Stamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of command, such as speed, wind or reset: quantity with unit and axes, topic or service, and message fields.

    Attributes:
        name: in records, bags and scripts.
        help: description of the command for users.
        quantity: quantity of its numbers; empty without numbers.
        unit: of its numbers.
        axes: names of its numbers, x, y, z or others, where it has them by axis and not by carriage or drive.
        needed: axes that the command always has, 0 where not given.
        topic: name of its topic, below the node; kinds of one topic differ by their field.
        message: type of the messages of that topic.
        field: of sensor_msgs/JointState with its numbers: on its topic, where they are by name, and in the bag.
        service: name of its service, below the node, where it has no numbers.
        switch: boolean in the call of a std_srvs/SetBool service; None for std_srvs/Trigger.
        done: answer of the service.
        drives: whether it moves carriages or drives: ends at the node's time-out, refused in an emergency stop.
        halts: whether it ends all motions commanded before.
        level: severity of its line in the view.
        units: units by axis, where they differ from `unit`.
    """

    name: str
    help: str
    quantity: str = ""
    unit: str = ""
    axes: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()
    topic: str = ""
    message: str = JOINT_STATE
    field: Literal["position", "velocity", "effort", ""] = ""
    service: str = ""
    switch: bool | None = None
    done: str = ""
    drives: bool = False
    halts: bool = False
    level: Literal["INFO", "WARN", "ERROR"] = "INFO"
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def unit_of(self, name: str) -> str:
        """Unit of a command's value for a carriage, drive or axis, by name."""
        return self.units.get(name, self.unit)

    def by_axis(self, given: Mapping[str, float]) -> dict[str, float]:
        """Complete a command's values by axis with 0 for each required axis without a value."""
        return dict.fromkeys(self.needed, 0.0) | dict(given)

    @property
    def keys(self) -> Mapping[str, str]:
        """Keys of a command's values in a script, by axis: as `wind` for the first axis, then `wind_z`, `wind_y`."""
        return {axis: f"{self.name}_{axis}" if number else self.name for number, axis in enumerate(self.axes or ("",))}


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "speed",
            "drive at this speed along the rope",
            quantity="speed",
            unit="m/s",
            topic=JOINT_COMMANDS,
            field="velocity",
            drives=True,
        ),
        Kind(
            "force",
            "drive with this force along the rope",
            quantity="force",
            unit="N",
            topic=JOINT_COMMANDS,
            field="effort",
            drives=True,
        ),
        Kind(
            "payload",
            "set the payload of a carriage that stands in a station",
            quantity="mass",
            unit="kg",
            topic="payload",
            field="effort",
        ),
        Kind(
            "wind",
            "set the wind: along the track, then upwards, then (in space) to the left; it holds until the next one",
            quantity="speed",
            unit="m/s",
            axes=("x", "z", "y"),
            needed=("x", "z"),
            topic="wind",
            message=VECTOR,
            field="velocity",
        ),
        Kind(
            "temperature",
            "set the temperature of all ropes, which get longer or tighter by it; it holds until the next one",
            quantity="temperature",
            unit="degC",
            axes=("ropes",),
            topic="temperature",
            message=TEMPERATURE,
            field="effort",
        ),
        Kind(
            "gust",
            "a gust in the shape of one minus cosine (CS-25.341): peak by axis as for wind, and its duration",
            quantity="speed",
            unit="m/s",
            axes=("x", "z", "y", "duration"),
            needed=("x", "z"),
            units={"duration": "s"},
            field="velocity",
        ),
        Kind(
            "operating_gust",
            "an extreme operating gust (IEC 61400-1), with a dip before and after its peak: peak by "
            "axis, and its duration",
            quantity="speed",
            unit="m/s",
            axes=("x", "z", "y", "duration"),
            needed=("x", "z"),
            units={"duration": "s"},
            field="velocity",
        ),
        Kind(
            "emergency_stop",
            "stop all drives at once, and refuse to drive until the stop is released",
            service="emergency_stop",
            switch=True,
            done="emergency stop",
            halts=True,
            level="ERROR",
        ),
        Kind(
            "release",
            "release the emergency stop",
            service="emergency_stop",
            switch=False,
            done="emergency stop released",
            level="WARN",
        ),
        Kind(
            "reset",
            "put the twin back into its state at the start; time goes on",
            service="reset",
            done="state put back to the start",
            halts=True,
            level="WARN",
        ),
    )
}


# type of the message of each topic that brings commands
INPUTS: Mapping[str, str] = {kind.topic: kind.message for kind in KINDS.values() if kind.topic}


def kinds_on(topic: str) -> dict[str, Kind]:
    """Command kinds that a topic accepts, by message field."""
    return {kind.field: kind for kind in KINDS.values() if kind.topic == topic}


def kinds_by_service() -> dict[str, dict[bool | None, Kind]]:
    """Command kinds of services, by service and by the boolean of the request."""
    services: dict[str, dict[bool | None, Kind]] = {}
    for kind in KINDS.values():
        if kind.service:
            services.setdefault(kind.service, {})[kind.switch] = kind
    return services


def describe_command(applied: AppliedCommand) -> str:
    """Describe an applied command in one line: kind, names and values with unit, source."""
    command = applied.command
    unit_of = KINDS[command.kind].unit_of
    values = ", ".join(f"{name} {value:g} {unit_of(name)}" for name, value in command.values.items())
    kind = command.kind.replace("_", " ")
    return f"{kind} {values} ({applied.source})" if values else f"{kind} ({applied.source})"


__all__ = [
    "INPUTS",
    "JOINT_COMMANDS",
    "JOINT_STATE",
    "KINDS",
    "TEMPERATURE",
    "VECTOR",
    "Kind",
    "describe_command",
    "kinds_by_service",
    "kinds_on",
]
