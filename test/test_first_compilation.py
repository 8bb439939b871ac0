"""First start: kernels compiled ahead by the second process are those needed, and progress is right."""

import inspect
import itertools
import os
import signal
import subprocess
import sys
from io import StringIO
from pathlib import Path

import numba
import pytest
from rich.console import Console
from twin_process import run_python, wait_until

import cable_twin
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.kernel_cache import FROM_KERNELS, FROM_PYTHON, kept_kernels
from cable_twin.scenario import load_scenario, scenario_names
from cable_twin.simulation import Simulation, first_compilation
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.first_compilation import (
    Moment,
    called_at_start,
    kernels_below,
    watching_compilation,
    work_ahead,
)
from cable_twin.terminal import bars
from cable_twin.terminal.bars import BEGIN, compilation_shown

needs_kernels = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
ROOT = Path(cable_twin.__file__).resolve().parents[1]
# callers are typed anew, as one from the cache would ask for nothing; in a process where no other test has been
CODE = """
import sys
import numba
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.typed_passes import NopythonTypeInference
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.specialization import PutKnown
from cable_twin.simulation.first_compilation import parts_of
from cable_twin.mechanics.solution.bundle.bullwheels import move_bullwheels
from cable_twin.mechanics.solution.generalized_alpha import begin_rope, step
from cable_twin.mechanics.solution.equations_of_motion import assemble_unheld
from cable_twin.mechanics.solution.prediction import Coefficients, predict_rope
from cable_twin.scenario import load_scenario, scenario_names
from cable_twin.simulation.engine import Engine

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
        passes.add_pass(PutKnown, "known")
        passes.add_pass(NopythonTypeInference, "types")
        passes.add_pass(Stop, "stop")
        passes.finalize()
        return [passes]

def types(arguments):
    return tuple(map(numba.typeof, arguments))

engine = Engine(load_scenario(sys.argv[1]))
chosen = {kernel: kinds for kernel, (kinds, _) in parts_of(engine).items()}
callers = {engine.integrator: types(map(pack, engine.arguments(0)))}
known = engine.typical()
callers |= {assemble_unheld: types(known[name] for name in ("system", "state", *3 * ("h",), "work"))}
factors = Coefficients(0.1, 0.4, 0.3, 0.6)
callers |= {predict_rope: types((factors, *(known[name] for name in ("h", "system", "state", "work"))))}
rope = [known[name] for name in ("system", "state", "work")]
bundle, moving, scratch = (known[name] for name in ("bundle", "moving", "scratch"))
callers |= {step: types((bundle, moving, moving, scratch, *rope, 0, 1.0))}
callers |= {begin_rope: types((factors, 1.0, *rope))}
if bundle.coupled is True:
    callers |= {move_bullwheels: types((known["sheaves"], known["motion"], factors, 1.0))}
for caller, kinds in (callers | chosen).items():
    try:
        numba.njit(caller.py_func, error_model="numpy", _nrt=False, pipeline_class=TypesAlone).compile(kinds)
    except Typed:
        pass
for kernel, kinds in chosen.items():
    asked = numba.typeof(kernel).dispatcher.signatures
    print(kernel.__name__, len(asked), kinds in asked)
"""


KINDS = "aerial_tramway", "windy_tramway", "chairlift", "jig_back"  # one rope and several, in a plane and in space
ONE, SEVERAL = "solve_block_tridiagonal", "solve_bundle"  # one rope, several


@needs_kernels
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(path.stem, marks=[pytest.mark.long] * (path.stem not in KINDS))
        for path in sorted((ROOT / "config").glob("*.yaml"))
    ],
)
def test_kernels_with_a_workspace_are_compiled_ahead(name):
    """Arguments by name; an unknown one of `typical` would be compiled late, in one process alone."""
    engine = Engine(load_scenario(name))
    known = engine.typical().keys()
    missing = [
        f"{kernel.title}: {argument}"
        for kernel in kernels_below(engine, *called_at_start(engine))
        if not numba.typeof(kernel).dispatcher.targetoptions.get("forceinline")
        for argument in inspect.signature(kernel.py_func).parameters
        if argument not in known and "work" in inspect.signature(kernel.py_func).parameters
    ]
    assert not missing, f"Ropeway.typical, or Engine.typical, has no value for {', '.join(missing)}"


@needs_kernels
def test_scenarios_of_a_kind_have_the_same_kernels():
    """One rope or several, plane or space: few kinds, so that few are compiled."""
    kinds = {}
    for name, changes in itertools.product(scenario_names(), ({}, {"space": 3})):
        engine = Engine(load_scenario(name, changes))
        dim = len(engine.parts[0].system.cable.gravity)
        types = tuple(numba.typeof(pack(argument)) for argument in engine.arguments(0))
        kinds.setdefault((len(engine.parts) > 1, dim), set()).add(types)
    assert len(kinds) == 4
    assert {kind: len(found) for kind, found in kinds.items()} == dict.fromkeys(kinds, 1)


@pytest.mark.long
@pytest.mark.parametrize(("name", "last_of_rest"), [("seed_example", ONE), ("jig_back", SEVERAL)])
def test_kernels_compiled_ahead_are_those_that_are_called(name, last_of_rest):
    """Argument types of kernels compiled ahead equal those of the calls, but for a few."""
    result = run_python("-c", CODE, name)
    assert result.returncode == 0, result.stderr
    lines = [line.split() for line in result.stdout.splitlines()]
    names = [name for name, _, _ in lines]
    assert {last_of_rest, "find_saturated", "move_drives", "add_cable", "element_at"} < set(names)
    assert ("predict_contacts" in names) == (name == "jig_back")  # vehicles that can meet are in that alone
    asked = [line for line in lines if line[1] != "0"]
    assert len(asked) > 0.8 * len(lines)
    assert len([name for name, _, as_guessed in asked if as_guessed != "True"]) <= 1  # an arc length that is whole


@pytest.mark.parametrize("name", ["seed_example", pytest.param("jig_back", marks=pytest.mark.long)])
def test_the_second_process_ends_well(name, tmp_path):
    """Clean exit code, and kernels begun by the other process left to that."""
    given, board = tmp_path / "scenario.yaml", tmp_path / "board"
    given.write_text(load_scenario(name).to_yaml())
    board.mkdir()
    (board / "0").touch()
    result = run_python("-m", "cable_twin.simulation.first_compilation", str(os.getpid()), given, board)
    assert result.returncode == 0, result.stderr
    said = {path.name for path in board.iterdir()}
    begun = {number for number in said if number.isdigit()}
    assert begun == {str(number) for number in range(len(begun))}
    assert len(begun) > 60
    assert {number for number in begun if f"{number} done" in said} == begun - {"0"}


def test_kernels_that_cannot_be_kept_are_told_and_taken_from_nowhere_else():
    code = "from cable_twin.mechanics.language.kernel_cache import keeps_kernels; print(keeps_kernels())"
    result = run_python("-c", code, variables={"NUMBA_CACHE_DIR": os.devnull})
    assert result.stdout == "False\n"
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{os.devnull}/cable_twin/kernels-")
    assert ": Not a directory: compiled kernels cannot be kept, every start compiles them" in line


@pytest.mark.parametrize("how", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL])
def test_a_start_that_is_ended_leaves_nothing_behind(how, tmp_path):
    """Neither the second process nor the shared files remain."""
    code = (
        "import sys; from cable_twin.offline.entry_points import simulate; sys.argv[1:] = ['single_span']; simulate()"
    )
    places = {"TMPDIR": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": str(ROOT)}
    variables = {**os.environ, **places, "NUMBA_DISABLE_JIT": "0"}
    (tmp_path / "kernels").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", code], env=variables, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    wait_until(lambda: list(tmp_path.glob("*/board/* done")), 120.0)
    process.send_signal(how)
    process.wait(60.0)
    wait_until(lambda: [path.name for path in tmp_path.iterdir()] == ["kernels"], 60.0)


def test_a_rope_without_rest_is_told_before_its_kernels_are_compiled(tmp_path):
    result = run_python(
        "-m",
        "cable_twin.offline.simulate",
        "aerial_tramway",
        "--set",
        "towers.tower.position=[545,3]",
        variables={"NUMBA_CACHE_DIR": str(tmp_path / "kernels")},
    )
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1].startswith("simulate: towers.tower.position: the bare cable at rest passes ")
    assert not [*tmp_path.rglob("*.nbc")]


def new_kernels():
    """Kernel outside every cache, with a new type at each call and a callee."""

    @kernel
    def doubled(x):
        return x + x

    @kernel
    def quadrupled(x):
        return doubled(doubled(x))

    return quadrupled


@needs_kernels
@pytest.mark.parametrize(("name", "kernels"), [("aerial_tramway", 150), ("chairlift", 240)])
def test_all_that_a_first_start_compiles_is_counted(name, kernels):
    """Progress complete at the start of the scenario, as announced before."""
    scenario = load_scenario(name)
    Simulation(scenario).advance_to(0.02)
    ahead, kept = work_ahead(Engine(scenario)), kept_kernels(0.0)
    assert len(ahead) > kernels
    assert sum(size for name, size in ahead.items() if name in kept) > 0.97 * sum(ahead.values())
    assert {(FROM_PYTHON, "generalized_alpha.advance"), (FROM_KERNELS, "element.add_cable")} <= set(ahead)


@needs_kernels
def test_what_is_compiled_is_told_with_its_name_and_nothing_where_nothing_is(monkeypatch):
    monkeypatch.setattr(first_compilation, "PERIOD", 0.001)
    moments: list[Moment] = []
    with watching_compilation(moments.append):
        pass
    assert moments == []
    with watching_compilation(moments.append):
        assert new_kernels()(3.0) == 12.0
    names = {moment.kernel for moment in moments}
    assert "quadrupled" in names
    assert names <= {"quadrupled", "doubled", ""}
    assert all(0.0 <= moment.share <= 1.0 and moment.elapsed >= 0.0 for moment in moments)


@needs_kernels
def test_the_begin_is_reported_before_the_first_share_which_takes_long(monkeypatch):
    """On a busy machine as long as 15 s, for which a log said nothing."""
    moments, at_first_share = [], []

    def share(watch, since):
        at_first_share.append(len(moments))
        return 0.5

    monkeypatch.setattr(first_compilation._Watch, "share", share)
    with watching_compilation(moments.append):
        new_kernels()(3.0)
        wait_until(lambda: at_first_share, what="first share")
    assert moments[0].share == 0.0
    assert at_first_share[0] == 1


def test_what_is_left_follows_from_the_speed_so_far():
    assert Moment(0.25, "chain", 10.0).remaining == pytest.approx(30.0)
    assert Moment(0.01, "chain", 10.0).remaining is None  # a guess
    assert Moment(0.99, "integrate", 60.0).remaining is None  # not 1 s or 0 s: what links them takes some seconds
    assert Moment(1.0, "integrate", 10.0).remaining is None  # what else there is was not known


@pytest.mark.parametrize("terminal", [False, True])
def test_a_bar_is_for_terminals_and_lines_for_the_rest(monkeypatch, terminal):
    def watching(shown):
        for share in (0.0, 0.05, 0.5, 0.6, 0.75):
            shown(Moment(share, "condense_chain", 20.0 * share))
        yield

    monkeypatch.setattr(bars, "watching_compilation", bars.contextmanager(watching))
    output, lines = StringIO(), []
    with compilation_shown(Console(file=output, force_terminal=terminal, width=100), lines.append):
        pass
    assert lines[-1].startswith("kernels compiled in ")
    if terminal:
        assert len(lines) == 1
        assert "condense_chain" in output.getvalue()
        assert "about 5 s left" in output.getvalue()
    else:
        assert lines[:-1] == [BEGIN, "compiling: 50 %, about 10 s left", "compiling: 75 %, about 5 s left"]
        assert output.getvalue() == ""
