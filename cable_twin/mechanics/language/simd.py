"""SIMD lanes: four numbers in one register, for one formula on four elements at once.

A value of lanes takes the place of a float in the formulas of an element, which are written for either. Each lane has
the arithmetic of IEEE 754 that a float would have, so the results are the same to the last bit. With the JIT off,
lanes are arrays of numpy. Past the last element or number, lanes repeat the last one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cable_twin.mechanics.language.traced import (
    LANES,
    Mat,
    Vec,
    as_lanes,
    formula,
    if_less,
    lane_of,
    least,
    read_lanes,
    row_of,
    shuffled,
    size_of,
    write_lanes,
)

WIDTH = LANES.width


@formula
def larger(one: Any, other: Any) -> Any:
    """Larger of two floats, or of each SIMD lane of them; the second one where one of them is no number."""
    return if_less(other, one, one, other)


@formula
def smaller(one: Any, other: Any) -> Any:
    """Smaller of two floats, or of each SIMD lane of them; the second one where one of them is no number."""
    return if_less(one, other, one, other)


@formula
def magnitude(value: Any) -> Any:
    """Absolute value of a float, or of each SIMD lane."""
    return if_less(value, 0.0, -value, value)


@formula
def gather(coordinates: Any, first: Any, like: Vec) -> tuple[Vec, ...]:
    """Nodal vectors r_A, slope A, r_B, slope B (dim,) of `WIDTH` elements from `first` on, as SIMD lanes.

    Takes `coordinates` (nodes, 2, dim) or their rates. The numbers of a node are loaded at once, as they are in memory,
    and then turned into lanes.
    """
    last = size_of(coordinates, 0) - 2
    return of_elements(coordinates, [least(first + lane, last) for lane in range(WIDTH)], 1, like)


@formula
def gather_listed(coordinates: Any, elements: Any, first: Any, like: Vec) -> tuple[Vec, ...]:
    """Nodal vectors r_A, slope after A, r_B, slope before B of `WIDTH` listed elements, as SIMD lanes."""
    return of_elements(coordinates, [elements[first + lane] for lane in range(WIDTH)], 2, like)


def of_elements(coordinates: Any, elements: Sequence[Any], after: int, like: Vec) -> tuple[Vec, ...]:
    """Nodal vectors of `elements` as SIMD lanes; row `after` of a node is the slope after it; for traced formulas."""
    dim = len(like)
    vectors: list[Vec] = []
    for end in range(2):
        size = (after + 1 if end == 0 else 2) * dim
        rows = [read_lanes(coordinates, (element + end, 0, 0), size) for element in elements]
        lanes = [as_lanes([lane_of(row, k) for row in rows]) for k in range(size)]
        vectors += Vec(lanes[:dim]), Vec(lanes[-dim:])
    return tuple(vectors)


@formula
def gather_numbers(numbers: Any, first: Any) -> Any:
    """SIMD lanes of `WIDTH` entries of `numbers` (elements,) from `first` on."""
    last = size_of(numbers, 0) - 1
    return as_lanes([numbers[least(first + lane, last)] for lane in range(WIDTH)])


@formula
def gather_numbers_listed(numbers: Any, elements: Any, first: Any) -> Any:
    """SIMD lanes of the entries of `numbers` for `WIDTH` elements in a list, from list entry `first` on."""
    return as_lanes([numbers[elements[first + lane]] for lane in range(WIDTH)])


@formula
def gather_vectors_listed(rows: Any, elements: Any, first: Any, like: Vec) -> Vec:
    """Vector (dim,) of SIMD lanes: columns of `rows` (dim, n) for elements in a list, from list entry `first` on."""
    return Vec(as_lanes([rows[axis, elements[first + lane]] for lane in range(WIDTH)]) for axis in range(len(like)))


@formula
def gather_vectors(rows: Any, first: Any, like: Vec) -> Vec:
    """Vector (dim,) of SIMD lanes: `WIDTH` adjacent columns of `rows` (dim, n) from column `first` on, all existing."""
    return Vec(read_lanes(rows, (axis, first), WIDTH) for axis in range(len(like)))


@formula
def gather_rows(rows: Any, first: Any, like: Vec) -> Vec:
    """Vector (dim,) of SIMD lanes: `WIDTH` adjacent rows of `rows` (n, dim), from row `first` on."""
    last, dim, numbers = size_of(rows, 0) - 1, len(like), row_of(rows)
    starts = [dim * least(first + lane, last) for lane in range(WIDTH)]
    return Vec(as_lanes([numbers[start + axis] for start in starts]) for axis in range(dim))


@formula
def put_vectors(values: Vec, rows: Any, first: Any) -> None:
    """Write a vector (dim,) of SIMD lanes to `WIDTH` adjacent columns of `rows` (dim, n) from `first` on."""
    for k, value in enumerate(values):
        write_lanes(value, rows, (k, first))


@formula
def read_numbers(numbers: Any, first: Any) -> Any:
    """SIMD lanes of `WIDTH` entries of `numbers` (n,) from `first` on, all existing."""
    return read_lanes(numbers, (first,), WIDTH)


@formula
def put_numbers(lanes: Any, numbers: Any, first: Any) -> None:
    """Write SIMD lanes to `WIDTH` entries of `numbers` (n,) from `first` on, all existing."""
    write_lanes(lanes, numbers, (first,))


@formula
def read_vector(rows: Any, first: Any, like: Vec) -> Vec:
    """Vector (dim,) of SIMD lanes from as many rows of `rows` (rows, WIDTH), from row `first` on."""
    return Vec(read_lanes(rows, (first + axis, 0), WIDTH) for axis in range(len(like)))


@formula
def read_square(rows: Any, first: Any, like: Vec) -> Mat:
    """Matrix (dim, dim) of SIMD lanes from as many rows of `rows` (rows, WIDTH), from row `first` on."""
    dim = len(like)
    return Mat(read_vector(rows, first + i * dim, like) for i in range(dim))


@formula
def spread(values: Vec | Mat, rows: Any, first: Any) -> None:
    """Write a vector or matrix of SIMD lanes to as many rows of `rows` (rows, WIDTH), from row `first` on."""
    for k, value in enumerate(values.entries):
        write_lanes(value, rows, (first + k, 0))


@formula
def add_spread(values: Vec | Mat, rows: Any, first: Any) -> None:
    """Add a vector or matrix of SIMD lanes to as many rows of `rows` (rows, WIDTH), from row `first` on."""
    for k, value in enumerate(values.entries):
        place = first + k, 0
        write_lanes(read_lanes(rows, place, WIDTH) + value, rows, place)


@formula
def add_diagonal(value: Any, rows: Any, first: Any, dim: int) -> None:
    """Add SIMD lanes to the diagonal of the matrix (dim, dim) of lanes in `rows` (rows, WIDTH), from row `first` on."""
    for axis in range(dim):
        place = first + axis * (dim + 1), 0
        write_lanes(read_lanes(rows, place, WIDTH) + value, rows, place)


@formula
def turn_lanes(rows: Any, numbers: Any, like: Vec) -> None:
    """Transpose the lanes of a group of elements, `rows` (n, WIDTH), into `numbers` (WIDTH, n), one row per element."""
    dim = len(like)
    _turn(rows, numbers, 4 * dim + 16 * dim * dim)


@formula
def turn_point_loads(rows: Any, numbers: Any, like: Vec) -> None:
    """Transpose the lanes of a group of point loads into one row per load; see `point.write_point_load`."""
    dim = len(like)
    _turn(rows, numbers, dim + 4 * dim * dim)


def _turn(rows: Any, numbers: Any, count: int) -> None:
    """Transpose at least the first `count` rows of a group, in whole squares of `WIDTH`; for traced formulas."""
    for first in range(0, count, WIDTH):
        lanes = transposed([read_lanes(rows, (first + k, 0), WIDTH) for k in range(WIDTH)])
        for number, own in enumerate(lanes):
            write_lanes(own, numbers, (number, first))


def transposed(rows: Sequence[Any]) -> list[Any]:
    """Transpose a square matrix of `WIDTH` rows in SIMD registers; for traced formulas."""
    a, b, c, d = rows
    even, odd = (0, 4, 2, 6), (1, 5, 3, 7)
    halves = shuffled(a, b, even), shuffled(a, b, odd), shuffled(c, d, even), shuffled(c, d, odd)
    low, high = (0, 1, 4, 5), (2, 3, 6, 7)
    return [shuffled(halves[k], halves[k + 2], half) for half in (low, high) for k in range(2)]


def read_beside(arrays: Sequence[Any], count: int) -> list[Any]:
    """Read the first `count` numbers of `WIDTH` arrays as SIMD lanes, a lane per array; for traced formulas.

    Numbers are read in the order of memory and then transposed into lanes.
    """
    whole, rows = count - count % WIDTH, [row_of(array) for array in arrays]
    numbers: list[Any] = []
    for k in range(0, whole, WIDTH):
        numbers += transposed([read_lanes(row, (k,), WIDTH) for row in rows])
    return numbers + [as_lanes([row[k] for row in rows]) for k in range(whole, count)]


def write_beside(numbers: Sequence[Any], arrays: Sequence[Any]) -> None:
    """Write SIMD registers, one per entry with a lane per array, to `WIDTH` arrays; for traced formulas."""
    whole, rows = len(numbers) - len(numbers) % WIDTH, [row_of(array) for array in arrays]
    for k in range(0, whole, WIDTH):
        for own, row in zip(transposed(numbers[k : k + WIDTH]), rows, strict=True):
            write_lanes(own, row, (k,))
    for k in range(whole, len(numbers)):
        for number, row in enumerate(rows):
            row[k] = lane_of(numbers[k], number)


@formula
def sum_of_lanes(lanes: Any) -> Any:
    """Sum of all lanes of a SIMD register, added from the first lane on."""
    return sum(lane_of(lanes, k) for k in range(WIDTH))


@formula
def beside(one: Any, other: Any) -> Any:
    """Pair the numbers of two tuples of equal structure as SIMD lanes, so that a formula evaluates both at once."""
    return together([one, other])


def together(parts: Sequence[Any]) -> Any:
    """Join the numbers of several tuples of equal structure as SIMD lanes, so that a formula evaluates all at once."""
    if isinstance(parts[0], tuple):
        return tuple(together(each) for each in zip(*parts, strict=True))
    return as_lanes(parts)


@formula
def first_of(pairs: Any) -> Any:
    """First tuple of numbers of a pair made with `beside`, which holds two tuples in the lanes of SIMD registers."""
    return _lanes_of(pairs, 0)


@formula
def second_of(pairs: Any) -> Any:
    """Second tuple of numbers of a pair made with `beside`, which holds two tuples in the lanes of SIMD registers."""
    return _lanes_of(pairs, 1)


def _lanes_of(pairs: Any, number: int) -> Any:
    if isinstance(pairs, tuple):
        return tuple(_lanes_of(pair, number) for pair in pairs)
    return lane_of(pairs, number)
