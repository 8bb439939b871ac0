"""What is gathered of vehicles and drives from snapshot to snapshot, and the figures that it makes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cable_twin.key_figures.extremes import Extremes
from cable_twin.key_figures.figure import KeyFigure, figure_of, with_limit
from cable_twin.records import CableSamples, FloatArray, Place, Snapshot
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Limits


class DriveExtremes:
    """Speed, force and power of several drives."""

    def __init__(self, count: int) -> None:
        self.speed, self._force = Extremes(count), Extremes(count)
        self._power, self._braking_power = Extremes(count), Extremes(count, -1.0)

    def update(self, time: float, places: FloatArray, speeds: FloatArray, forces: FloatArray) -> None:
        """Take in places (n,) in m, speeds in m/s and forces in N of all drives at a time (s)."""
        power = forces * speeds
        self.speed.update(np.abs(speeds), time, places)
        self._force.update(np.abs(forces), time, places)
        self._power.update(power, time, places)
        self._braking_power.update(power, time, places)

    def figures(
        self, name: str, index: int, limits: Limits, source: str, at: str = "arc length"
    ) -> Iterator[KeyFigure]:
        """Figures of one drive against its limits; `source` is where those are, `at` what its place is called."""
        speed = figure_of(self.speed, index, f"{name}: speed", "m/s", at)
        yield with_limit(speed, limits.speed, f"{source}.speed")
        force = figure_of(self._force, index, f"{name}: drive force", "N", at)
        yield with_limit(force, limits.force, f"{source}.force")
        highest = figure_of(self._power, index, f"{name}: drive power, highest", "W", at)
        yield with_limit(highest, limits.power, f"{source}.power")
        lowest = figure_of(self._braking_power, index, f"{name}: drive power, lowest", "W", at)
        yield with_limit(lowest, None if limits.power is None else -limits.power, f"{source}.power", "at least")


class Vehicles:
    """What is gathered of all vehicles, an entry each; those off the cable do not count.

    Nor do forces and accelerations of a carrier on the first and the last element of a moving cable: the end of the
    model is a point, and a mass that moves over it a singular load, where a ropeway has the rails of a station.
    """

    def __init__(self, scenario: Scenario) -> None:
        cable, self._names = scenario.cable, list(scenario.vehicles)
        clamped = np.array([vehicle.joint == "clamped" for vehicle in scenario.vehicles.values()])
        self._rails = np.where(clamped, cable.unstrained_length / cable.elements, -math.inf)  # m from either end
        self._length = cable.unstrained_length
        count = len(self._names)
        self.drive = DriveExtremes(count)
        self.swing, self.acceleration, self.contact_force = Extremes(count), Extremes(count), Extremes(count)
        self.tension_ratio, self.clearance = Extremes(count, -1.0), Extremes(count, -1.0)
        self._passed: list[tuple[float, FloatArray]] = []  # time, places of the last bodies (count, 2), two frames

    def forget(self) -> None:
        """The state was put back to the start: nothing before it is a part of the motion."""
        self._passed = []

    def update(self, snapshot: Snapshot) -> None:
        """Take in one snapshot."""
        if not self._names:
            return
        time, cable = snapshot.time, snapshot.cable
        states = [snapshot.carriages[name] for name in self._names]
        bodies = [list(state.bodies.values())[-1] for state in states]
        rows = np.array(
            [
                (
                    state.arc_length,
                    state.speed,
                    state.drive_force,
                    state.contact_force[0],
                    state.contact_force[-1],
                    body.x,
                    body.z,
                    body.pitch,
                )
                for state, body in zip(states, bodies, strict=True)
            ]
        )
        rows[[not state.attached for state in states]] = math.nan
        places, speeds, drive_forces, force_x, force_z, body_x, body_z, pitches = rows.T
        self.drive.update(time, places, speeds, drive_forces)
        on_rails = np.minimum(places, self._length - places) < self._rails
        for signal in (force_x, force_z, body_x, body_z):
            signal[on_rails] = math.nan
        self.contact_force.update(np.hypot(force_x, force_z), time, places)
        self.swing.update(np.abs(pitches), time, places)
        self.tension_ratio.update(_tension_ratios(cable, places, force_x, force_z), time, places)
        self._accelerate(time, np.column_stack([body_x, body_z]), places)

    def _accelerate(self, time: float, bodies: FloatArray, places: FloatArray) -> None:
        """Second difference of the places of the last bodies over three frames of equal spacing."""
        if len(self._passed) == 2:
            (first_time, first), (middle_time, middle) = self._passed
            period = time - middle_time
            if period > 0.0 and abs(middle_time - first_time - period) < 1e-6 * period:
                across = bodies - 2.0 * middle + first
                self.acceleration.update(np.hypot(across[:, 0], across[:, 1]) / period**2, middle_time, places)
        self._passed = [*self._passed[-1:], (time, bodies)]

    def update_clearance(self, time: float, found: Mapping[str, Place]) -> None:
        """Take in the heights of vehicles over the terrain at a time (s)."""
        places = [found.get(name) for name in self._names]
        heights = [math.nan if place is None else place.height for place in places]
        self.clearance.update(heights, time, np.array([math.nan if place is None else place.x for place in places]))

    def figure(
        self, extremes: Extremes, members: Sequence[int], name: str, unit: str, at: str = "arc length"
    ) -> KeyFigure:
        """Figure of the worst of some vehicles, which is named where there are several."""
        worst = extremes.worst(list(members))
        figure = figure_of(extremes, worst, name, unit, at)
        return figure if len(members) == 1 else replace(figure, place=f"{self._names[worst]}, {figure.place}")


def _tension_ratios(cable: CableSamples, places: FloatArray, force_x: FloatArray, force_z: FloatArray) -> FloatArray:
    """Tension over the part of a force (N) across the rope, at arc lengths (n,) in m; NaN without any."""
    x, z, last = cable.positions[:, 0], cable.positions[:, -1], len(cable.arc_lengths) - 1
    after = np.clip(np.searchsorted(cable.arc_lengths, places), 1, last)
    # beside the kink at the joint, from the sample before to the one after
    before, beyond = after - 1, np.minimum(after + 1, last)
    along_x, along_z = x[beyond] - x[before], z[beyond] - z[before]
    across = np.abs(along_x * force_z - along_z * force_x) / np.hypot(along_x, along_z)
    tensions = np.interp(places, cable.arc_lengths, cable.tensions)
    return np.divide(tensions, across, out=np.full(len(places), math.nan), where=across > 0.0)


__all__ = ["DriveExtremes", "Vehicles"]
