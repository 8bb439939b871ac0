"""Measurements of a window between two corrections, and faults of the plant that they show."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.special

from cable_twin.ensemble.estimate.detectors.counterweights import Stuck, stuck_counterweight
from cable_twin.ensemble.estimate.detectors.sensor_faults import fault_of_drive, negative
from cable_twin.ensemble.estimate.kalman import Belief, Terms, normalised_square
from cable_twin.ensemble.estimate.quantities import NEAR, Reading
from cable_twin.ensemble.estimate.scatter import excuse
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario

SURE = 1e-6  # probability at which a sensor contradicts the others
SEEN, ALIKE = 3.0, 0.5  # times the noise, that a value has to be, and share of it by which its negative may be wrong


class Row(NamedTuple):
    """Measurement of a sensor with the predictions of all ensemble members."""

    sensor: str
    value: float
    predicted: FloatArray  # (members,)
    variance: float
    numbers: FloatArray  # (members, n) of the frames of that time


def passes_a_tower(places: FloatArray, towers: FloatArray) -> bool:
    """Whether a carriage is so near to a tower that members differ in more than first order; places (m) of both."""
    return bool((np.abs(places[:, None] - towers) < NEAR).any())


def excused(rows: list[Row], linear: Callable[[list[Row]], Terms], belief: Belief) -> list[Row]:
    """Rows of one sensor, with more variance where waves within the window alone keep it from contradicting."""
    terms = linear(rows) if rows else None
    if not terms or normalised_square(*terms, belief.covariance) < scipy.special.chdtri(len(rows), SURE):
        return rows
    return [row._replace(variance=row.variance + excuse(terms[0], terms[2])) for row in rows]


def stuck_by(scenario: Scenario, of: Mapping[str, Sequence[Row]], held: Container[str]) -> Stuck:
    """Counterweight that is stuck, by the rows of each sensor in a window; `held` as of `stuck_counterweight`."""
    sensors = scenario.sensors
    cells = {sensors[name].of: rows for name, rows in of.items() if rows and sensors[name].kind == "load_cell"}
    apart = {name: _apart(rows) for name, rows in cells.items()}
    sure = {name: apart[name] / float(np.sqrt(rows[0].variance / len(rows))) for name, rows in cells.items()}
    return stuck_counterweight(scenario, apart, sure, held)


def fault_of(scenario: Scenario, readings: Mapping[str, Reading], rows: Sequence[Row]) -> str:
    """Message about a fault of a sensor or its drive that explains its rows; empty for none."""
    return _wrong_sign(readings, rows) or _drive_at_fault(scenario, readings, rows)


def _drive_at_fault(scenario: Scenario, readings: Mapping[str, Reading], rows: Sequence[Row]) -> str:
    """Message about a drive whose force is not the predicted one, by its sensor's rows; empty for none."""
    if not rows or (sensor := scenario.sensors[rows[0].sensor]).kind != "drive_force":
        return ""
    got, wanted = (float(np.mean(of)) for of in zip(*((row.value, row.predicted[0]) for row in rows), strict=True))
    return fault_of_drive(readings[rows[0].sensor], sensor.of, got, wanted)


def _wrong_sign(readings: Mapping[str, Reading], rows: Sequence[Row]) -> str:
    """Message about a sensor that reads the negative of what is expected, by its rows; empty for none."""
    if not rows or (reading := readings[rows[0].sensor]).places.size > 1:
        return ""
    got, wanted = (np.array(of) for of in zip(*((row.value, row.predicted[0]) for row in rows), strict=True))
    size = float(np.sqrt(np.mean(wanted**2)))
    if size < SEEN * reading.noise or float(np.sqrt(np.mean((got + wanted) ** 2))) > ALIKE * size:
        return ""
    return negative(reading)


def contradiction(readings: Mapping[str, Reading], of: Mapping[str, Sequence[Row]]) -> dict[str, float]:
    """Variances of what is hidden, by unit, where the plant is not as the model: as far as sensors are from it."""
    found: dict[str, float] = {}
    for name, rows in of.items():
        unit = readings[name].unit
        found[unit] = max(found.get(unit, 0.0), _apart(rows) ** 2 if rows else 0.0)
    return found


def _apart(rows: Sequence[Row]) -> float:
    """Mean measured less predicted value of one sensor."""
    return float(np.mean([row.value - row.predicted[0] for row in rows]))


__all__ = ["SURE", "Row", "contradiction", "excused", "fault_of", "passes_a_tower", "stuck_by"]
