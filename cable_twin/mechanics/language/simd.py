"""SIMD lanes: four numbers in one register, for one formula on four elements at once.

A value of lanes takes the place of a float in the formulas of an element, which are written for either. Each lane has
the arithmetic of IEEE 754 that a float would have, so the results are the same to the last bit. With the JIT off,
lanes are arrays of numpy.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, overload, register_model

from cable_twin.mechanics.language.compilation import OVERLOAD

_intrinsic: Any = intrinsic  # its stub asks for the typing context in a call

WIDTH = 4  # lanes; a processor with registers of two numbers takes two


class LanesType(types.Type):
    """SIMD type in numba of `width` floats."""

    def __init__(self, width: int) -> None:
        self.width, self.vector = width, ir.VectorType(ir.DoubleType(), width)
        super().__init__(name=f"lanes{width}")

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Conversion | None:
        """Allow conversion of a number to lanes, equal in all of them."""
        return Conversion.promote if isinstance(other, (types.Float, types.Integer)) else None


LANES = LanesType(WIDTH)
PAIR = LanesType(2)  # in formulas alone
_VECTOR = LANES.vector
_WORD = ir.IntType(32)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, kind.vector)


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _repeat(context: Any, builder: ir.IRBuilder, source: Any, target: Any, value: ir.Value) -> ir.Value:
    number = context.cast(builder, value, source, types.float64)
    first = builder.insert_element(ir.Constant(target.vector, ir.Undefined), number, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(_WORD, target.width), [0] * target.width))


def put_beside(builder: ir.IRBuilder, numbers: Sequence[ir.Value]) -> ir.Value:
    """Combine floats of compiled code into the lanes of one value."""
    lanes = ir.Constant(ir.VectorType(ir.DoubleType(), len(numbers)), ir.Undefined)
    for lane, number in enumerate(numbers):
        lanes = builder.insert_element(lanes, number, ir.Constant(_WORD, lane))
    return lanes


def take_lane(builder: ir.IRBuilder, lanes: ir.Value, lane: int) -> ir.Value:
    """Extract the float of one lane."""
    return builder.extract_element(lanes, ir.Constant(_WORD, lane))


def _define(function: Callable[..., Any], instruction: str, operands: int = 2) -> None:
    """Define a Python operator between lanes, or lanes and a number, as one instruction."""

    @infer_global(function)
    class _Typing(ConcreteTemplate):
        cases = [signature(LANES, *[LANES] * operands)]  # noqa: RUF012 - numba wants a list

    @lower_builtin(function, *[LANES] * operands)
    def _lower(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        return getattr(builder, instruction)(*values)


_define(operator.neg, "fneg", operands=1)
for _plain, _in_place, _instruction in (
    (operator.add, operator.iadd, "fadd"),
    (operator.sub, operator.isub, "fsub"),
    (operator.mul, operator.imul, "fmul"),
    (operator.truediv, operator.itruediv, "fdiv"),
):
    _define(_plain, _instruction)
    _define(_in_place, _instruction)


@_intrinsic
def _read(typingctx, coordinates, first, like):
    """Lanes of both ends of elements from `first` on; past the last element, lanes repeat the last one.

    What a node has is loaded at once, as it stands in memory, and then turned into lanes.
    """
    vector = types.UniTuple(LANES, like.count)
    whole = types.UniTuple(vector, 4)

    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        array = context.make_array(kinds.args[0])(context, builder, values[0])
        nodes, _, _ = cgutils.unpack_tuple(builder, array.shape, 3)
        first, size = values[1], 2 * like.count
        last = builder.sub(nodes, ir.Constant(first.type, 2))
        stored = ir.VectorType(ir.DoubleType(), size).as_pointer()
        rows: tuple[list[ir.Value], list[ir.Value]] = [], []
        for lane in range(WIDTH):
            element = builder.add(first, ir.Constant(first.type, lane))
            element = builder.select(builder.icmp_signed("<", element, last), element, last)
            for end in range(2):
                node = builder.add(element, ir.Constant(first.type, end))
                place = builder.gep(array.data, [builder.mul(node, ir.Constant(first.type, size))])
                rows[end].append(builder.load(builder.bitcast(place, stored), align=8))
        vectors = []
        for end in range(2):
            lanes = [
                put_beside(builder, [take_lane(builder, row, number) for row in rows[end]]) for number in range(size)
            ]
            slots = lanes[: like.count], lanes[like.count :]
            vectors += [context.make_tuple(builder, vector, slot) for slot in slots]
        return context.make_tuple(builder, whole, vectors)

    return whole(coordinates, types.intp, like), generate


def gather(coordinates: Any, first: int, like: tuple[float, ...]) -> tuple[Any, ...]:
    """r_A, slope A, r_B, slope B, vectors (dim,) of lanes, of `WIDTH` elements from `first` on.

    Takes `coordinates` (nodes, 2, dim) or their rates. Past the last element, that one is repeated.
    """
    nodes = np.minimum(first + np.arange(WIDTH), coordinates.shape[0] - 2)
    ends = coordinates[nodes], coordinates[nodes + 1]
    return tuple(tuple(end[:, slot, k] for k in range(len(like))) for end in ends for slot in range(2))


@overload(gather, jit_options=OVERLOAD)
def _gather(coordinates, first, like):
    def lanes(coordinates, first, like):
        return _read(coordinates, first, like)

    return lanes


@_intrinsic
def _read_numbers(typingctx, numbers, first):
    """Lanes of numbers[first + lane]; past the last number, lanes repeat the last one."""

    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        array = context.make_array(kinds.args[0])(context, builder, values[0])
        first = values[1]
        last = builder.sub(array.nitems, ir.Constant(first.type, 1))
        numbers = []
        for lane in range(WIDTH):
            place = builder.add(first, ir.Constant(first.type, lane))
            place = builder.select(builder.icmp_signed("<", place, last), place, last)
            numbers.append(builder.load(builder.gep(array.data, [place])))
        return put_beside(builder, numbers)

    return LANES(numbers, types.intp), generate


def gather_numbers(numbers: Any, first: int) -> Any:
    """Lanes of `WIDTH` entries of `numbers` (elements,) from `first` on; the last one is repeated past the end."""
    return numbers[np.minimum(first + np.arange(WIDTH), numbers.size - 1)]


@overload(gather_numbers, jit_options=OVERLOAD)
def _gather_numbers(numbers, first):
    def lanes(numbers, first):
        return _read_numbers(numbers, first)

    return lanes


@_intrinsic
def _read_row(typingctx, rows, row, first):
    """Lanes of rows[row, first + lane]."""

    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        array = context.make_array(kinds.args[0])(context, builder, values[0])
        _, columns = cgutils.unpack_tuple(builder, array.shape, 2)
        place = builder.gep(array.data, [builder.add(builder.mul(values[1], columns), values[2])])
        return builder.load(builder.bitcast(place, _VECTOR.as_pointer()), align=8)

    return LANES(rows, types.intp, types.intp), generate


def gather_vectors(rows: Any, first: int, like: tuple[float, ...]) -> tuple[Any, ...]:
    """Vectors (dim,) of lanes of `WIDTH` columns of `rows` (dim, n) from `first` on, all within `rows`."""
    return tuple(rows[axis, first : first + WIDTH] for axis in range(len(like)))


@overload(gather_vectors, jit_options=OVERLOAD)
def _gather_vectors(rows, first, like):
    def planar(rows, first, like):
        return _read_row(rows, 0, first), _read_row(rows, 1, first)

    def spatial(rows, first, like):
        return _read_row(rows, 0, first), _read_row(rows, 1, first), _read_row(rows, 2, first)

    return planar if like.count == 2 else spatial


@_intrinsic
def _write(typingctx, lanes, row):
    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        array = context.make_array(kinds.args[1])(context, builder, values[1])
        builder.store(values[0], builder.bitcast(array.data, _VECTOR.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(LANES, row), generate


def spread(values: tuple[Any, ...], rows: Any, first: int) -> None:
    """Write a tuple of lanes to as many rows of `rows` (rows, WIDTH), from row `first` on."""
    for i in range(len(values)):
        rows[first + i] = values[i]


@overload(spread, jit_options=OVERLOAD)
def _spread(values, rows, first):
    def write(values, rows, first):
        for i in range(len(values)):
            _write(values[i], rows[first + i])

    return write


@_intrinsic
def _add(typingctx, lanes, row):
    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        array = context.make_array(kinds.args[1])(context, builder, values[1])
        place = builder.bitcast(array.data, _VECTOR.as_pointer())
        builder.store(builder.fadd(builder.load(place, align=8), values[0]), place, align=8)
        return context.get_dummy_value()

    return types.void(LANES, row), generate


def add_spread(values: tuple[Any, ...], rows: Any, first: int) -> None:
    """Add a tuple of lanes to as many rows of `rows` (rows, WIDTH), from row `first` on."""
    for i in range(len(values)):
        rows[first + i] += values[i]


@overload(add_spread, jit_options=OVERLOAD)
def _add_spread(values, rows, first):
    def add(values, rows, first):
        for i in range(len(values)):
            _add(values[i], rows[first + i])

    return add


@_intrinsic
def _lane(typingctx, lanes, number):
    def generate(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        return builder.extract_element(values[0], builder.trunc(values[1], _WORD))

    return types.float64(LANES, types.intp), generate


def sum_of_lanes(lanes: Any) -> float:
    """Sum of all lanes, from the first one on."""
    return float(sum(lanes))


@overload(sum_of_lanes, jit_options=OVERLOAD)
def _sum_of_lanes(lanes):
    def total(lanes):
        result = 0.0
        for number in range(WIDTH):
            result += _lane(lanes, number)
        return result

    return total
