"""Compilation of kernels by numba: once, without the interpreter lock, and cached on disk.

No `fastmath`: with the arithmetic of IEEE 754 as written, results do not depend on what the compiler inlines where,
so that a fresh compilation, a cached one and another process agree to the last bit. Where a product and a sum are
rounded once is said by the formulas themselves (`traced`).

No memory management either (`_nrt`): a kernel works in the arrays that it is given, and one that would allocate does
not compile. Counting references to those arrays took three quarters of a step.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numba

from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.kernel_cache import FROM_KERNELS, FROM_PYTHON, KernelCache, title_of
from cable_twin.mechanics.language.linking import BriefCompiler, PartCompiler, WholeCompiler

_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "_nrt": False,
}
_AS_PART: dict[str, Any] = {"pipeline_class": PartCompiler, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

# Options of an `overload`, which is compiled as a kernel that others call.
OVERLOAD: Any = {"error_model": "numpy", **_AS_PART}


class Kernel:
    """Compiled function with two entry points, each compiled on demand: for Python and for other kernels.

    The conversion of Python objects into the dozens of arrays of a state and back is larger than most kernels; one that
    only others call is compiled without it, and without machine code of its own (`linking`). A closure or lambda is not
    kept for other processes: its name does not tell it from others of the same lines.
    """

    def __init__(
        self, function: Callable[..., Any], compiler: type[WholeCompiler] = WholeCompiler, **options: Any
    ) -> None:
        """Register the function with numba for calls from other kernels, without compiling it."""
        functools.update_wrapper(self, function)
        self.py_func = function
        self._options = {"pipeline_class": compiler, **_OPTIONS, **options}
        self._from_kernels: Any = _decorated(function, FROM_KERNELS, {**_OPTIONS, **options, **_AS_PART})
        self._numba_type_ = self._from_kernels._numba_type_  # what numba takes it for where a kernel names it

    @functools.cached_property
    def _from_python(self) -> Any:
        return _decorated(self.py_func, FROM_PYTHON, self._options)

    @property
    def title(self) -> str:
        """Name of the kernel in the list of cached kernels."""
        return title_of(self.py_func)

    @property
    def kinds_loaded(self) -> set[tuple[str, str]]:
        """Kind of call (from Python or kernels) and title of all code of this kernel loaded from the cache so far."""
        both = {FROM_PYTHON: self._from_python, FROM_KERNELS: self._from_kernels}
        return {(kind, self.title) for kind, compiled in both.items() if any(compiled.stats.cache_hits.values())}

    def is_kept(self, arguments: tuple[Any, ...]) -> bool:
        """Return whether the disk cache holds the kernel for calls from Python with arguments of these types."""
        cache = self._from_python._cache
        return isinstance(cache, KernelCache) and cache.has(tuple(numba.typeof(pack(one)) for one in arguments))

    def compiled_for(self, kinds: tuple[Any, ...]) -> Any:
        """Numba's compilation result of the kernel for calls from Python with these argument types.

        Raises:
            KeyError: Python has not called it with such arguments yet.
        """
        return self._from_python.overloads[kinds]

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel, compiled on the first call for its argument types or loaded from the cache."""
        return self._from_python(*map(pack, arguments))


def _decorated(function: Callable[..., Any], kind: str, options: dict[str, Any]) -> Any:
    """Numba dispatcher of a function, with a disk cache for its `kind` of call, from Python or from kernels."""
    compiled: Any = numba.njit(**options)(function)
    if "<" not in function.__qualname__:  # <locals>, <lambda>
        compiled._cache = KernelCache(function, kind)
    return compiled


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: compile on the first call, or load from the cache; plain Python with NUMBA_DISABLE_JIT=1."""
    config: Any = numba.config
    return function if config.DISABLE_JIT else Kernel(function)


def brief_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: kernel for a single short run, compiled faster with less optimisation."""
    config: Any = numba.config
    return function if config.DISABLE_JIT else Kernel(function, BriefCompiler)


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: kernel inlined into its callers, for calls in every iteration."""
    config: Any = numba.config
    return function if config.DISABLE_JIT else Kernel(function, forceinline=True)


def as_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """Plain Python function of a kernel that calls no other kernels, for rare calls on a few numbers."""
    return function.py_func if isinstance(function, Kernel) else function
