"""Commands from ROS 2 messages, and as they took effect into messages and back: no rclpy."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import get_args

import numpy as np

from cable_twin.messages import SECOND, Header, JointState, decode, nanoseconds, serialize, time_of
from cable_twin.records import AppliedCommand, Command, CommandError, CommandKind

UNITS = {"velocity": "m/s", "effort": "N"}
VALUE_FIELDS = {"speed": "velocity", "force": "effort", "payload": "effort", "wind": "velocity"}  # of applied commands


def applied_command_message(applied: AppliedCommand, epoch_ns: int) -> bytes:
    """Encode a command that took effect as sensor_msgs/JointState.

    The stamp is the simulated time of effect, the frame id "KIND:SOURCE"; by name velocity (m/s) for `speed` and
    `wind`, effort for `force` (N) and `payload` (kg), nothing for the other kinds.

    Args:
        applied: The command; its time to the nanosecond.
        epoch_ns: Wall time (ns since 1970) of simulated time zero.

    Returns:
        CDR, from which `applied_command_from_message` gives the same record.
    """
    command = applied.command
    values = np.array([*command.values.values()], dtype=np.float64)
    nothing = np.empty(0)
    stamp = time_of(epoch_ns + nanoseconds(applied.time))
    header = Header(stamp, f"{command.kind}:{applied.source}")
    field = VALUE_FIELDS.get(command.kind)
    velocity = values if field == "velocity" else nothing
    effort = values if field == "effort" else nothing
    return serialize(JointState(header, [*command.values], nothing, velocity, effort))


def applied_command_from_message(data: bytes, epoch_ns: int) -> AppliedCommand:
    """Invert `applied_command_message`.

    Args:
        data: CDR of the message.
        epoch_ns: Wall time (ns since 1970) of simulated time zero, as when it was encoded.

    Returns:
        The command; its time is the double nearest to the whole number of nanoseconds.

    Raises:
        ValueError: The message is no applied command.
    """
    message = decode(data, JointState.__msgtype__)
    kind, colon, source = message.header.frame_id.partition(":")
    if not colon or kind not in get_args(CommandKind):
        msg = f"applied command {message.header.frame_id!r}; KIND:SOURCE with one of {', '.join(get_args(CommandKind))}"
        raise ValueError(msg)
    given = getattr(message, VALUE_FIELDS[kind]) if kind in VALUE_FIELDS else ()
    values = dict(zip(message.name, map(float, given), strict=True))
    stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
    return AppliedCommand((stamp - epoch_ns) / SECOND, Command(kind, values), source)


def command_from_joint_state(
    names: Sequence[str], position: Collection[float], velocity: Collection[float], effort: Collection[float]
) -> Command:
    """Understand a joint command; whether names and limits fit is for the simulation to say.

    Args:
        names: Carriages or drives.
        position: Has to be empty: the twin does not take positions.
        velocity: m/s for each name, or empty.
        effort: N for each name, or empty.

    Returns:
        A command of kind `speed` or `force`.

    Raises:
        CommandError: What was given has no clear meaning.
    """
    if not len(names):
        msg = "joint command without names; name at least one carriage or drive"
        raise CommandError(msg)
    if len(position):
        msg = (
            f"joint command with {len(position)} positions; give velocity (m/s) or effort (N), positions are not taken"
        )
        raise CommandError(msg)
    if bool(len(velocity)) == bool(len(effort)):
        given = "both velocity and effort" if len(velocity) else "neither velocity nor effort"
        msg = f"joint command with {given}; give one of them, velocity (m/s) or effort (N)"
        raise CommandError(msg)
    field, numbers = ("velocity", velocity) if len(velocity) else ("effort", effort)
    if len(numbers) != len(names):
        counts = f"{len(names)} names and {len(numbers)} values of {field}"
        msg = f"joint command with {counts}; give one value ({UNITS[field]}) for each name"
        raise CommandError(msg)
    values = dict(zip(names, map(float, numbers), strict=True))
    if len(values) != len(names):
        twice = next(name for name in names if list(names).count(name) > 1)
        msg = f"joint command names {twice!r} more than once; name each one once"
        raise CommandError(msg)
    for name, value in values.items():
        if not math.isfinite(value):
            msg = f"joint command {field} of {name!r} is {value}; give a finite number ({UNITS[field]})"
            raise CommandError(msg)
    return Command("speed" if field == "velocity" else "force", values)


def payload_from_joint_state(
    names: Sequence[str], position: Collection[float], velocity: Collection[float], effort: Collection[float]
) -> Command:
    """Understand a payload; whether a carriage can take it now is for the simulation to say.

    Args:
        names: Carriages.
        position: Has to be empty.
        velocity: Has to be empty.
        effort: kg for each name.

    Raises:
        CommandError: What was given has no clear meaning.
    """
    if not len(names) or len(position) or len(velocity) or len(effort) != len(names):
        msg = (
            f"payload with {len(names)} names, {len(position)} positions, {len(velocity)} velocities and "
            f"{len(effort)} values of effort; give names, and effort as the mass (kg) for each"
        )
        raise CommandError(msg)
    return Command("payload", command_from_joint_state(names, position, velocity, effort).values)


def wind_from_vector(x: float, y: float, z: float) -> Command:
    """Understand a wind (m/s).

    Raises:
        CommandError: It blows across the track, where nothing can move.
    """
    if y != 0.0:
        msg = f"wind y is {y:g} m/s; allowed is 0: the twin moves in the plane of the track, x and z"
        raise CommandError(msg)
    return Command("wind", {"x": float(x), "z": float(z)})
