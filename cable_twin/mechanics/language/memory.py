"""Contiguous arrays as flat rows of numbers in kernels, for block copies and elementwise loops."""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.types import Array
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from cable_twin.mechanics.language.compilation import inlined_kernel

_intrinsic: Any = intrinsic  # its stub asks for the typing context in a call


@_intrinsic
def _view(typingctx, array):
    if not isinstance(array, Array) or array.layout != "C":
        return None
    row = Array(array.dtype, 1, "C")

    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        source = make_array(array)(context, builder, values[0])
        result = make_array(row)(context, builder)
        size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(array.dtype)))
        owner = cgutils.get_null_value(result.meminfo.type), cgutils.get_null_value(result.parent.type)
        populate_array(result, source.data, [source.nitems], [size], size, *owner)
        return result._getvalue()

    return row(array), generate


def _reshape(array: Any) -> Any:
    return array.reshape(-1)


# All entries of a contiguous array in their order, (size,), in place. numba's own `ravel` counts as one that allocates.
_config: Any = numba.config
flat: Any = _reshape if _config.DISABLE_JIT else _view


@_intrinsic
def _copy(typingctx, source, target):
    if source != target or not isinstance(source, Array) or source.layout != "C":
        return None

    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        _write_copy(context, builder, source, *values)
        return context.get_dummy_value()

    return types.void(source, target), generate


def _write_copy(context: Any, builder: ir.IRBuilder, kind: Any, source: ir.Value, target: ir.Value) -> None:
    here, there = (make_array(kind)(context, builder, value) for value in (source, target))
    size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    cgutils.raw_memcpy(builder, there.data, here.data, here.nitems, context.get_constant(types.intp, size))


def _copy_in_python(source: Any, target: Any) -> None:
    target[...] = source


# Write the first array into the second one of its shape, both contiguous.
copy_array: Any = _copy_in_python if _config.DISABLE_JIT else _copy


@inlined_kernel
def combine_arrays(start, weight, rate, target):
    """Write start + weight rate into `target`, all arrays of one shape; `target` may be `start`."""
    begin, slope, there = flat(start), flat(rate), flat(target)
    for i in range(begin.size):
        there[i] = begin[i] + weight * slope[i]


@inlined_kernel
def add_array(source, target):
    """Add the array `source` to the array `target` of equal shape, both contiguous."""
    here, there = flat(source), flat(target)
    for i in range(there.size):
        there[i] += here[i]


@inlined_kernel
def clear_array(target):
    """Set all entries of an array to zero."""
    there = flat(target)
    for i in range(there.size):
        there[i] = 0.0
