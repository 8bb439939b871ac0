"""Rails of stations beside an end of a rope, which hold a vehicle there, and hand it over to the rope.

At the end they bear the vehicle alone, its weight and its inertia, and less and less from there on, as rails that sink
away from under its wheels. They do work as such rails would.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.language.vectors import load, scale


@inlined_kernel
def share_on_rails(distance, rails):
    """Share of a vehicle that rails of a length `rails` (m) bear, at a `distance` (m) from where they bear it alone.

    It begins and ends without a jump of its rate or of the rate of that: 1 - 10 u³ + 15 u⁴ - 6 u⁵.
    """
    u = min(max(distance / rails, 0.0), 1.0)
    return 1.0 + u * u * u * (-10.0 + u * (15.0 - 6.0 * u))


@inlined_kernel
def share_on_rope(system, state, carriage):
    """Share of the force on a vehicle on a moving rope that the rope bears, and rails do not; 1 without rails."""
    rails, place = system.carriages.rails[carriage], state.joints.position[carriage]
    if not rails > 0.0:
        return 1.0
    return 1.0 - share_on_rails(min(place, system.cable.unstrained_length - place), rails)


@inlined_kernel
def force_of_ropes(system, state, carriage):
    """Force (dim,) in N of all ropes on a vehicle at its joint: its multiplier λ, less what rails bear of it."""
    force = load(state.multipliers[system.carriages.body_offset[carriage]], system.cable.gravity)
    if system.carriages.rails[carriage] > 0.0:
        force = scale(share_on_rope(system, state, carriage), force)
    return force
