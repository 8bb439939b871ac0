"""What sharp kinks hold on to for a step, of the rope as it is now or is predicted to be.

Across what each joint yields, under what tension, and the rope that its kink takes (`rope.kink`): they change so little
in a step that Newton's method need not know of it.
"""

from __future__ import annotations

from cable_twin.mechanics.drives.pull import joint_forces
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.vectors import load, store
from cable_twin.mechanics.on_rope.sliding_joint import joint_along
from cable_twin.mechanics.rope.kink import has_kinks, kink_length, shares, slackness


@kernel
def hold_kinks(system, state, work):
    """Choose all three for each joint, if joints yield at all."""
    cable = system.cable
    for carriage in range(system.carriages.fixed.size if has_kinks(cable) else 0):
        element, place = state.joint_element[carriage], state.joints.position[carriage]
        work.joint_slackness[carriage] = slackness(cable, state, element, place)
        store(joint_along(cable, state, carriage), work.joint_along[carriage])
    clear_array(state.kink_length)
    for carriage in range(system.carriages.fixed.size if has_kinks(cable) else 0):
        if state.attached[carriage]:
            element, place = state.joint_element[carriage], state.joints.position[carriage]
            force, along = joint_forces(system, state, carriage)[0], load(work.joint_along[carriage], cable.gravity)
            length = kink_length(cable, element, place, force, along, work.joint_slackness[carriage])
            for number, share in shares(cable, element, place):
                state.kink_length[number] += share * length


__all__ = ["hold_kinks"]
