"""The real-time integrator for a bundle: the steps of `solution.generalized_alpha` for all ropes at once."""

from __future__ import annotations

from math import inf, isfinite

from cable_twin.mechanics.drives.motion import find_saturated, follow_again, hold_at_limits, report_forces
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.memory import copy_record
from cable_twin.mechanics.on_rope.vehicle_buffer import still_off
from cable_twin.mechanics.solution.bundle.bullwheels import (
    ESTIMATED,
    correct_bullwheels,
    end_bullwheels,
    move_bullwheels,
    wheels_gone_back,
)
from cable_twin.mechanics.solution.bundle.clamp import find_clamps, follow_clamps, worst_clamp_gap
from cable_twin.mechanics.solution.bundle.equations import solve_increments
from cable_twin.mechanics.solution.bundle.records import BEFORE, GOOD, STATE, SYSTEM, WORK
from cable_twin.mechanics.solution.bundle.riders import ride_tracks
from cable_twin.mechanics.solution.bundle.strand_ends import carry_on, feel_ends, give_ends, place_ends
from cable_twin.mechanics.solution.dissipation import EVERY, SECOND, numerical_loss, trapezoidal_error
from cable_twin.mechanics.solution.generalized_alpha import (
    LEAST_CURVATURE,
    REFRESH,
    coefficients,
    correct,
    correct_all,
    factors,
    predict,
    predict_all,
)
from cable_twin.mechanics.solution.increments import worst_element
from cable_twin.mechanics.solution.stepping import begin_step, end_step
from cable_twin.mechanics.state import copy_state


@kernel
def begin_rope(c, h, system, state, work):
    """Start of a step for one rope."""
    begin_step(system, state, h)
    predict_all(c, h, system, state, work)


@kernel
def correct_rope(c, h, system, state, work):
    """Apply the Newton increments of one rope."""
    correct_all(c, h, system, state, work)


@kernel
def integrate_bundle(bundle, moving, scratch, system, state, work, h):
    """Take all coordinates over `h` (s), in place. Returns (converged, iterations, last increment in m).

    As `generalized_alpha.integrate`; where a contact has changed in an iteration, or a bullwheel has turned by more
    than the tolerance, there is one more.
    """
    solver, ropes, looped = system.solver, bundle.records.shape[0], bundle.sheaves.inertia.size > 0
    c = coefficients(solver.spectral_radius)
    move_bullwheels(bundle.sheaves, moving.sheaves, c, h)
    give_ends(bundle, moving.sheaves, system, state)
    for rope in range(ropes):
        own = record_at(bundle.records[rope, SYSTEM], system)
        begin_rope(
            c, h, own, record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
        )
    place_ends(bundle, moving.sheaves, system, state)
    find_clamps(bundle, moving, system, state, h)
    predict(c, h, moving.stages)
    for pantograph in range(moving.place.position.size):
        moving.place.position[pantograph] += h * moving.place.velocity[pantograph]
    mass_factor, rate_factor = factors(c, h)
    memory = record_at(bundle.records[0, STATE], state).newton_curvature
    scratch.wheel_stiffness[:] = 0.0
    increment, before = 0.0, 0.0
    curvature = REFRESH * memory[0] if memory[0] > 0.0 else inf
    for iteration in range(1, solver.max_iterations + 1):
        solvable, increment, changed = solve_increments(
            bundle, moving, scratch, system, state, work, mass_factor, rate_factor, 1.0
        )
        if not solvable or not isfinite(increment):
            return False, iteration, increment
        for rope in range(ropes):
            own = record_at(bundle.records[rope, SYSTEM], system)
            correct_rope(
                c, h, own, record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
            )
        correct(c, h, scratch.increment, moving.stages)
        turned = 0.0
        if looped:
            feel_ends(bundle, moving.sheaves, system, state)
            if iteration <= ESTIMATED:
                scratch.wheel_increment[:] = 0.0
            turned = correct_bullwheels(bundle, moving.sheaves, scratch, system, c, h)
            carry_on(bundle, moving.sheaves, system, state)
            follow_clamps(bundle, moving, system, state)
        if iteration == 2 and before > 0.0:
            curvature = max(increment / (before * before), LEAST_CURVATURE)
        left = max(curvature * increment * increment, still_off_any(bundle, system, work, increment, before))
        before = increment
        if turned > solver.tolerance or not isfinite(turned):
            continue
        if (left < solver.tolerance and changed == 0) or increment == 0.0:
            memory[0] = curvature
            return True, iteration, increment
    return False, solver.max_iterations, increment


@kernel
def still_off_any(bundle, system, work, increment, before):
    """Error (m) left where vehicles push each other on any of the ropes."""
    worst = 0.0
    for rope in range(bundle.records.shape[0]):
        own = record_at(bundle.records[rope, SYSTEM], system)
        worst = max(worst, still_off(own, record_at(bundle.records[rope, WORK], work), increment, before))
    return worst


@kernel
def step_bundle(bundle, moving, before, scratch, system, state, work, column, h):
    """One step of length `h` (s), as `generalized_alpha.step`; states before it are in `column` and `before`.

    Returns:
        Converged, iterations, last increment (m), largest gap of a joint (m).
    """
    iterations, gap, ropes = 0, 0.0, bundle.records.shape[0]
    for attempt in range(2):
        converged, used, increment = integrate_bundle(bundle, moving, scratch, system, state, work, h)
        iterations += used
        saturated = False
        gap = 0.0
        for rope in range(ropes):
            own = record_at(bundle.records[rope, SYSTEM], system)
            here, own_work = record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
            if converged:
                gap = max(gap, end_step(own, here, own_work))
            if attempt == 1:
                follow_again(here, own_work)
            elif converged and find_saturated(own, here, record_at(bundle.records[rope, column], state), own_work):
                saturated = True
        gap = max(gap, worst_clamp_gap(bundle, moving, system, state, system.cable.gravity)) if converged else gap
        converged = converged and isfinite(gap)
        if converged:
            end_bullwheels(bundle.sheaves, moving.sheaves)
            ride_tracks(bundle, system, state)
        if attempt == 1 or not converged or not saturated:
            break
        for rope in range(ropes):
            here, own_work = record_at(bundle.records[rope, STATE], state), record_at(bundle.records[rope, WORK], work)
            copy_state(record_at(bundle.records[rope, column], state), here)
            hold_at_limits(here, own_work)
        copy_record(before, moving)
    return converged, iterations, increment, gap


@kernel
def copy_ropes(bundle, source, target, state):
    """Copy the states of all ropes from one column of records to another."""
    for rope in range(bundle.records.shape[0]):
        copy_state(record_at(bundle.records[rope, source], state), record_at(bundle.records[rope, target], state))


@kernel
def advance(bundle, moving, moving_good, moving_before, scratch, system, state, work, steps):
    """Take `steps` whole steps, as `generalized_alpha.advance` does, or those until a lift has rolled back.

    Returns:
        The fields of `Outcome`.
    """
    solver, clock = system.solver, record_at(bundle.records[0, STATE], state).clock
    c = coefficients(solver.spectral_radius)
    iterations, halvings, worst_gap, increment = 0, 0, 0.0, 0.0
    lost, moved = 0.0, 0.0
    taken, gone_back = 0, wheels_gone_back(moving.sheaves)
    for done in range(steps):
        copy_ropes(bundle, STATE, GOOD, state)
        copy_record(moving, moving_good)
        looks = clock[0] % EVERY == 0
        converged = False
        for level in range(solver.max_halvings + 1):
            parts = 1 << level
            converged, gap = True, 0.0
            for part in range(parts):
                if converged:
                    column = GOOD
                    copy_record(moving, moving_before)
                    if part > 0:
                        column = BEFORE
                        copy_ropes(bundle, STATE, BEFORE, state)
                    converged, used, increment, gap = step_bundle(
                        bundle, moving, moving_before, scratch, system, state, work, column, solver.step / parts
                    )
                    iterations += used
                    for rope in range(bundle.records.shape[0] if converged else 0):
                        own = record_at(bundle.records[rope, SYSTEM], system)
                        start = record_at(bundle.records[rope, column], state)
                        end = record_at(bundle.records[rope, STATE], state)
                        if clock[0] % SECOND == 0:
                            lost += SECOND * trapezoidal_error(own, start, end)
                        if looks:
                            here, there = numerical_loss(own, start, end, c, solver.step / parts)
                            lost, moved = lost + EVERY * here, moved + EVERY * there
            if converged:
                worst_gap = max(worst_gap, gap)
                break
            copy_ropes(bundle, GOOD, STATE, state)
            copy_record(moving_good, moving)
            halvings += 1
        if not converged:
            element = worst_element(record_at(bundle.records[0, WORK], work))
            return False, done, iterations, halvings, worst_gap, increment, element, lost, moved
        for rope in range(bundle.records.shape[0]):
            record_at(bundle.records[rope, STATE], state).clock[0] += 1
        taken = done + 1
        if wheels_gone_back(moving.sheaves) > gone_back:
            break
    for rope in range(bundle.records.shape[0]):
        own = record_at(bundle.records[rope, SYSTEM], system)
        report_forces(own, record_at(bundle.records[rope, STATE], state))
    return True, taken, iterations, halvings, worst_gap, increment, 0, lost, moved
