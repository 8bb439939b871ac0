"""Hand-over of moving loads to the next nodes of the mesh, by which none gains energy.

Where a node is handed on, two cubics become one, whose energy is another one. What it would have more is taken out of
the motion: of the rope beside the load first, and what is left of the load's own motion along the rope. A rope that is
driven along itself, and loads that another rope holds, are left as they are: theirs is the energy of the drive, and
changed rates would shake their grips.
"""

from __future__ import annotations

from math import copysign, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import accumulate, add_scaled, dot, load, scale
from cable_twin.mechanics.parameters import JOINT
from cable_twin.mechanics.rope.following_nodes import lateral_axis, shift_train
from cable_twin.mechanics.rope.patch import follows, is_driven, mean_slope
from cable_twin.mechanics.rope.point import AFTER, BEFORE, R
from cable_twin.mechanics.rope.rope_energies import momentum_of_slope, rope_energies


@kernel
def hand_over(system, state, first, last, way):
    """Hand the loads at nodes `first` to `last` on to the next nodes, `way` 1 or -1, without a gain of energy."""
    front = last if way > 0 else first
    number, elements = state.node_load[front], (min(first, first + way) - 1, max(last, last + way) + 1)
    if system.moving_cable.moving or state.clamp_holds[number]:
        shift_train(system, state, first, last, way)
        return
    before = energy_of(system, state, elements)
    shift_train(system, state, first, last, way)
    gained = slow_slopes(system, state, front + way, way, energy_of(system, state, elements) - before)
    free = state.axis[number] == JOINT and not is_driven(state, number)
    if gained > 0.0 and free and follows(state, front + way):
        slow_load(system, state, number, gained)


@inlined_kernel
def energy_of(system, state, elements):
    """Energy (J) of the elements from the first of `elements` on, before the second one."""
    kinetic, elastic, gravitational = rope_energies(system.cable, state, elements[0], elements[1])
    return kinetic + elastic + gravitational


@inlined_kernel
def slow_slopes(system, state, node, way, energy):
    """Take energy (J) out of the rope's motion beside a load, by the rates of its slopes; return what is left to take.

    Of all motions with the other coordinates and rates, that of least kinetic energy is approached: by the slope ahead
    of the load (`way`), where the merged element is, and where that is not enough by the other slope.
    """
    lateral = lateral_axis(system.carriages, state, state.node_load[node], system.cable.gravity)
    for side in range(2):
        after = (way > 0) == (side == 0)
        element, vector, row = (node, 1, AFTER) if after else (node - 1, 3, BEFORE)
        momentum, inertia = momentum_of_slope(system.cable, state, element, vector)
        momentum = add_scaled(-dot(lateral, momentum), lateral, momentum)
        most = 0.5 * dot(momentum, momentum) / inertia
        if energy > 0.0 and most > 0.0:
            share = 1.0 - sqrt(max(1.0 - energy / most, 0.0))
            accumulate(scale(-share / inertia, momentum), state.nodes.velocity[node, row])
            energy -= most
    return energy


@kernel
def slow_load(system, state, number, energy):
    """Take energy (J) out of the motion of a free load along the rope: all of its bodies, and its node, lose speed."""
    carriages, node, like = system.carriages, state.joint_node[number], system.cable.gravity
    tangent, momentum, mass = mean_slope(state.nodes.position, node, like), 0.0, 0.0
    for body in range(carriages.body_offset[number], carriages.body_offset[number + 1]):
        momentum += carriages.mass[body] * dot(tangent, load(state.bodies.velocity[body], like))
        mass += carriages.mass[body] * dot(tangent, tangent)
    left = momentum * momentum - 2.0 * mass * energy
    if not left > 0.0:
        return
    change = (copysign(sqrt(left), momentum) - momentum) / mass
    for body in range(carriages.body_offset[number], carriages.body_offset[number + 1]):
        accumulate(scale(change, tangent), state.bodies.velocity[body])
    accumulate(scale(change, tangent), state.nodes.velocity[node, R])
    state.joints.velocity[number] += change
