"""Carriages that stand: a share of their rolling friction holds them that nobody knows, until they move."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.ensemble.estimate.quantities import SLOW, Reading
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario

HELD = 0.8  # of rolling friction, standard deviation: in plant and twin it holds anything from -1 to 1 of it


class Standing:
    """Errors of drive forces by the rolling friction of carriages that stand after they have been stirred.

    Who boards makes the rope give, and rollers take up as much of the weight as friction lets them: in `aerial_tramway`
    600 N, as 260 kg do, which vibration lets go within a minute. Once they roll it is known which way friction acts.

    Attributes:
        errors: (sensors,) standard deviations (N) of drive forces now, 0 of others.
        held: standard deviations (N) of drive forces, by sensor, while carriages stand that were stirred.

    Args:
        scenario: with carriages and sensors.
        readings: of the sensors, by name.
        layout: of frames.
    """

    def __init__(self, scenario: Scenario, readings: Mapping[str, Reading], layout: Layout) -> None:
        grips = {}
        for name, one in scenario.carriages.items():
            mass = sum(body.mass for body in one.bodies.values()) + (0.5 * one.payload.capacity if one.payload else 0.0)
            grips[name] = one.friction.rolling * mass * scenario.gravity
        every = float(np.linalg.norm([*grips.values()]))  # on one haul rope
        forces = {name: scenario.sensors[name].of for name in readings if scenario.sensors[name].kind == "drive_force"}
        self.held = {name: HELD * grips.get(of, every) for name, of in forces.items()}
        self._held = np.array([self.held.get(name, 0.0) for name in readings])
        self._forces, self._speeds = forces, layout.places.speed
        self.errors = np.zeros(len(readings))

    @property
    def rows(self) -> list[int]:
        """Rows of the sensors of drive forces."""
        return np.flatnonzero(self._held).tolist()

    def doubts(self, sensor: str) -> bool:
        """Whether a sensor is that of a drive whose carriages stand and were stirred: no waves pass under them."""
        return sensor in self._forces and bool(self.errors.any())

    def stir(self) -> None:
        """Doubt forces from now on, as carriages that stand are stirred."""
        self.errors = self._held

    def rolls(self, numbers: FloatArray) -> bool:
        """Whether carriages roll that were stirred while they stood, by the values (n,) of a frame; ends the doubt."""
        if not self.errors.any() or not self.moves(numbers):
            return False
        self.errors = np.zeros_like(self._held)
        return True

    def moves(self, numbers: FloatArray) -> bool:
        """Whether any carriage rolls, by the values (n,) of a frame."""
        return bool((np.abs(numbers[self._speeds]) > SLOW).any())

    def tells(self, sensor: str, numbers: FloatArray) -> bool:
        """Whether a measurement at the values (n,) of a frame is without that error: no drive force of a stand."""
        return sensor not in self._forces or self.moves(numbers)
