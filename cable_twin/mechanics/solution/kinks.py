"""Frozen quantities of joint compliance in a step, from the predicted rope: see `rope.kink`.

Across what each joint yields, how slack the rope is, and the rope that its kink takes: what it takes under the
weight of the vehicle and the mean tension of the rope. Rope that came and went with the forces beside it would be a
compliance, which gives energy to waves along the rope where Newton's method does not know of it.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.simd import WIDTH, spread
from cable_twin.mechanics.language.vectors import dot, store
from cable_twin.mechanics.on_rope.sliding_joint import joint_along
from cable_twin.mechanics.rope.element import group_tension
from cable_twin.mechanics.rope.kink import has_kinks, kink_length, shares

SLACKEST = 1.5  # τ, also of a rope that has less tension: c is worked out around 1, and a slack rope is no string


@kernel
def hold_kinks(system, state, work):
    """Freeze tangent, slackness and rope length in the kinks for a step, if joints are compliant."""
    if has_kinks(system.cable):
        state.slackness[0] = slackness(system.cable, state, work)
        clear_array(state.kink_length)
        for carriage in range(system.carriages.fixed.size):
            along = joint_along(system.cable, state, carriage)
            store(along, work.joint_along[carriage])
            if state.attached[carriage]:
                take_rope(system, state, carriage, along)


@kernel
def slackness(cable, state, work):
    """Mean tension of the rope at rest over the present one (-), a single number for the whole rope."""
    now, rest = 0.0, 0.0
    for first in range(0, cable.element_count, WIDTH):
        spread((group_tension(cable, state, first),), work.group, 0)
        for lane in range(min(WIDTH, cable.element_count - first)):
            now += cable.element_length[first + lane] * work.group[0, lane]
            rest += cable.element_length[first + lane] * cable.rounding_tension[first + lane]
    return rest / max(now, rest / SLACKEST)


@kernel
def take_rope(system, state, carriage, along):
    """Take the rope in the kink of a joint from three elements, at the unit tangent `along` (dim,)."""
    cable, carriages, gravity, mass = system.cable, system.carriages, system.cable.gravity, 0.0
    for body in range(carriages.body_offset[carriage], carriages.body_offset[carriage + 1]):
        mass += carriages.mass[body]
    weight = mass * sqrt(max(dot(gravity, gravity) - dot(gravity, along) ** 2, 0.0))
    element, place = state.joint_element[carriage], state.joints.position[carriage]
    length = kink_length(cable, element, place, weight, state.slackness[0])
    for number, share in shares(cable, element, place):
        state.kink_length[number] += share * length


__all__ = ["hold_kinks"]
