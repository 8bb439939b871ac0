"""What a joint yields of the kink that elements round off: its derivatives, its energy, and how much there is of it."""

import numpy as np
import pytest
from systems import difference, make_cable

from cable_twin.mechanics.rope.joint_compliance import (
    compliance_energy,
    joint_compliance,
    joint_compliance_table,
    kink_length,
)

_RNG = np.random.default_rng(8)
YIELDING = {  # of three elements: centimetres under some ten N, a third of them by d, half of which the limit takes
    "rounding": np.concatenate(
        [_RNG.uniform(0.5, 1.0, (3, 2, 9)) * np.array([3e-4, 3e-7])[:, None], np.full((3, 1, 9), 1e-6)], axis=1
    ),
    "rounding_limit": 2e-3,
    "rounding_tension": np.array([300.0, 310.0, 320.0]),
}


def unit(dim):
    """A tangent (dim,)."""
    along = np.array([0.9, 0.2, 0.4])[[0, 2] if dim == 2 else [0, 1, 2]]
    return along / np.linalg.norm(along)


def tables(cable, element, tau):
    """Polynomials of c and d, and b, at a tension of 1 / `tau` times that at rest."""
    c, d, k = cable.rounding[element]
    return tau * c + (tau - tau**2) * k, tau**4 * d, tau**3 * cable.rounding_limit


def energy(cable, element, s, force, along, tau=1.0):
    """E (J) of what yields under a `force` (dim,) in N at arc length `s` (m) across `along` (dim,), as defined."""
    force = force - (force @ along) * along
    u = (s - cable.node_arc_length[element]) / cable.element_length[element]
    c, d, limit = tables(cable, element, tau)
    c, d, squared = np.polyval(c, u), np.polyval(d, u), force @ force
    return 0.5 * c * squared + 0.25 * d * squared**2 / (1.0 + limit * squared)


def way_and_push(cable, element, s, force, along, tau=1.0):
    """∂E/∂F (dim,) in m and ∂E/∂s (N), written out by hand."""
    force = force - (force @ along) * along
    length, (c, d, limit) = cable.element_length[element], tables(cable, element, tau)
    u, squared = (s - cable.node_arc_length[element]) / length, force @ force
    c_s, d_s = (np.polyval(np.polyder(row), u) / length for row in (c, d))
    c, d = np.polyval(c, u), np.polyval(d, u)
    over = 1.0 + limit * squared
    way = (c + d * (squared / over - 0.5 * limit * squared**2 / over**2)) * force
    return way, 0.5 * c_s * squared + 0.25 * d_s * squared**2 / over


@pytest.mark.parametrize("tau", [1.0, 0.7])
@pytest.mark.parametrize("dim", [2, 3])
def test_derivatives_are_those_of_one_energy(dim, tau):
    """The way is ∂E/∂F, the push -∂E/∂s, and their tangents are their derivatives: differences, to 1e-8."""
    cable = make_cable(dim, **YIELDING)
    force, s, along = np.array([9.0, 14.0, 30.0])[-dim:], 1.13, unit(dim)
    got = joint_compliance(cable, 1, s, tuple(force), tuple(along), tau)
    by_force = difference(lambda f: np.array([energy(cable, 1, s, f, along, tau)]), force, 1e-2)[0]
    by_place = difference(lambda x: np.array([energy(cable, 1, x[0], force, along, tau)]), np.array([s]), 1e-3)[0, 0]
    np.testing.assert_allclose(got.displacement, by_force, rtol=1e-8)
    np.testing.assert_allclose(got.along, by_place, rtol=1e-8)
    way, push = way_and_push(cable, 1, s, force, along, tau)
    np.testing.assert_allclose(got.displacement, way, rtol=1e-12)
    np.testing.assert_allclose(got.along, push, rtol=1e-12)
    assert abs(np.array(got.displacement) @ along) < 1e-15  # nothing yields along the rope
    tangent = difference(lambda f: way_and_push(cable, 1, s, f, along, tau)[0], force, 1e-2)
    np.testing.assert_allclose(np.reshape(got.by_force, (dim, dim)), tangent, rtol=1e-7)
    along = difference(lambda x: np.append(*way_and_push(cable, 1, x[0], force, along, tau)), np.array([s]), 1e-3)[:, 0]
    np.testing.assert_allclose([*got.by_place, got.along_by_place], along, rtol=1e-7)


def test_energy_is_the_work_that_the_force_has_done():
    """∫F·dδ as a force grows, by Simpson's rule: to 1e-9."""
    cable, force, s, along, tau = make_cable(2, **YIELDING), np.array([14.0, 30.0]), 1.13, unit(2), 0.7
    shares = np.linspace(0.0, 1.0, 401)

    def way(share):
        return way_and_push(cable, 1, s, share[0] * force, along, tau)[0]

    rates = np.array([difference(way, np.array([share]), 1e-3)[:, 0] for share in shares])
    power = (shares[:, None] * force * rates).sum(axis=1)
    work = (power[:-1:2] + 4.0 * power[1::2] + power[2::2]).sum() * shares[1] / 3.0
    assert compliance_energy(cable, 1, s, tuple(force), tuple(along), tau) == pytest.approx(work, rel=1e-9)


@pytest.mark.parametrize(("force", "within"), [(8.0, 1e-4), (150.0, 2e-2)])
def test_the_rope_that_a_kink_takes_is_what_its_energy_loses_with_tension(force, within):
    """-∂E/∂T, from tables of two tensions: small forces, and large ones where d and its limit tell (as T⁻⁴ and T⁻³)."""
    mesh = {"element_count": 40, "element_length": 2.0, "even": True, "bending_stiffness": 20.0}
    cable, across, along = make_cable(2, **mesh), np.array([0.0, force]), np.array([1.0, 0.0])
    tabled = {t: cable._replace(**joint_compliance_table(cable, np.full(40, t))) for t in (499.0, 500.0, 501.0, 600.0)}
    for u in (0.0, 0.3, 0.5, 0.8):
        s = 2.0 * (20 + u)
        less, _, more, much = (energy(one, 20, s, across, along) for one in tabled.values())
        assert kink_length(tabled[500.0], 20, s, force, 1.0) == pytest.approx(0.5 * (less - more), rel=within)
        assert energy(tabled[500.0], 20, s, across, along, 500.0 / 600.0) == pytest.approx(much, rel=max(0.01, within))
        for tension in (400.0, 600.0):
            less, more = (energy(tabled[500.0], 20, s, across, along, 500.0 / (tension + h)) for h in (-1.0, 1.0))
            assert kink_length(tabled[500.0], 20, s, force, 500.0 / tension) == pytest.approx(
                0.5 * (less - more), rel=1e-4
            )


def test_a_linear_string_lacks_what_its_cubics_round_off():
    """c of equal elements without bending stiffness: 0.0589, 0.0403 and 0.0711 l / T (`verification.meshes`)."""
    cable = make_cable(2, element_count=40, element_length=2.0, even=True, bending_stiffness=0.0)
    row = joint_compliance_table(cable, np.full(40, 500.0))["rounding"][20, 0]
    lacking = [np.polyval(row, u) * 500.0 / 2.0 for u in (0.0, 0.2, 0.5, 1.0)]
    np.testing.assert_allclose(lacking, [0.058925565, 0.040338475, 0.071129449, 0.058925565], rtol=1e-5)


def test_bending_stiffness_rounds_the_kink_off_itself():
    """Where it does so over many elements, these lack nothing."""
    lacking = {}
    for stiffness in (0.0, 500.0, 50e3):  # √(EI / T) of 0, 1 and 10 m
        cable = make_cable(2, element_count=40, element_length=2.0, even=True, bending_stiffness=stiffness)
        lacking[stiffness] = joint_compliance_table(cable, np.full(40, 500.0))["rounding"][20, 0, -1]
    assert lacking[500.0] < 0.05 * lacking[0.0]
    assert lacking[50e3] < 1e-4 * lacking[0.0]


def test_what_is_lacking_is_smooth_from_element_to_element_and_nothing_at_the_ends():
    """c and its derivative agree at the nodes of a graded mesh; a load on a held end bends nothing."""
    lengths = np.concatenate([np.full(9, 1.0), 1.5 ** np.arange(1, 5), np.full(9, 1.5**4)])
    cable = make_cable(2, node_arc_length=np.concatenate([[0.0], np.cumsum(lengths)]), bending_stiffness=300.0)
    table = joint_compliance_table(cable, np.linspace(500.0, 520.0, lengths.size))["rounding"]
    size = np.abs(table[:, 0, -1]).max()
    for row, (left, right) in enumerate(zip(table[:-1, 0], table[1:, 0], strict=True)):
        assert np.polyval(left, 1.0) == pytest.approx(np.polyval(right, 0.0), abs=1e-12 * size)
        slopes = [np.polyval(np.polyder(one), u) for one, u in ((left, 1.0), (right, 0.0))]
        slopes = np.array(slopes) / lengths[row : row + 2]
        assert slopes[0] == pytest.approx(slopes[1], abs=1e-11 * size)
    assert np.polyval(table[0, 0], 0.0) == pytest.approx(0.0, abs=1e-12)
    assert np.polyval(table[-1, 0], 1.0) == pytest.approx(0.0, abs=1e-12)
