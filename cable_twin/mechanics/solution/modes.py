"""Natural frequencies and mode shapes of a rope about its equilibrium, every joint held at its arc length.

Over towers the cable slides without friction; counterweights move.

A held joint leaves a vehicle only the angles of its hinges. So the unknowns are the free nodal coordinates and these
angles, without multipliers, and K x = ω² M x is symmetric. A body turns with the body above it, and by the angles of
its joint: D = D_above exp([a] α) exp([c] β), of the axes as they are at rest. The cable turns its vehicles by the
shortest rotation of its tangent. At an equilibrium the second derivative of the potential is equal for all such
coordinates. That of a body, whose pivots pull it with λ above and -λ below, is that of λ_below·(D l) - λ·(D u): from D
to second order, with l and u its arms. Everything is in space, a plane is that with y = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import eigsh

from cable_twin.mechanics.language.declared import clone
from cable_twin.mechanics.language.rotations import by_turn, moment_by_turn, orientation
from cable_twin.mechanics.on_rope.counterweight import add_counterweights
from cable_twin.mechanics.on_rope.presence import vehicles_of
from cable_twin.mechanics.on_rope.tower import add_towers
from cable_twin.mechanics.parameters import FloatArray, IntArray, System
from cable_twin.mechanics.rope.ale import rest_length, rest_stretch
from cable_twin.mechanics.rope.elastic_models import chord_and_slopes, elastic_force
from cable_twin.mechanics.rope.patch import at_node
from cable_twin.mechanics.rope.patch_assembly import begin_patches
from cable_twin.mechanics.rope.point import element_at
from cable_twin.mechanics.rope.shape_functions import MASS, shape_functions, shape_functions_x
from cable_twin.mechanics.state import State, Workspace, allocate_workspace

DENSE_LIMIT = 400  # unknowns up to which all frequencies are computed at once
DIFFERENCE = 1e-6  # of an element's length, for the derivative of the elastic force


def natural_modes(system: System, state: State, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest natural frequencies and mode shapes of one rope with its vehicles.

    Args:
        system: parameters.
        state: an equilibrium, with the forces in its joints; velocities in it are ignored.
        count: how many.

    Returns:
        Frequencies (count,) in Hz, rising; shapes (count, nodes, 3, dim) of the nodal coordinates, largest entry 1.

    Raises:
        ValueError: when the system has fewer modes than `count`, or fewer than one is asked for.
    """
    free, carriages = _free_directions(system, state), hanging_carriages(system, state)
    nodal, angles = free.shape[0], sum(carriage.angles for carriage in carriages)
    unknowns = free.shape[1] + angles
    if not 1 <= count <= unknowns:
        raise ValueError(f"number of natural frequencies: given {count}; allowed: 1 to {unknowns} of this cable")
    basis = _block_diagonal(free, _diagonal(np.ones(angles)))

    support_stiffness, counterweight_mass = _tower_matrices(system, state)
    nothing = csc_array((angles, angles))
    mass = _block_diagonal(rest_stretch(system.cable, state) * _cable_mass(system, state) + counterweight_mass, nothing)
    stiffness = _block_diagonal(_cable_stiffness(system, state) + support_stiffness, nothing)
    for carriage, places in zip(carriages, _places(carriages, nodal), strict=True):
        rows, columns = np.repeat(places, places.size), np.tile(places, places.size)
        mass = mass + coo_array((carriage.mass.ravel(), (rows, columns)), mass.shape)
        stiffness = stiffness + coo_array((carriage.stiffness.ravel(), (rows, columns)), mass.shape)
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
    shapes = (basis @ vectors[:, order])[:nodal].T.reshape(count, -1, 3, len(system.cable.gravity))
    largest = np.take_along_axis(
        shapes.reshape(count, -1), np.abs(shapes.reshape(count, -1)).argmax(axis=1)[:, None], axis=1
    )
    largest[largest == 0.0] = 1.0
    return np.sqrt(np.maximum(squared[order], 0.0)) / (2.0 * np.pi), shapes / largest[:, :, None, None]


def _places(carriages: list[Hanging], nodal: int) -> list[IntArray]:
    """Indices of each vehicle's unknowns among all unknowns: nodal coordinates, then hinge angles."""
    last = nodal + np.cumsum([carriage.angles for carriage in carriages], dtype=np.int64)
    return [
        np.concatenate([carriage.places, np.arange(end - carriage.angles, end)])
        for carriage, end in zip(carriages, last, strict=True)
    ]


def _diagonal(values: FloatArray) -> csc_array:
    """Sparse diagonal matrix, possibly without rows."""
    return coo_array((values, (np.arange(values.size),) * 2), shape=(values.size,) * 2).tocsc()


def _block_diagonal(a: csc_array, b: csc_array) -> csc_array:
    """Sparse block-diagonal matrix of two matrices, each possibly without rows."""
    a, b = coo_array(a), coo_array(b)
    rows = np.concatenate([a.row, b.row + a.shape[0]])
    columns = np.concatenate([a.col, b.col + a.shape[1]])
    shape = (a.shape[0] + b.shape[0], a.shape[1] + b.shape[1])
    return coo_array((np.concatenate([a.data, b.data]), (rows, columns)), shape=shape).tocsc()


def _free_directions(system: System, state: State) -> csc_array:
    """Sparse basis (nodes 3 dim, free) of the nodal coordinates that the supports leave free.

    Both slopes of a node are one, but where it follows a load.
    """
    cable, dim = system.cable, len(system.cable.gravity)
    entries: list[tuple[int, int, float]] = []
    count = 0
    for node in range(cable.element_count + 1):
        end = {0: 0, cable.element_count: 1}.get(node)
        at_load = state.node_load[node] >= 0
        for slot, rows in ((0, (0,)), (1, (1,)), (2, (2,))) if at_load else ((0, (0,)), (1, (1, 2))):
            axes = np.eye(dim)
            if end is not None:
                values, vectors = np.linalg.eigh(cable.end_projector[end, slot].reshape(dim, dim))
                axes = vectors[:, values > 0.5].T
            for vector in axes:
                for row in rows:
                    entries += [((3 * node + row) * dim + axis, count, float(vector[axis])) for axis in range(dim)]
                count += 1
    places, columns, directions = zip(*entries, strict=True)
    size = 3 * dim * (cable.element_count + 1)
    return coo_array((np.array(directions), (np.array(places), np.array(columns))), shape=(size, count)).tocsc()


def _cable_mass(system: System, state: State) -> csc_array:
    """Sparse mass matrix (nodes 3 dim, nodes 3 dim) of the cable (eq. 5, 6)."""
    cable = system.cable
    length, dim = state.mesh.length, len(cable.gravity)
    scale = np.stack([np.ones_like(length), length, np.ones_like(length), length], axis=1)
    weights = np.array(MASS) * scale[:, :, None] * scale[:, None, :] * (cable.mass_per_length * length)[:, None, None]
    every_axis = np.einsum("eij,ab->eiajb", weights, np.eye(dim))
    return _assemble(system, every_axis.reshape(cable.element_count, 4 * dim, 4 * dim))


def _cable_stiffness(system: System, state: State) -> csc_array:
    """Stiffness matrix of the cable by differences of its elastic force: exact for either model but for rounding."""
    cable, dim = system.cable, len(system.cable.gravity)
    zero = (0.0,) * dim
    matrices = np.empty((cable.element_count, 4 * dim, 4 * dim))

    def force(at_rest: float, vectors: FloatArray) -> FloatArray:
        d, a, b = (tuple(row.tolist()) for row in vectors.reshape(3, dim))
        return np.concatenate(elastic_force(cable, at_rest, d, a, b, zero, zero, zero, 0.0, 0.0)[:3])

    for element, length in enumerate(state.mesh.length.tolist()):
        # chord and slopes (d, l r_x(A), l r_x(B)) from the nodal coordinates of an element
        shape = np.kron(np.array([[-1.0, 0, 1, 0], [0, length, 0, 0], [0, 0, 0, length]]), np.eye(dim))
        vectors = np.concatenate(chord_and_slopes(state.nodes.position, element, cable, state))
        tangent, at_rest = np.empty((3 * dim, 3 * dim)), rest_length(cable, state, element)
        for column, change in enumerate(np.eye(3 * dim) * DIFFERENCE * length):
            both = force(at_rest, vectors + change) - force(at_rest, vectors - change)
            tangent[:, column] = both / (2.0 * DIFFERENCE * length)
        matrices[element] = shape.T @ tangent @ shape
    return _assemble(system, matrices)


def _tower_matrices(system: System, state: State) -> tuple[csc_array, csc_array]:
    """Stiffness of frictionless towers and buffers, and mass of counterweights (nodes 3 dim square)."""
    state, work = clone(state), allocate_workspace(system)
    state.nodes.velocity[:] = 0.0
    smooth = system.towers._replace(friction=np.zeros_like(system.towers.friction))
    matrices = []
    for mass_factor, stiffness_factor in ((0.0, 1.0), (1.0, 0.0)):
        work.diagonal[:], work.upper[:], work.lower[:] = 0.0, 0.0, 0.0
        if system.cable.load_nodes:
            begin_patches(state, work)
        add_towers(system.cable, smooth, state, 0.0, stiffness_factor, work)
        add_counterweights(system.counterweights, system.cable, state, mass_factor, 0.0, stiffness_factor, work)
        matrices.append(_nodal_matrix(work) + _patch_matrix(state, work))
    return matrices[0], matrices[1]


def _nodal_matrix(work: Workspace) -> csc_array:
    """Sparse matrix from the node blocks (block-tridiagonal) in a workspace."""
    nodes, dim = work.diagonal.shape[0], round(work.diagonal.shape[3] ** 0.5)
    size, step = 2 * dim, 3 * dim  # of the equations of a node, and from one to the next one
    entries, rows, columns = [], [], []
    for blocks, down, right in ((work.diagonal, 0, 0), (work.upper, 0, 1), (work.lower, 1, 0)):
        square = blocks.reshape(-1, 2, 2, dim, dim).transpose(0, 1, 3, 2, 4).reshape(-1, size, size)
        first = step * np.arange(square.shape[0])[:, None, None]
        entries.append(square.ravel())
        rows.append((first + step * down + np.arange(size)[:, None] + np.zeros((1, size), np.int64)).ravel())
        columns.append((first + step * right + np.arange(size)[None, :] + np.zeros((size, 1), np.int64)).ravel())
    places = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(entries), places), shape=(nodes * step,) * 2).tocsc()


def _patch_matrix(state: State, work: Workspace) -> csc_array:
    """Sparse matrix of the elements beside loads at held arc lengths (nodes 3 dim square)."""
    size, dim = state.nodes.position.size, state.nodes.position.shape[2]
    matrix = csc_array((size, size))
    for node in np.flatnonzero(state.node_load >= 0).tolist():
        own, first = np.arange(3 * dim), 3 * dim * (node - 1)
        places = np.concatenate([first + own[: 2 * dim], first + 3 * dim + np.arange(6 * dim)])
        kept = np.concatenate([np.arange(5 * dim), 5 * dim + 1 + own])
        entries = work.patch[state.node_load[node]][np.ix_(kept, kept)]
        matrix = matrix + coo_array(
            (entries.ravel(), (np.repeat(places, kept.size), np.tile(places, kept.size))), shape=(size, size)
        )
    return matrix


def _assemble(system: System, matrices: FloatArray) -> csc_array:
    """Assemble element matrices (elements, 4 dim, 4 dim) to a sparse matrix of all nodes."""
    dim, count = len(system.cable.gravity), matrices.shape[0]
    places = 3 * dim * np.arange(count)[:, None] + _of_element(dim)
    rows = np.repeat(places, 4 * dim, axis=1)
    columns = np.tile(places, (1, 4 * dim))
    shape = ((count + 1) * 3 * dim,) * 2
    return coo_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsc()


def _of_element(dim: int) -> IntArray:
    """Indices (4 dim,) of the first element's coordinates: r and slope after node A, r and slope before node B."""
    return np.concatenate([row * dim + np.arange(dim) for row in (0, 2, 3, 4)])


LATERAL = np.array([0.0, 1.0, 0.0])


class Hanging(NamedTuple):
    """Mass and stiffness of one vehicle in n unknowns: nodal coordinates of its element, then its hinge angles."""

    places: IntArray  # number of each of these nodal coordinates
    bodies: IntArray  # numbers of its bodies
    directions: FloatArray  # (bodies, 6, n) how each body moves and turns
    mass: FloatArray  # (n, n)
    stiffness: FloatArray  # (n, n)

    @property
    def angles(self) -> int:
        """Number of hinge angles of the vehicle."""
        return self.mass.shape[0] - self.places.size


def hanging_carriages(system: System, state: State) -> list[Hanging]:
    """Mass and stiffness of all vehicles on the cable, at an equilibrium."""
    riding = state.attached & vehicles_of(system, state)
    return [_hanging(system, state, int(number)) for number in np.flatnonzero(riding)]


def _hanging(system: System, state: State, carriage: int) -> Hanging:
    """Unknowns, mass and stiffness of one vehicle on the cable, at an equilibrium."""
    cable, carriages = system.cable, system.carriages
    dim, s = len(cable.gravity), float(state.joints.position[carriage])
    lift = np.eye(3)[:, [0, 2]] if dim == 2 else np.eye(3)
    if at_node(cable, state, carriage):
        places = 3 * dim * int(state.joint_node[carriage]) + np.arange(3 * dim)
        shape, shape_x = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.5])
    else:
        element = int(element_at(cable, state, s))
        within = s - state.mesh.arc_length[element], state.mesh.length[element]
        places = 3 * dim * element + _of_element(dim)
        shape, shape_x = np.array(shape_functions(*within)), np.array(shape_functions_x(*within))
    bodies = np.arange(carriages.body_offset[carriage], carriages.body_offset[carriage + 1])
    rotations = [_rotation(state, body, lift) for body in bodies]
    r_x = lift @ (shape_x @ state.nodes.position.ravel()[places].reshape(-1, dim))
    norm = float(np.linalg.norm(r_x))
    hinges = _hinges(system, bodies, rotations, r_x / norm)

    size = places.size + sum(len(axes) for axes, _ in hinges)
    place, along = np.zeros((3, size)), np.zeros((3, size))
    place[:, : places.size] = np.kron(shape, lift)
    along[:, : places.size] = np.kron(shape_x, lift) / norm
    turn = _crossed(r_x / norm) @ along
    turns, on_cable = [turn], np.zeros(3)
    mass, stiffness, directions = np.zeros((size, size)), np.zeros((size, size)), []
    forces = np.vstack([state.multipliers[bodies] @ lift.T, np.zeros(3)])
    column = places.size
    for number, (body, rotation, (axes, springs)) in enumerate(zip(bodies, rotations, hinges, strict=True)):
        for axis, spring in zip(axes, springs, strict=True):
            turns.append(np.zeros((3, size)))
            turns[-1][:, column] = axis
            stiffness[column, column] += spring
            column += 1
        up, low = (rotation @ lift @ pivots[body] for pivots in (carriages.upper_pivot, carriages.lower_pivot))
        force, below = forces[number], forces[number + 1]
        stiffness += _by_turns(turns, _by_two_turns(low, below) - _by_two_turns(up, force))
        on_cable += np.cross(low, below) - np.cross(up, force)
        turn = sum(turns[1:], start=turns[0])
        place = place + _crossed(up) @ turn
        directions.append(np.vstack([place, turn]))
        inertia = np.diag(carriages.inertia[body] * LATERAL) if dim == 2 else carriages.inertia[body].reshape(3, 3)
        mass += carriages.mass[body] * place.T @ place + turn.T @ rotation @ inertia @ rotation.T @ turn
        place = place - _crossed(low) @ turn
    # the shortest turn of the tangent to second order: t x δ - (t x δ) (t·δ), with δ = δr_x / |r_x|
    across, stretch = np.cross(on_cable, r_x / norm) @ along, r_x / norm @ along
    stiffness -= np.outer(across, stretch) + np.outer(stretch, across)
    return Hanging(places, bodies, np.array(directions), mass, stiffness)


def _rotation(state: State, body: int, lift: FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) of a body, also of one in a plane."""
    dim = lift.shape[1]
    axes = np.reshape(orientation(state.bodies.position[body], (0.0,) * dim), (dim, dim))
    return axes if dim == 3 else lift @ axes @ lift.T + np.diag(LATERAL)


def _hinges(
    system: System, bodies: IntArray, rotations: list[FloatArray], tangent: FloatArray
) -> list[tuple[list[FloatArray], list[float]]]:
    """Rotation axes (3,) and springs (N m/rad) of the joint above each body of a vehicle, from above downwards."""
    found: list[tuple[list[FloatArray], list[float]]] = []
    for number, body in enumerate(bodies):
        spring = float(system.carriages.hinge_stiffness[body])
        if len(system.cable.gravity) == 2:
            found.append(([LATERAL], [spring]))
        elif number == 0:  # roll about the cable, pitch about its own lateral axis
            found.append(([tangent, rotations[0][:, 1]], [0.0, spring]))
        elif system.carriages.held[body] > 1:
            found.append(([rotations[number - 1][:, 1]], [spring]))
        else:
            found.append(([rotations[number - 1][:, 1], rotations[number][:, 0]], [spring, 0.0]))
    return found


def _by_turns(turns: list[FloatArray], matrix: FloatArray) -> FloatArray:
    """Second derivative (n, n) of F·(D arm) of a body turned by rotations (3, n) one after another."""
    before = np.zeros_like(turns[0])
    total = np.zeros((before.shape[1],) * 2)
    for turn in turns:
        total += before.T @ matrix @ turn + 0.5 * turn.T @ matrix @ turn
        before = before + turn
    return total + total.T


def _by_two_turns(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Matrix (3, 3) of the bilinear form F·(a x (b x arm)) in two rotations a and b."""
    return np.reshape(moment_by_turn(tuple(arm), tuple(force)), (3, 3))


def _crossed(vector: FloatArray) -> FloatArray:
    """Matrix (3, 3) of the cross product v x with a vector v."""
    return -np.reshape(by_turn(tuple(vector)), (3, 3))
