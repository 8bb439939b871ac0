"""Kernels in the cache: with all code for calls from Python, without an entry point for other kernels."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cable_twin

ROOT = Path(cable_twin.__file__).resolve().parents[1]
CODE = """
from numba.core import event
from cable_twin.mechanics.solution.prediction import coefficients
from cable_twin.mechanics.rope.shape_functions import shape_functions
from cable_twin.mechanics.language.compilation import kernel

@kernel
def inner(x):
    return 2.0 * x

@kernel
def outer(x):
    return inner(x) + 1.0

def compiled():
    with event.install_recorder("numba:compile") as recorder:
        assert outer(3.0) == 7.0
        assert inner(3.0) == 6.0
        assert outer.py_func(3.0) == 7.0
    return len(recorder.buffer) // 2

print(compiled(), compiled(), coefficients(1.0).gamma)
"""


BRIEF = """
from cable_twin.mechanics.language.compilation import brief_kernel, kernel

@kernel
def part(x):
    return 2.0 * x

@brief_kernel
def outer(x):
    return part(x) + 1.0

assert outer(3.0) == 7.0
(compiled,) = outer._from_python.overloads.values()
engine = compiled.codegen._engine._ee
(symbol,) = (one.fndesc.mangled_name for one in part._from_kernels.overloads.values())
print(*(engine.get_function_address(name) != 0 for name in (compiled.fndesc.mangled_name, symbol)))
"""


@pytest.mark.parametrize("disabled", ["0", "1"])
def test_kernels_are_compiled_once_and_called_from_both_sides(tmp_path, disabled):
    program = tmp_path / "program.py"
    program.write_text(CODE.replace("outer.py_func", "outer") if disabled == "1" else CODE)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # whose files know the second of a source alone
    outputs = [
        subprocess.run(
            [sys.executable, str(program)],
            env={**environment, "NUMBA_DISABLE_JIT": disabled},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        for _ in range(2)
    ]
    assert [result.returncode for result in outputs] == [0, 0], outputs[0].stderr + outputs[1].stderr
    first, second = (result.stdout.split() for result in outputs)
    expected = "0" if disabled == "1" else "3"  # outer, inner for it, inner for Python
    assert first == [expected, "0", "0.5"]
    assert second == ["0", "0", "0.5"]  # all from the cache, another process


def test_kernels_of_another_folder_follow_their_sources_and_leave_those_of_the_mechanics(tmp_path):
    """Constant imported from a neighbouring file, which is part of the compiled code and unknown to numba's cache."""
    folder = tmp_path / "figures"
    folder.mkdir()
    (folder / "program.py").write_text(
        "from cable_twin.mechanics.language.compilation import kernel\n"
        "from cable_twin.mechanics.language.kernel_cache import MECHANICS, cache_directory\n"
        "from constants import FACTOR\n\n"
        "@kernel\ndef scaled(x):\n    return FACTOR * x\n\n"
        "print(scaled(2.0), cache_directory(MECHANICS))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # which would be that of a file as long, written in the same second
    outputs = []
    for factor in (3.0, 4.0):
        (folder / "constants.py").write_text(f"FACTOR = {factor}\n")
        command = [sys.executable, str(folder / "program.py")]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True)
        outputs.append(result.stdout.split())
    assert [value for value, _ in outputs] == ["6.0", "8.0"]
    assert outputs[0][1] == outputs[1][1]


PARTS = """
import sys
from cable_twin.mechanics.language.compilation import kernel

@kernel
def inner(x):
    return 2.0 * x

@kernel
def first(x):
    return inner(x) + 1.0

@kernel
def second(x):
    return inner(x) - 1.0

print({"first": first, "second": second}[sys.argv[1]](3.0))
(part,) = inner._from_kernels.overloads.values()
hits = inner._from_kernels.stats.cache_hits
print(part.library.get_pointer_to_function(part.fndesc.llvm_func_name), sum(hits.values()))
"""


def test_a_part_has_no_machine_code_and_is_taken_from_the_cache_by_another_process(tmp_path):
    """Bitcode compiled for a first caller, reused for a second one in another process."""
    program = tmp_path / "program.py"
    program.write_text(PARTS)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["NUMBA_DISABLE_JIT"] = "0"
    for caller, expected in (("first", "7.0 0 0"), ("second", "5.0 0 1")):
        command = [sys.executable, str(program), caller]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True)
        assert " ".join(result.stdout.split()) == expected


ALIKE = """
import sys
from numba.extending import overload
from cable_twin.mechanics.language.compilation import OVERLOAD, kernel

def closure(factor):
    def scaled(x):
        return factor * x
    return kernel(scaled)

def through(inner):
    def outer(x):
        return inner(x) + 0.5
    return kernel(outer)

def pair():
    return [kernel(lambda x: 2.0 * x), kernel(lambda x: 3.0 * x)]

def given(number):
    def scaled(x, factor=number):
        return factor * x
    return kernel(scaled)

def overloaded(implementation):
    def scaled(x):
        pass

    overload(scaled, jit_options=OVERLOAD)(lambda x: implementation)
    return scaled

def of_closure(number):
    return lambda x: number * x

KINDS = {
    "closure": [closure(2.0), closure(3.0)],
    "callee": [through(closure(2.0)), through(closure(3.0))],
    "lambda": pair(),
    "default": [given(2.0), given(3.0)],
    "overload": [overloaded(of_closure(2.0)), overloaded(of_closure(3.0))],
    "beyond": [through(overloaded(of_closure(2.0))), through(overloaded(of_closure(3.0)))],
    "source": [overloaded(eval(f"lambda x: {number} * x")) for number in (2.0, 3.0)],
}

def values(two, three):
    @kernel
    def first(x):
        return two(x)

    @kernel
    def second(x):
        return three(x)

    @kernel
    def both(x):
        return first(x) + 100.0 * second(x)

    return {"first": first, "second": second, "both": both}[sys.argv[1]](1.0)

for kind, (two, three) in KINDS.items():
    print(kind, values(two, three))
"""


@pytest.fixture(scope="module")
def values_of_alike(tmp_path_factory):
    """Results of three processes: two cache parts with equal running numbers of numba, the third uses both."""
    directory = tmp_path_factory.mktemp("alike")
    program = directory / "program.py"
    program.write_text(ALIKE)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(directory / "cache")}
    environment["NUMBA_DISABLE_JIT"] = "0"
    outputs = []
    for caller in ("first", "second", "both"):
        command = [sys.executable, str(program), caller]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
        assert result.returncode == 0, result.stderr
        outputs.append(dict(line.split() for line in result.stdout.splitlines()))
    return outputs


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("closure", 0.0),
        ("callee", 0.5),
        ("lambda", 0.0),
        ("default", 0.0),
        ("overload", 0.0),
        ("beyond", 0.5),
        ("source", 0.0),
    ],
)
def test_functions_of_one_name_and_types_stay_apart(values_of_alike, kind, more):
    """Parts cached by two processes and used together in a third."""
    given = [float(values[kind]) for values in values_of_alike]
    assert given == [2.0 + more, 3.0 + more, 302.0 + 101.0 * more]


HELPER = """
from cable_twin.mechanics.language.compilation import kernel

@kernel
def scaled(x):
    return {factor} * x
"""
EDITED = """
import sys
from pathlib import Path
from cable_twin.mechanics.language.compilation import kernel

@kernel
def first(x):  # here it is settled where compiled code of this folder is kept
    return x

if len(sys.argv) > 1:
    Path(__file__).with_name("helper.py").write_text(sys.argv[1])
from helper import scaled

@kernel
def outer(x):
    return scaled(x) + 0.5

print(outer(1.0))
"""


@pytest.mark.long
def test_no_part_of_before_is_taken_when_a_source_is_edited_while_a_process_starts(tmp_path):
    """Callers of an edited function are unchanged themselves, and stay in the cache of the old sources."""
    (tmp_path / "program.py").write_text(EDITED)
    (tmp_path / "helper.py").write_text(HELPER.format(factor=2.0))
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment |= {"NUMBA_DISABLE_JIT": "0", "PYTHONDONTWRITEBYTECODE": "1"}
    outputs = []
    for edit in ([], [HELPER.format(factor=3.0)], [HELPER.format(factor=2.0)], []):
        command = [sys.executable, str(tmp_path / "program.py"), *edit]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
        assert result.returncode == 0, result.stderr
        outputs.append(float(result.stdout))
    assert outputs == [2.5, 3.5, 2.5, 2.5]


def test_nothing_gets_the_parts_of_a_brief_kernel(tmp_path):
    """Optimised kernels find their parts by name, and must not find parts loaded for brief kernels."""
    program = tmp_path / "program.py"
    program.write_text(BRIEF)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    found = subprocess.run(
        [sys.executable, str(program)], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert (found.returncode, found.stdout.split()) == (0, ["True", "False"]), found.stderr
