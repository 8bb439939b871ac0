"""Stations of a moving rope: vehicles off the rope hang at rest, and are attached on their return.

Beyond the mesh a vehicle is in the station that is nearer along its loop, and takes no part in the motion. Its force on
the rope sets in or ends between two steps, so the next step uses no accelerations of the last one. A vehicle that comes
to an end of the mesh leaves the rope a share `LEAVING` of the last element before the end, on rails too: nearer
to the end the rope cannot bend under a load as it should, and would throw it up with several times its weight.
"""

from __future__ import annotations

from math import floor

from cable_twin.mechanics.drives.speed_reference import follow
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, scale
from cable_twin.mechanics.on_rope.chain import hang_chain, move_chain
from cable_twin.mechanics.on_rope.presence import keep_on, rides
from cable_twin.mechanics.on_rope.sliding_joint import (
    joint_point,
    joint_tangent,
    joint_velocity,
    place_joint,
    velocity_acceleration,
)
from cable_twin.mechanics.parameters import ALONE
from cable_twin.mechanics.rope.ale import rest_stretch, transport_velocity
from cable_twin.mechanics.rope.following_nodes import give_back
from cable_twin.mechanics.rope.point import position_on_cable, slope, value

LEAVING = 0.07  # of the element at an end: so far before the end a vehicle leaves the rope
SLOW = 0.1  # m/s: a rope that is slower may rock, and takes a vehicle off at the end itself
STEPS_AT_END = 2.0  # from an end of the mesh, within which a vehicle has come from the station


@kernel
def loop_coordinate(system, state, carriage):
    """Arc length (m) of a clamped vehicle on the closed rope loop, counted from the start of the mesh."""
    return loop_coordinate_after(system, state, carriage, 0.0)


@inlined_kernel
def loop_coordinate_after(system, state, carriage, way):
    """Arc length (m) of a clamped vehicle on the closed rope loop after a further rope travel `way` (m)."""
    length = system.moving_cable.loop_length
    along = system.carriages.loop_place[carriage] - system.moving_cable.loop_offset
    place = along - state.loop_start[0] + state.rope.position[0] + way
    return (place - length * floor(place / length)) / rest_stretch(system.cable, state)


@inlined_kernel
def leaving_at(system, end):
    """Length (m) beside the start (0) or the end (1) of a moving rope's mesh on which no vehicle is on the rope."""
    homes, last = system.cable.node_arc_length, system.cable.node_arc_length.size - 1
    between = 0.5 * max(system.moving_cable.loop_length - homes[last], 0.0)  # stations: a loop may have none
    first = 0 if end == 0 else last - 1
    return min(LEAVING * (homes[first + 1] - homes[first]), between)


@inlined_kernel
def leaves(system, state, carriage, place):
    """Return whether a vehicle at an arc length (m) enters a station: near its end, or off the mesh after a step."""
    length, speed = system.cable.unstrained_length, state.rope.velocity[0]
    if speed > SLOW and place > length - leaving_at(system, 1):
        return True
    if speed < -SLOW and place < leaving_at(system, 0):
        return True
    return loop_coordinate_after(system, state, carriage, system.solver.step * speed) > length


@inlined_kernel
def stays_off(system, state, place):
    """Return whether a detached vehicle at an arc length (m) of the mesh stays in the station for now.

    For example where the rope has stopped with the vehicle there. On a rope that slowly moves inwards, a vehicle that
    comes from the station is within `STEPS_AT_END` steps of the end, and does not stay there.
    """
    before_end, speed = system.cable.unstrained_length - place, state.rope.velocity[0]
    near = STEPS_AT_END * system.solver.step * abs(speed)
    if place < leaving_at(system, 0):
        return not (speed > SLOW or (speed > 0.0 and place < near))
    if before_end < leaving_at(system, 1):
        return not (speed < -SLOW or (speed < 0.0 and before_end < near))
    return False


@kernel
def park(system, state, carriage, place):
    """Detach a vehicle and hang it at rest in the station nearest to its arc length `place` (m) on the loop."""
    length, loop = system.cable.unstrained_length, system.moving_cable.loop_length
    at_start = place < 0.5 * length or 2.0 * (place - length) >= loop - length
    hang_in_station(system, state, carriage, 0.0 if at_start else length)


@kernel
def hang_in_station(system, state, carriage, station):
    """Detach a vehicle and hang it at rest at the end of the cable that has the arc length `station` (m)."""
    cable = system.cable
    if cable.load_nodes and state.joint_node[carriage] >= 0:
        give_back(system, state, state.joint_node[carriage])
    if state.attached[carriage]:
        state.attached[carriage], state.newton_ratio[0] = False, 0.0
    state.clamp_holds[carriage] = False
    keep_on(system, state, carriage)
    state.joints.position[carriage], state.joints.velocity[carriage] = station, 0.0
    follow(state.reference, carriage, station, 0.0, 0.0)
    state.joints.algorithmic[carriage] = 0.0
    state.drives.force[carriage] = 0.0
    place_joint(cable, state, carriage)
    joint = position_on_cable(cable, state, station)
    still = scale(0.0, joint)
    hang_chain(system.carriages, state, carriage, joint, joint_tangent(cable, state, carriage))
    move_chain(system.carriages, cable.gravity, state, carriage, still, still)


@kernel
def detach_carriers(system, state):
    """Detach all carriers that come to a station from a moving rope, and hang them at rest there."""
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage] and rides(system, state, carriage):
            place = loop_coordinate(system, state, carriage)
            if leaves(system, state, carriage, place):
                park(system, state, carriage, place)


@kernel
def attach_carriers(system, state):
    """Attach all carriers that have reached the mesh and stay on it to a moving rope: upright, at its speed.

    Within one step of the end of the mesh the held end bears a carrier's weight but for some centimetres of arm, so
    that other vehicles feel no more of it than the wave of a load that rolls onto a rope.
    """
    for carriage in range(system.carriages.fixed.size):
        if state.attached[carriage] or not system.carriages.clamped[carriage]:
            continue
        if system.number == ALONE or system.moving_cable.carries[carriage]:
            place = loop_coordinate(system, state, carriage)
            on_mesh = place <= system.cable.unstrained_length and not stays_off(system, state, place)
            if on_mesh and not leaves(system, state, carriage, place):
                attach(system, state, carriage, place)


@kernel
def attach(system, state, carriage, place):
    """Attach one vehicle to the moving cable at the arc length `place` (m), at the speed of the cable."""
    speed, rate = transport_velocity(system.cable, state, place)
    put_on(system, state, carriage, place, speed, rate)


@kernel
def put_on(system, state, carriage, place, speed, rate):
    """Attach a vehicle to the cable at an arc length (m): upright, moving along the cable at `speed` (m/s)."""
    cable = system.cable
    state.attached[carriage], state.newton_ratio[0] = True, 0.0
    keep_on(system, state, carriage)
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
