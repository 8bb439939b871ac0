"""Integrators by name: each is a module here with a kernel `advance`, and a name in `parameters.INTEGRATORS`."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from cable_twin.mechanics.parameters import INTEGRATORS


def integrator_named(name: str) -> Callable[..., Any]:
    """The kernel `advance` of an integrator: takes what `generalized_alpha.advance` does, returns fields of `Outcome`.

    Raises:
        KeyError: there is none of that name.
    """
    if name not in INTEGRATORS:
        raise KeyError(name)
    return import_module(f"cable_twin.mechanics.solution.{name}").advance  # type: ignore[no-any-return]
