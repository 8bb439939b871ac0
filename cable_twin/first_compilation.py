"""The first start on a machine: compile the integrator in a second process while this one compiles the static start.

numba compiles one kernel at a time in a process. What both processes need is compiled twice, yet a start that took
both cores' time one after the other takes the longer of the two.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from cable_twin.mechanics.compilation import is_compiled
from cable_twin.mechanics.generalized_alpha import advance
from cable_twin.mechanics.runge_kutta import advance_explicitly
from cable_twin.mechanics.state import allocate_state, allocate_workspace
from cable_twin.scenario import build_system, load_scenario

INTEGRATORS = {"generalized_alpha": advance, "runge_kutta": advance_explicitly}


@contextlib.contextmanager
def compiling_ahead(integrator: str) -> Iterator[None]:
    """Have `integrator` compiled elsewhere meanwhile, where it is not yet and there is a second core for it.

    On leaving, it is in the cache; if the other process failed, it will be compiled on its first call as ever.
    """
    if is_compiled(INTEGRATORS[integrator]) or len(os.sched_getaffinity(0)) < 2:
        yield
        return
    root = str(Path(__file__).resolve().parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    with subprocess.Popen(
        [sys.executable, "-m", "cable_twin.first_compilation", integrator],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ):
        yield


def main() -> None:
    """Compile one integrator, for a system of any size."""
    integrator = sys.argv[1]
    system = build_system(load_scenario("seed_example", {"solver.integrator": integrator}))
    state, work = allocate_state(system), allocate_workspace(system)
    INTEGRATORS[integrator](system, state, state, state, work, 0)


if __name__ == "__main__":
    main()
