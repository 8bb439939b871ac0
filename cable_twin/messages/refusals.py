"""Message of refused commands: a status each with topic or source, reason in a line, and count so far."""

from __future__ import annotations

from cable_twin.frame.records import RefusedCommand
from cable_twin.messages.texts import Status, diagnostics_message, statuses_of_message

WARNING = 1  # level of a status
COUNT = "refused"  # commands of the run so far, this one included


def refused_command_message(refused: RefusedCommand, stamp_ns: int) -> bytes:
    """Encode a refused command as diagnostic_msgs/DiagnosticArray with a stamp (ns)."""
    return diagnostics_message(stamp_ns, Status(WARNING, refused.source, refused.reason, {COUNT: str(refused.count)}))


def refused_command_from_message(data: bytes, time: float) -> RefusedCommand:
    """Decode a refused command at a simulated time (s), inverse of `refused_command_message`.

    Raises:
        ValueError, KeyError: it is no such message.
    """
    (status,) = statuses_of_message(data)
    return RefusedCommand(time, status.name, status.message, int(status.values[COUNT]))


__all__ = ["refused_command_from_message", "refused_command_message"]
