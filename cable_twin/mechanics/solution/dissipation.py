"""Numerical dissipation of generalized-alpha: energy lost without damper, friction or brake.

All forces of a step are in balance with M q_ddot at both of its ends, so that by the trapezoidal rule their work is
½ (q_ddot + q_ddot')·M Δq. The kinetic energy changes by ½ (q_dot + q_dot')·M Δq_dot, to the last bit. With the updates
of the method, the difference is the change of a function of the state, which comes back, and

    h² w·M (η² Δq_ddot + (η (γ - ½) - (½ γ - β)) Δa),  w = (½ - α_m) Δa - η Δq_ddot,  η = ½ - α_f,

which is never given back; a is the auxiliary acceleration. It is 0 with the trapezoidal rule, and needs no forces, so
that it knows nothing of drives, brakes, friction, wind, buffers or loads. Beside it stands the error of the trapezoidal
rule where that is large: on the tension of a rope that turns, and on the forces of joints, which do no work at all.
Left out is that on forces of dampers and contacts.
"""

from __future__ import annotations

from cable_twin.mechanics.drives.joint_drive import joint_forces
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.rotations import cross, inertia_of, no_turn, orientation, turn_between
from cable_twin.mechanics.language.simd import WIDTH, gather, gather_numbers, sum_of_lanes
from cable_twin.mechanics.language.traced import formula
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, subtract
from cable_twin.mechanics.language.vectors import product as times
from cable_twin.mechanics.on_rope.chain import arm_to, axes_of
from cable_twin.mechanics.on_rope.presence import rides
from cable_twin.mechanics.rope.ale import nodal_vectors
from cable_twin.mechanics.rope.elastic_models import combine
from cable_twin.mechanics.rope.patch import at_node
from cable_twin.mechanics.rope.point import point_on, slope, value
from cable_twin.mechanics.rope.shape_functions import AXIAL_POINTS, AXIAL_SLOPES, AXIAL_WEIGHT, MASS

EVERY = 13  # steps, of which one is looked at and stands for all; of no common measure with those of a frame
SECOND = 2  # steps, of which one is looked at for the error of the trapezoidal rule, which has either sign


@kernel
def numerical_loss(system, before, after, c, h):
    """Energy lost by the integrator in a step of one rope, and change of its kinetic energy (J).

    Counted are cable, counterweights and bodies that were on the cable all the time.

    Args:
        system: parameters.
        before: state at the start of the step.
        after: state at the end of the step.
        c: coefficients of the method.
        h: length of the step, s.
    """
    factors = loss_factors(c, h)
    lost, moved = cable_loss(system.cable, before, after, factors)
    for end in range(2):
        here, there = counterweight_loss(system, before.nodes, after.nodes, end, factors)
        lost, moved = lost + here, moved + there
    for carriage in range(system.carriages.fixed.size):
        if rides(system, before, carriage) and rides(system, after, carriage):
            for body in range(system.carriages.body_offset[carriage], system.carriages.body_offset[carriage + 1]):
                here, there = body_loss(system, before, after, body, factors)
                lost, moved = lost + here, moved + there
    return lost, abs(moved)


@kernel
def loss_factors(c, h):
    """Factors p, q, r, s of the integrator's energy loss (p Δa + q Δq_ddot)·M (r Δa + s Δq_ddot); h² is in r and s."""
    eta = 0.5 - c.alpha_f
    return 0.5 - c.alpha_m, -eta, h * h * (eta * (c.gamma - 0.5) - 0.5 * c.gamma + c.beta), h * h * eta * eta


@kernel
def trapezoidal_error(system, before, after):
    """Spurious energy loss (J) of the trapezoidal rule in a step, on rope tension and on joint forces."""
    cable = system.cable
    lost = stretching_error(cable, before, after)
    for carriage in range(system.carriages.fixed.size):
        if rides(system, before, carriage) and rides(system, after, carriage):
            lost -= 0.5 * joint_work(system, before, before, after, carriage)
            lost -= 0.5 * joint_work(system, after, before, after, carriage)
    return lost


@inlined_kernel
def changed(start, end, like):
    """Change of a vector (dim,) over a step, from its rows at start and end of the step."""
    return subtract(load(end, like), load(start, like))


@kernel
def body_loss(system, before, after, body, factors):
    """Energy lost by the integrator and change of kinetic energy (J) of one body, translation and rotation."""
    like, carriages, (p, q, r, s) = system.cable.gravity, system.carriages, factors
    first, last, still = before.bodies, after.bodies, no_turn(system.cable.gravity)
    by, true = first.algorithmic[body], first.acceleration[body]
    a, b = changed(by, last.algorithmic[body], like), changed(true, last.acceleration[body], like)
    lost = carriages.mass[body] * dot(add_scaled(p, a, scale(q, b)), add_scaled(r, a, scale(s, b)))
    gain = changed(first.velocity[body], last.velocity[body], like)
    speed = add_scaled(1.0, load(last.velocity[body], like), load(first.velocity[body], like))
    change = 0.5 * carriages.mass[body] * dot(speed, gain)
    dim = len(like)
    a = changed(by[dim:], last.algorithmic[body, dim:], still)
    b = changed(true[dim:], last.acceleration[body, dim:], still)
    inertia = inertia_of(carriages.inertia, body, orientation(last.position[body], like), like)
    lost += dot(add_scaled(p, a, scale(q, b)), times(inertia, add_scaled(r, a, scale(s, b))))
    return lost, change + spun(carriages, last, body, like) - spun(carriages, first, body, like)


@kernel
def spun(carriages, bodies, body, like):
    """Rotational kinetic energy (J) of a body."""
    inertia = inertia_of(carriages.inertia, body, orientation(bodies.position[body], like), like)
    spin = load(bodies.velocity[body, len(like) :], no_turn(like))
    return 0.5 * dot(spin, times(inertia, spin))


@kernel
def joint_work(system, at, before, after, carriage):
    """Work (J) of a vehicle's joint forces, as in state `at`, over the displacement of the vehicle in a whole step."""
    cable, like = system.cable, system.cable.gravity
    place, element = at.joints.position[carriage], at.joint_element[carriage]
    point = point_on(at, element, place)
    if at_node(cable, before, carriage) and at_node(cable, after, carriage):
        node = at.joint_node[carriage]
        above = changed(before.nodes.position[node, 0], after.nodes.position[node, 0], like)
        return chain_work(system, at, before, after, carriage, above)
    above = subtract(value(after.nodes.position, point, like), value(before.nodes.position, point, like))
    slid = after.joints.position[carriage] - before.joints.position[carriage]
    return chain_work(
        system, at, before, after, carriage, add_scaled(slid, slope(at.nodes.position, point, like), above)
    )


@inlined_kernel
def chain_work(system, at, before, after, carriage, above):
    """Work (J) of the joint forces of a vehicle over a displacement `above` (dim,) in m of the rope at its joint."""
    carriages, like, work = system.carriages, system.cable.gravity, 0.0
    first = carriages.body_offset[carriage]
    for body in range(first, carriages.body_offset[carriage + 1]):
        way = subtract(load(after.bodies.position[body], like), load(before.bodies.position[body], like))
        turn, axes = (
            turn_between(before.bodies.position[body], after.bodies.position[body], like),
            axes_of(at, body, like),
        )
        upper = add_scaled(1.0, cross(turn, arm_to(axes, carriages.upper_pivot[body], like)), way)
        if body > first:
            work += dot(load(at.multipliers[body], like), subtract(upper, above))
        else:
            work += dot(joint_forces(system, at, carriage)[0], subtract(upper, above))
        above = add_scaled(1.0, cross(turn, arm_to(axes, carriages.lower_pivot[body], like)), way)
    return work


@formula
def combined(weight, start, end, length):
    """Four nodal vectors (dim,) at the end of a step plus `weight` times those at its start, slopes times length."""
    return (
        add_scaled(weight, start[0], end[0]),
        scale(length, add_scaled(weight, start[1], end[1])),
        add_scaled(weight, start[2], end[2]),
        scale(length, add_scaled(weight, start[3], end[3])),
    )


@formula
def mixed(p, a, q, b):
    """Sum p a + q b of two sets of four nodal vectors."""
    return (
        add_scaled(p, a[0], scale(q, b[0])),
        add_scaled(p, a[1], scale(q, b[1])),
        add_scaled(p, a[2], scale(q, b[2])),
        add_scaled(p, a[3], scale(q, b[3])),
    )


@formula
def product(one, other):
    """Bilinear form xᵀ M y of two sets of four nodal vectors, with the mass matrix M of eq. 5 for unit mass."""
    total = 0.0
    for i in range(4):
        row = scale(MASS[i][0], other[0])
        row = add_scaled(MASS[i][1], other[1], row)
        row = add_scaled(MASS[i][2], other[2], row)
        total += dot(one[i], add_scaled(MASS[i][3], other[3], row))
    return total


@inlined_kernel
def cable_loss(cable, start, end, factors):
    """Energy lost by the integrator and change of kinetic energy (J) of the consistent mass of all elements.

    Elements are computed `WIDTH` at a time, and those that are left over one by one; those beside loads, whose nodes
    move over the rope, are left out.
    """
    like, lengths, before, after = cable.gravity, end.mesh.length, start.nodes, end.nodes
    grouped = cable.element_count - cable.element_count % WIDTH
    lanes = 0.0 * gather(after.position, 0, like)[0][0]
    sums = lanes, lanes
    for element in range(0, grouped, WIDTH):
        here, there = elements_loss(
            cable.mass_per_length,
            gather_numbers(lengths, element),
            factors,
            (gather(before.algorithmic, element, like), gather(after.algorithmic, element, like)),
            (gather(before.acceleration, element, like), gather(after.acceleration, element, like)),
            (gather(before.velocity, element, like), gather(after.velocity, element, like)),
        )
        if cable.load_nodes:
            plain = gather_numbers(start.mesh.plain, element) * gather_numbers(end.mesh.plain, element)
            here, there = plain * here, plain * there
        sums = sums[0] + here, sums[1] + there
    lost, moved = sum_of_lanes(sums[0]), sum_of_lanes(sums[1])
    for element in range(grouped, cable.element_count):
        here, there = elements_loss(
            cable.mass_per_length,
            lengths[element],
            factors,
            (nodal_vectors(before.algorithmic, element, like), nodal_vectors(after.algorithmic, element, like)),
            (nodal_vectors(before.acceleration, element, like), nodal_vectors(after.acceleration, element, like)),
            (nodal_vectors(before.velocity, element, like), nodal_vectors(after.velocity, element, like)),
        )
        plain = start.mesh.plain[element] * end.mesh.plain[element]
        lost, moved = lost + plain * here, moved + plain * there
    return lost, moved


@inlined_kernel
def elements_loss(mass_per_length, length, factors, auxiliary, true, rates):
    """Energy lost by the integrator and change of kinetic energy (J) of one or `WIDTH` elements, from nodal vectors."""
    p, q, r, s = factors
    a, b = combined(-1.0, auxiliary[0], auxiliary[1], length), combined(-1.0, true[0], true[1], length)
    gain, speed = combined(-1.0, rates[0], rates[1], length), combined(1.0, rates[0], rates[1], length)
    mass = mass_per_length * length
    return mass * product(mixed(p, a, q, b), mixed(r, a, s, b)), 0.5 * mass * product(speed, gain)


@inlined_kernel
def stretching_error(cable, before, after):
    """Energy error (J) of the trapezoidal rule on the tension of all elements of a rope, `WIDTH` at a time."""
    like, first, last = cable.gravity, before.nodes.position, after.nodes.position
    grouped = cable.element_count - cable.element_count % WIDTH
    lanes = 0.0 * gather(last, 0, like)[0][0]
    for element in range(0, grouped, WIDTH):
        length = gather_numbers(after.mesh.length, element)
        error = tension_error(length, gather(first, element, like), gather(last, element, like))
        if cable.load_nodes:
            error = gather_numbers(before.mesh.plain, element) * gather_numbers(after.mesh.plain, element) * error
        lanes += error
    total = sum_of_lanes(lanes)
    for element in range(grouped, cable.element_count):
        length = after.mesh.length[element]
        error = tension_error(length, nodal_vectors(first, element, like), nodal_vectors(last, element, like))
        total += before.mesh.plain[element] * after.mesh.plain[element] * error
    return cable.axial_stiffness * total


@inlined_kernel
def tension_error(length, start, end):
    """Error (m) of the trapezoidal rule in time for the elongation of an element in a step: ½ ∫(1 - t·t')(ε' - ε)dx.

    With the strain ε = |r_x| - 1 of `continuum`, unit tangent t, it is the excess of the trapezoidal rule over the
    strain energy, to the last bit; here with ε neglected beside 1: with ρ = l r_x and δ = |ρ'| - |ρ|, 1 - t·t' is
    (|Δρ|² - δ²) / 2 l².
    """
    e = subtract(end[0], start[0]), subtract(end[1], start[1]), subtract(end[2], start[2]), subtract(end[3], start[3])
    moved = subtract(e[2], e[0]), scale(length, e[1]), scale(length, e[3])
    middle = (
        subtract(add_scaled(1.0, start[2], end[2]), add_scaled(1.0, start[0], end[0])),
        scale(length, add_scaled(1.0, start[1], end[1])),
        scale(length, add_scaled(1.0, start[3], end[3])),
    )
    total, per_length = 0.0 * length, 1.0 / length
    for point in range(AXIAL_POINTS):
        change = combine(AXIAL_SLOPES[point], *moved)
        longer = 0.5 * per_length * dot(change, combine(AXIAL_SLOPES[point], *middle))
        total += AXIAL_WEIGHT[point] * (dot(change, change) - longer * longer) * longer
    return 0.25 * per_length * per_length * total


@kernel
def counterweight_loss(system, before, after, end, factors):
    """Energy lost by the integrator and change of kinetic energy (J) of the counterweight at an end."""
    mass = system.counterweights.mass[end]
    if not mass > 0.0:
        return 0.0, 0.0
    like, node, (p, q, r, s) = system.cable.gravity, 0 if end == 0 else system.cable.element_count, factors
    direction = load(system.counterweights.direction[end], like)
    a = dot(direction, changed(before.algorithmic[node, 0], after.algorithmic[node, 0], like))
    b = dot(direction, changed(before.acceleration[node, 0], after.acceleration[node, 0], like))
    late, early = (
        dot(direction, load(after.velocity[node, 0], like)),
        dot(direction, load(before.velocity[node, 0], like)),
    )
    return mass * (p * a + q * b) * (r * a + s * b), 0.5 * mass * (late * late - early * early)
