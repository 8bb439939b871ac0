"""Haul rope of an aerial tramway: elastic between drive drum and vehicle, solved within Newton's method.

The rope pulls the vehicle in space, along the track rope, but reacts on its station and not on the track rope. So it
has a coordinate w (m) of its own, the travel of the vehicle's position p in that direction. The drum has the coordinate
u (m), the rope that it has paid out or hauled: where the vehicle would be if the rope did not stretch. With
d = r_x / |r_x|², found once a step, the mean of both sides where the track rope bends at the vehicle,

    w_dot = d·p_dot = s_dot + d·S e_dot,   T d on the carriage,   -T on u.

Both count metres of track rope, so that w is s but for what the track rope moves along itself; that is taken up at the
end of each step, where w is set to s again and the drum with it. Of the rope, with the length l from drum to u,

    T = EA (u - w) / l + c (u_dot - w_dot),   c = 2 ζ sqrt(EA (m / l + ρ / 3));

T may push up to the pretension of the counter rope, by which the tension at the vehicle is more than T; at the drive it
has the weight of the rope over the height between, too, and the rope's inertia at either end. The rope's mass moves
as that of a rod of two nodes: l ρ (1/3, 1/6; 1/6, 1/3) on (w, u). The weight of the rope is taken as balanced by the
counter rope, whose mass belongs to the drive's inertia.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, store
from cable_twin.mechanics.on_rope.chain import carriage_mass
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.on_rope.sliding_joint import joint_position, joint_tangent
from cable_twin.mechanics.parameters import DRUM, END, SPEED
from cable_twin.mechanics.rope.patch import at_node, both_slopes
from cable_twin.mechanics.rope.point import R

SHORTEST = 0.1  # of the rope beyond the track: what is left of the rope if the drive hauls the carriage too far


@kernel
def rope_length(system, carriage, travel):
    """Length (m) of a haul rope from its drum to a vehicle at `travel` (m) along its track; derivative by `travel`."""
    beyond = system.haul_ropes.beyond_track[carriage]
    length, by_travel = beyond + travel, 1.0
    if system.haul_ropes.station[carriage] == END:
        length, by_travel = beyond + system.cable.unstrained_length - travel, -1.0
    return (length, by_travel) if length > SHORTEST * beyond else (SHORTEST * beyond, 0.0)


@kernel
def rope_damping(system, carriage, length):
    """Damping coefficient (N s/m) of a haul rope of given length (m), and its derivative by the length."""
    ropes = system.haul_ropes
    stiffness, ratio = ropes.axial_stiffness[carriage], ropes.damping_ratio[carriage]
    mass = carriage_mass(system.carriages, carriage)
    root = sqrt(stiffness * (mass / length + ropes.mass_per_length[carriage] / 3.0))
    return 2.0 * ratio * root, -ratio * stiffness * mass / (length * length * root)


@kernel
def rope_force(system, state, carriage):
    """Force T (N) of the haul rope on the vehicle along the track, towards larger arc length, without inertia.

    Returns:
        T; its derivatives by w, by w_dot and by u (N/m, N s/m); zero but T where the rope is slack. That by u_dot is
        minus the one by w_dot.
    """
    ropes = system.haul_ropes
    travel, rate = state.drums.position[carriage], state.drums.velocity[carriage]
    length, by_travel = rope_length(system, carriage, travel)
    stiffness = ropes.axial_stiffness[carriage] / length
    damping, damping_by_length = rope_damping(system, carriage, length)
    stretch = travel - state.hauled.position[carriage]
    stretching = rate - state.hauled.velocity[carriage]
    force = stiffness * stretch + damping * stretching
    sign = 1.0 if ropes.station[carriage] == END else -1.0
    if sign * force < -ropes.pretension[carriage]:
        return -sign * ropes.pretension[carriage], 0.0, 0.0, 0.0
    by_u = stiffness + by_travel * (damping_by_length * stretching - stiffness * stretch / length)
    return force, -stiffness, -damping, by_u


@kernel
def drum_force(system, state, carriage):
    """Force (N) of the drive on the drum of a haul rope, towards larger drum travel: rope force and inertia."""
    ropes = system.haul_ropes
    force, _, _, _ = rope_force(system, state, carriage)
    length, _ = rope_length(system, carriage, state.drums.position[carriage])
    mass = ropes.mass_per_length[carriage] * length / 6.0
    inertia = (ropes.drive_inertia[carriage] + 2.0 * mass) * state.drums.acceleration[carriage]
    return force + inertia + mass * state.hauled.acceleration[carriage]


@kernel
def pull_on_carriage(system, state, carriage):
    """Force (N) of the haul rope on its vehicle along the track, less the inertia force of the rope."""
    force, _, _, _ = rope_force(system, state, carriage)
    length, _ = rope_length(system, carriage, state.drums.position[carriage])
    mass = system.haul_ropes.mass_per_length[carriage] * length / 6.0
    return force - mass * (2.0 * state.hauled.acceleration[carriage] + state.drums.acceleration[carriage])


@kernel
def haul_tension(system, state, carriage):
    """Highest tension (N) of a haul rope: at its vehicle, or at its drive in the height of that end of the track."""
    ropes, drums, hauled = system.haul_ropes, state.drums, state.hauled
    force, _, _, _ = rope_force(system, state, carriage)
    length, _ = rope_length(system, carriage, drums.position[carriage])
    mass = ropes.mass_per_length[carriage] * length / 6.0
    at_vehicle = pull_on_carriage(system, state, carriage)
    at_drive = force + mass * (2.0 * drums.acceleration[carriage] + hauled.acceleration[carriage])
    place = joint_position(system.cable, state, carriage)
    station, sign = state.nodes.position[0, 0], -1.0
    if ropes.station[carriage] == END:
        station, sign = state.nodes.position[-1, 0], 1.0
    below = add_scaled(-1.0, load(station, place), place)
    weight = ropes.mass_per_length[carriage] * dot(load(system.cable.gravity, place), below)
    d = haul_direction(system, state, carriage)
    metres = sign * sqrt(dot(d, d))  # of track rope in one of way
    return ropes.pretension[carriage] + max(metres * at_vehicle, metres * at_drive + weight)


@kernel
def haul_direction(system, state, carriage):
    """Haul direction d (dim,): derivative of a vehicle's travel along the track by its position.

    It is r_x / |r_x|², and at a node the mean of that of both sides: in a bend of the angle 2α of a track rope that
    moves across itself alone, d·p_dot is s_dot, while the path of the vehicle is longer by 1 / cos α.
    """
    if not at_node(system.cable, state, carriage):
        return along(joint_tangent(system.cable, state, carriage))
    before, after = both_slopes(state.nodes.position, state.joint_node[carriage], system.cable.gravity)
    return scale(0.5, add_scaled(1.0, along(before), along(after)))


@inlined_kernel
def along(r_x):
    """Derivative r_x / |r_x|² (dim,) of arc length by position, for a rope with slope r_x."""
    return scale(1.0 / dot(r_x, r_x), r_x)


@kernel
def leave_place(system, state, work):
    """Store the position of each vehicle with a haul rope at the start of a step, before prediction."""
    for carriage in range(state.axis.size):
        if state.axis[carriage] == DRUM and belongs(system, state, carriage):
            place = joint_position(system.cable, state, carriage)
            store(place, work.haul_place[carriage])
            work.haul_origin[carriage] = state.hauled.position[carriage]


@kernel
def direct_haul(system, state, work):
    """Set direction and origin of the travel of each haul rope for a step, from the predicted configuration."""
    for carriage in range(state.axis.size):
        if state.axis[carriage] == DRUM and belongs(system, state, carriage):
            d = haul_direction(system, state, carriage)
            store(d, work.haul_direction[carriage])
            work.haul_origin[carriage] -= dot(d, load(work.haul_place[carriage], d))
            if at_node(system.cable, state, carriage):
                go_with_node(state, carriage, d, work.haul_origin[carriage])


@inlined_kernel
def go_with_node(state, carriage, d, origin):
    """Set travel and rates of a haul rope to those of its vehicle's node in the direction d (dim,), without ḋ.

    Predicted from its own rates they would have a jump wherever d turns within a step, at a saddle or a change of
    nodes, and swing from step to step about it.
    """
    nodes, hauled, node = state.nodes, state.hauled, state.joint_node[carriage]
    hauled.position[carriage] = origin + dot(d, load(nodes.position[node, R], d))
    hauled.velocity[carriage] = dot(d, load(nodes.velocity[node, R], d))
    hauled.acceleration[carriage] = dot(d, load(nodes.acceleration[node, R], d))
    hauled.algorithmic[carriage] = dot(d, load(nodes.algorithmic[node, R], d))


@kernel
def take_up(system, state):
    """Reset the travel of each haul rope to the arc length of its vehicle, and shift its drum and reference alike."""
    for carriage in range(state.axis.size):
        if state.axis[carriage] == DRUM and belongs(system, state, carriage):
            slid = state.hauled.position[carriage] - state.joints.position[carriage]
            state.hauled.position[carriage] = state.joints.position[carriage]
            state.drums.position[carriage] -= slid
            state.reference.position[carriage] -= slid


@kernel
def condense_drum(system, state, carriage, mass_factor, rate_factor, work):
    """Eliminate the drum of a haul rope; store the rope's force, its tangent and increment, and the haul travel gap.

    A drum that follows its reference has no increment; the row of any other is
    (drive inertia + l ρ / 3) u_ddot + l ρ / 6 w_ddot + T = drive force.
    """
    ropes = system.haul_ropes
    force, by_w, by_w_dot, by_u = rope_force(system, state, carriage)
    length, by_travel = rope_length(system, carriage, state.drums.position[carriage])
    rope = ropes.mass_per_length[carriage] / 6.0
    mass, mass_by_u = rope * length, rope * by_travel
    u_ddot, w_ddot = state.drums.acceleration[carriage], state.hauled.acceleration[carriage]
    t_by_w = by_w + rate_factor * by_w_dot
    t_by_u = by_u - rate_factor * by_w_dot
    on_w = force - mass * (2.0 * w_ddot + u_ddot)
    on_w_by_w = t_by_w - mass_factor * 2.0 * mass
    place = joint_position(system.cable, state, carriage)
    way = work.haul_origin[carriage] + dot(load(work.haul_direction[carriage], place), place)
    gap, change = way - state.hauled.position[carriage], 0.0
    row = work.drum_row[carriage]
    row[0], row[1], row[2] = 1.0, 0.0, 0.0
    if state.drives.mode[carriage] != SPEED:
        on_w_by_u = t_by_u - mass_factor * mass - mass_by_u * (2.0 * w_ddot + u_ddot)
        drive = ropes.drive_inertia[carriage]
        row[0] = mass_factor * (drive + 2.0 * mass) + t_by_u + mass_by_u * (2.0 * u_ddot + w_ddot)
        row[1] = mass_factor * mass + t_by_w
        row[2] = state.drives.force[carriage] - force - (drive + 2.0 * mass) * u_ddot - mass * w_ddot
        change = on_w_by_u * row[2] / row[0]
        on_w_by_w -= on_w_by_u * row[1] / row[0]
    work.haul_force[carriage], work.haul_by_way[carriage] = on_w, on_w_by_w
    work.haul_gap[carriage], work.haul_change[carriage] = gap, change + on_w_by_w * gap


@kernel
def recover_drum(carriage, moved, work):
    """Store the increments of haul travel and drum travel, from the displacement (dim,) of the vehicle's joint."""
    row = work.drum_row[carriage]
    way = work.haul_gap[carriage] + dot(load(work.haul_direction[carriage], moved), moved)
    work.haul_increment[carriage] = way
    work.drum_increment[carriage] = (row[2] - row[1] * way) / row[0]


@kernel
def hang_in_rope(system, state, carriage, force):
    """Set the drum at rest for a static `force` (N) of its haul rope; return whether the rope can carry the force."""
    ropes = system.haul_ropes
    beyond, stiffness = ropes.beyond_track[carriage], ropes.axial_stiffness[carriage]
    s = state.joints.position[carriage]
    if ropes.station[carriage] == END:
        travel = (stiffness * s + force * (beyond + system.cable.unstrained_length)) / (stiffness + force)
        can = force >= -ropes.pretension[carriage]
    else:
        travel = (stiffness * s + force * beyond) / (stiffness - force)
        can = force <= ropes.pretension[carriage]
    drums = state.drums
    drums.position[carriage], drums.velocity[carriage] = travel, 0.0
    drums.acceleration[carriage] = drums.algorithmic[carriage] = 0.0
    state.reference.position[carriage] = travel
    hauled = state.hauled
    hauled.position[carriage], hauled.velocity[carriage] = s, 0.0
    hauled.acceleration[carriage] = hauled.algorithmic[carriage] = 0.0
    return can


@kernel
def haul_energies(system, state):
    """Kinetic and elastic energy (J) of all haul ropes and their drives."""
    kinetic, elastic = 0.0, 0.0
    for carriage in range(state.axis.size):
        if state.axis[carriage] == DRUM and belongs(system, state, carriage):
            u_dot, w_dot = state.drums.velocity[carriage], state.hauled.velocity[carriage]
            length, _ = rope_length(system, carriage, state.drums.position[carriage])
            rope = system.haul_ropes.mass_per_length[carriage] * length / 6.0
            kinetic += 0.5 * system.haul_ropes.drive_inertia[carriage] * u_dot * u_dot
            kinetic += rope * (w_dot * w_dot + w_dot * u_dot + u_dot * u_dot)
            stiffness = system.haul_ropes.axial_stiffness[carriage] / length
            stretch = state.drums.position[carriage] - state.hauled.position[carriage]
            sign = 1.0 if system.haul_ropes.station[carriage] == END else -1.0
            slack = -system.haul_ropes.pretension[carriage] / stiffness
            stretch = max(sign * stretch, slack)
            elastic += 0.5 * stiffness * stretch * stretch
    return kinetic, elastic
