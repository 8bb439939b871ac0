"""Text of numbers for engineers: readable unit, four digits, no exponent; a module without imports of the package."""

from __future__ import annotations

import math
from collections.abc import Mapping

LARGER: Mapping[str, tuple[tuple[float, str, float], ...]] = {  # from a size on, another unit, and its size
    "N": ((1e3, "kN", 1e3),),
    "N m": ((1e6, "MN m", 1e6), (1e3, "kN m", 1e3)),
    "W": ((1e6, "MW", 1e6), (1e3, "kW", 1e3)),
    "J": ((1e6, "MJ", 1e6), (1e3, "kJ", 1e3)),
    "kg": ((1e4, "t", 1e3),),
}
NORMAL_95 = 1.959964  # standard deviations between the mean of a normal distribution and an end of its middle 95 %
MOST_DECIMALS = 6  # of an estimate
PLAIN = -4, 7  # powers of ten between which a number has no exponent


def shown_unit(unit: str, size: float) -> tuple[str, float]:
    """Readable unit for an SI value of magnitude `size`, and the factor from the SI unit to it."""
    if unit == "rad":
        return "deg", 180.0 / math.pi
    for least, larger, one in LARGER.get(unit, ()):
        if abs(size) >= least:
            return larger, 1.0 / one
    return unit, 1.0


def rounded(value: float, digits: int = 4) -> str:
    """Text of a value with a number of significant digits, without an exponent from 0.0001 to 10 million."""
    short = f"{value:.{digits}g}"
    plain = float(short)
    power = math.floor(math.log10(abs(plain))) if plain and math.isfinite(plain) else 0
    if not PLAIN[0] <= power < PLAIN[1]:
        return short
    text = f"{plain:.{max(digits - 1 - power, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def decimals(band: float) -> int:
    """Number of decimals, at most `MOST_DECIMALS`, with which a band has two digits."""
    return min(max(1 - math.floor(math.log10(band)), 0), MOST_DECIMALS) if band > 0.0 else MOST_DECIMALS


def with_band(value: float, deviation: float, unit: str) -> str:
    """Text of an SI value with a standard deviation, and its band of 95 %, in a readable unit."""
    shown, scale = shown_unit(unit, value)
    band = NORMAL_95 * deviation * scale
    text = f"{value * scale + 0.0:.{decimals(band)}f} ± {band:.{decimals(band)}f}"
    return text if shown in ("", "-") else f"{text} {shown}"


def counted(count: int, noun: str) -> str:
    """Text of a count with its noun, which gets an s but for 1."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def with_unit(value: float, unit: str, digits: int = 4) -> str:
    """Text of an SI value in a readable unit."""
    shown, scale = shown_unit(unit, value)
    return f"{rounded(value * scale, digits)} {shown}" if shown not in ("", "-") else rounded(value * scale, digits)
