"""Tangent of bullwheels: rope over a wheel and travel of its carriage as unknowns of Newton's method, beside the ropes.

A wheel has two coordinates w: the rope u over it, where forces move the rope, and the travel y of its carriage, where a
counterweight pulls the carriage. All nodes of both strands depend on them: K Δe + G Δw = R, with G the columns of the
nodes. The end forces of the strands in the equations of the wheel are those of the end node before its support,
R - K Δe - G Δw there. So the ropes are solved for R and for the columns G at once, x - Z Δw, which leaves as many
equations as wheels have coordinates. Z hardly changes from step to step and is kept for some: that is Newton's method
with an older tangent for the increments of the wheels alone.

The stretch, by which rope over the wheel counts, and the tangent of the rope at its end are varied, too. Drives,
hydraulic cylinders and whether the rope slips are found before the iteration, and no part of it.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.addresses import record_at
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import add_array, copy_array
from cable_twin.mechanics.language.vectors import (
    accumulate,
    add_scaled,
    dot,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
    unit_matrix,
)
from cable_twin.mechanics.on_rope.load_node import follow_joints
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.rope.flow_tangent import add_flow_tangent, place_by_flow, share_of_end
from cable_twin.mechanics.rope.patch import at_node, beside_load, follows
from cable_twin.mechanics.rope.patch_assembly import add_patch_differences, shifts
from cable_twin.mechanics.rope.point import element_at, patch_row, point_at, slope
from cable_twin.mechanics.solution.bundle.bullwheels import (
    NOTHING,
    missing_rope,
    missing_travel,
    tension_shares,
)
from cable_twin.mechanics.solution.bundle.records import COUNTERWEIGHT, SERVES, STATE, SYSTEM, WORK, rope_of

ROPE, CARRIAGE = range(2)  # coordinates of a wheel, and columns of its block
LAGGING = 0.5  # of a wheel's increment, most that a kept response leaves wrong at any node
PART = 1e-5  # m, of rope over a wheel, for the difference that stands for a derivative beside loads


@kernel
def is_active(sheaves, motion, sheave, kind):
    """Return whether a coordinate of a bullwheel, rope or carriage, is an unknown in this step."""
    if kind == ROPE:
        return motion.by_forces[sheave] != NOTHING
    return sheaves.tensioning[sheave] == COUNTERWEIGHT


@kernel
def begin_wheels(bundle, moving, scratch, system, state, work, mass_factor, rate_factor):
    """Set up the columns of all bullwheels with unknown coordinates, in ropes and in uncondensed equations of loads.

    Bullwheels take part in time integration only, with a rate factor above 0. There are no columns to solve for where
    the response of an earlier iteration still serves.
    """
    sheaves, motion = bundle.sheaves, moving.sheaves
    scratch.slots[:] = 0
    scratch.lagging[0] = 0.0
    if sheaves.inertia.size == 0 or rate_factor == 0.0:
        moving.response.left[:] = 0
        return
    scratch.wheel_matrix[:] = 0.0
    scratch.slot[:] = -1
    for sheave in range(sheaves.inertia.size):
        if is_active(sheaves, motion, sheave, ROPE) or is_active(sheaves, motion, sheave, CARRIAGE):
            take_slots(bundle, scratch, sheave)
    if still_serves(bundle, moving, scratch, system, state, mass_factor):
        scratch.slots[:] = 0
        return
    active = False
    for rope in range(scratch.slots.size):
        active = active or scratch.slots[rope] > 0
    moving.response.left[0, 0] = SERVES if active else 0
    moving.response.wheels[:] = 0.0
    scratch.patch_columns[:] = 0.0
    clear_columns(bundle, scratch)
    for sheave in range(sheaves.inertia.size):
        if is_active(sheaves, motion, sheave, ROPE):
            for side in range(2):
                rope = sheaves.rope[sheave, side]
                own, here, room = rope_of(bundle, rope, system, state, work)
                if own.cable.load_nodes:
                    columns, slot = scratch.patch_columns, scratch.slot[sheave, rope]
                    add_patch_columns(own, here, room, 1 - side, mass_factor, rate_factor, columns, slot)


@kernel
def still_serves(bundle, moving, scratch, system, state, mass_factor):
    """Return whether the stored response of ropes to bullwheels is still valid; store present conditions.

    The response hardly changes from step to step, and a wheel's increment is small. Where a vehicle or a clamp comes to
    another element, bodies get another mass, a rope begins or ceases to slip, or other coordinates of wheels are
    unknown, it is computed anew.
    """
    response = moving.response
    serves = response.left[0, 0] > 0
    response.left[0, 0] = max(response.left[0, 0] - 1, 0)
    serves = is_as_noted(response.mass_factor[0], 0, mass_factor) and serves
    for sheave in range(bundle.sheaves.inertia.size):
        for kind in range(2):
            active = 1 if is_active(bundle.sheaves, moving.sheaves, sheave, kind) else 0
            noted = active + 2 * (1 + moving.sheaves.slipping[sheave])
            serves = is_as_noted(response.active[0], 2 * sheave + kind, noted) and serves
    first, here = record_at(bundle.records[0, SYSTEM], system), record_at(bundle.records[0, STATE], state)
    inertia = 0.0
    for body in range(first.carriages.mass.size):
        inertia += first.carriages.mass[body]
    serves = is_as_noted(response.inertia[0], 0, inertia) and serves
    for vehicle in range(here.vehicle_rope.size):
        place = -1
        if here.attached[vehicle]:
            place = 4 * (bundle.offset[here.vehicle_rope[vehicle]] + here.joint_element[vehicle])
            place += (1 if here.node_follows[vehicle] else 0) + (2 if here.clamp_holds[vehicle] else 0)
        serves = is_as_noted(response.joints[0], vehicle, place) and serves
    for clamp in range(bundle.clamps.rope.size):
        other, place = moving.clamp_rope[clamp], -1
        if other >= 0:
            cable = record_at(bundle.records[other, SYSTEM], system).cable
            there = record_at(bundle.records[other, STATE], state)
            place = bundle.offset[other] + element_at(cable, there, moving.clamp_place[clamp])
        serves = is_as_noted(response.clamps[0], clamp, place) and serves
    return serves


@inlined_kernel
def is_found_now(response):
    """Return whether the response of the ropes to their bullwheels is computed in this iteration, not reused."""
    return response.left[0, 0] == SERVES


@inlined_kernel
def is_as_noted(noted, row, value):
    """Return whether `value` equals the one stored in a row of `noted`, and store it there."""
    same = noted[row] == value
    noted[row] = value
    return same


@kernel
def add_wheels(bundle, moving, scratch, system, state, work, mass_factor, rate_factor):
    """Linearise all bullwheels with unknown coordinates; needs assembled, uncoupled ropes.

    Their columns get the derivatives by rope over the wheel, their equations the forces at the ends of the strands.
    """
    sheaves, motion = bundle.sheaves, moving.sheaves
    for rope in range(scratch.slots.size):
        own, here, _ = rope_of(bundle, rope, system, state, work)
        if own.cable.load_nodes and scratch.slots[rope] > 0:
            wheel_columns = scratch.wheel_columns[bundle.offset[rope] : bundle.offset[rope + 1]]
            carry_columns(here, scratch.patch_columns, scratch.slots[rope], wheel_columns, own.cable.gravity)
    for sheave in range(sheaves.inertia.size):
        if is_active(sheaves, motion, sheave, ROPE) and is_found_now(moving.response):
            for side in range(2):
                rope = sheaves.rope[sheave, side]
                own, here, room = rope_of(bundle, rope, system, state, work)
                columns = scratch.wheel_columns[bundle.offset[rope] : bundle.offset[rope + 1]]
                slot = scratch.slot[sheave, rope]
                add_flow_tangent(own, here, 1 - side, mass_factor, rate_factor, columns, slot, room)
                add_vehicles_and_towers(own, here, room, 1 - side, columns, slot)
    for sheave in range(sheaves.inertia.size):
        read_ends(bundle, motion, sheave, system, state, work)
    for sheave in range(sheaves.inertia.size):
        write_equations(bundle, moving, scratch, sheave, system, state, work, mass_factor, rate_factor)


@kernel
def add_patch_columns(system, state, work, end, mass_factor, rate_factor, patch_columns, slot):
    """Add the derivative, by rope over one end, of elements beside loads to the columns of loads' equations (patches).

    The change of the element forces is a finite difference, with `PART` (m) of rope. A load that is clamped to the rope
    moves along with it, also where it is on such an element without a node of its own.
    """
    cable, like, count = system.cable, system.cable.gravity, work.patch_count[0]
    dim = len(like)
    keep_joints(state, work)
    kept = shift_rope(state, end, PART, mass_factor, rate_factor)
    shift_clamped(system, state, work, end, PART, mass_factor, rate_factor)
    add_patch_differences(system, state, count, -1.0 / PART, patch_columns, slot, work)
    set_rope(state, end, kept)
    put_joints_back(state, work)
    for node in range(1, state.node_load.size - 1):
        number = state.node_load[node]
        if number >= 0:
            for row in range(work.patch_force.shape[1]):
                patch_columns[number, row, slot] += work.patch_force[number, row] / PART
    for carriage in range(system.carriages.fixed.size):
        if not rides(system, state, carriage):
            continue
        if at_node(cable, state, carriage) and work.along_held[carriage]:
            way = place_by_flow(cable, state, end, state.joints.position[carriage])
            patch_columns[carriage, 5 * dim, slot] = -way if system.carriages.clamped[carriage] else 0.0
        elif goes_along(system, state, carriage) and beside_load(cable, state, state.joint_element[carriage]):
            way = place_by_flow(cable, state, end, state.joints.position[carriage])
            element = state.joint_element[carriage]
            number, right = work.patch_of[element], work.patch_right[element]
            for i in range(4):
                force = scale(way, load(work.sliding_column[carriage, i], like))
                accumulate(force, patch_columns[number, patch_row(right, i, dim) :, slot])


@inlined_kernel
def goes_along(system, state, carriage):
    """Return whether a vehicle is clamped to the rope within an element, not at a node that follows it."""
    clamped, riding = system.carriages.clamped[carriage], rides(system, state, carriage)
    return clamped and riding and not at_node(system.cable, state, carriage)


@inlined_kernel
def shift_rope(state, end, way, mass_factor, rate_factor):
    """Let a length `way` (m) of rope run over one end; return the former travel, speed and acceleration there."""
    kept = state.rope.position[end], state.rope.velocity[end], state.rope.acceleration[end]
    set_rope(state, end, (kept[0] + way, kept[1] + rate_factor * way, kept[2] + mass_factor * way))
    return kept


@kernel
def keep_joints(state, work):
    """Store the motion of all vehicles' joints along the rope, for `put_joints_back`."""
    for carriage in range(work.along_kept.shape[0]):
        work.along_kept[carriage, 0] = state.joints.position[carriage]
        work.along_kept[carriage, 1] = state.joints.velocity[carriage]
        work.along_kept[carriage, 2] = state.joints.acceleration[carriage]


@kernel
def put_joints_back(state, work):
    """Restore the motion of all vehicles' joints along the rope, and of their nodes, from `keep_joints`."""
    for carriage in range(work.along_kept.shape[0]):
        state.joints.position[carriage] = work.along_kept[carriage, 0]
        state.joints.velocity[carriage] = work.along_kept[carriage, 1]
        state.joints.acceleration[carriage] = work.along_kept[carriage, 2]
    follow_joints(state)


@kernel
def shift_clamped(system, state, work, end, travel, mass_factor, rate_factor):
    """Move the nodes that follow vehicles clamped to the rope along with a `travel` (m) of rope over one end."""
    for node in range(1, state.node_load.size - 1):
        carriage = state.node_load[node]
        held = carriage >= 0 and follows(state, node) and not shifts(state, work, node)
        if held and system.carriages.clamped[carriage]:
            gone = travel * place_by_flow(system.cable, state, end, work.along_kept[carriage, 0])
            state.joints.position[carriage] += gone
            state.joints.velocity[carriage] += rate_factor * gone
            state.joints.acceleration[carriage] += mass_factor * gone
    follow_joints(state)


@inlined_kernel
def set_rope(state, end, course):
    """Set travel (m), speed (m/s) and acceleration (m/s²) of the rope over one end of a strand."""
    state.rope.position[end], state.rope.velocity[end], state.rope.acceleration[end] = course


@kernel
def carry_columns(state, columns, count, wheel_columns, like):
    """Add the condensed bullwheel columns of loads to the columns of the nodes beside the loads."""
    dim, first = len(like), 0
    for node in range(1, state.node_load.size - 1):
        number = state.node_load[node]
        if number >= 0:
            if state.node_load[node - 1] < 0:
                first = node
            if state.node_load[node + 1] < 0:
                for slot in range(count):
                    for i in range(2 * dim):
                        entry = (i % dim) * dim
                        wheel_columns[first - 1, slot, i // dim, entry] += columns[number, i, slot]
                        wheel_columns[node + 1, slot, i // dim, entry] += columns[number, 5 * dim + 1 + i, slot]


@kernel
def take_slots(bundle, scratch, sheave):
    """Assign a free block of columns to a bullwheel in all ropes that are coupled to its two strands."""
    line = bundle.order.line
    first, second = line[bundle.sheaves.rope[sheave, 0]], line[bundle.sheaves.rope[sheave, 1]]
    for rope in range(line.size):
        if line[rope] == first or line[rope] == second:
            scratch.slot[sheave, rope] = scratch.slots[rope]
            scratch.slots[rope] += 1


@kernel
def clear_columns(bundle, scratch):
    """Clear the bullwheel columns, as far as in use, of all ropes and clamps."""
    for rope in range(scratch.slots.size):
        if scratch.slots[rope] > 0:
            scratch.wheel_columns[bundle.offset[rope] : bundle.offset[rope + 1], : scratch.slots[rope]] = 0.0
    scratch.clamp_columns[:] = 0.0


@kernel
def add_vehicles_and_towers(system, state, work, end, wheel_columns, slot):
    """Add to a column the derivative, by rope over one end, of clamped vehicles and of tower friction."""
    cable, towers, like = system.cable, system.towers, system.cable.gravity
    for carriage in range(system.carriages.fixed.size):
        beside = beside_load(cable, state, state.joint_element[carriage])
        if goes_along(system, state, carriage) and not beside:
            way = place_by_flow(cable, state, end, state.joints.position[carriage])
            for i in range(4):
                force = scale(way, load(work.sliding_column[carriage, i], like))
                accumulate(force, wheel_columns[state.joint_element[carriage] + i // 2, slot, i % 2, :: len(like)])
    for contact in range(towers.stiffness.size):
        place = state.contact_arc_length[contact]
        if work.contact_slide[contact] != 0.0:
            point = point_at(cable, state, place)
            if not beside_load(cable, state, point.element):
                less = share_of_end(cable, end, place)  # rope before it than there was
                pull = scale(work.contact_slide[contact] * less, slope(state.nodes.position, point, like))
                for i in range(4):
                    column = wheel_columns[point.element + i // 2, slot, i % 2, :: len(like)]
                    accumulate(scale(point.shape[i], pull), column)


@inlined_kernel
def end_of(bundle, sheave, side, system, state, work):
    """Strand end at one side of a bullwheel: rope, end node, node next to it, parameters, state, workspace."""
    rope = bundle.sheaves.rope[sheave, side]
    own, here, room = rope_of(bundle, rope, system, state, work)
    node = own.cable.element_count if side == 0 else 0
    return rope, node, node - 1 if side == 0 else 1, own, here, room


@inlined_kernel
def unit_tangent(state, node, like):
    """Unit tangent (dim,) of a rope at a node, and the length of r_x."""
    r_x = load(state.nodes.position[node, 1], like)
    norm = sqrt(dot(r_x, r_x))
    return scale(1.0 / norm, r_x), norm


@kernel
def read_ends(bundle, motion, sheave, system, state, work):
    """Update tensions, stretch and pull of both strands at a bullwheel, from the residuals of their end nodes."""
    sheaves, like, pull, stretch = bundle.sheaves, system.cable.gravity, 0.0, 1.0
    direction = load(sheaves.direction[sheave], like)
    for side in range(2):
        _, node, _, own, here, room = end_of(bundle, sheave, side, system, state, work)
        force, along = load(room.right_side[node, 0], like), unit_tangent(here, node, like)[0]
        motion.tension[sheave, side] = -dot(force, along) if side == 0 else dot(force, along)
        stretch += 0.5 * motion.tension[sheave, side] / own.cable.axial_stiffness
        stretch += 0.5 * (own.cable.free_stretch - 1.0)
        pull -= dot(force, direction)
    motion.pull[sheave], motion.stretch[sheave] = pull, stretch


@kernel
def write_equations(bundle, moving, scratch, sheave, system, state, work, mass_factor, rate_factor):
    """Write the equations of a bullwheel: right side, tangent by its own coordinates and by both strand ends."""
    sheaves, motion, like, first = bundle.sheaves, moving.sheaves, system.cable.gravity, 2 * sheave
    right, matrix = scratch.wheel_increment, scratch.wheel_matrix
    right[first : first + 2] = 0.0
    matrix[first, first], matrix[first + 1, first + 1] = 1.0, 1.0
    on_rope, on_carriage = is_active(sheaves, motion, sheave, ROPE), is_active(sheaves, motion, sheave, CARRIAGE)
    if on_rope:
        right[first], matrix[first, first] = missing_rope(sheaves, motion, sheave, mass_factor)
    if on_carriage:
        found = missing_travel(sheaves, motion, sheave, mass_factor, rate_factor)
        right[first + 1], matrix[first + 1, first + 1] = found
    direction, square = load(sheaves.direction[sheave], like), outer(0.0, like, like)
    on, off = tension_shares(sheaves, motion, sheave)
    pulled = off * motion.tension[sheave, 1] - on * motion.tension[sheave, 0]
    for side in range(2):
        rope, node, _, own, here, room = end_of(bundle, sheave, side, system, state, work)
        along, norm = unit_tangent(here, node, like)
        force = load(room.right_side[node, 0], like)
        turning = scale(1.0 / norm, add_scaled(-dot(force, along), along, force))
        row = room.lower[node - 1] if side == 0 else room.upper[0]
        share = motion.stretch[sheave] * on if side == 0 else -motion.stretch[sheave] * off
        share -= 0.5 * pulled / own.cable.axial_stiffness
        share = share if side == 0 else -share  # of what the node is pulled with along the rope
        for kind in range(2):
            active = on_rope if kind == ROPE else on_carriage
            weight = scale(share, along) if kind == ROPE else direction
            weight = scale(1.0 if active else 0.0, weight)
            rows = scratch.wheel_row[sheave, side, kind]
            store(product(weight, load(room.diagonal[node, 0, 1], square)), rows[0])
            store(product(weight, load(row[0, 0], square)), rows[1])
            store(product(weight, load(row[0, 1], square)), rows[2])
            if kind == ROPE and active:
                store(subtract(load(rows[0], like), scale(share, turning)), rows[0])
            if is_active(sheaves, motion, sheave, CARRIAGE):
                by_travel = product(load(room.diagonal[node, 0, 0], square), direction)
                matrix[first + kind, first + 1] += dot(weight, by_travel)
            for other in range(sheaves.inertia.size if is_found_now(moving.response) else 0):
                if is_active(sheaves, motion, other, ROPE) and scratch.slot[other, rope] >= 0:
                    column = scratch.wheel_columns[bundle.offset[rope] + node, scratch.slot[other, rope], 0]
                    by_rope = dot(weight, load(column[:: len(like)], like))
                    moving.response.wheels[0, first + kind, 2 * other] += by_rope


@kernel
def add_travel(bundle, moving, scratch, system, state, work):
    """Add derivatives by carriage travel, and clamps, to the columns of bullwheels; then project these at the supports.

    Needs all couplings of ropes assembled, before supports hold the ropes.
    """
    if not is_found_now(moving.response):
        return
    sheaves, like = bundle.sheaves, system.cable.gravity
    square = outer(0.0, like, like)
    add_clamped(bundle, moving, scratch, system, state, work)
    for sheave in range(sheaves.inertia.size):
        if is_active(sheaves, moving.sheaves, sheave, CARRIAGE):
            direction = load(sheaves.direction[sheave], like)
            for side in range(2):
                rope, node, beside, _, _, room = end_of(bundle, sheave, side, system, state, work)
                at, slot = bundle.offset[rope], scratch.slot[sheave, rope]
                column = room.upper[node - 1] if side == 0 else room.lower[0]
                for i in range(2):
                    force = product(load(room.diagonal[node, i, 0], square), direction)
                    accumulate(force, scratch.wheel_columns[at + node, slot, i, 1 :: len(like)])
                    force = product(load(column[i, 0], square), direction)
                    accumulate(force, scratch.wheel_columns[at + beside, slot, i, 1 :: len(like)])
    for rope in range(scratch.slots.size):
        cable = record_at(bundle.records[rope, SYSTEM], system).cable
        for slot in range(scratch.slots[rope]):
            for end in range(2):
                node = bundle.offset[rope] + (0 if end == 0 else cable.element_count)
                for i in range(2):
                    free, column = load(cable.end_projector[end, i], square), scratch.wheel_columns[node, slot, i]
                    store(product(free, load(column, square)), column)


@kernel
def add_clamped(bundle, moving, scratch, system, state, work):
    """Add clamps to the columns of bullwheels on their strands: derivatives by rope and carriage travel."""
    sheaves, like = bundle.sheaves, system.cable.gravity
    for clamp in range(bundle.clamps.rope.size):
        rope = moving.clamp_rope[clamp]
        if rope < 0:
            continue
        own, here, _ = rope_of(bundle, rope, system, state, work)
        place, carriage = moving.clamp_place[clamp], bundle.clamps.carriage[clamp]
        held = point_at(own.cable, here, place)
        r_x = slope(here.nodes.position, held, like)
        force = add_scaled(moving.rail_mass[clamp], like, load(here.clamp_force[carriage], like))
        for sheave in range(sheaves.inertia.size):
            slot, gap = scratch.slot[sheave, rope], scratch.clamp_columns[clamp]
            for side in range(2):
                if sheaves.rope[sheave, side] != rope:
                    continue
                if is_active(sheaves, moving.sheaves, sheave, ROPE):
                    way = place_by_flow(own.cable, here, 1 - side, place)
                    accumulate(scale(-way, r_x), gap[slot, 0, :: len(like)])
                    for i in range(4):
                        node = bundle.offset[rope] + held.element + i // 2
                        pulled = scale(way * held.shape_x[i], force)
                        accumulate(pulled, scratch.wheel_columns[node, slot, i % 2, :: len(like)])
                node = own.cable.element_count if side == 0 else 0
                if is_active(sheaves, moving.sheaves, sheave, CARRIAGE) and 0 <= node - held.element <= 1:
                    moved = scale(-held.shape[2 * (node - held.element)], load(sheaves.direction[sheave], like))
                    accumulate(moved, gap[slot, 0, 1 :: len(like)])


@kernel
def recover_wheels(bundle, moving, scratch, system, state, work):
    """Increments of all bullwheels from the solutions of the ropes, in `wheel_increment`, and the ropes' response.

    The response is kept; an increment from an earlier response has an error of `LAGGING` times itself at most.

    Returns:
        Whether the equations of the wheels have a solution, and its largest increment (m).
    """
    sheaves, motion, response, largest = bundle.sheaves, moving.sheaves, moving.response, 0.0
    if is_found_now(response):
        copy_array(scratch.wheel_columns, response.of_nodes[0])
        copy_array(scratch.clamp_columns, response.of_clamps[0])
        copy_array(scratch.patch_columns, response.of_loads[0])
    for sheave in range(sheaves.inertia.size):
        subtract_ropes(bundle, response, scratch, sheave, system, state, work)
    add_array(response.wheels[0], scratch.wheel_matrix)
    if not solve_dense(scratch.wheel_matrix, scratch.wheel_increment):
        return False, largest
    for sheave in range(sheaves.inertia.size):
        moved, travelled = scratch.wheel_increment[2 * sheave], scratch.wheel_increment[2 * sheave + 1]
        largest = max(largest, abs(moved), abs(travelled))
        answer_wheel(bundle, moving, scratch, sheave, system, state, work)
        if is_active(sheaves, motion, sheave, ROPE):
            for side in range(2):
                own, here, room = rope_of(bundle, sheaves.rope[sheave, side], system, state, work)
                carry_vehicles(own, here, room, 1 - side, moved)
    scratch.lagging[0] = 0.0 if is_found_now(response) else LAGGING * largest
    return True, largest


@kernel
def subtract_ropes(bundle, response, scratch, sheave, system, state, work):
    """Subtract the solutions of both strands from the equations of a bullwheel."""
    like = system.cable.gravity
    for side in range(2):
        rope, node, beside, _, _, room = end_of(bundle, sheave, side, system, state, work)
        for kind in range(2):
            row, rows = 2 * sheave + kind, scratch.wheel_row[sheave, side, kind]
            for k in range(3):
                where, i = (node, 1) if k == 0 else (beside, k - 1)
                by = load(rows[k], like)
                scratch.wheel_increment[row] -= dot(by, load(room.right_side[where, i], like))
                for other in range(bundle.sheaves.inertia.size if is_found_now(response) else 0):
                    slot = scratch.slot[other, rope]
                    if slot >= 0:
                        columns = response.of_nodes[0, bundle.offset[rope] + where, slot, i]
                        for j in range(2):
                            column = load(columns[j :: len(like)], like)
                            response.wheels[0, row, 2 * other + j] -= dot(by, column)


@kernel
def answer_wheel(bundle, moving, scratch, sheave, system, state, work):
    """Subtract the response to the increments of a bullwheel from the solutions of all coupled ropes and clamps."""
    like = system.cable.gravity
    axes, square, response = unit_matrix(like), outer(0.0, like, like), moving.response
    moved, travelled = scratch.wheel_increment[2 * sheave], scratch.wheel_increment[2 * sheave + 1]
    increments = add_scaled(-moved, axes[0], scale(-travelled, axes[1]))
    for rope in range(scratch.slots.size):
        slot, at = scratch.slot[sheave, rope], bundle.offset[rope]
        if slot >= 0:
            right_side = record_at(bundle.records[rope, WORK], work).right_side
            for node in range(right_side.shape[0]):
                for i in range(2):
                    answer = product(load(response.of_nodes[0, at + node, slot, i], square), increments)
                    accumulate(answer, right_side[node, i])
            own, here, room = rope_of(bundle, rope, system, state, work)
            for node in range(here.node_load.size if own.cable.load_nodes else 0):
                number = here.node_load[node]
                if number >= 0:
                    for row in range(2 * len(like), 5 * len(like) + 1):
                        by_rope = response.of_loads[0, number, row, slot]
                        room.patch[number, row, room.patch.shape[1]] -= moved * by_rope
    for clamp in range(bundle.clamps.rope.size):
        slot = scratch.slot[sheave, bundle.clamps.rope[clamp]]
        if slot >= 0 and moving.clamp_rope[clamp] >= 0:
            for i in range(2):
                answer = product(load(response.of_clamps[0, clamp, slot, i], square), increments)
                accumulate(answer, scratch.clamp_right[clamp, i])


@kernel
def carry_vehicles(system, state, work, end, travel):
    """Add a `travel` (m) of rope over one end to the joint increments of all vehicles clamped to the strand."""
    for carriage in range(system.carriages.fixed.size):
        if system.carriages.clamped[carriage] and rides(system, state, carriage):
            place = state.joints.position[carriage]
            work.sliding_right[carriage] += travel * place_by_flow(system.cable, state, end, place)


@kernel
def solve_dense(matrix, right):
    """Solve a small dense linear system in place by elimination with row pivots; return whether it is solvable."""
    size = right.size
    for k in range(size):
        pivot = k
        for row in range(k + 1, size):
            if abs(matrix[row, k]) > abs(matrix[pivot, k]):
                pivot = row
        if not abs(matrix[pivot, k]) > 0.0:
            return False
        for column in range(k, size):
            matrix[k, column], matrix[pivot, column] = matrix[pivot, column], matrix[k, column]
        right[k], right[pivot] = right[pivot], right[k]
        for row in range(k + 1, size):
            factor = matrix[row, k] / matrix[k, k]
            for column in range(k + 1, size):
                matrix[row, column] -= factor * matrix[k, column]
            right[row] -= factor * right[k]
    for k in range(size - 1, -1, -1):
        for column in range(k + 1, size):
            right[k] -= matrix[k, column] * right[column]
        right[k] /= matrix[k, k]
    return True
