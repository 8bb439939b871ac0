"""One-sided elastic contact with damping: end stops, counterweight buffers, tower contacts.

After Hunt and Crossley (1975) the force is f(d) (1 + c ḋ) over the depth d, never pulling, so that it starts from zero.
f has the stiffness k, which sets in over a toe d_0: k d² / 2 d_0 up to it, and k (d - d_0 / 2) beyond.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import kernel


@kernel
def buffer_force(stiffness, toe, damping, depth, depth_rate):
    """Contact force (N), and its derivatives by depth (N/m) and rate (N s/m); k in N/m, c in s/m, d_0 in m."""
    hysteresis = 1.0 + damping * depth_rate
    if not (depth > 0.0 and hysteresis > 0.0):
        return 0.0, 0.0, 0.0
    if depth < toe:
        elastic, stiff = 0.5 * stiffness * depth * depth / toe, stiffness * depth / toe
    else:
        elastic, stiff = stiffness * (depth - 0.5 * toe), stiffness
    return elastic * hysteresis, stiff * hysteresis, elastic * damping


@kernel
def buffer_energy(stiffness, toe, depth):
    """Elastic energy (J) of a contact: the integral of f over the depth (m)."""
    if not depth > 0.0:
        return 0.0
    if depth < toe:
        return stiffness * depth * depth * depth / (6.0 * toe)
    return 0.5 * stiffness * (depth * (depth - toe) + toe * toe / 3.0)


@kernel
def stop_force(carriages, cable, carriage, s, s_dot):
    """Force (N) of the end stops along the cable on a carriage at s (m), and its derivatives by s and ṡ."""
    stroke = carriages.stop_stroke[carriage]
    sign, depth = 1.0, stroke - s
    if s > 0.5 * cable.unstrained_length:
        sign, depth = -1.0, s - (cable.unstrained_length - stroke)
    stiffness, damping = carriages.stop_stiffness[carriage], carriages.stop_damping[carriage]
    force, by_depth, by_rate = buffer_force(stiffness, 0.0, damping, depth, -sign * s_dot)
    return sign * force, -by_depth, -by_rate
