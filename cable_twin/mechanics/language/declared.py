"""Records of declared arrays: shape, unit, range and initial value of each array beside its name.

All arrays of a record are in one block of memory, in the order of their declaration: to copy a record is to copy that.
States that are read from files are held to the ranges.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

HUGEST = 1e15  # of any number in SI units; beyond it, sums of them lose what the solver reckons with
LATEST = 2**53  # solver steps, of which a float still counts each


class Range(NamedTuple):
    """Least and greatest allowed value of an array; a bound given as text is the name of an array size."""

    least: float | str
    most: float | str


ANY = Range(-HUGEST, HUGEST)
CLOCK = Range(0, LATEST)


def ranges_of(record: Any) -> dict[str, tuple[Range, ...]]:
    """Allowed ranges of all arrays of a record class by name, of inner records by dotted names as "nodes.position".

    A field is declared as `Annotated[array type, ..., Range(...)]`, with several of them for columns of its last axis.
    Floats without one have `ANY`; conditions have none.

    Raises:
        TypeError: an array of integers, which may be indices, has no declared range.
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
            raise TypeError(
                f"{record.__name__}.{name}: given integers without a range; allowed: integers with a declared `Range`"
            )
        else:
            found[name] = tuple(declared) or ((ANY,) if kind == NDArray[np.float64] else ())
    return found


def range_faults(
    arrays: Mapping[str, NDArray[Any]], ranges: Mapping[str, tuple[Range, ...]], sizes: Mapping[str, float]
) -> Iterator[str]:
    """Yield one line for each array of a record that has values out of its allowed range.

    Args:
        arrays: by name.
        ranges: of each array, as of `ranges_of`.
        sizes: values of the sizes that ranges name.
    """
    for name, array in arrays.items():
        if array.dtype == np.bool_ and np.any(np.ascontiguousarray(array).view(np.uint8) > 1):
            yield f"{name}: holds a byte that is neither true nor false; allowed: 0 (false) or 1 (true)"
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
    """Declaration of shape, unit and first value of an array, or of all arrays of a record: `Annotated[type, Of(...)]`.

    Args:
        shape: numbers, or names of sizes as "node", "vehicle"; none for the shape declared for the outer record.
        unit: of its numbers.
        first: initial value of its numbers.
        field: name of the one array of a record that this declaration is for; None for all others.
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
    """Declarations of all arrays of a record class, in order.

    Raises:
        TypeError: an array is declared without a shape.
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
            raise TypeError(f"{record.__name__}.{name}: given no shape; allowed: a shape declared by `Of`")
        ranges = tuple(one for one in extras if isinstance(one, Range))
        scalar = get_args(get_args(kind)[1])[0]
        yield Declared(f"{within}{name}", scalar, of.shape, of.unit, of.first, ranges)


def _shaped(given: Of, outer: tuple[Of, ...]) -> Of:
    """Declaration of an array, with the shape of its outer record where it has none of its own."""
    if given.shape or not outer:
        return given
    return Of(*outer[0].shape, unit=given.unit, first=given.first, field=given.field)


def allocate(record: type[R], sizes: Mapping[str, int]) -> R:
    """Allocate a record with the initial values of its arrays.

    Args:
        record: a named tuple whose fields are declared.
        sizes: what names in shapes stand for.
    """
    return allocate_together(record, [sizes])[0]


def allocate_together(
    record: type[R], sizes: Sequence[Mapping[str, int]], common: Container[str] = ()
) -> tuple[R, ...]:
    """Allocate several records in one block of memory, with the initial values of their arrays.

    Args:
        record: a named tuple whose fields are declared.
        sizes: of each record, the sizes by name in shapes.
        common: sizes such as "vehicle": arrays whose first axis has one of these exist once for all records.
    """
    fields = declared(cast(Any, record))
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {}
    for row, own in enumerate(sizes):
        for field in fields:
            shape = tuple(own[size] if isinstance(size, str) else size for size in field.shape)
            shapes.setdefault(_key(field, row, common), (field.type, shape))
    made = _in_one_block(record, shapes, len(sizes))
    for one in made:
        for field, array in zip(fields, arrays_of(one).values(), strict=True):
            if field.first:
                array[...] = field.first
    return made


def with_arrays(record: type[R], arrays: Arrays) -> R:
    """Allocate a record with copies of given arrays by name.

    Raises:
        KeyError: one is missing.
    """
    return with_arrays_together(record, [arrays])[0]


def with_arrays_together(record: type[R], arrays: Sequence[Arrays], common: Container[str] = ()) -> tuple[R, ...]:
    """Allocate several records in one block of memory, with copies of given arrays of each by name.

    Args:
        record: a named tuple whose fields are declared.
        arrays: of each record; `common` ones of the first.
        common: as in `allocate_together`.

    Raises:
        KeyError: one is missing.
    """
    fields = declared(cast(Any, record))
    given = {}
    for row, own in enumerate(arrays):
        for field in fields:
            if (key := _key(field, row, common)) not in given:
                given[key] = own[field.name]
    made = _in_one_block(record, {key: (array.dtype, array.shape) for key, array in given.items()}, len(arrays))
    for row, one in enumerate(made):
        for field, array in zip(fields, arrays_of(one).values(), strict=True):
            array[...] = given[_key(field, row, common)]
    return made


def is_common(field: Declared, common: Container[str]) -> bool:
    """Return whether a declared array exists once for all records of one block of memory."""
    return bool(field.shape) and field.shape[0] in common


def _key(field: Declared, row: int, common: Container[str]) -> str:
    """Name of an array of record number `row` in the structured dtype of a memory block that several records share."""
    return field.name if is_common(field, common) else f"{row}/{field.name}"


def _in_one_block(record: type[R], shapes: Mapping[str, tuple[Any, tuple[int, ...]]], count: int) -> tuple[R, ...]:
    """Allocate several records of zeros in one block of memory."""
    offsets, size = [], 0
    for kind, shape in shapes.values():
        offsets.append(size)
        size += -(-int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize // ALIGNMENT) * ALIGNMENT
    formats = [(kind, shape) for kind, shape in shapes.values()]
    layout = np.dtype({"names": list(shapes), "formats": formats, "offsets": offsets, "itemsize": max(size, 1)})
    block = np.zeros(1, layout)
    return tuple(_views(record, block, row) for row in range(count))


def _views(record: type[R], block: NDArray[Any], row: int, within: str = "") -> R:
    """Record number `row` of a block of memory, its arrays being views of the block."""
    fields: list[Any] = []
    for name, kind in _kinds(cast(Any, record)):
        key = f"{within}{name}"
        if kind is not None:
            fields.append(_views(kind, block, row, f"{key}."))
        elif name == MEMORY:
            fields.append(block.view(np.uint8))
        else:
            own = f"{row}/{key}"
            fields.append(block[own if own in block.dtype.fields else key][0])  # type: ignore[operator]
    return record(*fields)


@cache
def _kinds(record: Any) -> tuple[tuple[str, Any], ...]:
    """Field names of a record class, each with the field's class if that is a record, else None."""
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
    """Independent copy of a record, on a copy of its whole block of memory."""
    return Kept(record).records[0]  # type: ignore[no-any-return]


def write(source: Any, target: Any) -> None:
    """Copy all arrays of a record into another one of equal shapes, from Python without a kernel."""
    target.memory[:] = source.memory


class Kept:
    """Copy of the block of memory of one or several records, whose array views are created on demand.

    Args:
        records: one or several in the same block.
    """

    __slots__ = ("_like", "_records", "memory")

    def __init__(self, *records: Any) -> None:
        self._like: tuple[Any, ...] = records
        self._records: tuple[Any, ...] = ()
        self.memory: Memory = records[0].memory.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Kept records for copies and other processes, as their block of memory."""
        records = self.records
        return _kept, (records[0].memory.base, [(type(one), _row_of(one)) for one in records])

    @property
    def records(self) -> tuple[Any, ...]:
        """Records on the copied memory; writing to their arrays changes the copy."""
        if not self._records:
            block = np.empty(1, self._like[0].memory.base.dtype)
            block.view(np.uint8)[:] = self.memory
            self._records = tuple(_views(type(one), block, _row_of(one)) for one in self._like)
            self.memory = self._records[0].memory
        return self._records

    @property
    def record(self) -> Any:
        """First of the copied records, on the copied memory."""
        return self.records[0]


def _kept(block: NDArray[Any], records: Sequence[tuple[type, int]]) -> Kept:
    """Kept records of a block of memory, from the class and the number of each."""
    return Kept(*(_views(kind, block, row) for kind, row in records))


def _row_of(record: Any) -> int:
    """Index of a record among all records of its block of memory."""
    block, arrays = record.memory.base, arrays_of(record)
    for name in block.dtype.names:
        row, slash, key = name.partition("/")
        if slash and key in arrays and block[name].ctypes.data == arrays[key].ctypes.data:
            return int(row)
    return 0
