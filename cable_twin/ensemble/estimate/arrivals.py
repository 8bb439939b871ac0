"""Queue of measurements and commands from a live plant, sorted by time stamps; rejected measurements are logged."""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from itertools import count
from math import isfinite

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.sensors import Measurement

HORIZON = 0.5  # s, for which late measurements are waited for
FUTURE = 0.5  # s, by which a stamp may be ahead of the earliest way here
OTHER_CLOCK = 30.0  # s between two clocks, from which on they are told apart
REMEMBERED = 3.0  # s, over which the earliest way here is looked for: a plant may be slower than its clock
RESET = 50  # measurements one after the other with another clock, after which it counts as that of the plant
Item = AppliedCommand | Measurement


class Arrivals:
    """Queue of measurements and commands of a live plant, in the order of their time stamps.

    Times are those of the plant's stamps, in s from its first stamp on.

    Attributes:
        left_out: number of rejected measurements, by reason.
        notes: lines about the first rejection for each reason, and about jumps of the plant's clock.
    """

    def __init__(self) -> None:
        self.left_out: Counter[str] = Counter()
        self.notes: list[str] = []
        self._waiting: list[tuple[float, int, int, Item]] = []
        self._number, self._done = count(), -float("inf")
        self._offsets: deque[tuple[float, float]] = deque()  # arrivals (s), and our clock less that of the plant (s)
        self._elsewhere: list[float] = []  # s, offsets of measurements one after the other with another clock
        self.newest = -float("inf")  # s, stamp of the newest measurement
        self.last = -float("inf")  # s by our clock, arrival of the last one

    @property
    def started(self) -> bool:
        """Whether any measurement of the plant has arrived."""
        return bool(self._offsets)

    def now(self, arrival: float) -> float:
        """Time (s) of the plant's clock at a time (s) of this computer's clock."""
        return arrival - min((offset for _, offset in self._offsets), default=0.0)

    def put(self, measurements: Sequence[Measurement], arrival: float) -> list[Measurement]:
        """Accept measurements that arrive at a time (s) of this computer's clock; returns those not left out."""
        taken = []
        for one in measurements:
            if not all(map(isfinite, one.values)):
                self._leave_out(one, "not finite")
            elif self._is_of_the_clock(one, arrival):
                if one.time < self._done:
                    self._leave_out(one, "too late to be put in order")
                else:
                    self.newest, self.last = max(self.newest, one.time), arrival
                    heapq.heappush(self._waiting, (one.time, 1, next(self._number), one))
                    taken.append(one)
        return taken

    def command(self, applied: AppliedCommand) -> None:
        """Queue a command of the plant by its time (s) of the plant's clock."""
        heapq.heappush(self._waiting, (max(applied.time, self._done), 0, next(self._number), applied))

    def due(self, arrival: float) -> Iterator[Item]:
        """Yield the items older than the waiting time for late measurements, sorted by time."""
        until = self.now(arrival) - HORIZON
        while self._waiting and self._waiting[0][0] <= until:
            self._done = self._waiting[0][0]
            yield heapq.heappop(self._waiting)[-1]

    def drop(self, until: float) -> None:
        """Forget waiting items up to a time (s) of the plant's clock."""
        self._waiting = [one for one in self._waiting if one[0] > until]
        heapq.heapify(self._waiting)
        self._done = max(self._done, until)

    def leave_out(self, what: str, reason: str) -> None:
        """Count a rejected item by its reason, and add a line to log for the first item of each reason."""
        if not self.left_out[reason]:
            self.notes.append(f"left out: {what}: {reason}")
        self.left_out[reason] += 1

    def _leave_out(self, one: Measurement, reason: str) -> None:
        self.leave_out(f"{one.sensor} at {one.time:.3f} s", reason)

    def _is_of_the_clock(self, one: Measurement, arrival: float) -> bool:
        """Whether a measurement's time stamp fits the plant's clock, which is reset after a lasting jump of stamps."""
        offset = arrival - one.time
        delay = self.now(arrival) - one.time
        if not self.started or -FUTURE <= delay <= OTHER_CLOCK:
            self._elsewhere = []
            self._offsets.append((arrival, offset))
            while arrival - self._offsets[0][0] > REMEMBERED:
                self._offsets.popleft()
            return True
        self._elsewhere.append(offset)
        if len(self._elsewhere) >= RESET and max(self._elsewhere) - min(self._elsewhere) < 1.0:
            why = ", or messages no longer come late" if delay < 0.0 else ""
            self.notes.append(f"stamps of the plant jumped by {-delay:.3f} s{why}: it is followed by its new clock")
            self._offsets = deque([(arrival, min(self._elsewhere))])
            self._elsewhere = []
            self._waiting.clear()
            self._done, self.newest = -float("inf"), one.time
            return True
        self._leave_out(one, "a stamp from the future" if delay < 0.0 else f"a stamp more than {OTHER_CLOCK:g} s old")
        return False
