"""Newton's method for all ropes and their couplings: iterations of a step, each a linear solution, and their end."""

from __future__ import annotations

from math import inf, isfinite, sqrt

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, subtract
from cable_twin.mechanics.on_rope.buffer import contact_error
from cable_twin.mechanics.on_rope.tower import contacts_left
from cable_twin.mechanics.rope.point import AFTER, BEFORE, R
from cable_twin.mechanics.solution.block_tridiagonal import solve_block_tridiagonal, solve_columns
from cable_twin.mechanics.solution.bundle.clamp import recover_clamps
from cable_twin.mechanics.solution.bundle.couplings import add_couplings, add_to_patches, correct_couplings
from cable_twin.mechanics.solution.bundle.elimination import solve_bundle
from cable_twin.mechanics.solution.bundle.pantograph import recover_pantographs
from cable_twin.mechanics.solution.bundle.records import STATE, WORK, rope_of
from cable_twin.mechanics.solution.bundle.wheel_tangent import begin_wheels, is_found_now, recover_wheels
from cable_twin.mechanics.solution.equations_of_motion import assemble_open, hold_ends, measure_gaps, recover
from cable_twin.mechanics.solution.patch_elimination import condense_patches, recover_patches
from cable_twin.mechanics.solution.prediction import correct_rope, factors

REFRESH = 1.002  # growth of the remembered ratio in a step, so that it is measured again now and then
LEAST_RATIO = 0.5  # of the error that an iteration leaves to its estimate, where nothing else is known
PER_METRE = 1.0  # 1/m, least estimate over the square of the increment: bodies turn by an angle, and joints slide
BULGE = 0.25  # of a length, most by which slopes of 1 and -1 at its ends move the middle of a cubic: counts in motion


@kernel
def iterate(bundle, moving, scratch, system, state, work, c, h):
    """Solve the equations at the end of a step of `h` (s) by Newton's method, from the predicted motion there.

    What an iteration leaves is of second order in its increment (`second_order_error`), so that one iteration is enough
    where that is small. The ratio of error to estimate is measured whenever there is a second iteration, and remembered
    from step to step. Where a contact has changed in an iteration, there is one more; a response to bullwheels that was
    kept leaves an error of its own.

    Returns:
        Converged, iterations, last increment (m).
    """
    solver, ropes = system.solver, bundle.records.shape[0]
    mass_factor, rate_factor = factors(c, h)

    known = least_ratio(bundle, state)
    ratio = max(REFRESH * known, LEAST_RATIO) if known > 0.0 else inf
    increment, before, estimate = 0.0, 0.0, 0.0
    for iteration in range(1, solver.max_iterations + 1):
        solvable, increment, changed = solve_increments(
            bundle, moving, scratch, system, state, work, mass_factor, rate_factor, 1.0
        )
        if not solvable or not isfinite(increment):
            return False, iteration, increment
        if iteration == 2 and before > 0.0:
            ratio = max(increment / estimate, LEAST_RATIO)
        estimate = PER_METRE * increment * increment
        for rope in range(ropes):
            own, here, room = rope_of(bundle, rope, system, state, work)
            correct_rope(c, h, own, here, room)
            estimate = second_order_error(own, here, room, mass_factor, rate_factor, estimate)
        if bundle.coupled:
            correct_couplings(bundle, moving, scratch, system, state, c, h)
        left = max(ratio * estimate, contact_error_of_all(bundle, system, state, work, increment, before))
        if bundle.coupled:
            left = max(left, scratch.lagging[0])
        before = increment
        if (left < solver.tolerance and changed == 0) or increment == 0.0:
            remember_ratio(bundle, state, ratio)
            return True, iteration, increment
    return False, solver.max_iterations, increment


@kernel
def second_order_error(system, state, work, mass_factor, rate_factor, least):
    """Estimated error (m) of second order that an increment leaves in elements and tower contacts of a rope.

    Where an element of length l turns by θ and stretches by ε, its strain has grown by θ²/2 more, which moves its ends
    by l θ²/2 along it, and its tension by EA ε, which pulls them across with EA ε θ. What resists that is their inertia
    ρA l times the mass factor of the integrator.

    Args:
        system: parameters.
        state: after the increment.
        work: with the increment.
        mass_factor: ∂acceleration/∂coordinate (1/s²).
        rate_factor: ∂velocity/∂coordinate (1/s).
        least: an estimate (m); what is less is not looked at closely.
    """
    cable, increments, coordinates = system.cable, work.right_side, state.nodes.position
    like, across, worst = cable.gravity, cable.axial_stiffness / (mass_factor * cable.mass_per_length), least
    for element in range(cable.element_count):
        length = state.mesh.length[element]
        first, middle, second = slopes_in(increments, element, length, like)
        squares = dot(first, first), dot(middle, middle), dot(second, second)
        share = across / length
        if (0.5 * length + share) * max(squares[0], squares[1], squares[2]) > worst:
            first_x, middle_x, second_x = slopes_in(coordinates, element, length, like)
            along = dot(first, first_x) ** 2, dot(middle, middle_x) ** 2, dot(second, second_x) ** 2
            stretched = (along[0] + 4.0 * along[1] + along[2]) / 6.0  # Simpson's rule
            turned = max((squares[0] + 4.0 * squares[1] + squares[2]) / 6.0 - stretched, 0.0)
            worst = max(worst, 0.5 * length * turned + share * sqrt(stretched * turned))
    return contacts_left(cable, system.towers, state, work, mass_factor, rate_factor, worst)


@inlined_kernel
def slopes_in(coordinates, element, length, like):
    """Slopes (dim,) at the first end, the middle and the second end of an element, or their increments."""
    first, second = load(coordinates[element, AFTER], like), load(coordinates[element + 1, BEFORE], like)
    chord = scale(1.5 / length, subtract(load(coordinates[element + 1, R], like), load(coordinates[element, R], like)))
    return first, add_scaled(-0.25, first, add_scaled(-0.25, second, chord)), second


@kernel
def least_ratio(bundle, state):
    """Least remembered ratio of error to estimate of all ropes; 0 (not known) where accelerations are not known."""
    least = inf
    for rope in range(bundle.records.shape[0]):
        least = min(least, record_at(bundle.records[rope, STATE], state).newton_ratio[0])
    return least


@kernel
def remember_ratio(bundle, state, ratio):
    """Store with all ropes the ratio of the error that an iteration of Newton's method leaves to its estimate."""
    for rope in range(bundle.records.shape[0]):
        record_at(bundle.records[rope, STATE], state).newton_ratio[0] = ratio


@kernel
def contact_error_of_all(bundle, system, state, work, increment, previous):
    """Largest estimated error (m) of vehicles in buffer contact on any rope, see `contact_error`."""
    worst = 0.0
    for rope in range(bundle.records.shape[0]):
        own, here, room = rope_of(bundle, rope, system, state, work)
        worst = max(worst, contact_error(own, here, room, increment, previous))
    return worst


@kernel
def linearise_rope(system, state, work, mass_factor, rate_factor, stiffness_factor):
    """Assemble residual and tangent of one rope with its vehicles, before supports and condensation of moving loads."""
    measure_gaps(system, state, work, True)
    assemble_open(system, state, mass_factor, rate_factor, stiffness_factor, work)


@kernel
def recover_rope(system, state, work, of_slopes):
    """Recover the eliminated unknowns of one rope; return its largest increment (m), see `largest_increment`."""
    recover(system, state, work)
    return largest_increment(system, state, work, of_slopes)


@kernel
def solve_increments(bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor):
    """Solve for the Newton increments of all ropes and couplings, in their workspaces; updates multipliers.

    `system`, `state` and `work` are those of any of the ropes, for their types; factors as in `assemble`.

    Returns:
        Whether there is a solution, the largest increment (m), and how many contacts have changed.
    """
    ropes, largest, changed, turned = bundle.records.shape[0], 0.0, 0, 0.0
    for rope in range(ropes):
        own, here, room = rope_of(bundle, rope, system, state, work)
        linearise_rope(own, here, room, mass_factor, rate_factor, stiffness_factor)
    if bundle.coupled:
        begin_wheels(bundle, moving, scratch, system, state, work, mass_factor, rate_factor)
        changed = add_to_patches(bundle, moving, scratch, system, state, work, rate_factor, stiffness_factor)
    for rope in range(ropes):
        own, here, room = rope_of(bundle, rope, system, state, work)
        if own.cable.load_nodes:
            columns = scratch.patch_columns if is_found_now(moving.response) else room.no_columns
            condense_patches(here, room, columns, own.cable.gravity)
    if bundle.coupled:
        changed += add_couplings(
            bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor
        )
    for rope in range(ropes):
        own, _, room = rope_of(bundle, rope, system, state, work)
        hold_ends(own.cable, room)
    if not solve_nodes(bundle, scratch, system, work):
        return False, largest, changed
    if bundle.coupled and bundle.sheaves.inertia.size > 0 and rate_factor > 0.0:
        solvable, turned = recover_wheels(bundle, moving, scratch, system, state, work)
        if not solvable:
            return False, largest, changed
    if bundle.coupled:
        recover_clamps(bundle, moving, scratch, state, work, system.cable.gravity)
    for rope in range(ropes):
        own, here, room = rope_of(bundle, rope, system, state, work)
        recover_patches(here, room, own.cable.gravity)
    if bundle.coupled:
        like = system.cable.gravity
        lifted = recover_pantographs(bundle, moving, scratch, state, system, work, stiffness_factor, like)
        largest = max(turned, lifted) if isfinite(turned) else turned
    for rope in range(ropes):
        own, here, room = rope_of(bundle, rope, system, state, work)
        increment = recover_rope(own, here, room, BULGE if rate_factor > 0.0 else 1.0)
        largest = largest if increment <= largest else increment  # what is no number stays
    return True, largest, changed


@kernel
def solve_nodes(bundle, scratch, system, work):
    """Solve for the nodal increments: of coupled ropes in one sweep, of each other rope from both ends.

    Returns:
        False when a block has no inverse.
    """
    like = system.cable.gravity
    if bundle.coupled and bundle.order.node.size > 0 and not solve_bundle(bundle, scratch, work, like):
        return False
    for rope in range(bundle.records.shape[0]):
        if bundle.order.joined[rope] == 0:
            own = record_at(bundle.records[rope, WORK], work)
            if bundle.coupled and scratch.slots[rope] > 0:
                columns = scratch.wheel_columns[bundle.offset[rope] : bundle.offset[rope + 1]]
                stopped = solve_beside(own, columns, scratch.slots[rope], like)
            else:
                stopped = solve_block_tridiagonal(own.diagonal, own.upper, own.lower, own.right_side, like)
            if stopped >= 0:
                return False
    return True


@kernel
def solve_beside(work, wheel_columns, count, like):
    """Solve the equations of one rope together with the columns of bullwheels, see `solve_columns`."""
    return solve_columns(work.diagonal, work.upper, work.lower, work.right_side, wheel_columns, count, like)


@kernel
def largest_increment(system, state, work, of_slopes):
    """Largest Newton increment (m) of one rope: positions of rope and bodies, arc lengths; nan if any is no number.

    A slope counts as the element's length times `of_slopes`. It moves the rope by at most `BULGE` of that; on the way
    to an equilibrium, where it limits how far slopes go at once, it counts whole.
    """
    like, lengths, increments = system.cable.gravity, state.mesh.length, work.right_side
    worst, total = 0.0, 0.0
    for node in range(increments.shape[0]):
        length = of_slopes * lengths[min(node, lengths.size - 1)]
        largest, gone = 0.0, 0.0  # of a node, as the next one need not wait for it
        for i in range(len(like)):
            r, slope = increments[node, 0, i], length * increments[node, 1, i]
            largest = max(largest, abs(r), abs(slope))
            gone += r + slope
            if system.cable.load_nodes:
                after = length * increments[node, 2, i]
                largest, gone = max(largest, abs(after)), gone + after
        worst = max(worst, largest)
        total += gone
    for body in range(work.body_increment.shape[0]):
        for axis in range(work.body_increment.shape[1]):
            increment = work.body_increment[body, axis]
            if axis < work.right_side.shape[2]:
                worst = max(worst, abs(increment))
            total += increment
    for carriage in range(work.sliding_increment.size):
        worst = max(worst, abs(work.sliding_increment[carriage]))
        worst = max(worst, abs(work.drum_increment[carriage]))
        total += work.sliding_increment[carriage] + work.drum_increment[carriage]
    return worst if isfinite(total) else total - total


@kernel
def worst_element(work):
    """Index of the element at whose first node the last Newton increment was largest, or not a number."""
    worst, place = -1.0, 0
    for node in range(work.right_side.shape[0]):
        for i in range(work.right_side.shape[2]):
            size = abs(work.right_side[node, 0, i])
            if not size <= worst:
                worst, place = size, node
            if not isfinite(size):
                return min(node, work.right_side.shape[0] - 2)
    return min(place, work.right_side.shape[0] - 2)
