"""Block-tridiagonal linear solver against numpy's dense solver."""

import numpy as np
import pytest
from systems import dense_matrix

from cable_twin.mechanics.solution.block_tridiagonal import solve_block_tridiagonal

LIKE = {2: (0.0, 0.0), 3: (0.0, 0.0, 0.0)}


def random_blocks(nodes, dim, seed=3):
    rng = np.random.default_rng(seed)
    diagonal = rng.standard_normal((nodes, 2, 2, dim * dim))
    for slot in range(2):
        diagonal[:, slot, slot] += 6.0 * np.eye(dim).ravel()
    upper, lower = rng.standard_normal((2, nodes - 1, 2, 2, dim * dim))
    return diagonal, upper, lower, rng.standard_normal((nodes, 2, dim))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("nodes", [1, 2, 3, 40])
def test_solution_is_that_of_a_dense_solver(nodes, dim):
    """Unsymmetric blocks; agreement to 1e-12."""
    diagonal, upper, lower, right = random_blocks(nodes, dim)
    exact = np.linalg.solve(dense_matrix(diagonal, upper, lower), right.ravel())
    assert solve_block_tridiagonal(diagonal, upper, lower, right, LIKE[dim]) == -1
    np.testing.assert_allclose(right.ravel(), exact, rtol=0, atol=1e-12 * np.abs(exact).max())


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("node", [0, 2, 4])
@pytest.mark.parametrize("slot", [0, 1])
@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_block_without_inverse_is_named(dim, node, slot, value):
    """Singular node block, by zeros or NaN, without a coupling that could make it regular."""
    diagonal, upper, lower, right = random_blocks(5, dim)
    diagonal[node, slot], diagonal[node, :, slot] = 0.0, 0.0
    diagonal[node, slot, slot] = value * np.eye(dim).ravel() if value == 0.0 else value
    if node < 4:
        upper[node], lower[node] = 0.0, 0.0
    if node > 0:
        upper[node - 1], lower[node - 1] = 0.0, 0.0
    assert solve_block_tridiagonal(diagonal, upper, lower, right, LIKE[dim]) == node


def test_supported_rows_are_solved_as_identity():
    """Exactly zero increments of a node with the rows of `hold_ends`."""
    diagonal, upper, lower, right = random_blocks(4, 2)
    diagonal[0, 0], diagonal[0, :, 0], upper[0, 0], lower[0, :, 0], right[0, 0] = 0.0, 0.0, 0.0, 0.0, 0.0
    diagonal[0, 0, 0] = np.eye(2).ravel()
    assert solve_block_tridiagonal(diagonal, upper, lower, right, LIKE[2]) == -1
    assert right[0, 0].tolist() == [0.0, 0.0]
