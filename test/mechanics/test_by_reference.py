"""Records in kernels: the fields that were given, of any kind, at any depth, and no others."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from cable_twin.mechanics.by_reference import by_reference
from cable_twin.mechanics.compilation import as_python, kernel


@by_reference
class Inner(NamedTuple):
    """Part of a record."""

    count: int
    weight: float
    present: bool
    vector: tuple[float, ...]
    table: NDArray[np.float64]


@by_reference
class Outer(NamedTuple):
    """Record with a record in it."""

    inner: Inner
    flags: NDArray[np.bool_]
    numbers: NDArray[np.int64]


def records(table, dim=2):
    inner = Inner(3, 0.25, True, tuple(float(i) for i in range(dim)), table)
    return Outer(inner, np.array([True, False, True]), np.arange(4, dtype=np.int64))


@kernel
def deeper(inner, i, j):
    """Take a part of a record from another kernel."""
    return inner.table[i, j]


@kernel
def read(outer, result):
    """Read every kind of field, in a loop in which the arrays of the record are written to."""
    inner = outer.inner
    for k in range(inner.count):
        result[k] = inner.weight + (10.0 if inner.present else 0.0) + inner.vector[-1] + len(inner.vector)
        result[k] += deeper(inner, k, 1) + inner.table.shape[1] + inner.table.size
        if outer.flags[k]:
            result[k] += 1000.0 * outer.numbers[k + 1]
        inner.table[k, 0] = result[k]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "table", [np.ones((3, 2)), np.asfortranarray(np.ones((3, 2))), np.ones((6, 4))[::2, ::2]], ids=["C", "F", "A"]
)
def test_kernel_reads_what_the_record_holds(table, dim):
    table = table.copy(order="K") if table.flags.contiguous else table
    compiled, plain = np.zeros(3), np.zeros(3)
    read(records(table, dim), compiled)
    after = table.copy()
    as_python(read)(records(table, dim), plain)
    np.testing.assert_array_equal(compiled, plain)
    np.testing.assert_array_equal(after[:, 0], compiled)
    assert compiled[0] == 0.25 + 10.0 + (dim - 1) + dim + 1.0 + 2 + 6 + 1000.0


def test_type_tells_layouts_and_lengths_apart():
    kinds = {numba.typeof(records(table, dim)) for table in (np.ones((3, 2)), np.ones((3, 2)).T) for dim in (2, 3)}
    assert len(kinds) == 4
    assert numba.typeof(records(np.zeros((7, 2)))) in kinds  # but not sizes


def test_unknown_field_is_an_error():
    @numba.njit(_nrt=False)
    def misread(outer):
        return outer.weight

    with pytest.raises((numba.TypingError, AttributeError), match="weight"):
        misread(records(np.ones((3, 2))))


def test_what_is_no_array_is_refused():
    read(records(np.ones((3, 2))), np.zeros(3))
    with pytest.raises((numba.TypingError, TypeError)):
        read(records(None), np.zeros(3))
