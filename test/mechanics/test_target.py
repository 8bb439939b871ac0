"""Kernels are compiled for a class of CPUs, one code for all of them, or for the CPU itself where that is asked for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import pytest

import cable_twin
from cable_twin.basics.cpu import CLASSES, Target, choose, machine, this_cpu
from verification import JIT

ROOT = Path(cable_twin.__file__).resolve().parents[1]
CLASS = CLASSES["x86_64"].target
NEWER = Target("newer", "newer", f"{CLASS.features},+avx512f,-avx512fp16")
OLDER = Target("older", "older", CLASS.features.replace("+avx2", "-avx2"))
PROGRAM = """
import numba
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.target import target

@kernel
def scaled(x, factor):
    for i in range(x.size):
        x[i] = factor * x[i] + 1.0

@numba.njit
def of_somebody_else(x):
    return 2.0 * x

import numpy as np
x = np.arange(1000.0)
scaled(x, 1.1)
assert np.all(x == 1.1 * np.arange(1000.0) + 1.0)  # and nothing fused, which would round once
assert of_somebody_else(2.0) == 4.0
(compiled,) = scaled._from_python.overloads.values()
(other,) = of_somebody_else.overloads.values()
assembly = compiled.library.get_asm_str()
print(target().name, "ymm" in assembly, "zmm" in assembly, "vfmadd" in assembly, other.codegen.magic_tuple()[1])
"""


def run(tmp_path, **variables):
    """Words that a process prints that compiles a kernel, and its errors."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    places = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_DISABLE_JIT": "0"}
    inherited = {name: value for name, value in os.environ.items() if name != "CABLE_TWIN_CPU"}
    done = subprocess.run(
        [sys.executable, str(program)],
        env={**inherited, **places, **variables},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr


def test_a_cpu_of_the_class_gets_the_code_of_the_class_and_its_own_on_demand():
    assert choose("", "x86_64", NEWER) == choose("x86-64-v3", "x86_64", NEWER) == CLASS
    assert choose("native", "x86_64", NEWER) == NEWER
    assert choose("", "x86_64", OLDER) == choose("native", "x86_64", OLDER) == OLDER
    assert choose("", "riscv64", OLDER) == OLDER


@pytest.mark.parametrize(
    ("wanted", "host", "told"),
    [
        ("x86-64-v4", NEWER, "CABLE_TWIN_CPU: given 'x86-64-v4'; allowed: x86-64-v3 or native"),
        (
            "x86-64-v3",
            OLDER,
            "CABLE_TWIN_CPU: given 'x86-64-v3'; allowed: native, as older is of no known class",
        ),
    ],
)
def test_a_target_that_is_not_there_is_told_in_a_line(wanted, host, told):
    with pytest.raises(ValueError, match="CABLE_TWIN_CPU") as raised:
        choose(wanted, "x86_64", host)
    assert str(raised.value) == told


@pytest.mark.parametrize("kind", ["x86_64", "aarch64"])
def test_llvm_knows_the_classes(kind, capfd):
    """It goes on with a line on the terminal where it does not know a CPU or a feature."""
    known = CLASSES[kind].target
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    triple = llvm.Target.from_triple(f"{kind}-unknown-linux-gnu")
    code = llvm.parse_assembly(f"""
        target triple = "{kind}-unknown-linux-gnu"
        define <4 x double> @f(<4 x double> %a, <4 x double> %b) {{
            %c = fmul <4 x double> %a, %b
            %d = fadd <4 x double> %c, %a
            ret <4 x double> %d
        }}""")
    assembly = triple.create_target_machine(cpu=known.cpu, features=known.features).emit_assembly(code)
    assert ("ymm" in assembly) == (kind == "x86_64")
    assert ("v0.2d" in assembly) == (kind == "aarch64")
    assert "not a recognized" not in capfd.readouterr().err


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_kernels_are_compiled_for_the_class_and_other_code_of_the_process_is_not(tmp_path):
    host = this_cpu()
    if choose("", machine(), host) != CLASS:
        pytest.skip("this CPU is not of the class")
    assert run(tmp_path) == (["x86-64-v3", "True", "False", "False", host.name], "")
    (compiled,) = kept(tmp_path)
    words, _ = run(tmp_path, NUMBA_CPU_NAME="skylake")  # another CPU of the class takes what is there
    assert (words[0], words[-1]) == ("x86-64-v3", "skylake")
    assert kept(tmp_path) == [compiled]
    words, _ = run(tmp_path, CABLE_TWIN_CPU="native")
    assert (words[0], len(kept(tmp_path))) == (host.name, 2)
    words, _ = run(tmp_path, NUMBA_CPU_NAME="ivybridge", NUMBA_CPU_FEATURES=OLDER.features.replace("+fma", "-fma"))
    assert words == ["ivybridge", "True", "False", "False", "ivybridge"]
    assert len(kept(tmp_path)) == 3


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_a_wrong_target_is_told_and_the_default_taken(tmp_path):
    words, said = run(tmp_path, CABLE_TWIN_CPU="fast")
    (line,) = said.splitlines()
    assert line.startswith("CABLE_TWIN_CPU: given 'fast'; allowed: ")
    assert line.endswith(f"; {words[0]} is used")


def kept(tmp_path):
    """Compiled code in the cache."""
    return sorted((tmp_path / "cache").rglob("*.nbc"))
