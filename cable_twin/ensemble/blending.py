"""Weighted sums of the states of ensemble members, by which a filter applies its corrections to the fast motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_twin.ensemble.members import MemberStates
from cable_twin.mechanics.on_rope.chain import hang_together, top_of
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.mechanics.state import State

OWN = ("payload", "wind", "temperature", "clock", "newton_ratio", "deflection")  # in names of what is not blended
TOPOLOGY = (
    "joint_node",
    "joint_element",
    "node_load",
    "node_follows",
    "attached",
    "vehicle_rope",
    "mode",
    "axis",
    "braking",
)


class Turn(NamedTuple):
    """Rotation (angle and rate) of one body of a vehicle, which changes the swing of an ensemble member."""

    vehicle: int  # row
    body: int  # row of all bodies
    axis: int  # 1 pitch; in space also 0 roll
    angle: float  # rad
    rate: float  # rad/s


def are_alike(states: MemberStates) -> bool:
    """Whether members have each vehicle in the same rope element, and each drive in the same mode."""
    return all(
        bool((block[name] == block[name][0]).all())
        for block in (states.block, states.motions)
        for name in block.dtype.names
        if name.endswith(TOPOLOGY)
    )


def blend(states: MemberStates, weights: FloatArray) -> None:
    """Replace the state of each member by a weighted sum of the states of all members, calculated at equal payloads.

    Payloads, wind, temperature and friction stay those of the member. As bodies rotate, joints of the summed states are
    open to second order: they are closed here, else the first step would close them with forces beyond any drive's.

    Args:
        states: of members that `are_alike`.
        weights: (members, members), each row with the sum 1.
    """
    payloads = states.block["payload"].copy()
    _put_in(states, np.broadcast_to(payloads[0], payloads.shape))  # centres of mass are then equal points of bodies
    tops = np.array([_tops(states, member) for member in range(states.size)])
    for block in (states.block, states.motions):
        _sum_up(block, weights)
    for member, own in enumerate(tops[0] + np.tensordot(weights, tops - tops[0], 1)):
        _hang(states, member, own)
    _put_in(states, payloads)


def _sum_up(block: Any, weights: FloatArray) -> None:
    """Replace the blended arrays of each member in a block of states by weighted sums over all members."""
    for name in block.dtype.names:
        if block[name].dtype != np.float64 or any(word in name for word in OWN):
            continue
        rows = block[name].reshape(len(weights), -1)
        if np.array_equal(rows, np.broadcast_to(rows[0], rows.shape), equal_nan=True):
            continue
        with np.errstate(invalid="ignore"):  # inf less inf
            apart = rows - rows[0]
        moved = rows[0] + weights @ np.where(np.isfinite(apart), apart, 0.0)
        block[name][...] = np.where(np.isfinite(rows), moved, rows).reshape(block[name].shape)


def turn(states: MemberStates, member: int, turns: Sequence[Turn]) -> None:
    """Rotate bodies of a member, and close the joints of their vehicles below the joint with the rope."""
    simulation = states.enter(member)
    part = simulation.engine.parts[0]
    for row in dict.fromkeys(one.vehicle for one in turns):
        place, velocity = top_of(part.system.carriages, part.state, row)
        for one in turns:
            if one.vehicle == row:
                _turn_body(part.state, place.size, one)
        hang_together(part.system.carriages, part.state, row, place, velocity)
    states.leave(member, simulation)


def _turn_body(state: State, dim: int, one: Turn) -> None:
    """Rotate a body of a vehicle in place, which violates the constraints of its joints until they are closed again."""
    place, velocity = state.bodies.position[one.body, dim:], state.bodies.velocity[one.body, dim:]
    if dim == 2:
        place += one.angle
        velocity += one.rate
        return
    vector, before, scalar = np.zeros(3), place.copy(), np.cos(0.5 * one.angle)
    vector[one.axis] = np.sin(0.5 * one.angle)
    place[:3] = scalar * before[:3] + before[3] * vector + np.cross(vector, before[:3])
    place[3] = scalar * before[3] - vector @ before[:3]
    velocity[one.axis] += one.rate


def _tops(states: MemberStates, member: int) -> list[tuple[FloatArray, FloatArray]]:
    """Position and velocity of the upper pivot of each vehicle of a member."""
    part = states.enter(member).engine.parts[0]
    return [top_of(part.system.carriages, part.state, row) for row in states.base.layout.vehicle_rows.values()]


def _hang(states: MemberStates, member: int, tops: FloatArray) -> None:
    """Close the joints of all vehicles of a member below their upper pivots (vehicles, 2, dim)."""
    simulation = states.enter(member)
    part = simulation.engine.parts[0]
    for row, (place, velocity) in zip(states.base.layout.vehicle_rows.values(), tops, strict=True):
        hang_together(part.system.carriages, part.state, row, place, velocity)
    states.leave(member, simulation)


def _put_in(states: MemberStates, payloads: FloatArray) -> None:
    """Set the payloads (members, vehicles) in kg of all members."""
    names = [*states.base.layout.vehicles]
    for member in range(states.size):
        present = states.block["payload"][member]
        changed = {
            name: float(load)
            for name, load, before in zip(names, payloads[member], present, strict=True)
            if load != before
        }
        if changed:
            simulation = states.enter(member)
            simulation.engine.vehicles.put_in(changed)
            states.leave(member, simulation)


__all__ = ["Turn", "are_alike", "blend", "turn"]
