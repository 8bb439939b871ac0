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

from math import inf, sqrt
from typing import Any

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import cross
from cable_twin.mechanics.language.traced import formula, square_root
from cable_twin.mechanics.language.vectors import Matrix, Vector, add_scaled, dot, load, outer, scale, store, subtract
from cable_twin.mechanics.on_rope.buffer import buffer_energy, buffer_force
from cable_twin.mechanics.on_rope.friction import mobilise
from cable_twin.mechanics.parameters import IN_GROOVE, LIFTED, NO_RATIO, OUT_LEFT, OUT_RIGHT
from cable_twin.mechanics.rope.ale import rope_before
from cable_twin.mechanics.rope.following_nodes import at_place
from cable_twin.mechanics.rope.patch import beside_load, follows, motion_at_rest
from cable_twin.mechanics.rope.point import (
    AFTER,
    BEFORE,
    R,
    bend,
    interpolate,
    point_at,
    point_on,
    slope,
    value,
)
from cable_twin.mechanics.rope.point_load import add_point_load, add_point_tangent

MAX_MOVES = 30  # Newton iterations for the nearest point
CLEAR = 0.01  # m, by which the rope is off a contact that is not looked at closely
NEAR = 1e-4  # of an element's length: a last move below leaves its square times the share of depth to bend
STILL = 1e-6  # the same: after a shorter move the rope is taken as it is before it


@inlined_kernel
def find_contact(cable, towers, state, contact):
    """Update the arc length of a tower contact to the point of the rope nearest to it.

    A rope that is `CLEAR` off does not touch it, and the arc length is left where it is while it is less than that from
    the nearest: with r - p = α n + β t and n at right angles to t, α n·m is r·m - p·m - β t·m > 0, m the side of the
    rope. Most contacts hardly move in an iteration: of such a move the point is that before it.

    Returns:
        Whether the rope may touch; the point on it.
    """
    like, s = cable.gravity, state.contact_arc_length[contact]
    place, point = load(towers.position[contact], like), point_at(cable, state, s)
    apart, r_x, there, move = approach(cable, state, place, point, s)
    along = dot(apart, r_x)
    if dot(apart, load(towers.normal[contact], like)) > CLEAR and along * along < CLEAR * CLEAR * dot(r_x, r_x):
        return False, point
    if move > NEAR:
        there = nearest(cable, state, place, there)
    if move > STILL:
        point = point_at(cable, state, there)
    state.contact_arc_length[contact] = there
    return True, point


@kernel
def nearest(cable, state, place, arc_length):
    """Arc length (m) of the point of the rope nearest to `place` (dim,) in m, by Newton's method from `arc_length`.

    Where the rope bends so sharply around the place that the distance is no minimum, which no rope at rest does, the
    slope is kept positive.
    """
    s = arc_length
    for _ in range(MAX_MOVES):
        _, _, s, move = approach(cable, state, place, point_at(cable, state, s), s)
        if move <= NEAR:
            break
    return s


@inlined_kernel
def approach(cable, state, place, point, arc_length):
    """Make one move of Newton's method towards the point of the rope nearest to a place, from a `point` of the rope.

    Returns:
        r - p (dim,) in m and r_x (dim,) before it; the arc length (m) after it; size of the move, in lengths of the
        element.
    """
    coordinates = state.nodes.position
    length = state.mesh.length[point.element]
    r_x, r_xx = slope(coordinates, point, place), bend(coordinates, point, place)
    apart = subtract(value(coordinates, point, place), place)
    squared = dot(r_x, r_x)
    move = -dot(apart, r_x) / max(squared + dot(apart, r_xx), 0.25 * squared)
    move = min(max(move, -length), length)
    after = min(max(arc_length + move, 0.0), cable.unstrained_length)
    return apart, r_x, after, abs(after - arc_length) / length


@kernel
def slid(cable, state, contact):
    """Sliding displacement (m) of the rope over a tower contact in this step, positive towards the start of the rope.

    It is measured in unstrained rope before the contact, so that rope which runs through the mesh counts as well.
    """
    return rope_before(cable, state, state.contact_arc_length[contact]) - state.contact_origin[contact]


@inlined_kernel
def normal_force(towers, contact, depth, depth_rate):
    """Normal force (N) of a tower contact and its derivatives by depth (N/m) and by its rate (N s/m)."""
    stiffness, toe, damping = towers.stiffness[contact], towers.toe[contact], towers.damping[contact]
    return buffer_force(stiffness, toe, damping, depth, depth_rate)


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
    like = cable.gravity
    r_x = slope(state.nodes.position, point, like)
    apart = subtract(value(state.nodes.position, point, like), load(towers.position[contact], like))
    moving = value(state.nodes.velocity, point, like)
    if beside_load(cable, state, point.element):
        _, rates, _ = motion_at_rest(cable, state, point.element, state.nodes.acceleration, state.joints.acceleration)
        moving = at_place(rates, point.shape, point.shape)[0]
    side = load(towers.normal[contact], like)
    across = add_scaled(-dot(side, r_x) / dot(r_x, r_x), r_x, side)
    normal = scale(1.0 / max(sqrt(dot(across, across)), 1e-12), across)
    return r_x, apart, normal, depth_in_groove(towers, state, contact, -dot(apart, normal), like), moving


@kernel
def contact_force(cable, towers, state, contact):
    """Force (dim,) in N of a tower contact on the rope, at the rope point last found, and its normal part (N)."""
    _, r_x, apart, normal, depth, moving = contact_frame(cable, towers, state, contact)
    n, _, _ = normal_force(towers, contact, depth, -dot(normal, moving))
    z, _ = mobilise(slid(cable, state, contact), state.contact_deflection[contact], towers.presliding[contact])
    friction = towers.friction[contact] * n * z
    force = add_scaled(friction / sqrt(dot(r_x, r_x)), r_x, scale(n, normal))
    return with_groove(
        force, towers.groove[contact] * n, towers.groove_friction[contact] * n, r_x, normal, apart, moving
    ), n


@kernel
def add_towers(cable, towers, state, rate_factor, stiffness_factor, work):
    """Add forces and tangents of all tower contacts to the elements in contact.

    The normal turns with the rope as n_x = -t (n·t_x), which is exact in a plane. In space the lateral force of a
    groove grows with N as well; that it turns with the rope is left out.
    """
    like = cable.gravity
    for contact in range(towers.stiffness.size):
        work.contact_slide[contact] = 0.0
        touching, point = find_contact(cable, towers, state, contact)
        work.contact_element[contact] = point.element if touching else -1
        if not touching:
            continue
        if cable.load_nodes and towers.at_bends and add_at_bend(cable, towers, state, contact, stiffness_factor, work):
            continue
        r_x, apart, normal, depth, moving = frame_at(cable, towers, state, contact, point)
        rate = -dot(normal, moving)
        work.contact_depth[contact, 0], work.contact_depth[contact, 1] = depth, rate
        store(normal, work.contact_normal[contact])
        for i in range(4):
            work.contact_shape[contact, i] = point.shape[i]
        n, n_by_depth, n_by_rate = normal_force(towers, contact, depth, rate)
        if n == 0.0:
            continue
        norm = sqrt(dot(r_x, r_x))
        t = scale(1.0 / norm, r_x)
        coefficient = towers.friction[contact]
        way, before = slid(cable, state, contact), state.contact_deflection[contact]
        z, z_by_way = mobilise(way, before, towers.presliding[contact])
        friction = coefficient * n * z
        force = add_scaled(friction, t, scale(n, normal))
        groove, rub = towers.groove[contact] * n, towers.groove_friction[contact] * n
        whole = with_groove(force, groove, rub, r_x, normal, apart, moving)
        add_point_load(whole, point, state, work)
        if stiffness_factor == 0.0:
            continue

        r_xx, turning = bend(state.nodes.position, point, like), slope(state.nodes.velocity, point, like)
        pivot = norm * norm + dot(apart, r_xx)
        bent = dot(normal, r_xx)
        # ΔN = by_depth n·Δr + by_turn n·(Δr_x + r_xx Δs) + by_way Δs
        by_depth = -(n_by_depth + rate_factor * n_by_rate)
        by_turn = n_by_rate * dot(moving, t) / norm
        by_way = by_turn * bent - n_by_rate * dot(normal, turning)
        pushed = with_groove(  # ∂force/∂N
            add_scaled(coefficient * z, t, normal),
            towers.groove[contact],
            towers.groove_friction[contact],
            r_x,
            normal,
            apart,
            moving,
        )
        turned = scale(1.0 / norm, add_scaled(friction, normal, scale(-n, t)))  # ∂force/∂(n·r_x)
        slide = coefficient * n * z_by_way
        work.contact_slide[contact] = slide / norm
        on_way = add_scaled(by_way, pushed, add_scaled(bent, turned, scale(slide, t)))  # ∂force/∂s
        # Δs = -(r_x·Δr + (r - p)·Δr_x) / pivot
        by_r = add_scaled(1.0, outer(by_depth, pushed, normal), outer(-1.0 / pivot, on_way, r_x))
        by_r_x = outer(1.0, add_scaled(by_turn, pushed, turned), normal)
        by_r_x = add_scaled(1.0, by_r_x, outer(-1.0 / pivot, on_way, apart))
        held = groove_tangent(stiffness_factor * groove, rate_factor * rub, r_x, normal, moving)
        by_place = add_scaled(-stiffness_factor, by_r, held), scale(-stiffness_factor, by_r_x)
        share = stiffness_factor / pivot
        by_slope = outer(share, force, r_x), outer(share, force, apart)
        add_point_tangent(whole, by_place, by_slope, point, stiffness_factor, state, work)


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
        normal = scale(1.0 / max(sqrt(dot(across, across)), 1e-12), across)
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
    for contact in range(towers.stiffness.size):
        element = work.contact_element[contact]
        if element < 0:
            continue
        weights = work.contact_shape[contact]
        change = interpolate(work.right_side, element, (weights[0], weights[1], weights[2], weights[3]), like)
        deeper = -dot(load(work.contact_normal[contact], like), change)
        inertia = 0.5 * mass_factor * cable.mass_per_length * state.mesh.length[element]
        depth, rate, growth = (
            work.contact_depth[contact, 0],
            work.contact_depth[contact, 1],
            work.contact_slide[contact],
        )
        damping, toe = towers.damping[contact], towers.toe[contact]
        bent = towers.stiffness[contact] * (0.5 * (1.0 + damping * abs(rate)) / toe + rate_factor * damping)
        most = bent * deeper * deeper + growth * dot(change, change) / towers.presliding[contact]
        if most < worst * inertia:
            continue
        before, by_depth, by_rate = normal_force(towers, contact, depth, rate)
        now, _, _ = normal_force(towers, contact, depth + deeper, rate + rate_factor * deeper)
        stiff = by_depth + rate_factor * by_rate
        worst = max(worst, abs(now - before - stiff * deeper) / (inertia + stiff))
        if growth > 0.0 and before > 0.0:
            point = point_on(state, element, state.contact_arc_length[contact])
            slid_more = abs(dot(slope(state.nodes.position, point, like), change))
            share = 0.5 * slid_more / towers.presliding[contact] + abs(now - before) / before
            worst = max(worst, growth * slid_more * share / (inertia + growth))
    return worst


@kernel
def settle_towers(cable, towers, state):
    """End a step: store the mobilised friction of each tower contact and the normal load of each tower.

    Contact points are those of the last iteration: their move since then changes the depth in second order only, and
    the friction of the step is that of the sliding in that iteration.
    """
    for tower in range(towers.top.shape[0]):
        total = 0.0
        for contact in range(towers.contact_offset[tower], towers.contact_offset[tower + 1]):
            _, _, _, normal, depth, moving = contact_frame(cable, towers, state, contact)
            total += normal_force(towers, contact, depth, -dot(normal, moving))[0]
            state.contact_deflection[contact], _ = mobilise(
                slid(cable, state, contact), state.contact_deflection[contact], towers.presliding[contact]
            )
            state.contact_origin[contact] = rope_before(cable, state, state.contact_arc_length[contact])
        state.tower_load[tower, 0] = total
        state.tower_load[tower, 1] = min(state.tower_load[tower, 1], total)
        settle_groove(cable, towers, state, tower, cable.gravity)


@kernel
def settle_groove(cable: Any, towers: Any, state: Any, tower: int, like: Vector) -> None:
    """Store the lateral groove force of a tower, and its highest ratio to the normal force; no-op in a plane."""
    if len(like) == 2:
        return
    lateral, left = 0.0, load(towers.left[tower], like)
    for contact in range(towers.contact_offset[tower], towers.contact_offset[tower + 1]):
        _, r_x, apart, normal, depth, moving = contact_frame(cable, towers, state, contact)
        n, _, _ = normal_force(towers, contact, depth, -dot(normal, moving))
        across = to_that_side(sideways(r_x, normal), left)
        stiffness, rub = towers.groove[contact] * n, towers.groove_friction[contact] * n
        lateral += side_force(stiffness, rub, dot(apart, across), dot(moving, across))
    state.tower_lateral[tower, 0] = lateral
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


CREEP = 0.01  # v_0, m/s, at which friction sideways is 0.7 of what it comes to


@kernel
def depth_in_groove(towers: Any, state: Any, contact: int, depth: float, like: Vector) -> float:
    """Depth (m) of the rope in a tower contact; -inf once the rope has derailed from the tower."""
    if len(like) == 2 or state.derailment[towers.contact_tower[contact], 0] == IN_GROOVE:
        return depth
    return -inf


@kernel
def with_groove(
    force: Vector, stiffness: float, friction: float, r_x: Vector, normal: Vector, apart: Vector, moving: Vector
) -> Vector:
    """Force (dim,) in N of a tower contact, in space with the lateral force of its groove added.

    Args:
        force: of the contact without it, N.
        stiffness: g N, N/m.
        friction: μ N, N.
        r_x: along the rope (dim,).
        normal: of the contact (dim,).
        apart: r - p (dim,) in m.
        moving: velocity of the rope (dim,) in m/s.
    """
    if len(force) == 2:
        return force
    across = sideways(r_x, normal)
    return add_scaled(side_force(stiffness, friction, dot(apart, across), dot(moving, across)), across, force)


@formula
def side_force(stiffness, friction, aside, speed):
    """Lateral force (N) of a groove on a rope offset by `aside` (m) and moving sideways at `speed` (m/s)."""
    return -stiffness * aside - friction * speed / square_root(speed * speed + CREEP * CREEP)


@formula
def sideways(r_x, normal):
    """Lateral unit vector (3,) of a tower contact, across the rope and the normal."""
    across = cross(r_x, normal)
    return scale(1.0 / square_root(dot(across, across)), across)


@inlined_kernel
def to_that_side(across, side):
    """Vector `across` (3,), reversed if pointing away from `side` (3,)."""
    return scale(-1.0 if dot(across, side) < 0.0 else 1.0, across)


@inlined_kernel
def groove_tangent(stiffness: float, damping: float, r_x: Vector, normal: Vector, moving: Vector) -> Matrix:
    """Tangent (dim²) of the lateral force of a groove by the position of the rope; zeros in a plane.

    `damping` (N s/m times the integrator's 1/s) is μ N ∂velocity/∂coordinate; rest as in `with_groove`.
    """
    if len(r_x) == 2:
        return outer(0.0, r_x, r_x)
    across = sideways(r_x, normal)
    speed = dot(moving, across)
    squared = speed * speed + CREEP * CREEP
    return outer(stiffness + damping * CREEP * CREEP / (squared * sqrt(squared)), across, across)
