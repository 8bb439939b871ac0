"""The real-time integrator: generalized-alpha on the index-3 equations (Arnold, Brüls 2007), full Newton.

One step solves M q_ddot + Φ_qᵀ λ = Q and Φ = 0 at its end, with the updates of Newmark on the auxiliary acceleration a:
(1 - α_m) a' + α_m a = (1 - α_f) q_ddot' + α_f q_ddot.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import NamedTuple

from cable_twin.mechanics.drives.haul_rope import correct_sheaves, predict_sheaves, sheave_force
from cable_twin.mechanics.drives.moving_rope import attach_carriers, move_rope
from cable_twin.mechanics.drives.reference import advance_reference, follows_reference, force_limit
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel, kernel_part
from cable_twin.mechanics.language.memory import flat
from cable_twin.mechanics.on_rope.sliding_joint import driven_force, settle_friction
from cable_twin.mechanics.on_rope.tower import settle_supports
from cable_twin.mechanics.parameters import FORCE, HAULED, SPEED
from cable_twin.mechanics.solution.equations_of_motion import assemble, measure_gaps, solve
from cable_twin.mechanics.state import copy_state

REFRESH = 1.1  # growth of the remembered curvature in a step, so that it is measured again now and then
LEAST_CURVATURE = 1e-3  # 1/m, where rounding leaves nothing to measure


class Outcome(NamedTuple):
    """What came of a call: read `converged` before anything else.

    An integrator gives the fields alone: numba makes a named tuple by Python code of its own, which a Ctrl-C crashes.
    """

    converged: bool
    steps: int  # whole steps taken
    iterations: int  # Newton iterations in all
    halvings: int  # failed tries that were repeated with half the step
    gap: float  # m, largest gap of a joint at the end of a step
    increment: float  # m, largest of the last Newton iteration
    element: int  # where that was


class Coefficients(NamedTuple):
    """Generalized-alpha for one spectral radius (Chung, Hulbert 1993)."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float


@kernel
def coefficients(spectral_radius):
    """The coefficients that damp infinite frequency by `spectral_radius` a step, and low ones least."""
    alpha_m = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
    alpha_f = spectral_radius / (spectral_radius + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return Coefficients(alpha_m, alpha_f, 0.25 * (0.5 + gamma) * (0.5 + gamma), gamma)


@kernel
def predict(c, h, coordinates, velocities, accelerations, algorithmic):
    """Start of the iteration for one set of coordinates: the acceleration of the step before goes on."""
    x, v, q_ddot, a = flat(coordinates), flat(velocities), flat(accelerations), flat(algorithmic)
    for i in range(x.size):
        after = (q_ddot[i] - c.alpha_m * a[i]) / (1.0 - c.alpha_m)
        x[i] += h * (v[i] + h * ((0.5 - c.beta) * a[i] + c.beta * after))
        v[i] += h * ((1.0 - c.gamma) * a[i] + c.gamma * after)
        a[i] = after


@kernel
def correct(c, h, increments, coordinates, velocities, accelerations, algorithmic):
    """Apply Newton increments (m, rad) to one set of coordinates."""
    x, v, q_ddot, a = flat(coordinates), flat(velocities), flat(accelerations), flat(algorithmic)
    delta = flat(increments)
    by_velocity = c.gamma / (c.beta * h)
    by_algorithmic = 1.0 / (c.beta * h * h)
    by_acceleration = by_algorithmic * (1.0 - c.alpha_m) / (1.0 - c.alpha_f)
    for i in range(x.size):
        x[i] += delta[i]
        v[i] += by_velocity * delta[i]
        a[i] += by_algorithmic * delta[i]
        q_ddot[i] += by_acceleration * delta[i]


@kernel
def largest_increment(system, work):
    """Size (m) of the last Newton increment: positions, slopes times element length, arc lengths; nan if one is."""
    length = system.cable.element_length
    worst, total = 0.0, 0.0
    for node in range(work.right_side.shape[0]):
        for i in range(work.right_side.shape[2]):
            r, slope = work.right_side[node, 0, i], length * work.right_side[node, 1, i]
            worst = max(worst, abs(r), abs(slope))
            total += r + slope
    for body in range(work.body_increment.shape[0]):
        x, z = work.body_increment[body, 0], work.body_increment[body, 1]
        worst = max(worst, abs(x), abs(z))
        total += x + z + work.body_increment[body, 2]
    for carriage in range(work.sliding_increment.size):
        worst = max(worst, abs(work.sliding_increment[carriage]))
        worst = max(worst, abs(work.sheave_increment[carriage]))
        total += work.sliding_increment[carriage] + work.sheave_increment[carriage]
    return worst if isfinite(total) else total - total


@kernel
def worst_element(work):
    """Element at whose first node the last Newton increment was largest, or not a number."""
    worst, place = -1.0, 0
    for node in range(work.right_side.shape[0]):
        for i in range(work.right_side.shape[2]):
            size = abs(work.right_side[node, 0, i])
            if not size <= worst:
                worst, place = size, node
            if not isfinite(size):
                return min(node, work.right_side.shape[0] - 2)
    return min(place, work.right_side.shape[0] - 2)


@kernel_part
def step(system, state, h, work):
    """One step of length `h` (s), in place. Returns (converged, iterations, last increment in m, gap in m).

    An increment of size d leaves an error of C d² (Newton), so that one iteration is enough where d is small. C is
    measured whenever there is a second iteration, and remembered from step to step.
    """
    solver = system.solver
    c = coefficients(solver.spectral_radius)
    if system.moving_cable.moving:
        move_rope(system, state, h)
    for carriage in range(system.carriages.fixed.size):
        if state.drive_braking[carriage]:
            state.braking_time[carriage] += h
        if follows_reference(state.drive_mode, state.sheave_mode, carriage) and not system.carriages.clamped[carriage]:
            advance_reference(system.carriages, system.cable, state, carriage, h)
        if state.drive_mode[carriage] == SPEED:
            state.sliding_velocity[carriage] = state.reference[carriage, 1]
            state.sliding_acceleration[carriage] = state.reference[carriage, 2]

    predict(c, h, state.nodal_coordinates, state.nodal_velocities, state.nodal_accelerations, state.nodal_algorithmic)
    predict(c, h, state.body_coordinates, state.body_velocities, state.body_accelerations, state.body_algorithmic)
    predict_sliding(state, h)
    if system.haul_ropes.present:
        predict_sheaves(state, c, h)
    mass_factor = (1.0 - c.alpha_m) / ((1.0 - c.alpha_f) * c.beta * h * h)
    rate_factor = c.gamma / (c.beta * h)

    increment, before = 0.0, 0.0
    curvature = REFRESH * state.newton_curvature[0] if state.newton_curvature[0] > 0.0 else inf
    for iteration in range(1, solver.max_iterations + 1):
        measure_gaps(system, state, work, True)
        assemble(system, state, mass_factor, rate_factor, 1.0, work)
        if not solve(system, state, work):
            return False, iteration, increment, 0.0
        increment = largest_increment(system, work)
        if not isfinite(increment):
            return False, iteration, increment, 0.0
        correct(
            c,
            h,
            work.right_side,
            state.nodal_coordinates,
            state.nodal_velocities,
            state.nodal_accelerations,
            state.nodal_algorithmic,
        )
        correct(
            c,
            h,
            work.body_increment,
            state.body_coordinates,
            state.body_velocities,
            state.body_accelerations,
            state.body_algorithmic,
        )
        correct_sliding(state, rate_factor, 1.0 / (c.beta * h * h), work)
        if system.haul_ropes.present:
            correct_sheaves(state, c, h, work)
        if iteration == 2 and before > 0.0:
            curvature = max(increment / (before * before), LEAST_CURVATURE)
        before = increment
        if curvature * increment * increment < solver.tolerance or increment == 0.0:
            state.newton_curvature[0] = curvature
            gap = measure_gaps(system, state, work, True)
            for carriage in range(system.carriages.fixed.size):
                settle_friction(system.carriages, state, carriage)
            settle_supports(system.cable, system.supports, state)
            if system.moving_cable.moving:
                attach_carriers(system, state)
            return isfinite(gap), iteration, increment, gap
    return False, solver.max_iterations, increment, 0.0


@inlined_kernel
def predict_sliding(state, h):
    """Start of the iteration for the sliding coordinates, which have no inertia: at constant acceleration."""
    for carriage in range(state.sliding_coordinate.size):
        if state.drive_mode[carriage] != SPEED:
            a = state.sliding_acceleration[carriage]
            state.sliding_coordinate[carriage] += h * (state.sliding_velocity[carriage] + 0.5 * h * a)
            state.sliding_velocity[carriage] += h * a
        else:
            state.sliding_coordinate[carriage] = state.reference[carriage, 0]


@inlined_kernel
def correct_sliding(state, rate_factor, acceleration_factor, work):
    """Apply Newton increments (m) to the sliding coordinates."""
    for carriage in range(state.sliding_coordinate.size):
        delta = work.sliding_increment[carriage]
        state.sliding_coordinate[carriage] += delta
        if state.drive_mode[carriage] != SPEED:
            state.sliding_velocity[carriage] += rate_factor * delta
            state.sliding_acceleration[carriage] += acceleration_factor * delta


@kernel
def drive_force(system, state, carriage):
    """Force (N) of a drive that follows its reference, on its joint or on the sheave of its haul rope."""
    if state.drive_mode[carriage] == HAULED:
        return sheave_force(system, state, carriage)
    return driven_force(system, state, carriage)


@kernel
def set_drive_mode(state, carriage, mode):
    """Put a drive into FREE, FORCE or SPEED, be it on the joint itself or on the sheave of a haul rope."""
    if state.drive_mode[carriage] == HAULED:
        state.sheave_mode[carriage] = mode
    else:
        state.drive_mode[carriage] = mode


@kernel
def take_over(state, carriage):
    """Let the reference go on from the place (m) and speed (m/s) of the joint or sheave that is to follow it."""
    reference = state.reference[carriage]
    if state.drive_mode[carriage] == HAULED:
        reference[0], reference[1] = state.sheave[carriage, 0], state.sheave[carriage, 1]
    else:
        reference[0], reference[1] = state.sliding_coordinate[carriage], state.sliding_velocity[carriage]
    reference[2] = 0.0


@kernel_part
def limited_step(system, state, before, h, work):
    """One step in which no drive, and no brake on it, takes more than its force limit.

    One that would is repeated at its limit and goes on from the speed that it reached. `before` is the state at the
    start of the step, whose speed counts for the power limit.
    """
    iterations = 0
    for attempt in range(2):
        converged, used, increment, gap = step(system, state, h, work)
        iterations += used
        if attempt == 1 or not converged or not find_saturated(system, state, before, work):
            break
        copy_state(before, state)
        for carriage in range(system.carriages.fixed.size):
            if work.saturation[carriage] != 0.0:
                set_drive_mode(state, carriage, FORCE)
                state.drive_force[carriage] = work.saturation[carriage]
    if attempt == 1:
        for carriage in range(system.carriages.fixed.size):
            if work.saturation[carriage] != 0.0:
                set_drive_mode(state, carriage, SPEED)
                take_over(state, carriage)
    return converged, iterations, increment, gap


@kernel
def find_saturated(system, state, before, work):
    """Whether a drive takes more than its limit; `saturation` is what it may give then (N), and 0 for the others."""
    saturated = False
    for carriage in range(system.carriages.fixed.size):
        work.saturation[carriage] = 0.0
        if (
            follows_reference(before.drive_mode, before.sheave_mode, carriage)
            and not system.carriages.clamped[carriage]
        ):
            force = drive_force(system, state, carriage)
            limit = force_limit(system.carriages, state, carriage, before.reference[carriage, 1])
            if abs(force) > limit:
                work.saturation[carriage] = limit if force > 0.0 else -limit
                saturated = True
    return saturated


@kernel
def advance(system, state, good, before, work, steps):
    """Take `steps` whole steps: a frame in one call, without the interpreter lock.

    A step that fails is repeated in 2, 4, 8... parts. When 2^max_halvings parts fail too, `state` goes back to the
    last good step and the outcome says so. `good` and `before` are scratch of the shape of `state`.

    Returns:
        The fields of `Outcome`.
    """
    solver = system.solver
    iterations, halvings, worst_gap, increment = 0, 0, 0.0, 0.0
    for done in range(steps):
        copy_state(state, good)
        converged = False
        for level in range(solver.max_halvings + 1):
            parts = 1 << level
            converged, gap = True, 0.0
            for part in range(parts):
                if converged:
                    start = good
                    if part > 0:
                        start = before
                        copy_state(state, before)
                    converged, used, increment, gap = limited_step(system, state, start, solver.step / parts, work)
                    iterations += used
            if converged:
                worst_gap = max(worst_gap, gap)
                break
            copy_state(good, state)
            halvings += 1
        if not converged:
            return False, done, iterations, halvings, worst_gap, increment, worst_element(work)
        state.clock[0] += 1
    for carriage in range(system.carriages.fixed.size):
        if state.attached[carriage] and follows_reference(state.drive_mode, state.sheave_mode, carriage):
            state.drive_force[carriage] = drive_force(system, state, carriage)
    return True, steps, iterations, halvings, worst_gap, increment, worst_element(work)
