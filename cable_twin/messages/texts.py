"""Text messages: the scenario, and diagnostics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rosbags.typesys.stores import ros2_jazzy

from cable_twin.messages.cdr import decode, header, serialize
from cable_twin.messages.topics import DiagnosticArray, String

DiagnosticStatus = ros2_jazzy.diagnostic_msgs__msg__DiagnosticStatus
KeyValue = ros2_jazzy.diagnostic_msgs__msg__KeyValue


def scenario_message(scenario: Mapping[str, Any]) -> bytes:
    """Encode the whole resolved scenario as JSON text in a std_msgs/String."""
    return serialize(String(json.dumps(scenario, ensure_ascii=False)))


def scenario_from_message(data: bytes) -> dict[str, Any]:
    """Read the scenario from its message; raises ValueError where the text is not a JSON object."""
    scenario = json.loads(decode(data, String.__msgtype__).data)
    if not isinstance(scenario, dict):
        msg = "scenario: not a JSON object"
        raise ValueError(msg)
    return scenario


@dataclass(frozen=True, slots=True)
class Status:
    """One status of a diagnostics message."""

    level: int  # 0 ok, 1 warning, 2 error, 3 stale
    name: str  # what is diagnosed
    message: str  # one line for people
    values: Mapping[str, str]  # key figures, as text
    hardware_id: str = ""  # which of several


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
    """Read the statuses of a diagnostic_msgs/DiagnosticArray."""
    return [
        Status(status.level, status.name, status.message, {pair.key: pair.value for pair in status.values})
        for status in decode(data, DiagnosticArray.__msgtype__).status
    ]
