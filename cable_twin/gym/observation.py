"""Observation of an environment: named numbers and their places in a frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from math import inf
from typing import NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.scenario import Scenario


class Quantity(NamedTuple):
    """One number of an observation, with unit, place in a frame and bounds."""

    unit: str
    column: float  # of a frame, a whole number
    low: float = -inf
    high: float = inf


class Observed(Mapping[str, float]):
    """Observation with access by name: `after["cabin/speed"]`.

    Attributes:
        array: (n,) as the environment gives them.
    """

    __slots__ = ("_numbers", "array")

    def __init__(self, numbers: Mapping[str, int], array: FloatArray) -> None:
        self._numbers, self.array = numbers, array

    def __getitem__(self, name: str) -> float:
        return float(self.array[self._numbers[name]])

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


def quantities(scenario: Scenario, layout: Layout) -> dict[str, Quantity]:
    """All observable quantities of a scenario, by name; the cable is observed at its ends."""
    places = layout.columns(np.arange(layout.size, dtype=np.float64))
    length = scenario.cable.unstrained_length
    found = {"time": Quantity("s", 0, 0.0)}
    for row, name in enumerate(layout.vehicles):
        found |= {
            f"{name}/arc_length": Quantity("m", places.arc_length[row], 0.0, length),
            f"{name}/speed": Quantity("m/s", places.speed[row]),
            f"{name}/drive_force": Quantity("N", places.drive_force[row]),
            f"{name}/payload": Quantity("kg", places.payload[row], 0.0),
            f"{name}/attached": Quantity("-", places.attached[row], 0.0, 1.0),
            f"{name}/contact_force_x": Quantity("N", places.contact_force[row, 0]),
            f"{name}/contact_force_z": Quantity("N", places.contact_force[row, 2]),
        }
    for row, name in enumerate(layout.bodies):
        found |= {
            f"{name}/x": Quantity("m", places.body_position[row, 0]),
            f"{name}/z": Quantity("m", places.body_position[row, 2]),
            f"{name}/pitch": Quantity("rad", places.body_angles[row, 1]),
            f"{name}/pitch_rate": Quantity("rad/s", places.body_angular_velocity[row, 1]),
        }
    for row, name in enumerate(layout.drives):
        found |= {
            f"{name}/position": Quantity("m", places.drive_position[row]),
            f"{name}/speed": Quantity("m/s", places.drive_speed[row]),
            f"{name}/force": Quantity("N", places.moving_cable_force[row]),
        }
    of_carriages = [row for name, row in layout.vehicle_rows.items() if name in layout.commanded]
    told = [(row, "") for row in of_carriages] + [(row, "drive_") for row in range(len(layout.drives))]
    for name, (row, whose) in zip(layout.commanded, told, strict=True):
        found |= {
            f"{name}/{what}": Quantity(unit, getattr(places, f"{whose}{what}")[row])
            for what, unit in (
                ("commanded_speed", "m/s"),
                ("commanded_force", "N"),
                ("reference_position", "m"),
                ("reference_speed", "m/s"),
            )
        }
    for row, name in enumerate(layout.supports):
        found |= {
            f"{name}/force_x": Quantity("N", places.support_force[row, 0]),
            f"{name}/force_z": Quantity("N", places.support_force[row, 2]),
            f"{name}/travel": Quantity("m", places.support_travel[row]),
            f"{name}/load": Quantity("N", places.tower_load[row], 0.0),
        }
    for row, name in enumerate(layout.sheaves):
        found |= {
            f"{name}/tension_on": Quantity("N", places.sheave_tension[row, 0]),
            f"{name}/tension_off": Quantity("N", places.sheave_tension[row, 1]),
            f"{name}/slip": Quantity("m", places.sheave_slip[row]),
            f"{name}/travel": Quantity("m", places.sheave_travel[row]),
        }
    for name, sample in layout.end_samples.items():
        found[f"{name}/tension"] = Quantity("N", places.rope_tension[sample])
    return found


def by_default(layout: Layout) -> tuple[str, ...]:
    """Default quantities: motion of driven objects, and pitch of the bodies of carriages, with their rates."""
    return (
        *(f"{name}/{what}" for name in layout.drives for what in ("position", "speed")),
        *(f"{name}/{what}" for name in layout.carriages for what in ("arc_length", "speed")),
        *(
            f"{name}/{body}/{what}"
            for name in layout.carriages
            for body in layout.vehicles[name]
            for what in ("pitch", "pitch_rate")
        ),
    )


def chosen(known: Mapping[str, Quantity], patterns: Sequence[str], start: Snapshot) -> dict[str, Quantity]:
    """Quantities with names that match the patterns (`*` for any text), in the order of the patterns.

    Raises:
        ValueError: a pattern fits nothing that this scenario has.
    """
    has = {name: one for name, one in known.items() if np.isfinite(start.numbers[int(one.column)])}
    found: dict[str, Quantity] = {}
    for pattern in patterns:
        fitting = {name: one for name, one in has.items() if fnmatchcase(name, pattern)}
        if not fitting:
            raise ValueError(f"observations: {pattern!r} given; allowed, with * for any text: {', '.join(has)}")
        found |= {name: one for name, one in fitting.items() if name not in found}
    if not found:
        raise ValueError(f"observations: none given; allowed, with * for any text: {', '.join(has)}")
    return found


__all__ = ["Observed", "Quantity", "by_default", "chosen", "quantities"]
