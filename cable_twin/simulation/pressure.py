"""A cable without bending stiffness bears no pressure: a start that has some is a balance that nothing holds."""

from __future__ import annotations

import numpy as np

from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.records import CableSamples

ROUNDING = 1e-9  # strain


def check_pressure(system: System, rope: CableSamples) -> None:
    """Refuse a start under more pressure than rounding, or elements that fold under the weight of the cable, explain.

    Raises:
        EquilibriumError: the cable is pressed, and has no bending stiffness.
    """
    cable = system.cable
    weight = cable.mass_per_length * cable.unstrained_length * float(np.linalg.norm(cable.gravity))
    pressure = -float(rope.tensions.min())
    if cable.bending_stiffness == 0.0 and pressure > max(ROUNDING * cable.axial_stiffness, weight):
        raise EquilibriumError(
            f"cable.bending_stiffness: given 0, but the cable starts under a pressure of {pressure:.4g} N, which only "
            "a strut bears; allowed: a number above 0 in N m^2, a shorter cable, or gravity"
        )


__all__ = ["check_pressure"]
