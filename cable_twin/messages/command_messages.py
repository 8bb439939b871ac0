"""Conversion of commands from ROS 2 messages, and of applied commands to messages and back, without rclpy."""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from cable_twin.basics.printable import printable
from cable_twin.frame.commands import INPUTS, JOINT_COMMANDS, JOINT_STATE, KINDS, TEMPERATURE, VECTOR, Kind, kinds_on
from cable_twin.frame.records import AppliedCommand, Command, CommandError, Goal
from cable_twin.messages import SECOND, JointState, decode, header, nanoseconds, serialize
from cable_twin.messages.topics import FRAME_ID

LONGEST_FRAME_ID = 256  # characters of the frame of a command, which means nothing here


def applied_command_message(applied: AppliedCommand, epoch_ns: int, frame_id: str = FRAME_ID) -> bytes:
    """Encode an applied command as sensor_msgs/JointState.

    The stamp is the simulated time of effect. A name is KIND/NAME/SOURCE, with the name of a carriage or drive, or an
    axis, and has a number in the field of the kind in the table of kinds; or KIND/SOURCE for kinds without numbers.

    Args:
        applied: The command; its time to the nanosecond.
        epoch_ns: Wall time (ns since 1970) of simulated time zero.
        frame_id: Name of the fixed frame, of which a wind has its axes.

    Returns:
        CDR, from which `applied_command_from_message` gives the same record.
    """
    command = applied.command
    fields = {"position": np.empty(0), "velocity": np.empty(0), "effort": np.empty(0)}
    if field := KINDS[command.kind].field:
        fields[field] = np.array([*command.values.values()], dtype=np.float64)
    names = [f"{command.kind}/{name}/{applied.source}" for name in command.values]
    names = names or [f"{command.kind}/{applied.source}"]
    return serialize(JointState(header(epoch_ns + nanoseconds(applied.time), frame_id), names, **fields))


def applied_command_from_message(data: bytes, epoch_ns: int = 0) -> AppliedCommand:
    """Decode an applied command, inverse of `applied_command_message`.

    Args:
        data: CDR of the message.
        epoch_ns: Wall time (ns since 1970) of simulated time zero, as when it was encoded.

    Returns:
        The command; its time is the double nearest to the whole number of nanoseconds.

    Raises:
        ValueError: The message is no applied command.
    """
    message = decode(data, JointState.__msgtype__)
    kind, names, source = _parts(message)
    field = KINDS[kind].field
    given = getattr(message, field) if field else ()
    values = dict(zip(names, map(float, given), strict=True))
    stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
    return AppliedCommand((stamp - epoch_ns) / SECOND, Command(kind, values), source)


def _parts(message: Any) -> tuple[str, list[str], str]:
    """Kind, names and source of an applied command; raises ValueError for an invalid message."""
    kind = message.name[0].partition("/")[0] if message.name else ""
    parts = [name.split("/", 2 if kind in KINDS and KINDS[kind].field else 1) for name in message.name]
    if kind not in KINDS or any(part[0] != kind or len(part) != (3 if KINDS[kind].field else 2) for part in parts):
        allowed = f"KIND/NAME/SOURCE with a KIND of {', '.join(KINDS)}"
        raise ValueError(f"applied command: given '{printable(', '.join(message.name))}'; allowed: {allowed}")
    return kind, [part[1] for part in parts if len(part) > 2], parts[0][-1]


def command_from_message(topic: str, data: bytes, most_names: int | None = None) -> Command | Goal:
    """Decode a message of a command topic into a command; the simulation checks it against the present state.

    Args:
        topic: Relative name, a key of `cable_twin.frame.commands.INPUTS`.
        data: CDR.
        most_names: Highest number of names, checked before decoding; None for any number.

    Raises:
        CommandError: The message is not of the topic's type, has too many names, or has no clear meaning.
    """
    try:
        _check_counts(INPUTS[topic], data, most_names)
        message: Any = decode(data, INPUTS[topic])
        if INPUTS[topic] == VECTOR:
            return command_from_vector(topic, message.vector.x, message.vector.y, message.vector.z)
        if INPUTS[topic] == TEMPERATURE:
            return Command("temperature", {"ropes": float(message.temperature)})
        return command_from_joint_state(topic, message.name, message.position, message.velocity, message.effort)
    except CommandError:
        raise
    except Exception as error:  # nothing that arrives on a topic ends the node
        raise CommandError(f"not a {INPUTS[topic].rpartition('/')[2]}: {printable(error)}") from error


def _check_counts(message_type: str, data: bytes, most_names: int | None) -> None:
    """Refuse a command message with a too long frame_id or too many names, by counts read before decoding.

    Raises:
        CommandError: The name of the message's frame is too long, or it has too many names.
        struct.error: The message ends before its counts.
    """
    order = "<" if data[1] & 1 else ">"  # bytes 0 to 3: the encapsulation; 4 to 11: the stamp
    length = struct.unpack_from(f"{order}I", data, 12)[0]  # of the frame and a zero
    if length > LONGEST_FRAME_ID + 1:
        raise CommandError(f"frame_id: given {length - 1} bytes; allowed: up to {LONGEST_FRAME_ID}")
    if message_type != JOINT_STATE or most_names is None:
        return
    place = 16 + length
    count = struct.unpack_from(f"{order}I", data, place + -place % 4)[0]
    if count > most_names:
        raise CommandError(f"names: given {count}; allowed: up to {most_names}, as many as there are joints")


def command_from_joint_state(
    topic: str,
    names: Sequence[str],
    position: Collection[float],
    velocity: Collection[float],
    effort: Collection[float],
) -> Command | Goal:
    """Convert a JointState of a command topic into a command; the simulation checks names and limits.

    Positions of joint commands are places to go to, with velocities as speed limits on the way.

    Joints without a command may be named as well, with NaN as their numbers, as a ros2_control hardware on topics
    does, which sends all of its joints.

    Args:
        topic: Relative name, which limits the kinds of command.
        names: Carriages or drives.
        position: A number for each name, or empty.
        velocity: A number for each name, or empty.
        effort: A number for each name, or empty.

    Raises:
        CommandError: The message has no clear meaning.
    """
    kinds = kinds_on(topic)
    names, fields = _commanded(names, {"position": position, "velocity": velocity, "effort": effort})
    if topic == JOINT_COMMANDS and len(fields["position"]):
        return _goal(names, fields)
    if len(kinds) == 1:
        (kind,) = kinds.values()
        what = kind.name.replace("_", " ")
        _check_fields(kind, what, len(names), fields)
    else:
        what = topic.removesuffix("s").replace("_", " ")
        kind = _kind_meant(kinds, what, len(names), fields)
    _check_once(what, names)
    values = dict(zip(names, map(float, fields[kind.field]), strict=True))
    for name, value in values.items():
        if not math.isfinite(value):
            raise CommandError(
                f"{what} {kind.field} of '{printable(name)}' is {value}; give a finite number ({kind.unit})"
            )
    return Command(kind.name, values)


def _goal(names: Sequence[str], fields: Mapping[str, Collection[float]]) -> Goal:
    """Make a goal from a JointState with places in `position` and speed limits in `velocity`."""
    if any(len(numbers) not in (0, len(names)) for numbers in fields.values()):
        counts = ", ".join(f"{len(numbers)} of {field}" for field, numbers in fields.items())
        raise CommandError(f"joint command with {len(names)} names and {counts}; give one value for each name")
    if len(fields["effort"]):
        raise CommandError("joint command with position and effort; give position (m), optionally with velocity (m/s)")
    _check_once("joint command", names)
    places = dict(zip(names, map(float, fields["position"]), strict=True))
    for name, place in places.items():
        if not math.isfinite(place):
            raise CommandError(f"joint command position of '{printable(name)}' is {place}; give a finite number (m)")
    at_most = dict(zip(names, map(float, fields["velocity"]), strict=False))
    return Goal(places, {name: abs(speed) for name, speed in at_most.items() if not math.isnan(speed)})


def _check_once(what: str, names: Sequence[str]) -> None:
    """Refuse a command message that names a carriage or drive more than once."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise CommandError(f"{what} names '{printable(name)}' more than once; name each one once")
        seen.add(name)


def _commanded(
    names: Sequence[str], fields: Mapping[str, Collection[float]]
) -> tuple[Sequence[str], Mapping[str, Collection[float]]]:
    """Drop names of a JointState whose numbers are all NaN, and fields without any other number."""
    given = {field: list(map(float, numbers)) for field, numbers in fields.items() if len(numbers)}
    if not names or any(len(numbers) != len(names) for numbers in given.values()):
        return names, fields
    rows = [row for row in range(len(names)) if any(not math.isnan(numbers[row]) for numbers in given.values())]
    if not rows:
        return names, fields
    kept = {
        field: [numbers[row] for row in rows]
        for field, numbers in given.items()
        if any(not math.isnan(number) for number in numbers)
    }
    return [names[row] for row in rows], {field: kept.get(field, []) for field in fields}


def _check_fields(kind: Kind, what: str, names: int, fields: Mapping[str, Collection[float]]) -> None:
    """Refuse a JointState without exactly one number for each name, in the field of its command kind."""
    counts = {field: len(numbers) for field, numbers in fields.items()}
    if not names or counts != {**dict.fromkeys(counts, 0), kind.field: names}:
        given = "{position} positions, {velocity} velocities and {effort} values of effort".format(**counts)
        wanted = f"give names, and {kind.field} as the {kind.quantity} ({kind.unit}) for each"
        raise CommandError(f"{what} with {names} names, {given}; {wanted}")


def _kind_meant(kinds: Mapping[str, Kind], what: str, names: int, fields: Mapping[str, Collection[float]]) -> Kind:
    """Kind of a joint command, by the message field that has one number for each name."""
    known = " or ".join([*(f"{field} ({kind.unit})" for field, kind in kinds.items()), "position (m)"])
    given = [field for field, numbers in fields.items() if len(numbers)]
    if not names:
        raise CommandError(f"{what} without names; name at least one carriage or drive")
    if len(given) != 1:
        which = f"both {' and '.join(given)}" if given else f"neither position, {' nor '.join(kinds)}"
        raise CommandError(f"{what} with {which}; give one of {known}")
    kind = kinds[given[0]]
    if len(fields[kind.field]) != names:
        counts = f"{names} names and {len(fields[kind.field])} values of {kind.field}"
        raise CommandError(f"{what} with {counts}; give one value ({kind.unit}) for each name")
    return kind


def command_from_vector(topic: str, x: float, y: float, z: float) -> Command:
    """Convert a vector of a command topic, such as a wind (m/s), into a command; the simulation checks the y axis."""
    (kind,) = kinds_on(topic).values()
    across = {"y": float(y)} if y != 0.0 else {}
    return Command(kind.name, {"x": float(x), "z": float(z), **across})
