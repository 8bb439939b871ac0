"""Vectors and matrices of the working space against numpy, compiled and as plain Python."""

import numba
import numpy as np
import pytest

from cable_twin.mechanics.language import vectors as v
from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.traced import formula


@formula
def operators(c, a, b, m, n):
    """Every operator of vectors and matrices in a formula."""
    return m @ (a - b * c) + (-b) @ m.T + (a @ b) * ((m - n) @ n + c * -m.T) @ a


def everything(c, d, a, b, m, n, s, row):
    """Every primitive once. c, d: numbers; a, b: vectors; m, n: matrices; s: upper half of one; row: array (9,)."""
    return (
        v.dot(a, b),
        v.load(row, a),
        v.load(row, m),
        v.scale(c, a),
        v.subtract(a, b),
        v.add_scaled(c, a, b),
        v.add_scaled(c, s, s),
        v.symmetric(c, d, a),
        v.symmetric_pair(c, a, b),
        v.full(c, s, d),
        v.outer(c, a, b),
        v.product(m, a),
        v.product(a, m),
        v.product(m, n),
        v.subtract(m, n),
        v.determinant(m),
        v.adjugate(c, m),
        v.transpose(m),
        v.block(c, m, d),
        operators(c, a, b, m, n),
    )


def expected(c, d, a, b, m, n, s, row):
    dim = a.size
    upper = np.triu_indices(dim)
    one = np.eye(dim)
    whole = np.zeros((dim, dim))
    whole[upper] = s
    whole = whole + np.triu(whole, 1).T
    return (
        a @ b,
        row[:dim],
        row[: dim * dim],
        c * a,
        a - b,
        c * a + b,
        c * s + s,
        (c * one + d * np.outer(a, a))[upper],
        (c * (np.outer(a, b) + np.outer(b, a)))[upper],
        c * whole + d * one,
        c * np.outer(a, b),
        m @ a,
        a @ m,
        m @ n,
        m - n,
        np.linalg.det(m),
        c * np.linalg.det(m) * np.linalg.inv(m),
        m.T,
        c * m + d * one,
        m @ (a - b * c) + (-b) @ m.T + (a @ b) * ((m - n) @ n + c * -m.T) @ a,
    )


@pytest.fixture(params=["compiled", "plain"])
def evaluate(request):
    return numba.njit(error_model="numpy")(everything) if request.param == "compiled" else everything


@pytest.mark.parametrize("dim", [2, 3])
def test_primitives_are_those_of_numpy(evaluate, dim):
    rng = np.random.default_rng(dim)
    a, b = rng.standard_normal((2, dim))
    m, n = rng.standard_normal((2, dim, dim))
    s = rng.standard_normal(dim * (dim + 1) // 2)
    row = rng.standard_normal(9)
    c, d = 0.7, -1.3
    tuples = [tuple(map(tuple, x.tolist())) if x.ndim == 2 else tuple(x.tolist()) for x in (a, b, m, n, s)]
    got = evaluate(c, d, *tuples, row)
    for number, (value, exact) in enumerate(zip(got, expected(c, d, a, b, m, n, s, row), strict=True)):
        message = f"entry {number} of `everything`"
        np.testing.assert_allclose(value, np.reshape(exact, np.shape(value)), atol=2e-15 * 8, err_msg=message)


@kernel
def stored(a, row):
    """Kernel that calls `store`."""
    v.store(a, row)


@kernel
def accumulated(a, row):
    """Kernel that calls `accumulate`."""
    v.accumulate(a, row)


@pytest.mark.parametrize(("store", "accumulate"), [(stored, accumulated), (v.store, v.accumulate)])
@pytest.mark.parametrize("dim", [2, 3])
def test_store_writes_the_first_entries_and_accumulate_adds_to_them(store, accumulate, dim):
    row = np.full(4, 9.0)
    store((1.5, -2.0, 4.0)[:dim], row)
    assert row.tolist() == [1.5, -2.0, 4.0][:dim] + [9.0] * (4 - dim)
    accumulate((1.0, 2.0, 3.0)[:dim], row)
    assert row.tolist() == [2.5, 0.0, 7.0][:dim] + [9.0] * (4 - dim)
