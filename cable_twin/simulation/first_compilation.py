"""The first start on a machine: compile the integrator in a second process while this one compiles the static start.

numba compiles one kernel at a time in a process. What both processes need is compiled twice, yet a start that took
both cores' time one after the other takes the longer of the two.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import inspect
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba

from cable_twin.mechanics.language.compilation import Kernel, keeps_kernels
from cable_twin.scenario import Scenario, parse_scenario
from cable_twin.simulation.engines import Engine, engine_of

PR_SET_PDEATHSIG = 1  # of linux/prctl.h


@contextlib.contextmanager
def compiling_ahead(scenario: Scenario, engine: Engine) -> Iterator[None]:
    """Have the integrator of a scenario compiled elsewhere meanwhile, where it is not yet and there is a second core.

    On leaving, it is in the cache; if the other process failed, it will be compiled on its first call as ever.
    """
    integrator = engine.integrator
    cores = len(os.sched_getaffinity(0))
    if (
        cores < 2
        or not isinstance(integrator, Kernel)
        or not keeps_kernels()
        or integrator.is_kept(engine.arguments(0))
    ):
        yield
        return
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    with tempfile.TemporaryFile("w+", encoding="utf-8") as given:  # a pipe would fill up before the other one reads
        given.write(scenario.to_yaml())
        given.seek(0)
        with (
            _without_collector(),
            subprocess.Popen(
                [sys.executable, "-m", "cable_twin.simulation.first_compilation", str(os.getpid())],
                env={**os.environ, "PYTHONPATH": path},
                stdin=given,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            ),
        ):
            yield


@contextlib.contextmanager
def _without_collector() -> Iterator[None]:
    """A compiler makes objects by the million and drops few: looking for those takes a fifteenth of its time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@functools.cache
def kernels_below(*callers: Kernel) -> tuple[Kernel, ...]:
    """All that kernels call, and what those call, each once: in the order of the code, callers before callees."""
    found: dict[Kernel, None] = {}

    def visit(caller: Kernel) -> None:
        for name in caller.py_func.__code__.co_names:
            callee = caller.py_func.__globals__.get(name)
            if isinstance(callee, Kernel) and callee not in found:
                found[callee] = None
                visit(callee)

    for caller in callers:
        visit(caller)
    return tuple(found)


def begin_with(engine: Engine) -> dict[Kernel, tuple[Any, ...]]:
    """Kernels below an integrator, with arguments of the types they get, to compile while the other process starts.

    That needs much of the same, and goes from its begin on: so here the second half of that comes first, from its end
    on, then what a step alone has. The first half is there by then, and is not compiled twice. Arguments go by their
    names; a kernel that has others comes with its caller.
    """
    known = engine.typical()
    chosen = {}
    in_step = kernels_below(engine.integrator)
    shared = [kernel for kernel in kernels_below(*engine.at_rest) if kernel in in_step]
    own = [kernel for kernel in in_step if kernel not in shared]
    for kernel in (*reversed(shared[len(shared) // 2 :]), *reversed(own)):
        names = list(inspect.signature(kernel.py_func).parameters)
        if not kernel.is_inlined and known.keys() >= set(names):
            chosen[kernel] = tuple(known[name] for name in names)
    return chosen


def _end_with_parent(parent: int) -> None:
    """Be gone with the start that wanted this: one that a signal ends leaves no compiler behind."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it ended while this one was starting
        sys.exit()


def main() -> None:
    """Compile the integrator of the scenario that comes in."""
    (parent,) = sys.argv[1:]
    _end_with_parent(int(parent))
    gc.disable()
    engine = engine_of(parse_scenario(sys.stdin.read()))
    for kernel, arguments in begin_with(engine).items():
        numba.typeof(kernel).dispatcher.compile(tuple(map(numba.typeof, arguments)))  # as other kernels call it
    engine.integrator(*engine.arguments(0))


if __name__ == "__main__":
    main()
