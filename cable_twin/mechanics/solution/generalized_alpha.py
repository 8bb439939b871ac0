"""Real-time integrator: generalized-alpha on the index-3 equations (Arnold, Brüls 2007), Newton's method in `newton`.

One step solves M q_ddot + Φ_qᵀ λ = Q and Φ = 0 at its end, of all ropes at once, with the updates of `prediction`.
"""

from __future__ import annotations

from math import isfinite

from cable_twin.mechanics.drives.motion import find_saturated, follow_again, hold_at_limits, report_forces
from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.on_rope.load_node import seat_loads, update_load_nodes
from cable_twin.mechanics.solution.bundle.bullwheels import (
    find_saturated_wheels,
    hold_wheels_at_limits,
    turn_by_speed_again,
    wheels_gone_back,
)
from cable_twin.mechanics.solution.bundle.couplings import (
    end_couplings,
    move_couplings,
    place_couplings,
    worst_coupling_gap,
)
from cable_twin.mechanics.solution.bundle.records import (
    BEFORE,
    GOOD,
    STATE,
    copy_motion,
    copy_ropes,
    rope_of,
    take_motion,
)
from cable_twin.mechanics.solution.dissipation import EVERY, SECOND, numerical_loss, trapezoidal_error
from cable_twin.mechanics.solution.newton import iterate, least_ratio, worst_element
from cable_twin.mechanics.solution.prediction import coefficients_of_step, predict_rope
from cable_twin.mechanics.solution.stepping import begin_step, end_step


@kernel
def begin_rope(c, h, system, state, work):
    """Advance drives, wind and stations of one rope by `h` (s), and predict its motion."""
    begin_step(system, state, h)
    predict_rope(c, h, system, state, work)


@kernel
def integrate(bundle, moving, scratch, system, state, work, c, h):
    """Advance all coordinates by `h` (s) by Newton's method; return (converged, iterations, last increment in m)."""
    ropes = bundle.records.shape[0]
    if bundle.coupled:
        move_couplings(bundle, moving, system, state, c, h)
    for rope in range(ropes):
        own, here, room = rope_of(bundle, rope, system, state, work)
        begin_rope(c, h, own, here, room)
    if bundle.coupled:
        place_couplings(bundle, moving, system, state, c, h)
    return iterate(bundle, moving, scratch, system, state, work, c, h)


@kernel
def step(bundle, moving, moving_before, scratch, system, state, work, column, c, h):
    """Integrate one step of length `h` (s) with the force limits of drives and their brakes.

    A step in which a drive exceeds its limit is repeated with the drive at the limit; its reference then starts from
    the speed reached. The states at the start of the step, whose speeds count for the power limit, are in `column` of
    the records and in `moving_before`.

    Returns:
        Converged, iterations, last increment (m), largest gap of a joint (m).
    """
    iterations, gap, ropes = 0, 0.0, bundle.records.shape[0]
    scratch.saturation[:] = 0.0
    for attempt in range(2):
        converged, used, increment = integrate(bundle, moving, scratch, system, state, work, c, h)
        iterations += used
        saturated, gap = False, 0.0
        for rope in range(ropes):
            own, here, room = rope_of(bundle, rope, system, state, work)
            if converged:
                open_by = end_step(own, here, room)
                gap = gap if open_by <= gap else open_by  # what is no number stays
            if attempt == 1:
                follow_again(here, room)
            elif converged and find_saturated(own, here, record_at(bundle.records[rope, column], state), room):
                saturated = True
        if converged and bundle.coupled:
            gap = max(gap, worst_coupling_gap(bundle, moving, system, state)) if isfinite(gap) else gap
        converged = converged and isfinite(gap)
        if converged and bundle.coupled:
            end_couplings(bundle, moving, scratch, system, state)
            if attempt == 1:
                turn_by_speed_again(moving.sheaves, scratch)
            elif find_saturated_wheels(bundle.sheaves, moving.sheaves, moving_before, scratch):
                saturated = True
        if attempt == 1 or not converged or not saturated:
            break
        copy_ropes(bundle, column, STATE, state)
        for rope in range(ropes):
            _, here, room = rope_of(bundle, rope, system, state, work)
            hold_at_limits(here, room)
        if bundle.coupled:
            take_motion(moving_before, moving)
            hold_wheels_at_limits(moving.sheaves, scratch.saturation)
    return converged, iterations, increment, gap


@kernel
def lost_in_step(bundle, system, state, work, column, c, h):
    """Integrator's energy loss and change of kinetic energy (J) of all ropes in a step, estimated from sampled steps.

    A step that is not sampled gives 0; a sampled one counts for those that are not.
    """
    clock, lost, moved = record_at(bundle.records[0, STATE], state).clock[0], 0.0, 0.0
    for rope in range(bundle.records.shape[0]):
        own, end, _ = rope_of(bundle, rope, system, state, work)
        start = record_at(bundle.records[rope, column], state)
        if clock % SECOND == 0:
            lost += SECOND * trapezoidal_error(own, start, end)
        if clock % EVERY == 0:
            here, there = numerical_loss(own, start, end, c, h)
            lost, moved = lost + EVERY * here, moved + EVERY * there
    return lost, moved


@kernel
def has_changed_places(bundle, state):
    """Return whether a vehicle was attached or detached, or moved to another rope or station, in the last step."""
    before, now = record_at(bundle.records[0, GOOD], state), record_at(bundle.records[0, STATE], state)
    for vehicle in range(now.attached.size):
        attached, rope = now.attached[vehicle], now.vehicle_rope[vehicle]
        if attached != before.attached[vehicle] or rope != before.vehicle_rope[vehicle]:
            return True
        if not attached and now.joints.position[vehicle] != before.joints.position[vehicle]:
            return True
    return False


@kernel
def advance(bundle, moving, moving_good, moving_before, scratch, system, state, work, steps):
    """Integrate `steps` steps without interpreter lock; end early on rollback or if a vehicle joins or leaves a rope.

    A step that fails is repeated in 2, 4, 8... parts. When 2^max_halvings parts fail too, all goes back to the last
    good step and the outcome says so.

    Args:
        bundle: ropes and their couplings.
        moving: motion of the couplings.
        moving_good: scratch for a copy of `moving`.
        moving_before: the same.
        scratch: of the solver for couplings.
        system: parameters of any of the ropes, for their type.
        state: motion of any, likewise.
        work: scratch of any, likewise.
        steps: how many.

    Returns:
        The fields of `Outcome`.
    """
    solver = system.solver
    iterations, halvings, worst_gap, increment = 0, 0, 0.0, 0.0
    lost, moved = 0.0, 0.0
    taken, gone_back = 0, wheels_gone_back(moving.sheaves)
    for done in range(steps):
        for rope in range(bundle.records.shape[0]):
            own, here, _ = rope_of(bundle, rope, system, state, work)
            if own.cable.load_nodes:
                update_load_nodes(own, here)
        copy_ropes(bundle, STATE, GOOD, state)
        if bundle.coupled:
            copy_motion(moving, moving_good)
        converged = False
        for level in range(solver.max_halvings + 1):
            parts = 1 << level
            converged, gap = True, 0.0
            for part in range(parts):
                if converged:
                    column = GOOD
                    if bundle.coupled:
                        copy_motion(moving, moving_before)
                    if part > 0:
                        column = BEFORE
                        copy_ropes(bundle, STATE, BEFORE, state)
                    c = coefficients_of_step(solver.spectral_radius, least_ratio(bundle, state) > 0.0)
                    converged, used, increment, gap = step(
                        bundle, moving, moving_before, scratch, system, state, work, column, c, solver.step / parts
                    )
                    iterations += used
                    if converged:
                        here, there = lost_in_step(bundle, system, state, work, column, c, solver.step / parts)
                        lost, moved = lost + here, moved + there
            if converged:
                worst_gap = max(worst_gap, gap)
                break
            copy_ropes(bundle, GOOD, STATE, state)
            if bundle.coupled:
                take_motion(moving_good, moving)
                moving.response.left[:] = 0  # it may have been found of what is no number
            halvings += 1
        if not converged:
            element = worst_element(rope_of(bundle, 0, system, state, work)[2])
            return False, done, iterations, halvings, worst_gap, increment, element, lost, moved
        for rope in range(bundle.records.shape[0]):
            _, here, _ = rope_of(bundle, rope, system, state, work)
            here.clock[0] += 1
        taken, changed = done + 1, has_changed_places(bundle, state)
        for rope in range(bundle.records.shape[0]):
            own, here, _ = rope_of(bundle, rope, system, state, work)
            if changed and own.cable.load_nodes:
                seat_loads(own, here)
        if changed or wheels_gone_back(moving.sheaves) > gone_back:
            break
    for rope in range(bundle.records.shape[0]):
        own, here, _ = rope_of(bundle, rope, system, state, work)
        report_forces(own, here)
    return True, taken, iterations, halvings, worst_gap, increment, 0, lost, moved
