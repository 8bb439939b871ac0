"""Named tuples of parameters and states, handed to kernels and between them as one pointer.

numba passes a tuple by value, a state as some 400 words in every call and in every variable. Here the words are written
once, where Python calls a kernel, and a kernel reads of them what it names. No kernel writes to them (what their arrays
hold is another matter), which the loads say, so that they leave a loop.
"""

from __future__ import annotations

from collections.abc import Set
from typing import Any

from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.core.typing.typeof import typeof_impl
from numba.extending import NativeValue, lower_getattr_generic, models, register_model, unbox

_WORD = ir.IntType(32)


class RecordType(types.Type):
    """numba's type of a named tuple that is passed by reference."""

    def __init__(self, record: Any, kinds: tuple[types.Type, ...]) -> None:
        self.names: tuple[str, ...] = record._fields
        self.kinds = kinds
        super().__init__(name=f"&{record.__name__}({', '.join(map(str, kinds))})")


def by_reference(record: type) -> type:
    """Class decorator for a named tuple."""

    @typeof_impl.register(record)
    def _typeof(value: Any, context: Any) -> RecordType:
        return RecordType(record, tuple(map(typeof, value)))

    return record


@register_model(RecordType)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: RecordType) -> None:
        words = ir.LiteralStructType([manager.lookup(field).get_value_type() for field in kind.kinds])
        super().__init__(manager, kind, words.as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, record: Any, name: str) -> Any:  # type: ignore[override]
        return record.kinds[record.names.index(name)] if name in record.names else None


@lower_getattr_generic(RecordType)
def _read_field(context: Any, builder: ir.IRBuilder, record: RecordType, pointer: ir.Value, name: str) -> ir.Value:
    """Call a function of its own for each field: it is written once in a module, and LLVM puts it in place."""
    kind = context.get_value_type(record.kinds[record.names.index(name)])
    function = ir.FunctionType(kind, [pointer.type])
    reader = cgutils.get_or_insert_function(builder.module, function, f"read {name} of {record}")
    if reader.is_declaration:
        reader.linkage = "internal"
        reader.attributes.add("alwaysinline")
        body = ir.IRBuilder(reader.append_basic_block())
        index = record.names.index(name)
        owner = {0, 1} if isinstance(record.kinds[index], types.Array) else set()  # nothing here counts references
        body.ret(_load(body, reader.args[0], [ir.Constant(_WORD, 0), ir.Constant(_WORD, index)], kind, owner))
    return builder.call(reader, [pointer])


def _load(
    builder: ir.IRBuilder, pointer: ir.Value, path: list[ir.Constant], kind: ir.Type, leave_out: Set[int] = frozenset()
) -> ir.Value:
    """Load word by word: LLVM splits a load of several words and forgets that they do not change."""
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


@unbox(RecordType)
def _unbox_record(kind: RecordType, value: ir.Value, c: Any) -> NativeValue:
    builder = c.builder
    place = cgutils.alloca_once(builder, c.context.get_value_type(kind).pointee)
    failed = cgutils.alloca_once_value(builder, cgutils.false_bit)
    for number, field in enumerate(kind.kinds):
        item = c.pyapi.tuple_getitem(value, number)
        word = cgutils.gep_inbounds(builder, place, 0, number)
        if isinstance(field, types.Array):  # a fifth of what numba writes for it, which checks the type once more
            error = cgutils.is_not_null(
                builder, c.pyapi.numba_array_adaptor(item, builder.bitcast(word, c.pyapi.voidptr))
            )
        else:
            native = c.unbox(field, item)
            builder.store(native.value, word)
            error = native.is_error
        builder.store(builder.or_(builder.load(failed), error), failed)
    # Nothing happens here, but LLVM may not know: a load that "does not change" must not move before the words above.
    same = ir.FunctionType(place.type, [place.type])
    pointer = builder.asm(same, "", "=r,0,~{memory}", [place], side_effect=True)
    return NativeValue(pointer, is_error=builder.load(failed))
