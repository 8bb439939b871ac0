"""Rates (Hz) of topic groups, published and logged, and frame counts between due frames; imports no other module."""

from __future__ import annotations

import math
from collections.abc import Mapping

EVERY_FRAME = 0.0  # Hz, of a group that is due at every frame
ONCE = 1e-6  # Hz, of one that nobody takes but with the first frame
PUBLISHED: Mapping[str, float] = {"path": 10.0, "markers": 10.0}  # Hz, of groups that are not published every frame
# Hz, the same of logs
LOGGED: Mapping[str, float] = {
    "poses": 20.0,
    "forces": 20.0,
    "rope": 10.0,
    "path": 1.0,
    "transforms": 10.0,
    "markers": 1.0,
}

MOST_FRAMES = 1e9  # from one that is due to the next: a run has fewer
ROUNDING = 1e-5  # of a rate that somebody types with six digits, as messages have them


def frames_between(frame_rate: float, rate: float) -> int:
    """Count of frames from one due frame to the next at a rate (Hz) or just below it; 1 for every frame."""
    if rate == EVERY_FRAME or rate >= frame_rate:
        return 1
    count = frame_rate / rate
    nearest = round(count)
    return nearest if math.isclose(count, nearest, rel_tol=ROUNDING) else math.ceil(count)


def divides(frame_rate: float, rate: float) -> bool:
    """Whether a rate (Hz) divides the frame rate exactly: every frame, or one in a whole number of frames."""
    if rate == EVERY_FRAME:
        return True
    if rate * MOST_FRAMES < frame_rate:
        return False
    return math.isclose(frames_between(frame_rate, rate) * rate, frame_rate, rel_tol=ROUNDING)


def fault(called: str, rate: float, frame_rate: float) -> str | None:
    """Error line about a rate (Hz), named `called`, that does not divide the frame rate; None for a valid rate."""
    if divides(frame_rate, rate):
        return None
    return (
        f"{called}: given {rate:g} Hz; allowed: whole fractions of the frame rate, as {frame_rate:g}, "
        f"{frame_rate / 2:g} or {frame_rate / 5:g} Hz, and 0 for every frame"
    )
