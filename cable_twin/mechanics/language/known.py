"""Fields of a record whose values are part of its type: kernels are compiled without what those rule out.

A field that is `Known` is one value to all kernels that take the record. Where that says that something is absent,
nothing of it is compiled, nor run: half of what the mechanics can do is in no single scenario.
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
    """Put the values of known fields in place of the fields, and leave out what they rule out."""

    _name = "put_known"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """As numba asks for it."""
        found = False
        for block in state.func_ir.blocks.values():
            for assign in block.find_insts(ir.Assign):
                kind = _kind_of(assign.value, state)
                if isinstance(kind, KnownType):
                    assign.value = ir.Const(kind.value, assign.loc)
                    found = True
        if found:
            state.func_ir._definitions = build_definitions(state.func_ir.blocks)
            dead_branch_prune(state.func_ir, state.args)
        return found


def _kind_of(value: Any, state: Any) -> types.Type | None:
    """Type of a field of what the function is given, or of a record in it."""
    if isinstance(value, ir.Var):
        value = guard(get_definition, state.func_ir, value)
    if isinstance(value, ir.Arg):
        return state.args[value.index]  # type: ignore[no-any-return]
    if isinstance(value, ir.Expr) and value.op == "getattr":
        owner = _kind_of(value.value, state)
        if isinstance(owner, RecordType) and value.attr in owner.names:
            return owner.kinds[owner.names.index(value.attr)]
    return None


def known_fields(kinds: tuple[types.Type, ...]) -> set[str]:
    """Names of the known fields of records, and of records in those."""
    records = [kind for kind in kinds if isinstance(kind, RecordType)]
    inner = (known_fields(record.kinds) for record in records)
    fields = (pair for record in records for pair in zip(record.names, record.kinds, strict=True))
    return {name for name, kind in fields if isinstance(kind, KnownType)}.union(*inner)


def names_left(function: Any, kinds: tuple[types.Type, ...]) -> set[str]:
    """Names of what a function for arguments of these types takes from its module, without what they rule out."""
    state = SimpleNamespace(func_ir=run_frontend(function), args=kinds)
    PutKnown().run_pass(state)
    assigned = (one.value for block in state.func_ir.blocks.values() for one in block.find_insts(ir.Assign))
    return {value.name for value in assigned if isinstance(value, ir.Global)}
