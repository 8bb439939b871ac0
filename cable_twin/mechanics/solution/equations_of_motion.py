"""Residual, tangent and linear solution of one rope with its vehicles (paper, eq. 16).

With q = (r, e, n) and λ, eq. 16 and every Newton step on it have the same shape,

    | M_r   0     0     Φ_rᵀ |   | bodies               |
    | 0     M_e   0     Φ_eᵀ |   | nodal coordinates    |
    | 0     0     0     Φ_nᵀ |   | sliding coordinates  |  =  - residual,
    | Φ_r   Φ_e   Φ_n   0    |   | multipliers          |

where M stands for  mass_factor M + rate_factor ∂Q/∂q_dot + ∂Q/∂q. Rows 1, 3 and 4 of a carriage touch one
element, so they are eliminated first (`chain`, then `sliding_joint`); row 2 is block-tridiagonal.
"""

from __future__ import annotations

from cable_twin.mechanics.drives.joint_drive import (
    condense_drive,
    recover_drive,
    reference_acceleration,
    reference_gap,
)
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import clear_array, copy_array
from cable_twin.mechanics.language.vectors import (
    accumulate,
    block,
    full,
    load,
    outer,
    product,
    store,
    subtract,
    symmetric,
)
from cable_twin.mechanics.on_rope.buffer import predict_contacts
from cable_twin.mechanics.on_rope.chain import close_joints, condense_chain, joint_accelerations, recover_chain
from cable_twin.mechanics.on_rope.counterweight import add_counterweights
from cable_twin.mechanics.on_rope.load_node import follow_joints
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.on_rope.sliding_joint import (
    add_joint,
    direction_above,
    joint_position,
    joint_velocity,
    place_joint,
    recover_joint,
    recover_turn,
    velocity_acceleration,
    velocity_turning,
)
from cable_twin.mechanics.on_rope.tower import add_towers
from cable_twin.mechanics.on_rope.wind import drag_bodies
from cable_twin.mechanics.parameters import ELEMENT_FRAME
from cable_twin.mechanics.rope.element import add_cable
from cable_twin.mechanics.rope.patch_assembly import add_patches, begin_patches
from cable_twin.mechanics.rope.point import point_at
from cable_twin.mechanics.rope.point_load import add_point_load, add_point_tangent
from cable_twin.mechanics.solution.block_tridiagonal import solve_block_tridiagonal
from cable_twin.mechanics.solution.patch_elimination import condense_patches, recover_patches


@inlined_kernel
def measure_gaps(system, state, work, place):
    """Measure the residual of a rope's constraints at position level, in m: vehicle joints and driven joints.

    With `place` true, joints are first put on the element that holds them.
    """
    if place and system.cable.load_nodes:
        follow_joints(state)
    for carriage in range(system.carriages.fixed.size):
        if not rides(system, state, carriage):
            leave_out(system.carriages, carriage, work)
            continue
        if place:
            place_joint(system.cable, state, carriage)
        joint, above = joint_position(system.cable, state, carriage), direction_above(system, state, carriage)
        close_joints(system.carriages, state, carriage, joint, above, work)
        reference_gap(state, carriage, work)


@inlined_kernel
def largest_gap(system, state, work, place):
    """Largest constraint gap (m) of a rope's vehicle joints; measures all gaps like `measure_gaps`."""
    measure_gaps(system, state, work, place)
    worst = 0.0
    for carriage in range(system.carriages.fixed.size):
        first = system.carriages.body_offset[carriage]
        for body in range(first, system.carriages.body_offset[carriage + 1]):
            for axis in range(work.joint_gap.shape[1]):
                worst = max(worst, abs(work.joint_gap[body, axis]))
    return worst


@kernel
def leave_out(carriages, carriage, work):
    """Clear gaps and increments of a vehicle off the cable in the workspace."""
    bodies = carriages.body_offset[carriage], carriages.body_offset[carriage + 1]
    work.joint_gap[bodies[0] : bodies[1]] = 0.0
    work.body_increment[bodies[0] : bodies[1]] = 0.0
    work.sliding_increment[carriage] = 0.0


@kernel
def measure_gap_accelerations(system, state, feedback, work):
    """Compute the right side γ (m/s²) of eq. 12 for all constraints Φ, from Φ_ddot at zero accelerations.

    The gaps Φ and their rates are added with Baumgarte's factors, `feedback` (1/s) squared and doubled.
    """
    for carriage in range(system.carriages.fixed.size):
        joint = joint_position(system.cable, state, carriage), joint_velocity(system.cable, state, carriage)
        curved = velocity_acceleration(system.cable, state, carriage), velocity_turning(system.cable, state, carriage)
        above = direction_above(system, state, carriage)
        joint_accelerations(system.carriages, state, carriage, feedback, (*joint, *curved), above, work)
        reference_acceleration(state, carriage, work)


@inlined_kernel
def assemble(system, state, mass_factor, rate_factor, stiffness_factor, work):
    """Assemble residual and tangent of one rope (eq. 16), with vehicles eliminated; needs the gaps measured.

    Args:
        system: parameters.
        state: where to linearise.
        mass_factor: ∂acceleration/∂unknown of the caller's method, 1/s² (1 when the unknowns are accelerations).
        rate_factor: ∂velocity/∂unknown, 1/s.
        stiffness_factor: ∂coordinate/∂unknown, 1 (0 when the unknowns are accelerations).
        work: takes the result.
    """
    assemble_unheld(system, state, mass_factor, rate_factor, stiffness_factor, work)
    hold_ends(system.cable, work)


@inlined_kernel
def assemble_unheld(system, state, mass_factor, rate_factor, stiffness_factor, work):
    """Assemble a rope's residual and tangent before supports and couplings, with vehicles and loads eliminated."""
    assemble_open(system, state, mass_factor, rate_factor, stiffness_factor, work)
    if system.cable.load_nodes:
        condense_patches(state, work, work.no_columns, system.cable.gravity)


@inlined_kernel
def assemble_open(system, state, mass_factor, rate_factor, stiffness_factor, work):
    """Assemble a rope's residual and tangent before supports, with vehicles eliminated but not yet moving loads."""
    cable, carriages = system.cable, system.carriages
    if cable.load_nodes:
        begin_patches(state, work)
    add_cable(system, state, mass_factor, rate_factor, stiffness_factor, work)
    if cable.load_nodes:
        add_patches(system, state, mass_factor, rate_factor, stiffness_factor, work)
    add_loads(cable, state, stiffness_factor, work)
    if system.air.present:
        drag_bodies(system, state, rate_factor, stiffness_factor, work)
    for carriage in range(carriages.fixed.size):
        if rides(system, state, carriage):
            above = direction_above(system, state, carriage)
            condense_chain(
                carriages, cable.gravity, state, carriage, above, mass_factor, rate_factor, stiffness_factor, work
            )
            condense_drive(system, state, carriage, mass_factor, rate_factor, work)
    if system.buffers.present:
        predict_contacts(system, state, rate_factor, stiffness_factor, work)
    for carriage in range(carriages.fixed.size):
        if rides(system, state, carriage):
            add_joint(system, state, carriage, rate_factor, stiffness_factor, work)
    add_towers(cable, system.towers, state, rate_factor, stiffness_factor, work)
    add_counterweights(system.counterweights, cable, state, mass_factor, rate_factor, stiffness_factor, work)


@inlined_kernel
def add_loads(cable, state, stiffness_factor, work):
    """Add given point forces along the cable, and moments on the slopes of its ends: M ∂pitch/∂r_x.

    Beside `continuum`, the tangent of a moment is left out. It balances what the tangent of bending leaves out there: M
    times the second derivative of the turn. One without the other is wrong by more the shorter the elements are.
    """
    like = cable.gravity
    for k in range(cable.load_arc_length.size):
        force, point = load(cable.load_force[k], like), point_at(cable, state, cable.load_arc_length[k])
        add_point_load(force, point, state, work)
        if cable.load_nodes and stiffness_factor != 0.0:
            constant = outer(0.0, like, like)
            nothing = constant, constant
            add_point_tangent(force, nothing, nothing, point, stiffness_factor, state, work)
    for end in range(2):
        moment = cable.end_moment[end]
        if moment != 0.0:
            node = 0 if end == 0 else cable.element_count
            x, z = state.nodes.position[node, 1, 0], state.nodes.position[node, 1, 1]
            squared = x * x + z * z
            work.right_side[node, 1, 0] += moment * z / squared
            work.right_side[node, 1, 1] -= moment * x / squared
            if cable.elastic_model != ELEMENT_FRAME:
                continue
            stiff = stiffness_factor * moment / (squared * squared)
            square = work.diagonal[node, 1, 1]
            square[0] += 2.0 * stiff * x * z
            square[1] -= stiff * (x * x - z * z)
            square[2] -= stiff * (x * x - z * z)
            square[3] -= 2.0 * stiff * x * z


@kernel
def hold_ends(cable, work):
    """Project the equations of both end nodes of a rope onto the free directions of their supports.

    With P the projector onto the free directions, row and column of the node become P K P + k (1 - P). k is as large as
    the entries beside it, since rounding of larger numbers would let smaller ones drift.
    """
    like = cable.gravity
    square = outer(0.0, like, like)
    identity = full(0.0, symmetric(0.0, 0.0, like), 1.0)
    last = cable.element_count
    for end in range(2):
        node = 0 if end == 0 else last
        out, back = (work.upper[0], work.lower[0]) if end == 0 else (work.lower[last - 1], work.upper[last - 1])
        for i in range(2):
            free_i = load(cable.end_projector[end, i], square)
            right = load(work.right_side[node, i], like)
            store(product(free_i, right), work.right_side[node, i])
            for j in range(2):
                free_j = load(cable.end_projector[end, j], square)
                inner = product(product(free_i, load(work.diagonal[node, i, j], square)), free_j)
                store(inner, work.diagonal[node, i, j])
                store(product(free_i, load(out[i, j], square)), out[i, j])
                store(product(load(back[i, j], square), free_j), back[i, j])
            size = 0.0
            for entry in range(work.diagonal.shape[3]):
                size = max(size, abs(work.diagonal[node, i, i, entry]))
            held = subtract(identity, free_i)
            accumulate(block(size if size > 0.0 else 1.0, held, 0.0), work.diagonal[node, i, i])


@inlined_kernel
def solve(system, state, work):
    """Solve the equations of one rope: nodal increments in `right_side`, others in `*_increment`; multipliers updated.

    Returns:
        False when the system has no solution.
    """
    like = system.cable.gravity
    if solve_block_tridiagonal(work.diagonal, work.upper, work.lower, work.right_side, like) >= 0:
        return False
    recover_patches(state, work, like)
    recover(system, state, work)
    return True


@inlined_kernel
def recover(system, state, work):
    """Recover the increments of all eliminated unknowns of a rope, from the nodal increments."""
    for carriage in range(system.carriages.fixed.size):
        if rides(system, state, carriage):
            moved = recover_joint(system, state, carriage, work)
            turned = recover_turn(system, state, carriage, work)
            recover_chain(system.carriages, state, carriage, moved, turned, work)
            recover_drive(state, carriage, moved, work)


@kernel
def solve_accelerations(system, state, feedback, work):
    """Solve eq. 16 as printed: all accelerations and multipliers of `state` from its coordinates and velocities.

    The multipliers that friction depends on are those of the call before. `feedback` (1/s) is that of
    `measure_gap_accelerations`.

    Returns:
        False when the system has no solution.
    """
    clear_array(state.nodes.acceleration)
    clear_array(state.bodies.acceleration)
    clear_array(work.turned)
    measure_gap_accelerations(system, state, feedback, work)
    assemble(system, state, 1.0, 0.0, 0.0, work)
    if not solve(system, state, work):
        return False
    copy_array(work.right_side, state.nodes.acceleration)
    copy_array(work.body_increment, state.bodies.acceleration)
    copy_array(work.sliding_increment, state.joints.acceleration)
    return True
