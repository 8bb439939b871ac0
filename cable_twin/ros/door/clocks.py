"""Offsets of other clocks from this computer's: by round trips, as in NTP, or one way by the quickest message."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from cable_twin.basics.units import rounded
from cable_twin.messages import SECOND
from cable_twin.ros.door.samples import Tell

SPAN = 60 * SECOND  # ns in which the best measurement counts
CHANGED = SECOND // 10  # ns by which an offset has to change until it is said again
SELDOM = 60.0  # s between two lines about delays that change
STEADY = 2  # answers in a row that differ from those before, of a clock that is renewed at each question
DELAY = SECOND  # ns below which what is known one way only is taken for a delay


class RoundTrips:
    """Offset of a server's clock from this computer's clock, measured by round trips of time requests, as in NTP.

    Some servers renew their time only once a second. An answer counts where it differs from the answer before, so that
    the time was renewed in between, and half of that interval is the uncertainty. A clock of which three answers in a
    row differ is renewed at each question.
    """

    def __init__(self) -> None:
        self._trips: deque[tuple[int, int, int]] = deque()  # time, offset, half of the interval, ns
        self._before: tuple[int, int] | None = None  # sent, theirs, of the last question
        self._steps = 0  # answers in a row that differed

    def begin(self) -> None:
        """Begin a series of time requests to the other clock."""
        self._before, self._steps = None, 0

    def add(self, sent_ns: int, theirs_ns: int, received_ns: int) -> bool:
        """Add a time request by local send and receive times and the server's time, ns; returns whether it was used."""
        before, self._before = self._before, (sent_ns, theirs_ns)
        if before is None:
            return False
        self._steps = self._steps + 1 if theirs_ns != before[1] else 0
        if not self._steps:
            return False
        first = sent_ns if self._steps >= STEADY else before[0]
        half = max((received_ns - first) // 2, 0)
        offset = theirs_ns - (first + half)
        best = self.best
        if best is not None and abs(offset - best[0]) > half + best[1] + CHANGED:
            self._trips.clear()  # somebody has set that clock
        self._trips.append((received_ns, offset, half))
        while self._trips and received_ns - self._trips[0][0] > SPAN:
            self._trips.popleft()
        return True

    @property
    def best(self) -> tuple[int, int] | None:
        """Offset (other clock minus ours) and its uncertainty, ns; None without any round trip."""
        if not self._trips:
            return None
        _, offset, half = min(self._trips, key=lambda trip: trip[2])
        return offset, half


class OneWay:
    """Offset of another clock by the stamps of its messages, with the delay of the quickest message taken as zero."""

    def __init__(self) -> None:
        self._delays: deque[tuple[int, int]] = deque()  # receipt, delay; of rising delays, ns

    def add(self, stamp_ns: int, receipt_ns: int) -> None:
        """Add a message by its stamp and the time of its receipt, ns."""
        delay = receipt_ns - stamp_ns
        while self._delays and self._delays[-1][1] >= delay:
            self._delays.pop()
        self._delays.append((receipt_ns, delay))
        while receipt_ns - self._delays[0][0] > SPAN:
            self._delays.popleft()

    @property
    def best(self) -> int | None:
        """Offset (other clock minus ours), ns, with the shortest delay as zero; None without any message."""
        return -self._delays[0][1] if self._delays else None


class Correction:
    """Correction of stamps by the offset of another clock, which is logged at first and whenever it has changed.

    Args:
        whose: name of the clock, in words.
        tell: takes lines.
        correct: whether stamps are shifted, or taken as they are.
        tolerance_ns: offset from which on stamps are shifted.
        clock: gives time in s.
    """

    def __init__(
        self,
        whose: str,
        tell: Tell,
        *,
        correct: bool,
        tolerance_ns: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._whose, self._tell, self._correct, self._tolerance = whose, tell, correct, tolerance_ns
        self.offset_ns = 0  # theirs minus ours
        self.uncertainty_ns: int | None = None
        self._said: int | None = None
        self._said_uncertainty = 0
        self._said_at, self._said_shifts, self._time = 0.0, False, clock
        self._shifts = False

    def update(self, offset_ns: int, uncertainty_ns: int | None = None) -> None:
        """Set the offset of the other clock, with its uncertainty where it was measured by round trips."""
        self.offset_ns, self.uncertainty_ns = offset_ns, uncertainty_ns
        edge = self._tolerance // 2 if self._shifts else self._tolerance
        self._shifts = self._correct and abs(offset_ns) >= max(edge, uncertainty_ns or 0)
        edge = max(CHANGED, 2 * (uncertainty_ns or 0) + self._said_uncertainty)
        now = self._time()
        drifts = uncertainty_ns is None and self._said_shifts == self._shifts and now - self._said_at < SELDOM
        if self._said is None or (abs(offset_ns - self._said) >= edge and not drifts):
            self._said_at, self._said_shifts = now, self._shifts
            self._say()

    @property
    def shift_ns(self) -> int:
        """Time to subtract from the other clock's stamps, ns."""
        return self.offset_ns if self._shifts else 0

    def _say(self) -> None:
        changed, self._said = self._said is not None, self.offset_ns
        self._said_uncertainty = self.uncertainty_ns or 0
        size, one_way = abs(self.offset_ns) / SECOND, self.uncertainty_ns is None
        notable = abs(self.offset_ns) >= (DELAY if one_way else CHANGED)
        if one_way and not notable and not changed:
            return  # a delay, and no offset as far as can be told
        shown = f"{rounded(size * 1e3, 3)} ms" if size < 1.0 else f"{rounded(size, 7)} s"
        way = "ahead of" if self.offset_ns > 0 else "behind"
        known = "" if self.uncertainty_ns is None else f" (+-{rounded(self.uncertainty_ns / 1e6, 2)} ms)"
        late = ", or its messages are late," if one_way and self.offset_ns < 0 else ""
        done = "stamps are shifted by that" if self.shift_ns else "stamps are taken as they are"
        if not one_way and abs(self.offset_ns) < self._said_uncertainty:
            agrees = f"{self._whose} agrees with ours to {rounded(self._said_uncertainty / 1e6, 2)} ms"
            self._tell("info", f"{agrees}; stamps are taken as they are")
            return
        text = f"{self._whose} is {'now ' if changed else ''}{shown} {way} ours{known}{late}; {done}"
        self._tell("warning" if notable else "info", text.replace(",;", ";"))
