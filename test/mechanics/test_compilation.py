"""Kernels as they are kept: complete for Python, without their door to it for other kernels."""

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
from cable_twin.mechanics.generalized_alpha import coefficients
from cable_twin.mechanics.shape_functions import shape_functions
from cable_twin.mechanics.compilation import kernel

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


@pytest.mark.parametrize("disabled", ["0", "1"])
def test_kernels_are_compiled_once_and_called_from_both_sides(tmp_path, disabled):
    program = tmp_path / "program.py"
    program.write_text(CODE.replace("outer.py_func", "outer") if disabled == "1" else CODE)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
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
