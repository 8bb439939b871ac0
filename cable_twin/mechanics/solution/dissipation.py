"""What generalized-alpha itself loses: energy that no damper, friction or brake has taken.

All forces of a step are in balance with M q_ddot at both of its ends, so that by the trapezoidal rule their work is
½ (q_ddot + q_ddot')·M Δq. The kinetic energy changes by ½ (q_dot + q_dot')·M Δq_dot, to the last bit. The difference,

    ½ (q_ddot + q_ddot')·M Δq - ½ (q_dot + q_dot')·M Δq_dot,

is 0 with the trapezoidal rule and otherwise what the method takes out of motion that is fast for its step. It needs no
forces, and so no account of drives, brakes, friction, wind, buffers or loads: what these give and take is in the first
part. What is left out is the error of the trapezoidal rule on forces that change much in a step.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.formulas import formula
from cable_twin.mechanics.language.orientations import inertia_of, orientation, turn_between
from cable_twin.mechanics.language.turns import gyration, no_turn
from cable_twin.mechanics.language.vectors import add_scaled, dot, load, scale, subtract
from cable_twin.mechanics.language.vectors import product as times
from cable_twin.mechanics.rope.point import coordinate
from cable_twin.mechanics.rope.shape_functions import MASS

EVERY = 13  # steps, of which one is looked at and stands for all; of no common measure with those of a frame


@kernel
def numerical_loss(system, before, after):
    """What a step from `before` to `after` has lost, and by how much it has changed the kinetic energy (J).

    Counted are cable, counterweights and bodies that were on the cable all the time.
    """
    lost, moved = 0.0, 0.0
    for element in range(system.cable.element_count):
        here, there = cable_loss(system.cable, before.nodes, after.nodes, element)
        lost, moved = lost + here, moved + there
    for end in range(2):
        here, there = counterweight_loss(system, before.nodes, after.nodes, end)
        lost, moved = lost + here, moved + there
    for carriage in range(system.carriages.fixed.size):
        if before.attached[carriage] and after.attached[carriage]:
            for body in range(system.carriages.body_offset[carriage], system.carriages.body_offset[carriage + 1]):
                here, there = body_loss(system, before, after, body)
                lost, moved = lost + here, moved + there
    return lost, abs(moved)


@kernel
def body_loss(system, before, after, body):
    """The same of one body (J): of its centre of mass, and of its turn θ with the moment J ω_dot + ω x J ω."""
    like, carriages = system.cable.gravity, system.carriages
    first, last = before.bodies, after.bodies
    way = subtract(load(last.position[body], like), load(first.position[body], like))
    gain = subtract(load(last.velocity[body], like), load(first.velocity[body], like))
    speed = add_scaled(1.0, load(last.velocity[body], like), load(first.velocity[body], like))
    pull = add_scaled(1.0, load(last.acceleration[body], like), load(first.acceleration[body], like))
    change = 0.5 * carriages.mass[body] * dot(speed, gain)
    work = 0.5 * carriages.mass[body] * dot(pull, way)
    turn = turn_between(first.position[body], last.position[body], like)
    early, late = turning(carriages, first, body, like), turning(carriages, last, body, like)
    spun = late[1] - early[1]
    return work + 0.5 * dot(add_scaled(1.0, early[0], late[0]), turn) - change - spun, change + spun


@kernel
def turning(carriages, bodies, body, like):
    """Moment (turns,) in N m that turns a body as it does, and its energy of that (J)."""
    axes = orientation(bodies.position[body], like)
    inertia = inertia_of(carriages.inertia, body, axes, like)
    spin = load(bodies.velocity[body, len(like) :], no_turn(like))
    acceleration = load(bodies.acceleration[body, len(like) :], spin)
    moment, _ = gyration(inertia, spin, acceleration, no_turn(like), 0.0, 0.0, 0.0)
    return moment, 0.5 * dot(spin, times(inertia, spin, spin))


@formula
def between(weight, start, end, element, length, like):
    """The four coordinates (dim,) of an element at the end plus `weight` times those at the start, slopes times l."""
    return (
        add_scaled(weight, coordinate(start, element, 0, like), coordinate(end, element, 0, like)),
        scale(length, add_scaled(weight, coordinate(start, element, 1, like), coordinate(end, element, 1, like))),
        add_scaled(weight, coordinate(start, element, 2, like), coordinate(end, element, 2, like)),
        scale(length, add_scaled(weight, coordinate(start, element, 3, like), coordinate(end, element, 3, like))),
    )


@formula
def product(one, other):
    """Four coordinates times the mass matrix of eq. 5 times four others."""
    total = 0.0
    for i in range(4):
        row = scale(MASS[i][0], other[0])
        row = add_scaled(MASS[i][1], other[1], row)
        row = add_scaled(MASS[i][2], other[2], row)
        total += dot(one[i], add_scaled(MASS[i][3], other[3], row))
    return total


@kernel
def cable_loss(cable, before, after, element):
    """The same of the consistent mass of one element (J)."""
    like, length = cable.gravity, cable.element_length[element]
    way = between(-1.0, before.position, after.position, element, length, like)
    gain = between(-1.0, before.velocity, after.velocity, element, length, like)
    pull = between(1.0, before.acceleration, after.acceleration, element, length, like)
    speed = between(1.0, before.velocity, after.velocity, element, length, like)
    half, change = 0.5 * cable.mass_per_length * length, product(speed, gain)
    return half * (product(pull, way) - change), half * change


@kernel
def counterweight_loss(system, before, after, end):
    """The same of what pulls an end (J)."""
    mass = system.counterweights.mass[end]
    if not mass > 0.0:
        return 0.0, 0.0
    like, node = system.cable.gravity, 0 if end == 0 else system.cable.element_count
    direction = load(system.counterweights.direction[end], like)
    way = dot(direction, load(after.position[node, 0], like)) - dot(direction, load(before.position[node, 0], like))
    late, early = (
        dot(direction, load(after.velocity[node, 0], like)),
        dot(direction, load(before.velocity[node, 0], like)),
    )
    pull = dot(direction, load(after.acceleration[node, 0], like))
    pull = 0.5 * (pull + dot(direction, load(before.acceleration[node, 0], like)))
    change = 0.5 * mass * (late * late - early * early)
    return mass * pull * way - change, change
