"""Disk cache of compiled kernels: those shipped with the package, and those that this user has compiled.

Cached code is keyed by the text of the sources, the target, and the versions of Python, numba and llvmlite; neither by
times nor by paths of files, so that kernels compiled on one machine serve on another one. numba's own cache checks only
whether the file of a kernel has changed, not those of the kernels that it calls.
"""

from __future__ import annotations

import errno
import functools
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.compiler import compile_result
from numba.core.sigutils import normalize_signature

from cable_twin.mechanics.language.fingerprint import Sources, sources
from cable_twin.mechanics.language.linking import PartLibrary
from cable_twin.mechanics.language.target import target_context

FROM_PYTHON, FROM_KERNELS = "from_python", "from_kernels"  # directories for what is called from there
MECHANICS = Path(__file__).parents[1]
SHIPPED = MECHANICS.parent / "compiled"  # filled by `python -m cable_twin.kernels build`
ROOM = 50 * 2**20  # bytes that a first compilation is sure to find enough


def sources_of(folder: Path) -> Sources:
    """Sources that the kernels of a folder depend on: those of the mechanics, and of the folder itself."""
    return sources(MECHANICS) if folder.is_relative_to(MECHANICS) else sources(MECHANICS, folder)


def version_directory(folder: Path) -> str:
    """Name of the cache directory for the kernels of a folder, one for each version of their sources.

    Their sources are the mechanics and their own folder, as `test_architecture` ensures.
    """
    return f"kernels-{sources_of(folder).fingerprint}"


@functools.cache
def cache_directory(folder: Path) -> Path | None:
    """Directory where a folder's compiled kernels are cached, in the user's home or under NUMBA_CACHE_DIR.

    None, with a warning in the log, where kernels cannot be kept.
    """
    name = version_directory(folder)
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
            raise OSError(
                errno.ENOSPC, f"disk: given {room / 2**20:.0f} MB free; allowed: {ROOM / 2**20:.0f} MB or more"
            )
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
    """Refuse a cache directory writable by others, who could place code in it for this process to run.

    Write access of the user's own group is removed: some systems create all directories with it.

    Raises:
        PermissionError: other users own the directory or may write there.
    """
    found = directory.stat()
    if found.st_uid not in (0, os.geteuid()):
        raise PermissionError(
            errno.EPERM, f"given owner {found.st_uid} (user ID); allowed: this user or root", str(directory)
        )
    if found.st_mode & 0o002 or (found.st_mode & 0o020 and found.st_gid != os.getegid()):
        raise PermissionError(
            errno.EPERM,
            f"given mode {found.st_mode & 0o777:o}, with which others may write; allowed: writing by its owner alone",
            str(directory),
        )
    if found.st_mode & 0o020:
        directory.chmod(found.st_mode & 0o755)


@functools.cache
def shipped_directory(folder: Path) -> Path | None:
    """Directory of a folder's compiled kernels shipped with the package; None if built from other sources."""
    directory = SHIPPED / version_directory(folder)
    return directory if directory.is_dir() else None


def title_of(function: Callable[..., Any]) -> str:
    """Name of a kernel's function in the file names of the cache: module and qualified name."""
    return f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}"


class _CacheEntry(CompileResultCacheImpl):
    """Numba's conversion of one compiled kernel to and from its cache file, with support for bitcode parts."""

    def __init__(self, function: Any) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = SimpleNamespace(_py_file=function.__code__.co_filename)  # for what numba says of a failure

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Rebuild numba's compilation result of a kernel, or of a bitcode part, from its cache entry."""
        (name, kind, parts), function, env, signature, *_ = payload
        if kind != PartLibrary.KIND:
            return super().rebuild(target_context, payload)
        library = PartLibrary.of(target_context.codegen(), name, parts)
        return compile_result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            library=library,
            environment=env,
            entry_point=target_context.get_executable(library, function, env),
            fndesc=function,
            signature=signature,
            objectmode=False,
            reload_init=[],
        )


class KernelCache(FunctionCache):
    """Disk cache of one kernel, for calls either from Python or from other kernels.

    Args:
        function: Python function of the kernel.
        kind: `FROM_PYTHON` or `FROM_KERNELS`.
    """

    def __init__(self, function: Callable[..., Any], kind: str) -> None:
        self._py_func = function
        self._impl = _CacheEntry(function)
        self._folder = Path(function.__code__.co_filename).parent
        self._sources = sources_of(self._folder)
        within = MECHANICS if self._folder.is_relative_to(MECHANICS) else self._folder
        self._place = Path(kind) / self._folder.relative_to(within)
        python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
        self._file_name = f"{title_of(function)}-{function.__code__.co_firstlineno}.{python}"
        self.enable()

    @property
    def cache_path(self) -> str:
        """Subdirectory of the kernel's files within a directory of cached kernels."""
        return str(self._place)

    @functools.cached_property
    def _shipped(self) -> IndexDataCacheFile | None:
        return self._file(shipped_directory(self._folder))

    @functools.cached_property
    def _own(self) -> IndexDataCacheFile | None:
        return self._file(cache_directory(self._folder))

    def _file(self, directory: Path | None) -> IndexDataCacheFile | None:
        if directory is None:
            return None
        return IndexDataCacheFile(str(directory / self._place), self._file_name, self._sources.fingerprint)

    def _files(self) -> Iterator[IndexDataCacheFile]:
        """Yield the cache files that may hold the kernel: the one shipped with the package, then the user's own."""
        if self._shipped is not None:
            yield self._shipped
        if self._own is not None:
            yield self._own

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code of the kernel in the cache, unless a source file has changed since it was first read."""
        if self._own is not None and self._sources.are_unchanged() and self._impl.check_cachable(data):
            os.makedirs(self._own._cache_path, exist_ok=True)
            self._own.save(self._index_key(sig, data.codegen), self._impl.reduce(data))

    def has(self, types: tuple[Any, ...]) -> bool:
        """Return whether the cache holds the kernel's code for arguments of these types."""
        key = self._index_key(types, target_context().codegen())
        for file in self._files():
            try:
                if key in file._load_index():
                    return True
            except Exception:  # noqa: PERF203 - as in `load_overload`, which tells
                continue
        return False

    def load_overload(self, sig: Any, target_context_of_numba: Any) -> Any:
        """Load the kernel's cached code for argument types; None for a file whose code differs from its index.

        numba writes the index first, so that two starts at once of scenarios of different types may leave such a file.
        None also once a source was edited since the start: this process may have read the new one.
        """
        context = target_context()
        context.refresh()
        key = self._index_key(sig, context.codegen())
        for file in self._files() if self._sources.are_unchanged() else ():
            try:
                data = file.load(key)
                loaded = None if data is None else self._impl.rebuild(context, data)
            except Exception as error:  # of pickle, or what garbage has made of it
                logging.getLogger("cable_twin").warning(
                    "%s: damaged (%s): its kernel is compiled anew",
                    file._index_path,
                    " ".join(str(error).split())[:200] or type(error).__name__,
                )
                if file is self._own:
                    file.flush()  # nothing is in it then
                continue
            if loaded is not None and loaded.signature.args == normalize_signature(sig)[0]:
                return loaded
        return None


def keeps_kernels() -> bool:
    """Return whether compiled kernels can be cached on disk for other processes."""
    return cache_directory(MECHANICS) is not None


def kept_kernels(since: float) -> set[tuple[str, str]]:
    """Kind of call and title of all kernels of the mechanics cached by this user since a time (s, of the clock).

    Kinds are `FROM_PYTHON` and `FROM_KERNELS`. A kernel may be cached earlier for other types, as of a plane.
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
