"""Declared ranges of the arrays of a record, for checks of states read from files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

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


__all__ = ["ANY", "CLOCK", "HUGEST", "Range", "range_faults", "ranges_of"]
