"""Dry friction of a vehicle's joint with presliding (Dahl), and that of its track-rope brake.

Friction of the rope at towers is in `on_rope.tower`: the same law (`mobilise`) over the sliding distance of the rope.
Another friction law of joints needs no more than the normal force that `friction_force` takes.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.simd import magnitude
from cable_twin.mechanics.language.traced import exponential, formula, if_less, square_root
from cable_twin.mechanics.language.vectors import add_scaled, dot
from cable_twin.mechanics.on_rope.brakes import brake_force
from cable_twin.mechanics.parameters import TRACK_ROPE


@kernel
def mobilise(way, before, presliding):
    """Mobilised share z (-1..1) of a friction limit after a slip `way` (m) from share `before`, and dz/dway (1/m).

    Dahl's law dz/ds = (1 - z sign(ṡ)) / p, in closed form over the way since the start of the step. It is smooth
    through zero speed and holds still on a slope, since z changes with the way and not with time; a joint that goes
    on vibrating there creeps (docs/theory.md). All are numbers, or SIMD lanes.
    """
    sign = if_less(way, 0.0, -1.0, 1.0)
    left = (before - sign) * exponential(-magnitude(way) / presliding)
    return sign + left, -sign * left / presliding


@kernel
def deflection(carriages, state, carriage):
    """Mobilised share -1..1 of the rolling friction of a vehicle, and its derivative by arc length (1/m)."""
    way = state.joints.position[carriage] - state.friction_origin[carriage]
    return mobilise(way, state.friction_deflection[carriage], carriages.presliding[carriage])


@kernel
def friction_force(carriages, state, carriage, normal):
    """Friction force (N) along the cable on a vehicle at a normal force (N); derivatives by s, ṡ and normal force.

    A track-rope brake grips with its own force, and holds and slips by the same law.
    """
    z, z_by_s = deflection(carriages, state, carriage)
    rolling, viscous = carriages.rolling_friction[carriage], carriages.viscous_friction[carriage]
    grip = rolling * normal
    if state.drives.braking[carriage]:
        grip += brake_force(carriages, state, carriage, TRACK_ROPE)
    force = -grip * z - viscous * state.joints.velocity[carriage]
    return force, -grip * z_by_s, -viscous, -rolling * z


@kernel
def settle_friction(carriages, state, carriage):
    """End a step: store the mobilised friction of a vehicle's joint as the start of the next step."""
    state.friction_deflection[carriage], _ = deflection(carriages, state, carriage)
    state.friction_origin[carriage] = state.joints.position[carriage]


@formula
def along_and_across(force, r_x):
    """Split a force (dim,) in N by the tangent r_x: |r_x| (-), tangential part, normal part (dim,) and its size (N)."""
    norm = square_root(dot(r_x, r_x))
    tangential = dot(force, r_x) / norm
    normal_force = add_scaled(-tangential / norm, r_x, force)
    return norm, tangential, normal_force, square_root(dot(normal_force, normal_force))
