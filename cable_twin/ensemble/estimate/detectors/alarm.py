"""Alarm about a plant or its sensors, and how it says a value."""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.basics.units import with_unit


class Alarm(NamedTuple):
    """Alarm about the plant or a sensor: time and reason."""

    time: float  # s
    reason: str
    of_payload: bool = False  # of which a lift has many, as people come


def with_deviation(value: float, deviation: float, unit: str) -> str:
    """Text of an estimate and its standard deviation, both in SI units, in readable units."""
    return f"{with_unit(value, unit)}, standard deviation {with_unit(deviation, unit, 2)}"
