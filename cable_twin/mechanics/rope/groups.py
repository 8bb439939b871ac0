"""Layout of residual and tangent of element groups in `Workspace.group`: one row a number, one lane an element.

First the vectors of the four nodal coordinates, then the sixteen blocks of coordinate i against j, row by row.
"""

from __future__ import annotations

from cable_twin.mechanics.language.traced import formula


@formula
def vector_row(i, like):
    """First row of the vector (dim,) of coordinate i."""
    return i * len(like)


@formula
def block_row(i, j, like):
    """First row of the block (dim²) of coordinate i against j."""
    dim = len(like)
    return 4 * dim + (4 * i + j) * dim * dim
