"""Commands from topics: each applied and recorded as a whole, or refused as a whole, counted and reported."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from cable_twin.basics.printable import printable
from cable_twin.frame.records import CommandError
from cable_twin.messages import SECOND as NANOSECONDS
from cable_twin.messages import stamp_in
from cable_twin.messages.command_messages import command_from_message
from cable_twin.runtime.frame_loop import FrameLoop

WARNING_PERIOD = 5.0  # s between two log warnings about refused commands
MESSAGE_PERIOD = 0.05  # s between two messages about refused commands on their topic
LONGEST_REASON = 400  # characters
SECOND = 1.0  # s over which commands are counted


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Limits beyond which commands from topics are refused.

    Attributes:
        size: size (bytes) of a message, checked before it is decoded.
        rate: commands per second of all topics together, while simulated time runs.
        names: number of names in a message.
        age: difference (s) of a stamp from that of the newest frame; 0 to ignore stamps.
    """

    size: int
    rate: int
    names: int
    age: float = 0.0


class CommandSubscriber:
    """Subscriber to the command topics of a twin.

    Args:
        loop: frame loop, which applies commands.
        limits: limits that are checked before a command is passed to the loop.
        counts: counts of the diagnostics, of which `commands_refused` is updated.
        logger: logger of the node.
        full_name: returns the full, remapped name of a topic.
        now_ns: returns the stamp (ns) of the newest frame.
        record: called with the topic and the bytes of each applied command.
        report_refused: called with the topic, the reason in a line, and the number of refused commands so far, at most
            once in `MESSAGE_PERIOD`.
        clock: returns the time (s) of a steady clock.
    """

    def __init__(
        self,
        loop: FrameLoop,
        limits: CommandLimits,
        counts: dict[str, int],
        logger: Any,
        full_name: Callable[[str], str],
        now_ns: Callable[[], int],
        record: Callable[[str, bytes], None],
        report_refused: Callable[[str, str, int], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._loop, self._limits, self._counts, self._logger = loop, limits, counts, logger
        self._full_name, self._now_ns = full_name, now_ns
        self._record, self._report_refused, self._clock = record, report_refused, clock
        self._warned = self._reported = self._second = -math.inf  # s: last warning, last message, begin of the count
        self._accepted = 0  # commands since then

    def take(self, topic: str, data: bytes) -> None:
        """Submit the command in a message of a command topic to the frame loop, or refuse the message."""
        try:
            if len(data) > self._limits.size:
                raise CommandError(f"message: given {len(data)} bytes; allowed: up to {self._limits.size} bytes")
            command = command_from_message(topic, data, self._limits.names)
            self._check_age(stamp_in(data))
            self._count()
        except CommandError as error:
            self._refuse(topic, error)
            return
        self._loop.submit(command, topic).add_done_callback(partial(self._on_applied, topic, data))

    def _check_age(self, stamp_ns: int) -> None:
        """Refuse a command whose stamp (ns) is too far from the newest frame; a stamp of 0 is accepted."""
        most, age = self._limits.age, (self._now_ns() - stamp_ns) / NANOSECONDS
        if most > 0.0 and stamp_ns != 0 and abs(age) > most:
            when = "older" if age > 0.0 else "later"
            raise CommandError(
                f"stamp: given {abs(age):.6g} s {when} than the newest frame; allowed: up to {most:g} s "
                "(command_max_age), or a stamp of 0"
            )

    def _count(self) -> None:
        """Refuse commands beyond the rate limit while time runs; commands refused by earlier checks do not count."""
        if self._loop.paused:
            return  # in lockstep the controller sets the pace
        now = self._clock()
        if now - self._second >= SECOND:
            self._second, self._accepted = now, 0
        self._accepted += 1
        if self._accepted > self._limits.rate:
            raise CommandError(f"commands: given {self._accepted} in a second; allowed: up to {self._limits.rate}")

    def _on_applied(self, topic: str, data: bytes, future: Any) -> None:
        if future.cancelled():
            return
        if (error := future.exception()) is not None:
            self._refuse(topic, error)
        else:
            self._record(topic, data)

    def _refuse(self, topic: str, error: BaseException) -> None:
        self._counts["commands_refused"] += 1
        now, count, reason = self._clock(), self._counts["commands_refused"], printable(error, LONGEST_REASON)
        if now - self._reported >= MESSAGE_PERIOD:
            self._reported = now
            self._report_refused(topic, reason, count)
        if now - self._warned >= WARNING_PERIOD:
            self._warned = now
            self._logger.warning(
                f"{self._full_name(topic)}: command refused, the previous one stays in force: {reason} "
                f"({count} refused so far)"
            )
