"""Progress of a first compilation: share compiled by this process and its helper, weighted by kernel size."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, NamedTuple

from numba.core import event

from cable_twin.mechanics.language.compilation import FROM_KERNELS, FROM_PYTHON, Kernel, kept_kernels, title_of
from cable_twin.mechanics.readout.columns import observe
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.first_compilation import called_at_start, kernels_below

NAMELESS = "impl"
PERIOD = 0.25  # s between two looks
OVERHEAD = 300  # bytes of Python's code that take as long to compile as the least kernel does
KNOWN = 0.08, 0.95  # shares between which the time that is left is: what links in the end takes some seconds more
LAST = 0.2  # of the time for all kernels below: what optimising them together takes


class Moment(NamedTuple):
    """Progress of a first compilation at one moment."""

    share: float  # of the work that is done, 0 to 1
    kernel: str  # what this process compiles
    elapsed: float  # s since the begin

    @property
    def remaining(self) -> float | None:
        """Remaining time (s) at the mean speed so far; None near start and end, where an estimate means nothing."""
        return self.elapsed * (1.0 - self.share) / self.share if KNOWN[0] < self.share < KNOWN[1] else None


def work_ahead(engine: Engine) -> dict[tuple[str, str], float]:
    """Kernels compiled by a first start, by kind and name, with their size in bytes of Python bytecode."""
    ahead: dict[tuple[str, str], float] = {}
    for caller in called_at_start(engine):
        kernels = kernels_below(engine, caller)
        sizes = {(FROM_KERNELS, kernel.title): OVERHEAD + len(kernel.py_func.__code__.co_code) for kernel in kernels}
        ahead |= sizes
        ahead[FROM_PYTHON, caller.title] = LAST * sum(sizes.values())
    return ahead


_expected: list[Engine] = []  # what is compiled is this process's, as numba's events are


def expect_kernels(engine: Engine) -> None:
    """Announce the engine about to start, and with it the kernels of a first start, to `watching_compilation`."""
    _expected[:] = [engine]


@contextmanager
def watching_compilation(shown: Callable[[Moment], None]) -> Iterator[None]:
    """Report compilation progress some times a second from another thread, from the first compiled kernel on.

    Where all are there already, nothing is told.
    """
    if not isinstance(observe, Kernel):  # the JIT is off
        yield
        return
    watch, since = _Watch(), time.time()
    ended = threading.Event()
    _expected.clear()

    def look() -> None:
        while not ended.wait(PERIOD):
            if watch.begun is not None:
                shown(Moment(watch.share(since), watch.kernel, monotonic() - watch.begun))

    thread = threading.Thread(target=look, name="compilation watch", daemon=True)
    with event.install_listener("numba:compile", watch):
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            _expected.clear()


class _Watch(event.Listener):
    """Listener for kernels that numba compiles in this process."""

    def __init__(self) -> None:
        self.begun: float | None = None
        self.done: set[tuple[str, str]] = set()
        self._under_way: list[str] = []  # callers before callees
        self._ahead: dict[tuple[str, str], float] = {}
        self._kernels: list[Kernel] = []

    def share(self, since: float) -> float:
        """Share (0 to 1) of the compilation done by this process, by its helper, or before."""
        if _expected and not self._ahead:  # once: asked for some times a second, for which what compiles has to wait
            (engine,) = _expected
            called = called_at_start(engine)
            self._ahead, self._kernels = work_ahead(engine), [*called, *kernels_below(engine, *called)]
        done = self.done.union(kept_kernels(since), *(kernel.kinds_loaded for kernel in self._kernels))
        whole = sum(self._ahead.values())
        return sum(size for kernel, size in self._ahead.items() if kernel in done) / (whole or 1.0)

    @property
    def kernel(self) -> str:
        """Name of the kernel under compilation, without small functions of numba itself."""
        named = (name for name in reversed(self._under_way) if name.isidentifier() and not name.startswith(NAMELESS))
        return next(named, "")

    def on_start(self, event: Any) -> None:
        """Record the start of a compilation."""
        self.begun = self.begun or monotonic()
        self._under_way = [*self._under_way, event.data["dispatcher"].py_func.__name__]

    def on_end(self, event: Any) -> None:
        """Record the end of a compilation."""
        dispatcher = event.data["dispatcher"]
        kind = FROM_KERNELS if "no_cpython_wrapper" in dispatcher.targetoptions else FROM_PYTHON
        self.done.add((kind, title_of(dispatcher.py_func)))
        self._under_way = self._under_way[:-1]


__all__ = ["Moment", "expect_kernels", "watching_compilation", "work_ahead"]
