"""Message of derailments: all towers without their rope, sent at each new derailment and after a reset."""

from __future__ import annotations

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import DERAILED, Columns, Layout, Snapshot, derailments
from cable_twin.messages.texts import Status, diagnostics_message, statuses_of_message
from cable_twin.messages.topics import DERAILMENTS

ERROR = 2  # level of a status


class DerailmentMessage:
    """Message of derailments, filled from the columns of a frame: a status for each tower without its rope.

    Args:
        layout: of the frame.
        columns: which are filled in before each call.
    """

    def __init__(self, layout: Layout, columns: Columns) -> None:
        self._layout, self._columns = layout, columns

    def fill(self, stamp_ns: int) -> bytes:
        """Encoded message with a stamp (ns)."""
        statuses = []
        for one in derailments(self._layout, self._columns):
            values = {"how": one.how, "time_s": repr(one.time)}
            values |= {} if one.ratio is None else {"ratio": repr(one.ratio)}
            values |= {f"{axis}_m": repr(float(place)) for axis, place in zip("xyz", one.position, strict=True)}
            statuses.append(Status(ERROR, one.tower, str(one), values))
        return diagnostics_message(stamp_ns, *statuses)


class DerailmentWatch:
    """Watch for changes of the derailed towers."""

    def __init__(self) -> None:
        self._told: list[tuple[str, float]] = []

    def due(self, snapshot: Snapshot, *, everything: bool = False) -> tuple[str, ...]:
        """Topic `derailments` after a change of the derailed towers, or where any are for a new file; else empty."""
        found = [(one.tower, one.time) for one in snapshot.derailments]
        if found == self._told and not (everything and found):
            return ()
        self._told = found
        return (DERAILMENTS,)


def read_derailments(data: bytes, layout: Layout, derailed: FloatArray, times: FloatArray) -> None:
    """Fill `derailed` and `times` (s), both (supports,), of towers in space from a message of derailments.

    Raises:
        ValueError, KeyError: it is of other towers, or not understood.
    """
    rows = [layout.support_rows[name] for name in layout.grooves]
    derailed[rows], times[rows] = 0.0, 0.0
    for status in statuses_of_message(data):
        row = layout.support_rows[status.name]
        derailed[row], times[row] = DERAILED.index(status.values["how"]), float(status.values["time_s"])


__all__ = ["DerailmentMessage", "DerailmentWatch", "read_derailments"]
