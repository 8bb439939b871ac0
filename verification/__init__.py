"""Verification cases of the mechanics: expected results with their source and tolerance.

A case is a function marked with `case` in one of the modules beside this file. The tests run them all, and
`python -m verification` writes them as a table into `docs/verification.md`.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

JIT = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
MODULES = (
    "statics",
    "rope_frequencies",
    "dynamics",
    "conservation",
    "drives",
    "carriages",
    "vehicle_buffers",
    "hinges",
    "supports",
    "counterweights",
    "moving_cable",
    "tramway",
    "haul_ropes",
    "loads",
    "random_loads",
    "load_statics",
    "load_cases",
    "moving_loads",
    "meshes",
    "space",
    "rotation",
    "wind",
    "grooves",
    "ropes",
    "loops",
    "bicable",
    "shipped_meshes",
    "en50318",
)


@dataclass(frozen=True)
class Result:
    """Number of a case beside its expected value."""

    quantity: str
    unit: str
    expected: float
    got: float
    tolerance: float  # absolute, in the unit

    @property
    def error(self) -> float:
        """Absolute difference from the expected value, in the unit."""
        return abs(self.got - self.expected)

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance; never for NaN."""
        return self.error <= self.tolerance


@dataclass(frozen=True)
class Case:
    """One verification case."""

    name: str
    source: str
    run: Callable[[], Iterator[Result]]
    needs_jit: bool  # too long to run with the JIT off
    long: bool  # too long for the tests that one runs often


CASES: list[Case] = []


def case(
    name: str, source: str, *, needs_jit: bool = False, long: bool = False
) -> Callable[[Callable[[], Iterator[Result]]], Callable]:
    """Register a generator of results as a case."""

    def register(run: Callable[[], Iterator[Result]]) -> Callable[[], Iterator[Result]]:
        CASES.append(Case(name, source, run, needs_jit, long))
        return run

    return register


def load_cases(modules: Iterable[str] = MODULES) -> list[Case]:
    """Cases of all or some modules in their order; with the JIT off, those that run without compiled kernels."""
    loaded = {importlib.import_module(f"verification.{module}").__name__ for module in modules}
    return [one for one in CASES if one.run.__module__ in loaded and (JIT or not one.needs_jit)]
