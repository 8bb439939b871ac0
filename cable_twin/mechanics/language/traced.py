"""Traced formulas: Python functions of few numbers, inlined instruction by instruction into kernels.

numba runs the Python of a formula while it compiles a kernel, with stand-ins for the numbers that note what is done
with them. So a formula may be of any Python that does not ask for the value of a number: loops and conditions on
lengths of tuples are gone by then, as the dimension is. To compile a formula as a kernel of its own, for each of its
types, took a tenth of a second.

Tuples of numbers come into a formula as vectors (`Vec`), tuples of vectors of one length as matrices (`Mat`, by rows),
so that it reads as in theory.md: m @ (a - b) + c * d.

A product and what it is added to, or subtracted from, are rounded once, by the one instruction that CPUs have for both.
Which products are is found as the formula is traced, and not by the compiler, so that a formula has the same bits in
every kernel.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, lower_cast, models, register_model
from numba.np.arrayobj import make_array

from cable_twin.basics.cpu import machine
from cable_twin.mechanics.language.target import target

_WORD = ir.IntType(32)


class LanesType(types.Type):
    """Numba type of a SIMD register of `width` floats."""

    def __init__(self, width: int) -> None:
        self.width, self.vector = width, ir.VectorType(ir.DoubleType(), width)
        super().__init__(name=f"lanes{width}")

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Conversion | None:
        """Allow numba to convert a number to SIMD lanes of equal values."""
        return Conversion.promote if isinstance(other, (types.Float, types.Integer)) else None


LANES = LanesType(4)  # of elements; a processor with registers of two numbers takes two
PAIR = LanesType(2)  # in formulas alone


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


_RANKS = types.int64, types.float64, LANES, PAIR  # what one of them and another one make is the later of both
_INSTRUCTIONS = {  # of integers and of all others; division of integers is of what is not negative
    "add": ("add", "fadd"),
    "sub": ("sub", "fsub"),
    "mul": ("mul", "fmul"),
    "truediv": ("", "fdiv"),
    "floordiv": ("sdiv", ""),
    "mod": ("srem", ""),
}


class Vec(tuple[Any, ...]):
    """Vector of numbers, traced or not, with the operators of vectors; @ is its product with a vector or a matrix."""

    __slots__ = ()
    __array_priority__ = 1.0  # a number of numpy leaves its product with a vector to that

    @property
    def entries(self) -> tuple[Any, ...]:
        """All numbers of the vector."""
        return self

    def __add__(self, other: Any) -> Any:
        return Vec(x + y for x, y in zip(self, other, strict=True))

    def __sub__(self, other: Any) -> Any:
        return Vec(x - y for x, y in zip(self, other, strict=True))

    def __neg__(self) -> Any:
        return Vec(-x for x in self)

    def __mul__(self, factor: Any) -> Any:
        return Vec(factor * x for x in self)

    __rmul__ = __mul__

    def __matmul__(self, other: Any) -> Any:
        if isinstance(other, Mat):
            return other.T @ self
        return sum(x * y for x, y in zip(self, other, strict=True))


class Mat(tuple[Vec, ...]):
    """Matrix of numbers, a tuple of its rows, with the operators of matrices; @ with a vector or a matrix."""

    __slots__ = ()
    __array_priority__ = 1.0

    @property
    def entries(self) -> tuple[Any, ...]:
        """All numbers of the matrix, row by row."""
        return tuple(x for row in self for x in row)

    @property
    def T(self) -> Mat:  # noqa: N802 - as numpy has it
        """Transpose of the matrix."""
        return Mat(map(Vec, zip(*self, strict=True)))

    def __add__(self, other: Any) -> Any:
        return Mat(x + y for x, y in zip(self, other, strict=True))

    def __sub__(self, other: Any) -> Any:
        return Mat(x - y for x, y in zip(self, other, strict=True))

    def __neg__(self) -> Any:
        return Mat(-x for x in self)

    def __mul__(self, factor: Any) -> Any:
        return Mat(factor * row for row in self)

    __rmul__ = __mul__

    def __matmul__(self, other: Any) -> Any:
        if isinstance(other, Mat):
            columns = other.T
            return Mat(Vec(row @ column for column in columns) for row in self)
        return Vec(row @ other for row in self)


def _shaped(value: Any) -> Any:
    """Convert a tuple of numbers to a vector, of vectors of one length to a matrix; other tuples recursively."""
    if not isinstance(value, tuple) or isinstance(value, Vec | Mat):
        return value
    parts = [_shaped(part) for part in value]
    if type(value) is not tuple:  # a named one
        return type(value)(*parts)
    if not any(isinstance(part, tuple) for part in parts):
        return Vec(parts)
    even = all(isinstance(part, Vec) and len(part) == len(parts[0]) for part in parts)
    return Mat(parts) if even else tuple(parts)


def _plain(value: Any) -> Any:
    """Convert vectors and matrices of a formula into plain tuples."""
    if isinstance(value, Vec | Mat) or type(value) is tuple:
        return tuple(map(_plain, value))
    return value


def formula(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: trace a function of numbers, lanes, arrays and tuples into the kernels that call it.

    The function takes positional arguments only, reads and writes entries of arrays by indices that are not negative,
    and returns numbers and tuples of them. Called from Python with plain tuples, it returns plain tuples.
    """

    @functools.wraps(function)
    def shaped(*arguments: Any) -> Any:
        inner = any(isinstance(argument, Vec | Mat | _Number | _Array) for argument in arguments)
        outcome = _shaped(function(*map(_shaped, arguments)))
        return outcome if inner else _plain(outcome)

    _trace(shaped)
    return shaped


def _trace(function: Callable[..., Any]) -> None:
    """Register a formula with numba: its type inference, and the instructions that its call becomes."""

    class _Typing(AbstractTemplate):
        key = function

        def generic(self, arguments: Any, keywords: Any) -> Any:
            if keywords:
                return None
            try:
                outcome = function(*(_stand_in(kind, None, None) for kind in arguments))
            except (AttributeError, IndexError, TypeError, ValueError) as error:
                raise TypingError(f"{function.__name__}{arguments}: {error}") from None
            return signature(_kind_of(outcome), *arguments)

    infer_global(function, types.Function(_Typing))

    @lower_builtin(function, types.VarArg(types.Any))
    def _lower(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        place = context, builder
        outcome = function(*(_stand_in(*pair, place) for pair in zip(kinds.args, values, strict=True)))
        return _value_of(outcome, kinds.return_type, place)


class _Number:
    """Stand-in for a number while a formula is traced: its numba type, and later its value in the compiled code.

    A product keeps its factors, for the sums that it goes into; it is multiplied out where it is used otherwise.
    """

    __slots__ = ("_value", "factors", "kind", "place")

    def __init__(self, kind: types.Type, value: ir.Value | None, place: Any, factors: Any = None) -> None:
        self.kind, self._value, self.place = kind, value, place
        self.factors: tuple[_Number, _Number] | None = factors

    @property
    def value(self) -> ir.Value | None:
        """Value of a traced number in the compiled code; None during type inference."""
        if self._value is None and self.factors is not None and self.place is not None:
            self._value = self.place[1].fmul(*(factor.cast(self.kind) for factor in self.factors))
        return self._value

    def cast(self, kind: types.Type) -> ir.Value | None:
        """Value in the compiled code of the traced number, converted to another numba type."""
        if self.place is None:
            return None
        context, builder = self.place
        return context.cast(builder, self.value, self.kind, kind)

    def _with(self, name: str, other: Any, turned: bool = False) -> Any:
        if isinstance(other, tuple):  # whose operator it is
            return NotImplemented
        if not isinstance(other, _Number):
            other = _constant(other, self.place)
        kind = max(self.kind, other.kind, key=_RANKS.index)
        if name == "truediv" and kind == types.int64:
            kind = types.float64
        if self.place is None:
            return _Number(kind, None, None)
        operands = (other, self) if turned else (self, other)
        if kind != types.int64:
            if name == "mul" and fuses():
                return _Number(kind, None, self.place, operands)
            if name in ("add", "sub") and any(operand.factors is not None for operand in operands):
                return _fused(name, operands[0], operands[1], kind)
        instruction = getattr(self.place[1], _INSTRUCTIONS[name][kind != types.int64])
        return _Number(kind, instruction(*(operand.cast(kind) for operand in operands)), self.place)

    def __add__(self, other: Any) -> Any:
        return self._with("add", other)

    def __radd__(self, other: Any) -> Any:
        return self if type(other) is int and other == 0 else self._with("add", other, turned=True)  # as `sum` begins

    def __sub__(self, other: Any) -> Any:
        return self._with("sub", other)

    def __rsub__(self, other: Any) -> Any:
        return self._with("sub", other, turned=True)

    def __mul__(self, other: Any) -> Any:
        return self._with("mul", other)

    def __rmul__(self, other: Any) -> Any:
        return self._with("mul", other, turned=True)

    def __floordiv__(self, other: Any) -> Any:
        return self._with("floordiv", other)

    def __mod__(self, other: Any) -> Any:
        return self._with("mod", other)

    def __truediv__(self, other: Any) -> Any:
        return self._with("truediv", other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._with("truediv", other, turned=True)

    def square_root(self) -> Any:
        """Square root of a traced number, or of each of its lanes."""
        if self.place is None:
            return self
        return _call("llvm.sqrt", self.kind, [self.value], self.place)

    def __bool__(self) -> bool:
        raise TypeError("condition in a formula: given one on the value of a number; allowed: one on lengths and types")

    def __eq__(self, other: object) -> bool:
        raise TypeError("condition in a formula: given one on the value of a number; allowed: one on lengths and types")

    __hash__ = None  # type: ignore[assignment]

    def __neg__(self) -> Any:
        if self.place is None:
            return self
        if self.factors is not None:
            return _Number(self.kind, None, self.place, (-self.factors[0], self.factors[1]))
        negated = self.place[1].neg if self.kind == types.int64 else self.place[1].fneg
        return _Number(self.kind, negated(self.value), self.place)


def _fused(name: str, one: _Number, other: _Number, kind: types.Type) -> _Number:
    """Sum or difference of two traced numbers, of which one is a product, as a fused multiply-add with one rounding."""
    builder = one.place[1]
    product, rest = (other, one) if other.factors is not None else (one, other)
    assert product.factors is not None
    a, b = (factor.cast(kind) for factor in product.factors)
    c = rest.cast(kind)
    if name == "sub":  # one - a b, or a b - other
        a, c = (builder.fneg(a), c) if product is other else (a, builder.fneg(c))
    return _call("llvm.fma", kind, [a, b, c], one.place)


def _call(name: str, kind: types.Type, values: Sequence[Any], place: Any) -> _Number:
    """Result of an intrinsic function of LLVM, of floats or of lanes, whose arguments have the type of its result."""
    context, builder = place
    of_lanes = f"v{kind.width}f64" if isinstance(kind, LanesType) else "f64"
    llvm = context.get_value_type(kind)
    function = ir.FunctionType(llvm, [llvm] * len(values))
    called = cgutils.get_or_insert_function(builder.module, function, f"{name}.{of_lanes}")
    return _Number(kind, builder.call(called, values), place)


@functools.cache
def fuses() -> bool:
    """Return whether the CPUs of the compilation target have a fused multiply-add instruction."""
    return "+fma" in target().features.split(",") or not machine().startswith("x86")


class _Array:
    """Traced array of a formula, or a sub-array of it at leading indices.

    Its start address is computed once for all its entries: with numba's own indexing this took a third of the
    instructions of a kernel.
    """

    __slots__ = ("_steps", "_where", "axis", "before", "index", "kind", "place", "value")
    __iter__ = None  # by its entries it would go on for ever

    def __init__(self, kind: types.Array, value: ir.Value | None, place: Any) -> None:
        self.kind, self.value, self.place, self.axis = kind, value, place, 0
        self.before: _Array | None = None
        self.index: _Number | None = None
        self._where: ir.Value | None = None
        self._steps: list[ir.Value] = []  # bytes from one entry of an axis to the next

    def at(self, index: Any) -> _Array:
        """Traced entry or sub-array at one or some leading indices."""
        entry = self
        for one in index if isinstance(index, tuple) else (index,):
            after = _Array(self.kind, self.value, self.place)
            after.before, after.index, after.axis = entry, _as_number(one, self.place), entry.axis + 1
            entry = after
        return entry

    def start(self) -> ir.Value:
        """Pointer to the first entry of the traced array or sub-array."""
        if self._where is None:
            context, builder = self.place
            if self.before is None or self.index is None:
                array = make_array(self.kind)(context, builder, self.value)
                self._where = array.data
                self._steps = cgutils.unpack_tuple(builder, array.strides, self.kind.ndim)
            else:
                before, index = self.before.start(), self.index.cast(types.intp)
                self._steps = self.before._steps
                if isinstance(index, ir.Constant) and index.constant == 0:
                    self._where = before
                elif self.kind.layout == "C" and self.axis == self.kind.ndim:
                    self._where = builder.gep(before, [index])
                else:
                    way = builder.mul(index, self._steps[self.axis - 1])
                    self._where = cgutils.pointer_add(builder, before, way, before.type)
        return self._where

    def __getitem__(self, index: Any) -> Any:
        entry = self.at(index)
        if entry.axis < self.kind.ndim:
            return entry
        value = None if self.place is None else self.place[1].load(entry.start())
        return _Number(self.kind.dtype, value, self.place)

    def __setitem__(self, index: Any, value: Any) -> None:
        if self.place is not None:
            self.place[1].store(_as_number(value, self.place).cast(self.kind.dtype), self.at(index).start())


def _stand_in(kind: Any, value: ir.Value | None, place: Any) -> Any:
    """Traced stand-in for an argument of a formula, from its numba type and its value in the compiled code."""
    if isinstance(kind, types.BaseTuple):
        kinds: Any = kind
        parts = [None] * len(kind) if place is None else cgutils.unpack_tuple(place[1], value, len(kind))
        parts = [_stand_in(*pair, place) for pair in zip(kinds, parts, strict=True)]
        return kinds.instance_class(*parts) if isinstance(kind, types.BaseNamedTuple) else _shaped(tuple(parts))
    if isinstance(kind, types.Array):
        return _Array(kind, value, place)
    plain = types.unliteral(kind)
    if plain not in _RANKS:
        raise TypeError(f"argument of a formula: given {kind}; allowed: numbers, lanes, arrays and tuples of them")
    return _Number(plain, value, place)


def _constant(value: Any, place: Any) -> _Number:
    if not isinstance(value, int | float):
        raise TypeError(f"number in a formula: given {type(value).__name__}; allowed: int, float or a traced number")
    kind = types.int64 if isinstance(value, int) else types.float64
    return _Number(kind, None if place is None else place[0].get_constant(kind, value), place)


def _as_number(value: Any, place: Any) -> _Number:
    return value if isinstance(value, _Number) else _constant(value, place)


def _kind_of(outcome: Any) -> types.Type:
    """Numba type of the result of a formula."""
    if outcome is None:
        return types.none
    if isinstance(outcome, tuple):
        record = type(outcome) if hasattr(outcome, "_fields") else None
        return types.BaseTuple.from_types([_kind_of(part) for part in outcome], record)
    return _as_number(outcome, None).kind


def _value_of(outcome: Any, kind: Any, place: Any) -> ir.Value:
    """Value in the compiled code of the result of a formula."""
    context, builder = place
    if outcome is None:
        return context.get_dummy_value()
    if isinstance(outcome, tuple):
        parts = [_value_of(*pair, place) for pair in zip(outcome, kind, strict=True)]
        return context.make_tuple(builder, kind, parts)
    return _as_number(outcome, place).value


@formula
def square_root(value: Any) -> Any:
    """Square root of a number, or of each SIMD lane."""
    return value.square_root() if isinstance(value, _Number) else np.sqrt(value)


@formula
def exponential(value: Any) -> Any:
    """Exponential of a number, or of each SIMD lane."""
    if not isinstance(value, _Number):
        return np.exp(value)
    return value if value.place is None else _call("llvm.exp", value.kind, [value.value], value.place)


@formula
def if_less(one: Any, other: Any, then: Any, otherwise: Any) -> Any:
    """`then` where the float `one` is less than `other`, else `otherwise`; of SIMD lanes, lane by lane."""
    numbers = [one, other, then, otherwise]
    places = [number.place for number in numbers if isinstance(number, _Number)]
    if not places:
        return np.where(one < other, then, otherwise)[()]
    numbers = [_as_number(number, places[0]) for number in numbers]
    kind = max((number.kind for number in numbers), key=_RANKS.index)
    if places[0] is None:
        return _Number(kind, None, None)
    builder, (a, b, c, d) = places[0][1], [number.cast(kind) for number in numbers]
    return _Number(kind, builder.select(builder.fcmp_ordered("<", a, b), c, d), places[0])


def least(one: Any, other: Any) -> Any:
    """Lesser of two integers, for traced formulas."""
    if not isinstance(one, _Number):
        return min(one, other)
    if one.place is None:
        return one
    builder = one.place[1]
    lesser = builder.select(builder.icmp_signed("<", one.value, other.value), one.value, other.value)
    return _Number(one.kind, lesser, one.place)


def size_of(array: Any, axis: int) -> Any:
    """Size of an array along an axis, for traced formulas."""
    if not isinstance(array, _Array):
        return array.shape[axis]
    if array.place is None:
        return _Number(types.int64, None, None)
    context, builder = array.place
    shape = make_array(array.kind)(context, builder, array.value).shape
    return _Number(types.int64, builder.extract_value(shape, axis), array.place)


def as_lanes(numbers: Sequence[Any]) -> Any:
    """Numbers as the lanes of one SIMD register, for traced formulas."""
    if not isinstance(numbers[0], _Number):
        return np.array(numbers)
    kind, place = LanesType(len(numbers)), numbers[0].place
    if place is None:
        return _Number(kind, None, None)
    lanes = ir.Constant(kind.vector, ir.Undefined)
    for lane, number in enumerate(numbers):
        lanes = place[1].insert_element(lanes, number.cast(types.float64), ir.Constant(_WORD, lane))
    return _Number(kind, lanes, place)


def lane_of(lanes: Any, number: int) -> Any:
    """Number in one lane of a SIMD register, as a float."""
    if not isinstance(lanes, _Number):
        return lanes[number]
    value = None if lanes.place is None else lanes.place[1].extract_element(lanes.value, ir.Constant(_WORD, number))
    return _Number(types.float64, value, lanes.place)


def shuffled(one: Any, other: Any, lanes: Sequence[int]) -> Any:
    """SIMD register of lanes chosen by index from two registers, with indices that count on into the second one.

    For formulas: one instruction, which with `lane_of` and `as_lanes` the compiler would have to find.
    """
    if not isinstance(one, _Number):
        return np.concatenate([one, other])[list(lanes)]
    kind = LanesType(len(lanes))
    if one.place is None:
        return _Number(kind, None, None)
    chosen = ir.Constant(ir.VectorType(_WORD, len(lanes)), list(lanes))
    return _Number(kind, one.place[1].shuffle_vector(one.value, other.value, chosen), one.place)


def row_of(array: Any) -> Any:
    """View all numbers of a contiguous array, or of its entry at leading indices, as one row; for traced formulas.

    So the distance of a number from the first one is constant, where otherwise the sizes of axes would be read.
    """
    if not isinstance(array, _Array):
        return array.reshape(-1)
    if array.kind.layout != "C":
        raise TypeError(
            f"array of a formula as one row: given {array.kind}; allowed: a contiguous one, in row-major order"
        )
    whole = _Array(types.Array(array.kind.dtype, 1, "C"), None, array.place)
    if array.place is not None:
        whole._where = array.start()
    return whole


def read_lanes(array: Any, index: tuple[Any, ...], count: int) -> Any:
    """Read `count` adjacent numbers of an array in memory as SIMD lanes, from entry `index` on; for traced formulas."""
    if not isinstance(array, _Array):
        first = np.ravel_multi_index(index, array.shape)
        return array.reshape(-1)[first : first + count]
    kind = LanesType(count)
    if array.place is None:
        return _Number(kind, None, None)
    builder = array.place[1]
    place = builder.bitcast(array.at(index).start(), kind.vector.as_pointer())
    return _Number(kind, builder.load(place, align=8), array.place)


def write_lanes(lanes: Any, array: Any, index: tuple[Any, ...]) -> None:
    """Write SIMD lanes to consecutive numbers of an array in memory, from the entry `index` on; for traced formulas."""
    if not isinstance(array, _Array):
        first = np.ravel_multi_index(index, array.shape)
        array.reshape(-1)[first : first + LANES.width] = lanes
    elif array.place is not None:
        builder, lanes = array.place[1], _as_number(lanes, array.place).cast(LANES)
        builder.store(lanes, builder.bitcast(array.at(index).start(), LANES.vector.as_pointer()), align=8)


def _define(function: Callable[..., Any], instruction: str, operands: int = 2) -> None:
    """Define a Python operator on SIMD lanes, or lanes and a number, in kernels as one instruction."""

    @infer_global(function)
    class _Typing(ConcreteTemplate):
        cases = [signature(LANES, *[LANES] * operands)]  # noqa: RUF012 - numba wants a list

    @lower_builtin(function, *[LANES] * operands)
    def _lower(context: Any, builder: ir.IRBuilder, kinds: Any, values: Any) -> ir.Value:
        return getattr(builder, instruction)(*values)


_define(operator.neg, "fneg", operands=1)
for _name, _instruction in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _define(getattr(operator, _name), _instruction)
    _define(getattr(operator, f"i{_name}"), _instruction)
