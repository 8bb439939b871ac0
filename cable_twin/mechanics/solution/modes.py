"""Natural frequencies and mode shapes about the present equilibrium, every joint held at its arc length.

Over towers the cable slides without friction; counterweights move.

A held joint leaves a carriage only its pitches: the place of each body follows from them and from r = S e. So the
unknowns are the free nodal coordinates and the pitches, without multipliers, and K x = ω² M x is symmetric.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import eigsh

from cable_twin.mechanics.language.orientations import orientation
from cable_twin.mechanics.language.turns import cross
from cable_twin.mechanics.on_rope.counterweight import add_counterweights
from cable_twin.mechanics.on_rope.grip import moment_by_slope, turn_by_slope
from cable_twin.mechanics.on_rope.sliding_joint import grip_moment
from cable_twin.mechanics.on_rope.tower import add_towers
from cable_twin.mechanics.parameters import FloatArray, IntArray, System
from cable_twin.mechanics.rope.elastic_models import chord_and_slopes, elastic_force
from cable_twin.mechanics.rope.point import element_at
from cable_twin.mechanics.rope.shape_functions import MASS, shape_functions, shape_functions_x
from cable_twin.mechanics.state import State, Workspace, allocate_workspace, clone_state

DENSE_LIMIT = 400  # unknowns up to which all frequencies are computed at once
DIFFERENCE = 1e-6  # of an element's length, for the derivative of the elastic force


def natural_modes(system: System, state: State, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest natural frequencies and their shapes.

    Args:
        system: parameters.
        state: an equilibrium; velocities in it are ignored.
        count: how many.

    Returns:
        Frequencies (count,) in Hz, rising; shapes (count, nodes, 2, dim) of the nodal coordinates, largest entry 1.

    Raises:
        ValueError: when the system has fewer modes than `count`, fewer than one is asked for, or carriages in space.
    """
    free = _free_directions(system)
    nodal = free.shape[0]
    pitches = system.carriages.mass.size
    if pitches and len(system.cable.gravity) == 3:
        raise ValueError("natural frequencies of carriages in space asked for; allowed: of a bare cable, or in a plane")
    unknowns = free.shape[1] + pitches
    if not 1 <= count <= unknowns:
        raise ValueError(f"{count} natural frequencies asked for; this cable has 1 to {unknowns}")
    bodies = _body_directions(system, state)
    basis = _block_diagonal(free, _diagonal(np.ones(pitches)))

    inertia = system.carriages.inertia.ravel()[:pitches]
    inertias = np.column_stack([system.carriages.mass, system.carriages.mass, inertia]).ravel()
    support_stiffness, counterweight_mass = _tower_matrices(system, state)
    mass = _block_diagonal(_cable_mass(system) + counterweight_mass, csc_array((pitches, pitches)))
    mass = mass + bodies.T @ _diagonal(inertias) @ bodies
    cable_stiffness = _cable_stiffness(system, state) + support_stiffness
    stiffness = _block_diagonal(cable_stiffness, _pitch_stiffness(system, state)) + _spring_stiffness(system, state)
    mass, stiffness = basis.T @ mass @ basis, basis.T @ stiffness @ basis
    mass, stiffness = (mass + mass.T) / 2.0, (stiffness + stiffness.T) / 2.0

    if unknowns <= DENSE_LIMIT or count >= unknowns - 1:
        squared, vectors = eigh(stiffness.toarray(), mass.toarray(), subset_by_index=(0, count - 1))
    else:
        # below every mode that a stable equilibrium has, so that the factorisation exists with rigid modes as well
        wave_speed = np.sqrt(system.cable.axial_stiffness / system.cable.mass_per_length)
        shift = -((1e-3 * wave_speed / system.cable.unstrained_length) ** 2)
        squared, vectors = eigsh(csc_array(stiffness), count, M=csc_array(mass), sigma=shift, which="LM")
    order = np.argsort(squared)
    shapes = (basis @ vectors[:, order])[:nodal].T.reshape(count, -1, 2, len(system.cable.gravity))
    largest = np.take_along_axis(
        shapes.reshape(count, -1), np.abs(shapes.reshape(count, -1)).argmax(axis=1)[:, None], axis=1
    )
    largest[largest == 0.0] = 1.0
    return np.sqrt(np.maximum(squared[order], 0.0)) / (2.0 * np.pi), shapes / largest[:, :, None, None]


def _diagonal(values: FloatArray) -> csc_array:
    """Diagonal matrix, which may have no rows."""
    return coo_array((values, (np.arange(values.size),) * 2), shape=(values.size,) * 2).tocsc()


def _block_diagonal(a: csc_array, b: csc_array) -> csc_array:
    """Block-diagonal matrix of two, either of which may have no rows."""
    a, b = coo_array(a), coo_array(b)
    rows = np.concatenate([a.row, b.row + a.shape[0]])
    columns = np.concatenate([a.col, b.col + a.shape[1]])
    shape = (a.shape[0] + b.shape[0], a.shape[1] + b.shape[1])
    return coo_array((np.concatenate([a.data, b.data]), (rows, columns)), shape=shape).tocsc()


def _free_directions(system: System) -> csc_array:
    """Orthonormal directions of the nodal coordinates that no support holds, (nodes 2 dim, free)."""
    cable = system.cable
    dim = len(cable.gravity)
    size = (cable.element_count + 1) * 2 * dim
    columns: list[FloatArray] = []
    rows: list[IntArray] = []
    for end, first in ((0, 0), (1, size - 2 * dim)):
        for slot in range(2):
            values, vectors = np.linalg.eigh(cable.end_projector[end, slot].reshape(dim, dim))
            for vector in vectors[:, values > 0.5].T:
                columns.append(vector)
                rows.append(first + slot * dim + np.arange(dim))
    inner = np.arange(2 * dim, size - 2 * dim)
    held = coo_array(
        (
            np.concatenate([np.ones(inner.size), *columns]),
            (
                np.concatenate([inner, *rows]).astype(np.int64),
                np.concatenate(
                    [np.arange(inner.size), *(np.full(dim, inner.size + k) for k in range(len(columns)))]
                ).astype(np.int64),
            ),
        ),
        shape=(size, inner.size + len(columns)),
    )
    return held.tocsc()


def _cable_mass(system: System) -> csc_array:
    """Mass matrix (nodes 2 dim, nodes 2 dim) of the cable (eq. 5, 6)."""
    cable = system.cable
    length, dim = cable.element_length, len(cable.gravity)
    scale = np.stack([np.ones_like(length), length, np.ones_like(length), length], axis=1)
    weights = np.array(MASS) * scale[:, :, None] * scale[:, None, :] * (cable.mass_per_length * length)[:, None, None]
    every_axis = np.einsum("eij,ab->eiajb", weights, np.eye(dim))
    return _assemble(system, every_axis.reshape(cable.element_count, 4 * dim, 4 * dim))


def _cable_stiffness(system: System, state: State) -> csc_array:
    """Derivative of the elastic force by central differences: exact for either elastic model but for rounding."""
    cable = system.cable
    dim = len(cable.gravity)
    zero = (0.0,) * dim
    matrices = np.empty((cable.element_count, 4 * dim, 4 * dim))

    def force(length: float, vectors: FloatArray) -> FloatArray:
        d, a, b = (tuple(row.tolist()) for row in vectors.reshape(3, dim))
        return np.concatenate(elastic_force(cable, length, d, a, b, zero, zero, zero, 0.0, 0.0)[:3])

    for element, length in enumerate(cable.element_length.tolist()):
        # chord and slopes (d, l r_x(A), l r_x(B)) from the nodal coordinates of an element
        shape = np.kron(np.array([[-1.0, 0, 1, 0], [0, length, 0, 0], [0, 0, 0, length]]), np.eye(dim))
        vectors = np.concatenate(chord_and_slopes(state.nodes.position, element, cable))
        tangent = np.empty((3 * dim, 3 * dim))
        for column, change in enumerate(np.eye(3 * dim) * DIFFERENCE * length):
            both = force(length, vectors + change) - force(length, vectors - change)
            tangent[:, column] = both / (2.0 * DIFFERENCE * length)
        matrices[element] = shape.T @ tangent @ shape
    return _assemble(system, matrices)


def _tower_matrices(system: System, state: State) -> tuple[csc_array, csc_array]:
    """Stiffness of towers and buffers, the towers without friction, and mass of counterweights (nodes 2 dim square)."""
    state, work = clone_state(state), allocate_workspace(system)
    state.nodes.velocity[:] = 0.0
    smooth = system.towers._replace(friction=np.zeros_like(system.towers.friction))
    matrices = []
    for mass_factor, stiffness_factor in ((0.0, 1.0), (1.0, 0.0)):
        work.diagonal[:], work.upper[:], work.lower[:] = 0.0, 0.0, 0.0
        add_towers(system.cable, smooth, state, 0.0, stiffness_factor, work)
        add_counterweights(system.counterweights, system.cable, state, mass_factor, 0.0, stiffness_factor, work)
        matrices.append(_nodal_matrix(work))
    return matrices[0], matrices[1]


def _nodal_matrix(work: Workspace) -> csc_array:
    """The block-tridiagonal matrix of a workspace."""
    nodes, dim = work.diagonal.shape[0], round(work.diagonal.shape[3] ** 0.5)
    size = 2 * dim
    entries, rows, columns = [], [], []
    for blocks, down, right in ((work.diagonal, 0, 0), (work.upper, 0, 1), (work.lower, 1, 0)):
        square = blocks.reshape(-1, 2, 2, dim, dim).transpose(0, 1, 3, 2, 4).reshape(-1, size, size)
        first = size * np.arange(square.shape[0])[:, None, None]
        entries.append(square.ravel())
        rows.append((first + size * down + np.arange(size)[:, None] + np.zeros((1, size), np.int64)).ravel())
        columns.append((first + size * right + np.arange(size)[None, :] + np.zeros((size, 1), np.int64)).ravel())
    places = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(entries), places), shape=(nodes * size,) * 2).tocsc()


def _assemble(system: System, matrices: FloatArray) -> csc_array:
    """Sum of element matrices (elements, 4 dim, 4 dim) over the nodes."""
    size = 2 * len(system.cable.gravity)
    count = matrices.shape[0]
    places = size * np.arange(count)[:, None] + np.arange(2 * size)
    rows = np.repeat(places, 2 * size, axis=1)
    columns = np.tile(places, (1, 2 * size))
    shape = ((count + 1) * size,) * 2
    return coo_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsc()


def _body_directions(system: System, state: State) -> csc_array:
    """Derivative of all body coordinates (3 bodies) by nodal coordinates and pitches, joints held."""
    cable, carriages = system.cable, system.carriages
    dim = len(cable.gravity)
    nodal = (cable.element_count + 1) * 2 * dim
    entries: list[tuple[int, int, float]] = []
    for carriage in range(carriages.fixed.size):
        s = float(state.joints.position[carriage])
        element = int(element_at(cable, s))
        weights = shape_functions(s - cable.node_arc_length[element], cable.element_length[element])
        first = int(carriages.body_offset[carriage])
        for body in range(first, int(carriages.body_offset[carriage + 1])):
            for axis in range(2):
                for slot, weight in enumerate(weights):
                    column = (element + slot // 2) * 2 * dim + (slot % 2) * dim + axis
                    entries.append((3 * body + axis, column, weight))
            for above in range(first, body + 1):
                for axis, value in enumerate(_arm(system, state, body, above)[:2]):
                    entries.append((3 * body + axis, nodal + above, value))
            entries.append((3 * body + 2, nodal + body, 1.0))
    rows, columns, values = np.array(entries).T if entries else np.zeros((3, 0))
    shape = (3 * carriages.mass.size, nodal + carriages.mass.size)
    return coo_array((values, (rows.astype(np.int64), columns.astype(np.int64))), shape=shape).tocsc()


def _arm(system: System, state: State, body: int, above: int) -> tuple[float, float, float, float]:
    """First and second derivative (x, z, x, z) in m of the place of `body` by the pitch of `above` in its chain."""
    carriages = system.carriages
    pitch = float(state.bodies.position[above, 2])
    down = -carriages.upper_pivot[above]
    if above != body:
        down = down + carriages.lower_pivot[above]
    axes = np.reshape(orientation((0.0, 0.0, pitch), (0.0, 0.0)), (2, 2))
    arm = tuple((axes @ down).tolist())
    return *cross((1.0,), arm), -arm[0], -arm[1]


def _pitch_stiffness(system: System, state: State) -> csc_array:
    """Stiffness of the pitches against gravity, a diagonal matrix (bodies, bodies) in N m."""
    carriages, gravity = system.carriages, system.cable.gravity
    stiffness = np.zeros(carriages.mass.size)
    for carriage in range(carriages.fixed.size):
        chain = range(int(carriages.body_offset[carriage]), int(carriages.body_offset[carriage + 1]))
        for body in chain:
            for above in range(chain.start, body + 1):
                _, _, x, z = _arm(system, state, body, above)
                stiffness[above] -= carriages.mass[body] * (gravity[0] * x + gravity[-1] * z)
    return _diagonal(stiffness)


def _spring_stiffness(system: System, state: State) -> csc_array:
    """Stiffness of the springs of hinges, square over nodal coordinates and pitches: k ∂φ ∂φᵀ of each angle φ."""
    cable, carriages = system.cable, system.carriages
    nodal = (cable.element_count + 1) * 2 * len(cable.gravity)
    size = nodal + carriages.mass.size
    total = csc_array((size, size))
    for carriage in range(carriages.fixed.size):
        first = int(carriages.body_offset[carriage])
        for body in range(first, int(carriages.body_offset[carriage + 1])):
            turn = np.zeros(size)
            turn[nodal + body] = 1.0
            if body > first:
                turn[nodal + body - 1] = -1.0
            elif carriages.hinge_stiffness[body] > 0.0:
                columns, slope, bend = _turn_of_cable(system, state, carriage)
                turn[columns] -= slope
                total = total + coo_array(
                    (bend.ravel(), np.indices(bend.shape).reshape(2, -1) + columns[0]), total.shape
                )
            row = csc_array(turn[None])
            total = total + carriages.hinge_stiffness[body] * (row.T @ row)
    return total


def _turn_of_cable(system: System, state: State, carriage: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """How the cable turns at a joint.

    Returns:
        Nodal coordinates (4 dim,) of its element by number; the derivative (4 dim,) of its pitch by them; the second
        one (4 dim, 4 dim) times the moment there (N m).
    """
    cable, s = system.cable, float(state.joints.position[carriage])
    dim, element = len(cable.gravity), int(element_at(cable, s))
    shape_x = np.array(shape_functions_x(s - cable.node_arc_length[element], cable.element_length[element]))
    x, z = (shape_x @ state.nodes.position[element : element + 2].reshape(4, dim)).tolist()
    still = clone_state(state)
    still.nodes.velocity[:], still.joints.velocity[:], still.bodies.velocity[:] = 0.0, 0.0, 0.0
    still.joint_element[carriage] = element
    moment, _ = grip_moment(system, still, carriage)
    twice = np.reshape(moment_by_slope(moment, (x, z)), (dim, dim))
    bend = np.kron(np.outer(shape_x, shape_x), twice).astype(np.float64)
    turn = np.kron(shape_x, np.array(turn_by_slope((x, z))))
    return 2 * dim * element + np.arange(4 * dim), turn, bend
