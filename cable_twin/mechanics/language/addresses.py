"""Tables of memory addresses of packed records, so that one kernel takes any number of records of a type."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from cable_twin.mechanics.language.by_reference import RecordType, pack

_intrinsic: Any = intrinsic  # its stub asks for the typing context in a call


class Addresses:
    """Table of addresses of packed records, which stay in place for the lifetime of this object.

    Attributes:
        table: (rows, columns) integers, for kernels.
    """

    def __init__(self, rows: list[tuple[Any, ...]]) -> None:
        """Pack the records of a table, whose columns each hold records of one kind."""
        self._packed = [[pack(record) for record in row] for row in rows]
        self.table: NDArray[np.int64] = np.array([[address(one) for one in row] for row in self._packed], np.int64)

    def write(self, row: int, column: int, record: Any) -> None:
        """Replace one record in the table of addresses by another of the same type.

        Raises:
            TypeError: the record is of another type, so that kernels would misread it.
        """
        packed, before = pack(record), self._packed[row][column]
        if getattr(packed, "_numba_type_", None) != getattr(before, "_numba_type_", None):
            raise TypeError(
                f"{type(record).__name__}: given a record of another type; allowed: the type of the replaced record"
            )
        self._packed[row][column] = packed
        self.table[row, column] = address(self._packed[row][column])


def address(packed: Any) -> int:
    """Memory address of a packed record, valid as long as somebody holds a reference to the record."""
    if hasattr(packed, "address"):
        return int(packed.address)
    _UNPACKED[id(packed)] = packed
    return id(packed)


_UNPACKED: dict[int, Any] = {}  # records by the number that stands for their address, with the JIT off


@_intrinsic
def _at(typingctx, address, like):
    if not isinstance(like, RecordType) or not isinstance(address, types.Integer):
        return None

    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        return builder.inttoptr(values[0], values[1].type)

    return like(address, like), generate


def _at_in_python(address: int, like: Any) -> Any:
    return _UNPACKED[int(address)]


_config: Any = numba.config
# The record at an address, of the kind of the second argument.
record_at: Any = _at_in_python if _config.DISABLE_JIT else _at
