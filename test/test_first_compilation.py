"""What the second process of a first start compiles ahead is what the integrator then asks for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cable_twin

ROOT = Path(cable_twin.__file__).resolve().parents[1]
# callers are typed anew, as one from the cache would ask for nothing; in a process where no other test has been
CODE = """
import numba
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.typed_passes import NopythonTypeInference
from cable_twin.simulation.first_compilation import begin_with
from cable_twin.mechanics.solution.equations_of_motion import assemble_unheld
from cable_twin.mechanics.solution.generalized_alpha import Coefficients, predict_all
from cable_twin.mechanics.solution.integrators import integrator_named
from cable_twin.mechanics.state import allocate_state, allocate_workspace
from cable_twin.scenario import build_system, load_scenario

class Typed(Exception):
    pass

@register_pass(mutates_CFG=False, analysis_only=True)
class Stop(AnalysisPass):
    _name = "stop"

    def __init__(self):
        AnalysisPass.__init__(self)

    def run_pass(self, state):
        raise Typed

class TypesAlone(CompilerBase):
    def define_pipelines(self):
        passes = PassManager("types alone")
        passes.passes.extend(DefaultPassBuilder.define_untyped_pipeline(self.state).passes)
        passes.add_pass(NopythonTypeInference, "types")
        passes.add_pass(Stop, "stop")
        passes.finalize()
        return [passes]

def types(arguments):
    return tuple(map(numba.typeof, arguments))

advance = integrator_named("generalized_alpha")
system = build_system(load_scenario("seed_example"))
state, work = allocate_state(system), allocate_workspace(system)
chosen = begin_with(advance, system, state, work)
callers = {advance: (system, state, state, state, work, 0), assemble_unheld: (system, state, 1.0, 1.0, 1.0, work)}
callers |= {predict_all: (Coefficients(0.1, 0.4, 0.3, 0.6), 1.0, system, state, work), **chosen}
for caller, arguments in callers.items():
    try:
        numba.njit(caller.py_func, error_model="numpy", _nrt=False, pipeline_class=TypesAlone).compile(types(arguments))
    except Typed:
        pass
for kernel, arguments in chosen.items():
    asked = numba.typeof(kernel).dispatcher.signatures
    print(kernel.__name__, len(asked), asked == [types(arguments)])
"""


def test_kernels_compiled_ahead_are_those_that_are_called():
    """Each is asked for with the types that it is compiled for; a few are asked for by callers of other arguments."""
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
    names = [name for name, _, _ in lines]
    assert {"add_towers", "solve", "find_saturated", "move_drives"} < set(names)
    assert names.index("solve") < names.index("add_towers") < names.index("move_drives")  # a step alone has the last
    assert "add_cable" not in names  # the other process begins with it
    asked = [line for line in lines if line[1] != "0"]
    assert len(asked) > 0.8 * len(lines)
    assert asked == [[name, "1", "True"] for name, _, _ in asked]


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
