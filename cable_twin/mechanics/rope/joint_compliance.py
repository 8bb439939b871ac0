"""Joint compliance at the kink of a rope: correction of elements with continuous slopes under a point load.

A force F across a taut rope bends it at one place. Elements bend over their length instead, and their rope is too high
under the force by an amount that depends on the place: a vehicle rides over waves, from node to node. This height is
put between rope and joint as a massless spring without a length, of the complementary energy

    E(F, s, T) = ½ c F² + ¼ d F⁴ / (1 + b F²)

of the part of F across the rope. ∂E/∂F is the displacement δ from the joint to its place on the rope, -∂E/∂s the force
on the joint along the rope, and -∂E/∂T the rope in the kink. With the tension T_0 at rest and the slackness τ = T_0 / T
(-) of the rope,

    c = c_0 τ + k (τ - τ²),  k = c_0 + T_0 ∂c/∂T,  d = d_0 τ⁴,  b = b_0 τ³.

`joint_compliance_table` has c_0, d_0 and k of each element. Beside the element that bears the load only its neighbours
matter, so that each element is looked at within a few of them, held at both ends. Across itself a taut rope is a string
with some bending stiffness, T w'² + EI w''², which is solved here with the same cubics; the difference to the exact
height, F c, is a polynomial of the load's place.

A large load bends the rope so much that its length counts: u' = -½ w'² would keep the tension even, and the cubics
have no such u'. The rest of ½ w'² takes energy, ½ EA ∫(...)² dx, which grows with F⁴: d, to first order. As the
bend gives way to it, that is too much where EA F² / T³ is large, by 1 / (1 + LIMIT EA F² / T³) of the energy, measured
on even meshes (`verification.meshes`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import add_scaled, block, dot, outer, scale
from cable_twin.mechanics.parameters import Cable, FloatArray
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x, shape_functions_xx


class JointCompliance(NamedTuple):
    """Displacement of a compliant joint under its force, with derivatives."""

    displacement: Any  # δ (dim,) m
    by_force: Any  # ∂δ/∂F (dim²) m/N
    by_place: Any  # ∂δ/∂s (dim,)
    along: Any  # ∂E/∂s, N
    along_by_place: Any  # ∂²E/∂s², N/m


@inlined_kernel
def has_joint_compliance(cable):
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
def joint_compliance(cable, element, arc_length, force, along, tau):
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
    return JointCompliance(
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
def compliance_energy(cable, element, arc_length, force, along, tau):
    """Elastic energy (J) of a compliant joint, F·δ - E, with the arguments of `joint_compliance`."""
    (c, _, _), (d, _, _) = rounded_off(cable, element, arc_length, tau)
    squared = dot(force, force) - dot(force, along) ** 2
    limited = 1.0 / (1.0 + cable.rounding_limit * tau**3 * squared)
    return squared * (0.5 * c + d * squared * limited * (0.25 + 0.5 * limited))


REACH = 6  # elements on either side that are looked at
LIMIT = 0.1  # -
MEASURED = 3.0  # -, EA F² / T³ up to which that is so, and motion under vehicles stable
CHANGE = 1e-3  # of the tension, for derivatives by it
PLACES = 9  # on an element, through which polynomials of degree 8 go
LEAST_TENSION = 1e-3  # of the highest one: a rope that is slacker is no string

QUARTERS = np.array([0.125, 0.375, 0.625, 0.875])  # of an element, their middles

_POINTS, _WEIGHTS = leggauss(4)
_POINTS, _WEIGHTS = 0.5 + 0.5 * _POINTS, 0.5 * _WEIGHTS
_PLACES = 0.5 - 0.5 * np.cos(np.pi * np.arange(PLACES) / (PLACES - 1))


def joint_compliance_table(cable: Cable, tension: FloatArray) -> dict[str, Any]:
    """Fields of `Cable` for compliant joints: tables of c_0, d_0 and k of `joint_compliance`, and b_0.

    Args:
        cable: its mesh and its stiffness.
        tension: (elements,) N, of each element.
    """
    tension = np.maximum(tension, LEAST_TENSION * tension.max())
    numbers = np.arange(cable.element_count)
    first = np.maximum(numbers - REACH, 0)
    last = np.minimum(numbers + REACH, cable.element_count - 1)
    table = np.zeros((cable.element_count, 3, PLACES))
    for before, after in {*zip((numbers - first).tolist(), (last - numbers).tolist(), strict=True)}:
        alike = numbers[(numbers - first == before) & (last - numbers == after)]
        patch = alike[:, None] + np.arange(-before, after + 1)
        lengths, tensions = cable.element_length[patch], tension[patch]
        here, bent = _lacking(cable, lengths, tensions, before)
        less, more = (_lacking(cable, lengths, (1.0 + change) * tensions, before)[0] for change in (-CHANGE, CHANGE))
        stiff = _stiffness(cable, lengths, tensions[:, before], bent)
        values = np.stack([here, stiff, here + (more - less) / (2.0 * CHANGE)], axis=1)
        table[alike] = values @ np.linalg.inv(np.vander(_PLACES, PLACES)).T
    _join(table, cable.element_length)
    limit = LIMIT * cable.axial_stiffness / float(tension.mean()) ** 3
    return {"rounding": table, "rounding_limit": limit, "rounding_tension": tension}


def smoothed(cable: Cable, tension: FloatArray) -> FloatArray:
    """Element tensions (elements,) in N smoothed beside loads: means of the linear interpolation of mid-values."""
    if cable.element_count == 1:
        return tension
    places = cable.node_arc_length[:-1, None] + cable.element_length[:, None] * QUARTERS
    middles = cable.node_arc_length[:-1] + 0.5 * cable.element_length
    left = np.clip(np.searchsorted(middles, places, side="right") - 1, 0, cable.element_count - 2)
    share = (places - middles[left]) / (middles[left + 1] - middles[left])
    smooth: FloatArray = (tension[left] + share * (tension[left + 1] - tension[left])).mean(axis=1)
    return smooth


def _join(table: FloatArray, length: FloatArray) -> None:
    """Join polynomials (elements, 3, PLACES) of neighbours in value and slope, against rounding errors.

    Newton's method would go to and fro between two that do not. At the ends of the rope nothing yields.
    """
    powers = np.arange(PLACES - 1, -1, -1)
    here, there = table[..., -1], table.sum(axis=-1)
    by_here, by_there = table[..., -2] / length[:, None], (table * powers).sum(axis=-1) / length[:, None]
    off = np.zeros((4, *here.shape))  # of value and slope at both ends of each element
    off[0, 1:], off[2, :-1] = 0.5 * (there[:-1] - here[1:]), 0.5 * (here[1:] - there[:-1])
    off[1, 1:], off[3, :-1] = 0.5 * (by_there[:-1] - by_here[1:]), 0.5 * (by_here[1:] - by_there[:-1])
    off[0, 0], off[2, -1] = -here[0], -there[-1]
    value, slope, value_there, slope_there = off
    slope, slope_there = slope * length[:, None], slope_there * length[:, None]
    table[..., -1] += value
    table[..., -2] += slope
    table[..., -3] += 3.0 * (value_there - value) - 2.0 * slope - slope_there
    table[..., -4] += 2.0 * (value - value_there) + slope + slope_there


def _slopes(length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slopes (patches, elements, 4, points) of the cubics, their weights, and their stiffness under a unit tension."""
    slopes = np.stack(shape_functions_x(_POINTS * length[..., None], length[..., None]), axis=-2)
    weights = _WEIGHTS * length[..., None]
    return slopes, weights, np.einsum("peig,pejg,peg->peij", slopes, slopes, weights)


def _lacking(cable: Cable, length: FloatArray, tension: FloatArray, loaded: int) -> tuple[FloatArray, FloatArray]:
    """Heights c (patches, PLACES) in m/N at places on element `loaded` of patches (patches, elements) in m and N.

    Beside it the coordinates (patches, 2 nodes, PLACES) of the cubics under a load of 1 N.
    """
    here = length[:, loaded, None]
    _, weights, axial = _slopes(length)
    bends = np.stack(shape_functions_xx(_POINTS * length[..., None], length[..., None]), axis=-2)
    across = tension[..., None, None] * axial
    across += cable.bending_stiffness * np.einsum("peig,pejg,peg->peij", bends, bends, weights)

    # the cubics under the load at each place, held at both ends of the patch
    size = 2 * length.shape[1] + 2
    free = np.delete(np.arange(size), [0, size - 2])
    load = np.zeros((len(length), size, PLACES))
    load[:, 2 * loaded : 2 * loaded + 4] = np.stack(shape_functions(_PLACES * here, here), axis=-2)
    bent = np.zeros_like(load)
    bent[:, free] = np.linalg.solve(_assembled(across)[:, free[:, None], free], load[:, free])
    cubic = np.einsum("pks,pks->ps", load, bent)

    # the exact string, whose kink its bending stiffness rounds off by λ / 2, less near an end
    yields = length / tension
    before = yields[:, :loaded].sum(axis=1, keepdims=True) + _PLACES * yields[:, loaded, None]
    whole = yields.sum(axis=1, keepdims=True)
    beside = [np.maximum(loaded - 1, 0), loaded, np.minimum(loaded + 1, length.shape[1] - 1)]
    first, last = (0.5 * (tension[:, beside[k], None] + tension[:, beside[k + 1], None]) for k in range(2))
    smooth = first + _PLACES * (last - first)  # so that nothing jumps at nodes
    reach = np.sqrt(cable.bending_stiffness / smooth)
    way = length[:, :loaded].sum(axis=1, keepdims=True) + _PLACES * here
    end = np.minimum(way, length.sum(axis=1, keepdims=True) - way)
    near = np.exp(-2.0 * end / np.maximum(reach, 1e-9 * here))
    lacking = np.maximum(before * (whole - before) / whole - 0.5 * reach / smooth * (1.0 - near) - cubic, 0.0)
    return lacking, bent


def _stiffness(cable: Cable, length: FloatArray, pull: FloatArray, bent: FloatArray) -> FloatArray:
    """Factors d (patches, PLACES) in m/N³ under the tension `pull` (patches,) in N, from the cubics of `_lacking`.

    What the cubics along the rope leave of ½ w'², seen along the line that halves the kink.
    """
    slopes, weights, axial = _slopes(length)
    pull = pull[:, None]
    nodal = np.stack([bent[:, 2 * k : 2 * k + 4] for k in range(length.shape[1])], axis=1)
    turn = pull[..., None, None] * np.einsum("peig,peis->pegs", slopes, nodal)
    half = 0.5 * (turn - 0.5 * (turn[:, :1, :1] + turn[:, -1:, -1:])) ** 2
    pushed = np.einsum("peig,pegs,peg->peis", slopes, half, weights)
    right = np.zeros_like(bent)
    for k in range(length.shape[1]):
        right[:, 2 * k : 2 * k + 4] += pushed[:, k]
    along = np.zeros_like(bent)
    along[:, 1:] = np.linalg.solve(_assembled(axial)[:, 1:, 1:], right[:, 1:])
    nodal = np.stack([along[:, 2 * k : 2 * k + 4] for k in range(length.shape[1])], axis=1)
    left = half - np.einsum("peig,peis->pegs", slopes, nodal)
    return 2.0 * cable.axial_stiffness / pull**4 * np.einsum("pegs,peg->ps", left**2, weights)


def _assembled(blocks: FloatArray) -> FloatArray:
    """Assemble matrices (patches, n, n) from element blocks (patches, elements, 4, 4) overlapping by half."""
    whole = np.zeros((len(blocks), 2 * blocks.shape[1] + 2, 2 * blocks.shape[1] + 2))
    for k in range(blocks.shape[1]):
        whole[:, 2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += blocks[:, k]
    return whole
