"""Check for compression at the start of a cable without bending stiffness: such an equilibrium is unstable."""

from __future__ import annotations

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import CableSamples
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.catenary import EquilibriumError

ROUNDING = 1e-9  # strain


def check_pressure(system: System, rope: CableSamples) -> None:
    """Refuse a start with compression beyond rounding errors and beyond elements that fold under the cable's weight.

    Raises:
        EquilibriumError: the cable is pressed, and has no bending stiffness.
    """
    cable = system.cable
    weight = cable.mass_per_length * cable.unstrained_length * float(np.linalg.norm(cable.gravity))
    pressure = -float(rope.tensions.min())
    if cable.bending_stiffness == 0.0 and pressure > max(ROUNDING * cable.axial_stiffness, weight):
        raise EquilibriumError(
            "cable.bending_stiffness: given 0, but the cable starts under a pressure of "
            f"{with_unit(pressure, 'N')}, which only "
            "a strut bears; allowed: a number above 0 in N m^2, a shorter cable, or gravity"
        )


__all__ = ["check_pressure"]
