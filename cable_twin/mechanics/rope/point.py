"""A place on the rope: which element holds it, what the rope is like there, and what acts on it there."""

from __future__ import annotations

from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.vectors import accumulate, add_scaled, load, scale
from cable_twin.mechanics.rope.shape_functions import shape_functions


@kernel
def locate(cable, arc_length):
    """Element that holds `arc_length` (m), and the paper's n in it (m); beyond an end, the end element extrapolated."""
    return locate_on_mesh(cable.element_count, cable.element_length, arc_length)


@kernel
def locate_on_mesh(element_count, element_length, arc_length):
    """As `locate`, from what it needs of the cable."""
    place = arc_length / element_length
    element = int(min(place, element_count - 1.0)) if place > 0.0 else 0  # what is no number is on the first one
    return element, arc_length - element * element_length


@kernel
def interpolate(coordinates, element, weights, like):
    """Weighted sum (dim,) of the four nodal vectors of an element."""
    return add_scaled(
        weights[0],
        load(coordinates[element, 0], like),
        add_scaled(
            weights[1],
            load(coordinates[element, 1], like),
            add_scaled(
                weights[2],
                load(coordinates[element + 1, 0], like),
                scale(weights[3], load(coordinates[element + 1, 1], like)),
            ),
        ),
    )


@kernel
def position_on_cable(cable, state, arc_length):
    """R (dim,) in m at an arc length."""
    element, x = locate(cable, arc_length)
    return interpolate(state.nodes.position, element, shape_functions(x, cable.element_length), cable.gravity)


@inlined_kernel
def add_block(matrix, element, i, j, diagonal, upper, lower):
    """Add a full matrix to the equations of coordinate `i` of an element, where they have its coordinate `j`.

    Coordinates 0 and 1 are r and r_x at its first node, 2 and 3 those at its second one.
    """
    if i // 2 == j // 2:
        accumulate(matrix, diagonal[element + i // 2, i % 2, j % 2])
    elif i // 2 == 0:
        accumulate(matrix, upper[element, i % 2, j % 2])
    else:
        accumulate(matrix, lower[element, i % 2, j % 2])
