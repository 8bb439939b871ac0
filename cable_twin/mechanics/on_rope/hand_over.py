"""Hand-over of moving loads to the next nodes of the mesh, by which none gains energy.

Where a node is handed on, two cubics become one, whose energy is another one. What it has more, a free load pays with
its speed along the rope: the rope's own waves stay as they are, as changed rates would let short ones grow beside fast
loads. Loads that a drive or another rope holds get their energy there.
"""

from __future__ import annotations

from math import copysign, sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import accumulate, dot, load, scale
from cable_twin.mechanics.parameters import JOINT
from cable_twin.mechanics.rope.following_nodes import shift_train
from cable_twin.mechanics.rope.patch import follows, is_driven, mean_slope
from cable_twin.mechanics.rope.point import R
from cable_twin.mechanics.rope.rope_energies import rope_energies


@kernel
def hand_over(system, state, first, last, way):
    """Hand the loads at nodes `first` to `last` on to the next nodes, `way` 1 or -1; a free one gains no energy."""
    front = last if way > 0 else first
    number, elements = state.node_load[front], (min(first, first + way) - 1, max(last, last + way) + 1)
    held = system.moving_cable.moving or state.clamp_holds[number] or is_driven(state, number)
    if held or state.axis[number] != JOINT or not follows(state, front):
        shift_train(system, state, first, last, way)
        return
    before = energy_of(system, state, elements)
    shift_train(system, state, first, last, way)
    slow_load(system, state, number, energy_of(system, state, elements) - before)


@inlined_kernel
def energy_of(system, state, elements):
    """Energy (J) of the elements from the first of `elements` on, before the second one."""
    kinetic, elastic, gravitational = rope_energies(system.cable, state, elements[0], elements[1])
    return kinetic + elastic + gravitational


@kernel
def slow_load(system, state, number, energy):
    """Take energy (J), if it is one, out of a free load's motion along the rope: its bodies and node lose speed."""
    carriages, node, like = system.carriages, state.joint_node[number], system.cable.gravity
    tangent, momentum, mass = mean_slope(state.nodes.position, node, like), 0.0, 0.0
    for body in range(carriages.body_offset[number], carriages.body_offset[number + 1]):
        momentum += carriages.mass[body] * dot(tangent, load(state.bodies.velocity[body], like))
        mass += carriages.mass[body] * dot(tangent, tangent)
    left = momentum * momentum - 2.0 * mass * energy
    if not (energy > 0.0 and left > 0.0):
        return
    change = (copysign(sqrt(left), momentum) - momentum) / mass
    for body in range(carriages.body_offset[number], carriages.body_offset[number + 1]):
        accumulate(scale(change, tangent), state.bodies.velocity[body])
    accumulate(scale(change, tangent), state.nodes.velocity[node, R])
    state.joints.velocity[number] += change
