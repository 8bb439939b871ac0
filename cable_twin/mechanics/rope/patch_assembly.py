"""Assembly of the elements beside moving loads: residual and tangent in the patch of each load; see `patch`."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.memory import clear_array
from cable_twin.mechanics.language.simd import (
    WIDTH,
    add_diagonal,
    add_spread,
    gather_listed,
    gather_numbers_listed,
    gather_vectors_listed,
    read_square,
    read_vector,
    spread,
    turn_lanes,
)
from cable_twin.mechanics.language.traced import Vec, formula
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    block,
    dot,
    load,
    outer,
    product,
    scale,
    store,
    subtract,
)
from cable_twin.mechanics.rope.ale import mesh_dilution_rate, nodal_vectors, rest_stretch
from cable_twin.mechanics.rope.elastic_models import elastic_force
from cable_twin.mechanics.rope.element import inertia, rates_of_strain, with_damping, write_group
from cable_twin.mechanics.rope.patch import (
    bend_rates,
    by_length,
    follows,
    forces_along,
    forces_by_motion,
    is_driven,
    rope_motion,
    rope_past,
    shift_vectors,
    with_passing_rope,
)
from cable_twin.mechanics.rope.point import add_column, add_matrix, add_row, patch_row
from cable_twin.mechanics.rope.rope_drag import add_drag
from cable_twin.mechanics.rope.shape_functions import MASS, block_row, vector_row


@kernel
def begin_patches(state, work):
    """Find the elements beside moving loads, clear their patches, and find which loads have a prescribed arc length.

    Needs the gaps measured (`measure_gaps`): they are the increments of joints that follow a reference.
    """
    count = 0
    for element in range(work.patch_of.size):
        work.patch_of[element], state.mesh.plain[element] = -1, 1.0
    for node in range(1, state.node_load.size - 1):
        number = state.node_load[node]
        if number >= 0:
            clear_array(work.patch[number])
            driven = is_driven(state, number)
            work.along_held[number] = driven or not state.node_follows[number]
            work.along_increment[number] = work.sliding_increment[number] if driven else 0.0
            if state.node_load[node - 1] < 0:
                work.patch_of[node - 1], work.patch_right[node - 1] = number, 0
                state.mesh.plain[node - 1] = 0.0
                work.patch_elements[count] = node - 1
                count += 1
            work.patch_of[node], work.patch_right[node] = number, 1
            state.mesh.plain[node] = 0.0
            work.patch_elements[count] = node
            count += 1
    list_elements(work, count)


@kernel
def list_elements(work, count):
    """List the elements not beside a load; pad that list, and that of `count` beside loads, to whole groups."""
    work.patch_count[0] = count
    for k in range(count, -(-count // WIDTH) * WIDTH):
        work.patch_elements[k] = work.patch_elements[count - 1]
    plain = 0
    for element in range(work.patch_of.size):
        if work.patch_of[element] < 0:
            work.plain_elements[plain] = element
            plain += 1
    work.plain_count[0] = plain
    for k in range(plain, -(-plain // WIDTH) * WIDTH):
        work.plain_elements[k] = work.plain_elements[plain - 1]


@inlined_kernel
def shifts(state, work, node):
    """Return whether a Newton iteration moves a node along the rope, not counting the motion of rope over mesh ends."""
    number = state.node_load[node]
    return follows(state, node) and not (work.along_held[number] and work.along_increment[number] == 0.0)


@kernel
def add_patches(system, state, mass_factor, rate_factor, stiffness_factor, work):
    """Add residual and tangent of all elements beside moving loads to their patches, `WIDTH` elements at a time."""
    count = work.patch_count[0]
    for first in range(0, count, WIDTH):
        nodal_motion, shifted = gather_motion(system, state, first, work), any_shifted(state, work, first)
        linearise_patches(system, state, nodal_motion, shifted, mass_factor, rate_factor, stiffness_factor, work)
        turn_lanes(work.group, work.elements, system.cable.gravity)
        for lane in range(min(WIDTH, count - first)):
            element = work.patch_elements[first + lane]
            add_patch_element(system, state, element, lane, mass_factor, rate_factor, stiffness_factor, work)
    if system.moving_cable.over_bullwheels:
        keep_patch_forces(state, work)


@inlined_kernel
def keep_patch_forces(state, work):
    """Store the forces of the elements beside each moving load, before other forces are added to the patches."""
    last = work.patch.shape[1]
    for node in range(1, state.node_load.size - 1):
        number = state.node_load[node]
        if number >= 0:
            for row in range(last):
                work.patch_force[number, row] = work.patch[number, row, last]


@inlined_kernel
def gather_motion(system, state, first, work):
    """Rope motion on `WIDTH` elements beside loads, as SIMD lanes; their lengths, wind and passing speeds go to `work`.

    Returns:
        Nodal vectors, and velocities and accelerations of the rope, as of `motion_of_rope`.
    """
    like, rows, elements = system.cable.gravity, work.patch_motion, work.patch_elements
    for lane in range(WIDTH):
        element = elements[first + lane]
        k_a, k_a_dot, speed_a = rope_past(system, state, element)
        k_b, k_b_dot, speed_b = rope_past(system, state, element + 1)
        store((k_a, k_b, k_a_dot, k_b_dot, speed_b - speed_a), rows[len(like) + 1 :, lane])
    length = gather_numbers_listed(state.mesh.length, elements, first)
    spread((length,), rows, 0)
    spread(gather_vectors_listed(state.wind_field.along_rope, elements, first, like), rows, 1)
    k_a, k_b, k_a_dot, k_b_dot, grows = read_vector(rows, len(like) + 1, (0.0, 0.0, 0.0, 0.0, 0.0))
    e = gather_listed(state.nodes.position, elements, first, like)
    rates = gather_listed(state.nodes.velocity, elements, first, like)
    accelerations = gather_listed(state.nodes.acceleration, elements, first, like)
    spreads = 0.0
    if system.moving_cable.moving:
        spreads = -mesh_dilution_rate(system.cable, state)
    v, a = rope_motion(length, grows, e, rates, accelerations, (k_a, k_a_dot), (k_b, k_b_dot), spreads)
    return e, v, a


@inlined_kernel
def any_shifted(state, work, first):
    """Return whether a Newton iteration moves any node of `WIDTH` elements beside moving loads along the rope."""
    found = False
    for lane in range(WIDTH):
        element = work.patch_elements[first + lane]
        found = found or shifts(state, work, element) or shifts(state, work, element + 1)
    return found


@inlined_kernel
def force_patches(system, state, nodal_motion, shifted, work):
    """Write the nodal forces of a gathered group of elements beside moving loads to the vectors of `work.group`.

    Where the iteration moves any of their nodes along the rope (`shifted`), the forces Q_X go to its first block.
    """
    like, rows = system.cable.gravity, work.patch_motion
    length, wind = read_vector(rows, 0, (0.0,))[0], read_vector(rows, 1, like)
    passing = read_vector(rows, len(like) + 1, (0.0, 0.0))
    parts = forces_by_motion(system, state, length, nodal_motion, wind)
    forces = with_passing_rope(system, state, parts, nodal_motion, passing)
    for i in range(4):
        spread(forces[i], work.group, vector_row(i, like))
    if shifted:
        spread(forces_along(system, state, length, parts, nodal_motion, passing), work.group, block_row(0, 0, like))


@kernel
def add_patch_differences(system, state, count, share, patch_columns, slot, work):
    """Add `share` times nodal forces, -`share` times forces Q_X along the rope, of elements beside loads to patches.

    Args:
        system: parameters.
        state: of the rope.
        count: of elements beside loads.
        share: factor.
        patch_columns: (vehicles, rows, columns), is added to.
        slot: number of the column.
        work: with the patches.
    """
    like = system.cable.gravity
    dim = len(like)
    for first in range(0, count, WIDTH):
        nodal_motion, shifted = gather_motion(system, state, first, work), any_shifted(state, work, first)
        force_patches(system, state, nodal_motion, shifted, work)
        for lane in range(min(WIDTH, count - first)):
            element = work.patch_elements[first + lane]
            number, right = work.patch_of[element], work.patch_right[element]
            for i in range(4):
                row, entry = patch_row(right, i, dim), vector_row(i, like)
                for axis in range(dim):
                    patch_columns[number, row + axis, slot] += share * work.group[entry + axis, lane]
            for end in range(2):
                if shifts(state, work, element + end):
                    along = work.group[block_row(0, 0, like) + end, lane]
                    patch_columns[number, shift_row(right, end, dim), slot] -= share * along


@inlined_kernel
def linearise_patches(system, state, nodal_motion, shifted, mass_factor, rate_factor, stiffness_factor, work):
    """Linearise `WIDTH` elements beside loads: write residual, tangent and elastic part of them to groups in `work`.

    Takes the `nodal_motion` of `gather_motion`. Where the iteration moves any of their nodes (`shifted`), derivatives
    of the elastic energy by length are stored, too.
    """
    cable, like, group, elastic_group = system.cable, system.cable.gravity, work.group, work.patch_elastic
    rows, stretch = work.patch_motion, rest_stretch(cable, state)
    length, (e, v, a) = read_vector(rows, 0, (0.0,))[0], nodal_motion
    shape = subtract(e[2], e[0]), scale(length, e[1]), scale(length, e[3])
    at_rest = stretch * length
    still = scale(0.0, shape[0])
    elastic = elastic_force(cable, at_rest, *shape, still, still, still, 0.0, stiffness_factor)
    write_group(cable, length, elastic, (still, still, still, still), 0.0, elastic_group)
    if cable.damping_time > 0.0:
        taken_in = mesh_dilution_rate(cable, state)
        rates = subtract(v[2], v[0]), scale(length, v[1]), scale(length, v[3])
        rates = rates_of_strain(taken_in, shape, rates)
        elastic = elastic_force(cable, at_rest, *shape, *rates, rate_factor, stiffness_factor)
    inert = inertia(cable, length, stretch, *with_damping(cable, a, v))
    write_group(cable, length, elastic, inert, (mass_factor + cable.mass_damping * rate_factor) * stretch, group)
    if system.air.present:
        wind = read_vector(rows, 1, like)
        add_drag(system.air.rope_drag, wind, length, shape, v, rate_factor, stiffness_factor, group)
    k_a, k_b, k_a_dot, k_b_dot, grows = read_vector(rows, len(like) + 1, (0.0, 0.0, 0.0, 0.0, 0.0))
    mass = cable.mass_per_length * stretch
    if rate_factor > 0.0:
        per_rate = stiffness_factor / rate_factor
        convect_damping(length, mass, mass_factor, per_rate, k_a, k_b, group, elastic_group, like)
    before, after = (k_a, k_a_dot), (k_b, k_b_dot)
    convect(length, mass, grows, before, after, rate_factor, stiffness_factor, group, like)
    if shifted:
        first, second, by_d, by_a, by_b = by_length(cable, at_rest, *shape)
        spread((first, second), work.patch_by_length, 0)
        spread(by_d, work.patch_by_length, 2)
        spread(by_a, work.patch_by_length, 2 + len(like))
        spread(by_b, work.patch_by_length, 2 + 2 * len(like))


@inlined_kernel
def add_patch_element(system, state, element, lane, mass_factor, rate_factor, stiffness_factor, work):
    """Add one element of a SIMD group to its load's equations (patch), with rows for nodes that follow loads."""
    cable, like = system.cable, system.cable.gravity
    dim, square = len(like), outer(0.0, like, like)
    number, right = work.patch_of[element], work.patch_right[element]
    patch, last = work.patch[number], work.patch.shape[1]
    length, mass = state.mesh.length[element], cable.mass_per_length * rest_stretch(cable, state)
    e = nodal_vectors(state.nodes.position, element, like)
    rates = nodal_vectors(state.nodes.velocity, element, like)
    k = load(work.patch_motion[dim + 1 :, lane], (0.0, 0.0))
    grows = work.patch_motion[dim + 5, lane]
    add_numbers(work.elements[lane], patch, right, last, like)
    for end in range(2):  # momentum of rope that passes the node
        sign = 1.0 if end == 0 else -1.0
        flux, slope = sign * mass * k[end] * k[end], e[1] if end == 0 else e[3]
        if flux != 0.0:
            row = patch_row(right, 2 * end, dim)
            add_column(scale(-flux, slope), patch, row, last)
            turned = block(0.0, square, stiffness_factor * flux)
            add_matrix(turned, patch, row, patch_row(right, 2 * end + 1, dim))
            if shifts(state, work, element + end):
                by_speed = scale(-2.0 * sign * mass * k[end] * rate_factor, slope)
                add_column(by_speed, patch, row, shift_row(right, end, dim))
    for end in range(2):
        if shifts(state, work, element + end):
            shift = shift_vectors(end, e, length)
            row = shift_row(right, end, dim)
            turned = bend_rates(length, grows, e, rates)[end]
            add_shift(
                cable,
                state,
                element,
                lane,
                end,
                shift,
                row,
                e,
                rates,
                turned,
                k[end],
                rate_factor,
                stiffness_factor,
                work,
            )
    if shifts(state, work, element) and shifts(state, work, element + 1):
        add_both_shifts(cable, state, element, lane, e, stiffness_factor, work)


@formula
def add_numbers(numbers, patch, right, last, like):
    """Add an element's residual and tangent, `numbers`, to a load's equations, the residual in column `last`."""
    dim, square = len(like), outer(0.0, like, like)
    rows = [patch_row(right, i, dim) for i in range(4)]
    for i in range(4):
        for j in range(4):
            first = block_row(i, j, like)
            matrix = load([numbers[first + k] for k in range(dim * dim)], square)
            add_matrix(matrix, patch, rows[i], rows[j])
        first = vector_row(i, like)
        add_column(Vec(numbers[first + axis] for axis in range(dim)), patch, rows[i], last)


@formula
def convect_damping(length, mass, mass_factor, per_rate, k_a, k_b, group, elastic_group, like):
    """Add derivatives by nodal coordinates of damping and drag, due to rope passing the nodes, to a group's tangent.

    Damping and drag are the group's tangent less its elastic part and its inertia, `mass` (kg/m) by `mass_factor`;
    `per_rate` is the stiffness factor over the rate factor.
    """
    speeds = passing_speeds(length, k_a, k_b)
    powers = (mass_factor * mass * per_rate) * length, length, length * length
    for i in range(4):
        damped = []
        for m in range(4):
            inert = MASS[i][m] * powers[0]
            inert = inert if i % 2 + m % 2 == 0 else powers[i % 2 + m % 2] * inert
            whole = read_square(group, block_row(i, m, like), like)
            damped.append(block(per_rate, whole - read_square(elastic_group, block_row(i, m, like), like), -inert))
        for j in range(4):
            of_j = [(speeds[m][j], damped[m]) for m in range(4) if speeds[m][j] is not None]
            add_spread(total(speed * one for speed, one in of_j), group, block_row(i, j, like))


@formula
def convect(length, mass, grows, before, after, rate_factor, stiffness_factor, group, like):
    """Add derivatives by nodal coordinates of inertia forces, due to rope passing the nodes, to a group's tangent."""
    still = convection(length, grows, before, after, rate_factor, stiffness_factor)
    inert = mass * length, mass * length * length
    for i in range(4):
        for j in range(4):
            add_diagonal(inert[i % 2] * still[i][j], group, block_row(i, j, like), len(like))


@formula
def total(terms):
    """Sum of numbers, vectors or matrices, at least one."""
    first, *others = terms
    for other in others:
        first = first + other
    return first


@formula
def passing_speeds(length, k_a, k_b):
    """Derivatives (4, 4) of rope velocities at the nodes of an element by its nodal coordinates; None where zero."""
    per, square = 1.0 / length, 1.0 / (length * length)
    return (
        (None, k_a, None, None),
        (-6.0 * square * k_a, -4.0 * per * k_a, 6.0 * square * k_a, -2.0 * per * k_a),
        (None, None, None, k_b),
        (6.0 * square * k_b, 2.0 * per * k_b, -6.0 * square * k_b, 4.0 * per * k_b),
    )


@formula
def convection(length, grows, before, after, rate_factor, stiffness_factor):
    """Rows of ∫S_i S_j dx/l times the derivatives of rope accelerations by nodal coordinates, without those by r_tt.

    Rows of slopes are without a factor l. Arguments as in `rope_motion`, factors as in `assemble`.
    """
    per, square = 1.0 / length, 1.0 / (length * length)
    bends = (
        (-6.0 * square, -4.0 * per, 6.0 * square, -2.0 * per),
        (6.0 * square, 2.0 * per, -6.0 * square, 4.0 * per),
    )
    turn = grows * per
    grown = (
        (12.0 * square * turn, 4.0 * per * turn, -12.0 * square * turn, 2.0 * per * turn),
        (-12.0 * square * turn, -2.0 * per * turn, 12.0 * square * turn, -4.0 * per * turn),
    )
    speeds, by = passing_speeds(length, before[0], after[0]), []  # of velocities of the rope less nodal rates
    for end, (k, k_dot), bend in ((0, before, bends[0]), (1, after, bends[1])):
        passed, squared = 2.0 * rate_factor * k + stiffness_factor * k_dot, stiffness_factor * k * k
        rows = [squared * bend[j] for j in range(4)]
        rows[2 * end + 1] = rows[2 * end + 1] + passed
        turns = [total(bend[m] * speeds[m][j] for m in range(4) if speeds[m][j] is not None) for j in range(4)]
        turned = [passed * bend[j] + stiffness_factor * k * (grown[end][j] + turns[j]) for j in range(4)]
        by += [rows, [length * one for one in turned]]
    return tuple(tuple(total(MASS[i][m] * by[m][j] for m in range(4)) for j in range(4)) for i in range(4))


@formula
def shift_row(right, end, dim):
    """Row, in a moving load's patch, of the arc length of one end of the element before or after the load."""
    return 5 * dim + right * end * (3 * dim + 1)


@inlined_kernel
def energy_by_node(cable, state, element, lane, e, like, work):
    """First and second derivative of an element's elastic energy by its length, and mixed ones by nodal coordinates."""
    stretch, length = rest_stretch(cable, state), state.mesh.length[element]
    dim, square = len(like), outer(0.0, like, like)
    by, group = work.patch_by_length, work.patch_elastic
    by_d = scale(stretch, load(by[2:, lane], like))
    by_a = scale(stretch, load(by[2 + dim :, lane], like))
    by_b = scale(stretch, load(by[2 + 2 * dim :, lane], like))
    per_length = 1.0 / length  # rows of slopes are times l
    f_a = scale(-per_length, load(group[vector_row(1, like) :, lane], like))
    f_b = scale(-per_length, load(group[vector_row(3, like) :, lane], like))
    first = stretch * by[0, lane] + dot(f_a, e[1]) + dot(f_b, e[3])
    # k (t_A, t_B): rows r_B and of both slopes; blocks of slopes have a factor l each
    on_d = scale(
        per_length,
        add_scaled(
            1.0,
            product(load(group[block_row(2, 1, like) :, lane], square), e[1]),
            product(load(group[block_row(2, 3, like) :, lane], square), e[3]),
        ),
    )
    on_a = scale(
        per_length,
        add_scaled(
            1.0,
            product(load(group[block_row(1, 1, like) :, lane], square), e[1]),
            product(load(group[block_row(1, 3, like) :, lane], square), e[3]),
        ),
    )
    on_b = scale(
        per_length,
        add_scaled(
            1.0,
            product(load(group[block_row(3, 1, like) :, lane], square), e[1]),
            product(load(group[block_row(3, 3, like) :, lane], square), e[3]),
        ),
    )
    second = stretch * stretch * by[1, lane] + 2.0 * (dot(by_a, e[1]) + dot(by_b, e[3]))
    second += per_length * (dot(e[1], on_a) + dot(e[3], on_b))
    d = add_scaled(1.0, by_d, on_d)
    a = add_scaled(1.0, f_a, add_scaled(length, by_a, on_a))
    b = add_scaled(1.0, f_b, add_scaled(length, by_b, on_b))
    return first, second, (scale(-1.0, d), a, d, b)


@inlined_kernel
def beyond_elastic(group, elastic_group, row, lane, like):
    """Part of one element's residual or tangent in a SIMD group without the elastic part, read from row `row` on."""
    return subtract(load(group[row:, lane], like), load(elastic_group[row:, lane], like))


@inlined_kernel
def add_shift(
    cable, state, element, lane, end, shift, row, e, rates, bend_rate, k, rate_factor, stiffness_factor, work
):
    """Add row and column of the arc length of a node that follows a load, from one of the elements beside the node.

    Args:
        cable: parameters.
        state: where to linearise.
        element: beside the node.
        lane: of it in the groups.
        end: 0 where the node is its first one, 1 where it is the second one.
        shift: `shift_vectors`.
        row: of the arc length in the patch.
        e: nodal vectors.
        rates: of them, along the nodes.
        bend_rate: of r_xx at the node, likewise.
        k: speed of rope past the node, m/s.
        rate_factor: as in `assemble`.
        stiffness_factor: as in `assemble`.
        work: takes the result.
    """
    like = cable.gravity
    dim, square = len(like), outer(0.0, like, like)
    number, right = work.patch_of[element], work.patch_right[element]
    patch, last, group, elastic_group = work.patch[number], work.patch.shape[1], work.group, work.patch_elastic
    length, mass = state.mesh.length[element], cable.mass_per_length * rest_stretch(cable, state)
    sign = 1.0 if end == 1 else -1.0
    slope, bend = shift
    r, t = 2 * end, 2 * end + 1
    first, second, by_node = energy_by_node(cable, state, element, lane, e, like, work)
    on_r = beyond_elastic(group, elastic_group, vector_row(r, like), lane, like)  # forces but the elastic ones
    on_t = beyond_elastic(group, elastic_group, vector_row(t, like), lane, like)
    squared = dot(slope, slope)
    residual = sign * (first + 0.5 * mass * k * k * squared) + dot(slope, on_r) + dot(bend, on_t)
    patch[row, last] -= residual
    turned = rates[1] if end == 0 else rates[3]
    convected = scale(-2.0 * rate_factor * mass * length, turned)
    convected_bend = scale(-2.0 * rate_factor * mass * length * length, bend_rate)
    pivot = stiffness_factor * second - sign * mass * k * rate_factor * squared
    for j in range(4):
        of_r = beyond_elastic(group, elastic_group, block_row(r, j, like), lane, square)
        of_t = beyond_elastic(group, elastic_group, block_row(t, j, like), lane, square)
        energy = scale(sign * stiffness_factor, by_node[j])
        by_j = subtract(energy, add_scaled(1.0, product(slope, of_r), product(bend, of_t)))
        per_length = 4.0 if j == t else 2.0
        bent = -sign * (per_length / length if j % 2 == 1 else (6.0 if j == 0 else -6.0) / (length * length))
        by_j = add_scaled(-stiffness_factor * bent, on_t, by_j)
        if j == t:
            by_j = add_scaled(stiffness_factor, on_r, by_j)
            by_j = add_scaled(stiffness_factor * sign * mass * k * k, slope, by_j)
        add_row(by_j, patch, row, patch_row(right, j, dim))
        to_r = beyond_elastic(group, elastic_group, block_row(j, r, like), lane, square)
        to_t = beyond_elastic(group, elastic_group, block_row(j, t, like), lane, square)
        on_j = subtract(energy, add_scaled(1.0, product(to_r, slope), product(to_t, bend)))
        grown = beyond_elastic(group, elastic_group, vector_row(j, like), lane, like)  # as there is more rope
        on_j = add_scaled(-sign * stiffness_factor * (2.0 if j % 2 == 1 else 1.0) / length, grown, on_j)
        factor = length if j % 2 == 1 else 1.0
        carried = scale(factor, add_scaled(MASS[j][r], convected, scale(MASS[j][t], convected_bend)))
        on_j = add_scaled(1.0, carried, on_j)
        add_column(on_j, patch, patch_row(right, j, dim), row)
        if j // 2 == end:
            along = slope if j == r else bend
            pivot += dot(along, add_scaled(1.0, product(to_r, slope), product(to_t, bend)))
            pivot -= dot(along, carried)
    patch[row, row] += pivot


@inlined_kernel
def add_both_shifts(cable, state, element, lane, e, stiffness_factor, work):
    """Add the coupling of the arc lengths of two neighbouring nodes that both follow moving loads."""
    like = cable.gravity
    dim, square = len(like), outer(0.0, like, like)
    number, right = work.patch_of[element], work.patch_right[element]
    patch, group, elastic_group = work.patch[number], work.group, work.patch_elastic
    _, second, _ = energy_by_node(cable, state, element, lane, e, like, work)
    length = state.mesh.length[element]
    first_shift, second_shift = shift_vectors(0, e, length), shift_vectors(1, e, length)
    here, there = -stiffness_factor * second, -stiffness_factor * second
    for i in range(2):
        for j in range(2):
            own, other = first_shift[i], second_shift[j]
            matrix = beyond_elastic(group, elastic_group, block_row(i, 2 + j, like), lane, square)
            here += dot(own, product(matrix, other))
            matrix = beyond_elastic(group, elastic_group, block_row(2 + j, i, like), lane, square)
            there += dot(other, product(matrix, own))
    first, last = shift_row(right, 0, dim), shift_row(right, 1, dim)
    patch[first, last] += here
    patch[last, first] += there
