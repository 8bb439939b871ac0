"""Towers: one-sided contact of the rope with sheaves and saddles, friction along it, and grooves in space.

A contact is a fixed point p and the side on which the rope is. It acts on the point of the rope nearest to it,

    φ(s) = (r(s) - p)·r_x(s) = 0,

with the force N n + f t on the rope: n the normal of the rope there, t = r_x / |r_x|, N from the depth (p - r)·n, and
f friction. s is not an unknown but a function of the shape: it is found anew in every iteration, and its derivative
∂s/∂e = -(S r_x + S_x (r - p)) / (|r_x|² + (r - p)·r_xx) makes the tangent exact. With no friction the forces have a
potential, and a rope that slides over keeps its tension. A saddle, or a train of sheaves, is several contacts on a
circle: a sharper bend lifts off the outer ones. Beside a moving load see `tower_at_load`.

In space a groove holds the rope sideways, until more than a ratio of the normal force pushes it over the flank, or it
lifts higher than the groove is deep. From then on this tower does not touch it. With b = t x n, the lateral force is
-g N y b, y = (r - p)·b, so that g y is the ratio of the forces, and a contact without normal force holds nothing.
Friction adds -μ N v / √(v² + v_0²) b, v the lateral speed: Coulomb's law but for a creep below v_0. In a plane there is
no groove, and no code is compiled for it.
"""

from __future__ import annotations

from math import inf
from typing import Any

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import (
    WIDTH,
    gather_listed,
    gather_numbers,
    gather_numbers_listed,
    gather_rows,
    gather_vectors,
    magnitude,
    put_numbers,
    put_vectors,
    read_numbers,
    read_vector,
    spread,
    turn_point_loads,
)
from cable_twin.mechanics.language.traced import square_root
from cable_twin.mechanics.language.vectors import Vector, add_scaled, dot, load, scale, store
from cable_twin.mechanics.on_rope.buffer import buffer_energy, buffer_force
from cable_twin.mechanics.on_rope.friction import mobilise
from cable_twin.mechanics.on_rope.tower_at_load import (
    Part,
    add_beside_load,
    node_on_piece,
    normal_on_piece,
    part_of_piece,
    velocity_beside_load,
)
from cable_twin.mechanics.on_rope.tower_contact import (
    MAX_MOVES,
    NEAR,
    approach,
    depth_in_groove,
    force_and_tangent,
    mobilised,
    normal_force,
    shape_at_contact,
    shapes_at,
    side_force,
    sideways,
    slid,
    with_groove,
)
from cable_twin.mechanics.parameters import IN_GROOVE, LIFTED, NO_RATIO, OUT_LEFT, OUT_RIGHT
from cable_twin.mechanics.rope.ale import nodal_vectors, rope_before
from cable_twin.mechanics.rope.patch import beside_load
from cable_twin.mechanics.rope.point import (
    accumulate_vector,
    add_point_tangents,
    element_beside,
    point_at,
    point_on,
    read_point_load,
    slope,
    value,
    weighted,
    write_point_load,
)

CLEAR = 0.01  # m, by which the rope is off a contact that is not looked at closely
STILL = 1e-6  # of an element's length: after a shorter move the rope is taken as it is before it
FOUR = (0.0, 0.0, 0.0, 0.0)  # numbers of a contact, as shape functions


@inlined_kernel
def find_contacts(cable, towers, state, first, place, side, work):
    """Update arc lengths of `WIDTH` contacts from `first` on to those points of the rope that are nearest to them.

    A rope that is `CLEAR` off does not touch a contact, and the arc length is left where it is while it is less than
    that from the nearest: with r - p = α n + β t and n at right angles to t, α n·m is r·m - p·m - β t·m > 0, m the side
    of the rope. Most contacts hardly move in an iteration: of such a move the point is that before it.

    Args:
        cable: of the rope.
        towers: parameters.
        state: takes the arc lengths.
        first: row of the first contact.
        place: (dim,) m.
        side: on which the rope is, (dim,) unit vectors.
        work: takes the elements, and -1 in `contact_element` for a contact that the rope is clear of.

    Returns:
        Nodal vectors and `shapes_at` the points of the rope.
    """
    last, like, numbers = towers.stiffness.size - 1, cable.gravity, work.lane_numbers
    for lane in range(WIDTH):
        s = state.contact_arc_length[min(first + lane, last)]
        near = element_beside(cable, state, s, work.contact_near[first + lane])
        work.contact_place[first + lane], work.contact_near[first + lane], work.lane_moves[lane] = s, near, True
    e, shapes, length = curve_at(state, first, work, like)
    for move in range(MAX_MOVES + 1):
        s = gather_numbers(work.contact_place, first)
        apart, r_x, there, way = approach(cable, e, shapes, place, length, s)
        spread((there, way, dot(apart, side), dot(apart, r_x), dot(r_x, r_x)), numbers, 0)
        moving, moved = False, False
        for lane in range(WIDTH):
            if work.lane_moves[lane]:
                contact, s, along = first + lane, numbers[0, lane], numbers[3, lane]
                clear = move == 0 and numbers[2, lane] > CLEAR and along * along < CLEAR * CLEAR * numbers[4, lane]
                if not clear:
                    state.contact_arc_length[min(contact, last)] = s
                    if move > 0 or numbers[1, lane] > STILL:
                        work.contact_place[contact], moved = s, True
                        work.contact_near[contact] = element_beside(cable, state, s, work.contact_near[contact])
                work.contact_element[contact] = -1 if clear or contact > last else work.contact_near[contact]
                work.lane_moves[lane] = not clear and numbers[1, lane] > NEAR
                moving = moving or work.lane_moves[lane]
        if moved:
            e, shapes, length = curve_at(state, first, work, like)
        if not moving:
            break
    return e, shapes


@inlined_kernel
def curve_at(state, first, work, like):
    """Nodal vectors, `shapes_at` and length (m) of the elements at the places of `WIDTH` contacts from `first` on."""
    elements = work.contact_near
    length = gather_numbers_listed(state.mesh.length, elements, first)
    x = gather_numbers(work.contact_place, first) - gather_numbers_listed(state.mesh.arc_length, elements, first)
    return gather_listed(state.nodes.position, elements, first, like), shapes_at(x, length), length


@inlined_kernel
def velocity_at(cable, state, rates, shapes, first, work):
    """Velocity (dim,) of the rope in m/s at `WIDTH` contacts from `first` on, from nodal rates of its elements."""
    moving, elements, numbers = weighted(rates, shapes[0]), work.contact_near, work.lane_numbers
    if cable.load_nodes:
        beside = False
        for lane in range(WIDTH):
            beside = beside or beside_load(cable, state, elements[first + lane])
        if beside:
            spread(shapes[0], numbers, 0)
            spread(moving, numbers, 4)
            for lane in range(WIDTH):
                element = elements[first + lane]
                if beside_load(cable, state, element):
                    shape = load(numbers[:, lane], FOUR)
                    store(velocity_beside_load(cable, state, element, shape), numbers[:, lane], 4)
            moving = read_vector(numbers, 4, cable.gravity)
    return moving


@kernel
def contact_energy(cable, towers, state, contact):
    """Elastic energy (J) of a tower contact."""
    point, _, _, _, depth, _ = contact_frame(cable, towers, state, contact)
    node, way = node_on_piece(cable, towers, state, contact, point.element, cable.gravity)
    if node < 0:
        return buffer_energy(towers.stiffness[contact], towers.toe[contact], depth)
    energy = 0.0
    for number in range(2):
        part = part_of_piece(cable, towers, state, contact, node, way, number, cable.gravity)
        energy += buffer_energy(part.share * towers.stiffness[contact], towers.toe[contact], part.depth)
    return energy


@kernel
def contact_frame(cable, towers, state, contact):
    """Rope point of a tower contact as last found; tangent, offset, normal, depth and velocity of the rope there."""
    point = point_at(cable, state, state.contact_arc_length[contact])
    return (point, *frame_at(cable, towers, state, contact, point))


@inlined_kernel
def frame_at(cable, towers, state, contact, point):
    """Contact kinematics at a tower contact: tangent, offset, normal, depth and velocity of the rope at its `point`.

    Returns:
        r_x (dim,) there; r - p (dim,) in m; the normal n (dim,); the depth (m); the velocity (dim,) of the rope in m/s.
    """
    like, shapes = cable.gravity, (point.shape, point.shape_x, point.shape_xx)
    place, side = load(towers.position[contact], like), load(towers.normal[contact], like)
    e = nodal_vectors(state.nodes.position, point.element, like)
    r_x, apart, normal = shape_at_contact(e, shapes, place, side)
    moving = value(state.nodes.velocity, point, like)
    if beside_load(cable, state, point.element):
        moving = velocity_beside_load(cable, state, point.element, point.shape)
    return r_x, apart, normal, depth_in_groove(towers, state, contact, -dot(apart, normal), like), moving


@kernel
def contact_force(cable, towers, state, contact):
    """Force (dim,) in N of a tower contact on the rope, at the rope point last found, and its normal part (N)."""
    like, z = cable.gravity, mobilised(cable, towers, state, contact)
    point, r_x, apart, normal, depth, moving = contact_frame(cable, towers, state, contact)
    node, way = node_on_piece(cable, towers, state, contact, point.element, like)
    if node < 0:
        return force_of_part(towers, contact, Part(1.0, point, r_x, apart, normal, depth, moving), z)
    before = force_of_part(towers, contact, part_of_piece(cable, towers, state, contact, node, way, 0, like), z)
    after = force_of_part(towers, contact, part_of_piece(cable, towers, state, contact, node, way, 1, like), z)
    return add_scaled(1.0, before[0], after[0]), before[1] + after[1]


@inlined_kernel
def force_of_part(towers, contact, part, mobilised_share):
    """Force (dim,) in N of a part of a contact on the rope, and its normal part (N)."""
    r_x, normal, moving = part.r_x, part.normal, part.moving
    n = part.share * normal_force(towers, contact, part.depth, -dot(normal, moving))[0]
    friction = towers.friction[contact] * n * mobilised_share
    force = add_scaled(friction / square_root(dot(r_x, r_x)), r_x, scale(n, normal))
    groove, rub = towers.groove[contact] * n, towers.groove_friction[contact] * n
    return with_groove(force, groove, rub, r_x, normal, part.apart, moving), n


@kernel
def add_towers(cable, towers, state, rate_factor, stiffness_factor, work):
    """Add forces and tangents of all tower contacts to the elements in contact, `WIDTH` contacts at a time."""
    like = cable.gravity
    for first in range(0, towers.stiffness.size, WIDTH):
        place, side = gather_rows(towers.position, first, like), gather_rows(towers.normal, first, like)
        e, shapes = find_contacts(cable, towers, state, first, place, side, work)
        touching = False
        for lane in range(WIDTH):
            touching = touching or work.contact_element[first + lane] >= 0
        put_numbers(0.0, work.contact_slide, first)
        if touching:
            at = shape_at_contact(e, shapes, place, side)
            add_contacts(cable, towers, state, first, e, shapes, at, rate_factor, stiffness_factor, work)


@inlined_kernel
def add_contacts(cable, towers, state, first, e, shapes, at, rate_factor, stiffness_factor, work):
    """Add forces and tangents of `WIDTH` contacts from `first` on, of which the points of the rope are found.

    Takes what `find_contacts` and `shape_at_contact` return; rest as in `assemble`.
    """
    like, (r_x, apart, normal) = cable.gravity, at
    rates = gather_listed(state.nodes.velocity, work.contact_near, first, like)
    moving = velocity_at(cable, state, rates, shapes, first, work)
    depth, depth_rate = depth_of_lanes(towers, state, -dot(apart, normal), first, work, like), -dot(normal, moving)
    stiffness, toe = gather_numbers(towers.stiffness, first), gather_numbers(towers.toe, first)
    n, by_depth, by_rate = buffer_force(stiffness, toe, gather_numbers(towers.damping, first), depth, depth_rate)
    put_vectors(shapes[0], work.contact_shape, first)
    put_vectors(normal, work.contact_normal, first)
    put_vectors((depth, depth_rate, n), work.contact_depth, first)
    pressed = cable.load_nodes and towers.at_bends
    for lane in range(WIDTH):
        pressed = pressed or work.contact_depth[2, first + lane] != 0.0
    if not pressed:
        return
    s, origin = gather_numbers(state.contact_arc_length, first), gather_numbers(state.contact_origin, first)
    way, before = slid(cable, state, s, origin), gather_numbers(state.contact_deflection, first)
    z, z_by_way = mobilise(way, before, gather_numbers(towers.presliding, first))
    put_vectors((way, before, z), work.contact_friction, first)
    force, by_place, by_slope, slide = force_and_tangent(
        (n, by_depth, by_rate, z, z_by_way),
        (
            gather_numbers(towers.friction, first),
            gather_numbers(towers.groove, first),
            gather_numbers(towers.groove_friction, first),
        ),
        (r_x, apart, normal, weighted(e, shapes[2])),
        (moving, weighted(rates, shapes[1])),
        rate_factor,
        stiffness_factor,
    )
    if stiffness_factor != 0.0:
        put_numbers(slide, work.contact_slide, first)
    put_vectors(shapes[1], work.contact_shape_x, first)
    write_point_load(force, by_place, by_slope, work.group)
    turn_point_loads(work.group, work.elements, like)
    for contact in range(first, min(first + WIDTH, towers.stiffness.size)):
        lane = contact - first
        if work.contact_element[contact] >= 0:
            if cable.load_nodes and beside_load(cable, state, work.contact_element[contact]):
                add_beside_load(cable, towers, state, contact, lane, rate_factor, stiffness_factor, work)
            elif work.contact_depth[2, contact] != 0.0:
                add_beside_none(contact, lane, stiffness_factor, like, work)


@inlined_kernel
def add_beside_none(contact, lane, stiffness_factor, like, work):
    """Add force and tangent of one contact, in a lane of the group in `work`, to an element beside no moving load."""
    numbers, element = work.elements[lane], work.contact_element[contact]
    shape = load(work.contact_shape[:, contact], FOUR)
    force, _, _ = read_point_load(numbers, like)
    for i in range(4):
        accumulate_vector(scale(work.contact_shape[i, contact], force), work.right_side, element, i)
    if stiffness_factor != 0.0:
        shape_x = load(work.contact_shape_x[:, contact], FOUR)
        add_point_tangents(numbers, shape, shape_x, element, work.diagonal, work.upper, work.lower, like)


@kernel
def contacts_left(cable, towers, state, work, mass_factor, rate_factor, least):
    """Largest estimated error (m) that a Newton iteration leaves at the tower contacts of one rope.

    A normal force is no linear function of depth and rate; what it differs from its tangent moves the rope there. So
    does friction along the rope, whose growth with sliding falls by the share of the presliding distance.

    Args:
        cable: of the rope.
        towers: parameters.
        state: with the places of the contacts.
        work: with the increment, and the contacts before it.
        mass_factor: ∂acceleration/∂coordinate (1/s²).
        rate_factor: ∂velocity/∂coordinate (1/s).
        least: an estimate (m); what is less is not looked at closely.
    """
    like, worst = cable.gravity, least
    for first in range(0, towers.stiffness.size, WIDTH):
        touching = False
        for lane in range(WIDTH):
            touching = touching or work.contact_element[first + lane] >= 0
        if not touching:
            continue
        increments = gather_listed(work.right_side, work.contact_near, first, like)
        change = weighted(increments, gather_vectors(work.contact_shape, first, FOUR))
        deeper = -dot(gather_vectors(work.contact_normal, first, like), change)
        length = gather_numbers_listed(state.mesh.length, work.contact_near, first)
        inertia = 0.5 * mass_factor * cable.mass_per_length * length
        rates, damping = read_numbers(work.contact_depth[1], first), gather_numbers(towers.damping, first)
        hard = 0.5 * (1.0 + damping * magnitude(rates)) / gather_numbers(towers.toe, first) + rate_factor * damping
        bent = gather_numbers(towers.stiffness, first) * hard * deeper * deeper
        growth = read_numbers(work.contact_slide, first) / gather_numbers(towers.presliding, first)
        spread((deeper, inertia, bent + growth * dot(change, change)), work.lane_numbers, 0)
        spread(change, work.lane_numbers, 3)
        for contact in range(first, min(first + WIDTH, towers.stiffness.size)):
            inertia, most = work.lane_numbers[1, contact - first], work.lane_numbers[2, contact - first]
            if work.contact_element[contact] >= 0 and not most < worst * inertia:
                worst = max(worst, contact_left(towers, state, work, contact, contact - first, rate_factor, like))
    return worst


@kernel
def contact_left(towers, state, work, contact, lane, rate_factor, like):
    """Estimated error (m) that a Newton iteration leaves at one tower contact, see `contacts_left`.

    Takes from its `lane` the part of the rope's increment that is deeper in the contact (m), the inertia that resists
    it (N/m), and from row 3 on the increment (dim,) in m.
    """
    deeper, inertia = work.lane_numbers[0, lane], work.lane_numbers[1, lane]
    change = load(work.lane_numbers[:, lane], like, 3)
    depth, rate, growth = work.contact_depth[0, contact], work.contact_depth[1, contact], work.contact_slide[contact]
    before, by_depth, by_rate = normal_force(towers, contact, depth, rate)
    now, _, _ = normal_force(towers, contact, depth + deeper, rate + rate_factor * deeper)
    stiff = by_depth + rate_factor * by_rate
    left = abs(now - before - stiff * deeper) / (inertia + stiff)
    if growth > 0.0 and before > 0.0:
        point = point_on(state, work.contact_element[contact], state.contact_arc_length[contact])
        slid_more = abs(dot(slope(state.nodes.position, point, change), change))
        share = 0.5 * slid_more / towers.presliding[contact] + abs(now - before) / before
        left = max(left, growth * slid_more * share / (inertia + growth))
    return left


@kernel
def settle_towers(cable, towers, state, work):
    """End a step: store the mobilised friction of each tower contact and the loads of each tower.

    Contact points are those of the last iteration: their move since then changes the depth in second order only, and
    the friction of the step is that of the sliding in that iteration.
    """
    like, count, numbers = cable.gravity, towers.stiffness.size, work.lane_numbers
    for tower in range(towers.top.shape[0]):
        state.tower_load[tower, 0] = 0.0
        begin_lateral(state, tower, like)
    for first in range(0, count, WIDTH):
        for lane in range(WIDTH):
            s = state.contact_arc_length[min(first + lane, count - 1)]
            near = element_beside(cable, state, s, work.contact_near[first + lane])
            work.contact_place[first + lane], work.contact_near[first + lane] = s, near
        e, shapes, _ = curve_at(state, first, work, like)
        place, side = gather_rows(towers.position, first, like), gather_rows(towers.normal, first, like)
        r_x, apart, normal = shape_at_contact(e, shapes, place, side)
        rates = gather_listed(state.nodes.velocity, work.contact_near, first, like)
        moving = velocity_at(cable, state, rates, shapes, first, work)
        depth = depth_of_lanes(towers, state, -dot(apart, normal), first, work, like)
        stiffness, toe = gather_numbers(towers.stiffness, first), gather_numbers(towers.toe, first)
        damping = gather_numbers(towers.damping, first)
        n, _, _ = buffer_force(stiffness, toe, damping, depth, -dot(normal, moving))
        spread((n,), numbers, 0)
        note_lateral(r_x, normal, apart, moving, numbers)
        for lane in range(min(WIDTH, count - first)):
            contact, force = first + lane, numbers[0, lane]
            if cable.load_nodes and beside_load(cable, state, work.contact_near[contact]):
                force = normal_on_piece(cable, towers, state, contact, work.contact_near[contact], force, like)
            state.tower_load[towers.contact_tower[contact], 0] += force
            add_lateral(towers, state, contact, force, numbers[:, lane], like)
            settle_friction_of_contact(cable, towers, state, contact, work)
    for tower in range(towers.top.shape[0]):
        state.tower_load[tower, 1] = min(state.tower_load[tower, 1], state.tower_load[tower, 0])
        end_lateral(state, tower, like)


@inlined_kernel
def settle_friction_of_contact(cable, towers, state, contact, work):
    """End a step: store the mobilised friction of a tower contact, as the last iteration had it if nothing moved."""
    before, rope = state.contact_deflection[contact], rope_before(cable, state, state.contact_arc_length[contact])
    way, friction = rope - state.contact_origin[contact], work.contact_friction
    found = work.contact_element[contact] >= 0 and work.contact_depth[2, contact] != 0.0
    if found and friction[0, contact] == way and friction[1, contact] == before:
        state.contact_deflection[contact] = friction[2, contact]
    else:
        state.contact_deflection[contact] = mobilise(way, before, towers.presliding[contact])[0]
    state.contact_origin[contact] = rope


@kernel
def begin_lateral(state: Any, tower: int, like: Vector) -> None:
    """Set the lateral force of a tower to zero, before `add_lateral`; no-op in a plane."""
    if len(like) == 3:
        state.tower_lateral[tower, 0] = 0.0


@inlined_kernel
def note_lateral(r_x: Any, normal: Any, apart: Any, moving: Any, numbers: Any) -> None:
    """Write offset and speed across the groove, and its lateral vector (3,), of `WIDTH` contacts; no-op in a plane.

    Takes what `shape_at_contact` returns, and the velocity of the rope. They go to `numbers` (n, WIDTH), from row 2 on.
    """
    if len(r_x) == 2:
        return
    across = sideways(r_x, normal)
    spread((dot(apart, across), dot(moving, across)), numbers, 2)
    spread(across, numbers, 4)


@inlined_kernel
def add_lateral(towers: Any, state: Any, contact: int, force: float, numbers: Any, like: Vector) -> None:
    """Add the force (N) of a groove on the rope, to the left of the track, to that of its tower; no-op in a plane.

    Takes the normal `force` (N), and the `numbers` of the contact as of `note_lateral`.
    """
    if len(like) == 2:
        return
    tower = towers.contact_tower[contact]
    sign = -1.0 if dot(load(numbers, like, 4), load(towers.left[tower], like)) < 0.0 else 1.0
    stiffness, rub = towers.groove[contact] * force, towers.groove_friction[contact] * force
    state.tower_lateral[tower, 0] += side_force(stiffness, rub, sign * numbers[2], sign * numbers[3])


@kernel
def end_lateral(state: Any, tower: int, like: Vector) -> None:
    """Store the highest ratio of lateral to normal force of a tower; no-op in a plane."""
    if len(like) == 3:
        state.tower_lateral[tower, 1] = max(state.tower_lateral[tower, 1], lateral_ratio(state, tower))


@inlined_kernel
def lateral_ratio(state, tower):
    """Present ratio of lateral to normal force (-) of a tower; NO_RATIO without normal force."""
    normal = state.tower_load[tower, 0]
    return abs(state.tower_lateral[tower, 0]) / normal if normal > 0.0 else NO_RATIO


@kernel
def begin_extremes(cable, towers, state):
    """Reset least load and highest lateral ratio of each tower to their present values."""
    for tower in range(towers.top.shape[0]):
        state.tower_load[tower, 1] = state.tower_load[tower, 0]
        if len(cable.gravity) == 3:
            state.tower_lateral[tower, 1] = lateral_ratio(state, tower)


@kernel
def derail(cable: Any, towers: Any, state: Any, like: Vector) -> None:
    """End a step: release the rope for good from each groove beyond its lateral or lift limit; no-op in a plane."""
    if len(like) == 2:
        return
    for tower in range(towers.top.shape[0]):
        if state.derailment[tower, 0] != IN_GROOVE:
            continue
        how, normal, lateral = IN_GROOVE, state.tower_load[tower, 0], state.tower_lateral[tower, 0]
        if abs(lateral) > towers.derailment_ratio[tower] * normal:
            how = OUT_RIGHT if lateral > 0.0 else OUT_LEFT  # against the force that held it
        elif normal == 0.0 and lift(cable, towers, state, tower) > towers.groove_height[tower]:
            how = LIFTED
        if how != IN_GROOVE:
            state.derailment[tower, 0], state.derailment[tower, 1] = how, state.clock[0] + 1


@kernel
def lift(cable, towers, state, tower):
    """Height (m) of the rope above the nearest contact of a tower, negative in contact."""
    deepest = -inf
    for contact in range(towers.contact_offset[tower], towers.contact_offset[tower + 1]):
        deepest = max(deepest, contact_frame(cable, towers, state, contact)[4])
    return -deepest


@inlined_kernel
def depth_of_lanes(towers: Any, state: Any, depth: Any, first: int, work: Any, like: Vector) -> Any:
    """`depth_in_groove` of `WIDTH` contacts from `first` on."""
    if len(like) == 2:
        return depth
    last, out = towers.stiffness.size - 1, False
    for lane in range(WIDTH):
        out = out or state.derailment[towers.contact_tower[min(first + lane, last)], 0] != IN_GROOVE
    if out:
        spread((depth,), work.lane_numbers, 0)
        for lane in range(WIDTH):
            contact = min(first + lane, last)
            work.lane_numbers[0, lane] = depth_in_groove(towers, state, contact, work.lane_numbers[0, lane], like)
        return read_numbers(work.lane_numbers[0], 0)
    return depth
