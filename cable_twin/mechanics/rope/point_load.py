"""Point loads on the rope: nodal forces, tangent, and forces along the rope on nodes that follow moving loads.

On an element beside a moving load, a shift δX of the load's node moves the rope at a fixed arc length by
-(S_r r_x + S_t r_xx) δX, with r_x and r_xx at the node (`patch`). So a point load F has, beside its nodal forces S F,
the force -F·(S_r r_x + S_t r_xx) on X. As a cubic stays the same curve when a node moves along it, this is F·∂(S e)/∂X.
"""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel
from cable_twin.mechanics.language.vectors import add_scaled, dot, product, scale, transpose
from cable_twin.mechanics.rope.ale import nodal_vectors
from cable_twin.mechanics.rope.patch import shift_vectors
from cable_twin.mechanics.rope.patch_assembly import shift_row, shifts
from cable_twin.mechanics.rope.point import add_column, add_force, add_row, add_tangent, patch_row


@inlined_kernel
def shift_of_point(state, point, end, like):
    """Derivatives (dim,) of r (-) and of r_x (1/m) at a point by the arc length of one end, 0 or 1, of its element."""
    e = nodal_vectors(state.nodes.position, point.element, like)
    r_x, r_xx = shift_vectors(end, e, state.mesh.length[point.element])
    r, t = 2 * end, 2 * end + 1
    moved = add_scaled(-point.shape[t], r_xx, scale(-point.shape[r], r_x))
    return moved, add_scaled(-point.shape_x[t], r_xx, scale(-point.shape_x[r], r_x))


@inlined_kernel
def force_along(state, node, force, point, like):
    """Force (N) of a point load (dim,) on the arc length of a node; 0 unless the node is at an end of its element."""
    if point.element == node:
        return dot(force, shift_of_point(state, point, 0, like)[0])
    if point.element == node - 1:
        return dot(force, shift_of_point(state, point, 1, like)[0])
    return 0.0


@inlined_kernel
def add_point_load(force, point, state, work):
    """Add a force (dim,) in N at a point of the rope to the residual of nodes, and of arc lengths of moving nodes."""
    add_force(force, point, work)
    element = point.element
    number = work.patch_of[element]
    if number >= 0:
        patch, right, dim = work.patch[number], work.patch_right[element], len(force)
        for end in range(2):
            if shifts(state, work, element + end):
                moved, _ = shift_of_point(state, point, end, force)
                patch[shift_row(right, end, dim), patch.shape[0]] += dot(moved, force)


@inlined_kernel
def add_point_tangent(force, by_place, by_slope, point, stiffness_factor, state, work):
    """Add the tangent of a point load on the rope, by nodal coordinates and by arc lengths of moving nodes.

    Of an arc length by itself ∂²S/∂X² is left out, which is little beside the stiffness of the rope.

    Args:
        force: (dim,) N.
        by_place: as in `point.add_tangent`.
        by_slope: likewise.
        point: the place.
        stiffness_factor: as in `assemble`.
        state: of the rope.
        work: with the patches.
    """
    add_tangent(by_place, by_slope, point, work)
    element = point.element
    number = work.patch_of[element]
    if number >= 0:
        patch, right, dim, length = (
            work.patch[number],
            work.patch_right[element],
            len(force),
            state.mesh.length[element],
        )
        share = 0.5 * (1.0 - point.shape_x[1] + point.shape_x[3])  # of the way from the first end to the second one
        for end in range(2):
            if shifts(state, work, element + end):
                r, r_x = shift_of_point(state, point, end, force)
                row = shift_row(right, end, dim)
                on_r = add_scaled(1.0, product(by_place[0], r), product(by_place[1], r_x))
                on_r_x = add_scaled(1.0, product(by_slope[0], r), product(by_slope[1], r_x))
                of_r = product(transpose(by_place[0]), r)
                of_r = add_scaled(1.0, product(transpose(by_slope[0]), r_x), of_r)
                of_r_x = product(transpose(by_place[1]), r)
                of_r_x = add_scaled(1.0, product(transpose(by_slope[1]), r_x), of_r_x)
                patch[row, row] += dot(r, on_r) + dot(r_x, on_r_x)
                for j in range(4):
                    place, turn = point.shape[j], point.shape_x[j]
                    moved = scale(-stiffness_factor * change_of_shape(place, turn, share, length, j, end), force)
                    to_j = add_scaled(place, on_r, add_scaled(turn, on_r_x, moved))
                    from_j = add_scaled(place, of_r, add_scaled(turn, of_r_x, moved))
                    add_column(to_j, patch, patch_row(right, j, dim), row)
                    add_row(from_j, patch, row, patch_row(right, j, dim))


@inlined_kernel
def change_of_shape(shape, shape_x, share, length, j, end):
    """Derivative of shape function `j` at a fixed arc length, by the arc length of one end, 0 or 1, of its element.

    `share` (-) is the place on the element, of a `length` (m). Those of slopes, with odd `j`, have a factor of it.
    """
    grown = shape / length if j % 2 == 1 else 0.0
    return -(1.0 - share) * shape_x - grown if end == 0 else grown - share * shape_x
