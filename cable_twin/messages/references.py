"""Message `joint_references` of commands and references: three rows for each commanded carriage and drive.

NAME has the reference that the drive follows, ramped within its limits: place (m), speed (m/s) and commanded force (N);
where it follows no ramp, place and speed are its own. NAME/command has the kind of the command (by its number in
`COMMANDED`) as position, the commanded speed (m/s) and force (N). NAME/limit has the share of the force limit in use as
position (1 in saturation) and that limit (N) as effort; both are 0 where there is no limit. That of a bullwheel's drive
is the force at which the rope would slip on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout
from cable_twin.messages.cdr import Header, Template, marks
from cable_twin.messages.topics import JointState

IntArray = NDArray[np.int64]
ROWS = ("", "/command", "/limit")  # behind a name


class ReferencesMessage:
    """Message `joint_references`, filled from the numbers of a frame.

    Args:
        header: of the message.
        layout: of the frame.
        numbers: (size,) of the frame, which are filled in before each call.
    """

    def __init__(self, header: Header, layout: Layout, numbers: FloatArray) -> None:
        self._frame, self._sources = numbers, _sources(layout)
        self._shown = np.zeros(self._sources.shape)
        places, speeds, forces = marks(self._shown.size).reshape(3, -1)
        names = [f"{name}{row}" for name in layout.commanded for row in ROWS]
        self._template = Template(JointState(header, names, places, speeds, forces), [self._shown])
        # places in the message and numbers of the frame: share in use, force limit, force
        columns = layout.places
        self._limited = [
            (number, self._sources[2, number, 2].item(), int(columns.drive_force[layout.vehicle_rows[name]]))
            for number, name in enumerate(layout.commanded)
            if name in layout.vehicle_rows
        ]
        first = len(layout.commanded) - len(layout.drives)
        self._on_bullwheels = [  # the same of drives, whose limits do not change
            (first + row, limit, int(columns.moving_cable_force[row]))
            for row, limit in enumerate(layout.drive_limits.tolist())
            if limit > 0.0
        ]

    def fill(self, stamp_ns: int) -> bytes:
        """Encoded message with a stamp (ns)."""
        shown, frame = self._shown, self._frame
        frame.take(self._sources, None, shown, "clip")
        shown[:, :, 2] = 0.0
        for number, limit, force in self._limited:
            if (most := frame.item(limit)) > 0.0:  # there is one
                shown[0, number, 2], shown[2, number, 2] = abs(frame.item(force)) / most, most
        for number, most, force in self._on_bullwheels:
            shown[0, number, 2], shown[2, number, 2] = abs(frame.item(force)) / most, most
        return self._template.fill(stamp_ns)


def _sources(layout: Layout) -> IntArray:
    """Indices (3, names, rows) of frame numbers in the message, for place, speed, force; 0 for empty fields."""
    c = layout.places
    limits = layout.of_commanded(c.force_limit, np.zeros_like(c.drive_position))
    kinds = layout.of_commanded(c.command_kind, c.drive_command_kind)
    force = layout.of_commanded(c.commanded_force, c.drive_commanded_force)
    places = layout.of_commanded(c.reference_position, c.drive_reference_position)
    speeds = layout.of_commanded(c.reference_speed, c.drive_reference_speed)
    told, none = layout.of_commanded(c.commanded_speed, c.drive_commanded_speed), np.zeros_like(kinds)
    rows = [[places, kinds, none], [speeds, told, none], [force, force, limits]]
    return np.moveaxis(np.array(rows, dtype=np.int64), 1, 2)


def fill_references(numbers: FloatArray, layout: Layout, frame: FloatArray) -> None:
    """Fill the columns of commands and references from the doubles at the end of their message.

    Args:
        numbers: `reference_numbers` doubles: three arrays of one length, 8 bytes apart.
        layout: of the frame.
        frame: (size,) takes them.
    """
    sources = _sources(layout)
    size = sources[0].size
    shown = np.stack([numbers[first : first + size] for first in (0, size + 1, 2 * size + 2)]).reshape(sources.shape)
    for row in range(len(ROWS) - 1):
        frame[sources[:, :, row]] = shown[:, :, row]
    limits, limited = shown[2, :, 2], sources[2, :, 2] > 0
    frame[sources[2, limited, 2]] = np.where(limits == 0.0, np.nan, limits)[limited]


def reference_numbers(layout: Layout) -> int:
    """Number of doubles at the end of the message, with one more for the length of each array."""
    return 3 * len(layout.commanded) * len(ROWS) + 2


__all__ = ["ReferencesMessage", "fill_references", "reference_numbers"]
