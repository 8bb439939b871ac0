"""Message `sheaves` of bullwheels: rows with the rope, the drive, both strands and the tensioning of each.

NAME has the rope gone over it (m), its speed (m/s) and the force of its drive at the rim (N); NAME/on and NAME/off are
the strands that come to it and leave it, with their tensions (N) as effort, and on NAME/on how far its rim has gone
further than the rope (m); NAME/carriage, where something tensions it, has the travel of that (m).
"""

from __future__ import annotations

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.messages.cdr import Header, Template, marks
from cable_twin.messages.topics import JointState


class _Rows:
    """Names of the rows of the message, and row numbers of each kind."""

    def __init__(self, layout: Layout) -> None:
        self.names: list[str] = []
        self.wheel, self.on, self.off, self.carriage = [], [], [], []  # type: ignore[var-annotated]
        for name in layout.sheaves:
            for rows, row in ((self.wheel, name), (self.on, f"{name}/on"), (self.off, f"{name}/off")):
                rows.append(len(self.names))
                self.names.append(row)
            if name in layout.tensioned:
                self.carriage.append(len(self.names))
                self.names.append(f"{name}/carriage")
        self.tensioned = [row for row, name in enumerate(layout.sheaves) if name in layout.tensioned]


class BullwheelsMessage:
    """Message `sheaves`, filled from the columns of a frame.

    Args:
        header: of the message.
        layout: of the frame.
        numbers: (size,) of the frame, which are filled in before each call.
    """

    def __init__(self, header: Header, layout: Layout, numbers: FloatArray) -> None:
        self._frame, rows = numbers, _Rows(layout)
        count = len(rows.names)
        self._sources, self._shows = np.zeros((3, count), dtype=np.int64), np.zeros((3, count))
        c = layout.places
        for kind, row, sources in (
            (0, rows.wheel, c.sheave_position),
            (0, rows.on, c.sheave_slip),
            (0, rows.carriage, c.sheave_travel[rows.tensioned]),
            (1, rows.wheel, c.sheave_speed),
            (2, rows.wheel, c.sheave_force),
            (2, rows.on, c.sheave_tension[:, 0]),
            (2, rows.off, c.sheave_tension[:, 1]),
        ):
            self._sources[kind, row], self._shows[kind, row] = sources, 1.0
        self._numbers = np.zeros((3, count))
        places, speeds, forces = marks(3 * count).reshape(3, -1)
        self._template = Template(JointState(header, rows.names, places, speeds, forces), [self._numbers])

    def fill(self, stamp_ns: int) -> bytes:
        """Encoded message with a stamp (ns)."""
        self._frame.take(self._sources, None, self._numbers, "clip")
        self._numbers *= self._shows  # 0 where a row shows nothing
        return self._template.fill(stamp_ns)


def fill_bullwheels(numbers: FloatArray, layout: Layout, c: Columns) -> None:
    """Fill the columns of bullwheels from the last three arrays of their message, 8 bytes apart.

    Args:
        numbers: the doubles with which the message ends, at least as many.
        layout: of the frame.
        c: takes them.
    """
    rows = _Rows(layout)
    count = len(rows.names)
    numbers = numbers[numbers.size - (3 * count + 2) :]
    places, speeds, forces = numbers[:count], numbers[count + 1 : 2 * count + 1], numbers[2 * count + 2 :]
    c.sheave_position[:], c.sheave_slip[:] = places[rows.wheel], places[rows.on]
    c.sheave_travel[rows.tensioned] = places[rows.carriage]
    c.sheave_speed[:], c.sheave_force[:] = speeds[rows.wheel], forces[rows.wheel]
    c.sheave_tension[:, 0], c.sheave_tension[:, 1] = forces[rows.on], forces[rows.off]


def bullwheel_numbers(layout: Layout) -> int:
    """Number of doubles at the end of the message, with one more for the length of each array."""
    return 3 * len(_Rows(layout).names) + 2


__all__ = ["BullwheelsMessage", "bullwheel_numbers", "fill_bullwheels"]
