"""Carriages that ride a loop of one rope, clamped to it, and slide on another rope where that goes along it.

Where the loop leaves the track, in the stations, a carriage hangs at rest and takes no part, as what is clamped to a
moving rope alone does; it is put on again where the loop comes to the track.
"""

from __future__ import annotations

from cable_twin.mechanics.drives.moving_rope import hang_in_station, put_on
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.tower import nearest
from cable_twin.mechanics.rope.point import position_on_cable
from cable_twin.mechanics.rope.strand import going_by
from cable_twin.mechanics.solution.bundle.clamp import clamp_coordinate
from cable_twin.mechanics.solution.bundle.records import STATE, SYSTEM

STATION = 3.0  # m, of the track at both ends of it, which carriages do not ride


@kernel
def ride_tracks(bundle, system, state):
    """End a step: take off their tracks what has come to an end of those, and put on what comes from a station."""
    clamps = bundle.clamps
    for clamp in range(clamps.rope.size):
        if clamps.loop_length[clamp] > 0.0:
            choice = clamps.choice_offset[clamp]
            strand, track = clamps.choice[choice], clamps.rope[clamp]
            ride_track(
                clamps,
                clamp,
                clamps.place[choice],
                record_at(bundle.records[strand, SYSTEM], system),
                record_at(bundle.records[strand, STATE], state),
                record_at(bundle.records[track, SYSTEM], system),
                record_at(bundle.records[track, STATE], state),
            )


@kernel
def ride_track(clamps, clamp, place, strand, strand_state, track, track_state):
    """The same of one carriage, clamped at `place` (m) of a strand."""
    carriage, loop_length = clamps.carriage[clamp], clamps.loop_length[clamp]
    s = clamp_coordinate(strand, strand_state, place, loop_length)
    length, ridden = strand.cable.unstrained_length, track.cable.unstrained_length
    attached = track_state.attached[carriage]
    if 0.0 < s < length:
        found = track_state.joints.position[carriage]
        if not attached:
            point = position_on_cable(strand.cable, strand_state, s)
            found = nearest(track.cable, track_state.nodes.position, point, ridden * s / length)
        if STATION < found < ridden - STATION:
            if not attached:
                speed, rate = going_by(strand.cable, strand_state, s)
                put_on(track, track_state, carriage, found, speed, rate)
            return
    beyond = s - length
    station = ridden if 2.0 * beyond < loop_length - length and 2.0 * s > length else 0.0
    if attached or track_state.joints.position[carriage] != station:
        hang_in_station(track, track_state, carriage, station)
