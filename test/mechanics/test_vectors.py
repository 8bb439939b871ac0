"""Vectors and matrices of the working space against numpy, compiled and as plain Python."""

import numba
import numpy as np
import pytest

from cable_twin.mechanics.language import vectors as v


def everything(c, d, a, b, m, n, s, row):
    """Every primitive once. c, d: numbers; a, b: vectors; m, n: full matrices; s: symmetric; row: array (9,)."""
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
        v.apply(m, a),
        v.multiply(m, n),
        v.subtract(m, n),
        v.determinant(m),
        v.adjugate(c, m),
        v.transpose(m),
        v.block(c, m, d),
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
        m @ n,
        m - n,
        np.linalg.det(m),
        c * np.linalg.det(m) * np.linalg.inv(m),
        m.T,
        c * m + d * one,
    )


def plain(function):
    """The Python function under a kernel."""
    return getattr(function, "py_func", function)


@pytest.fixture(params=["compiled", "plain"])
def evaluate(request, monkeypatch):
    if request.param == "compiled":
        return numba.njit(error_model="numpy")(everything)
    for name in ("dot", "determinant", "symmetric_pair"):
        monkeypatch.setattr(v, name, plain(getattr(v, name)))
    return everything


@pytest.mark.parametrize("dim", [2, 3])
def test_primitives_are_those_of_numpy(evaluate, dim):
    rng = np.random.default_rng(dim)
    a, b = rng.standard_normal((2, dim))
    m, n = rng.standard_normal((2, dim, dim))
    s = rng.standard_normal(dim * (dim + 1) // 2)
    row = rng.standard_normal(9)
    c, d = 0.7, -1.3
    flat = [tuple(array.ravel().tolist()) for array in (a, b, m, n, s)]
    got = evaluate(c, d, *flat, row)
    for number, (value, exact) in enumerate(zip(got, expected(c, d, a, b, m, n, s, row), strict=True)):
        message = f"entry {number} of `everything`"
        np.testing.assert_allclose(value, np.ravel(exact).reshape(np.shape(value)), atol=2e-15 * 8, err_msg=message)


@pytest.mark.parametrize("how", [lambda function: function, plain], ids=["compiled", "plain"])
@pytest.mark.parametrize("dim", [2, 3])
def test_store_writes_the_first_entries_and_accumulate_adds_to_them(how, dim):
    row = np.full(4, 9.0)
    how(v.store)((1.5, -2.0, 4.0)[:dim], row)
    assert row.tolist() == [1.5, -2.0, 4.0][:dim] + [9.0] * (4 - dim)
    how(v.accumulate)((1.0, 2.0, 3.0)[:dim], row)
    assert row.tolist() == [2.5, 0.0, 7.0][:dim] + [9.0] * (4 - dim)
