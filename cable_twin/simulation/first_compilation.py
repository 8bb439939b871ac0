"""The first start on a machine: compile the integrator in a second process while this one compiles the static start.

numba compiles one kernel at a time in a process. What both processes need is compiled twice, yet a start that took
both cores' time one after the other takes the longer of the two.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

from cable_twin.mechanics.drives.haul_rope import condense_sheave
from cable_twin.mechanics.drives.motion import find_saturated
from cable_twin.mechanics.drives.moving_rope import attach_carriers, move_rope
from cable_twin.mechanics.drives.reference import advance_reference
from cable_twin.mechanics.language.compilation import is_compiled, keeps_kernels
from cable_twin.mechanics.on_rope.chain import condense_chain
from cable_twin.mechanics.on_rope.counterweight import add_counterweights
from cable_twin.mechanics.on_rope.sliding_joint import add_joint, driven_force
from cable_twin.mechanics.on_rope.tower import add_supports, settle_supports
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.equations_of_motion import hold_supports, solve
from cable_twin.mechanics.solution.increments import largest_increment
from cable_twin.mechanics.solution.integrators import integrator_named
from cable_twin.mechanics.state import State, Workspace, allocate_state, allocate_workspace
from cable_twin.scenario import build_system, load_scenario

PR_SET_PDEATHSIG = 1  # of linux/prctl.h


@contextlib.contextmanager
def compiling_ahead(integrator: str) -> Iterator[None]:
    """Have `integrator` compiled elsewhere meanwhile, where it is not yet and there is a second core for it.

    On leaving, it is in the cache; if the other process failed, it will be compiled on its first call as ever.
    """
    if not keeps_kernels() or is_compiled(integrator_named(integrator)) or len(os.sched_getaffinity(0)) < 2:
        yield
        return
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    with subprocess.Popen(
        [sys.executable, "-m", "cable_twin.simulation.first_compilation", integrator],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ):
        yield


def begin_with(system: System, state: State, work: Workspace) -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Kernels, with arguments of the types they get, to compile while the static start is at those of the cable.

    Each process finds what the other one has compiled by then, so less is compiled twice.
    """
    cable, carriages = system.cable, system.carriages
    return {
        hold_supports: (cable, work),
        add_counterweights: (system.counterweights, cable, state, 1.0, 1.0, 1.0, work),
        add_supports: (cable, system.supports, state, 1.0, 1.0, work),
        condense_sheave: (system, state, 0, 1.0, 1.0, work),
        solve: (system, state, work),
        settle_supports: (cable, system.supports, state),
        find_saturated: (system, state, state, work),
        attach_carriers: (system, state),
        move_rope: (system, state, 1.0),
        condense_chain: (carriages, cable.gravity, state, 0, (0.0, 0.0, 0.0), 1.0, 1.0, 1.0, work),
        add_joint: (system, state, 0, 1.0, 1.0, work),
        largest_increment: (system, work),
        driven_force: (system, state, 0),
        advance_reference: (carriages, cable, state, 0, 1.0),
    }


def _end_with_parent() -> None:
    """Be gone with the start that wanted this: one that a signal ends leaves no compiler behind."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def main() -> None:
    """Compile one integrator, for a system of any size."""
    _end_with_parent()
    integrator = sys.argv[1]
    system = build_system(load_scenario("seed_example", {"solver.integrator": integrator}))
    state, work = allocate_state(system), allocate_workspace(system)
    for function, arguments in begin_with(system, state, work).items():
        numba.typeof(function).dispatcher.compile(tuple(map(numba.typeof, arguments)))  # as other kernels call it
    integrator_named(integrator)(system, state, state, state, work, 0)


if __name__ == "__main__":
    main()
