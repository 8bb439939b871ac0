"""Records of declared arrays in one block of memory, copied as one."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from systems import make_system

from cable_twin.mechanics.language.declared import (
    ALIGNMENT,
    Kept,
    Memory,
    Of,
    allocate,
    arrays_of,
    clone,
    declared,
    with_arrays,
    write,
)
from cable_twin.mechanics.solution.bundle.records import BundleState, BundleWork
from cable_twin.mechanics.state import State, Workspace, allocate_state, sizes_of


class Inner(NamedTuple):
    """Inner record whose arrays have the shape given by the outer one."""

    place: NDArray[np.float64]
    turn: NDArray[np.float64]


class Outer(NamedTuple):
    """Record of floats, integers and conditions."""

    inner: Annotated[Inner, Of("node", 2, unit="m"), Of("node", unit="rad", field="turn")]
    number: Annotated[NDArray[np.int64], Of("node", first=-1)]
    holds: Annotated[NDArray[np.bool_], Of(3, first=1)]
    memory: Memory


def test_arrays_have_the_declared_shapes_units_and_first_values():
    record = allocate(Outer, {"node": 5})
    assert {name: (array.shape, array.dtype) for name, array in arrays_of(record).items()} == {
        "inner.place": ((5, 2), np.float64),
        "inner.turn": ((5,), np.float64),
        "number": ((5,), np.int64),
        "holds": ((3,), np.bool_),
    }
    assert [field.unit for field in declared(Outer)] == ["m", "rad", "-", "-"]
    assert not record.inner.place.any()
    assert (record.number == -1).all()
    assert record.holds.all()


def test_all_arrays_are_in_one_block_each_where_registers_may_begin():
    record = allocate(Outer, {"node": 5})
    start = record.memory.ctypes.data
    for array in arrays_of(record).values():
        offset = array.ctypes.data - start
        assert 0 <= offset <= record.memory.size - array.nbytes
        assert offset % ALIGNMENT == 0
        assert array.flags.c_contiguous


def test_copies_are_independent_and_what_is_kept_may_be_written():
    record = allocate(Outer, {"node": 4})
    record.inner.place[:] = 2.0
    copy, kept = clone(record), Kept(record)
    record.inner.place[:] = 3.0
    assert (copy.inner.place == 2.0).all()
    kept.record.number[1] = 7
    write(kept, record)
    assert (record.inner.place == 2.0).all()
    assert record.number.tolist() == [-1, 7, -1, -1]
    again = with_arrays(Outer, arrays_of(record) | {"holds": np.zeros(3, np.bool_)})
    assert not again.holds.any()
    assert (again.inner.place == 2.0).all()


def test_an_array_without_a_shape_is_refused():
    class Open(NamedTuple):
        place: NDArray[np.float64]

    with pytest.raises(TypeError, match=r"Open\.place: given no shape"):
        declared(Open)


@pytest.mark.parametrize("record", [State, Workspace, BundleState, BundleWork])
def test_every_array_of_the_solver_has_a_unit(record):
    assert all(field.unit for field in declared(record))


@pytest.mark.parametrize("dim", [2, 3])
def test_sizes_of_a_system_are_those_of_its_state(dim):
    system = make_system(dim, chains=(2, 1))
    state, sizes = allocate_state(system), sizes_of(system)
    assert state.nodes.position.shape == (system.cable.element_count + 1, 3, dim)
    assert state.bodies.position.shape == (3, 3 if dim == 2 else 7)
    assert state.bodies.velocity.shape == (3, sizes["rate"])
    assert sum(array.nbytes for array in arrays_of(state).values()) <= state.memory.size
