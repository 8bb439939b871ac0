"""A cable that moves along itself on a mesh that stands still, and what is clamped to it.

The rope goes by as `rope.strand` has it. What is clamped to it is a driven joint, which keeps its place on the rope, on
a loop of which the mesh is a part. Beyond the mesh it hangs at rest in the nearer station and takes no part.
"""

from __future__ import annotations

from math import floor, inf

from cable_twin.mechanics.drives.reference import follow, ramp
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale
from cable_twin.mechanics.on_rope.chain import hang_chain, move_chain
from cable_twin.mechanics.on_rope.sliding_joint import (
    grip_moment,
    joint_point,
    joint_tangent,
    joint_velocity,
    place_joint,
    velocity_acceleration,
)
from cable_twin.mechanics.on_rope.tower import contact_force
from cable_twin.mechanics.rope.flow import flow_integrals
from cable_twin.mechanics.rope.point import point_at, position_on_cable, slope, value
from cable_twin.mechanics.rope.strand import going_by, rest_stretch


@kernel
def moving_rope_force(system, state):
    """Force (N) of the drive on this strand: d/dt ∫ρA r_x·(r_t + v r_x) dx + Σ (λ·r_x + m ∂α/∂s) - Σ F·r_x.

    λ and m, the force and moment of a hinge, are of what is clamped, F of the contacts of towers on the cable: their
    friction, since they press across r_x. The equation of motion of the cable that has gone by. Times v it is the power
    into the strand and all that hangs on it, when what the cable itself carries out at one end it brings back at the
    other: round a closed loop.
    """
    cable = system.cable
    speed, rate = state.rope.velocity[0], state.rope.acceleration[0]
    _, squared, by_acceleration, by_rate = flow_integrals(cable, state)
    force = by_acceleration + rate * squared + 2.0 * speed * by_rate
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage] and state.attached[carriage]:
            r_x = joint_tangent(cable, state, carriage)
            force += dot(load(state.multipliers[system.carriages.body_offset[carriage]], cable.gravity), r_x)
            force += grip_moment(system, state, carriage)[1]
    for contact in range(system.towers.stiffness.size):
        r_x = slope(state.nodes.position, point_at(cable, state.contact_arc_length[contact]), cable.gravity)
        force -= dot(contact_force(cable, system.towers, state, contact)[0], r_x)
    return force


@kernel
def loop_coordinate(system, state, carriage):
    """Place (m) of what is clamped, along the mesh from its start on and round the loop as far as that start."""
    length = system.moving_cable.loop_length
    place = system.carriages.loop_place[carriage] - state.loop_start[0] + state.rope.position[0]
    return (place - length * floor(place / length)) / rest_stretch(system.cable, state)


@kernel
def move_rope(system, state, duration):
    """Move the cable by `duration` (s) as its drive has it, and the references of all that is clamped to it.

    One whose ends run over bullwheels goes as those do, and has been moved by them.
    """
    moving, course = system.moving_cable, state.rope
    if not moving.over_bullwheels:
        ramp_rope(system, state, duration)
        course.position[1], course.velocity[1] = course.position[0], course.velocity[0]
        course.acceleration[1] = course.acceleration[0]
    carry_clamped(system, state)


@kernel
def ramp_rope(system, state, duration):
    """Move the start of the rope by `duration` (s) as its drive has it."""
    moving = system.moving_cable
    limit, jerk = moving.acceleration_limit, moving.jerk_limit
    if state.rope_braking[0]:
        limit, jerk = moving.emergency_deceleration, inf
    ramp(state.rope, 0, state.rope_target[0], limit, jerk, duration)


@kernel
def carry_clamped(system, state):
    """Move the references of all that is clamped to the rope with it.

    What leaves the mesh by that is taken off. What comes onto it stays off until `attach_carriers`.
    """
    moving, cable = system.moving_cable, system.cable
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage]:
            place = loop_coordinate(system, state, carriage)
            moved = abs(place - state.joints.position[carriage])
            if state.attached[carriage] and place <= cable.unstrained_length and moved < 0.5 * moving.loop_length:
                speed, rate = going_by(cable, state, place)
                follow(state.reference, carriage, place, speed, rate)
            else:
                park(system, state, carriage, place)


@kernel
def park(system, state, carriage, place):
    """Take a carriage off the cable: it hangs at rest in the station that is nearer to its place (m) on the loop."""
    cable = system.cable
    beyond = place - cable.unstrained_length
    station = (
        cable.unstrained_length if 2.0 * beyond < system.moving_cable.loop_length - cable.unstrained_length else 0.0
    )
    hang_in_station(system, state, carriage, station)


@kernel
def hang_in_station(system, state, carriage, station):
    """Take a carriage off the cable: it hangs at rest at the end of it that is at the arc length `station` (m)."""
    cable = system.cable
    state.attached[carriage] = False
    state.joints.position[carriage], state.joints.velocity[carriage] = station, 0.0
    follow(state.reference, carriage, station, 0.0, 0.0)
    state.joints.algorithmic[carriage] = 0.0
    state.drive_force[carriage] = 0.0
    place_joint(cable, state, carriage)
    joint = position_on_cable(cable, state, station)
    still = scale(0.0, joint)
    hang_chain(system.carriages, state, carriage, joint, joint_tangent(cable, state, carriage))
    move_chain(system.carriages, cable.gravity, state, carriage, still, still)


@kernel
def attach_carriers(system, state):
    """Put what has come onto the mesh on the cable: hanging from its joint, upright, and moving as that does.

    Within one step of the end of the mesh its weight is on the held end but for some centimetres of arm, so that no
    other carriage feels more of it than the wave that a load makes that rolls onto a rope.
    """
    cable = system.cable
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage] and not state.attached[carriage]:
            place = loop_coordinate(system, state, carriage)
            if place <= cable.unstrained_length:
                attach(system, state, carriage, place)


@kernel
def attach(system, state, carriage, place):
    """Put one carriage on the cable at the arc length `place` (m)."""
    speed, rate = going_by(system.cable, state, place)
    put_on(system, state, carriage, place, speed, rate)


@kernel
def put_on(system, state, carriage, place, speed, rate):
    """Put a carriage on the cable at an arc length (m): hanging upright, and moving along it at `speed` (m/s)."""
    cable = system.cable
    state.attached[carriage] = True
    state.joints.position[carriage] = place
    state.joints.velocity[carriage] = speed
    state.joints.algorithmic[carriage] = rate
    follow(state.reference, carriage, place, speed, rate)
    state.friction_origin[carriage], state.friction_deflection[carriage] = place, 0.0
    place_joint(cable, state, carriage)
    point = joint_point(cable, state, carriage)
    joint = position_on_cable(cable, state, place)
    velocity = joint_velocity(cable, state, carriage)
    r_tt, r_x = value(state.nodes.acceleration, point, cable.gravity), slope(state.nodes.position, point, cable.gravity)
    acceleration = add_scaled(rate, r_x, add_scaled(1.0, r_tt, velocity_acceleration(cable, state, carriage)))
    hang_chain(system.carriages, state, carriage, joint, r_x)
    move_chain(system.carriages, cable.gravity, state, carriage, velocity, acceleration)
