"""Records of declared arrays: shape, unit, range and initial value of each array beside its name.

All arrays of a record are in one block of memory, in the order of their declaration: to copy a record is to copy that.
States that are read from files are held to the ranges.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

HUGEST = 1e15  # of any number in SI units; beyond it, sums of them lose what the solver reckons with
LATEST = 2**53  # solver steps, of which a float still counts each


class Range(NamedTuple):
    """Least and greatest value of an array; a text stands for a size given at the check."""

    least: float | str
    most: float | str


ANY = Range(-HUGEST, HUGEST)
CLOCK = Range(0, LATEST)


def ranges_of(record: Any) -> dict[str, tuple[Range, ...]]:
    """Ranges of all arrays of a named tuple by name, of inner records by dotted names such as "nodes.position".

    A field is declared as `Annotated[array type, ..., Range(...)]`, with several of them for columns of its last axis.
    Floats without one have `ANY`; conditions have none.

    Raises:
        TypeError: whole numbers have none, which may be indices.
    """
    found: dict[str, tuple[Range, ...]] = {}
    for name, hint in get_type_hints(record, include_extras=True).items():
        kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        declared = [one for one in extras if isinstance(one, Range)]
        if kind == NDArray[np.uint8]:  # the memory of all of them
            continue
        if hasattr(kind, "_fields"):
            found |= {f"{name}.{inner}": ranges for inner, ranges in ranges_of(kind).items()}
        elif kind == NDArray[np.int64] and not declared:
            raise TypeError(f"{record.__name__}.{name}: no range is declared")
        else:
            found[name] = tuple(declared) or ((ANY,) if kind == NDArray[np.float64] else ())
    return found


def range_faults(
    arrays: Mapping[str, NDArray[Any]], ranges: Mapping[str, tuple[Range, ...]], sizes: Mapping[str, float]
) -> Iterator[str]:
    """One line for each array with values out of range.

    Args:
        arrays: by name.
        ranges: of each, as `ranges_of` has them.
        sizes: what texts in them stand for.
    """
    for name, array in arrays.items():
        if array.dtype == np.bool_ and np.any(np.ascontiguousarray(array).view(np.uint8) > 1):
            yield f"{name}: holds what is neither true nor false"
        for column, one in enumerate(ranges[name]):
            least, most = (sizes[bound] if isinstance(bound, str) else bound for bound in one)
            numbers = array if len(ranges[name]) == 1 else array[..., column]
            if np.any(wrong := ~((numbers >= least) & (numbers <= most))):
                allowed = f"finite numbers up to {HUGEST:g}" if one == ANY else f"{least:.9g} to {most:.9g}"
                yield f"{name}: holds {numbers[wrong][0]!s}; allowed: {allowed}"


MEMORY = "memory"  # name of the field that is the whole block, as bytes
ALIGNMENT = 16  # bytes, at which each array begins
Memory = NDArray[np.uint8]
Arrays = Mapping[str, NDArray[Any]]
R = TypeVar("R")


class Of:
    """Declaration of an array, or of all arrays of a record, in `Annotated[type, Of(...)]`.

    Args:
        shape: numbers, or names of sizes as "node", "vehicle"; none for that of the record which holds the array.
        unit: of its numbers.
        first: value that it begins with.
        field: the one array of a record that this is for; of all others it is another declaration.
    """

    def __init__(self, *shape: int | str, unit: str = "-", first: float = 0.0, field: str | None = None) -> None:
        self.shape, self.unit, self.first, self.field = shape, unit, first, field


class Declared(NamedTuple):
    """Declaration of one array of a record, with its name and type."""

    name: str  # as "wind", of a record in it as "nodes.position"
    type: Any  # of its numbers
    shape: tuple[int | str, ...]
    unit: str
    first: float
    ranges: tuple[Range, ...]


@cache
def declared(record: Any) -> tuple[Declared, ...]:
    """Declarations of all arrays of a record, in order.

    Raises:
        TypeError: one is declared without a shape.
    """
    return tuple(_declared(record, "", ()))


def _declared(record: Any, within: str, outer: tuple[Of, ...]) -> Iterator[Declared]:
    for name, hint in get_type_hints(record, include_extras=True).items():
        if name == MEMORY:
            continue
        kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        given = tuple(_shaped(one, outer) for one in extras if isinstance(one, Of)) or outer
        if hasattr(kind, "_fields"):
            yield from _declared(kind, f"{within}{name}.", given)
            continue
        of = next((one for one in given if one.field == name), None) or next((o for o in given if not o.field), None)
        if of is None:
            raise TypeError(f"{record.__name__}.{name}: no shape is declared")
        ranges = tuple(one for one in extras if isinstance(one, Range))
        scalar = get_args(get_args(kind)[1])[0]
        yield Declared(f"{within}{name}", scalar, of.shape, of.unit, of.first, ranges)


def _shaped(given: Of, outer: tuple[Of, ...]) -> Of:
    """Declaration with the shape of the outer record where it has none of its own."""
    if given.shape or not outer:
        return given
    return Of(*outer[0].shape, unit=given.unit, first=given.first, field=given.field)


def allocate(record: type[R], sizes: Mapping[str, int]) -> R:
    """Allocate a record with the initial values of its arrays.

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
    """Allocate a record with copies of given arrays by name.

    Raises:
        KeyError: one is missing.
    """
    given = {field.name: arrays[field.name] for field in declared(cast(Any, record))}
    made = _in_one_block(record, {name: (array.dtype, array.shape) for name, array in given.items()})
    for array, own in zip(given.values(), arrays_of(made).values(), strict=True):
        own[...] = array
    return made


def _in_one_block(record: type[R], shapes: Mapping[str, tuple[Any, tuple[int, ...]]]) -> R:
    """Record of zeros in one block of memory."""
    offsets, size = [], 0
    for kind, shape in shapes.values():
        offsets.append(size)
        size += -(-int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize // ALIGNMENT) * ALIGNMENT
    formats = [(kind, shape) for kind, shape in shapes.values()]
    layout = np.dtype({"names": list(shapes), "formats": formats, "offsets": offsets, "itemsize": max(size, 1)})
    return _views(record, np.zeros(1, layout))


def _views(record: type[R], block: NDArray[Any], within: str = "") -> R:
    """Record with its arrays as views of a block of memory."""
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
    """Field names of a record, each with its class if it is a record, else None."""
    return tuple((name, kind if hasattr(kind, "_fields") else None) for name, kind in get_type_hints(record).items())


def arrays_of(record: Any, within: str = "") -> dict[str, NDArray[Any]]:
    """All arrays of a record by name, of inner records by dotted names such as "nodes.position"."""
    found: dict[str, NDArray[Any]] = {}
    for name, field in zip(record._fields, record, strict=True):
        if isinstance(field, tuple):
            found |= arrays_of(field, f"{within}{name}.")
        elif name != MEMORY:
            found[f"{within}{name}"] = field
    return found


def clone(record: R) -> R:
    """Independent copy of a record with one block of memory."""
    return Kept(record).record


def write(source: Any, target: Any) -> None:
    """Copy all arrays of a record into another one of equal shapes, without a kernel."""
    target.memory[:] = source.memory


class Kept:
    """Copy of a record's memory, with the arrays created on demand."""

    __slots__ = ("_kind", "_layout", "_record", "memory")

    def __init__(self, record: Any) -> None:
        self._kind, self._layout = type(record), record.memory.base.dtype
        self._record: Any = None
        self.memory: Memory = record.memory.copy()

    @property
    def record(self) -> Any:
        """Record on the copied memory; writing to its arrays changes the copy."""
        if self._record is None:
            block = np.empty(1, self._layout)
            block.view(np.uint8)[:] = self.memory
            self._record = _views(self._kind, block)
            self.memory = self._record.memory
        return self._record
