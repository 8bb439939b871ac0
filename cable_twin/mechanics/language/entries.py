"""Calls of compiled kernels by the address of their machine code, and atomic counters for threads.

A kernel that names another one takes its code in; a kernel that calls it by address runs the very machine code that
Python calls, and is compiled in no time.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.compilation import Kernel

_intrinsic: Any = intrinsic  # its stub asks for the typing context in a call
_config: Any = numba.config

# what an integrator returns, the fields of `stepping.Outcome`
OUTCOME = types.Tuple(
    (
        types.boolean,
        *(types.int64, types.int64, types.int64),
        *(types.float64, types.float64),
        types.int64,
        *(types.float64, types.float64),
    )
)
NOTHING = types.none  # of a kernel that fills what it is given
_UNCOMPILED: dict[int, Any] = {}  # functions by the number that stands for their address, with the JIT off


def address_of(function: Any, arguments: tuple[Any, ...], returned: types.Type) -> int:
    """Address of a kernel's machine code for arguments with which Python has called it before.

    Args:
        function: the kernel.
        arguments: of its calls.
        returned: type of what it returns.

    Raises:
        TypeError: the kernel returns another type.
        KeyError: the kernel is not compiled for such arguments.
    """
    if not isinstance(function, Kernel):
        _UNCOMPILED[id(function)] = function
        return id(function)
    compiled = function.compiled_for(tuple(numba.typeof(pack(one)) for one in arguments))
    if compiled.signature.return_type != returned:
        raise TypeError(f"{function.title}: given a result of {compiled.signature.return_type}; allowed: {returned}")
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def _caller(returned: types.Type) -> Any:
    """Numba intrinsic that calls the kernel at an address with a tuple of arguments, for one return type."""

    @_intrinsic
    def call(typingctx: Any, address: Any, arguments: Any) -> Any:
        if not isinstance(arguments, types.BaseTuple) or not isinstance(address, types.Integer):
            return None
        kinds: tuple[Any, ...] = tuple(arguments.types)  # type: ignore[attr-defined]

        def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
            convention = context.call_conv
            kind = convention.get_function_type(returned, kinds)
            function = builder.inttoptr(values[0], kind.as_pointer())
            given = cgutils.unpack_tuple(builder, values[1], len(kinds))
            _, result = convention.call_function(builder, function, returned, kinds, given)
            return result

        return returned(address, arguments), generate

    return call


def _call_in_python(address: int, arguments: Any) -> Any:
    return _UNCOMPILED[int(address)](*arguments)


# Call of the kernel at an address, with a tuple of its arguments: an integrator, and one that returns nothing.
call_integrator: Any = _call_in_python if _config.DISABLE_JIT else _caller(OUTCOME)
call_reader: Any = _call_in_python if _config.DISABLE_JIT else _caller(types.none)


@_intrinsic
def _take(typingctx, counter, index):
    if not isinstance(counter, types.Array) or counter.dtype != types.int64 or not isinstance(index, types.Integer):
        return None

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        array = make_array(counter)(context, builder, values[0])
        place = builder.gep(array.data, [values[1]])
        return builder.atomic_rmw("add", place, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter, index), generate


def _take_in_python(counter: Any, index: int) -> int:
    counter[index] += 1
    return int(counter[index]) - 1


# Number at an index of a counter, which grows by one: no two threads get one number.
take_number: Any = _take_in_python if _config.DISABLE_JIT else _take
