"""Zeros of encoders: what a carriage that is elsewhere than its encoder says would do to all other sensors.

The twin is where the encoder says, so that the encoder itself tells nothing. For each there is one member whose
carriage is some way from that of the estimate: how much its sensors differ is what an encoder with another zero would
do to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.ensemble.estimate.detectors.windows import Row
from cable_twin.ensemble.estimate.quantities import PLACE_ERROR, Reading
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario

ZERO = 3.0  # m, by which the zero of an encoder may be elsewhere than that of the scenario, a standard deviation
AWAY, LEAST = 0.1, 0.02  # m, from the carriage of the estimate to that of its member, and below which it tells nothing


class Displaced:
    """Members whose carriages are some way from those of the estimate, one for each carriage with an encoder.

    With several ropes there are none: there carriages are moved by haul ropes, and members are costly.

    Attributes:
        encoders: carriages by the names of their encoders.

    Args:
        scenario: of the twin, with the sensors of the plant.
        first: member with the first of them; the others follow.
        layout: of the frames of the members.
    """

    def __init__(self, scenario: Scenario, first: int, layout: Layout) -> None:
        alone = len(scenario.cables) == 1
        of = {name: one.of for name, one in scenario.sensors.items() if one.kind == "encoder" and alone}
        self.encoders = {name: carriage for name, carriage in of.items() if carriage in scenario.carriages}
        self._scenario, self._first = scenario, first
        columns = layout.places.arc_length
        self._places = [int(columns[layout.vehicle_rows[carriage]]) for carriage in self.encoders.values()]

    def __len__(self) -> int:
        return len(self.encoders)

    @property
    def members(self) -> range:
        """Numbers of the ensemble members whose carriages are displaced."""
        return range(self._first, self._first + len(self))

    def places(self, motion: Mapping[str, Any]) -> dict[str, list[float]]:
        """Places (m) of carriages at rest for each ensemble member, by scenario key; displaced in one for each encoder.

        Args:
            motion: of the twin, by key, as of `values_at`.
        """
        found = {}
        for member, name in zip(self.members, self.encoders.values(), strict=True):
            one, key = self._scenario.carriages[name], f"carriages.{name}.arc_length"
            place, rope = motion.get(key, one.arc_length), self._scenario.cables[self._scenario.rope_of(one)]
            found[key] = [place] * (self._first + len(self))
            found[key][member] += AWAY if place < 0.5 * rope.unstrained_length else -AWAY
        return found

    def along(self, weights: FloatArray) -> FloatArray:
        """Weights of all ensemble members, by (members, members) weights of those whose carriages are not displaced."""
        size = self._first
        found = np.eye(size + len(self))
        found[:size, :size] = weights
        found[size:, :size] = weights[0]
        found[size:, 0] -= 1.0
        return found

    def effects(self, rows: Sequence[Row]) -> dict[str, FloatArray]:
        """Change of each measurement (k,) of a window by 1 m of error in the zero of an encoder, by the encoder's name.

        That of the encoder's own measurement by itself is left out. Ropes wave otherwise in the member that is
        elsewhere, as after people have boarded, which is no effect of its place: the mean of each sensor counts.
        """
        found, sensors = {}, np.array([row.sensor for row in rows])
        for member, place, name in zip(self.members, self._places, self.encoders, strict=True):
            away = np.array([row.numbers[member, place] - row.numbers[0, place] for row in rows])
            more = np.array([row.predicted[member] - row.predicted[0] for row in rows])
            found[name] = -np.divide(more, away, out=np.zeros_like(more), where=np.abs(away) > LEAST)
            for sensor in {*sensors.tolist()}:
                found[name][sensors == sensor] = found[name][sensors == sensor].mean()
        return found


def with_zero(reading: Reading, size: float, deviation: float) -> tuple[Reading, str]:
    """Reading of an encoder that is found to read a size (m) too much, and the message about it.

    Args:
        reading: until now.
        size: m.
        deviation: m, of the size by the sensors; that of a twin beside its plant comes on top.
    """
    by, band = with_unit(abs(size), "m", 3), with_unit(float(np.hypot(deviation, PLACE_ERROR)), "m", 2)
    return reading._replace(offset=reading.offset + size), (
        f"sensor {reading.name} reads {by} too {'much' if size > 0.0 else 'little'}, standard deviation {band}: its "
        "zero is not that of the arc length. It is taken with that offset"
    )


__all__ = ["ZERO", "Displaced", "with_zero"]
