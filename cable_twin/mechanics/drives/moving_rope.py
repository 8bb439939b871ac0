"""Axially moving cable on a fixed mesh, and vehicles clamped to it.

The rope moves through its mesh as in `rope.ale`. A vehicle clamped to the rope is a driven joint that keeps its place
on the rope, on a loop of which the mesh is a part. Beyond the mesh the vehicle is in a station (`stations`).
"""

from __future__ import annotations

from math import inf

from cable_twin.mechanics.drives.speed_reference import approach_target, follow
from cable_twin.mechanics.drives.stations import loop_coordinate, park
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import dot, scale
from cable_twin.mechanics.on_rope.presence import belongs, rides
from cable_twin.mechanics.on_rope.rails import force_of_ropes
from cable_twin.mechanics.on_rope.sliding_joint import joint_tangent, tangent_moment
from cable_twin.mechanics.on_rope.tower import contact_force
from cable_twin.mechanics.parameters import START
from cable_twin.mechanics.rope.ale import transport_velocity
from cable_twin.mechanics.rope.flow import flow_integrals
from cable_twin.mechanics.rope.patch import at_node, both_slopes
from cable_twin.mechanics.rope.point import point_at, slope


@kernel
def moving_rope_force(system, state):
    """Force (N) of the drive on a moving rope: rate of axial momentum, plus vehicles' forces, less tower friction.

    It is d/dt ∫ρA r_x·(r_t + v r_x) dx + Σ (λ·t + m ∂α/∂s) - Σ F·r_x.

    t is `pulled_slope`. λ and m are joint force and hinge moment of clamped vehicles, F the force of a tower contact on
    the cable, of which only friction counts, since the normal force is across r_x. This is the equation of motion of
    the rope travel. Times v it is the power into the strand and its vehicles, where the energy that the cable carries
    out at one end comes back at the other: on a closed loop.
    """
    cable = system.cable
    speed, rate = state.rope.velocity[0], state.rope.acceleration[0]
    squared, by_acceleration, by_rate = flow_integrals(cable, state)
    force = by_acceleration + rate * squared + 2.0 * speed * by_rate
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage] and rides(system, state, carriage):
            force += dot(force_of_ropes(system, state, carriage), pulled_slope(cable, state, carriage))
            force += tangent_moment(system, state, carriage)[1]
    for contact in range(system.towers.stiffness.size):
        r_x = slope(state.nodes.position, point_at(cable, state, state.contact_arc_length[contact]), cable.gravity)
        force -= dot(contact_force(cable, system.towers, state, contact)[0], r_x)
    return force


@inlined_kernel
def pulled_slope(cable, state, carriage):
    """Vector t (dim,): of a clamped vehicle's contact force λ, a moving rope's drive bears the part λ·t (N).

    It is r_x, and at a node, with a and b the slopes on both sides and r their mean, r (a·a + b·b) / (2 r·r): then λ·t
    is the difference of T |r_x| less the strain energy per length on both sides, whatever the angle of the bend.
    """
    r_x = joint_tangent(cable, state, carriage)
    if not at_node(cable, state, carriage):
        return r_x
    before, after = both_slopes(state.nodes.position, state.joint_node[carriage], r_x)
    return scale(0.5 * (dot(before, before) + dot(after, after)) / dot(r_x, r_x), r_x)


@kernel
def move_rope(system, state, duration):
    """Advance the moving rope by `duration` (s) under its drive, and the references of all vehicles clamped to it.

    A rope whose ends run over bullwheels has been moved by the bullwheels already.
    """
    moving, course = system.moving_cable, state.rope
    if not moving.over_bullwheels:
        approach_target(moving.limits, state.rope_drive, START, course, inf, inf, duration)
        course.position[1], course.velocity[1] = course.position[0], course.velocity[0]
        course.acceleration[1] = course.acceleration[0]
    carry_clamped(system, state)


@kernel
def carry_clamped(system, state):
    """Update the references of all vehicles clamped to the rope, and park those that leave the mesh in a station.

    A vehicle that comes onto the mesh stays detached until `stations.attach_carriers`.
    """
    moving, cable = system.moving_cable, system.cable
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage] and belongs(system, state, carriage):
            place = loop_coordinate(system, state, carriage)
            moved = abs(place - state.joints.position[carriage])
            if state.attached[carriage] and place <= cable.unstrained_length and moved < 0.5 * moving.loop_length:
                speed, rate = transport_velocity(cable, state, place)
                follow(state.reference, carriage, place, speed, rate)
            else:
                park(system, state, carriage, place)
