"""Detection of a drive that moves otherwise than that of the twin, as in an emergency stop of the plant alone."""

from __future__ import annotations

from collections import deque

import numpy as np

SPAN = 1.0  # s, over which speeds are compared, and half of which is enough
UNLIKE, CALMS = 0.15, 10.0  # m/s between drives of plant and twin, and s after it, until forces are alike again


class UnlikeMotion:
    """Detector of drives whose speed is not that of the twin, by the places that their encoders measure."""

    def __init__(self) -> None:
        self._places: dict[str, deque[tuple[float, float, float]]] = {}  # time, place, speed of the twin, by encoder
        self._until = -np.inf  # s

    def clear(self) -> None:
        """Forget all measured places, as at a restart."""
        self._places.clear()

    def note(self, time: float, sensor: str, place: float, speed: float) -> bool:
        """Add the place (m) of an encoder at a time (s), and the twin's speed (m/s) of that drive; True if unlike."""
        places = self._places.setdefault(sensor, deque())
        places.append((time, place, speed))
        while time - places[0][0] > SPAN:
            places.popleft()
        lasted = time - places[0][0]
        if lasted <= 0.5 * SPAN:
            return False
        unlike = abs((place - places[0][1]) / lasted - float(np.mean([twin for *_, twin in places]))) > UNLIKE
        if unlike:
            self._until = time + CALMS
        return unlike

    def lasts(self, time: float) -> bool:
        """Whether forces are those of another motion than the twin's, or of the waves behind it, at a time (s)."""
        return time < self._until
