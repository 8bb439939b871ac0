"""Traced formulas: Python functions of few numbers, inlined instruction by instruction into kernels.

numba runs the Python of a formula while it compiles a kernel, with stand-ins for the numbers that note what is done
with them. So a formula may be of any Python that does not ask for the value of a number: loops and conditions on
lengths of tuples are gone by then, as the dimension is. To compile a formula as a kernel of its own, for each of its
types, took a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin
from numba.np.arrayobj import make_array

from cable_twin.mechanics.language.simd import LANES, PAIR, LanesType, put_beside, take_lane

_Function = TypeVar("_Function", bound=Callable[..., Any])
_RANKS = types.int64, types.float64, LANES, PAIR  # what one of them and another one make is the later of both
_INSTRUCTIONS = {  # of integers and of all others; division of integers is of what is not negative
    "add": ("add", "fadd"),
    "sub": ("sub", "fsub"),
    "mul": ("mul", "fmul"),
    "truediv": ("", "fdiv"),
    "floordiv": ("sdiv", ""),
    "mod": ("srem", ""),
}


def formula(function: _Function) -> _Function:
    """Decorator: trace a function of numbers, lanes, arrays and tuples into the kernels that call it.

    It takes its arguments by their places, reads and writes entries of arrays by indices that are not negative, and
    gives numbers and tuples of them.
    """

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

    return function


class _Number:
    """Traced number: its type, and its value in the compiled code once instructions are generated."""

    __slots__ = ("kind", "place", "value")

    def __init__(self, kind: types.Type, value: ir.Value | None, place: Any) -> None:
        self.kind, self.value, self.place = kind, value, place

    def cast(self, kind: types.Type) -> ir.Value | None:
        """Cast the value to another type."""
        if self.place is None:
            return None
        context, builder = self.place
        return context.cast(builder, self.value, self.kind, kind)

    def _with(self, name: str, other: Any, turned: bool = False) -> Any:
        if not isinstance(other, _Number):
            other = _constant(other, self.place)
        kind = max(self.kind, other.kind, key=_RANKS.index)
        if name == "truediv" and kind == types.int64:
            kind = types.float64
        if self.place is None:
            return _Number(kind, None, None)
        instruction = getattr(self.place[1], _INSTRUCTIONS[name][kind != types.int64])
        operands = (other, self) if turned else (self, other)
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
        """Square root of the number, or of each lane."""
        if self.place is None:
            return self
        context, builder = self.place
        kind, name = context.get_value_type(self.kind), "f64"
        if isinstance(self.kind, LanesType):
            name = f"v{self.kind.width}f64"
        root = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]), f"llvm.sqrt.{name}")
        return _Number(self.kind, builder.call(root, [self.value]), self.place)

    def beside(self, other: Any) -> Any:
        """Pair of this number and another one, as floats."""
        if self.place is None:
            return _Number(PAIR, None, None)
        floats = [number.cast(types.float64) for number in (self, other)]
        return _Number(PAIR, put_beside(self.place[1], floats), self.place)

    def lane(self, number: int) -> Any:
        """Float of one lane of a pair."""
        value = None if self.place is None else take_lane(self.place[1], self.value, number)
        return _Number(types.float64, value, self.place)

    def __bool__(self) -> bool:
        raise TypeError("a formula may not ask for the value of a number")

    def __eq__(self, other: object) -> bool:
        raise TypeError("a formula may not ask for the value of a number")

    __hash__ = None  # type: ignore[assignment]

    def __neg__(self) -> Any:
        if self.place is None:
            return self
        negated = self.place[1].neg if self.kind == types.int64 else self.place[1].fneg
        return _Number(self.kind, negated(self.value), self.place)


class _Array:
    """Traced array, or a sub-array by leading indices.

    Where it starts is worked out once, for all its entries: by numba's own way a third of the instructions of a kernel
    were of that.
    """

    __slots__ = ("_steps", "_where", "axis", "before", "index", "kind", "place", "value")
    __iter__ = None  # by its entries it would go on for ever

    def __init__(self, kind: types.Array, value: ir.Value | None, place: Any) -> None:
        self.kind, self.value, self.place, self.axis = kind, value, place, 0
        self.before: _Array | None = None
        self.index: _Number | None = None
        self._where: ir.Value | None = None
        self._steps: list[ir.Value] = []  # bytes from one entry of an axis to the next

    def _at(self, index: Any) -> _Array:
        entry = self
        for one in index if isinstance(index, tuple) else (index,):
            after = _Array(self.kind, self.value, self.place)
            after.before, after.index, after.axis = entry, _as_number(one, self.place), entry.axis + 1
            entry = after
        return entry

    def _start(self) -> ir.Value:
        """Pointer to the first entry of the array."""
        if self._where is None:
            context, builder = self.place
            if self.before is None or self.index is None:
                array = make_array(self.kind)(context, builder, self.value)
                self._where = array.data
                self._steps = cgutils.unpack_tuple(builder, array.strides, self.kind.ndim)
            else:
                before, index = self.before._start(), self.index.cast(types.intp)
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
        entry = self._at(index)
        if entry.axis < self.kind.ndim:
            return entry
        value = None if self.place is None else self.place[1].load(entry._start())
        return _Number(self.kind.dtype, value, self.place)

    def __setitem__(self, index: Any, value: Any) -> None:
        if self.place is not None:
            self.place[1].store(_as_number(value, self.place).cast(self.kind.dtype), self._at(index)._start())


def _stand_in(kind: Any, value: ir.Value | None, place: Any) -> Any:
    """Traced stand-in for an argument of a formula."""
    if isinstance(kind, types.BaseTuple):
        kinds: Any = kind
        parts = [None] * len(kind) if place is None else cgutils.unpack_tuple(place[1], value, len(kind))
        return tuple(_stand_in(*pair, place) for pair in zip(kinds, parts, strict=True))
    if isinstance(kind, types.Array):
        return _Array(kind, value, place)
    plain = types.unliteral(kind)
    if plain not in _RANKS:
        raise TypeError(f"a formula takes numbers, lanes, arrays and tuples of them, not {kind}")
    return _Number(plain, value, place)


def _constant(value: Any, place: Any) -> _Number:
    if not isinstance(value, int | float):
        raise TypeError(f"{type(value).__name__} where a number has to be")
    kind = types.int64 if isinstance(value, int) else types.float64
    return _Number(kind, None if place is None else place[0].get_constant(kind, value), place)


def _as_number(value: Any, place: Any) -> _Number:
    return value if isinstance(value, _Number) else _constant(value, place)


def _kind_of(outcome: Any) -> types.Type:
    """Type in numba of the result of a formula."""
    if outcome is None:
        return types.none
    if isinstance(outcome, tuple):
        return types.BaseTuple.from_types([_kind_of(part) for part in outcome])
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
    """Square root of a float, or of each lane."""
    return value.square_root() if isinstance(value, _Number) else np.sqrt(value)


@formula
def beside(one: Any, other: Any) -> Any:
    """Pair up the numbers of two tuples of one structure, for formulas on both at once."""
    if isinstance(one, tuple):
        return tuple(beside(*both) for both in zip(one, other, strict=True))
    return one.beside(other) if isinstance(one, _Number) else np.array([one, other])


@formula
def first_of(pairs: Any) -> Any:
    """First numbers of a tuple of pairs."""
    return _lanes_of(pairs, 0)


@formula
def second_of(pairs: Any) -> Any:
    """Second numbers of a tuple of pairs."""
    return _lanes_of(pairs, 1)


def _lanes_of(pairs: Any, place: int) -> Any:
    if isinstance(pairs, tuple):
        return tuple(_lanes_of(pair, place) for pair in pairs)
    return pairs.lane(place) if isinstance(pairs, _Number) else pairs[place]
