"""Inertia and stiffness of carriages with held joints, by motion of the cable and angles of their hinges.

A body turns with what is above it, and by the angles that its joint leaves: D = D_above exp([a] α) exp([c] β), of the
axes as they are at rest. The cable turns what hangs on it by the shortest turn of its tangent. So nothing is held by
multipliers, and at an equilibrium the second derivative of the potential is the same for all such coordinates. That of
a body, whose pivots pull it with λ above and -λ below, is that of λ_below·(D l) - λ·(D u): from D to second order, with
l and u its arms. Everything is in space, a plane is that with y = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_twin.mechanics.language.orientations import orientation
from cable_twin.mechanics.language.turns import by_turn, moment_by_turn
from cable_twin.mechanics.parameters import FloatArray, IntArray, System
from cable_twin.mechanics.rope.point import element_at
from cable_twin.mechanics.rope.shape_functions import shape_functions, shape_functions_x
from cable_twin.mechanics.state import State

LATERAL = np.array([0.0, 1.0, 0.0])


class Hanging(NamedTuple):
    """Mass and stiffness of one carriage in n unknowns: nodal coordinates of its element, then its hinge angles."""

    places: IntArray  # (4 dim,) number of each of these nodal coordinates
    bodies: IntArray  # numbers of its bodies
    directions: FloatArray  # (bodies, 6, n) how each body moves and turns
    mass: FloatArray  # (n, n)
    stiffness: FloatArray  # (n, n)

    @property
    def angles(self) -> int:
        """Number of hinge angles of the carriage."""
        return self.mass.shape[0] - self.places.size


def hanging_carriages(system: System, state: State) -> list[Hanging]:
    """Mass and stiffness of all carriages on the cable, at an equilibrium."""
    return [_hanging(system, state, int(number)) for number in np.flatnonzero(state.attached)]


def _hanging(system: System, state: State, carriage: int) -> Hanging:
    """Unknowns, inertia and stiffness of one carriage."""
    cable, carriages = system.cable, system.carriages
    dim, s = len(cable.gravity), float(state.joints.position[carriage])
    element = int(element_at(cable, s))
    within = s - cable.node_arc_length[element], cable.element_length[element]
    lift = np.eye(3)[:, [0, 2]] if dim == 2 else np.eye(3)
    bodies = np.arange(carriages.body_offset[carriage], carriages.body_offset[carriage + 1])
    rotations = [_rotation(state, body, lift) for body in bodies]
    r_x = lift @ (np.array(shape_functions_x(*within)) @ state.nodes.position[element : element + 2].reshape(4, dim))
    norm = float(np.linalg.norm(r_x))
    hinges = _hinges(system, bodies, rotations, r_x / norm)

    size = 4 * dim + sum(len(axes) for axes, _ in hinges)
    place, along = np.zeros((3, size)), np.zeros((3, size))
    place[:, : 4 * dim] = np.kron(shape_functions(*within), lift)
    along[:, : 4 * dim] = np.kron(shape_functions_x(*within), lift) / norm
    turn = _crossed(r_x / norm) @ along
    turns, on_cable = [turn], np.zeros(3)
    mass, stiffness, directions = np.zeros((size, size)), np.zeros((size, size)), []
    forces = np.vstack([state.multipliers[bodies] @ lift.T, np.zeros(3)])
    column = 4 * dim
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
    return Hanging(2 * dim * element + np.arange(4 * dim), bodies, np.array(directions), mass, stiffness)


def _rotation(state: State, body: int, lift: FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) of a body."""
    dim = lift.shape[1]
    axes = np.reshape(orientation(state.bodies.position[body], (0.0,) * dim), (dim, dim))
    return axes if dim == 3 else lift @ axes @ lift.T + np.diag(LATERAL)


def _hinges(
    system: System, bodies: IntArray, rotations: list[FloatArray], tangent: FloatArray
) -> list[tuple[list[FloatArray], list[float]]]:
    """Rotation axes (3,) of the joint above each body, from above downwards, and their springs (N m/rad)."""
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
    """Second derivative (n, n) of a·(matrix b) in [a][b], by rotations (3, n) one after another."""
    before = np.zeros_like(turns[0])
    total = np.zeros((before.shape[1],) * 2)
    for turn in turns:
        total += before.T @ matrix @ turn + 0.5 * turn.T @ matrix @ turn
        before = before + turn
    return total + total.T


def _by_two_turns(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Matrix (3, 3) between a and b in F·(a x (b x arm))."""
    return np.reshape(moment_by_turn(tuple(arm), tuple(force)), (3, 3))


def _crossed(vector: FloatArray) -> FloatArray:
    """Matrix (3, 3) of v x ."""
    return -np.reshape(by_turn(tuple(vector)), (3, 3))


__all__ = ["Hanging", "hanging_carriages"]
