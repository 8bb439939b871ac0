"""Elements beside a moving load: a node of the mesh follows the load, with a slope on either side.

A node at the arc length X(t) makes the two elements beside it a mesh that moves over the rope (arbitrary
Lagrangian-Eulerian). Rope passes the node at κ = w - Ẋ, w the transport velocity of `ale`. With nodal coordinates r, t
(= r_x) there, the rope at the node has at this instant

    the velocity V = ṙ + κ t,  V_x = ṫ + w_x t + κ r_xx,
    the acceleration a = r̈ + κ̇ t + κ ṫ + κ V_x,  a_x = d(V_x)/dt + κ V_xx + w_x V_x,

and a cubic of r has cubics of V and a, so that inertia, damping and drag of an element are those of `element` with
these in the place of nodal rates. A shift δX of the node moves the rope under it by -t δX and its slope by -r_xx δX. So
the equation of X has the nodal forces of the rope's motion, and the derivative of the elastic energy by the element's
length:

    Q_X = ± dW/dl + t·Q_r + r_xx·Q_t ± ½ ρA λ κ² |t|²,  + for the element before the node.

At a node with two slopes rope changes its velocity by κ times their difference. The momentum that takes,
ρA λ κ² (t_after - t_before), is a force on r. All of this follows from one kinetic energy, ½∫ρA λ |V|² dx, and adds
no energy.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.traced import formula, square_root
from cable_twin.mechanics.language.vectors import (
    add_scaled,
    dot,
    load,
    scale,
    subtract,
)
from cable_twin.mechanics.parameters import JOINT, SPEED
from cable_twin.mechanics.rope.ale import flow_on_mesh, mesh_dilution_rate, nodal_vectors, rest_stretch
from cable_twin.mechanics.rope.elastic_models import elastic_force
from cable_twin.mechanics.rope.element import force_of_element, inertia, rates_of_strain, with_damping
from cable_twin.mechanics.rope.point import (
    AFTER,
    BEFORE,
)
from cable_twin.mechanics.rope.rope_drag import drag_on
from cable_twin.mechanics.rope.shape_functions import (
    AXIAL_POINTS,
    AXIAL_SLOPES,
    AXIAL_WEIGHT,
    BENDING_CURVATURES,
    BENDING_POINTS,
    BENDING_SLOPES,
    BENDING_WEIGHT,
    combine,
)


@inlined_kernel
def follows(state, node):
    """Return whether a node moves along with its load; a node too near an end or another load stands still."""
    number = state.node_load[node]
    return number >= 0 and state.node_follows[number]


@inlined_kernel
def is_driven(state, carriage):
    """Return whether a vehicle's drive prescribes the joint itself: speed mode, and not by a haul drum."""
    return state.axis[carriage] == JOINT and state.drives.mode[carriage] == SPEED


@inlined_kernel
def at_node(cable, state, carriage):
    """Return whether a vehicle's joint, on whichever rope, is at a mesh node that follows the joint."""
    return cable.load_nodes and state.node_follows[carriage]


@inlined_kernel
def both_slopes(coordinates, node, like):
    """Slopes (dim,) before and after a node, from its coordinates or their rates."""
    return load(coordinates[node, BEFORE], like), load(coordinates[node, AFTER], like)


@inlined_kernel
def mean_slope(coordinates, node, like):
    """Mean (dim,) of the slopes on both sides of a node, from its coordinates or their rates."""
    before, after = both_slopes(coordinates, node, like)
    return scale(0.5, add_scaled(1.0, before, after))


@inlined_kernel
def rope_past(system, state, node):
    """Speed κ (m/s) of the rope past a node, its rate along the node (m/s²), and the node's own speed (m/s)."""
    speed, rate = 0.0, 0.0
    if follows(state, node):
        number = state.node_load[node]
        speed, rate = state.joints.velocity[number], state.joints.acceleration[number]
    if system.moving_cable.moving:
        w, w_x, w_t = flow_on_mesh(system.cable, state, state.mesh.arc_length[node])
        return w - speed, w_t + speed * w_x - rate, speed
    return -speed, -rate, speed


@formula
def bends(length, e):
    """Second derivatives r_xx (dim,) in 1/m at both nodes of an element, from its nodal vectors."""
    chord = (1.0 / (length * length)) * (e[2] - e[0])
    a, b = (2.0 / length) * e[1], (2.0 / length) * e[3]
    return 6.0 * chord - 2.0 * a - b, a + 2.0 * b - 6.0 * chord


@formula
def bend_rates(length, grows, e, rates):
    """Rates (dim,) in 1/(m s) of r_xx at both nodes of an element whose length grows by `grows` (m/s)."""
    moved, turned = bends(length, rates), grows / length
    chord = (1.0 / (length * length)) * (e[2] - e[0])
    a, b = (2.0 / length) * e[1], (2.0 / length) * e[3]
    return (
        moved[0] - turned * (12.0 * chord - 2.0 * a - b),
        moved[1] - turned * (a + 2.0 * b - 12.0 * chord),
    )


@formula
def rope_motion(length, grows, e, rates, accelerations, before, after, spreads):
    """Velocities and accelerations of the rope at both nodes of an element, while the nodes may move along the rope.

    Args:
        length: of the element, m.
        grows: its rate, m/s.
        e: nodal vectors.
        rates: of them, along the nodes.
        accelerations: likewise.
        before: κ and κ̇ at the first node.
        after: at the second one.
        spreads: w_x, 1/s.
    """
    (k_a, k_a_dot), (k_b, k_b_dot) = before, after
    bend_a, bend_b = bends(length, e)
    bend_a_dot, bend_b_dot = bend_rates(length, grows, e, rates)
    v_a, v_b = rates[0] + k_a * e[1], rates[2] + k_b * e[3]
    slope_a, slope_b = rates[1] + spreads * e[1] + k_a * bend_a, rates[3] + spreads * e[3] + k_b * bend_b
    v = v_a, slope_a, v_b, slope_b
    turn_a, turn_b = bends(length, v)
    a = (
        accelerations[0] + k_a_dot * e[1] + k_a * (rates[1] + slope_a),
        accelerations[1] + spreads * (rates[1] + slope_a) + k_a_dot * bend_a + k_a * (bend_a_dot + turn_a),
        accelerations[2] + k_b_dot * e[3] + k_b * (rates[3] + slope_b),
        accelerations[3] + spreads * (rates[3] + slope_b) + k_b_dot * bend_b + k_b * (bend_b_dot + turn_b),
    )
    return v, a


@inlined_kernel
def motion_of_rope(system, state, element, accelerations):
    """Nodal vectors of an element beside a moving load, with velocities and accelerations of the rope at its nodes.

    Takes the accelerations of the nodal coordinates (nodes, rows, dim): the true ones, or the auxiliary ones.
    """
    like, length = system.cable.gravity, state.mesh.length[element]
    k_a, k_a_dot, speed_a = rope_past(system, state, element)
    k_b, k_b_dot, speed_b = rope_past(system, state, element + 1)
    e = nodal_vectors(state.nodes.position, element, like)
    rates = nodal_vectors(state.nodes.velocity, element, like)
    spreads = 0.0
    if system.moving_cable.moving:
        spreads = -mesh_dilution_rate(system.cable, state)
    v, a = rope_motion(
        length,
        speed_b - speed_a,
        e,
        rates,
        nodal_vectors(accelerations, element, like),
        (k_a, k_a_dot),
        (k_b, k_b_dot),
        spreads,
    )
    return e, v, a


@kernel
def by_length(cable, length, d, a, b):
    """Derivatives of the elastic energy of `continuum` by the rest length at given d, a, b: first, second, mixed.

    Returns:
        dW/dl (N), d²W/dl² (N/m), and d²W/dl d(d, a, b), three vectors (dim,) in N/m.
    """
    zero, per_length = scale(0.0, d), 1.0 / length
    first, second = 0.0 * length, 0.0 * length
    by_d, by_a, by_b = zero, zero, zero
    for point in range(AXIAL_POINTS):  # ½ EA l ε², ε = |ρ| / l - (1 + α ΔT)
        slopes = AXIAL_SLOPES[point]
        rho = combine(slopes, d, a, b)
        stretch = square_root(dot(rho, rho)) * per_length
        weight = AXIAL_WEIGHT[point] * cable.axial_stiffness
        first -= weight * 0.5 * (stretch * stretch - cable.free_stretch * cable.free_stretch)
        second += weight * stretch * stretch * per_length
        mixed = -weight * per_length * per_length
        by_d = add_scaled(mixed * slopes[0], rho, by_d)
        by_a = add_scaled(mixed * slopes[1], rho, by_a)
        by_b = add_scaled(mixed * slopes[2], rho, by_b)
    for point in range(BENDING_POINTS):  # ½ EI |P χ|² / (ρ² l)
        slopes, curvatures = BENDING_SLOPES[point], BENDING_CURVATURES[point]
        rho, chi = combine(slopes, d, a, b), combine(curvatures, d, a, b)
        inverse_squared = 1.0 / dot(rho, rho)
        stretch_gradient = dot(rho, chi) * inverse_squared
        bent = add_scaled(-stretch_gradient, rho, chi)
        weight = BENDING_WEIGHT[point] * cable.bending_stiffness * inverse_squared * per_length
        energy = 0.5 * weight * dot(bent, bent)
        first -= energy * per_length
        second += 2.0 * energy * per_length * per_length
        moment = scale(-weight * per_length, bent)
        on_rho = add_scaled(-dot(bent, moment) * inverse_squared, rho, scale(-stretch_gradient, moment))
        by_d = add_scaled(slopes[0], on_rho, add_scaled(curvatures[0], moment, by_d))
        by_a = add_scaled(slopes[1], on_rho, add_scaled(curvatures[1], moment, by_a))
        by_b = add_scaled(slopes[2], on_rho, add_scaled(curvatures[2], moment, by_b))
    return first, second, by_d, by_a, by_b


@formula
def shift_vectors(end, e, length):
    """Slope and r_xx (dim,) at an element's end, 0 or 1: minus changes of r and r_x by a shift of its moving node."""
    bend_a, bend_b = bends(length, e)
    first = 1.0 - end
    return first * e[1] + end * e[3], first * bend_a + end * bend_b


@inlined_kernel
def forces_by_motion(system, state, length, motion, wind):
    """Nodal forces (dim,) on r_A, slope A, r_B, slope B of one or `WIDTH` elements: elastic ones, sum of all others.

    Those on positions are in N, those on slopes in N m. The others are inertia, weight, damping and drag.

    Args:
        system: parameters.
        state: for rest stretch and dilution.
        length: of the element, m.
        motion: nodal vectors, and velocities and accelerations of the rope, as of `motion_of_rope`.
        wind: (dim,) m/s.
    """
    cable, (e, v, a) = system.cable, motion
    stretch, shape = rest_stretch(cable, state), (subtract(e[2], e[0]), scale(length, e[1]), scale(length, e[3]))
    still, at_rest = scale(0.0, shape[0]), stretch * length
    on_d, on_a, on_b = elastic_force(cable, at_rest, *shape, still, still, still, 0.0, 0.0)[:3]
    elastic = on_d, scale(-length, on_a), scale(-1.0, on_d), scale(-length, on_b)
    inert = inertia(cable, length, stretch, *with_damping(cable, a, v))
    r_a, t_a, r_b, t_b = (
        scale(-1.0, inert[0]),
        scale(-length, inert[1]),
        scale(-1.0, inert[2]),
        scale(-length, inert[3]),
    )
    if cable.damping_time > 0.0:
        rates = subtract(v[2], v[0]), scale(length, v[1]), scale(length, v[3])
        rates = rates_of_strain(mesh_dilution_rate(cable, state), shape, rates)
        whole = elastic_force(cable, at_rest, *shape, *rates, 0.0, 0.0)[:3]
        d, a, b = subtract(whole[0], on_d), subtract(whole[1], on_a), subtract(whole[2], on_b)
        r_a, t_a = add_scaled(1.0, d, r_a), add_scaled(-length, a, t_a)
        r_b, t_b = add_scaled(-1.0, d, r_b), add_scaled(-length, b, t_b)
    if system.air.present:
        drag = system.air.rope_drag
        r_a = add_scaled(1.0, drag_on(drag, wind, length, shape, v, 0), r_a)
        t_a = add_scaled(length, drag_on(drag, wind, length, shape, v, 1), t_a)
        r_b = add_scaled(1.0, drag_on(drag, wind, length, shape, v, 2), r_b)
        t_b = add_scaled(length, drag_on(drag, wind, length, shape, v, 3), t_b)
    return elastic, (r_a, t_a, r_b, t_b)


@inlined_kernel
def with_passing_rope(system, state, forces, motion, passing):
    """Nodal forces (dim,) of one or `WIDTH` elements beside a load, with the momentum of rope passing their nodes.

    Takes both parts of `forces_by_motion`, the motion, and the speeds κ (m/s) of rope past both nodes.
    """
    (elastic, others), (e, _, _), (k_a, k_b) = forces, motion, passing
    mass = system.cable.mass_per_length * rest_stretch(system.cable, state)
    return (
        add_scaled(-mass * k_a * k_a, e[1], add_scaled(1.0, elastic[0], others[0])),
        add_scaled(1.0, elastic[1], others[1]),
        add_scaled(mass * k_b * k_b, e[3], add_scaled(1.0, elastic[2], others[2])),
        add_scaled(1.0, elastic[3], others[3]),
    )


@inlined_kernel
def forces_along(system, state, length, forces, motion, passing):
    """Generalized forces Q_X (N) on the arc lengths of both nodes, of one or `WIDTH` elements beside a moving load.

    Takes the length (m), and the arguments of `with_passing_rope`.
    """
    (elastic, others), (e, _, _), (k_a, k_b), cable = forces, motion, passing, system.cable
    stretch, shape = rest_stretch(cable, state), (subtract(e[2], e[0]), scale(length, e[1]), scale(length, e[3]))
    first = stretch * by_length(cable, stretch * length, *shape)[0]
    first = first - (dot(elastic[1], e[1]) + dot(elastic[3], e[3])) / length
    mass, (_, bend_a), (_, bend_b) = (
        cable.mass_per_length * stretch,
        shift_vectors(0, e, length),
        shift_vectors(1, e, length),
    )
    along_a = dot(e[1], others[0]) + dot(bend_a, others[1]) - first - 0.5 * mass * k_a * k_a * dot(e[1], e[1])
    along_b = dot(e[3], others[2]) + dot(bend_b, others[3]) + first + 0.5 * mass * k_b * k_b * dot(e[3], e[3])
    return along_a, along_b


@inlined_kernel
def on_element(system, state, element):
    """Length (m), rope motion, wind and speeds of the rope past the nodes, of an element beside a moving load."""
    return (
        state.mesh.length[element],
        motion_of_rope(system, state, element, state.nodes.acceleration),
        load(state.wind_field.along_rope[:, element], system.cable.gravity),
        (rope_past(system, state, element)[0], rope_past(system, state, element + 1)[0]),
    )


@kernel
def pull_at_node(system, state, node):
    """Generalized force Q_X (N) along the rope of both elements beside a node that follows a moving load."""
    total = 0.0
    for end in range(2):
        length, motion, wind, passing = on_element(system, state, node - end)
        forces = forces_by_motion(system, state, length, motion, wind)
        total += forces_along(system, state, length, forces, motion, passing)[end]
    return total


@kernel
def force_beside_load(system, state, element, row):
    """Nodal force (dim,) in N of an element beside a load with all distributed loads, on r_A (row 0) or r_B (2)."""
    cable, like, node = system.cable, system.cable.gravity, element + row // 2
    length, motion, wind, _ = on_element(system, state, element)
    elastic, others = forces_by_motion(system, state, length, motion, wind)
    force = add_scaled(1.0, elastic[row], others[row])
    if not system.moving_cable.moving:
        return force
    speed = flow_on_mesh(cable, state, state.mesh.arc_length[node])[0]  # its momentum is in no nodal force, as in `ale`
    flux = cable.mass_per_length * rest_stretch(cable, state) * speed * speed
    slope = load(state.nodes.position[node, AFTER if row == 0 else BEFORE], like)
    return add_scaled(-flux if row == 0 else flux, slope, force)


@inlined_kernel
def beside_load(cable, state, element):
    """Return whether an element has a node that follows a moving load."""
    return cable.load_nodes and (state.node_load[element] >= 0 or state.node_load[element + 1] >= 0)


@kernel
def nodal_force(system, state, element, row):
    """Nodal force (dim,) in N of any element with all distributed loads, on r_A (row 0) or r_B (row 2)."""
    if beside_load(system.cable, state, element):
        return force_beside_load(system, state, element, row)
    return force_of_element(system, state, element, row)


@inlined_kernel
def travel(state, node, rates):
    """Rate of a node along the mesh: the entry in `rates` (vehicles,) of the moving load that it follows, else 0."""
    return rates[state.node_load[node]] if follows(state, node) else 0.0


@inlined_kernel
def motion_at_rest(cable, state, element, nodal, along):
    """Nodal vectors of an element, with velocities and accelerations of the rope at fixed arc lengths of the mesh.

    Takes the accelerations of nodal coordinates (nodes, rows, dim) and of arc lengths (vehicles,).
    """
    like, speeds = cable.gravity, state.joints.velocity
    speed_a, speed_b = travel(state, element, speeds), travel(state, element + 1, speeds)
    e = nodal_vectors(state.nodes.position, element, like)
    v, a = rope_motion(
        state.mesh.length[element],
        speed_b - speed_a,
        e,
        nodal_vectors(state.nodes.velocity, element, like),
        nodal_vectors(nodal, element, like),
        (-speed_a, -travel(state, element, along)),
        (-speed_b, -travel(state, element + 1, along)),
        0.0,
    )
    return e, v, a
