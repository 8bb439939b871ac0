"""Messages of drives and bullwheels, JointStates with several rows for each: `joint_references` and `sheaves`."""

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
    """Message `joint_references`: references, commands and force limits of each commanded carriage and drive.

    NAME has the reference that the drive follows, ramped within its limits: place (m), speed (m/s) and commanded force
    (N); without a ramp, the actual place and speed. NAME/command has the kind of the command (by its number
    in `COMMANDED`) as position, the commanded speed (m/s) and force (N). NAME/limit has the share of the force limit in
    use as position (1 in saturation) and the limit (N) as effort; both are 0 where there is no limit. The limit of a
    bullwheel's drive is the force at which the rope slips on the wheel.

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
        """Encode the references of the present frame with a stamp (ns)."""
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
    """Indices (3, names, rows) in a frame of the values of `joint_references`: place, speed, force; 0 for no value."""
    c = layout.places
    limits = layout.of_commanded(c.force_limit, np.zeros_like(c.drive_position))
    kinds = layout.of_commanded(c.command_kind, c.drive_command_kind)
    force = layout.of_commanded(c.commanded_force, c.drive_commanded_force)
    places = layout.of_commanded(c.reference_position, c.drive_reference_position)
    speeds = layout.of_commanded(c.reference_speed, c.drive_reference_speed)
    told, none = layout.of_commanded(c.commanded_speed, c.drive_commanded_speed), np.zeros_like(kinds)
    rows = [[places, kinds, none], [speeds, told, none], [force, force, limits]]
    return np.moveaxis(np.array(rows, dtype=np.int64), 1, 2)


class _Rows:
    """Rows of message `sheaves`: names, and the row indices of wheels, strands and tensioning carriages."""

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
    """Message `sheaves` of bullwheels: rope travel, drive force, tensions of both strands and tensioning of each.

    NAME has the travel of the rope over the wheel (m), its speed (m/s) and the force of the drive at the rim (N).
    NAME/on and NAME/off are the strands that come to the wheel and leave it, with their tensions (N) as effort; NAME/on
    has the slip (m), by which the rim has gone further than the rope, as position. NAME/carriage, for a wheel with a
    tensioning device, has the travel of the device (m).

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
        """Encode the bullwheels of the present frame with a stamp (ns)."""
        self._frame.take(self._sources, None, self._numbers, "clip")
        self._numbers *= self._shows  # 0 where a row shows nothing
        return self._template.fill(stamp_ns)
