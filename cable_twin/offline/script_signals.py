"""Test signals of a script for the identification of a drive: step and chirp, as sequences of commands.

Both come on top of the speed or force of their entry, which holds again afterwards. A step lasts for its duration. A
chirp is a sine of this amplitude whose frequency goes from one to the other by equal factors in equal times,

    f(t) = f_0 k^(t / T),  k = f_1 / f_0,  phase(t) = 2 pi f_0 T (k^(t / T) - 1) / ln k,

held from command to command, 20 of them in the shortest period.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

SHAPES = ("step", "chirp")
KEYS = (*SHAPES, "duration", "from", "to")
SAMPLES = 20  # commands in the shortest period of a chirp
HIGHEST = 10.0  # Hz
MOST = 100_000  # commands of one chirp
ALLOWED = (
    "allowed with a time, a name and a speed or force: step and duration (s), or chirp, duration (s), from and to "
    "(Hz); step and chirp have the unit of the speed or force"
)


def signal_values(
    row: Mapping[str, Any], base: float, finite: Callable[[Any, str, str], float], unit: str
) -> list[tuple[float, float]]:
    """Times (s, relative to the entry) and values of a step or chirp, ending with the base value.

    Args:
        row: the entry; it has one of `KEYS`.
        base: its speed or force.
        finite: checks that a value is a finite number, given its key and unit.
        unit: of the base.

    Raises:
        ValueError: it is no such signal; the line has what is allowed.
    """
    shapes = [shape for shape in SHAPES if shape in row]
    given = {key for key in KEYS if key in row}
    if "at" in row or len(shapes) != 1 or given != ({"step", "duration"} if "step" in row else {*KEYS} - {"step"}):
        what = ", ".join(f"{key} {row[key]!r}" for key in ("at", *KEYS) if key in row)
        raise ValueError(f"{what} given; {ALLOWED}")
    height, duration = finite(row[shapes[0]], shapes[0], unit), finite(row["duration"], "duration", "s")
    if duration <= 0.0:
        raise ValueError(f"duration {duration:g} s given; allowed: more than 0 s")
    if "step" in row:
        return [(0.0, base), (0.0, base + height), (duration, base)]
    first, last = finite(row["from"], "from", "Hz"), finite(row["to"], "to", "Hz")
    for key, frequency in (("from", first), ("to", last)):
        if not 0.0 < frequency <= HIGHEST:
            raise ValueError(f"{key} {frequency:g} Hz given; allowed: more than 0, up to {HIGHEST:g} Hz")
    count = math.ceil(duration * SAMPLES * max(first, last))
    if count > MOST:
        raise ValueError(f"a chirp of {count} commands given; allowed: {MOST}, {SAMPLES} in the shortest period")
    times = [duration * number / count for number in range(count)]
    values = [base + height * math.sin(_phase(time, duration, first, last)) for time in times]
    return [*zip(times, values, strict=True), (duration, base)]


def _phase(time: float, duration: float, first: float, last: float) -> float:
    """Phase (rad) of a chirp of `duration` (s) from one frequency (Hz) to another at a time (s)."""
    growth = math.log(last / first)
    if abs(growth) < 1e-9:
        return 2.0 * math.pi * first * time
    return 2.0 * math.pi * first * duration * math.expm1(growth * time / duration) / growth


__all__ = ["KEYS", "SHAPES", "signal_values"]
