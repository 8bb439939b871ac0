"""Clock of a run: time of day of a simulated time, and its lag behind the present time.

Stamps are the epoch plus simulated time. The epoch is taken when time starts to run, so that at real_time_factor 1 a
stamp is the time of day at which its frame is due. It never changes in a run: a log gives simulated times back by it,
and no stamp ever goes back. What moves stamps away from the clock is told: a pause, and a clock that somebody sets.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from cable_twin.messages import SECOND, nanoseconds

SET = 0.02  # s by which the time of day has moved against the steady clock: it was set, not slewed


class RunClock:
    """Clock that gives the time stamps of a run.

    Args:
        time_of_day: ns since 1970.
        steady: ns of a clock that nobody sets, slewed as the other one.
    """

    def __init__(
        self, time_of_day: Callable[[], int] = time.time_ns, steady: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.epoch_ns: int | None = None  # until time starts to run
        self._time_of_day, self._steady = time_of_day, steady
        self._apart = 0

    def begin(self, simulated_time: float) -> int:
        """Begin the run now, at a simulated time (s); returns the epoch in ns."""
        now = self._time_of_day()
        self._apart = now - self._steady()
        self.epoch_ns = now - nanoseconds(simulated_time)
        return self.epoch_ns

    def stamp_ns(self, simulated_time: float) -> int:
        """Stamp (ns) of a simulated time (s); before the run begins, the time of day."""
        return self._time_of_day() if self.epoch_ns is None else self.epoch_ns + nanoseconds(simulated_time)

    def behind(self, simulated_time: float) -> float:
        """Lag (s) of a time stamp behind the time of day, negative where ahead."""
        return (self._time_of_day() - self.stamp_ns(simulated_time)) / SECOND

    def take_setting(self) -> float | None:
        """Step (s) of the time of day since the last call, forward positive; None without a step."""
        apart = self._time_of_day() - self._steady()
        moved = (apart - self._apart) / SECOND
        if self.epoch_ns is None or abs(moved) < SET:
            return None
        self._apart = apart
        return moved
