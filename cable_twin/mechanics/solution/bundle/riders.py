"""Carriages clamped to a loop of haul rope and sliding on a track rope beside it, between stations.

Where the loop leaves the track, in the stations, a carriage hangs at rest and takes no part, as what is clamped to a
moving rope alone does; it is put on again where the loop comes to the track. Beside both ends of the track are the
rails of the stations: there they carry a part of its weight, all of it where it comes on, so that both ropes take it
over as smoothly as on rails that sink away from under the wheels. They push upwards, and do work as such rails would.
"""

from __future__ import annotations

from cable_twin.mechanics.drives.stations import hang_in_station, put_on
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, subtract
from cable_twin.mechanics.on_rope.tower import nearest
from cable_twin.mechanics.rope.point import point_at, slope, value
from cable_twin.mechanics.rope.strand import going_by
from cable_twin.mechanics.solution.bundle.clamp import STATION, clamp_coordinate
from cable_twin.mechanics.solution.bundle.records import STATE, SYSTEM


@kernel
def ride_tracks(bundle, system, state):
    """End a step: detach carriages at the end of their tracks, and attach carriages leaving a station."""
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
    """Detach or attach one carriage, clamped at `place` (m) of a strand with an `offset` (dim,) in m from its joint."""
    carriage, loop_length = clamps.carriage[clamp], clamps.loop_length[clamp]
    s = clamp_coordinate(strand, strand_state, place, loop_length)
    length, ridden = strand.cable.unstrained_length, track.cable.unstrained_length
    attached = track_state.attached[carriage]
    if 0.0 < s < length:
        found = track_state.joints.position[carriage]
        if not attached:
            held = value(strand_state.nodes.position, point_at(strand.cable, s), offset)
            found = nearest(track.cable, track_state.nodes.position, subtract(held, offset), ridden * s / length)
        if STATION < found < ridden - STATION:
            if not attached:
                speed, rate = speed_beside(strand.cable, strand_state, s, track.cable, track_state, found, offset)
                put_on(track, track_state, carriage, found, speed, rate)
            return
    beyond = s - length
    station = ridden if 2.0 * beyond < loop_length - length and 2.0 * s > length else 0.0
    if attached or track_state.joints.position[carriage] != station:
        hang_in_station(track, track_state, carriage, station)


@kernel
def speed_beside(strand, strand_state, s, track, track_state, place, like):
    """Speed (m/s) and its rate along a track at an arc length, beside a moving point `s` (m) of a strand."""
    own, beside = point_at(strand, s), point_at(track, place)
    speed, rate = going_by(strand, strand_state, s)
    r_x, along = slope(strand_state.nodes.position, own, like), slope(track_state.nodes.position, beside, like)
    moving = subtract(value(strand_state.nodes.velocity, own, like), value(track_state.nodes.velocity, beside, like))
    squared = dot(along, along)
    return dot(add_scaled(speed, r_x, moving), along) / squared, rate * dot(r_x, along) / squared
