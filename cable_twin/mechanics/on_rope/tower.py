"""Towers: one-sided contact of the rope with sheaves and saddles, friction along it, and grooves in space.

A contact is a fixed point p and the side on which the rope is. It acts on the point of the rope nearest to it,

    φ(s) = (r(s) - p)·r_x(s) = 0,

with the force N n + f t on the rope: n the normal of the rope there, t = r_x / |r_x|, N from the depth (p - r)·n, and
f friction. s is not an unknown but a function of the shape: it is found anew in every iteration, and its derivative
∂s/∂e = -(S r_x + S_x (r - p)) / (|r_x|² + (r - p)·r_xx) makes the tangent exact. With no friction the forces have a
potential, and a rope that slides over keeps its tension. A saddle, or a train of sheaves, is several contacts on a
circle: a sharper bend lifts off the outer ones.

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
    put_numbers,
    put_vectors,
    read_vector,
    spread,
    turn_lanes,
)
from cable_twin.mechanics.language.traced import formula, larger, magnitude, square_root
from cable_twin.mechanics.language.vectors import Vector, add_scaled, dot, load, outer, scale, store, subtract
from cable_twin.mechanics.on_rope.buffer import buffer_energy
from cable_twin.mechanics.on_rope.tower_contact import (
    MAX_MOVES,
    NEAR,
    approach,
    force_and_tangent,
    groove_tangent,
    mobilised,
    normal_force,
    shape_at_contact,
    shapes_at,
    side_force,
    sideways,
    with_groove,
)
from cable_twin.mechanics.parameters import IN_GROOVE, LIFTED, NO_RATIO, OUT_LEFT, OUT_RIGHT
from cable_twin.mechanics.rope.ale import nodal_vectors, rope_before
from cable_twin.mechanics.rope.element import accumulate_element
from cable_twin.mechanics.rope.following_nodes import at_place
from cable_twin.mechanics.rope.patch import beside_load, follows, motion_at_rest
from cable_twin.mechanics.rope.point import (
    AFTER,
    BEFORE,
    R,
    element_at,
    point_at,
    point_on,
    slope,
    value,
    weighted,
    write_point_load,
)
from cable_twin.mechanics.rope.point_load import add_point_load, add_point_tangent

CLEAR = 0.01  # m, by which the rope is off a contact that is not looked at closely
STILL = 1e-6  # of an element's length: after a shorter move the rope is taken as it is before it
FOUR = (0.0, 0.0, 0.0, 0.0)  # numbers of a contact, as shape functions
LAW = (0.0, 0.0, 0.0, 0.0, 0.0)  # likewise: what `force_and_tangent` takes as `law`


@kernel
def find_contacts(cable, towers, state, first, work):
    """Update arc lengths of `WIDTH` contacts from `first` on to those points of the rope that are nearest to them.

    A rope that is `CLEAR` off does not touch a contact, and the arc length is left where it is while it is less than
    that from the nearest: with r - p = α n + β t and n at right angles to t, α n·m is r·m - p·m - β t·m > 0, m the side
    of the rope. Most contacts hardly move in an iteration: of such a move the point is that before it.

    Args:
        cable: of the rope.
        towers: parameters.
        state: takes the arc lengths.
        first: row of the first contact.
        work: takes the points of the rope: arc lengths, and the elements, -1 in `contact_element` where it is clear.
    """
    last, like = towers.stiffness.size - 1, cable.gravity
    place, side = gather_rows(towers.position, first, like), gather_rows(towers.normal, first, like)
    for lane in range(WIDTH):
        s = state.contact_arc_length[min(first + lane, last)]
        work.contact_place[first + lane], work.lane_element[lane] = s, element_at(cable, state, s)
        work.lane_moves[lane] = True
    for move in range(MAX_MOVES + 1):
        s = gather_numbers(work.contact_place, first)
        e, shapes, length = curve_at(state, s, work, like)
        apart, r_x, there, moved = approach(cable, e, shapes, place, length, s)
        spread((there, moved, dot(apart, side), dot(apart, r_x), dot(r_x, r_x)), work.lane_numbers, 0)
        moving = False
        for lane in range(WIDTH):
            if work.lane_moves[lane]:
                after, way, along = work.lane_numbers[0, lane], work.lane_numbers[1, lane], work.lane_numbers[3, lane]
                clear = (
                    move == 0
                    and work.lane_numbers[2, lane] > CLEAR
                    and along * along < CLEAR * CLEAR * work.lane_numbers[4, lane]
                )
                if not clear:
                    state.contact_arc_length[min(first + lane, last)] = after
                    if move > 0 or way > STILL:
                        work.contact_place[first + lane] = after
                        work.lane_element[lane] = element_at(cable, state, after)
                if first + lane <= last:
                    work.contact_element[first + lane] = -1 if clear else work.lane_element[lane]
                work.lane_moves[lane] = not clear and way > NEAR
                moving = moving or work.lane_moves[lane]
        if not moving:
            break


@inlined_kernel
def curve_at(state, s, work, like):
    """Nodal vectors, `shapes_at` and length (m) of the elements in `lane_element`, at arc lengths `s` (m) on them."""
    length = gather_numbers_listed(state.mesh.length, work.lane_element, 0)
    e = gather_listed(state.nodes.position, work.lane_element, 0, like)
    return e, shapes_at(s - gather_numbers_listed(state.mesh.arc_length, work.lane_element, 0), length), length


@inlined_kernel
def velocity_at(cable, state, rates, shapes, work):
    """Velocity (dim,) of the rope in m/s on the elements in `lane_element`, of which `rates` are the nodal rates."""
    moving = weighted(rates, shapes[0])
    if cable.load_nodes:
        beside = False
        for lane in range(WIDTH):
            beside = beside or beside_load(cable, state, work.lane_element[lane])
        if beside:
            spread(moving, work.lane_numbers, 4)
            spread(shapes[0], work.lane_numbers, 0)
            for lane in range(WIDTH):
                if beside_load(cable, state, work.lane_element[lane]):
                    shape = load(work.lane_numbers[:, lane], FOUR)
                    store(
                        velocity_beside_load(cable, state, work.lane_element[lane], shape),
                        work.lane_numbers[:, lane],
                        4,
                    )
            moving = read_vector(work.lane_numbers, 4, cable.gravity)
    return moving


@inlined_kernel
def velocity_beside_load(cable, state, element, shape):
    """Velocity (dim,) of the rope in m/s at a point, of given shape functions, of an element beside a moving load."""
    _, rates, _ = motion_at_rest(cable, state, element, state.nodes.acceleration, state.joints.acceleration)
    return at_place(rates, shape, shape)[0]


@kernel
def contact_energy(cable, towers, state, contact):
    """Elastic energy (J) of a tower contact."""
    depth = contact_frame(cable, towers, state, contact)[4]
    return buffer_energy(towers.stiffness[contact], towers.toe[contact], depth)


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
    _, r_x, apart, normal, depth, moving = contact_frame(cable, towers, state, contact)
    n, _, _ = normal_force(towers, contact, depth, -dot(normal, moving))
    z, _ = mobilised(cable, towers, state, contact)
    friction = towers.friction[contact] * n * z
    force = add_scaled(friction / square_root(dot(r_x, r_x)), r_x, scale(n, normal))
    return with_groove(
        force, towers.groove[contact] * n, towers.groove_friction[contact] * n, r_x, normal, apart, moving
    ), n


@kernel
def add_towers(cable, towers, state, rate_factor, stiffness_factor, work):
    """Add forces and tangents of all tower contacts to the elements in contact, `WIDTH` contacts at a time."""
    for first in range(0, towers.stiffness.size, WIDTH):
        find_contacts(cable, towers, state, first, work)
        touching = False
        for lane in range(WIDTH):
            work.contact_slide[first + lane] = 0.0
            touching = touching or work.contact_element[first + lane] >= 0
        if touching:
            add_contacts(cable, towers, state, first, rate_factor, stiffness_factor, work)


@kernel
def add_contacts(cable, towers, state, first, rate_factor, stiffness_factor, work):
    """Add forces and tangents of `WIDTH` contacts from `first` on, of which the points of the rope are found."""
    like, pressed = cable.gravity, False
    e, shapes, _ = curve_at(state, gather_numbers(work.contact_place, first), work, like)
    rates = gather_listed(state.nodes.velocity, work.lane_element, 0, like)
    place, side = gather_rows(towers.position, first, like), gather_rows(towers.normal, first, like)
    r_x, apart, normal = shape_at_contact(e, shapes, place, side)
    moving = velocity_at(cable, state, rates, shapes, work)
    put_vectors(shapes[0], work.contact_shape, first)
    put_vectors(normal, work.contact_normal, first)
    put_vectors((-dot(apart, normal), -dot(normal, moving)), work.contact_depth, first)
    for lane in range(WIDTH):
        contact, law = first + lane, LAW
        if work.contact_element[contact] >= 0:
            depth = depth_in_groove(towers, state, contact, work.contact_depth[0, contact], like)
            work.contact_depth[0, contact] = depth
            n, by_depth, by_rate = normal_force(towers, contact, depth, work.contact_depth[1, contact])
            if n != 0.0:
                law, pressed = (n, by_depth, by_rate, *mobilised(cable, towers, state, contact)), True
        store(law, work.lane_numbers[:, lane])
    if not (pressed or towers.at_bends):
        return
    limits = (
        gather_numbers(towers.friction, first),
        gather_numbers(towers.groove, first),
        gather_numbers(towers.groove_friction, first),
    )
    force, by_place, by_slope, slide = force_and_tangent(
        read_vector(work.lane_numbers, 0, LAW),
        limits,
        (r_x, apart, normal, weighted(e, shapes[2])),
        (moving, weighted(rates, shapes[1])),
        rate_factor,
        stiffness_factor,
    )
    if stiffness_factor != 0.0:
        put_numbers(slide, work.contact_slide, first)
    write_point_load(force, by_place, by_slope, shapes[0], shapes[1], work.group)
    turn_lanes(work.group, work.elements, like)
    if cable.load_nodes:
        spread(force, work.group, 0)
        spread(by_place[0], work.group, tangent_row(0, like))
        spread(by_place[1], work.group, tangent_row(1, like))
        spread(by_slope[0], work.group, tangent_row(2, like))
        spread(by_slope[1], work.group, tangent_row(3, like))
    for lane in range(WIDTH):
        element = work.contact_element[first + lane]
        if element >= 0 and beside_load(cable, state, element):
            add_beside_load(cable, towers, state, first, lane, stiffness_factor, work)
        elif work.lane_numbers[0, lane] != 0.0:
            accumulate_element(work.elements[lane], element, stiffness_factor != 0.0, like, work)


@formula
def tangent_row(number, like):
    """First row of the four matrices (dim²) of tangents of a group of contacts, after their forces (dim,)."""
    dim = len(like)
    return dim + number * dim * dim


@kernel
def add_beside_load(cable, towers, state, first, lane, stiffness_factor, work):
    """Add force and tangent of one contact, in a lane of those from `first` on, to the elements beside a moving load.

    Takes force and tangents of the lanes in `work.group`, in rows as of `tangent_row`.
    """
    contact, like = first + lane, cable.gravity
    if towers.at_bends and add_at_bend(cable, towers, state, contact, stiffness_factor, work):
        return
    if work.lane_numbers[0, lane] == 0.0:
        return
    numbers, square = work.group[:, lane], outer(0.0, like, like)
    force, point = load(numbers, like), point_on(state, work.contact_element[contact], work.contact_place[contact])
    add_point_load(force, point, state, work)
    if stiffness_factor != 0.0:
        by_place = load(numbers, square, tangent_row(0, like)), load(numbers, square, tangent_row(1, like))
        by_slope = load(numbers, square, tangent_row(2, like)), load(numbers, square, tangent_row(3, like))
        add_point_tangent(force, by_place, by_slope, point, stiffness_factor, state, work)


@kernel
def add_at_bend(cable, towers, state, contact, stiffness_factor, work):
    """Add force and tangent of a tower contact that touches the rope at its sharp bend at a load, at rest.

    The normal is at right angles to a mean of both slopes there, of which r - p has no part. It turns with r, as
    ∂n/∂r = -t tᵀ / depth, so that the contact holds the bend like a spring along the rope too.

    Args:
        cable: of the rope.
        towers: parameters.
        state: in which the arc length of the contact becomes that of the bend.
        contact: row of the contact; the element on which it touches is in `work`.
        stiffness_factor: as in `assemble`.
        work: takes force and tangent.

    Returns:
        Whether it touches a bend; else nothing is added.
    """
    like, element = cable.gravity, work.contact_element[contact]
    place, nodes = load(towers.position[contact], like), state.nodes.position
    for node in range(max(element, 1), min(element + 2, cable.element_count)):
        before, after = load(nodes[node, BEFORE], like), load(nodes[node, AFTER], like)
        apart = subtract(load(nodes[node, R], like), place)
        nearer, farther = dot(apart, before), dot(apart, after)
        if not follows(state, node) or nearer > 0.0 or farther < 0.0 or farther == nearer:
            continue
        share = farther / (farther - nearer)
        r_x, still = add_scaled(share, before, scale(1.0 - share, after)), scale(0.0, apart)
        side = load(towers.normal[contact], like)
        across = add_scaled(-dot(side, r_x) / dot(r_x, r_x), r_x, side)
        normal = scale(1.0 / larger(square_root(dot(across, across)), 1e-12), across)
        depth = depth_in_groove(towers, state, contact, -dot(apart, normal), like)
        n, n_by_depth, _ = normal_force(towers, contact, depth, 0.0)
        state.contact_arc_length[contact] = state.mesh.arc_length[node]
        if n == 0.0:
            return True
        point = point_on(state, node - 1, state.mesh.arc_length[node])
        groove, rub = towers.groove[contact], towers.groove_friction[contact]
        whole = with_groove(scale(n, normal), groove * n, rub * n, r_x, normal, apart, still)
        add_point_load(whole, point, state, work)
        if stiffness_factor != 0.0:
            pushed = with_groove(normal, groove, rub, r_x, normal, apart, still)
            turned = outer(stiffness_factor * n / (depth * dot(r_x, r_x)), r_x, r_x)
            held = add_scaled(1.0, turned, groove_tangent(stiffness_factor * groove * n, 0.0, r_x, normal, still))
            by_r = add_scaled(1.0, outer(stiffness_factor * n_by_depth, pushed, normal), held)
            nothing = outer(0.0, apart, apart)
            add_point_tangent(whole, (by_r, nothing), (nothing, nothing), point, stiffness_factor, state, work)
        return True
    return False


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
            element = work.contact_element[first + lane]
            touching = touching or element >= 0
            work.lane_element[lane] = max(element, 0)
        if not touching:
            continue
        increments = gather_listed(work.right_side, work.lane_element, 0, like)
        change = weighted(increments, gather_vectors(work.contact_shape, first, FOUR))
        deeper = -dot(gather_vectors(work.contact_normal, first, like), change)
        length = gather_numbers_listed(state.mesh.length, work.lane_element, 0)
        inertia = 0.5 * mass_factor * cable.mass_per_length * length
        rates, damping = gather_numbers(work.contact_depth[1], first), gather_numbers(towers.damping, first)
        hard = 0.5 * (1.0 + damping * magnitude(rates)) / gather_numbers(towers.toe, first) + rate_factor * damping
        bent = gather_numbers(towers.stiffness, first) * hard * deeper * deeper
        growth = gather_numbers(work.contact_slide, first) / gather_numbers(towers.presliding, first)
        spread((deeper, inertia, bent + growth * dot(change, change)), work.lane_numbers, 0)
        spread(change, work.lane_numbers, 3)
        for lane in range(WIDTH):
            contact = first + lane
            deeper, inertia, most = work.lane_numbers[0, lane], work.lane_numbers[1, lane], work.lane_numbers[2, lane]
            if work.contact_element[contact] >= 0 and not most < worst * inertia:
                change = load(work.lane_numbers[:, lane], like, 3)
                left = contact_left(towers, state, work, contact, change, deeper, inertia, rate_factor)
                worst = max(worst, left)
    return worst


@kernel
def contact_left(towers, state, work, contact, change, deeper, inertia, rate_factor):
    """Estimated error (m) that a Newton iteration leaves at one tower contact, see `contacts_left`.

    Takes the increment (dim,) in m of the rope there, what of it is `deeper` in the contact (m), and the inertia that
    resists it, in N/m.
    """
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
    like, count = cable.gravity, towers.stiffness.size
    for tower in range(towers.top.shape[0]):
        state.tower_load[tower, 0] = 0.0
        begin_lateral(state, tower, like)
    for first in range(0, count, WIDTH):
        s = gather_numbers(state.contact_arc_length, first)
        for lane in range(WIDTH):
            place = state.contact_arc_length[min(first + lane, count - 1)]
            work.lane_element[lane] = element_at(cable, state, place)
        e, shapes, _ = curve_at(state, s, work, like)
        place, side = gather_rows(towers.position, first, like), gather_rows(towers.normal, first, like)
        r_x, apart, normal = shape_at_contact(e, shapes, place, side)
        rates = gather_listed(state.nodes.velocity, work.lane_element, 0, like)
        moving = velocity_at(cable, state, rates, shapes, work)
        spread((-dot(apart, normal), -dot(normal, moving)), work.lane_numbers, 0)
        note_lateral(r_x, normal, apart, moving, work.lane_numbers)
        for lane in range(min(WIDTH, count - first)):
            contact, tower = first + lane, towers.contact_tower[first + lane]
            depth = depth_in_groove(towers, state, contact, work.lane_numbers[0, lane], like)
            n, _, _ = normal_force(towers, contact, depth, work.lane_numbers[1, lane])
            state.tower_load[tower, 0] += n
            add_lateral(towers, state, contact, n, work.lane_numbers[:, lane], like)
            state.contact_deflection[contact], _ = mobilised(cable, towers, state, contact)
            state.contact_origin[contact] = rope_before(cable, state, state.contact_arc_length[contact])
    for tower in range(towers.top.shape[0]):
        state.tower_load[tower, 1] = min(state.tower_load[tower, 1], state.tower_load[tower, 0])
        end_lateral(state, tower, like)


@kernel
def begin_lateral(state: Any, tower: int, like: Vector) -> None:
    """Set the lateral force of a tower to zero, before `add_lateral`; no-op in a plane."""
    if len(like) == 3:
        state.tower_lateral[tower, 0] = 0.0


@inlined_kernel
def note_lateral(r_x: Any, normal: Any, apart: Any, moving: Any, numbers: Any) -> None:
    """Write offset and speed across the groove, and the lateral vector (3,), of `WIDTH` contacts; no-op in a plane.

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


@kernel
def depth_in_groove(towers: Any, state: Any, contact: int, depth: float, like: Vector) -> float:
    """Depth (m) of the rope in a tower contact; -inf once the rope has derailed from the tower."""
    if len(like) == 2 or state.derailment[towers.contact_tower[contact], 0] == IN_GROOVE:
        return depth
    return -inf
