"""Growth of joint forces from node to node where a vehicle crosses an element in too few steps (theory.md)."""

from __future__ import annotations

import warnings
from math import inf, log, sqrt

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import CableSamples
from cable_twin.mechanics.parameters import System
from cable_twin.scenario import Scenario

E_FOLDS = 5.6  # by which the error of a joint has to die out on an element, measured
REACH = 0.45  # ln(1/ρ) times the elements that a wave crosses in a step, from which on nothing grows, measured


def growing_steps(spectral_radius: float, length: float, speed: float, wave: float) -> tuple[float, float]:
    """Interval of step sizes (s) of generalized-alpha in which the joint force at nodes may grow.

    Those with speed h/l > ln(1/ρ)/5.6 and wave h/l < 0.45/ln(1/ρ); none where the first is not below the second.

    Args:
        spectral_radius: ρ, at infinite frequency.
        length: l, of the elements (m).
        speed: of the joint along the cable (m/s), at least 0.
        wave: speed of transverse waves (m/s), at least 0.
    """
    decay = log(1.0 / spectral_radius) if spectral_radius > 0.0 else inf
    shortest = decay / E_FOLDS * length / speed if speed > 0.0 else inf
    return shortest, REACH / decay * length / wave if decay * wave > 0.0 else inf


def highest_speed(vehicles: Scenario, drives: Scenario) -> float:
    """Highest speed (m/s) of the vehicles of one scenario with the drives of another; 0 without any limit."""
    moved = [one for one in vehicles.vehicles.values() if one.joint != "fixed"]
    limits = [drive.limits.speed for drive in drives.drives.values()] if moved else []
    limits += [one.drive.limits.speed for one in moved]
    return max([*(limit for limit in limits if limit is not None), *(abs(one.speed) for one in moved)], default=0.0)


def warn_of_crossing(vehicles: Scenario, drives: Scenario, system: System, rope: CableSamples) -> None:
    """Warn of a step size with which joint forces may grow on the shortest elements, at the least tension of `rope`."""
    step, radius = system.solver.step, system.solver.spectral_radius
    speed, length = highest_speed(vehicles, drives), float(system.cable.element_length.min())
    wave = sqrt(max(float(rope.tensions.min()), 0.0) / system.cable.mass_per_length)
    shortest, longest = growing_steps(radius, length, speed, wave)
    if shortest < step < longest:
        warnings.warn(
            f"solver.step of {step:g} s is above {shortest:.3g} s, the longest for a vehicle at {speed:g} m/s on "
            f"elements of {with_unit(length, 'm', 3)} with solver.spectral_radius {radius:g}: the force of its "
            "joint may grow from "
            "node to node; a shorter step, longer elements or a lower radius prevent that",
            stacklevel=3,
        )


__all__ = ["growing_steps", "highest_speed", "warn_of_crossing"]
