"""Contacts of a tower with the elements beside a moving load, at whose node the rope bends sharply.

A saddle is a surface, of which a contact stands for the piece around its point p that is `Towers.apart` long, a. Where
a load's node is on that piece, u from p along it, the depth of the rope has a kink there, and its normal turns from one
side to the other. So the piece is divided there: a / 2 + u of it before the node and a / 2 - u after it, each a contact
in the middle of its part, with its share of the stiffness, on the rope on its side. Where the depth is straight on
either side this is the whole line load, wherever the node is; with one contact at p a vehicle would be shaken by each
point of the saddle. How u moves with the rope is left out of the tangent.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import square_root
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, outer, scale, subtract
from cable_twin.mechanics.on_rope.friction import mobilise
from cable_twin.mechanics.on_rope.tower_contact import (
    MAX_MOVES,
    NEAR,
    approach,
    depth_in_groove,
    force_and_tangent,
    groove_tangent,
    normal_force,
    normal_to,
    shape_at_contact,
    shapes_at,
    slid,
    with_groove,
)
from cable_twin.mechanics.rope.ale import nodal_vectors
from cable_twin.mechanics.rope.following_nodes import at_place
from cable_twin.mechanics.rope.patch import beside_load, follows, mean_slope, motion_at_rest
from cable_twin.mechanics.rope.point import (
    AFTER,
    BEFORE,
    R,
    element_beside,
    interpolate,
    point_on,
    read_point_load,
    value,
)
from cable_twin.mechanics.rope.point_load import add_point_load, add_point_tangent


@inlined_kernel
def velocity_beside_load(cable, state, element, shape):
    """Velocity (dim,) of the rope in m/s at a point, of given shape functions, of an element beside a moving load."""
    _, rates, _ = motion_at_rest(cable, state, element, state.nodes.acceleration, state.joints.acceleration)
    return at_place(rates, shape, shape)[0]


@kernel
def add_beside_load(cable, towers, state, contact, lane, rate_factor, stiffness_factor, work):
    """Add force and tangent of one contact, in a lane of the group in `work`, to an element beside a moving load."""
    if add_on_piece(cable, towers, state, contact, rate_factor, stiffness_factor, work):
        return
    if towers.at_bends and add_at_bend(cable, towers, state, contact, stiffness_factor, work):
        return
    if work.contact_depth[2, contact] == 0.0:
        return
    force, by_place, by_slope = read_point_load(work.elements[lane], cable.gravity)
    point = point_on(state, work.contact_element[contact], work.contact_place[contact])
    add_point_load(force, point, state, work)
    if stiffness_factor != 0.0:
        add_point_tangent(force, by_place, by_slope, point, stiffness_factor, state, work)


class Part(NamedTuple):
    """Part of the piece of surface of a contact on one side of a load's node, as a contact in its middle."""

    share: float  # of the piece
    point: Any  # of the rope
    r_x: Any  # (dim,)
    apart: Any  # r - p (dim,) m
    normal: Any  # (dim,)
    depth: float  # m
    moving: Any  # (dim,) m/s, velocity of the rope


@kernel
def node_on_piece(cable, towers, state, contact, element, like):
    """Node of a moving load on the piece of surface of a contact, -1 without one; way (m) from the contact to it.

    `element` is the one that the contact touches.
    """
    half, place = 0.5 * towers.apart[contact], load(towers.position[contact], like)
    if half > 0.0:
        for node in range(max(element, 1), min(element + 2, cable.element_count)):
            if follows(state, node):
                along = along_piece(towers, state, contact, node, like)
                way = dot(subtract(load(state.nodes.position[node, R], like), place), along)
                if abs(way) < half:
                    return node, way
    return -1, 0.0


@inlined_kernel
def along_piece(towers, state, contact, node, like):
    """Unit vector (dim,) along the surface at a contact, in the plane of its normal and of the rope at a node."""
    normal, r_x = load(towers.normal[contact], like), mean_slope(state.nodes.position, node, like)
    along = add_scaled(-dot(r_x, normal), normal, r_x)
    return scale(1.0 / square_root(dot(along, along)), along)


@inlined_kernel
def part_of_piece(cable, towers, state, contact, node, way, number, like):
    """Part of the piece of surface of a contact before a load's node, `number` 0, or after it, 1; as a contact.

    `way` (m) goes from the contact to the node.
    """
    half, along = 0.5 * towers.apart[contact], along_piece(towers, state, contact, node, like)
    middle = 0.5 * (way - half) if number == 0 else 0.5 * (way + half)
    share = (half + way if number == 0 else half - way) / (2.0 * half)
    place, side = add_scaled(middle, along, load(towers.position[contact], like)), load(towers.normal[contact], like)
    s, element = state.mesh.arc_length[node] + middle - way, node - 1 + number
    for _ in range(MAX_MOVES):
        element = element_beside(cable, state, s, element)
        element = min(element, node - 1) if number == 0 else max(element, node)
        length = state.mesh.length[element]
        shapes = shapes_at(s - state.mesh.arc_length[element], length)
        _, _, s, move = approach(cable, nodal_vectors(state.nodes.position, element, like), shapes, place, length, s)
        if move <= NEAR:
            break
    point = point_on(state, element, s)
    shapes = (point.shape, point.shape_x, point.shape_xx)
    r_x, apart, normal = shape_at_contact(nodal_vectors(state.nodes.position, element, like), shapes, place, side)
    moving = value(state.nodes.velocity, point, like)
    if beside_load(cable, state, element):
        moving = velocity_beside_load(cable, state, element, point.shape)
    depth = depth_in_groove(towers, state, contact, -dot(apart, normal), like)
    return Part(share, point, r_x, apart, normal, depth, moving)


@kernel
def normal_on_piece(cable, towers, state, contact, element, normal, like):
    """Normal force (N) of a contact by both parts of its piece at a load's node; `normal`, as given, without one."""
    node, way = node_on_piece(cable, towers, state, contact, element, like)
    if node < 0:
        return normal
    total = 0.0
    for number in range(2):
        part = part_of_piece(cable, towers, state, contact, node, way, number, like)
        total += part.share * normal_force(towers, contact, part.depth, -dot(part.normal, part.moving))[0]
    return total


@kernel
def add_on_piece(cable, towers, state, contact, rate_factor, stiffness_factor, work):
    """Add forces and tangents of both parts of a contact's piece of surface at a load's node; whether it has one."""
    like = cable.gravity
    node, way = node_on_piece(cable, towers, state, contact, work.contact_element[contact], like)
    if node < 0:
        return False
    shift = slid(cable, state, state.contact_arc_length[contact], state.contact_origin[contact])
    z, z_by_way = mobilise(shift, state.contact_deflection[contact], towers.presliding[contact])
    for number in range(2):
        part = part_of_piece(cable, towers, state, contact, node, way, number, like)
        n, by_depth, by_rate = normal_force(towers, contact, part.depth, -dot(part.normal, part.moving))
        if n > 0.0:
            bends, turning = (
                interpolate(state.nodes.position, part.point.element, part.point.shape_xx, like),
                interpolate(state.nodes.velocity, part.point.element, part.point.shape_x, like),
            )
            force, by_place, by_slope, _ = force_and_tangent(
                (part.share * n, part.share * by_depth, part.share * by_rate, z, z_by_way),
                (towers.friction[contact], towers.groove[contact], towers.groove_friction[contact]),
                (part.r_x, part.apart, part.normal, bends),
                (part.moving, turning),
                rate_factor,
                stiffness_factor,
            )
            add_point_load(force, part.point, state, work)
            if stiffness_factor != 0.0:
                add_point_tangent(force, by_place, by_slope, part.point, stiffness_factor, state, work)
    return True


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
        normal = normal_to(r_x, load(towers.normal[contact], like))
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
