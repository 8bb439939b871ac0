"""Friction that holds at rest and slips beyond a limit."""

from __future__ import annotations

from math import exp

from cable_twin.mechanics.language.compilation import kernel


@kernel
def mobilise(way, before, presliding):
    """Share z in -1..1 of a friction that is mobilised after a `way` (m) from the share `before`, and dz/dway (1/m).

    Dahl's law dz/ds = (1 - z sign(ṡ)) / p, in closed form over the way since the start of the step. It is smooth
    through zero speed and holds still on a slope, since z changes with the way and not with time; a joint that goes
    on vibrating there creeps (docs/theory.md).
    """
    sign = 1.0 if way >= 0.0 else -1.0
    left = (before - sign) * exp(-abs(way) / presliding)
    return sign + left, -sign * left / presliding
