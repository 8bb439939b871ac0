"""Records passed to kernels by reference: all fields of any kind and depth, unchanged."""

from __future__ import annotations

import gc
import weakref
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from cable_twin.mechanics.language.by_reference import REMEMBERED, by_reference, pack
from cable_twin.mechanics.language.compilation import as_python, kernel


@by_reference
class Inner(NamedTuple):
    """Inner record."""

    count: int
    weight: float
    present: bool
    vector: tuple[float, ...]
    table: NDArray[np.float64]


@by_reference
class Outer(NamedTuple):
    """Record with an inner record."""

    inner: Inner
    flags: NDArray[np.bool_]
    numbers: NDArray[np.int64]


def records(table, dim=2):
    inner = Inner(3, 0.25, True, tuple(float(i) for i in range(dim)), table)
    return Outer(inner, np.array([True, False, True]), np.arange(4, dtype=np.int64))


@kernel
def deeper(inner, i, j):
    """Read a field of an inner record in another kernel."""
    return inner.table[i, j]


@kernel
def read(outer, result):
    """Read every kind of field within a loop that writes to the arrays of the record."""
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


needs_jit = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is packed")


def result_of(outer):
    result = np.zeros(3)
    read(outer, result)
    return result


@needs_jit
def test_words_and_what_they_point_to_live_as_long_as_what_is_packed():
    """All other references to record, arrays and memory are dropped, and equal memory is allocated again."""
    expected = result_of(records(np.full((3, 2), 2.0)))
    kept = pack(records(np.full((3, 2), 2.0)))
    address = kept.address
    for number in range(3 * REMEMBERED):
        pack(records(np.full((3, 2), float(number))))
    gc.collect()
    filled = [np.full((3, 2), -1.0) for _ in range(1000)]
    assert pack(kept) is kept  # what is packed stays as it is
    assert kept.address == address
    np.testing.assert_array_equal(result_of(kept), expected)
    assert len(filled) == 1000


@needs_jit
def test_types_of_fields_that_are_kept_are_those_that_numba_finds():
    """Arrays that differ in kind, order, or in whether they may be written, twice each."""
    fixed = np.ones((3, 2))
    fixed.flags.writeable = False
    tables = [
        np.ones((3, 2)),
        np.ones((3, 2), np.float32),
        np.ones(3),
        np.ones((2, 3)).T,
        np.ones((6, 4))[::2, ::2],
        fixed,
    ]
    for table in 2 * tables:
        inner = records(table).inner
        assert pack(inner)._numba_type_.kinds == tuple(map(numba.typeof, inner))
    names = {pack(records(table).inner)._numba_type_.name for table in tables}
    assert len(names) == len(tables)


@needs_jit
def test_arrays_of_what_is_packed_may_change_in_place():
    table = np.ones((3, 2))
    outer = records(table)
    kept = pack(outer)
    before = result_of(kept)
    table[:, 1] += 5.0
    outer.flags[1], outer.numbers[1] = True, 7
    np.testing.assert_array_equal(result_of(kept) - before, [5.0 + 6000.0, 5.0 + 2000.0, 5.0])
    assert table[2, 0] == result_of(kept)[2]  # and what the kernel writes is in them


@needs_jit
def test_records_handed_over_last_are_remembered_and_no_others():
    """A record passed repeatedly is packed once, and others are released."""
    used = records(np.ones((3, 2)))
    kept = pack(used)
    tables = []
    for _ in range(2 * REMEMBERED):
        table = np.ones((3, 2))
        tables.append(weakref.ref(table))
        pack(records(table))
        assert pack(used) is kept
    del table
    gc.collect()
    assert sum(table() is not None for table in tables) == REMEMBERED - 1


def test_what_is_no_record_is_not_packed():
    for argument in (3.0, "text", np.zeros(2), (1.0, 2.0), None):
        assert pack(argument) is argument


@needs_jit
@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("table", None, "NoneType"),
        ("table", [[1.0, 2.0]], "list"),
        ("vector", (1, 2), "tuple"),
        ("vector", ("x", 2.0), "tuple"),
        ("weight", "heavy", "str"),
        ("weight", 1j, "complex"),
        ("weight", np.float32(0.5), "float32"),
        ("count", np.int32(3), "int32"),
        ("present", object(), "object"),
    ],
)
def test_what_no_record_holds_is_named_in_one_line(field, value, kind):
    outer = records(np.ones((3, 2)))
    with pytest.raises(TypeError) as caught:
        pack(outer._replace(inner=outer.inner._replace(**{field: value})))
    assert str(caught.value).startswith(f"Inner.{field}: given {kind}; allowed: arrays, int, float, bool")
    assert "\n" not in str(caught.value)


@needs_jit
def test_a_record_that_nobody_packed_is_an_error_of_a_plain_function():
    """`kernel` packs its arguments; numba alone finds no address in a tuple."""

    @numba.njit(_nrt=False)
    def weight(inner):
        return inner.weight

    inner = records(np.ones((3, 2))).inner
    assert weight(pack(inner)) == 0.25
    with pytest.raises(AttributeError, match="address"):
        weight(inner)
