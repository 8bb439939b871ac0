"""First compilation of kernels on a machine, by two processes, as numba compiles one kernel at a time in each.

Both compile kernels, beginning with those that call no others, and find the other process's kernels in the cache. Then
one links the integrator, and the other one the kernels that find the equilibrium and that read the state.

The progress is the share compiled by both processes, weighted by the size of the kernels.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import inspect
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple, cast

import numba
from numba.core import event
from numba.core.errors import NumbaError

from cable_twin.mechanics.language.compilation import Kernel
from cable_twin.mechanics.language.kernel_cache import FROM_KERNELS, FROM_PYTHON, keeps_kernels, kept_kernels, title_of
from cable_twin.mechanics.language.specialization import known_fields, names_left
from cable_twin.mechanics.readout.columns import observe
from cable_twin.scenario import Scenario, parse_scenario
from cable_twin.simulation.engine import Engine

PR_SET_PDEATHSIG = 1  # of linux/prctl.h


@contextlib.contextmanager
def compiling_ahead(scenario: Scenario, engine: Engine) -> Iterator[None]:
    """Compile the kernels of a scenario, its integrator in a second process where a second core is free.

    On leaving, the integrator is in the cache; if the other process failed, it is compiled on its first call as usual.

    Raises:
        EquilibriumError: a bare rope of the scenario has no equilibrium.
    """
    integrator = engine.integrator
    if not isinstance(integrator, Kernel) or integrator.is_kept(engine.arguments(0)):
        yield
        return
    if len(os.sched_getaffinity(0)) < 2 or not keeps_kernels():
        engine.check_bare()
        yield
        return
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    with contextlib.ExitStack() as stack:
        stack.enter_context(_without_collector())
        with contextlib.suppress(OSError):  # no room for files: this process compiles all, as it needs it
            directory = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
            board, given = directory / "board", directory / "scenario.yaml"
            board.mkdir()
            given.write_text(scenario.to_yaml(), encoding="utf-8")
            other = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "cable_twin.simulation.first_compilation", str(os.getpid()), given, board],
                    env={**os.environ, "PYTHONPATH": path},
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
            )
            stack.push(lambda kind, error, trace: other.terminate() if kind else None)  # nobody is to wait for it then
            engine.check_bare()  # who has to change the scenario is not to wait for its kernels
            compile_parts(engine, board)
        yield


@contextlib.contextmanager
def _without_collector() -> Iterator[None]:
    """Pause garbage collection, a fifteenth of compilation time: compilers make many objects and drop few."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def called_at_start(engine: Engine) -> tuple[Kernel, ...]:
    """Kernels called from Python at a start, the integrator first, as its compilation takes longest."""
    return engine.integrator, *engine.at_rest, cast(Kernel, observe)


def kernels_below(engine: Engine, *callers: Kernel) -> dict[Kernel, tuple[Kernel, ...]]:
    """Direct and indirect callees of kernels of an engine, each with its own callees: callers before callees.

    Kernels for features that the scenario does not have are left out.
    """
    known = {name: numba.typeof(value) for name, value in engine.typical().items()}
    found: dict[Kernel, tuple[Kernel, ...]] = {}

    def callees(caller: Kernel) -> tuple[Kernel, ...]:
        names = set(caller.py_func.__code__.co_names)
        kinds = tuple(known.get(name, numba.types.unknown) for name in inspect.signature(caller.py_func).parameters)
        if not names.isdisjoint({"len", *known_fields(kinds)}):
            names = names_left(caller.py_func, kinds)
        named = (caller.py_func.__globals__.get(name) for name in caller.py_func.__code__.co_names if name in names)
        return tuple(callee for callee in named if isinstance(callee, Kernel))

    def visit(caller: Kernel) -> None:
        found[caller] = callees(caller)
        for callee in found[caller]:
            if callee not in found:
                visit(callee)

    for caller in callers:
        visit(caller)
    return {kernel: below for kernel, below in found.items() if kernel not in callers}


def parts_of(engine: Engine) -> dict[Kernel, tuple[tuple[Any, ...], tuple[Kernel, ...]]]:
    """Kernels called by other kernels at a start, each with its argument types and its callees among these kernels.

    Kernels of the integrator come first, and callees before callers. Argument types are known by parameter name; a
    kernel with other parameters is compiled with its caller.
    """
    known = engine.typical()
    order: dict[Kernel, tuple[Kernel, ...]] = {}
    for caller in called_at_start(engine):
        below = kernels_below(engine, caller)
        order |= {kernel: below[kernel] for kernel in reversed(below) if kernel not in order}
    parts = {}
    for kernel in order:
        names = list(inspect.signature(kernel.py_func).parameters)
        if known.keys() >= set(names):
            parts[kernel] = tuple(numba.typeof(known[name]) for name in names)
    return {kernel: (types, tuple(one for one in order[kernel] if one in parts)) for kernel, types in parts.items()}


def compile_parts(engine: Engine, board: Path) -> None:
    """Compile kernels that no other process of this start has begun, callees first where possible.

    Args:
        engine: of the scenario that starts.
        board: directory in which each process marks the kernels that it begins and has compiled.
    """
    parts = parts_of(engine)
    numbers = {kernel: str(number) for number, kernel in enumerate(parts)}
    while True:
        said = set(os.listdir(board))
        left = [kernel for kernel in parts if numbers[kernel] not in said]
        if not left:
            return
        ready = (kernel for kernel in left if all(f"{numbers[one]} done" in said for one in parts[kernel][1]))
        kernel = next(ready, left[0])
        try:
            (board / numbers[kernel]).touch(exist_ok=False)
        except FileExistsError:  # the other one was faster
            continue
        with contextlib.suppress(NumbaError):  # of types that are none of its; it comes with its caller then
            numba.typeof(kernel).dispatcher.compile(parts[kernel][0])  # as other kernels call it
            (board / f"{numbers[kernel]} done").touch()


def _end_with_parent(parent: int, directory: Path) -> None:
    """End together with the parent process and remove its files, also where a signal ended the parent."""

    def leave(number: int, frame: Any) -> None:
        shutil.rmtree(directory, ignore_errors=True)
        os._exit(0)

    signal.signal(signal.SIGTERM, leave)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the parent gets it as well, and decides
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it ended while this one was starting
        leave(signal.SIGTERM, None)


def main() -> None:
    """Compile the integrator of a scenario for a starting process, then the remaining kernels."""
    parent, scenario, board = sys.argv[1:]
    _end_with_parent(int(parent), Path(board).parent)
    gc.disable()
    engine = Engine(parse_scenario(Path(scenario).read_text(encoding="utf-8")))
    compile_parts(engine, Path(board))
    engine.integrator(*engine.arguments(0))


if __name__ == "__main__":
    main()


NAMELESS = "impl"
PERIOD = 0.25  # s between two looks
OVERHEAD = 300  # bytes of Python's code that take as long to compile as the least kernel does
KNOWN = 0.08, 0.95  # shares between which the time that is left is: what links in the end takes some seconds more
LAST = 0.2  # of the time for all kernels below: what optimising them together takes


class Moment(NamedTuple):
    """Progress of a first compilation of kernels at one moment."""

    share: float  # of the work that is done, 0 to 1
    kernel: str  # kernel under compilation in this process
    elapsed: float  # s since the start

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

    At first a share of 0 is reported, as the first share takes seconds beside a compiler: its kernels are to be found.
    Where all kernels are compiled already, nothing is reported.
    """
    if not isinstance(observe, Kernel):  # the JIT is off
        yield
        return
    watch, since = _Watch(), time.time()
    ended = threading.Event()
    _expected.clear()

    def look() -> None:
        told = False
        while not ended.wait(PERIOD):
            if watch.begun is not None:
                share = watch.share(since) if told else 0.0
                shown(Moment(share, watch.kernel, monotonic() - watch.begun))
                told = True

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
        """Share (0 to 1) of the compilation that is complete, by this process, a second one or earlier ones."""
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
        """Record the start of compiling a kernel."""
        self.begun = self.begun or monotonic()
        self._under_way = [*self._under_way, event.data["dispatcher"].py_func.__name__]

    def on_end(self, event: Any) -> None:
        """Record the end of compiling a kernel."""
        dispatcher = event.data["dispatcher"]
        kind = FROM_KERNELS if "no_cpython_wrapper" in dispatcher.targetoptions else FROM_PYTHON
        self.done.add((kind, title_of(dispatcher.py_func)))
        self._under_way = self._under_way[:-1]
