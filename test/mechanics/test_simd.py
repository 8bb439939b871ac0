"""SIMD lanes against floats to the last bit, and groups of elements with unused lanes."""

import numpy as np
import pytest
from systems import disturbed_state, make_system, nodal_vectors

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.memory import clear_array, combine_arrays, copy_array, flat
from cable_twin.mechanics.language.simd import WIDTH, gather, larger, magnitude, smaller, spread
from cable_twin.mechanics.language.traced import exponential, if_less, square_root
from cable_twin.mechanics.language.vectors import dot, scale
from cable_twin.mechanics.rope import elastic_models
from cable_twin.mechanics.rope import element as cable_element

RNG = np.random.default_rng(7)


@kernel
def formula(a, b):
    """Every operation that lanes have, on floats or lanes."""
    c = a + 2.0 * b
    c -= 3.0 / (square_root(a * a + 1.0) + 1)
    c /= 1.5 + b * b
    c += if_less(a, b, exponential(-magnitude(c)), larger(smaller(c, b), -0.5))
    return -c


@kernel
def product_of(a, b):
    """A scalar product, on floats or lanes."""
    return dot(a, scale(2.0, b))


@kernel
def formulas(coordinates, first, like, rows):
    """The formula of x, z at both ends of a group of elements."""
    r_a, slope_a, r_b, slope_b = gather(coordinates, first, like)
    spread((formula(r_a[0], slope_a[1]), formula(r_b[1], slope_b[0]), product_of(r_a, r_b)), rows, 1)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("elements", [1, 3, 4, 6])
def test_lanes_have_the_bits_of_floats_and_repeat_the_last_element(dim, elements):
    coordinates = RNG.normal(size=(elements + 1, 3, dim))
    rows = np.full((5, WIDTH), np.nan)
    first = max(elements - 2, 0)
    formulas(coordinates, first, (0.0,) * dim, rows)
    for lane in range(WIDTH):
        element = min(first + lane, elements - 1)
        start, end = coordinates[element], coordinates[element + 1]
        assert rows[1, lane] == formula(start[0, 0], start[1, 1])
        assert rows[2, lane] == formula(end[0, 1], end[1, 0])
        assert rows[3, lane] == product_of(tuple(start[0]), tuple(end[0]))
    assert np.isnan(rows[[0, 4]]).all()


@pytest.mark.parametrize("model", ["continuum", "element_frame"])
def test_a_group_of_elements_is_each_element_by_itself(model):
    """Nodal forces of the cable, bit for bit, against elements computed one by one."""
    system = make_system(2, cable={"elastic_model": {"continuum": 0, "element_frame": 1}[model], "damping_time": 0.01})
    cable = system.cable
    state, work = disturbed_state(system)
    cable_element.add_cable(system, state, 2.0, 3.0, 1.0, work)
    forces = np.zeros_like(work.right_side[:, :2])
    for element in range(cable.element_count):
        length = cable.element_length[element]
        own = elastic_models.chord_and_slopes(state.nodes.position, element, cable, state)
        rates = elastic_models.chord_and_slopes(state.nodes.velocity, element, cable, state)
        d, a, b = elastic_models.elastic_force(cable, length, *own, *rates, 3.0, 1.0)[:3]
        accelerations = (tuple(row) for row in nodal_vectors(state.nodes.acceleration[element : element + 2]))
        r_a, slope_a, r_b, slope_b = (
            np.array(part) for part in cable_element.inertia(cable, length, 1.0, *accelerations)
        )
        forces[element, 0] += np.array(d) - r_a
        forces[element, 1] += -length * (np.array(a) + slope_a)
        forces[element + 1, 0] = -(np.array(d) + r_b)
        forces[element + 1, 1] = -length * (np.array(b) + slope_b)
    np.testing.assert_array_equal(work.right_side[:, :2], forces)


@kernel
def arrays(source, target, other):
    """Every operation on whole arrays."""
    copy_array(source, target)
    combine_arrays(target, 3.0, source, target)
    clear_array(other)
    return flat(target)[source.size - 1]


def test_whole_arrays():
    source, target, other = RNG.normal(size=(3, 2, 4)), np.empty((3, 2, 4)), np.ones((2, 2))
    assert arrays(source, target, other) == 4.0 * source[2, 1, 3]
    np.testing.assert_array_equal(target, 4.0 * source)
    np.testing.assert_array_equal(other, np.zeros((2, 2)))


def test_a_kernel_that_would_allocate_does_not_compile():
    """No step allocates memory; nothing is compiled with the JIT off."""
    numba = pytest.importorskip("numba")
    if numba.config.DISABLE_JIT:
        return

    @kernel
    def allocate(count):
        return np.zeros(count).sum()

    with pytest.raises(numba.core.errors.NumbaError):
        allocate(3)
