"""Towers of which the rope has come out, as a message: all of them, whenever one more has or a reset lays it back."""

from __future__ import annotations

from cable_twin.messages.texts import Status, diagnostics_message, statuses_of_message
from cable_twin.messages.topics import DERAILMENTS
from cable_twin.records import FloatArray
from cable_twin.snapshot import DERAILED, Columns, Layout, Snapshot, derailments

ERROR = 2  # level of a status


class DerailmentMessage:
    """The message of what the columns of a frame show: a status for each tower that has lost its rope.

    Args:
        layout: of the frame.
        columns: which are filled in before each call.
    """

    def __init__(self, layout: Layout, columns: Columns) -> None:
        self._layout, self._columns = layout, columns

    def fill(self, stamp_ns: int) -> bytes:
        """The message with a stamp (ns)."""
        statuses = []
        for one in derailments(self._layout, self._columns):
            values = {"how": one.how, "time_s": repr(one.time)}
            values |= {} if one.ratio is None else {"ratio": repr(one.ratio)}
            values |= {f"{axis}_m": repr(float(place)) for axis, place in zip("xyz", one.position, strict=True)}
            statuses.append(Status(ERROR, one.tower, str(one), values))
        return diagnostics_message(stamp_ns, *statuses)


class DerailmentWatch:
    """Knows when there is something to tell."""

    def __init__(self) -> None:
        self._told: list[tuple[str, float]] = []

    def due(self, snapshot: Snapshot, *, everything: bool = False) -> tuple[str, ...]:
        """The topic where another tower has lost its rope, or got it back, or what there is for a new file."""
        found = [(one.tower, one.time) for one in snapshot.derailments]
        if found == self._told and not (everything and found):
            return ()
        self._told = found
        return (DERAILMENTS,)


def read_derailments(data: bytes, layout: Layout, derailed: FloatArray, times: FloatArray) -> None:
    """Fill `derailed` and `times` (s), both (supports,), of the towers in space from their message.

    Raises:
        ValueError, KeyError: it is of other towers, or not understood.
    """
    rows = [layout.support_rows[name] for name in layout.grooves]
    derailed[rows], times[rows] = 0.0, 0.0
    for status in statuses_of_message(data):
        row = layout.support_rows[status.name]
        derailed[row], times[row] = DERAILED.index(status.values["how"]), float(status.values["time_s"])


__all__ = ["DerailmentMessage", "DerailmentWatch", "read_derailments"]
