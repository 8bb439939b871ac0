"""Swing of vehicles as fast quantities of a filter: angle and rate of each body, each perturbed in one member."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_twin.ensemble.blending import Turn
from cable_twin.frame.sensors import ANGLES
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray

SIZE = 0.01  # rad and rad/s, by which a member differs from the middle one
PRIOR = 2e-3  # rad and rad/s, standard deviation at the start, where a plant stands
ANY_SWING = 0.02  # the same under way
GROWTH = 2e-4  # rad/s after a second, standard deviation: by the error of the model
STIRRED = 2.6e-3  # the same by waves of a stop
AT_TOWER = 1.5e-2  # the same while a vehicle passes a tower, where meshes differ most
FIRST = 1.5  # times as much for the first body of a vehicle, which rides the rope
ROLL, PITCH = ANGLES["roll"], ANGLES["pitch"]


class Swing(NamedTuple):
    """Swing of a vehicle's body as a quantity of a filter: its angle, or its rate."""

    vehicle: int  # row
    body: int  # row of all bodies
    axis: int  # roll or pitch
    rate: bool
    place: int  # in the numbers of a frame

    def turn(self, size: float) -> Turn:
        """Rotation of the body by a size of this swing (rad or rad/s)."""
        return Turn(self.vehicle, self.body, self.axis, 0.0 if self.rate else size, size if self.rate else 0.0)


def swings(layout: Layout) -> tuple[Swing, ...]:
    """Swings of all bodies of carriages, angle and rate: pitch, and in space roll as well.

    With several ropes, whose members are costly, only those of the second body, or of an only one: all that hangs from
    the carriage on the rope rotates as a whole.
    """
    places, found, alone = layout.places, [], len(layout.ropes) == 1
    for vehicle, name in enumerate(layout.carriages):
        bodies = range(layout.first_body[vehicle], layout.first_body[vehicle] + len(layout.vehicles[name]))
        for body in bodies if alone else bodies[:2][-1:]:
            for axis in (PITCH, ROLL) if layout.space else (PITCH,):
                for rate in (False, True):
                    column = (places.body_angular_velocity if rate else places.body_angles)[body, axis]
                    found.append(Swing(vehicle, body, axis, rate, int(column)))
    return tuple(found)


def carried(fast: Sequence[Swing], numbers: FloatArray, first: int) -> FloatArray:
    """Transition matrix (n, n) of n swings, from the unit swings given to members initially to their present swings.

    Args:
        fast: n swings.
        numbers: (members, m) of the present frames.
        first: member with the first swing; the members with the other swings follow.
    """
    places = [one.place for one in fast]
    apart: FloatArray = (numbers[first : first + len(fast)][:, places] - numbers[0, places]) / SIZE
    return apart.T


def growth(fast: Sequence[Swing], seconds: float, stirred: float, at_tower: bool) -> FloatArray:
    """Variances (n,) that swings gain in some seconds by the error of the model.

    Args:
        fast: n swings.
        seconds: s.
        stirred: remaining share of the waves that a passed tower has excited.
        at_tower: whether a vehicle is passing a tower.
    """
    rate = (AT_TOWER**2 if at_tower else GROWTH**2 + (stirred * STIRRED) ** 2) * seconds
    firsts = {one.vehicle: one.body for one in reversed(fast)}
    return np.array(
        [(FIRST**2 if one.body == firsts[one.vehicle] else 1.0) * (1.0 if one.rate else 0.25) * rate for one in fast]
    )


def anchored(fast: Sequence[Swing], numbers: FloatArray, member: int) -> list[Turn]:
    """Rotations that give a member the swing of the middle member."""
    return [one.turn(float(numbers[0, one.place] - numbers[member, one.place])) for one in fast]
