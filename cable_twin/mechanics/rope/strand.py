"""How much rope there is on the mesh, and how fast it goes by.

Rope runs onto the mesh at its start with V_0 and off it at its end with V_1 (m/s of unstrained length), and is spread
evenly over it: an arc length s of the mesh holds λ s of rope, where λ = 1 + (surplus + P_0 - P_1) / L, P being what has
gone by at either end. At s the rope goes by with u = V_0 + (V_1 - V_0) s / L, on the mesh with w = u / λ: a point of it
has the velocity r_t + w r_s and the acceleration r_tt + 2 w r_ts + w² r_ss + (w_t + w w_s) r_s. Of a rope that ends in
its supports λ is 1 and u is 0; of one that goes by as a whole, λ is 1 and u the same everywhere.

The rate of a strain |r_s| / λ - 1 is that of |r_s| less λ_t / λ of it, which damping follows.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel


@inlined_kernel
def rest_stretch(cable, state):
    """λ: unstrained length of the rope on the mesh, over that of the mesh (-)."""
    gone = state.rope.position
    return 1.0 + (state.surplus[0] + gone[0] - gone[1]) / cable.unstrained_length


@inlined_kernel
def rest_length(cable, state, element):
    """Unstrained length (m) of the rope on an element, less what sharp kinks take of it."""
    return rest_stretch(cable, state) * cable.element_length[element] - state.kink_length[element]


@inlined_kernel
def thickening(cable, state):
    """λ_t / λ (1/s): rate at which what is between two places of the mesh takes in rope, of the rope there."""
    speed = state.rope.velocity
    return (speed[0] - speed[1]) / (cable.unstrained_length * rest_stretch(cable, state))


@inlined_kernel
def between_ends(cable, values, arc_length):
    """What is `values[0]` at the start of the mesh and `values[1]` at its end, linearly, at an arc length (m)."""
    return values[0] + (values[1] - values[0]) * (arc_length / cable.unstrained_length)


@kernel
def going_by(cable, state, arc_length):
    """Speed w (m/s) at which what is clamped to the rope at an arc length (m) goes along the mesh, and its rate."""
    stretch, speed = rest_stretch(cable, state), state.rope.velocity
    rate = (speed[0] - speed[1]) / cable.unstrained_length
    on_mesh = between_ends(cable, speed, arc_length) / stretch
    return on_mesh, (between_ends(cable, state.rope.acceleration, arc_length) - 2.0 * on_mesh * rate) / stretch


@kernel
def rope_before(cable, state, arc_length):
    """Unstrained rope (m) before an arc length (m), from that which was at the start of the mesh at first."""
    return rest_stretch(cable, state) * arc_length - state.rope.position[0]
