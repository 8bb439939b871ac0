"""Points on the rope: element search, interpolation, and point loads.

At a point of an element with the nodal coordinates e, r = S e; coordinate i of an element is r or r_x of its first node
(0, 1), or of its second one (2, 3).
"""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import WIDTH, spread
from cable_twin.mechanics.language.traced import Mat, Vec, formula, read_lanes, row_of, write_lanes
from cable_twin.mechanics.language.vectors import accumulate, add_scaled, load, scale
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x, shape_functions_xx

Four = tuple[float, float, float, float]


R, BEFORE, AFTER = 0, 1, 2  # rows of a node: its position, and its slopes towards the start and the end of the rope


class Point(NamedTuple):
    """Point on an element, given by the shape functions (eq. 2) and their derivatives at this point."""

    element: int
    shape: Four  # S: - for positions, m for slopes
    shape_x: Four  # S_x: 1/m and -
    shape_xx: Four  # S_xx: 1/m² and 1/m


@kernel
def element_at(cable, state, arc_length):
    """Index of the element at an `arc_length` (m); beyond an end, the end element; the first one for NaN."""
    place = arc_length / cable.cell_length
    cell = int(min(place, cable.cell_element.size - 1.0)) if place > 0.0 else 0
    return element_beside(cable, state, arc_length, cable.cell_element[cell])


@inlined_kernel
def element_beside(cable, state, arc_length, element):
    """Index of the element at an `arc_length` (m), looked for from a given one on; that one for NaN."""
    nodes = state.mesh.arc_length  # which may have moved from where the grid has them
    while element > 0 and arc_length < nodes[element]:
        element -= 1
    while element < cable.element_count - 1 and arc_length >= nodes[element + 1]:
        element += 1
    return element


@inlined_kernel
def point_on(state, element, arc_length):
    """Point of the rope at an `arc_length` (m) on a given element, extrapolated beyond its nodes."""
    x, length = arc_length - state.mesh.arc_length[element], state.mesh.length[element]
    return Point(element, shape_functions(x, length), shape_functions_x(x, length), shape_functions_xx(x, length))


@inlined_kernel
def point_at(cable, state, arc_length):
    """Point of the rope at an `arc_length` (m) of the whole cable."""
    return point_on(state, element_at(cable, state, arc_length), arc_length)


@formula
def weighted(vectors, weights):
    """Weighted sum (dim,) of the four nodal vectors of an element, with shape functions as `weights`."""
    return add_scaled(
        weights[0],
        vectors[0],
        add_scaled(weights[1], vectors[1], add_scaled(weights[2], vectors[2], scale(weights[3], vectors[3]))),
    )


@formula
def interpolate(coordinates, element, weights, like):
    """Weighted sum (dim,) of the four nodal vectors of an element in `coordinates` (nodes, 3, dim), see `weighted`."""
    return weighted([coordinate(coordinates, element, i, like) for i in range(4)], weights)


@inlined_kernel
def value(coordinates, point, like):
    """Position r (dim,) in m at a point of the rope from nodal coordinates, or velocity r_t from nodal rates: S e."""
    return interpolate(coordinates, point.element, point.shape, like)


@inlined_kernel
def slope(coordinates, point, like):
    """Slope r_x (dim,) at a point of the rope from nodal coordinates, or r_tx in 1/s from nodal rates: S_x e."""
    return interpolate(coordinates, point.element, point.shape_x, like)


@inlined_kernel
def bend(coordinates, point, like):
    """Second derivative r_xx (dim,) in 1/m at a point of the rope from nodal coordinates: S_xx e."""
    return interpolate(coordinates, point.element, point.shape_xx, like)


@kernel
def position_on_cable(cable, state, arc_length):
    """Position r (dim,) in m of the cable at an arc length (m)."""
    return value(state.nodes.position, point_at(cable, state, arc_length), cable.gravity)


@formula
def coordinate(array, element, i, like):
    """Nodal coordinate `i` (dim,) of an element from an `array` (nodes, 3, dim)."""
    return load(array[element + i // 2, (i % 2) * (AFTER - i // 2)], like)


@formula
def accumulate_vector(vector, array, element, i):
    """Add a vector (dim,) to nodal coordinate `i` of an element not beside a load, in an `array` (nodes, rows, dim)."""
    accumulate(vector, array[element + i // 2, i % 2])


@inlined_kernel
def add_to(vector, element, i, work):
    """Add a vector (dim,) to the right side at nodal coordinate `i` of an element; beside a load, in its patch."""
    load_number = work.patch_of[element]
    if load_number < 0:
        accumulate_vector(vector, work.right_side, element, i)
    else:
        row = patch_row(work.patch_right[element], i, len(vector))
        add_column(vector, work.patch[load_number], row, work.patch.shape[1])


@inlined_kernel
def add_force(force, point, work):
    """Add a force (dim,) in N at a point of the rope to the right side of the nodes beside it."""
    for i in range(4):
        add_to(scale(point.shape[i], force), point.element, i, work)


@inlined_kernel
def add_block(matrix, element, i, j, work):
    """Add a matrix to the tangent block of nodal coordinates `i`, `j` of an element; beside a load, in its patch."""
    load_number = work.patch_of[element]
    if load_number >= 0:
        right, dim = work.patch_right[element], len(matrix)
        add_matrix(matrix, work.patch[load_number], patch_row(right, i, dim), patch_row(right, j, dim))
    elif i // 2 == j // 2:
        accumulate(matrix, work.diagonal[element + i // 2, i % 2, j % 2])
    elif i // 2 == 0:
        accumulate(matrix, work.upper[element, i % 2, j % 2])
    else:
        accumulate(matrix, work.lower[element, i % 2, j % 2])


@inlined_kernel
def add_tangent(by_place, by_slope, point, work):
    """Add the tangent of a point load on the rope: of its force on r, and of its generalized force on r_x.

    Args:
        by_place: derivatives (dim²) of the force, which works by Δr, by r and by r_x.
        by_slope: derivatives (dim²) of the generalized force that works by Δr_x, likewise.
        point: the place.
        work: with the tangent blocks, or the patch, of its element.
    """
    element = point.element
    load_number = work.patch_of[element]
    if load_number >= 0:
        patch, right = work.patch[load_number], work.patch_right[element]
        add_tangent_to_patch(by_place, by_slope, point.shape, point.shape_x, patch, right)
    else:
        blocks = work.diagonal[element], work.upper[element], work.lower[element], work.diagonal[element + 1]
        add_tangent_to_nodes(by_place, by_slope, point.shape, point.shape_x, *blocks)


@formula
def add_tangent_to_nodes(by_place, by_slope, shape, shape_x, first, upper, lower, second):
    """Add the tangent of a point load to the node blocks (2, 2, dim²) of an element not beside a moving load."""
    for i, j, matrix in tangent_blocks(by_place, by_slope, shape, shape_x):
        blocks = ((first, upper), (lower, second))[i // 2][j // 2]
        accumulate(matrix, blocks[i % 2, j % 2])


@formula
def add_tangent_to_patch(by_place, by_slope, shape, shape_x, patch, right):
    """Add the tangent of a point load on the element before (`right` 0) or after (1) a moving load to its patch."""
    dim = len(by_place[0])
    rows = [patch_row(right, i, dim) for i in range(4)]
    for i, j, matrix in tangent_blocks(by_place, by_slope, shape, shape_x):
        add_matrix(matrix, patch, rows[i], rows[j])


@formula
def write_point_load(force, by_place, by_slope, group):
    """Write force and tangent of `WIDTH` point loads, as `add_tangent` takes them, to a `group`, one row a number."""
    matrices = (*by_place, *by_slope)
    for k, matrix in enumerate(matrices):
        spread(matrix, group, k * len(matrix.entries))
    spread(force, group, len(matrices) * len(force) * len(force))


@formula
def read_point_load(numbers, like):
    """Force, and tangents by place and by slope, of a point load from its `numbers`, in the order of a `group`."""
    square = len(like) * len(like)
    matrix = Mat([like] * len(like))
    matrices = [load(numbers, matrix, k * square) for k in range(4)]
    return load(numbers, like, 4 * square), (matrices[0], matrices[1]), (matrices[2], matrices[3])


@formula
def add_point_tangents(numbers, shape, shape_x, element, diagonal, upper, lower, like):
    """Add the tangent of a point load on an element beside no moving load to node blocks, as `add_tangent_to_nodes`.

    Takes the `numbers` of the load in the order of a `group`. Those of a block are added in SIMD lanes, as they are in
    memory.
    """
    square = len(like) * len(like)
    whole = square - square % WIDTH
    chunks = [
        Vec(
            [read_lanes(numbers, (k * square + first,), WIDTH) for first in range(0, whole, WIDTH)]
            + [numbers[k * square + entry] for entry in range(whole, square)]
        )
        for k in range(4)
    ]
    rows = (
        (row_of(diagonal[element]), row_of(upper[element])),
        (row_of(lower[element]), row_of(diagonal[element + 1])),
    )
    for i, j, block in tangent_blocks(chunks[:2], chunks[2:], shape, shape_x):
        row, first = rows[i // 2][j // 2], (i % 2 * 2 + j % 2) * square
        for k in range(whole // WIDTH):
            place = (first + k * WIDTH,)
            write_lanes(read_lanes(row, place, WIDTH) + block[k], row, place)
        for k in range(whole // WIDTH, len(block)):
            place = first + whole + k - whole // WIDTH
            row[place] = row[place] + block[k]


def tangent_blocks(by_place, by_slope, shape, shape_x):
    """Yield i, j and the block (dim²) of a point load's tangent by nodal coordinates i and j; for traced formulas."""
    for j in range(4):
        moved = shape[j] * by_place[0] + shape_x[j] * by_place[1]
        turned = shape[j] * by_slope[0] + shape_x[j] * by_slope[1]
        for i in range(4):
            yield i, j, shape[i] * moved + shape_x[i] * turned


@formula
def add_matrix(matrix, array, row, column):
    """Add a full matrix to a two-dimensional `array`, from a row and a column on."""
    for i, line in enumerate(matrix):
        for j, entry in enumerate(line):
            array[row + i, column + j] = array[row + i, column + j] + entry


@formula
def add_column(vector, array, row, column):
    """Add a vector to a column of a two-dimensional `array`, from a row on."""
    for i, entry in enumerate(vector):
        array[row + i, column] = array[row + i, column] + entry


@formula
def add_row(vector, array, row, column):
    """Add a vector to a row of a two-dimensional `array`, from a column on."""
    for j, entry in enumerate(vector):
        array[row, column + j] = array[row, column + j] + entry


@formula
def read_matrix(array, row, column, like):
    """Matrix of the shape of `like` from a two-dimensional `array`, from a row and a column on."""
    return tuple(tuple(array[row + i, column + j] for j in range(len(line))) for i, line in enumerate(like))


@formula
def clamp_row(dim):
    """First row of a clamp's force in the patch (equations) of a moving load, after the rows of the next node.

    The next node follows no other load then.
    """
    return 7 * dim + 1


@formula
def patch_row(right, i, dim):
    """First row, in a load's patch, of nodal coordinate `i` of the element before (`right` 0) or after (1) the load.

    Rows are those of the node before the load, r and r_x; of the load, r, r_x before and after it, and s; of the node
    after the load likewise, whose last ones are used where it follows a load too.
    """
    before = i * dim  # r, r_x of the node before, r and r_x before of the load
    after = 2 * dim + (i % 2) * 2 * dim + (i // 2) * (3 * dim + 1) - (i // 2) * (i % 2) * dim
    return before + right * (after - before)
