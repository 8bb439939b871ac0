"""ROS 2 messages as CDR bytes without rclpy, laid out by the rosbags typestore, for logs on machines without ROS.

Padding is zero: equal records give equal bytes, and a replay may compare bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.messages.topics import FRAME_ID

Time = ros2_jazzy.builtin_interfaces__msg__Time
Header = ros2_jazzy.std_msgs__msg__Header

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)
SECOND = 1_000_000_000  # ns
ENCAPSULATION = 4  # bytes in front of the message proper, from which alignment counts
WIDEST = 8  # bytes of the longest number
STAMP = Time(0x5E5E5E5E, 0x5A5A5A5A)  # stands for every stamp of a template
_MARKS = {"<f8": (np.uint64, 0x7FE0_0000_0000_0000), "<f4": (np.uint32, 0x7E00_0000)}  # finite, and in no message


class Message(Protocol):
    """Common type of all ROS message classes of the rosbags typestore."""

    __msgtype__: ClassVar[str]


def serialize(message: Message) -> bytes:
    """Encode a message of the typestore as little-endian CDR."""
    return bytes(TYPESTORE.serialize_cdr(message, message.__msgtype__, little_endian=True))


def decode(data: bytes, message_type: str) -> Any:
    """Decode a message of a type ("sensor_msgs/msg/JointState") into its rosbags dataclass."""
    return TYPESTORE.deserialize_cdr(data, message_type)


def nanoseconds(time: float) -> int:
    """Convert simulated time (s) into nanoseconds."""
    return round(time * SECOND)


def time_of(stamp_ns: int) -> Time:
    """Time message (builtin_interfaces/Time) of a stamp in ns."""
    return Time(*divmod(stamp_ns, SECOND))


def stamp_in(data: bytes) -> int:
    """Stamp (ns) of an encoded message of sufficient length whose first field is a header."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanosecond = struct.unpack_from(f"{order}iI", data, ENCAPSULATION)
    return int(seconds) * SECOND + int(nanosecond)


def header(stamp_ns: int, frame_id: str = FRAME_ID) -> Header:
    """Header message (std_msgs/Header) with a stamp in ns."""
    return Header(time_of(stamp_ns), frame_id)


def marks(count: int, kind: str = "<f8") -> NDArray[Any]:
    """Placeholder values (count,) for a message template, in increasing order."""
    word, first = _MARKS[kind]
    return (np.arange(count, dtype=word) + word(first)).view(kind)


class Template:
    """CDR message template: laid out once, then only its stamps and numeric values are overwritten.

    The message is given with `STAMP` for every stamp and `marks` for the numbers; their positions are read from its
    bytes, so nothing here knows the layout of any message.
    """

    def __init__(
        self,
        message: Message,
        sources: Sequence[NDArray[np.float64]],
        kind: str = "<f8",
        *,
        singles: Sequence[NDArray[Any]] = (),
    ) -> None:
        """Lay out a message as template: find the byte positions of its stamps and numbers.

        Args:
            message: with the placeholders of all sources, one source after the other, each in C order.
            sources: arrays that are copied into the message by each `fill`; (rows, ...) or (rows,).
            kind: type of their numbers in the message, "<f8" or "<f4".
            singles: further sources, for numbers of type "<f4" in a message whose `kind` is "<f8".
        """
        plain = serialize(message)
        # numbers are aligned from behind the encapsulation on
        room = np.zeros(len(plain) + 2 * WIDEST, dtype=np.uint8)
        start = -ENCAPSULATION % WIDEST
        self._data = room[start : start + len(plain)]
        self._data[:] = np.frombuffer(plain, np.uint8)
        self._body = room[start + ENCAPSULATION :]
        self._words = self._body[: self._body.size // 4 * 4].view("<u4")
        self._stamps = np.flatnonzero(self._words == STAMP.sec)
        if self._stamps.size == 0 or (self._words[self._stamps + 1] != STAMP.nanosec).any():
            raise ValueError(f"template of {message.__msgtype__}: given no stamp; allowed: at least one")
        # bytes before the only stamp
        self._stamped = ENCAPSULATION + 4 * int(self._stamps[0]) if self._stamps.size == 1 else None
        self._bytes = self._data.data
        self._copies: list[tuple[NDArray[Any], NDArray[Any]]] = []
        self._scattered: list[tuple[NDArray[Any], NDArray[np.intp], NDArray[Any]]] = []
        self._find(message, sources, kind)
        if singles:
            self._find(message, singles, "<f4")

    def _find(self, message: Message, sources: Sequence[NDArray[Any]], kind: str) -> None:
        """Find the byte positions of all placeholder numbers of one data type in the message."""
        word, first = _MARKS[kind]
        size = np.dtype(kind).itemsize
        numbers = self._body[: self._body.size // size * size].view(kind)
        order = numbers.view(word) - word(first)
        count = sum(source.size for source in sources)
        where = np.flatnonzero(order < count)
        places = where[np.argsort(order[where], kind="stable")]
        if places.size != count:
            raise ValueError(f"template of {message.__msgtype__}: given {count} numbers; allowed: {places.size}")
        taken = 0
        for source in sources:
            own = places[taken : taken + source.size].reshape(source.shape)
            taken += source.size
            target = _strided(numbers, own)
            if target is not None:
                self._copies.append((target, source))
            else:
                self._scattered.append((numbers, own, source))

    def fill(self, stamp_ns: int) -> bytes:
        """Encode the message with a stamp (ns) and the present values of the source arrays."""
        second, nanosecond = divmod(stamp_ns, SECOND)
        if self._stamped is not None:
            _PAIR.pack_into(self._bytes, self._stamped, second, nanosecond)
        else:
            self._words[self._stamps], self._words[self._stamps + 1] = second, nanosecond
        for target, source in self._copies:
            target[...] = source
        for numbers, places, source in self._scattered:
            numbers[places] = source
        return self._bytes.tobytes()


_PAIR = struct.Struct("<2I")


def _strided(numbers: NDArray[Any], places: NDArray[np.intp]) -> NDArray[Any] | None:
    """Strided view of the array elements at the indices `places`, if evenly spaced along each axis; else None."""
    if places.size == 0:
        return numbers[:0].reshape(places.shape)
    steps = []
    for axis in range(places.ndim):
        differences = np.diff(places, axis=axis)
        if differences.size and (differences != differences.flat[0]).any():
            return None
        steps.append(int(differences.flat[0]) if differences.size else 1)
    first, size = int(places.flat[0]), numbers.itemsize
    return np.ndarray(places.shape, numbers.dtype, numbers, first * size, tuple(step * size for step in steps))
