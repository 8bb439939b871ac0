"""Digits of key figures in text, so many that a value that passes its limit differs from it."""

from __future__ import annotations

from cable_twin.basics.units import rounded
from cable_twin.key_figures.figure import KeyFigure

DIGITS, MOST_DIGITS = 4, 9  # of values and limits, and where a value that passes its limit would look like it
NOISE = 1e-6  # in the printed unit: below it, a rounding error


def digits_of(figure: KeyFigure, scale: float) -> int:
    """Significant digits of a key figure and its limit, so many that a value that passes its limit differs from it."""
    digits = DIGITS
    if figure.limit is not None and figure.kept is not True:
        while digits < MOST_DIGITS and shown(figure.value, scale, digits) == rounded(figure.limit * scale, digits):
            digits += 1
    return digits


def shown(value: float, scale: float, digits: int = DIGITS) -> str:
    """Text of an SI value, scaled to its shown unit; a value within rounding error is shown as 0."""
    return "0" if abs(value * scale) < NOISE else rounded(value * scale, digits)
