"""Integrators by name: modules of this package with a kernel `advance`, listed in `parameters.INTEGRATORS`."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from cable_twin.mechanics.parameters import INTEGRATORS


def integrator_named(name: str) -> Callable[..., Any]:
    """Kernel `advance` of an integrator, with the arguments and results of `generalized_alpha.advance`.

    Raises:
        KeyError: there is none of that name.
    """
    if name not in INTEGRATORS:
        raise KeyError(name)
    return import_module(f"cable_twin.mechanics.solution.{name}").advance  # type: ignore[no-any-return]
