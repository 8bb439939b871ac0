"""Clamp to a haul rope of a vehicle that slides on a track rope: rigid constraint with a multiplier.

The clamp is rigid, p + o = q: the place p = S(n) e of the joint, with the offset o of the clamp from it, is that of the
other rope q = S(l) e_h at its arc length l. The multiplier F is the force of the other rope on the carriage. The track
rope bears λ - F, and nothing of F along itself: the row of n has (λ - F)·r_x. F and n together are one more block of
the linear system beside the nodes of both elements (`elimination`), so that Newton's tangent is whole and no stiffness
has to be chosen.

A carriage clamped to a loop of haul rope leaves the track where the loop does, in the stations: there it is detached
and hangs at rest, until the loop comes to a track again. Beside both ends of a track are the rails of the stations,
which carry a part of its weight, all of it at the end, so that both ropes take it over as smoothly as from rails that
sink away from under the wheels. They push upwards, and do work as such rails would.
"""

from __future__ import annotations

from math import floor, sqrt

from cable_twin.mechanics.drives.stations import hang_in_station, put_on
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    dot,
    full,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    symmetric,
)
from cable_twin.mechanics.on_rope.chain import carriage_mass
from cable_twin.mechanics.on_rope.presence import belongs, rides
from cable_twin.mechanics.on_rope.rails import share_on_rails
from cable_twin.mechanics.on_rope.sliding_joint import joint_point, joint_position, joint_tangent, joint_velocity
from cable_twin.mechanics.on_rope.tower_contact import nearest
from cable_twin.mechanics.rope.ale import rest_stretch, transport_velocity
from cable_twin.mechanics.rope.patch import at_node
from cable_twin.mechanics.rope.point import add_column, add_force, clamp_row, point_at, read_matrix, slope, value
from cable_twin.mechanics.solution.bundle.records import STATE, SYSTEM, WORK, rope_of

CLOSING_TIME = 2.0  # s, after which nothing is left of what was between a clamp and a rope that it has just taken
STATION = 3.0  # m, of the track at both ends of it, which carriages do not ride
RAILS = 12.0  # m after that, over which its rails carry a part of those


@kernel
def clamp_coordinate(system, state, place, loop_length):
    """Present arc length (m) on a rope's mesh of a clamp that was at `place` (m) before any rope travel.

    On a loop, of a `loop_length` (m) other than 0, it is taken modulo that length.
    """
    way = place - state.loop_start[0] + state.rope.position[0]
    if loop_length > 0.0:
        way -= loop_length * floor(way / loop_length)
    return way / rest_stretch(system.cable, state)


@inlined_kernel
def clamp_gap(bundle, moving, clamp, system, state, like):
    """Gap (dim,) in m between a vehicle's clamp and its place on the rope that it holds."""
    rope, carriage = bundle.clamps.rope[clamp], bundle.clamps.carriage[clamp]
    track, here = record_at(bundle.records[rope, SYSTEM], system), record_at(bundle.records[rope, STATE], state)
    other = moving.clamp_rope[clamp]
    haul = record_at(bundle.records[other, SYSTEM], system).cable
    there = record_at(bundle.records[other, STATE], state)
    held = value(there.nodes.position, point_at(haul, there, moving.clamp_place[clamp]), like)
    at = add_scaled(1.0, load(bundle.clamps.offset[clamp], like), joint_position(track.cable, here, carriage))
    return subtract(subtract(held, at), load(moving.clamp_slack[clamp], like))


@kernel
def find_clamps(bundle, moving, system, state, h):
    """Find rope and arc length that each clamp holds after `h` (s); clamps beyond all meshes hold none, without force.

    A clamp that takes hold under way starts from its gap to the rope and the rate of that gap; both are then brought to
    zero smoothly, so that the clamp force begins and ends without a jump.
    """
    clamps, like = bundle.clamps, system.cable.gravity
    for clamp in range(clamps.rope.size):
        found, found_place = -1, 0.0
        for row in range(clamps.choice_offset[clamp], clamps.choice_offset[clamp + 1]):
            rope = clamps.choice[row]
            own = record_at(bundle.records[rope, SYSTEM], system)
            there = record_at(bundle.records[rope, STATE], state)
            place = clamp_coordinate(own, there, clamps.place[row], clamps.loop_length[clamp])
            if found < 0 and 0.0 < place < own.cable.unstrained_length:
                found, found_place = rope, place
        own = record_at(bundle.records[clamps.rope[clamp], SYSTEM], system)
        track, carriage = record_at(bundle.records[clamps.rope[clamp], STATE], state), clamps.carriage[clamp]
        if not rides(own, track, carriage):
            found = -1
        taken = found != moving.clamp_rope[clamp]
        moving.clamp_rope[clamp], moving.clamp_place[clamp] = found, found_place
        here = belongs(own, track, carriage)
        if here:
            track.clamp_holds[carriage] = found >= 0
        mass = 0.0
        if found >= 0 and clamps.loop_length[clamp] > 0.0:
            mass = rail_share(own.cable.unstrained_length, track.joints.position[carriage])
            mass *= carriage_mass(own.carriages, carriage)
        moving.rail_mass[clamp] = mass
        moving.clamp_time[clamp] += h
        if taken:
            if here:
                store(scale(-mass, like), track.clamp_force[carriage])
            clear_array(moving.clamp_slack[clamp])
            clear_array(moving.clamp_taken[clamp])
            moving.clamp_time[clamp] = 0.0
            if found >= 0 and h > 0.0:
                store(clamp_gap(bundle, moving, clamp, system, state, like), moving.clamp_taken[clamp, 0])
                store(gap_rate(bundle, moving, clamp, system, state, like), moving.clamp_taken[clamp, 1])
                if here:  # what the track rope bears stays as it is
                    accumulate(load(track.clamp_force[carriage], like), track.multipliers[first_body(own, carriage)])
        store(what_is_left(moving, clamp, like), moving.clamp_slack[clamp])


@inlined_kernel
def what_is_left(moving, clamp, like):
    """Remaining gap (dim,) in m of a closing clamp: fifth-order polynomial in time from initial gap and rate."""
    u = min(moving.clamp_time[clamp] / CLOSING_TIME, 1.0)
    cubed = u * u * u
    by_place = 1.0 + cubed * (-10.0 + u * (15.0 - 6.0 * u))
    by_rate = CLOSING_TIME * (u + cubed * (-6.0 + u * (8.0 - 3.0 * u)))
    first, rate = load(moving.clamp_taken[clamp, 0], like), load(moving.clamp_taken[clamp, 1], like)
    return add_scaled(by_rate, rate, scale(by_place, first))


@inlined_kernel
def gap_rate(bundle, moving, clamp, system, state, like):
    """Rate (dim,) in m/s of the gap between a vehicle's clamp and its rope, before closing."""
    rope, carriage, other = bundle.clamps.rope[clamp], bundle.clamps.carriage[clamp], moving.clamp_rope[clamp]
    track, here = record_at(bundle.records[rope, SYSTEM], system), record_at(bundle.records[rope, STATE], state)
    haul, there = record_at(bundle.records[other, SYSTEM], system), record_at(bundle.records[other, STATE], state)
    place = moving.clamp_place[clamp]
    held = point_at(haul.cable, there, place)
    speed, _ = transport_velocity(haul.cable, there, place)
    goes = add_scaled(speed, slope(there.nodes.position, held, like), value(there.nodes.velocity, held, like))
    return subtract(goes, joint_velocity(track.cable, here, carriage))


@inlined_kernel
def rail_share(length, place):
    """Share of a vehicle's weight on the station rails, at a `place` (m) of a track of a `length` (m)."""
    return share_on_rails(min(place, length - place) - STATION, RAILS)


@inlined_kernel
def first_body(system, carriage):
    """Number of the first body of a vehicle, at whose joint the multiplier λ is."""
    return system.carriages.body_offset[carriage]


@kernel
def follow_clamps(bundle, moving, system, state):
    """Update the arc lengths of all clamps after rope travel over bullwheels within the step."""
    clamps = bundle.clamps
    for clamp in range(clamps.rope.size):
        for row in range(clamps.choice_offset[clamp], clamps.choice_offset[clamp + 1]):
            rope = clamps.choice[row]
            if rope == moving.clamp_rope[clamp]:
                own = record_at(bundle.records[rope, SYSTEM], system)
                there = record_at(bundle.records[rope, STATE], state)
                place = clamp_coordinate(own, there, clamps.place[row], clamps.loop_length[clamp])
                moving.clamp_place[clamp] = place


@kernel
def add_clamps(bundle, moving, scratch, system, state, work, like):
    """Write matrix block and nodal couplings of each closed clamp, and add its force to the haul rope.

    Needs both ropes assembled, before their supports hold them: the row of the sliding coordinate is found there.
    """
    square = outer(0.0, like, like)
    one, zero = full(0.0, symmetric(0.0, 0.0, like), 1.0), scale(0.0, square)
    e_1 = one[0]
    for clamp in range(bundle.clamps.rope.size):
        other = moving.clamp_rope[clamp]
        if other < 0:
            scratch.clamp_node[clamp] = -1
            continue
        rope, carriage = bundle.clamps.rope[clamp], bundle.clamps.carriage[clamp]
        track, here = record_at(bundle.records[rope, SYSTEM], system), record_at(bundle.records[rope, STATE], state)
        own, beside = record_at(bundle.records[rope, WORK], work), record_at(bundle.records[other, WORK], work)
        haul, there = (
            record_at(bundle.records[other, SYSTEM], system).cable,
            record_at(bundle.records[other, STATE], state),
        )
        force = load(here.clamp_force[carriage], like)
        held = point_at(haul, there, moving.clamp_place[clamp])
        diagonal, right = scratch.clamp_diagonal[clamp], scratch.clamp_right[clamp]
        out, back = scratch.clamp_out[clamp], scratch.clamp_in[clamp]
        clear_array(out)
        clear_array(back)
        first = here.joint_element[carriage]
        last = first + 1
        if at_node(track.cable, here, carriage):
            last = first + 2  # both sides of the node that follows the joint
            add_clamp_at_node(own.patch[carriage], diagonal, right, out, back, like)
        else:
            # rows: S Δe + r_x Δn - S_h Δe_h = gap, and that of n, which F enters as minus λ
            joint, r_x = joint_point(track.cable, here, carriage), joint_tangent(track.cable, here, carriage)
            store(zero, diagonal[0, 0])
            store(outer(1.0, r_x, e_1), diagonal[0, 1])
            store(outer(-1.0, e_1, load(own.sliding_along[carriage], like)), diagonal[1, 0])
            store(add_scaled(own.sliding_pivot[carriage] - 1.0, outer(1.0, e_1, e_1), one), diagonal[1, 1])
            store(gap_to_close(bundle, moving, scratch, clamp, system, state, like), right[0])
            store(scale(own.sliding_right[carriage], e_1), right[1])
            for i in range(4):
                node, row = i // 2, i % 2
                store(scale(-joint.shape[i], one), out[node, row, 0])
                store(outer(1.0, load(own.sliding_column[carriage, i], like), e_1), out[node, row, 1])
                store(scale(joint.shape[i], one), back[node, 0, row])
                store(outer(1.0, e_1, load(own.sliding_row[carriage, i], like)), back[node, 1, row])
        scratch.clamp_node[clamp, 0] = bundle.order.first[rope] + first
        scratch.clamp_node[clamp, 1] = bundle.order.first[rope] + last
        for k in range(2):
            scratch.clamp_node[clamp, 2 + k] = bundle.order.first[other] + held.element + k

        # what the rails carry is in F too, as that of the other rope less what is not on it
        add_force(scale(-1.0, add_scaled(moving.rail_mass[clamp], like, force)), held, beside)
        for i in range(4):
            node, row = i // 2, i % 2
            store(scale(held.shape[i], one), out[2 + node, row, 0])
            store(scale(-held.shape[i], one), back[2 + node, 0, row])
        hold_coupling(track.cable, first, 0, out, back, like)
        hold_coupling(track.cable, last, 1, out, back, like)
        hold_coupling(haul, held.element, 2, out, back, like)
        hold_coupling(haul, held.element + 1, 3, out, back, like)


@inlined_kernel
def gap_to_close(bundle, moving, scratch, clamp, system, state, like):
    """Gap (dim,) in m of a clamp that a Newton iteration closes: the full gap, or as much as `closing` allows."""
    gap = clamp_gap(bundle, moving, clamp, system, state, like)
    size = sqrt(dot(gap, gap))
    return scale(min(1.0, scratch.closing[0] / size) if size > 0.0 else 1.0, gap)


@kernel
def add_clamp_gaps(bundle, moving, scratch, system, state, work):
    """Write gaps of clamps of vehicles at nodes to the equations of the nodes (patches), before condensation."""
    like = system.cable.gravity
    for clamp in range(bundle.clamps.rope.size):
        if moving.clamp_rope[clamp] >= 0:
            rope, carriage = bundle.clamps.rope[clamp], bundle.clamps.carriage[clamp]
            own, here, room = rope_of(bundle, rope, system, state, work)
            if at_node(own.cable, here, carriage):
                patch = room.patch[carriage]
                gap = gap_to_close(bundle, moving, scratch, clamp, system, state, like)
                add_column(gap, patch, clamp_row(len(like)), patch.shape[0])


@inlined_kernel
def add_clamp_at_node(patch, diagonal, right, out, back, like):
    """Write block and couplings of the clamp of a vehicle at a node, from the node's condensed equations (patch)."""
    dim, square = len(like), outer(0.0, like, like)
    one, force, last = full(0.0, symmetric(0.0, 0.0, like), 1.0), clamp_row(dim), patch.shape[0]
    clear_array(diagonal)
    store(one, diagonal[1, 1])
    store(read_matrix(patch, force, force, square), diagonal[0, 0])
    for axis in range(dim):
        right[0, axis], right[1, axis] = patch[force + axis, last], 0.0
    for node in range(2):
        for row in range(2):
            place = node * (5 * dim + 1) + row * dim
            store(read_matrix(patch, place, force, square), out[node, row, 0])
            store(read_matrix(patch, force, place, square), back[node, 0, row])


@inlined_kernel
def hold_coupling(cable, node, k, out, back, like):
    """Project a clamp's coupling `k` with a node onto the directions that a support at the node leaves free."""
    square = outer(0.0, like, like)
    for end in range(2):
        if node == (0 if end == 0 else cable.element_count):
            for i in range(2):
                free = load(cable.end_projector[end, i], square)
                for j in range(2):
                    store(product(free, load(out[k, i, j], square)), out[k, i, j])
                    store(product(load(back[k, j, i], square), free), back[k, j, i])


@kernel
def recover_clamps(bundle, moving, scratch, state, work, like):
    """Update the forces of all clamps, and store the sliding-coordinate increments that joints are recovered from."""
    for clamp in range(bundle.clamps.rope.size):
        if moving.clamp_rope[clamp] < 0:
            continue
        rope, carriage = bundle.clamps.rope[clamp], bundle.clamps.carriage[clamp]
        here, own = record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
        change = load(scratch.clamp_right[clamp, 0], like)
        accumulate(change, here.clamp_force[carriage])
        if own.patch.size > 0:
            for axis in range(len(like)):
                own.patch[carriage, clamp_row(len(like)) + axis, own.patch.shape[1]] = change[axis]
        own.sliding_pivot[carriage], own.sliding_right[carriage] = 1.0, scratch.clamp_right[clamp, 1, 0]
        clear_array(own.sliding_row[carriage])


@kernel
def worst_clamp_gap(bundle, moving, system, state, like):
    """Largest gap (m) of all closed clamps."""
    worst = 0.0
    for clamp in range(bundle.clamps.rope.size):
        if moving.clamp_rope[clamp] >= 0:
            gap = clamp_gap(bundle, moving, clamp, system, state, like)
            worst = max(worst, sqrt(dot(gap, gap)))
    return worst


@kernel
def ride_tracks(bundle, system, state):
    """End a step: detach vehicles at the end of their tracks, and attach vehicles that leave a station."""
    clamps, like = bundle.clamps, system.cable.gravity
    for clamp in range(clamps.rope.size):
        if clamps.loop_length[clamp] > 0.0:
            choice = clamps.choice_offset[clamp]
            strand, track = clamps.choice[choice], clamps.rope[clamp]
            ride_track(
                clamps,
                clamp,
                clamps.place[choice],
                load(clamps.offset[clamp], like),
                record_at(bundle.records[strand, SYSTEM], system),
                record_at(bundle.records[strand, STATE], state),
                record_at(bundle.records[track, SYSTEM], system),
                record_at(bundle.records[track, STATE], state),
            )


@kernel
def ride_track(clamps, clamp, place, offset, strand, strand_state, track, track_state):
    """Attach a vehicle to its track or detach it, by where its clamp is, `place` (m) of a strand.

    `offset` (dim,) in m is from the joint of the vehicle to its clamp.
    """
    carriage, loop_length = clamps.carriage[clamp], clamps.loop_length[clamp]
    s = clamp_coordinate(strand, strand_state, place, loop_length)
    length, ridden = strand.cable.unstrained_length, track.cable.unstrained_length
    attached = rides(track, track_state, carriage)
    if 0.0 < s < length:
        found = track_state.joints.position[carriage]
        if not attached:
            held = value(strand_state.nodes.position, point_at(strand.cable, strand_state, s), offset)
            found = nearest(track.cable, track_state, subtract(held, offset), ridden * s / length)
        if STATION < found < ridden - STATION:
            if not attached:
                speed, rate = speed_beside(strand.cable, strand_state, s, track.cable, track_state, found, offset)
                put_on(track, track_state, carriage, found, speed, rate)
                hung = track_state.multipliers[first_body(track, carriage)]
                store(scale(1.0 - rail_share(ridden, found), load(hung, offset)), hung)
            return
    beyond = s - length
    station = ridden if 2.0 * beyond < loop_length - length and 2.0 * s > length else 0.0
    if belongs(track, track_state, carriage) and (attached or track_state.joints.position[carriage] != station):
        hang_in_station(track, track_state, carriage, station)


@kernel
def speed_beside(strand, strand_state, s, track, track_state, place, like):
    """Speed (m/s), and its rate, along a track at arc length `place` (m) of the strand point at `s` (m) beside it."""
    own, beside = point_at(strand, strand_state, s), point_at(track, track_state, place)
    speed, rate = transport_velocity(strand, strand_state, s)
    r_x, along = slope(strand_state.nodes.position, own, like), slope(track_state.nodes.position, beside, like)
    moving = subtract(value(strand_state.nodes.velocity, own, like), value(track_state.nodes.velocity, beside, like))
    squared = dot(along, along)
    return dot(add_scaled(speed, r_x, moving), along) / squared, rate * dot(r_x, along) / squared
