"""Text messages: the scenario, and statuses for people: diagnostics, refused commands, derailments."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.records import RefusedCommand
from cable_twin.frame.snapshot import Columns, Layout, Snapshot, derailments
from cable_twin.messages.cdr import decode, header, serialize
from cable_twin.messages.topics import DERAILMENTS, DiagnosticArray, String

DiagnosticStatus = ros2_jazzy.diagnostic_msgs__msg__DiagnosticStatus
KeyValue = ros2_jazzy.diagnostic_msgs__msg__KeyValue

WARNING, ERROR = 1, 2  # levels of a status
COUNT = "refused"  # commands of the run so far, this one included


def scenario_message(scenario: Mapping[str, Any]) -> bytes:
    """Encode the whole resolved scenario as JSON text in a std_msgs/String."""
    return serialize(String(json.dumps(scenario, ensure_ascii=False)))


def scenario_from_message(data: bytes) -> dict[str, Any]:
    """Decode the scenario from its std_msgs/String; raises ValueError where the text is not a JSON object."""
    scenario = json.loads(decode(data, String.__msgtype__).data)
    if not isinstance(scenario, dict):
        msg = "scenario: not a JSON object"
        raise ValueError(msg)
    return scenario


def readmitted_message(sensor: str) -> bytes:
    """Encode the name of a sensor that counts again, as somebody has asked for, in a std_msgs/String."""
    return serialize(String(sensor))


def readmitted_from_message(data: bytes) -> str:
    """Decode the name of a sensor that counts again; inverse of `readmitted_message`."""
    return str(decode(data, String.__msgtype__).data)


@dataclass(frozen=True, slots=True)
class Status:
    """Status in a diagnostics message: level, name, text and values."""

    level: int  # 0 ok, 1 warning, 2 error, 3 stale
    name: str  # of the diagnosed task
    message: str  # one line for people
    values: Mapping[str, str]  # key figures, as text
    hardware_id: str = ""  # of one among several


def diagnostics_message(stamp_ns: int, *statuses: Status) -> bytes:
    """Encode a diagnostic_msgs/DiagnosticArray with a stamp in ns."""
    array = [
        DiagnosticStatus(
            status.level,
            status.name,
            status.message,
            status.hardware_id,
            [KeyValue(key, value) for key, value in status.values.items()],
        )
        for status in statuses
    ]
    return serialize(DiagnosticArray(header(stamp_ns, ""), array))


def statuses_of_message(data: bytes) -> list[Status]:
    """Decode the statuses of a diagnostic_msgs/DiagnosticArray."""
    return [
        Status(status.level, status.name, status.message, {pair.key: pair.value for pair in status.values})
        for status in decode(data, DiagnosticArray.__msgtype__).status
    ]


def refused_command_message(refused: RefusedCommand, stamp_ns: int) -> bytes:
    """Encode a refused command as diagnostic_msgs/DiagnosticArray with a stamp (ns)."""
    return diagnostics_message(stamp_ns, Status(WARNING, refused.source, refused.reason, {COUNT: str(refused.count)}))


def refused_command_from_message(data: bytes, time: float) -> RefusedCommand:
    """Decode a refused command at a simulated time (s), inverse of `refused_command_message`.

    Raises:
        ValueError, KeyError: the message is not of a refused command.
    """
    (status,) = statuses_of_message(data)
    return RefusedCommand(time, status.name, status.message, int(status.values[COUNT]))


class DerailmentMessage:
    """Message of derailments, filled from the columns of a frame: a status for each tower without its rope.

    Args:
        layout: of the frame.
        columns: of the frame, filled in before each call.
    """

    def __init__(self, layout: Layout, columns: Columns) -> None:
        self._layout, self._columns = layout, columns

    def fill(self, stamp_ns: int) -> bytes:
        """Encode the derailments of the present frame with a stamp (ns)."""
        statuses = []
        for one in derailments(self._layout, self._columns):
            values = {"how": one.how, "time_s": repr(one.time)}
            values |= {} if one.ratio is None else {"ratio": repr(one.ratio)}
            values |= {f"{axis}_m": repr(float(place)) for axis, place in zip("xyz", one.position, strict=True)}
            statuses.append(Status(ERROR, one.tower, str(one), values))
        return diagnostics_message(stamp_ns, *statuses)


class DerailmentWatch:
    """Schedule of the derailment message: due at each change of the derailed towers."""

    def __init__(self) -> None:
        self._told: list[tuple[str, float]] = []

    def due(self, snapshot: Snapshot, *, everything: bool = False) -> tuple[str, ...]:
        """Topics due: `derailments` after a change, and at the start of a file with any derailed tower; else none."""
        found = [(one.tower, one.time) for one in snapshot.derailments]
        if found == self._told and not (everything and found):
            return ()
        self._told = found
        return (DERAILMENTS,)
