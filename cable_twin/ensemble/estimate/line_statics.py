"""Static effects of payloads, friction and ice on tower forces and drive forces of a line with carriers.

A weight between two supports rests on both by the law of the lever, as a counterweight keeps the tension constant. Its
component along the rope is carried by all that is farther from the tensioned end: by the drive, and by towers as far as
the line bends there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.system import tower_friction

Place = tuple[float, float]  # m, along the track and up


class _Tower(NamedTuple):
    """Tower of a rope with its friction and the places of the supports before and after it."""

    rope: int
    before: Place  # of the support with the lesser place along the track
    place: Place
    after: Place
    friction: float

    @property
    def bend(self) -> float:
        """Angle (rad) by which the line from support to support bends downwards over the tower."""
        (x0, z0), (x1, z1), (x2, z2) = self.before, self.place, self.after
        return float(np.arctan2(z1 - z0, x1 - x0) - np.arctan2(z2 - z1, x2 - x1))

    @property
    def half_spans(self) -> float:
        """Length (m) of rope that rests on the tower: half of both spans."""
        (x0, z0), (x1, z1), (x2, z2) = self.before, self.place, self.after
        return float(0.5 * (np.hypot(x1 - x0, z1 - z0) + np.hypot(x2 - x1, z2 - z1)))


class Carried(NamedTuple):
    """Static effects of payloads, friction and ice on one sensor's value."""

    payloads: FloatArray  # (carriers,) N/kg
    friction: float  # N, of the friction of all towers as a share of that of the scenario
    ice: float  # N m/kg, of ice on all ropes


class LineStatics:
    """Static effects of payloads, friction and ice on the towers and drives of a line with carriers.

    Attributes:
        towers: names of the towers of all ropes.

    Args:
        scenario: with carriers.
        start: snapshot of the scenario at its start.
    """

    def __init__(self, scenario: Scenario, start: Snapshot) -> None:
        layout = start.layout
        self._gravity = scenario.gravity
        self._rows = np.array([layout.vehicle_rows[name] for name in layout.carriers])
        self._supports = layout.support_rows
        self._drives = layout.drive_rows
        self._towers: dict[str, _Tower] = {}
        self._profiles: list[list[Place]] = []
        for row, rope in enumerate(scenario.cables):
            self._add(scenario, rope, row)
        self.towers = tuple(self._towers)

    def _add(self, scenario: Scenario, rope: str, row: int) -> None:
        """Add the towers and the profile of a rope."""
        alone: Any = scenario.of_rope(rope)
        ends = scenario.end_names(rope)
        named = [(ends[0], alone.cable.start), *alone.towers.items(), (ends[1], alone.cable.end)]
        places = [(float(one.position[0]), float(one.position[-1])) for _, one in named]
        for number, (name, one) in enumerate(named[1:-1], start=1):
            before, after = sorted((places[number - 1], places[number + 1]))
            friction = tower_friction(one)
            if name in self._supports:
                self._towers[name] = _Tower(row, before, places[number], after, friction)
        self._profiles.append(places)

    def clear(self, tower: str, snapshot: Snapshot, near: float) -> bool:
        """Whether no carrier is within a distance (m) along the track from a tower."""
        one = self._towers[tower]
        here, places = self._on(one.rope, snapshot)
        return bool((np.abs(places[here, 0] - one.place[0]) > near).all())

    def of_tower(self, name: str, snapshot: Snapshot) -> Carried:
        """Static effects of payloads, friction and ice on the force of a tower."""
        one = self._towers[name]
        here, places = self._on(one.rope, snapshot)
        force = snapshot.columns.support_force[self._supports[name]]
        upright = abs(float(force[2])) / max(float(np.linalg.norm(force)), 1.0)
        along, x, z = places[:, 0], *one.place
        share = np.interp(along, [one.before[0], x, one.after[0]], [0.0, 1.0, 0.0])
        profile = self._profiles[one.rope]
        below = (places[:, 2] < z) * np.abs(_slopes(along, profile)) * one.bend
        lowest = min(place[1] for place in profile)
        return Carried(
            payloads=here * self._gravity * (share * upright + below),
            friction=0.0,
            ice=self._gravity * (one.half_spans * upright + (z - lowest) * one.bend),
        )

    def of_drive(self, name: str, snapshot: Snapshot) -> Carried:
        """Static effects on the force of a drive: weights along the rope, and friction of all towers by their loads."""
        payloads, friction, ice = np.zeros(self._rows.size), 0.0, 0.0
        for rope, profile in enumerate(self._profiles):
            here, places = self._on(rope, snapshot)
            rising = 1.0 if profile[-1][1] > profile[0][1] else -1.0
            payloads += here * rising * self._gravity * np.abs(_slopes(places[:, 0], profile))
        sense = float(np.sign(snapshot.columns.drive_speed[self._drives[name]]))
        loads = np.linalg.norm(snapshot.columns.support_force, axis=1)
        for tower, one in self._towers.items():
            own = self.of_tower(tower, snapshot)
            payloads += sense * one.friction * own.payloads
            ice += sense * one.friction * own.ice
            friction += sense * one.friction * float(loads[self._supports[tower]])
        return Carried(payloads, friction, ice)

    def _on(self, rope: int, snapshot: Snapshot) -> tuple[FloatArray, FloatArray]:
        """Mask (carriers,) of the carriers on a rope, and positions (carriers, 3) in m of all carriers."""
        columns = snapshot.columns
        here = (columns.vehicle_rope[self._rows] == rope) & (columns.attached[self._rows] == 1.0)
        return here, columns.joint_position[self._rows]


def _slopes(along: FloatArray, profile: Sequence[Place]) -> FloatArray:
    """Sines (n,) of the slope of a line through supports (its profile) at places (m) along the track."""
    places = sorted(profile)
    spans = np.diff(np.array(places), axis=0)
    number = np.clip(np.searchsorted([place[0] for place in places], along) - 1, 0, len(spans) - 1)
    slopes: FloatArray = spans[number, 1] / np.hypot(spans[number, 0], spans[number, 1])
    return slopes
