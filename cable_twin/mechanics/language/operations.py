"""Cached type inference of operations on numbers and arrays, resolved once in a process.

numba tries all that an operator may mean, of texts, lists and sets as well, each time that it meets one.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NopythonTypeInference

PLAIN = types.Number, types.Boolean, types.Array  # what an operation has no other meaning for, wherever it stands
MODULES = "_operator", "builtins", "math"
_found: dict[tuple[Any, ...], Any] = {}


@register_pass(mutates_CFG=True, analysis_only=False)
class FindTypes(NopythonTypeInference):
    """Type inference pass of numba, with cached types of operations."""

    _name = "find_types"

    def run_pass(self, state: Any) -> bool:
        """Run numba's type inference with the caching context."""
        context = state.typingctx
        state.typingctx = _WithFound(context)
        try:
            return bool(super().run_pass(state))
        finally:
            state.typingctx = context


class _WithFound:
    """Typing context with a cache of operations."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: tuple[Any, ...], named: Any) -> Any:
        """Signature of an operation or call; None without one."""
        meant = getattr(function, "typing_key", function)
        if named or getattr(meant, "__module__", "") not in MODULES or not all(isinstance(a, PLAIN) for a in arguments):
            return self._context.resolve_function_type(function, arguments, named)
        key = function, *arguments
        if key not in _found:
            signature = self._context.resolve_function_type(function, arguments, named)
            if signature is None:
                return None
            _found[key] = signature
        return _found[key]


__all__ = ["FindTypes"]
