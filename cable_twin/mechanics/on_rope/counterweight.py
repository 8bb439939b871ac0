"""Counterweight at an end of the cable: constant force along a line, with the inertia of the weight."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import accumulate, dot, load, outer, scale, subtract
from cable_twin.mechanics.on_rope.buffer import buffer_energy, buffer_force


@kernel
def counterweight_motion(counterweights, cable, state, end):
    """Travel (m), speed (m/s) and acceleration (m/s²) of the counterweight at `end`, in the direction of its pull."""
    like = cable.gravity
    node = 0 if end == 0 else cable.element_count
    direction = load(counterweights.direction[end], like)
    travel = dot(subtract(load(state.nodes.position[node, 0], like), load(cable.end_position[end], like)), direction)
    speed = dot(load(state.nodes.velocity[node, 0], like), direction)
    return travel, speed, dot(load(state.nodes.acceleration[node, 0], like), direction)


@kernel
def limit_force(counterweights, end, travel, speed):
    """Force (N) of a counterweight's travel-limit buffers along its pull, and its derivatives by travel and speed."""
    low, high = counterweights.travel[end, 0], counterweights.travel[end, 1]
    sign, depth = (1.0, low - travel) if travel < low else (-1.0, travel - high)
    stiffness, damping = counterweights.stiffness[end], counterweights.damping[end]
    force, by_depth, by_rate = buffer_force(stiffness, 0.0, damping, depth, -sign * speed)
    return sign * force, -by_depth, -by_rate


@kernel
def add_counterweights(counterweights, cable, state, mass_factor, rate_factor, stiffness_factor, work):
    """Add force, inertia and buffers of the counterweights to the nodes at the ends of the cable."""
    for end in range(2):
        mass = counterweights.mass[end]
        if mass > 0.0:
            node = 0 if end == 0 else cable.element_count
            direction = load(counterweights.direction[end], cable.gravity)
            travel, speed, acceleration = counterweight_motion(counterweights, cable, state, end)
            buffer, by_travel, by_speed = limit_force(counterweights, end, travel, speed)
            pull = counterweights.force[end] + buffer - mass * acceleration
            accumulate(scale(pull, direction), work.right_side[node, 0])
            stiff = mass_factor * mass - stiffness_factor * (by_travel + rate_factor * by_speed)
            accumulate(outer(stiff, direction, direction), work.diagonal[node, 0, 0])


@kernel
def counterweight_energies(counterweights, cable, state, end):
    """Kinetic, elastic buffer and potential energy (J) of the counterweight at `end`; potential zero at travel 0."""
    if not counterweights.mass[end] > 0.0:
        return 0.0, 0.0, 0.0
    travel, speed, _ = counterweight_motion(counterweights, cable, state, end)
    depth = max(counterweights.travel[end, 0] - travel, travel - counterweights.travel[end, 1])
    return (
        0.5 * counterweights.mass[end] * speed * speed,
        buffer_energy(counterweights.stiffness[end], 0.0, depth),
        -counterweights.force[end] * travel,
    )
