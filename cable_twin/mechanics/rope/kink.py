"""Joint compliance at the kink of a rope: correction of elements with continuous slopes under a point load.

A force F across a taut rope bends it at one place. Elements bend over their length instead, and their rope is too high
under the force by what `rounding` works out, depending on the place: a vehicle rides over waves, from node to node.
What they lack is put between rope and joint as a massless spring without a length, of the complementary energy

    E(F, s, T) = ½ c F² + ¼ d F⁴ / (1 + b F²)

of what F is across the rope. ∂E/∂F is the way δ from the joint to its place on the rope, -∂E/∂s what pushes the joint
along the rope, and -∂E/∂T the rope that the kink takes. With the tension T_0 at rest and the slackness τ = T_0 / T (-)
of the rope,

    c = c_0 τ + k (τ - τ²),  k = c_0 + T_0 ∂c/∂T,  d = d_0 τ⁴,  b = b_0 τ³.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, block, dot, outer, scale


class Kink(NamedTuple):
    """Displacement of a compliant joint under its force, with derivatives."""

    way: Any  # δ (dim,) m
    by_force: Any  # ∂δ/∂F (dim²) m/N
    by_place: Any  # ∂δ/∂s (dim,)
    along: Any  # ∂E/∂s, N
    along_by_place: Any  # ∂²E/∂s², N/m


@inlined_kernel
def has_kinks(cable):
    """Return whether joints of this rope are compliant."""
    return cable.rounding.shape[0] > 0


@inlined_kernel
def shares(cable, element, arc_length):
    """Three elements around a place (m) on the middle one, each with its share (-): a quadratic spline."""
    off = (arc_length - cable.node_arc_length[element]) / cable.element_length[element] - 0.5
    off = min(max(off, -0.5), 0.5)
    return (
        (max(element - 1, 0), 0.5 * (0.5 - off) ** 2),
        (element, 0.75 - off * off),
        (min(element + 1, cable.element_count - 1), 0.5 * (0.5 + off) ** 2),
    )


@inlined_kernel
def kink(cable, element, arc_length, force, along, tau):
    """Displacement of a joint at an arc length (m) on an element under the rope's `force` (dim,) in N.

    The unit vector `along` (dim,) is that of the rope there, `tau` its slackness (-).
    """
    (c, c_s, c_ss), (d, d_s, d_ss) = rounded_off(cable, element, arc_length, tau)
    force = add_scaled(-dot(force, along), along, force)
    squared = dot(force, force)
    limited = 1.0 / (1.0 + cable.rounding_limit * tau**3 * squared)
    fourth = 0.25 * squared * squared * limited  # of d, in E
    cubed = squared * (0.5 + 0.5 * limited) * limited  # of d, in δ over F
    way = c + d * cubed
    by_force = outer(2.0 * d * limited * limited * limited, force, force)
    return Kink(
        scale(way, force),
        block(1.0, add_scaled(1.0, outer(-way, along, along), by_force), way),
        scale(c_s + d_s * cubed, force),
        0.5 * c_s * squared + d_s * fourth,
        0.5 * c_ss * squared + d_ss * fourth,
    )


@inlined_kernel
def rounded_off(cable, element, arc_length, tau):
    """Compliances c in m/N and d in m/N³ at an arc length (m) and slackness (-), with two derivatives by s."""
    c, d, k = at_rest(cable, element, arc_length)
    return add_scaled(tau - tau * tau, k, scale(tau, c)), scale(tau**4, d)


@inlined_kernel
def at_rest(cable, element, arc_length):
    """Compliances c_0 in m/N, d_0 in m/N³, k in m/N at an arc length (m), with two derivatives by s; 0 off the rope."""
    per_length = 1.0 / cable.element_length[element]
    u = (arc_length - cable.node_arc_length[element]) * per_length
    if arc_length < 0.0 or arc_length > cable.unstrained_length:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return (
        polynomial(cable.rounding[element, 0], u, per_length),
        polynomial(cable.rounding[element, 1], u, per_length),
        polynomial(cable.rounding[element, 2], u, per_length),
    )


@inlined_kernel
def polynomial(coefficients, u, factor):
    """Value and two derivatives by u / factor of a polynomial of u, its coefficients from the highest power down."""
    value, first, second = 0.0, 0.0, 0.0
    for k in range(coefficients.size):
        second = second * u + 2.0 * first
        first = first * u + value
        value = value * u + coefficients[k]
    return value, factor * first, factor * factor * second


@kernel
def kink_length(cable, element, arc_length, force, tau):
    """Rope length (m) in a kink under a transverse force (N), at a slackness (-): -∂E/∂T, at least 0."""
    (c, _, _), (d, _, _), (k, _, _) = at_rest(cable, element, arc_length)
    tension = 0.0
    for number, share in shares(cable, element, arc_length):
        tension += share * cable.rounding_tension[number]
    squared = force * force
    limited = 1.0 / (1.0 + cable.rounding_limit * tau**3 * squared)
    fourth = 0.25 * d * tau**4 * squared * squared * limited * (1.0 + 3.0 * limited)
    return tau * max(0.5 * tau * (c + k - 2.0 * tau * k) * squared + fourth, 0.0) / tension


@kernel
def kink_energy(cable, element, arc_length, force, along, tau):
    """Elastic energy (J) of a compliant joint, F·δ - E, with the arguments of `kink`."""
    (c, _, _), (d, _, _) = rounded_off(cable, element, arc_length, tau)
    squared = dot(force, force) - dot(force, along) ** 2
    limited = 1.0 / (1.0 + cable.rounding_limit * tau**3 * squared)
    return squared * (0.5 * c + d * squared * limited * (0.25 + 0.5 * limited))


__all__ = ["Kink", "has_kinks", "kink", "kink_energy", "kink_length", "shares"]
