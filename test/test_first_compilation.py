"""What the second process of a first start compiles ahead is what the integrator then asks for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cable_twin

ROOT = Path(cable_twin.__file__).resolve().parents[1]
# callers are compiled anew, as one from the cache would ask for nothing; in a process where no other test has been
CODE = """
import numba
from cable_twin.simulation.first_compilation import begin_with
from cable_twin.mechanics.solution.equations_of_motion import assemble
from cable_twin.mechanics.drives.motion import drive_force, move_drives
from cable_twin.mechanics.solution.generalized_alpha import step
from cable_twin.mechanics.solution.stepping import settle
from cable_twin.mechanics.state import allocate_state, allocate_workspace
from cable_twin.scenario import build_system, load_scenario

def types(*arguments):
    return tuple(map(numba.typeof, arguments))

system = build_system(load_scenario("seed_example"))
state, work = allocate_state(system), allocate_workspace(system)
callers = {
    step: (system, state, state, 1.0, work),
    assemble: (system, state, 1.0, 1.0, 1.0, work),
    settle: (system, state),
    move_drives: (system, state, 1.0),
    drive_force: (system, state, 0),
}
for caller, arguments in callers.items():
    numba.njit(caller.py_func, error_model="numpy", _nrt=False).compile(types(*arguments))
for kernel, arguments in begin_with(system, state, work).items():
    asked = numba.typeof(kernel).dispatcher.signatures
    print(kernel.__name__, len(asked), types(*arguments) in asked)
"""


def test_kernels_compiled_ahead_are_those_that_are_called():
    result = subprocess.run(
        [sys.executable, "-c", CODE],
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "0"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    lines = [line.split() for line in result.stdout.splitlines()]
    assert len(lines) > 3
    assert lines == [[name, "1", "True"] for name, _, _ in lines]


def test_the_second_process_ends_well():
    """It would fail in silence, and the first start would take longer."""
    result = subprocess.run(
        [sys.executable, "-m", "cable_twin.simulation.first_compilation", "generalized_alpha", str(os.getpid())],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_kernels_that_cannot_be_kept_are_told_and_taken_from_nowhere_else():
    code = "from cable_twin.mechanics.language.compilation import keeps_kernels; print(keeps_kernels())"
    result = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": os.devnull},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.stdout == "False\n"
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{os.devnull}/cable_twin/kernels-")
    assert ": Not a directory: compiled kernels cannot be kept, every start compiles them" in line
