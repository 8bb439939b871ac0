"""Message `columns`: all values of a frame, bit for bit, as a std_msgs/Float64MultiArray for the log.

Columns are in groups, each group is logged at its own rate, and a message has the groups that are due: the label of
its only dimension names them, and their columns follow one after the other. `columns_metadata` describes groups and
columns for the metadata of the log.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import astuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.records import FloatArray, SolverReport
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.mechanics.language.declared import declared
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.messages.cdr import serialize
from cable_twin.messages.topics import Topic

Float64MultiArray = ros2_jazzy.std_msgs__msg__Float64MultiArray
MultiArrayLayout = ros2_jazzy.std_msgs__msg__MultiArrayLayout
MultiArrayDimension = ros2_jazzy.std_msgs__msg__MultiArrayDimension

COLUMNS = "columns"  # the topic, and the key of its description in the metadata of a log
COLUMNS_TOPIC = Topic(COLUMNS, Float64MultiArray.__msgtype__)  # only in logs: nothing publishes it
ALWAYS, COMPLETE = "time", "path"  # the group that is in every message, and the one that comes with all others
GROUPS = (ALWAYS, "joints", "poses", "forces", "rope", COMPLETE)  # as those of topics, at whose rates they are logged
COLUMNS_OF: Mapping[str, Sequence[str]] = {  # columns of each group; all others are in `joints`
    ALWAYS: ("time",),
    "poses": ("joint_position", "body_position", "body_orientation"),
    "forces": (
        *("contact_force", "tension_over_load", "haul_travel", "haul_force", "haul_tension", "haul_pull"),
        *("push", "push_highest"),
        *("touched", "touch_place", "touch_speed", "touch_time", "support_force", "support_travel"),
        *("tower_load", "tower_lowest_load", "tower_rest_load", "tower_lateral", "tower_lateral_ratio"),
        "connector_force",
    ),
    "rope": ("lowest_tension", "highest_tension"),
    "path": ("rope_position", "rope_tension", "body_velocity", "body_angular_velocity"),
}
BY_COMPONENT = ("body_angles",)  # all pitches one after the other, as in `joint_states`: compression finds them there
REPORT = tuple(f"solver_{name}" for name in SolverReport.__dataclass_fields__)  # since the message before with them
REPORT_UNITS = {"solver_energy_lost": "J", "solver_energy_moved": "J", "solver_constraint_residual": "m"}
DECLARED = {column.name: column for column in declared(Columns)}
REPORT_GROUP, RESIDUAL = "forces", REPORT.index("solver_constraint_residual")
IntArray = NDArray[np.intp]
NO_PLACE: IntArray = np.zeros(0, np.intp)
NOTHING = SolverReport(0, 0, 0, 0.0)
LABEL = 12  # bytes in front of the label: encapsulation, number of dimensions, length of the label
MOST = 1_000_000  # numbers of a message
MOST_KINDS = 64  # sets of groups whose messages are kept in mind; a run has 31 at most


class Row(NamedTuple):
    """Frame decoded from one message `columns`: its values, the indices of those present, and the solver report."""

    numbers: FloatArray  # (size of a frame,) NaN outside the groups of the message
    places: IntArray  # (n,) indices in a frame of the numbers in the message
    report: SolverReport  # since the previous message with a report; without steps if not in the message


def groups_due(due: Collection[str]) -> tuple[str, ...]:
    """Groups of columns due in message `columns` of a frame, from the groups of topics logged with the frame."""
    if COMPLETE in due:
        return GROUPS
    groups = tuple(group for group in GROUPS if group in due)
    return (ALWAYS, *groups) if groups else ()


def _columns(layout: Layout) -> dict[str, dict[str, IntArray]]:
    """Indices of all values, by group and column, in the vector of a frame followed by the solver report."""
    groups = {column: group for group, columns in COLUMNS_OF.items() for column in columns}
    found: dict[str, dict[str, IntArray]] = {group: {} for group in GROUPS}
    for name, places in layout.places._asdict().items():
        if places.size:
            stored = places.T if name in BY_COMPONENT else places
            found[groups.get(name, "joints")][name] = stored.astype(np.intp)
    for number, name in enumerate(REPORT):
        found[REPORT_GROUP][name] = np.array([layout.size + number])
    return found


def columns_metadata(layout: Layout) -> dict[str, str]:
    """Description of message `columns` for log metadata: JSON with columns of each group and names of their rows."""
    groups = {
        group: [
            {"name": name, "unit": _unit(name), "shape": places.shape, "axes": _axes(name)}
            for name, places in columns.items()
        ]
        for group, columns in _columns(layout).items()
    }
    named = ("vehicles", "carriages", "bodies", "supports", "drives", "ropes", "sheaves", "connectors", "pantographs")
    names = {kind: list(getattr(layout, kind)) for kind in named}
    described = {"groups": groups, "names": names, "arc_lengths": layout.arc_lengths.tolist()}
    return {COLUMNS: json.dumps(described, ensure_ascii=False)}


def _unit(name: str) -> str:
    """Unit of a frame's column, by name; empty for counts, ratios and booleans."""
    unit = DECLARED[name].unit if name in DECLARED else REPORT_UNITS.get(name, "-")
    return "" if unit == "-" else unit


def _axes(name: str) -> list[str]:
    """Names of the axes of a frame's column: kind of object for rows, "component" for vectors and pairs."""
    shape = DECLARED[name].shape if name in DECLARED else (1,)
    axes = ["component" if isinstance(count, int) else count for count in shape]
    return axes[::-1] if name in BY_COMPONENT else axes


def _head(groups: Sequence[str], count: int) -> bytes:
    """Leading bytes of a message `columns`: the encoded message up to its numbers."""
    dimension = MultiArrayDimension(" ".join(groups), count, count)
    return serialize(Float64MultiArray(MultiArrayLayout([dimension], 0), np.zeros(count)))[: -8 * count or None]


class RowEncoder:
    """Encoder of the frames of one run as messages `columns`, each with the groups of columns that are due.

    Args:
        layout: Of the snapshots.
    """

    def __init__(self, layout: Layout) -> None:
        self._columns = _columns(layout)
        self._known: dict[Sequence[str], tuple[bytes, IntArray]] = {}
        self._report = NOTHING

    def encode(self, snapshot: Snapshot, groups: Sequence[str]) -> bytes | None:
        """Encode the due columns of a frame as a message; None where no group is due.

        Args:
            snapshot: Every snapshot of the run in the order of time, as reports of the solver are added up.
            groups: Result of `groups_due`.
        """
        self._report = self._report.then(snapshot.solver)
        if not groups:
            return None
        if groups not in self._known:
            own = (places.ravel() for group in groups for places in self._columns[group].values())
            every = np.concatenate([NO_PLACE, *own])
            self._known[groups] = _head(groups, every.size), every
        head, places = self._known[groups]
        numbers: FloatArray = snapshot.numbers
        if REPORT_GROUP in groups:
            numbers, self._report = np.append(numbers, astuple(self._report)), NOTHING
        return head + numbers.take(places).tobytes()


class RowDecoder:
    """Decoder of the messages `columns` of one log; columns unknown to this version are left out."""

    def __init__(self, metadata: Mapping[str, str], layout: Layout) -> None:
        """Parse the description of the columns in the metadata of a log.

        Args:
            metadata: Of the log.
            layout: Of the frames.

        Raises:
            ValueError: The description is missing or differs from the layout; a line with the reason.
        """
        self._layout = layout
        self._shapes = {name: places for columns in _columns(layout).values() for name, places in columns.items()}
        self._known: dict[bytes, _Parts] = {}
        try:
            described = json.loads(metadata.get(COLUMNS, ""))["groups"].items()
            self._groups = {group: [self._places(column) for column in columns] for group, columns in described}
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            fault = str(error) if isinstance(error, _ShapeError) else "a JSON object with groups of columns is expected"
            raise ValueError(f"{COLUMNS} are unreadable: {fault}") from error

    def _places(self, column: Mapping[str, Any]) -> IntArray:
        """Indices in a frame's vector of the values of a column described in a log; -1 for an unknown column."""
        name, shape = str(column["name"]), tuple(column["shape"])
        if name not in self._shapes:
            return np.broadcast_to(np.intp(-1), _limited(math.prod(map(int, shape))))
        if shape != self._shapes[name].shape:
            raise _ShapeError(f"{name}: given shape {str(shape)[:40]}; allowed: {self._shapes[name].shape}")
        return self._shapes[name].ravel()

    def decode(self, data: bytes) -> Row:
        """Decode a message `columns` into the values of its frame.

        Raises:
            ValueError, KeyError, struct.error: No such message, or with other columns than the log describes.
        """
        (length,) = struct.unpack_from("<I", data, LABEL - 4)
        label = bytes(data[LABEL : LABEL + length])
        parts = self._known.get(label) or self._parts(label)
        if not data.startswith(parts.head) or len(data) != len(parts.head) + 8 * parts.size:
            raise ValueError("columns differ from those described in the log")
        numbers = np.frombuffer(data, "<f8", parts.size, len(parts.head))
        report = numbers.take(parts.report).tolist()
        solver = SolverReport(*map(int, report[:RESIDUAL]), *report[RESIDUAL:]) if report else NOTHING
        frame = np.full(self._layout.size, math.nan)
        frame[parts.places] = numbers.take(parts.taken)
        return Row(frame, parts.places, solver)

    def _parts(self, label: bytes) -> _Parts:
        groups = label.rstrip(b"\0").decode().split()
        if len(set(groups)) < len(groups):
            raise ValueError("a group of columns is given twice")
        size = _limited(sum(places.size for group in groups for places in self._groups[group]))
        every = np.concatenate([NO_PLACE, *(places for group in groups for places in self._groups[group])])
        taken = np.flatnonzero((every >= 0) & (every < self._layout.size))
        report = np.flatnonzero(every >= self._layout.size)
        report = report[np.argsort(every[report])] if report.size == len(REPORT) else NO_PLACE
        parts = _Parts(_head(groups, size), size, taken, every[taken], report)
        if len(self._known) < MOST_KINDS:
            self._known[label] = parts
        return parts

    def name(self, place: int) -> str:
        """Name of the value at an index of a frame, such as body_angles[cabin/hanger, 1] for the pitch of a hanger."""
        for name, places in self._layout.places._asdict().items():
            for row, *component in np.argwhere(places == place).tolist():
                names = getattr(self._layout, str(DECLARED[name].shape[0]) if name in DECLARED else "", ())
                return f"{name}[{', '.join(map(str, ([*names][row] if names else row, *component)))}]"
        raise KeyError(place)


class _Parts(NamedTuple):
    """Positions of the values in messages `columns` that contain one set of column groups."""

    head: bytes  # of the message, up to its numbers
    size: int  # number of numbers
    taken: IntArray  # (n,) positions in the message of the numbers of the frame
    places: IntArray  # (n,) their indices in a frame
    report: IntArray  # (6,) positions of the solver's report, or (0,)


class _ShapeError(ValueError):
    """Error of a column of unexpected shape or size in a log."""


def _limited(count: int) -> int:
    """Check a number of values against the limit of one message; returns the number."""
    if not 0 <= count <= MOST:
        raise _ShapeError(f"given {count} numbers; allowed: at most {MOST}")
    return count
