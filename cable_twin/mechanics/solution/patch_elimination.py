"""Condensation of moving loads onto the mesh nodes beside them, so that the rope stays block-tridiagonal.

A patch has, in rows and columns, the node before the load (r, r_x), the load's own (r, r_x before, r_x after, s) with
its vehicle condensed in it, and the node after the load. Gaussian elimination of the load's own leaves couplings of the
nodes before and after, C and C'. The node that follows the load is free to carry them, with a stand-in y and the rows

    before: .. + β x_before + β y,   y: β x_before + β y - C x_after,   after: .. - C' y + C' C x_after / β,

of which elimination of y leaves C x_after and C' x_before. The force of a clamp that holds the vehicle to another rope
stays, after these in rows and columns, and is one of the unknowns of the ropes (`bundle.clamp`).
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.simd import WIDTH
from cable_twin.mechanics.language.traced import formula, read_lanes, write_lanes
from cable_twin.mechanics.language.vectors import load, store
from cable_twin.mechanics.rope.point import clamp_row


@kernel
def condense_patches(state, work, patch_columns, like):
    """Eliminate the unknowns of all moving loads on a rope; add their Schur complements to the nodes beside the loads.

    Args:
        state: of the rope.
        work: with the patches.
        patch_columns: (vehicles, rows, columns) further right sides of the patches, of bullwheels; they stay there.
        like: any vector of the space.
    """
    dim, first, count = len(like), 0, patch_columns.shape[2]
    for node in range(1, state.node_load.size - 1):
        number = state.node_load[node]
        if number < 0:
            continue
        if state.node_load[node - 1] < 0:
            first = node
        following = state.node_load[node + 1]
        size = (3 * dim + 1 if following >= 0 else 2 * dim) + 5 * dim + 1
        if state.clamp_holds[number]:
            size = clamp_row(dim) + dim
        if work.along_held[number]:
            hold_row(work.patch[number], 5 * dim, work.along_increment[number])
        eliminate(work.patch[number], patch_columns[number], count, size, like)
        if following >= 0:
            hand_on(
                work.patch[number], work.patch[following], patch_columns[number], patch_columns[following], count, dim
            )
        else:
            carry_over(work, number, first, node, like)


@kernel
def hold_row(patch, row, increment):
    """Replace one row of a moving load's patch by a prescribed increment of its unknown."""
    for column in range(patch.shape[1]):
        patch[row, column] = 0.0
    patch[row, row], patch[row, patch.shape[0]] = 1.0, increment


@inlined_kernel
def own_row(turn, dim):
    """Row in a load's patch of the unknown eliminated as number `turn`: slopes on both sides, then r, then s."""
    if turn < 2 * dim:
        return 3 * dim + turn
    return turn if turn < 3 * dim else 5 * dim


@inlined_kernel
def turn_of(row, dim):
    """Number in the elimination order of the unknown in a `row` of a moving load's patch; inverse of `own_row`."""
    if row < 3 * dim:
        return row
    return row - 3 * dim if row < 5 * dim else 3 * dim


@kernel
def eliminate(patch, columns, count, size, like):
    """Eliminate a moving load's own unknowns from the other equations of its patch, which has `size` unknowns."""
    dim = len(like)
    first, end = 2 * dim, 5 * dim + 1
    for turn in range(3 * dim + 1):
        pivot = own_row(turn, dim)
        inverse = 1.0 / patch[pivot, pivot]
        for row in range(size):
            factor = patch[row, pivot] * inverse
            if factor == 0.0 or (first <= row < end and turn_of(row, dim) <= turn):
                continue
            subtract_row(patch, row, factor, pivot, like)
            for column in range(count):
                columns[row, column] -= factor * columns[pivot, column]


@formula
def subtract_row(patch, row, factor, pivot, like):
    """Subtract `factor` times one row of a load's patch from another, in whole lanes, eliminated columns included."""
    for column in range(0, 8 * len(like) + WIDTH, WIDTH):
        rest = read_lanes(patch, (row, column), WIDTH) - factor * read_lanes(patch, (pivot, column), WIDTH)
        write_lanes(rest, patch, (row, column))


@kernel
def hand_on(patch, following, columns, following_columns, count, dim):
    """Add the Schur complement of a moving load's patch to the patch of the next load, at the adjacent node."""
    before, own, last = 2 * dim, 5 * dim + 1, patch.shape[0]
    size = before + 3 * dim + 1
    for i in range(size):
        row = i if i < before else i - before + own
        for j in range(size):
            column = j if j < before else j - before + own
            following[i, j] += patch[row, column]
        following[i, last] += patch[row, last]
        for column in range(count):
            following_columns[i, column] += columns[row, column]


@kernel
def carry_over(work, number, first, node, like):
    """Add the Schur complement of a load's patch to the nodes beside its train of loads, at nodes `first` to `node`."""
    patch, before, after, dim = work.patch[number], first - 1, node + 1, len(like)
    own, last, count = 5 * dim + 1, patch.shape[0], node - first + 1
    size = abs(work.diagonal[before, 0, 0, 0]) + abs(patch[0, 0])
    scale = size if size > 0.0 else 1.0
    for i in range(2 * dim):
        work.right_side[before, i // dim, i % dim] += patch[i, last]
        work.right_side[after, i // dim, i % dim] += patch[own + i, last]
        for j in range(2 * dim):
            entry = (i % dim) * dim + j % dim
            work.diagonal[before, i // dim, j // dim, entry] += patch[i, j]
            back = patch[own + i, own + j]
            for k in range(2 * dim):
                back += patch[own + i, k] * patch[k, own + j] / scale
            work.diagonal[after, i // dim, j // dim, entry] += back
            work.upper[node, i // dim, j // dim, entry] = -patch[i, own + j]
            work.lower[node, i // dim, j // dim, entry] = -patch[own + i, j]
    for between in range(first, node + 1):
        for i in range(2 * dim):
            work.right_side[between, i // dim, i % dim] = 0.0
    for k in range(2):
        for axis in range(dim):
            entry = axis * (dim + 1)
            work.diagonal[before, k, k, entry] += count * scale
            work.upper[before, k, k, entry] = work.lower[before, k, k, entry] = scale
            work.diagonal[first, k, k, entry] = scale
            for between in range(first, node):
                work.upper[between, k, k, entry] = work.lower[between, k, k, entry] = -scale
                work.diagonal[between + 1, k, k, entry] = 2.0 * scale


@kernel
def recover_patches(state, work, like):
    """Write the increments of all nodes that follow loads, and of their arc lengths, from those of all other nodes."""
    for node in range(state.node_load.size):
        if state.node_load[node] < 0:
            store(load(work.right_side[node, 1], like), work.right_side[node, 2])
    for node in range(state.node_load.size - 2, 0, -1):
        if state.node_load[node] >= 0:
            substitute(state, work, node, like)


@kernel
def substitute(state, work, node, like):
    """Recover the increments of one moving load, from those of the nodes before and after its train of loads."""
    dim, number, start = len(like), state.node_load[node], node - 1
    while state.node_load[start] >= 0:
        start -= 1
    patch, own = work.patch[number], 5 * dim + 1
    following = state.node_load[node + 1]
    size = (3 * dim + 1 if following >= 0 else 2 * dim) + own
    last = patch.shape[0]
    if state.clamp_holds[number]:
        size = clamp_row(dim) + dim
    for turn in range(3 * dim, -1, -1):
        row = own_row(turn, dim)
        value = patch[row, last]
        for column in range(2 * dim):
            value -= patch[row, column] * work.right_side[start, column // dim, column % dim]
        for later in range(turn + 1, 3 * dim + 1):
            column = own_row(later, dim)
            value -= patch[row, column] * patch[column, last]
        for column in range(own, size):
            k = column - own
            if k >= 2 * dim and state.clamp_holds[number]:
                value -= patch[row, column] * patch[column, last]
            elif k < 3 * dim:
                value -= patch[row, column] * work.right_side[node + 1, k // dim, k % dim]
            else:
                value -= patch[row, column] * work.sliding_increment[following]
        patch[row, last] = value / patch[row, row]
    for k in range(3 * dim):
        work.right_side[node, k // dim, k % dim] = patch[2 * dim + k, last]
    work.sliding_increment[number] = patch[5 * dim, last]
