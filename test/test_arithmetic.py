"""Arithmetic of numpy and the libraries below it: told apart by its fingerprint, and held to a class of CPUs."""

from __future__ import annotations

import numpy as np
import pytest
from twin_process import run_python

from cable_twin.basics.arithmetic import arithmetic
from cable_twin.basics.cpu import class_of, machine, this_cpu

KNOWN = class_of(machine(), this_cpu())
VARIABLES = "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NPY_ENABLE_CPU_FEATURES", "CABLE_TWIN_CPU"
PROGRAM = """
from cable_twin.basics.cpu import hold_numpy_to_the_class
hold_numpy_to_the_class()
from cable_twin.basics.arithmetic import arithmetic
import numpy as np
print(arithmetic(), np.exp(np.linspace(-1.0, 1.0, 100)).tobytes().hex())
"""


def fingerprint(monkeypatch, **variables):
    """Fingerprint, and some exponentials, of a process that does as commands do."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    result = run_python("-c", PROGRAM, variables=variables)
    assert (result.returncode, result.stderr) == (0, ""), result.stderr
    return result.stdout.split()


@pytest.mark.skipif(KNOWN is None, reason="this CPU is of no known class")
def test_commands_have_the_arithmetic_of_the_class(monkeypatch):
    """Whatever else the CPU has; `native`, and variables of the user, leave that to numpy and OpenBLAS."""
    of_class = {"OPENBLAS_CORETYPE": KNOWN.core, "NPY_DISABLE_CPU_FEATURES": KNOWN.beyond}
    held, native = fingerprint(monkeypatch), fingerprint(monkeypatch, CABLE_TWIN_CPU="native")
    assert held == fingerprint(monkeypatch, CABLE_TWIN_CPU="native", **of_class)
    if "+avx512f" in this_cpu().features.split(","):  # what numpy has other code for
        assert held[1] != native[1]
        assert held[0] != native[0]
        assert fingerprint(monkeypatch, NPY_DISABLE_CPU_FEATURES="none")[1] == native[1]


@pytest.mark.parametrize("rounding", [lambda x: np.nextafter(x, 2.0 * x), lambda x: x - 1e-16 * x])
def test_another_rounding_is_another_arithmetic(monkeypatch, rounding):
    before, exponential = arithmetic(), np.exp
    arithmetic.cache_clear()
    assert arithmetic() == before
    arithmetic.cache_clear()
    monkeypatch.setattr("cable_twin.basics.arithmetic.OF_ARRAYS", (lambda x: rounding(exponential(x)),))
    assert arithmetic() != before
    arithmetic.cache_clear()
