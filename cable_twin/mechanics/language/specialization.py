"""Specialization of kernels by compile-time constants in the types of their arguments.

A field of a record that is `Known` is one value to all kernels that take the record. Where that says that something is
absent, nothing of it is compiled, nor run: half of what the mechanics can do is in no single scenario. So it is with
lengths of tuples, wherever they come from: in a plane nothing of what is for space is compiled.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from numba.core import ir, types
from numba.core.analysis import dead_branch_prune
from numba.core.compiler import run_frontend
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import build_definitions, get_definition, guard

from cable_twin.mechanics.language.by_reference import KnownType, RecordType


@register_pass(mutates_CFG=True, analysis_only=False)
class PutKnown(FunctionPass):
    """Compiler pass of numba: replace `Known` fields of records by their values, and prune dead branches."""

    _name = "put_known"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Run the pass on a function's intermediate code; return whether anything was replaced (numba's interface)."""
        found = False
        for block in state.func_ir.blocks.values():
            for assign in block.find_insts(ir.Assign):
                value = _known_value(assign.value, state)
                if value is not None:
                    assign.value = ir.Const(value, assign.loc)
                    found = True
        if found:
            state.func_ir._definitions = build_definitions(state.func_ir.blocks)
            dead_branch_prune(state.func_ir, state.args)
        return found


def _known_value(value: Any, state: Any) -> int | None:
    """Value of an expression that is a `Known` field or the length of a tuple; None for run-time values."""
    if isinstance(value, ir.Expr) and value.op == "call" and len(value.args) == 1:
        called = guard(get_definition, state.func_ir, value.func)
        kind = _kind_of(value.args[0], state)
        if isinstance(called, ir.Global) and called.value is len and isinstance(kind, types.BaseTuple):
            return len(kind)
    kind = _kind_of(value, state)
    return kind.value if isinstance(kind, KnownType) else None


def _kind_of(value: Any, state: Any) -> types.Type | None:
    """Numba type of an expression: function argument, or field of a record or tuple in one; None for others."""
    if isinstance(value, ir.Var):
        value = guard(get_definition, state.func_ir, value)
    if isinstance(value, ir.Arg):
        return state.args[value.index]  # type: ignore[no-any-return]
    if isinstance(value, ir.Expr) and value.op == "getattr":
        owner: Any = _kind_of(value.value, state)
        if isinstance(owner, RecordType) and value.attr in owner.names:
            return owner.kinds[owner.names.index(value.attr)]  # type: ignore[no-any-return]
        fields = getattr(owner, "fields", ()) if isinstance(owner, types.BaseNamedTuple) else ()
        if value.attr in fields:
            return owner[fields.index(value.attr)]  # type: ignore[no-any-return]
    return None


def known_fields(kinds: tuple[types.Type, ...]) -> set[str]:
    """Names of the `Known` fields of record types and of their inner records."""
    records = [kind for kind in kinds if isinstance(kind, RecordType)]
    inner = (known_fields(record.kinds) for record in records)
    fields = (pair for record in records for pair in zip(record.names, record.kinds, strict=True))
    return {name for name, kind in fields if isinstance(kind, KnownType)}.union(*inner)


def names_left(function: Any, kinds: tuple[types.Type, ...]) -> set[str]:
    """Names of the globals that a function still uses after specialization for argument types."""
    state = SimpleNamespace(func_ir=run_frontend(function), args=kinds)
    PutKnown().run_pass(state)
    assigned = (one.value for block in state.func_ir.blocks.values() for one in block.find_insts(ir.Assign))
    return {value.name for value in assigned if isinstance(value, ir.Global)}
