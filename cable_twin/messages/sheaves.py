"""Bullwheels as a message: a row for each, for the strands that come to it and leave it, and for what tensions it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cable_twin.messages.cdr import Header, Template, marks
from cable_twin.messages.topics import JointState
from cable_twin.snapshot import Columns, Layout

ROWS = ("", "/on", "/off", "/carriage")  # of each bullwheel, behind its name


class SheaveMessage:
    """The message of what the columns of a frame show.

    NAME has the rope gone by (m), its speed (m/s) and the drive force at the rim (N). NAME/on and NAME/off, the
    strands, have tensions (N) as effort, and NAME/on the slip (m) of the rope. NAME/carriage has the travel (m) of what
    tensions the wheel.

    Args:
        header: of the message.
        layout: of the frame.
        columns: which are filled in before each call.
    """

    def __init__(self, header: Header, layout: Layout, columns: Columns) -> None:
        self._columns = columns
        names = [f"{name}{row}" for name in layout.sheaves for row in ROWS]
        self._numbers = np.zeros((3, len(layout.sheaves), len(ROWS)))
        places, speeds, forces = marks(3 * len(names)).reshape(3, -1)
        self._template = Template(JointState(header, names, places, speeds, forces), list(self._numbers))

    def fill(self, stamp_ns: int) -> bytes:
        """The message with a stamp (ns)."""
        c, (places, speeds, forces) = self._columns, self._numbers
        places[:, 0], places[:, 1], places[:, 3] = c.sheave_position, c.sheave_slip, c.sheave_travel
        speeds[:, 0], forces[:, 0], forces[:, 1:3] = c.sheave_speed, c.sheave_force, c.sheave_tension
        return self._template.fill(stamp_ns)


def sheave_reader(numbers_of: Callable[[bytes, int], np.ndarray], columns: Columns) -> Callable[[bytes], None]:
    """Reads that message into the columns of a frame; `numbers_of` gives so many numbers at the end of a message."""
    c, count = columns, len(ROWS) * columns.sheave_speed.size

    def read(data: bytes) -> None:
        numbers = numbers_of(data, 3 * count + 2)
        parts = numbers[:count], numbers[count + 1 : 2 * count + 1], numbers[2 * count + 2 :]
        places, speeds, forces = (part.reshape(-1, len(ROWS)) for part in parts)
        c.sheave_position[:], c.sheave_slip[:], c.sheave_travel[:] = places[:, 0], places[:, 1], places[:, 3]
        c.sheave_speed[:], c.sheave_force[:], c.sheave_tension[:] = speeds[:, 0], forces[:, 0], forces[:, 1:3]

    return read


__all__ = ["SheaveMessage", "sheave_reader"]
