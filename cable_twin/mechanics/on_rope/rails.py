"""Rails of stations, which carry a part of a vehicle's weight beside an end of its rope, straight upwards.

At the end they carry all of it, and less and less from there on, so that the rope takes a vehicle over as smoothly as
from rails that sink away from under its wheels. They do work as such rails would.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.language.vectors import scale
from cable_twin.mechanics.on_rope.chain import carriage_mass


@inlined_kernel
def share_on_rails(distance, rails):
    """Share of a vehicle's weight on rails of a length `rails` (m), at a `distance` (m) from where they carry it all.

    It begins and ends without a jump of its rate or of the rate of that: 1 - 10 u³ + 15 u⁴ - 6 u⁵.
    """
    u = min(max(distance / rails, 0.0), 1.0)
    return 1.0 + u * u * u * (-10.0 + u * (15.0 - 6.0 * u))


@inlined_kernel
def rail_force(system, state, carriage):
    """Force (dim,) in N of station rails on the grip of a vehicle on a moving rope; 0 of vehicles without rails."""
    rails, place = system.carriages.rails[carriage], state.joints.position[carriage]
    if not rails > 0.0:
        return scale(0.0, system.cable.gravity)
    share = share_on_rails(min(place, system.cable.unstrained_length - place), rails)
    return scale(-share * carriage_mass(system.carriages, carriage), system.cable.gravity)
