"""Amount and speed of the rope on a fixed mesh: transport kinematics of an axially moving rope.

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
    """Rest stretch λ (-): unstrained length of the rope on the mesh over the length of the mesh."""
    gone = state.rope.position
    return 1.0 + (state.surplus[0] + gone[0] - gone[1]) / cable.unstrained_length


@inlined_kernel
def rest_length(cable, state, element):
    """Unstrained length (m) of the rope on an element, less the rope taken by sharp kinks."""
    return rest_stretch(cable, state) * cable.element_length[element] - state.kink_length[element]


@inlined_kernel
def thickening(cable, state):
    """Mesh dilution rate λ_t / λ (1/s): relative rate of rope taken in between two points of the mesh."""
    speed = state.rope.velocity
    return (speed[0] - speed[1]) / (cable.unstrained_length * rest_stretch(cable, state))


@inlined_kernel
def between_ends(cable, values, arc_length):
    """Linear interpolation at an arc length (m) between `values[0]` at the start and `values[1]` at the end."""
    return values[0] + (values[1] - values[0]) * (arc_length / cable.unstrained_length)


@kernel
def going_by(cable, state, arc_length):
    """Transport velocity w (m/s) along the mesh of a point clamped to the rope at an arc length (m), and its rate."""
    stretch, speed = rest_stretch(cable, state), state.rope.velocity
    rate = (speed[0] - speed[1]) / cable.unstrained_length
    on_mesh = between_ends(cable, speed, arc_length) / stretch
    return on_mesh, (between_ends(cable, state.rope.acceleration, arc_length) - 2.0 * on_mesh * rate) / stretch


@kernel
def rope_before(cable, state, arc_length):
    """Unstrained rope (m) before an arc length (m), counted from the initial start of the mesh."""
    return rest_stretch(cable, state) * arc_length - state.rope.position[0]
