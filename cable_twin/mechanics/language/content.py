"""Fingerprint of a function: a short text, equal only for functions that compile to equal code.

numba names compiled code after the module, the qualified name, the types of the arguments and a running number, which
is another one in each process; and what it keeps of a function, it finds by the bytes of its instructions and by what
its closure holds. Closures of one factory, lambdas of one function, and formulas that differ in a number are not told
apart by all of that once they come from processes that have counted alike.
"""

from __future__ import annotations

import hashlib
import weakref
from collections.abc import Iterator
from types import CodeType, FunctionType
from typing import Any

from numba.core.typing.templates import builtin_registry

_KNOWN: weakref.WeakKeyDictionary[Any, str] = weakref.WeakKeyDictionary()
_OVERLOADS: dict[FunctionType, list[Any]] = {}
_READ = [0]  # of numba's list of what is registered
_PLAIN = (int, float, complex, bool, str, bytes, type(None), tuple, frozenset)


def content_of(function: Any) -> str:
    """Fingerprint of a function, from its instructions, constants, closure, defaults and all names used.

    Kernels, overloads and intrinsics that it calls are followed; of anything else that is no number, the name counts.
    """
    known = _KNOWN.get(function)
    if known is None:
        _KNOWN[function] = ""  # for one that calls itself
        content = hashlib.sha256()
        for part in _parts(function):
            content.update(part.encode() + b"\0")
        known = _KNOWN[function] = content.hexdigest()[:16]
    return known


def _parts(function: Any) -> Iterator[str]:
    yield from _code(function.__code__)
    for cell in function.__closure__ or ():
        yield _value(cell.cell_contents)
    yield _value(function.__defaults__)
    for name in sorted(_names(function.__code__)):
        if name in function.__globals__:
            yield f"{name} = {_value(function.__globals__[name])}"


def _code(code: CodeType) -> Iterator[str]:
    yield f"{code.co_code!r} {code.co_varnames} {code.co_names} {code.co_freevars}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(constant)


def _names(code: CodeType) -> set[str]:
    """Global names used by a code object and its inner functions."""
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*inner)


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_value, value))})"
    if isinstance(value, _PLAIN):
        return repr(value)
    function = getattr(value, "py_func", getattr(value, "_defn", value))  # of a kernel, of an intrinsic
    if isinstance(function, FunctionType):
        given = [content_of(overload) for overload in _overloads_of(function)]
        return f"{function.__module__}.{function.__qualname__} {content_of(function)} {given}"
    return f"{type(value).__qualname__} {getattr(value, '__name__', '')}"


def _overloads_of(function: FunctionType) -> list[Any]:
    """Overloads registered in numba for a plain function."""
    registered = builtin_registry.globals
    for value, kind in registered[_READ[0] :]:
        if isinstance(value, FunctionType):
            made = [getattr(template, "_overload_func", None) for template in kind.templates]
            _OVERLOADS.setdefault(value, []).extend(filter(None, made))
    _READ[0] = len(registered)
    return _OVERLOADS.get(function, [])


__all__ = ["content_of"]
