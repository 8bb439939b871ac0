"""Check for rope bends under vehicles beyond the validated range of sharp kinks (theory.md, sharp kinks)."""

from __future__ import annotations

import warnings

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.parameters import FloatArray, System
from cable_twin.mechanics.rope.rounding import MEASURED
from cable_twin.scenario import Scenario


def worst_bend(
    scenario: Scenario, system: System, slopes: FloatArray, tensions: FloatArray
) -> tuple[float, str, float]:
    """Largest EA F² / T³ (-), its vehicle, and F (N): weight of the fully loaded vehicle across the rope.

    Looked at is each element to which the vehicle may come, with the tension that it has now.

    Args:
        scenario: of one rope.
        system: its parameters, without payloads.
        slopes: (nodes, dim) of the rope at its nodes.
        tensions: (elements,) N.
    """
    cable, carriages = system.cable, system.carriages
    gravity = np.array(cable.gravity)
    along = slopes[:-1] + slopes[1:]
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.sqrt(np.maximum(gravity @ gravity - (along @ gravity) ** 2, 0.0))  # m/s², of each element
    bends = cable.axial_stiffness * across**2 / np.maximum(tensions, 1e-9 * cable.axial_stiffness) ** 3
    worst = 0.0, "", 0.0
    for row, (name, vehicle) in enumerate(scenario.vehicles.items()):
        mass = float(carriages.mass[carriages.body_offset[row] : carriages.body_offset[row + 1]].sum())
        mass += vehicle.payload.capacity if vehicle.payload else 0.0
        where = slice(None)
        if vehicle.joint == "fixed":
            after = int(np.searchsorted(cable.node_arc_length[1:-1], vehicle.arc_length, side="right"))
            where = slice(after, after + 1)
        element = int(np.argmax(bends[where])) + (where.start or 0)
        worst = max(worst, (mass * mass * float(bends[element]), name, mass * float(across[element])))
    return worst


def warn_of_bends(scenario: Scenario, system: System, slopes: FloatArray, tensions: FloatArray, key: str) -> None:
    """Warn of a bend beyond the validated range; `key` is that of the rope, other arguments as in `worst_bend`."""
    bend, name, force = worst_bend(scenario, system, slopes, tensions)
    if bend > MEASURED:
        warnings.warn(
            f"{key}.kinks: given 'sharp' where {name!r} may bend the rope by EA F^2 / T^3 = {bend:.3g}, with a weight "
            f"of {with_unit(force, 'N')} across it; measured up to {MEASURED:g}: beyond, the solver may fail; "
            "allowed: rounded "
            "with shorter elements, a tighter rope, or less weight",
            stacklevel=2,
        )


__all__ = ["warn_of_bends", "worst_bend"]
