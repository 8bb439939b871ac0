"""Quantities of a frame by name, unit and column, for the observations of environments and ensembles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import inf
from typing import NamedTuple

import numpy as np

from cable_twin.frame.layout import DERAILED, Layout
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.scenario import Scenario
from cable_twin.scenario.checks.fault import listed

NEAR, LIKE = 3, 0.5  # most names that a message proposes, and how like a wrong one they are, from 0 to 1


class Quantity(NamedTuple):
    """Observable quantity of the twin: unit, index in the row of a frame, and bounds.

    Of several indices the quantity is the largest absolute value.
    """

    unit: str
    column: float | FloatArray  # whole numbers
    low: float = -inf
    high: float = inf


class Reader:
    """Reader of quantities from rows of frames.

    Args:
        seen: the n quantities.
    """

    def __init__(self, seen: Iterable[Quantity]) -> None:
        columns = [np.atleast_1d(one.column).astype(np.intp) for one in seen]
        self._first = np.array([one[0] for one in columns], dtype=np.intp)
        self._several = [(number, one) for number, one in enumerate(columns) if one.size > 1]

    def read(self, numbers: FloatArray) -> FloatArray:
        """Values (..., n) of the quantities in rows (..., size) of frames."""
        found: FloatArray = numbers[..., self._first]
        for number, columns in self._several:
            found[..., number] = np.fmax.reduce(np.abs(numbers[..., columns]), axis=-1)
        return found


def quantities(scenario: Scenario, layout: Layout) -> dict[str, Quantity]:
    """All observable quantities of a scenario, by name; ropes are observed at their ends."""
    columns = layout.columns(np.arange(layout.size, dtype=np.float64))
    length = max(rope.unstrained_length for rope in scenario.cables.values())
    found = {"time": Quantity("s", 0, 0.0)}
    for row, name in enumerate(layout.vehicles):
        found |= {
            f"{name}/arc_length": Quantity("m", columns.arc_length[row], 0.0, length),
            f"{name}/speed": Quantity("m/s", columns.speed[row]),
            f"{name}/drive_force": Quantity("N", columns.drive_force[row]),
            f"{name}/payload": Quantity("kg", columns.payload[row], 0.0),
            f"{name}/attached": Quantity("-", columns.attached[row], 0.0, 1.0),
            f"{name}/contact_force_x": Quantity("N", columns.contact_force[row, 0]),
            f"{name}/contact_force_z": Quantity("N", columns.contact_force[row, 2]),
        }
    for row, name in enumerate(layout.bodies):
        found |= {
            f"{name}/x": Quantity("m", columns.body_position[row, 0]),
            f"{name}/z": Quantity("m", columns.body_position[row, 2]),
            f"{name}/pitch": Quantity("rad", columns.body_angles[row, 1]),
            f"{name}/pitch_rate": Quantity("rad/s", columns.body_angular_velocity[row, 1]),
        }
    if hanging := _hanging(layout):
        found |= {
            "carriers/largest_pitch": Quantity("rad", columns.body_angles[hanging, 1], 0.0),
            "carriers/largest_pitch_rate": Quantity("rad/s", columns.body_angular_velocity[hanging, 1], 0.0),
        }
    for row, name in enumerate(layout.drives):
        found |= {
            f"{name}/position": Quantity("m", columns.drive_position[row]),
            f"{name}/speed": Quantity("m/s", columns.drive_speed[row]),
            f"{name}/force": Quantity("N", columns.moving_cable_force[row]),
        }
    of_carriages = [row for name, row in layout.vehicle_rows.items() if name in layout.commanded]
    commanded = [(row, "") for row in of_carriages] + [(row, "drive_") for row in range(len(layout.drives))]
    for name, (row, prefix) in zip(layout.commanded, commanded, strict=True):
        found |= {
            f"{name}/{signal}": Quantity(unit, getattr(columns, f"{prefix}{signal}")[row])
            for signal, unit in (
                ("commanded_speed", "m/s"),
                ("commanded_force", "N"),
                ("reference_position", "m"),
                ("reference_speed", "m/s"),
            )
        }
    for row, name in enumerate(layout.supports):
        found |= {
            f"{name}/force_x": Quantity("N", columns.support_force[row, 0]),
            f"{name}/force_z": Quantity("N", columns.support_force[row, 2]),
            f"{name}/travel": Quantity("m", columns.support_travel[row]),
            f"{name}/load": Quantity("N", columns.tower_load[row], 0.0),
        }
    for row, name in enumerate(layout.sheaves):
        found |= {
            f"{name}/tension_on": Quantity("N", columns.sheave_tension[row, 0]),
            f"{name}/tension_off": Quantity("N", columns.sheave_tension[row, 1]),
            f"{name}/slip": Quantity("m", columns.sheave_slip[row]),
            f"{name}/travel": Quantity("m", columns.sheave_travel[row]),
        }
    for name, sample in layout.end_samples.items():
        found[f"{name}/tension"] = Quantity("N", columns.rope_tension[sample])
    return found | _across(layout, columns) if layout.space else found


def _across(layout: Layout, columns: Columns) -> dict[str, Quantity]:
    """Observable quantities of a scenario in space that one in a plane does not have, by name.

    Args:
        layout: of its frames.
        columns: with the index of each value in the row of a frame.
    """
    found = {f"wind/{axis}": Quantity("m/s", columns.wind[row]) for row, axis in enumerate("xyz")}
    for row, name in enumerate(layout.vehicles):
        found[f"{name}/contact_force_y"] = Quantity("N", columns.contact_force[row, 1])
    for row, name in enumerate(layout.bodies):
        found[f"{name}/y"] = Quantity("m", columns.body_position[row, 1])
        for axis, angle in ((0, "roll"), (2, "yaw")):
            found[f"{name}/{angle}"] = Quantity("rad", columns.body_angles[row, axis])
            found[f"{name}/{angle}_rate"] = Quantity("rad/s", columns.body_angular_velocity[row, axis])
    if hanging := _hanging(layout):
        found["carriers/largest_roll"] = Quantity("rad", columns.body_angles[hanging, 0], 0.0)
        found["carriers/largest_roll_rate"] = Quantity("rad/s", columns.body_angular_velocity[hanging, 0], 0.0)
    for row, name in enumerate(layout.supports):
        found |= {
            f"{name}/force_y": Quantity("N", columns.support_force[row, 1]),
            f"{name}/lateral_force": Quantity("N", columns.tower_lateral[row]),
            f"{name}/highest_lateral_ratio": Quantity("-", columns.tower_lateral_ratio[row], 0.0),
            f"{name}/derailed": Quantity("-", columns.tower_derailed[row], 0.0, len(DERAILED) - 1.0),
        }
    return found


def _hanging(layout: Layout) -> list[int]:
    """Numbers of the bodies of all carriers."""
    return [row for row, name in enumerate(layout.bodies) if name.partition("/")[0] in layout.carriers]


def by_default(scenario: Scenario, layout: Layout) -> tuple[str, ...]:
    """Names of the default observations.

    Of drives place, speed, force and the tensions at their bullwheels; of carriers the largest pitch and pitch rate; of
    carriages place, speed, and pitch and pitch rate of each body. In space of all these roll and roll rate, too, and
    the wind along and across the track.
    """
    bullwheels = [one.sheave for one in scenario.drives.values() if one.sheave]
    swings = [f"{angle}{rate}" for angle in ("pitch", "roll")[: 1 + layout.space] for rate in ("", "_rate")]
    return (
        *(f"{name}/{signal}" for name in layout.drives for signal in ("position", "speed", "force")),
        *(f"{name}/{signal}" for name in bullwheels for signal in ("tension_on", "tension_off")),
        *(f"carriers/largest_{signal}" for signal in swings if layout.carriers),
        *(f"{name}/{signal}" for name in layout.carriages for signal in ("arc_length", "speed")),
        *(
            f"{name}/{body}/{signal}"
            for name in layout.carriages
            for body in layout.vehicles[name]
            for signal in swings
        ),
        *(("wind/x", "wind/y") if layout.space else ()),
    )


def chosen(known: Mapping[str, Quantity], patterns: str | Sequence[str], start: Snapshot) -> dict[str, Quantity]:
    """Observable quantities whose names match a pattern or several (`*` for any text), in the order of the patterns.

    Raises:
        ValueError: a pattern matches no quantity of this scenario.
    """
    there = np.isfinite(Reader(known.values()).read(start.numbers))
    has = {name: one for (name, one), is_there in zip(known.items(), there.tolist(), strict=True) if is_there}
    found: dict[str, Quantity] = {}
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        fitting = {name: one for name, one in has.items() if fnmatchcase(name, pattern)}
        if not fitting:
            raise ValueError(f"observations: given {pattern!r}; {_allowed(pattern, has)}")
        found |= {name: one for name, one in fitting.items() if name not in found}
    if not found:
        raise ValueError(f"observations: given none; {_allowed('', has)}")
    return found


def _allowed(pattern: str, names: Iterable[str]) -> str:
    """Text of a message about a pattern without a match: names or patterns like it, else what has observations."""
    names = [*names]
    owners = [f"{owner}/*" for owner in dict.fromkeys(name.rpartition("/")[0] for name in names) if owner]
    near = get_close_matches(pattern, [*names, *owners], n=NEAR, cutoff=LIKE)
    if near:
        return f"did you mean {', '.join(map(repr, near))}?"
    return f"allowed, with * for any text: {listed([*owners, *names], 'nothing')}"
