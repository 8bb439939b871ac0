"""Records of arrays that are declared once: shape, unit, range and first value of each beside its name.

All arrays of a record are in one block of memory, in the order of their declaration: to copy a record is to copy that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.ranges import Range

MEMORY = "memory"  # name of the field that is the whole block, as bytes
ALIGNMENT = 16  # bytes, at which each array begins
Memory = NDArray[np.uint8]
Arrays = Mapping[str, NDArray[Any]]
R = TypeVar("R")


class Of:
    """Declares an array, or all arrays of a record, within `Annotated[type, Of(...)]`.

    Args:
        shape: numbers, or names of sizes as "node", "vehicle".
        unit: of its numbers.
        first: value that it begins with.
        field: the one array of a record that this is for; of all others it is another declaration.
    """

    def __init__(self, *shape: int | str, unit: str = "-", first: float = 0.0, field: str | None = None) -> None:
        self.shape, self.unit, self.first, self.field = shape, unit, first, field


class Declared(NamedTuple):
    """One array of a record."""

    name: str  # as "wind", of a record in it as "nodes.position"
    type: Any  # of its numbers
    shape: tuple[int | str, ...]
    unit: str
    first: float
    ranges: tuple[Range, ...]


@cache
def declared(record: Any) -> tuple[Declared, ...]:
    """All arrays of a record, in their order.

    Raises:
        TypeError: one is declared without a shape.
    """
    return tuple(_declared(record, "", ()))


def _declared(record: Any, within: str, outer: tuple[Of, ...]) -> Iterator[Declared]:
    for name, hint in get_type_hints(record, include_extras=True).items():
        if name == MEMORY:
            continue
        kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        given = tuple(one for one in extras if isinstance(one, Of)) or outer
        if hasattr(kind, "_fields"):
            yield from _declared(kind, f"{within}{name}.", given)
            continue
        of = next((one for one in given if one.field == name), None) or next((o for o in given if not o.field), None)
        if of is None:
            raise TypeError(f"{record.__name__}.{name}: no shape is declared")
        ranges = tuple(one for one in extras if isinstance(one, Range))
        scalar = get_args(get_args(kind)[1])[0]
        yield Declared(f"{within}{name}", scalar, of.shape, of.unit, of.first, ranges)


def allocate(record: type[R], sizes: Mapping[str, int]) -> R:
    """Make a record with the values that its arrays begin with.

    Args:
        record: a named tuple whose fields are declared.
        sizes: what names in shapes stand for.
    """
    fields = declared(cast(Any, record))
    shapes = {f.name: (f.type, tuple(sizes[n] if isinstance(n, str) else n for n in f.shape)) for f in fields}
    made = _in_one_block(record, shapes)
    for field, array in zip(fields, arrays_of(made).values(), strict=True):
        if field.first:
            array[...] = field.first
    return made


def with_arrays(record: type[R], arrays: Arrays) -> R:
    """Make a record with a copy of arrays by their names.

    Raises:
        KeyError: one is missing.
    """
    given = {field.name: arrays[field.name] for field in declared(cast(Any, record))}
    made = _in_one_block(record, {name: (array.dtype, array.shape) for name, array in given.items()})
    for array, own in zip(given.values(), arrays_of(made).values(), strict=True):
        own[...] = array
    return made


def _in_one_block(record: type[R], shapes: Mapping[str, tuple[Any, tuple[int, ...]]]) -> R:
    """A record of zeros."""
    offsets, size = [], 0
    for kind, shape in shapes.values():
        offsets.append(size)
        size += -(-int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize // ALIGNMENT) * ALIGNMENT
    formats = [(kind, shape) for kind, shape in shapes.values()]
    layout = np.dtype({"names": list(shapes), "formats": formats, "offsets": offsets, "itemsize": max(size, 1)})
    return _views(record, np.zeros(1, layout))


def _views(record: type[R], block: NDArray[Any], within: str = "") -> R:
    """The record whose arrays are in a block."""
    fields: list[Any] = []
    for name, kind in _kinds(cast(Any, record)):
        if kind is not None:
            fields.append(_views(kind, block, f"{within}{name}."))
        elif name == MEMORY:
            fields.append(block.view(np.uint8))
        else:
            fields.append(block[f"{within}{name}"][0])
    return record(*fields)


@cache
def _kinds(record: Any) -> tuple[tuple[str, Any], ...]:
    """Names of the fields of a record, with the class of those that are records."""
    return tuple((name, kind if hasattr(kind, "_fields") else None) for name, kind in get_type_hints(record).items())


def arrays_of(record: Any, within: str = "") -> dict[str, NDArray[Any]]:
    """All arrays of a record by name, those of the records in it as in "nodes.position"."""
    found: dict[str, NDArray[Any]] = {}
    for name, field in zip(record._fields, record, strict=True):
        if isinstance(field, tuple):
            found |= arrays_of(field, f"{within}{name}.")
        elif name != MEMORY:
            found[f"{within}{name}"] = field
    return found


def clone(record: R) -> R:
    """Independent copy of a record that has its memory."""
    return Kept(record).record


def write(source: Any, target: Any) -> None:
    """Write all arrays of a record into those of another one of the same shapes, without a kernel."""
    target.memory[:] = source.memory


class Kept:
    """A copy of a record, whose arrays are looked for only where somebody asks for them."""

    __slots__ = ("_kind", "_layout", "_record", "memory")

    def __init__(self, record: Any) -> None:
        self._kind, self._layout = type(record), record.memory.base.dtype
        self._record: Any = None
        self.memory: Memory = record.memory.copy()

    @property
    def record(self) -> Any:
        """The record; what is written into its arrays is kept as well."""
        if self._record is None:
            block = np.empty(1, self._layout)
            block.view(np.uint8)[:] = self.memory
            self._record = _views(self._kind, block)
            self.memory = self._record.memory
        return self._record


__all__ = ["MEMORY", "Kept", "Memory", "Of", "allocate", "arrays_of", "clone", "declared", "with_arrays", "write"]
