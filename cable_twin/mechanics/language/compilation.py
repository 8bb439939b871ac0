"""Compilation of kernels: once, without the interpreter lock, and cached on disk.

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
        """Set up compilation for other kernels, without compiling."""
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
        """Name of a kernel in the list of cached kernels."""
        return title_of(self.py_func)

    @property
    def kinds_loaded(self) -> set[tuple[str, str]]:
        """Kind and title of the compiled code that this process has loaded from the cache."""
        both = {FROM_PYTHON: self._from_python, FROM_KERNELS: self._from_kernels}
        return {(kind, self.title) for kind, compiled in both.items() if any(compiled.stats.cache_hits.values())}

    def is_kept(self, arguments: tuple[Any, ...]) -> bool:
        """Return whether the cache holds the kernel for calls from Python with arguments of these types."""
        cache = self._from_python._cache
        return isinstance(cache, KernelCache) and cache.has(tuple(numba.typeof(pack(one)) for one in arguments))

    def compiled_for(self, kinds: tuple[Any, ...]) -> Any:
        """Result of compilation for calls from Python with arguments of these types of numba.

        Raises:
            KeyError: there was no such call yet.
        """
        return self._from_python.overloads[kinds]

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel, compiled on the first call for its argument types or loaded from the cache."""
        return self._from_python(*map(pack, arguments))


def _decorated(function: Callable[..., Any], kind: str, options: dict[str, Any]) -> Any:
    """Dispatcher of numba for a function, with a cache of its kind."""
    compiled: Any = numba.njit(**options)(function)
    if "<" not in function.__qualname__:  # <locals>, <lambda>
        compiled._cache = KernelCache(function, kind)
    return compiled


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile `function` on its first call, or load it from the cache; plain Python with NUMBA_DISABLE_JIT=1."""
    config: Any = numba.config
    return function if config.DISABLE_JIT else Kernel(function)


def brief_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Kernel for a single short run, compiled faster with less optimisation."""
    config: Any = numba.config
    return function if config.DISABLE_JIT else Kernel(function, BriefCompiler)


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Kernel inlined into its callers, for calls in every iteration."""
    config: Any = numba.config
    return function if config.DISABLE_JIT else Kernel(function, forceinline=True)


def as_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """Uncompiled function of a kernel without calls of other kernels, for rare calls on a few numbers."""
    return function.py_func if isinstance(function, Kernel) else function
