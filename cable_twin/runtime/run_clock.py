"""Clocks of a run: the steady clock that paces frames, and time stamps as time of day of a simulated time.

Stamps are the epoch plus simulated time. The epoch is taken when time starts to run, so that at real_time_factor 1 a
stamp is the time of day at which its frame is due. It never changes in a run: a log gives simulated times back by it,
and no stamp ever goes back. A pause, or somebody who sets the clock, moves stamps away from the clock; the node's log
reports both.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from cable_twin.messages import SECOND, nanoseconds

SET = 0.02  # s by which the time of day has moved against the steady clock: it was set, not slewed
SHORT = 0.05  # s before a deadline in which a wait is no longer interrupted


class SteadyClock:
    """Monotonic clock, unaffected by settings of the time of day, with waits for deadlines."""

    def now(self) -> float:
        """Present time (s) on the steady clock."""
        return time.monotonic()

    def wait_until(self, due: float, interrupt: threading.Event) -> None:
        """Wait until a time (s) on the clock, or until the interrupt is set."""
        remaining = due - self.now()
        if remaining > SHORT:
            interrupt.wait(min(remaining - SHORT, threading.TIMEOUT_MAX))
            remaining = due - self.now()
        if remaining > 0.0 and not interrupt.is_set():
            time.sleep(remaining)  # wakes more exactly than an event, which takes a lock and gives it back


class RunClock:
    """Clock that gives the time stamps of a run.

    Args:
        time_of_day: returns ns since 1970.
        steady: returns ns of a clock that nobody sets, slewed as the time of day is.
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
        """Jump (s) of the time of day since the last call, such as a setting of the clock; None without a jump."""
        apart = self._time_of_day() - self._steady()
        moved = (apart - self._apart) / SECOND
        if self.epoch_ns is None or abs(moved) < SET:
            return None
        self._apart = apart
        return moved
