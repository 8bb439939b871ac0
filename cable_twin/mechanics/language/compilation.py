"""Compilation of kernels: once, without the interpreter lock, and cached on disk.

No `fastmath`: with the arithmetic of IEEE 754 as written, results do not depend on what the compiler inlines where,
so that a fresh compilation, a cached one and another process agree to the last bit.

No memory management either (`_nrt`): a kernel works in the arrays that it is given, and one that would allocate does
not compile. Counting references to those arrays took three quarters of a step.
"""

from __future__ import annotations

import errno
import functools
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.fingerprint import Sources, sources
from cable_twin.mechanics.language.linking import BriefCompiler, KernelCache, PartCache, PartCompiler, WholeCompiler

FROM_PYTHON, FROM_KERNELS = "from_python", "from_kernels"  # directories for what is called from there
MECHANICS = Path(__file__).parents[1]
ROOM = 50 * 2**20  # bytes that a first compilation is sure to find enough


def sources_of(folder: Path) -> Sources:
    """Sources of the kernels of a folder: of the mechanics, and of the folder itself."""
    return sources(MECHANICS) if folder.is_relative_to(MECHANICS) else sources(MECHANICS, folder)


@functools.cache
def cache_directory(folder: Path) -> Path | None:
    """Cache directory of the compiled kernels of a folder, one for each version of their sources.

    That is the mechanics and their own folder, which `test_architecture` sees to; numba itself asks only whether the
    file of a kernel has changed, not those of the kernels that it calls. None, and a line that says so, where they
    cannot be kept: numba would take another place, in which it finds old ones.
    """
    name = f"kernels-{sources_of(folder).fingerprint}"
    if not folder.is_relative_to(MECHANICS):
        beside = cache_directory(MECHANICS)
        return None if beside is None else beside.parent / name
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    directory = Path(base) / "cable_twin" / name
    try:
        directory = directory.expanduser()
        filled = directory.is_dir()
        directory.parent.mkdir(parents=True, exist_ok=True)
        for own in (directory.parent, directory):
            own.mkdir(mode=0o755, exist_ok=True)
            refuse_shared(own)
        with tempfile.TemporaryFile(dir=directory):
            room = shutil.disk_usage(directory).free
        if room < ROOM and not filled:
            raise OSError(errno.ENOSPC, f"{room / 2**20:.0f} MB are free, {ROOM / 2**20:.0f} MB are needed")
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
        reason = getattr(error, "strerror", None) or error
        logging.getLogger("cable_twin").warning(
            "%s: %s: compiled kernels cannot be kept, every start compiles them; NUMBA_CACHE_DIR names another place",
            directory,
            reason,
        )
        return None
    return directory


def refuse_shared(directory: Path) -> None:
    """Refuse a directory writable by others, who could place code in the cache of this process.

    What only the group of this user may write is closed to it: some systems make all directories so.

    Raises:
        PermissionError: others may write there, or it is theirs.
    """
    found = directory.stat()
    if found.st_uid not in (0, os.geteuid()):
        raise PermissionError(errno.EPERM, f"it belongs to another user ({found.st_uid})", str(directory))
    if found.st_mode & 0o002 or (found.st_mode & 0o020 and found.st_gid != os.getegid()):
        raise PermissionError(errno.EPERM, f"others may write there (mode {found.st_mode & 0o777:o})", str(directory))
    if found.st_mode & 0o020:
        directory.chmod(found.st_mode & 0o755)


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
        self._from_kernels: Any = _decorated(function, FROM_KERNELS, PartCache, {**_OPTIONS, **options, **_AS_PART})
        self._numba_type_ = self._from_kernels._numba_type_  # what numba takes it for where a kernel names it

    @functools.cached_property
    def _from_python(self) -> Any:
        return _decorated(self.py_func, FROM_PYTHON, KernelCache, self._options)

    @property
    def title(self) -> str:
        """Name of the kernel in `kept_kernels`."""
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

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel, compiled on the first call for its argument types or loaded from the cache."""
        return self._from_python(*map(pack, arguments))


def _decorated(function: Callable[..., Any], kind: str, cache: type[KernelCache], options: dict[str, Any]) -> Any:
    """Dispatcher of numba for a function, with a cache in the directory of its kind."""
    config: Any = numba.config
    before, folder = config.CACHE_DIR, Path(function.__code__.co_filename).parent
    directory = cache_directory(folder)
    config.CACHE_DIR = f"{directory}/{kind}"  # read by numba while it decorates, and only then
    try:
        compiled: Any = numba.njit(**options)(function)
        if directory is not None and "<" not in function.__qualname__:  # <locals>, <lambda>
            compiled._cache = cache(function)
            compiled._cache.sources = sources_of(folder)
    finally:
        config.CACHE_DIR = before
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


def keeps_kernels() -> bool:
    """Return whether compiled kernels are cached for other processes."""
    return cache_directory(MECHANICS) is not None


def title_of(function: Callable[..., Any]) -> str:
    """Name of a kernel's function among the files of the cache."""
    return f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"


def kept_kernels(since: float) -> set[tuple[str, str]]:
    """Kind and title of all kernels of the mechanics cached since a time (s, of the clock).

    Kinds are `FROM_PYTHON` and `FROM_KERNELS`. A kernel is there before for other types, of a plane or of one rope.
    """
    directory = cache_directory(MECHANICS)
    if directory is None:
        return set()
    return {
        (kind, file.name.rpartition("-")[0])
        for kind in (FROM_PYTHON, FROM_KERNELS)
        for file in (directory / kind).glob("**/*.nbi")
        if file.stat().st_mtime >= since
    }
