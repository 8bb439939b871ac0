"""Detection of leaps of an encoder: places at which its vehicle cannot have arrived since the sample before."""

from __future__ import annotations

from collections import deque

FASTEST = 3.0  # m/s^2, more than any vehicle accelerates or brakes by
LEAST, NOISES = 0.3, 10.0  # m, and standard deviations of a sample, by which a place is beyond that at least
HELD = 20  # samples one after the other elsewhere, after which the encoder is followed there


class Leaps:
    """Detector of leaps of one encoder, by its last two places where it was expected.

    Args:
        noise: standard deviation of a sample, m.
    """

    def __init__(self, noise: float = 0.0) -> None:
        self._least = max(LEAST, NOISES * noise)
        self._kept: deque[tuple[float, float]] = deque(maxlen=2)  # s and m
        self._elsewhere = 0  # samples one after the other

    def clear(self) -> None:
        """Forget the last places, as after a gap."""
        self._kept.clear()
        self._elsewhere = 0

    def note(self, time: float, place: float) -> float:
        """Distance (m) of a sample at a time (s) from where its vehicle may be; 0 where it may be there."""
        if len(self._kept) == 2 and self._elsewhere < HELD:
            (first, start), (last, end) = self._kept
            since, between = time - last, max(last - first, 1e-3)
            away = place - end - (end - start) / between * since
            if abs(away) > self._least + 0.5 * FASTEST * since * (since + between):
                self._elsewhere += 1
                return away
        elif self._elsewhere:
            self.clear()
        self._elsewhere = 0
        if not self._kept or time > self._kept[-1][0]:
            self._kept.append((time, place))
        return 0.0
