"""Kernels that several processes of a test run need at the same time, compiled by one of them.

Without that the processes of `-n`, which begin with an empty cache, compile the same ones side by side, and what two of
them write to one file of the cache at once is lost.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from cable_twin.mechanics.language.kernel_cache import KernelCache
from cable_twin.simulation import first_compilation

PLACE = Path(tempfile.gettempdir()) / f"cable_twin_test_kernels_{os.getuid()}.lock"
WRITING = 0  # place in that file for all that is written; each kernel has another one
_compile, _load, _save = Dispatcher.compile, KernelCache.load_overload, KernelCache.save_overload
_held = threading.local()


@cache
def _file(process: int) -> int:
    """Descriptor of the locks, one in each process: a lock is given up where any other is closed."""
    return os.open(PLACE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)


def _lock(place: int) -> None:
    fcntl.lockf(_file(os.getpid()), fcntl.LOCK_EX, 1, place)


def _release(place: int) -> None:
    fcntl.lockf(_file(os.getpid()), fcntl.LOCK_UN, 1, place)


@contextmanager
def _kernels_of_this_call() -> Iterator[None]:
    """Release what is locked meanwhile; nested as kernels call one another, so that no two processes wait in a ring."""
    held: list[int] = _held.__dict__.setdefault("places", [])
    before = len(held)
    try:
        yield
    finally:
        while len(held) > before:
            _release(held.pop())


def _compile_in_turn(self: Any, sig: Any) -> Any:
    with _kernels_of_this_call():
        return _compile(self, sig)


def _load_in_turn(self: KernelCache, sig: Any, context: Any) -> Any:
    found = _load(self, sig, context)
    if found is None and self._own is not None and hasattr(_held, "places"):
        digest = hashlib.sha256(f"{self._own._index_path} {sig}".encode()).digest()
        place = 1 + int.from_bytes(digest[:6], "little")
        _lock(place)
        _held.places.append(place)
        found = _load(self, sig, context)  # that of a process that was faster
    return found


def _save_in_turn(self: KernelCache, sig: Any, data: Any) -> None:
    _lock(WRITING)
    try:
        _save(self, sig, data)
    finally:
        _release(WRITING)


def take_turns() -> None:
    """Compile in this process alone, and only what no other process of the tests compiles at the moment."""
    first_compilation.keeps_kernels = lambda: False  # no second process for it: all cores have work
    Dispatcher.compile = _compile_in_turn
    KernelCache.load_overload = _load_in_turn
    KernelCache.save_overload = _save_in_turn
