"""Kernel of a thread that takes members of an ensemble one after another and advances each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.by_reference import by_reference
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.entries import call_integrator, call_reader, take_number
from cable_twin.mechanics.language.memory import copy_array
from cable_twin.mechanics.on_rope.buffer import CLOSEST
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.solution.bundle.bullwheels import wheels_gone_back
from cable_twin.mechanics.solution.bundle.records import SYSTEM

BoolArray = NDArray[np.bool_]
NEXT, STOP = 0, 1  # entries of a queue: place in the order of members, and whether to end
STEPS, ITERATIONS, HALVINGS, ELEMENT, STATUS, ASKING = range(6)  # columns of `Members.counts`
GAP, INCREMENT, LOST, MOVED = range(4)  # columns of `Members.sums`
NONE_LEFT, ANOTHER = -2, -1  # in place of a member: the queue is empty, or is to be asked again
NOBODY, LEFT, CAME = range(3)  # which changes vehicles have made between ropes and stations
GOING, FAILED, PRESSED = range(3)  # STATUS: of a member whose step failed, or whose vehicles are within each other


@by_reference
class Members(NamedTuple):
    """States of all members of an ensemble, with the clock and solver outcome of each, for kernels."""

    states: NDArray[np.uint8]  # (members, bytes) of all ropes and vehicles
    motions: NDArray[np.uint8]  # (members, bytes) of couplings
    systems: IntArray  # (members, ropes) addresses of parameters
    left: IntArray  # (members,) steps to be taken
    stopped: BoolArray  # (members,) an emergency stop is in force
    loading: BoolArray  # (members,) vehicles are being loaded
    stations: FloatArray  # (members, vehicles) m, place of the station of each at the last look, NaN on the rope
    ropes: IntArray  # (members, vehicles) rope of each then
    counts: IntArray  # (members, 6) of the steps so far; ASKING: 1 where Python has to see to it
    sums: FloatArray  # (members, 4) likewise


@by_reference
class Looks(NamedTuple):
    """Settings of the checks between calls of the integrator: vehicle pairs that can meet, payloads, step counts."""

    before: IntArray  # (pairs,) vehicle that can meet another one
    after: IntArray  # (pairs,) the one after it on its rope
    exchanges: bool  # payloads change in stations
    period: int  # steps from one look to the next
    most: int  # steps of a call of the integrator


@kernel
def advance_members(
    code, queue, order, first, budget, members, looks, bundles, like, moving, good, before, scratch, system, state, work
):
    """Advance members from a queue until it is empty or stopped, or an event of a member must be handled in Python.

    Args:
        code: address of the integrator.
        queue: (2,) place in the order, shared by all threads, and 1 to end.
        order: (n,) members to be advanced.
        first: member to begin with, negative for the next of the queue.
        budget: steps after which to return.
        members: all members.
        looks: occasions on which steps are interrupted.
        bundles: (members,) addresses of the couplings of each, for the memory of this thread.
        like: couplings of any member, for their type.
        moving: motion of the couplings, in the memory of this thread, as all that follows.
        good: scratch for a copy of `moving`.
        before: the same.
        scratch: of the solver for couplings.
        system: parameters of any of the ropes, for their type.
        state: motion of any, likewise.
        work: scratch of any, likewise.

    Returns:
        The member to begin with next, which may be asking for Python; `NONE_LEFT`, or `ANOTHER` after the budget.
    """
    # parameters of their own: numba finds the types of a tuple of records in Python, at each call
    arguments = like, moving, good, before, scratch, system, state, work
    member = first
    while queue[STOP] == 0:
        if member < 0:
            place = take_number(queue, NEXT)
            if place >= order.size:
                return NONE_LEFT
            member = order[place]
        left = members.left[member]
        if advance_member(code, queue, member, budget, members, looks, bundles, arguments):
            return member
        budget -= left - members.left[member]
        if budget <= 0:
            return ANOTHER if members.left[member] == 0 or members.counts[member, STATUS] != GOING else member
        member = ANOTHER
    return NONE_LEFT


@kernel
def advance_member(code, queue, member, budget, members, looks, bundles, arguments):
    """Advance a member by about `budget` steps; returns whether Python must handle an event before the next step."""
    like, moving, good, before, scratch, any_system, state, work = arguments
    bundle, system = record_at(bundles[member], like), record_at(members.systems[member, 0], any_system)
    copy_array(members.states[member], state.memory)
    copy_array(members.motions[member], moving.memory)
    for rope in range(bundle.records.shape[0]):
        bundle.records[rope, SYSTEM] = members.systems[member, rope]
    watched = looks.before.size > 0 or members.loading[member]
    attention, going = False, True
    while going and members.left[member] > 0 and budget > 0 and queue[STOP] == 0:
        if are_pressed(looks, state):
            members.counts[member, STATUS] = PRESSED
            break
        steps = min(members.left[member], looks.most)
        if watched or (looks.exchanges and changed_places(members, member, state) != NOBODY):
            steps = min(steps, looks.period - state.clock[0] % looks.period)
        outcome = call_integrator(code, (bundle, moving, good, before, scratch, system, state, work, steps))
        going, taken = take_outcome(members, member, outcome)
        budget -= taken
        attention = wheels_gone_back(moving.sheaves) > 0 and not members.stopped[member]
        if going and state.clock[0] % looks.period == 0:
            attention = attention or members.loading[member]
            if looks.exchanges and not attention:
                changed = changed_places(members, member, state)
                attention = changed == CAME
                if changed == LEFT:
                    note_stations(members, member, state)
        going = going and not attention
    copy_array(state.memory, members.states[member])
    copy_array(moving.memory, members.motions[member])
    members.counts[member, ASKING] = 1 if attention else 0
    return attention


@inlined_kernel
def take_outcome(members, member, outcome):
    """Add the outcome of an integrator call to the counts of a member; returns whether it converged, and its steps."""
    converged, steps, iterations, halvings, gap, increment, element, lost, moved = outcome
    counts, sums = members.counts, members.sums
    counts[member, STEPS] += steps
    counts[member, ITERATIONS] += iterations
    counts[member, HALVINGS] += halvings
    counts[member, ELEMENT] = element
    sums[member, GAP] = max(sums[member, GAP], gap)
    sums[member, INCREMENT] = increment
    sums[member, LOST] += lost
    sums[member, MOVED] += moved
    members.left[member] -= steps
    if not converged:
        counts[member, STATUS] = FAILED
    return converged, steps


@kernel
def are_pressed(looks, state):
    """Return whether any two vehicles that can meet have passed through each other."""
    for pair in range(looks.before.size):
        if state.joints.position[looks.after[pair]] - state.joints.position[looks.before[pair]] < CLOSEST:
            return True
    return False


@kernel
def changed_places(members, member, state):
    """Change of rope or station of any vehicle since the last record: `CAME` to one, `LEFT` a station, or `NOBODY`.

    The integrator ends its call at the step of each change.
    """
    found = NOBODY
    for vehicle in range(state.attached.size):
        before = members.stations[member, vehicle]
        if state.vehicle_rope[vehicle] != members.ropes[member, vehicle]:
            return CAME
        if state.attached[vehicle]:
            found = max(found, NOBODY if np.isnan(before) else LEFT)
        elif state.joints.position[vehicle] != before:
            return CAME
    return found


@kernel
def note_stations(members, member, state):
    """Record the present rope and station of each vehicle of a member."""
    for vehicle in range(state.attached.size):
        on_rope = state.attached[vehicle]
        members.stations[member, vehicle] = np.nan if on_rope else state.joints.position[vehicle]
        members.ropes[member, vehicle] = state.vehicle_rope[vehicle]


@kernel
def observe_members(code, members, system, state, sections, places, rests, lateral, columns, numbers, rows):
    """Compute the snapshot values of all members of an ensemble with one rope.

    Args:
        code: address of `columns.observe`.
        members: all members.
        system: of any of them, for its type.
        state: memory of one member, which is overwritten.
        sections: scratch of one member.
        places: of the samples on the rope.
        rests: (members, towers, 2) N, tower loads at rest of each.
        lateral: position (m) of the rope beside the track, for pictures.
        columns: of a frame, in `numbers`.
        numbers: (n,) of one frame, which are overwritten.
        rows: (members, n) for the numbers of each.
    """
    for member in range(rows.shape[0]):
        copy_array(members.states[member], state.memory)
        own = record_at(members.systems[member, 0], system)
        call_reader(code, (own, state, sections, places, rests[member], lateral, columns))
        copy_array(numbers, rows[member])
