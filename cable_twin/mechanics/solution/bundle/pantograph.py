"""Pantograph: masses on springs with a head sliding along a rope from below, in one-sided contact.

The gap is measured upwards where the rope is above the head, g = z_0 - z(s) with x(s) = X. Its virtual work gives the
rope the force F (e_z - z'/x' e_x) there, which is normal to it: there is no friction. The stages are eliminated first,
F = k_c g being their only share in the equations of the rope.
"""

from __future__ import annotations

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import along_track
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, outer, scale
from cable_twin.mechanics.rope.point import add_force, add_tangent, bend, coordinate, point_at, slope, value
from cable_twin.mechanics.solution.bundle.records import STATE, SYSTEM, WORK

SEARCHES = 4  # Newton steps for the place above the head, from the one before


@kernel
def find_place(cable, state, arc_length, x):
    """Arc length (m) of a rope at `x` (m) along the track, by Newton's method from `arc_length`."""
    like, nodes = cable.gravity, state.nodes
    for _ in range(SEARCHES):
        point = point_at(cable, state, arc_length)
        arc_length += (x - value(nodes.position, point, like)[0]) / slope(nodes.position, point, like)[0]
        arc_length = min(max(arc_length, 0.0), cable.unstrained_length)
    return arc_length


@inlined_kernel
def push_direction(nodes, point, up, like):
    """Direction (dim,) of the push of a pantograph's head on the rope, with a vertical component of 1."""
    r_x = slope(nodes.position, point, like)
    return add_scaled(-dot(r_x, up) / r_x[0], along_track(like), up)


@inlined_kernel
def springs_and_inertia(pantographs, moving, pantograph, stage):
    """Upward force (N) of the springs and dampers on a stage of a pantograph, less the inertia of the stage."""
    z, z_dot = moving.stages.position[pantograph], moving.stages.velocity[pantograph]
    last = z.size - 1
    force = -pantographs.mass[pantograph, stage] * moving.stages.acceleration[pantograph, stage]
    if stage > 0:
        k, c = pantographs.stiffness[pantograph, stage - 1], pantographs.damping[pantograph, stage - 1]
        force -= k * (z[stage] - z[stage - 1]) + c * (z_dot[stage] - z_dot[stage - 1])
    k, c = pantographs.stiffness[pantograph, stage], pantographs.damping[pantograph, stage]
    if stage < last:
        return force - k * (z[stage] - z[stage + 1]) - c * (z_dot[stage] - z_dot[stage + 1])
    return force - k * z[stage] - c * z_dot[stage] + pantographs.base_force[pantograph]


@kernel
def add_pantographs(bundle, moving, scratch, system, state, work, mass_factor, rate_factor, stiffness_factor, like):
    """Condense all pantographs and add their contact to the ropes.

    Returns:
        Number of pantographs that have touched or lost their rope since the last call.
    """
    changed, up = 0, load(bundle.up, like)
    for pantograph in range(bundle.pantographs.rope.size):
        rope = bundle.pantographs.rope[pantograph]
        cable = record_at(bundle.records[rope, SYSTEM], system).cable
        here = record_at(bundle.records[rope, STATE], state)
        nodes = here.nodes
        own = record_at(bundle.records[rope, WORK], work)
        x = moving.place.position[pantograph]
        moving.arc_length[pantograph] = find_place(cable, here, moving.arc_length[pantograph], x)
        point = point_at(cable, here, moving.arc_length[pantograph])
        gap = moving.stages.position[pantograph, 0] - dot(value(nodes.position, point, like), up)
        under_rope = 0.0 < moving.arc_length[pantograph] < cable.unstrained_length  # and not past one of its ends
        touches = 1 if gap > 0.0 and under_rope else 0
        contact = bundle.pantographs.contact_stiffness[pantograph] if touches else 0.0
        force = contact * gap
        moving.contact_force[pantograph] = force
        factors = mass_factor, rate_factor, stiffness_factor
        given, share = condense_stages(bundle.pantographs, moving, scratch, pantograph, contact, force, factors)
        if touches:
            push = push_direction(nodes, point, up, like)
            add_force(scale(force + contact * stiffness_factor * given, push), point, own)
            stiff = stiffness_factor * contact * (1.0 - stiffness_factor * contact * share)
            add_push_tangent(nodes, point, push, stiff, stiffness_factor * force, own)
        place = bundle.connectors.length.size + pantograph
        changed += abs(touches - moving.tight[place])
        moving.tight[place] = touches
    return changed


@inlined_kernel
def add_push_tangent(nodes, point, push, stiff, force, own):
    """Add the tangent of a pantograph's push to the rope nodes beside it: by size, direction and place of the push.

    With x(s) = X at the head, Δs = -e_x·S Δe / x', and Δ(z'/x') = p·(S_x Δe + r_xx Δs) / x' of the direction p.

    Args:
        nodes: of the rope.
        point: above the head.
        push: p (dim,).
        stiff: growth of the push with the rope, N/m.
        force: the push, N.
        own: workspace of the rope.
    """
    level = along_track(push)
    per_x = 1.0 / slope(nodes.position, point, push)[0]
    turn = per_x * force
    bent = dot(push, bend(nodes.position, point, push))
    by_r = add_scaled(1.0, outer(stiff, push, push), outer(-turn * per_x * bent, level, level))
    nothing = outer(0.0, push, push)
    add_tangent((by_r, outer(turn, level, push)), (outer(turn, push, level), nothing), point, own)


@kernel
def condense_stages(pantographs, moving, scratch, pantograph, contact, force, factors):
    """Eliminate a pantograph's stages from the base up to the head; keep the factors for `recover_pantographs`.

    Returns:
        Increment of the head (m) if the rope stays, and its share (m/N) of a force on it.
    """
    mass_factor, rate_factor, stiffness_factor = factors
    stages = pantographs.mass.shape[1]
    below, right_below = 0.0, 0.0
    for stage in range(stages - 1, -1, -1):
        k, c = pantographs.stiffness[pantograph, stage], pantographs.damping[pantograph, stage]
        under = stiffness_factor * k + rate_factor * c
        pivot = mass_factor * pantographs.mass[pantograph, stage] + under
        right = springs_and_inertia(pantographs, moving, pantograph, stage)
        if stage < stages - 1:  # row of the stage below: below · Δz_(stage+1) - under · Δz_stage = right_below
            pivot -= under * under / below
            right += under * right_below / below
        if stage > 0:
            above = stiffness_factor * pantographs.stiffness[pantograph, stage - 1]
            pivot += above + rate_factor * pantographs.damping[pantograph, stage - 1]
        else:
            pivot += stiffness_factor * contact
            right -= force
        below, right_below = pivot, right
        scratch.elimination[pantograph, stage, 0] = pivot
        scratch.elimination[pantograph, stage, 1] = right
        scratch.elimination[pantograph, stage, 2] = under
    return right_below / below, 1.0 / below


@kernel
def recover_pantographs(bundle, moving, scratch, state, system, work, stiffness_factor, like):
    """Recover the increments of all pantograph stages from those of the ropes; return the largest (m)."""
    largest, up = 0.0, load(bundle.up, like)
    for pantograph in range(bundle.pantographs.rope.size):
        rope = bundle.pantographs.rope[pantograph]
        cable = record_at(bundle.records[rope, SYSTEM], system).cable
        here = record_at(bundle.records[rope, STATE], state)
        nodes = here.nodes
        own = record_at(bundle.records[rope, WORK], work)
        lifted = 0.0
        if moving.tight[bundle.connectors.length.size + pantograph]:
            point = point_at(cable, here, moving.arc_length[pantograph])
            push = push_direction(nodes, point, up, like)
            for i in range(4):
                lifted += point.shape[i] * dot(push, coordinate(own.right_side, point.element, i, like))
            lifted *= stiffness_factor * bundle.pantographs.contact_stiffness[pantograph]
        rows, before = scratch.elimination[pantograph], 0.0
        for stage in range(rows.shape[0]):
            extra = lifted if stage == 0 else rows[stage - 1, 2] * before
            before = (rows[stage, 1] + extra) / rows[stage, 0]
            scratch.increment[pantograph, stage] = before
            largest = max(largest, abs(before))
    return largest
