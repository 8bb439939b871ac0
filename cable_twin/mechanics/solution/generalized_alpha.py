"""The real-time integrator: generalized-alpha on the index-3 equations (Arnold, Brüls 2007), full Newton.

One step solves M q_ddot + Φ_qᵀ λ = Q and Φ = 0 at its end, with the updates of Newmark on the auxiliary acceleration a:
(1 - α_m) a' + α_m a = (1 - α_f) q_ddot' + α_f q_ddot.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Any, NamedTuple

from cable_twin.mechanics.drives.haul_rope import direct_haul, leave_place
from cable_twin.mechanics.drives.motion import find_saturated, follow_again, hold_at_limits, prescribe, report_forces
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel, kernel_part
from cable_twin.mechanics.language.memory import flat
from cable_twin.mechanics.language.orientations import grow_turn, turn_row
from cable_twin.mechanics.language.vectors import Vector
from cable_twin.mechanics.on_rope.vehicle_buffer import still_off
from cable_twin.mechanics.solution.dissipation import EVERY, SECOND, numerical_loss, trapezoidal_error
from cable_twin.mechanics.solution.equations_of_motion import assemble, measure_gaps, solve
from cable_twin.mechanics.solution.increments import largest_increment, worst_element
from cable_twin.mechanics.solution.kinks import hold_kinks
from cable_twin.mechanics.solution.stepping import begin_step, end_step
from cable_twin.mechanics.state import copy_state

REFRESH = 1.1  # growth of the remembered curvature in a step, so that it is measured again now and then
LEAST_CURVATURE = 1e-3  # 1/m, where rounding leaves nothing to measure


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


@inlined_kernel
def factors(c, h):
    """What the method makes of inertia and of rates in its tangent: ∂acceleration and ∂velocity by coordinate."""
    return (1.0 - c.alpha_m) / ((1.0 - c.alpha_f) * c.beta * h * h), c.gamma / (c.beta * h)


@kernel
def predict(c, h, kind):
    """Start of the iteration for one kind of coordinates: the acceleration of the step before goes on."""
    x, v = flat(kind.position), flat(kind.velocity)
    q_ddot, a = flat(kind.acceleration), flat(kind.algorithmic)
    for i in range(x.size):
        after = (q_ddot[i] - c.alpha_m * a[i]) / (1.0 - c.alpha_m)
        x[i] += h * (v[i] + h * ((0.5 - c.beta) * a[i] + c.beta * after))
        v[i] += h * ((1.0 - c.gamma) * a[i] + c.gamma * after)
        a[i] = after


@inlined_kernel
def predict_massless(c, h, kind):
    """The same for coordinates without inertia, which have no acceleration to go on with: the algorithmic one stays."""
    for i in range(kind.position.size):
        a = kind.algorithmic[i]
        kind.position[i] += h * (kind.velocity[i] + 0.5 * h * a)
        kind.velocity[i] += h * a
        kind.acceleration[i] = (a - c.alpha_f * kind.acceleration[i]) / (1.0 - c.alpha_f)


@kernel
def correct(c, h, increments, kind):
    """Apply Newton increments (m, rad) to one kind of coordinates."""
    x, v = flat(kind.position), flat(kind.velocity)
    q_ddot, a = flat(kind.acceleration), flat(kind.algorithmic)
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
def predict_bodies(c: Coefficients, h: float, kind: Any, turned: Any, like: Vector) -> None:
    """Start of the iteration for bodies; in space, a rotation vector `turned` (bodies, 3) of the step is what moves."""
    if len(like) == 2:
        predict(c, h, kind)
    else:
        _predict_in_space(c, h, kind, turned)


@kernel
def _predict_in_space(c, h, kind, turned):
    """The same with turns: the orientation goes on by exp(Δ), Δ by Newmark's formula (Brüls, Cardona, Arnold 2012)."""
    x, v, q_ddot, a = kind.position, kind.velocity, kind.acceleration, kind.algorithmic
    for body in range(v.shape[0]):
        for axis in range(6):
            after = (q_ddot[body, axis] - c.alpha_m * a[body, axis]) / (1.0 - c.alpha_m)
            moved = h * (v[body, axis] + h * ((0.5 - c.beta) * a[body, axis] + c.beta * after))
            if axis < 3:
                x[body, axis] += moved
            else:
                turned[body, axis - 3] = moved
            v[body, axis] += h * ((1.0 - c.gamma) * a[body, axis] + c.gamma * after)
            a[body, axis] = after
        turn_row(x[body], (turned[body, 0], turned[body, 1], turned[body, 2]))


@kernel
def correct_bodies(c: Coefficients, h: float, increments: Any, kind: Any, turned: Any, like: Vector) -> None:
    """Apply Newton increments (m, rad) to bodies."""
    if len(like) == 2:
        correct(c, h, increments, kind)
    else:
        _correct_in_space(c, h, increments, kind, turned)


@kernel
def _correct_in_space(c, h, increments, kind, turned):
    """The same with turns: the rates go by what the rotation vector of the step grows by."""
    x, v, q_ddot, a = kind.position, kind.velocity, kind.acceleration, kind.algorithmic
    by_velocity = c.gamma / (c.beta * h)
    by_algorithmic = 1.0 / (c.beta * h * h)
    by_acceleration = by_algorithmic * (1.0 - c.alpha_m) / (1.0 - c.alpha_f)
    for body in range(v.shape[0]):
        delta = grow_turn(turned[body], increments[body, 3:])
        turn_row(x[body], (increments[body, 3], increments[body, 4], increments[body, 5]))
        for axis in range(6):
            if axis < 3:
                x[body, axis] += increments[body, axis]
                grown = increments[body, axis]
            else:
                grown = delta[axis - 3]
            v[body, axis] += by_velocity * grown
            a[body, axis] += by_algorithmic * grown
            q_ddot[body, axis] += by_acceleration * grown


@inlined_kernel
def predict_all(c, h, system, state, work):
    """Start of the iteration for all coordinates of one rope and what is on it."""
    leave_place(system, state, work)
    predict(c, h, state.nodes)
    predict_bodies(c, h, state.bodies, work.turned, system.cable.gravity)
    predict_massless(c, h, state.joints)
    predict_massless(c, h, state.hauled)
    predict(c, h, state.sheaves)
    prescribe(state)
    hold_kinks(system, state, work)
    direct_haul(system, state, work)


@inlined_kernel
def correct_all(c, h, system, state, work):
    """Apply the Newton increments of one rope and what is on it."""
    correct(c, h, work.right_side, state.nodes)
    correct_bodies(c, h, work.body_increment, state.bodies, work.turned, system.cable.gravity)
    correct(c, h, work.sliding_increment, state.joints)
    correct(c, h, work.haul_increment, state.hauled)
    correct(c, h, work.sheave_increment, state.sheaves)


@kernel_part
def integrate(system, state, h, work):
    """Take all coordinates over `h` (s), in place. Returns (converged, iterations, last increment in m).

    An increment of size d leaves an error of C d² (Newton), so that one iteration is enough where d is small. C is
    measured whenever there is a second iteration, and remembered from step to step.
    """
    solver = system.solver
    c = coefficients(solver.spectral_radius)
    predict_all(c, h, system, state, work)
    mass_factor, rate_factor = factors(c, h)

    increment, before = 0.0, 0.0
    curvature = REFRESH * state.newton_curvature[0] if state.newton_curvature[0] > 0.0 else inf
    for iteration in range(1, solver.max_iterations + 1):
        measure_gaps(system, state, work, True)
        assemble(system, state, mass_factor, rate_factor, 1.0, work)
        if not solve(system, state, work):
            return False, iteration, increment
        increment = largest_increment(system, work)
        if not isfinite(increment):
            return False, iteration, increment
        correct_all(c, h, system, state, work)
        if iteration == 2 and before > 0.0:
            curvature = max(increment / (before * before), LEAST_CURVATURE)
        left = max(curvature * increment * increment, still_off(system, work, increment, before))
        before = increment
        if left < solver.tolerance or increment == 0.0:
            state.newton_curvature[0] = curvature
            return True, iteration, increment
    return False, solver.max_iterations, increment


@kernel_part
def step(system, state, before, h, work):
    """One step of length `h` (s) in which no drive, and no brake on it, takes more than its force limit.

    One that would is repeated at its limit and goes on from the speed that it reached. `before` is the state at the
    start of the step, whose speed counts for the power limit.

    Returns:
        Converged, iterations, last increment (m), largest gap of a joint (m).
    """
    iterations, gap = 0, 0.0
    for attempt in range(2):
        begin_step(system, state, h)
        converged, used, increment = integrate(system, state, h, work)
        iterations += used
        if converged:
            gap = end_step(system, state, work)
            converged = isfinite(gap)
        if attempt == 1:
            follow_again(state, work)
        elif converged and find_saturated(system, state, before, work):
            copy_state(before, state)
            hold_at_limits(state, work)
        else:
            break
    return converged, iterations, increment, gap


@kernel
def advance(system, state, good, before, work, steps):
    """Take `steps` whole steps: a frame in one call, without the interpreter lock.

    A step that fails is repeated in 2, 4, 8... parts. When 2^max_halvings parts fail too, `state` goes back to the
    last good step and the outcome says so. `good` and `before` are scratch of the shape of `state`.

    Returns:
        The fields of `Outcome`.
    """
    solver, c = system.solver, coefficients(system.solver.spectral_radius)
    iterations, halvings, worst_gap, increment = 0, 0, 0.0, 0.0
    lost, moved = 0.0, 0.0
    for done in range(steps):
        copy_state(state, good)
        looks = state.clock[0] % EVERY == 0
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
                    converged, used, increment, gap = step(system, state, start, solver.step / parts, work)
                    iterations += used
                    if converged and state.clock[0] % SECOND == 0:
                        lost += SECOND * trapezoidal_error(system, start, state)
                    if converged and looks:
                        here, there = numerical_loss(system, start, state, c, solver.step / parts)
                        lost, moved = lost + EVERY * here, moved + EVERY * there
            if converged:
                worst_gap = max(worst_gap, gap)
                break
            copy_state(good, state)
            halvings += 1
        if not converged:
            return False, done, iterations, halvings, worst_gap, increment, worst_element(work), lost, moved
        state.clock[0] += 1
    report_forces(system, state)
    return True, steps, iterations, halvings, worst_gap, increment, worst_element(work), lost, moved
