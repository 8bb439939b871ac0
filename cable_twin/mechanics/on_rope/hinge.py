"""A spring and a damper of a turn: between two bodies of a chain, or between the first one and the cable.

A body that is turned by φ = θ - θ_above has the moment m = -k φ - c φ_dot at its upper pivot, and what is above has -m.
A law of another kind is another `hinge_moment`: all that uses it takes moment and derivatives as they come.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel


@kernel
def hinge_moment(carriages, body, angle, rate):
    """Moment (N m) on a body turned by an angle (rad), at a rate (rad/s), and minus its derivatives by both."""
    stiffness, damping = carriages.hinge_stiffness[body], carriages.hinge_damping[body]
    return -stiffness * angle - damping * rate, stiffness, damping


@kernel
def hinge_energy(carriages, body, angle):
    """Elastic energy (J) of the spring."""
    return 0.5 * carriages.hinge_stiffness[body] * angle * angle


@kernel
def is_hinged(carriages, body):
    """Whether there is a spring or a damper above a body: a bare pivot is not asked for angles."""
    return carriages.hinge_stiffness[body] > 0.0 or carriages.hinge_damping[body] > 0.0
