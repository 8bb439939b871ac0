"""Traced formulas against their plain Python functions, to the last bit."""

from __future__ import annotations

from fractions import Fraction
from math import inf, isfinite

import numba
import numpy as np
import pytest

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.simd import beside, first_of, second_of
from cable_twin.mechanics.language.traced import formula, fuses, row_of, square_root
from cable_twin.mechanics.language.vectors import load

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


class Exact(float):
    """Number of Python with the rounding of compiled formulas: a product and what it is added to are rounded once."""

    factors: tuple[float, float] | None = None

    def __mul__(self, other):
        product = Exact(float(self) * float(other))
        if fuses() and not numba.config.DISABLE_JIT:
            product.factors = float(self), float(other)
        return product

    __rmul__ = __mul__

    def __neg__(self):
        negative = Exact(-float(self))
        if self.factors is not None:
            negative.factors = -self.factors[0], self.factors[1]
        return negative

    def __add__(self, other):
        return Exact(once(self, other, 1))

    def __radd__(self, other):
        return self if type(other) is int and other == 0 else Exact(once(other, self, 1))

    def __sub__(self, other):
        return Exact(once(self, other, -1))

    def __rsub__(self, other):
        return Exact(once(other, self, -1))


def once(one, other, sign):
    """Sum or difference, with the product that the second or else the first number is."""
    for product, rest, of_product, of_rest in ((other, one, sign, 1), (one, other, 1, sign)):
        factors = getattr(product, "factors", None)
        if factors is not None and all(map(isfinite, (*factors, rest))):
            exact = of_product * Fraction(factors[0]) * Fraction(factors[1]) + of_rest * Fraction(float(rest))
            try:
                return float(exact)
            except OverflowError:
                return inf if exact > 0 else -inf
    return float(one) + sign * float(other)


@formula
def arithmetic(x, y, n, pair, like):
    """Every operation, with numbers on both sides."""
    total = sum(a * b for a, b in zip(pair, (x, 2), strict=True))
    if len(like) == 2:
        total = total - 3
    quotient = (1.0 - x) / (y / 4), 7 / n, n / 2 - x, 2.5 / x
    return total, quotient, (-x, -n, 1 + n * 3 - 1, n // 2, (n + 1) % 2), 0.5, square_root(x * x + y * y)


@formula
def swap(array, i, row):
    """Entries by constant and by variable indices, and by one index after the other."""
    first, last = array[i + 1, 0], array[i][1]
    array[i, 1], array[i + 1][0] = first, last
    row[0] += first
    row[1] = i
    return last


@formula
def asks(x):
    """Formula that needs a value at compile time."""
    return 1.0 if x == 0.0 else x


@formula
def scaled(c, row):
    """Formula on a tuple; invalid for an array, whose length is unknown at compile time."""
    return tuple(c * value for value in row)


@formula
def of_a_row(x, row):
    """Formula with a non-number among its arguments."""
    return x * row


@kernel
def compiled_wrong(which, row):
    """Kernel that calls an invalid formula."""
    if len(which) == 1:
        return asks(row[0])
    if len(which) == 2:
        return scaled(2.0, row)[0]
    return of_a_row(2.0, row)


@kernel
def compiled_arithmetic(x, y, n, pair, like):
    """Kernel that calls `arithmetic`."""
    return arithmetic(x, y, n, pair, like)


@kernel
def compiled_swap(array, i, row):
    """Kernel that calls `swap`."""
    return swap(array, i, row)


def flat(values):
    """All numbers in order, numpy floats as Python floats."""
    whole = [number for value in values for number in (flat(value) if isinstance(value, tuple) else [value])]
    return [float(number) if isinstance(number, float) else number for number in whole]


@pytest.mark.parametrize("like", [(0.0, 0.0), (0.0, 0.0, 0.0)], ids=["plane", "space"])
@pytest.mark.parametrize(("x", "y", "n"), [(0.3, -1.7, 3), (-2.25, 1e-9, 8), (1e300, 1e-300, 1)])
def test_arithmetic_is_that_of_python(x, y, n, like):
    here = arithmetic(Exact(x), Exact(y), n, (Exact(x), Exact(y)), like)
    there = compiled_arithmetic(x, y, n, (x, y), like)
    assert flat(there) == flat(here)
    kinds = [float if isinstance(number, float) else type(number) for number in flat(here)]
    assert list(map(type, flat(there))) == kinds


def test_entries_of_an_array_are_read_and_written_in_their_order():
    """Rows with any stride."""
    outcomes = []
    for function in (swap, compiled_swap):
        whole = np.arange(24.0).reshape(4, 3, 2)
        array, row = whole[:, 1, :], np.zeros(4)[::2]
        outcomes.append((function(array, 2, row), whole, row))
    for here, there in zip(*outcomes, strict=True):
        np.testing.assert_array_equal(there, here)


@formula
def root_of_sum(a, b):
    """Every operation on pairs, with numbers on both sides."""
    return -(2.0 * a + b / 3) * (a - 1.5), 1.0 / b, square_root(a * a + b * b)


@kernel
def in_pairs(one, other, like, outcome):
    """Formula `root_of_sum` on two rows at once."""
    pairs = beside(load(one, like), load(other, like))
    found = root_of_sum(pairs[0], pairs[1])
    first, second = first_of(found), second_of(found)
    for i in range(3):
        outcome[0, i], outcome[1, i] = first[i], second[i]


def test_pairs_have_the_bits_of_numbers_by_themselves():
    one, other = np.array([0.3, -1.7]), np.array([-2.25, 1e-9])
    outcome = np.zeros((2, 3))
    in_pairs(one, other, (0.0, 0.0), outcome)
    for row, numbers in zip(outcome, (one, other), strict=True):
        assert tuple(row) == root_of_sum(*map(Exact, numbers))


@compiled
@pytest.mark.parametrize(
    ("count", "said"), [(1, "given one on the value of a number"), (2, "not iterable"), (3, "given _Array; allowed")]
)
def test_what_cannot_be_put_in_place_is_refused_as_it_is_compiled(count, said):
    with pytest.raises(numba.errors.TypingError, match=said):
        compiled_wrong((0.0,) * count, np.zeros(3))


@compiled
def test_what_is_no_number_is_refused():
    with pytest.raises(Exception, match=r"a formula: given unicode_type; allowed: numbers, lanes, arrays and tuples"):
        compiled_arithmetic("x", 1.0, 1, (1.0, 1.0), (0.0, 0.0))


@formula
def last_of_row(array, like):
    return row_of(array)[2 * len(like) - 1]


@kernel
def compiled_last(arrays, like):
    return last_of_row(arrays[1], like)


def test_entry_of_an_array_is_one_row_of_its_numbers():
    arrays = np.arange(12.0).reshape(3, 2, 2)
    assert compiled_last(arrays, (0.0, 0.0)) == arrays[1, 1, 1]


@compiled
def test_array_whose_numbers_are_not_adjacent_is_no_row():
    with pytest.raises(numba.errors.TypingError, match=r"one row: given array.*; allowed: a contiguous one"):
        compiled_last(np.zeros((3, 4, 2))[:, ::2], (0.0, 0.0))
