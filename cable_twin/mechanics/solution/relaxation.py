"""Relaxation to static equilibrium, interruptible in parts and with reports of its progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf, isfinite, log
from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.language.compilation import brief_kernel, kernel
from cable_twin.mechanics.language.memory import combine_arrays
from cable_twin.mechanics.language.rotations import move_body
from cable_twin.mechanics.language.vectors import scale
from cable_twin.mechanics.on_rope.chain import hang_chain, move_chain
from cable_twin.mechanics.on_rope.load_node import follow_joints, follow_moved_joints, update_load_nodes
from cable_twin.mechanics.on_rope.presence import belongs
from cable_twin.mechanics.on_rope.sliding_joint import driven_force, joint_point, place_joint
from cable_twin.mechanics.on_rope.tower import begin_extremes, settle_towers
from cable_twin.mechanics.on_rope.wind import update_wind
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.rope.ale import rope_before
from cable_twin.mechanics.rope.point import slope, value
from cable_twin.mechanics.solution.bundle.clamp import find_clamps, worst_clamp_gap
from cable_twin.mechanics.solution.bundle.records import (
    GOOD,
    LONGEST_GAP,
    STATE,
    copy_motion,
    copy_ropes,
    rope_of,
    take_motion,
)
from cable_twin.mechanics.solution.newton import solve_increments

MAX_RELAXATIONS = 5000
STALLED = 1000  # iterations without progress, after which there will be none: those that found a rest took 10 to 500
FACTOR, LEAST_FACTOR, LEAST_INCREMENT, IDLE, PATIENCE = range(5)  # of the course of a relaxation, see `relax`
LAST = 1e-12  # of the first mass factor: from there on iterations are Newton's
CLOSED = 1e-6  # m, gap of a clamp
SHARPEST = 0.5  # rad, that a body turns in an iteration
PART = 50_000  # iterations times elements of a part, which takes some tenths of a second at most


@kernel
def hang_carriages(system, state):
    """Place all bodies of a rope's vehicles upright below their joints."""
    carriages = system.carriages
    for carriage in range(carriages.fixed.size):
        if not belongs(system, state, carriage):
            continue
        place_joint(system.cable, state, carriage)
        point = joint_point(system.cable, state, carriage)
        place = value(state.nodes.position, point, system.cable.gravity)
        hang_chain(carriages, state, carriage, place, slope(state.nodes.position, point, system.cable.gravity))
        if not state.attached[carriage]:
            still = scale(0.0, place)
            move_chain(carriages, system.cable.gravity, state, carriage, still, still)


@kernel
def store_equilibrium(system, state, work):
    """Store a rope's equilibrium: holding force of each joint, origins of friction, extremes of tower loads."""
    for carriage in range(state.axis.size):
        if belongs(system, state, carriage):
            state.drives.force[carriage] = driven_force(system, state, carriage)
    for contact in range(state.contact_origin.size):
        state.contact_origin[contact] = rope_before(system.cable, state, state.contact_arc_length[contact])
    settle_towers(system.cable, system.towers, state, work)
    begin_extremes(system.cable, system.towers, state)


@kernel
def begin_relaxation(system, state):
    """Prepare one rope for an iteration of relaxation: update its wind."""
    if system.air.varies:
        update_wind(system, state, 0.0)


@kernel
def move_relaxed(system, state, work):
    """Apply the increments of one rope to positions alone; return the largest rotation of a body (rad)."""
    turn = sharpest_turn(work, system.cable.gravity)
    combine_arrays(state.nodes.position, 1.0, work.right_side, state.nodes.position)
    combine_arrays(state.joints.position, 1.0, work.sliding_increment, state.joints.position)
    for vehicle in range(state.vehicle_rope.size):
        if belongs(system, state, vehicle):
            for body in range(system.carriages.body_offset[vehicle], system.carriages.body_offset[vehicle + 1]):
                move_body(state.bodies.position[body], work.body_increment[body], system.cable.gravity)
    return turn


@kernel
def sharpest_turn(work, like):
    """Largest rotation (rad) among the Newton increments of bodies."""
    turn = 0.0
    for body in range(work.body_increment.shape[0]):
        for axis in range(len(like), work.body_increment.shape[1]):
            turn = max(turn, abs(work.body_increment[body, axis]))
    return turn


@brief_kernel
def relax(bundle, moving, good, scratch, system, state, work, tolerance, first, longest, course, iterations):
    """Pseudo-transient continuation to equilibrium: implicit steps without velocity, growing into Newton steps.

    A rope by itself begins with what is on it hanging upright, all its joints held, and ends with their drive forces
    in `drive_force`. Several ropes go on from where each of them lies.

    It makes progress where the mass factor falls below its least so far, and once it cannot fall farther, where the
    increment is half the least so far, or within the tolerance while contacts change or clamps close.

    Args:
        bundle: ropes and their couplings.
        moving: motion of the couplings.
        good: scratch for a copy of `moving`.
        scratch: of the solver for couplings.
        system: parameters of any of the ropes, for their type.
        state: motion of any, likewise.
        work: scratch of any, likewise.
        tolerance: last increment (m) that is allowed.
        first: mass factor (1/s²) to begin with.
        longest: displacement (m) that a point may make in an iteration.
        course: (5,) mass factor (1/s²) with which to go on, 0 to begin and at rest; the least one so far; the least
            increment (m) with the smallest mass factor; number of iterations since the last progress; after how many
            it gives up.
        iterations: most of them.

    Returns:
        Number of iterations used, and the last increment (m).
    """
    ropes, like = bundle.records.shape[0], system.cable.gravity
    begun = course[FACTOR] > 0.0
    mass_factor = course[FACTOR] if begun else first
    for rope in range(ropes):
        own, here, _ = rope_of(bundle, rope, system, state, work)
        moved = own.cable.load_nodes and follow_moved_joints(own, here)
        if moved or (ropes == 1 and not begun):
            hang_carriages(own, here)
    smallest, increment = LAST * first, 0.0
    for iteration in range(iterations):
        if bundle.coupled:
            find_clamps(bundle, moving, system, state, 0.0)  # what rails carry depends on where a rider stands
            copy_motion(moving, good)
        copy_ropes(bundle, STATE, GOOD, state)
        for rope in range(ropes):
            own, here, _ = rope_of(bundle, rope, system, state, work)
            begin_relaxation(own, here)
        solvable, increment, changed = solve_increments(
            bundle, moving, scratch, system, state, work, mass_factor, 0.0, 1.0
        )
        note_course(course, mass_factor, smallest, increment, tolerance)
        turn = 0.0
        if solvable and isfinite(increment) and increment <= 3.0 * longest:
            for rope in range(ropes):
                own, here, room = rope_of(bundle, rope, system, state, work)
                turn = max(turn, move_relaxed(own, here, room))
                if bundle.coupled and own.cable.load_nodes:  # joints that clamps hold are free to go
                    follow_joints(here)
                    update_load_nodes(own, here)
        else:
            turn = inf
        if turn > SHARPEST:
            copy_ropes(bundle, GOOD, STATE, state)
            mass_factor *= 8.0
            if bundle.coupled:
                take_motion(good, moving)
                scratch.closing[0] *= 0.5
            continue
        closed = True
        if bundle.coupled:
            combine_arrays(moving.stages.position, 1.0, scratch.increment, moving.stages.position)
            closed = worst_clamp_gap(bundle, moving, system, state, like) < CLOSED
        if increment < tolerance and mass_factor <= smallest and changed == 0 and closed:
            if ropes == 1:
                own, here, room = rope_of(bundle, 0, system, state, work)
                store_equilibrium(own, here, room)
            course[FACTOR] = 0.0
            return iteration + 1, increment
        if increment < longest:
            mass_factor = max(0.25 * mass_factor, smallest)
            if bundle.coupled:
                scratch.closing[0] = min(1.5 * scratch.closing[0], LONGEST_GAP)
        if course[IDLE] >= course[PATIENCE]:
            iterations = iteration + 1
            break
    course[FACTOR] = mass_factor
    return iterations, increment


@kernel
def note_course(course, mass_factor, smallest, increment, tolerance):
    """Note in the `course` of a relaxation (see `relax`) whether an iteration makes progress."""
    newton = mass_factor <= smallest
    if mass_factor < course[LEAST_FACTOR] or (newton and increment < max(0.5 * course[LEAST_INCREMENT], tolerance)):
        course[LEAST_FACTOR] = min(mass_factor, course[LEAST_FACTOR])
        course[LEAST_INCREMENT] = increment if newton else inf
        course[IDLE] = 0.0
    else:
        course[IDLE] += 1.0


class Moment(NamedTuple):
    """Progress of a relaxation to equilibrium at one moment."""

    elements: int
    iterations: int
    share: float  # 0 to 1, of what the masses have to lose
    elapsed: float  # s

    @property
    def remaining(self) -> float:
        """Upper bound of the remaining time (s) at the present rate; most relaxations take a tenth of it or less."""
        return self.elapsed / self.iterations * (MAX_RELAXATIONS - self.iterations)


_watchers: list[Callable[[Moment], object]] = []


@contextmanager
def watching_relaxation(shown: Callable[[Moment], object]) -> Iterator[None]:
    """Context manager that reports the progress of relaxations to `shown` after each part."""
    _watchers.append(shown)
    try:
        yield
    finally:
        _watchers.remove(shown)


class Relaxed(NamedTuple):
    """End of a relaxation: whether all forces balance, the number of iterations, and the last increment (m)."""

    at_rest: bool
    iterations: int
    increment: float


def relax_in_parts(
    relax: Callable[[FloatArray, int], tuple[int, float]], elements: int, begin: float = 0.0, patience: int = STALLED
) -> Relaxed:
    """Run a relaxation in parts until all forces balance, it makes no more progress, or it has taken too long.

    Args:
        relax: takes the course of the relaxation and a number of iterations; returns how many it used, and the last
            increment (m); see the kernel.
        elements: of the mesh.
        begin: mass factor of the first part.
        patience: number of iterations without progress after which it gives up.
    """
    begun, used, first, increment = time.monotonic(), 0, begin, 0.0
    part = max(PART // elements, 1)
    course = np.array([begin, inf, inf, 0.0, patience])
    while used < MAX_RELAXATIONS and course[IDLE] < patience:
        taken, increment = relax(course, min(part, MAX_RELAXATIONS - used))
        used += taken
        factor = float(course[FACTOR])
        if factor == 0.0:
            return Relaxed(True, used, increment)
        first = max(first, factor)
        moment = Moment(elements, used, min(log(first / factor) / -log(LAST), 1.0), time.monotonic() - begun)
        for shown in _watchers:
            shown(moment)
    return Relaxed(False, used, increment)


__all__ = [
    "LAST",
    "STALLED",
    "Moment",
    "Relaxed",
    "hang_carriages",
    "relax",
    "relax_in_parts",
    "store_equilibrium",
    "watching_relaxation",
]
