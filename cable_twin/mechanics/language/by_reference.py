"""Named tuples of parameters and states, passed to kernels and between kernels as one pointer.

numba passes a tuple by value, a state as some 400 words in every call and in every variable. Here the words are written
once, by `pack`, and a kernel reads of them what it names. No kernel writes to them (what their arrays hold is another
matter), which the loads say, so that they leave a loop. To hand a packed state over takes a third of a microsecond.
"""

from __future__ import annotations

import hashlib
import struct
from collections import OrderedDict
from collections.abc import Set
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.errors import NumbaError
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.core.typing.typeof import typeof_impl
from numba.extending import NativeValue, lower_getattr_generic, models, register_model, unbox

_WORD = ir.IntType(32)


class Known(int):
    """Compile-time constant in a record: an integer or condition that is part of its type, see `specialization`."""


class KnownType(types.Type):
    """Numba type of one compile-time constant (`Known`)."""

    def __init__(self, value: int) -> None:
        self.value = value
        super().__init__(name=f"known {value}")


register_model(KnownType)(models.OpaqueModel)


@typeof_impl.register(Known)
def _typeof_known(value: Known, context: Any) -> KnownType:
    return KnownType(int(value))


class RecordType(types.Type):
    """Numba type of a named tuple that is passed to kernels by reference."""

    def __init__(self, record: Any, kinds: tuple[types.Type, ...]) -> None:
        self.names: tuple[str, ...] = record._fields
        self.kinds = kinds
        content = hashlib.sha256(repr(kinds).encode()).hexdigest()[
            :12
        ]  # short: compiled code names symbols after types
        super().__init__(name=f"&{record.__name__} {content}")


_RECORDS: set[type] = set()


def by_reference(record: type) -> type:
    """Class decorator: pass a named tuple by reference to kernels."""
    _RECORDS.add(record)

    @typeof_impl.register(record)
    def _typeof(value: Any, context: Any) -> RecordType:
        return RecordType(record, tuple(map(typeof, value)))

    return record


@register_model(RecordType)
class _RecordModel(models.PrimitiveModel):
    """Numba data model of a record: an opaque address, since its full type is longer than most kernels."""

    def __init__(self, manager: Any, kind: RecordType) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, record: Any, name: str) -> Any:  # type: ignore[override]
        kind = record.kinds[record.names.index(name)] if name in record.names else None
        return types.literal(kind.value) if isinstance(kind, KnownType) else kind


@lower_getattr_generic(RecordType)
def read_field(context: Any, builder: ir.IRBuilder, record: RecordType, pointer: ir.Value, name: str) -> ir.Value:
    """Emit code that reads a field of a record, by one inlined function per field and module to keep code short."""
    known = record.kinds[record.names.index(name)]
    if isinstance(known, KnownType):
        return context.get_constant(types.int64, known.value)
    kind = context.get_value_type(record.kinds[record.names.index(name)])
    function = ir.FunctionType(kind, [pointer.type])
    reader = cgutils.get_or_insert_function(builder.module, function, f"read {name} of {record}")
    if reader.is_declaration:
        reader.linkage = "internal"
        reader.attributes.add("alwaysinline")
        body = ir.IRBuilder(reader.append_basic_block())
        words = ir.LiteralStructType([context.get_value_type(field) for field in record.kinds])
        index = record.names.index(name)
        owner = {0, 1} if isinstance(record.kinds[index], types.Array) else set()  # nothing here counts references
        place = body.bitcast(reader.args[0], words.as_pointer())
        body.ret(_load(body, place, [ir.Constant(_WORD, 0), ir.Constant(_WORD, index)], kind, owner))
    return builder.call(reader, [pointer])


def _load(
    builder: ir.IRBuilder, pointer: ir.Value, path: list[ir.Constant], kind: ir.Type, leave_out: Set[int] = frozenset()
) -> ir.Value:
    """Emit code that loads a value word by word, since LLVM loses the invariance of a load of several words."""
    if isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        parts = kind.elements if isinstance(kind, ir.LiteralStructType) else [kind.element] * kind.count
        value = ir.Constant(kind, None if leave_out else ir.Undefined)
        for number, part in enumerate(parts):
            if number not in leave_out:
                piece = _load(builder, pointer, [*path, ir.Constant(_WORD, number)], part)
                value = builder.insert_value(value, piece, number)
        return value
    loaded = builder.load(builder.gep(pointer, path, inbounds=True))
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


class Packed:
    """Record packed in the memory layout of kernels: its words, and the owners of all memory they point to."""

    __slots__ = ("_numba_type_", "_owners", "_words", "address")

    def __init__(self, record: Any) -> None:
        """Pack a record of a `by_reference` class, and its inner records, into machine words.

        Raises:
            TypeError: one line: a field has a type that no record holds.
        """
        fields = [Packed(field) if type(field) in _RECORDS else field for field in record]
        self._owners = record, fields
        kinds: list[types.Type] = []
        words: list[Any] = []
        layout = "@"  # aligned as C, and LLVM, align a structure
        for name, field in zip(record._fields, fields, strict=True):
            try:
                kinds.append(_kind_of(field))
                form, values = _words(field, kinds[-1])
            except (TypeError, ValueError, NumbaError):
                raise TypeError(
                    f"{type(record).__name__}.{name}: given {type(field).__name__}; "
                    "allowed: arrays, int, float, bool, tuples of floats and records"
                ) from None
            layout += form
            words += values
        self._numba_type_ = _record_type(type(record), tuple(kinds))
        self._words = np.frombuffer(struct.pack(layout, *words), np.uint8)
        self.address = self._words.ctypes.data


_ARRAYS: dict[tuple[Any, ...], types.Type] = {}  # numba finds the type of an array in 15 µs, anew each time
_TYPES: dict[tuple[Any, ...], RecordType] = {}  # by the class and its kinds, which live as long as the type


def _kind_of(field: Any) -> types.Type:
    """Numba type of a field of a record; types of arrays are cached."""
    if isinstance(field, Packed):
        return field._numba_type_
    if type(field) is not np.ndarray:
        return typeof(field)
    flags = field.flags
    key = field.dtype, field.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable
    if key not in _ARRAYS:
        _ARRAYS[key] = typeof(field)
    return _ARRAYS[key]


def _record_type(record: Any, kinds: tuple[types.Type, ...]) -> RecordType:
    """Numba type of the records of a class whose fields have these types."""
    key = record, *map(id, kinds)
    if key not in _TYPES:
        _TYPES[key] = RecordType(record, kinds)
    return _TYPES[key]


@typeof_impl.register(Packed)
def _typeof_packed(value: Packed, context: Any) -> RecordType:
    return value._numba_type_


_FORMS = {types.boolean: "?", types.int64: "q", types.float64: "d"}


def _words(field: Any, kind: types.Type) -> tuple[str, tuple[Any, ...]]:
    """Format and values, as for `struct.pack`, of one field of a record in the memory layout of kernels."""
    if isinstance(kind, types.Array):  # an array of numba: two owners, nobody here, then what follows
        sizes = (*field.shape, *field.strides)
        return f"PPqqP{len(sizes)}q", (0, 0, field.size, field.itemsize, field.__array_interface__["data"][0], *sizes)
    if isinstance(field, Packed):
        return "P", (field.address,)
    if isinstance(kind, types.UniTuple) and kind.dtype == types.float64:
        return f"{len(field)}d", tuple(field)
    if isinstance(kind, KnownType):
        return "P", (0,)  # nobody reads it
    if kind in _FORMS:
        return _FORMS[kind], (field,)
    raise TypeError


def pack(record: Any) -> Any:
    """Pack a record for calls of kernels, worth keeping for frequent calls; without JIT return the record itself.

    The contents of its arrays may change later, its fields may not. Anything that is no record is returned as it is.

    Raises:
        TypeError: one line: a field has a type that no record holds.
    """
    config: Any = numba.config
    if type(record) not in _RECORDS or config.DISABLE_JIT:
        return record
    known = _PACKED.pop(id(record), None) or (record, Packed(record))  # with the record: its id is its own till then
    _PACKED[id(record)] = known
    if len(_PACKED) > REMEMBERED:
        _PACKED.popitem(last=False)
    return known[1]


REMEMBERED = 16  # records that were handed over last: mostly it is the same ones again
_PACKED: OrderedDict[int, tuple[Any, Packed]] = OrderedDict()  # each step above is whole, also between threads


@unbox(RecordType)
def _unbox_record(kind: RecordType, value: ir.Value, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(value, "address")
    unpacked = cgutils.is_null(c.builder, number)  # an AttributeError then
    address = cgutils.alloca_once_value(c.builder, cgutils.get_null_value(cgutils.voidptr_t))
    with cgutils.if_likely(c.builder, c.builder.not_(unpacked)):
        c.builder.store(c.pyapi.long_as_voidptr(number), address)
        c.pyapi.decref(number)
    place = c.builder.load(address)
    # Nothing happens here, but LLVM may not know: a load that "does not change" must not move before the words above.
    same = ir.FunctionType(place.type, [place.type])
    return NativeValue(c.builder.asm(same, "", "=r,0,~{memory}", [place], side_effect=True), is_error=unpacked)
