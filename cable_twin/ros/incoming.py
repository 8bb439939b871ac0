"""Commands from topics: applied whole and recorded unchanged, or refused whole, counted and named."""

from __future__ import annotations

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

WARNING_PERIOD = 5.0  # s between two warnings of refused commands
TELLING_PERIOD = 0.05  # s between two of them that are told on their topic
LONGEST_REASON = 400  # characters
SECOND = 1.0  # s over which commands are counted


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Limits of accepted commands from topics.

    Attributes:
        size: bytes of a message; what is larger is not decoded.
        rate: commands in a second while time runs, all topics together; what comes beyond is refused.
        names: in one message; there are no more joints.
        age: s by which a stamp may differ from that of the newest frame; 0 where stamps do not count.
    """

    size: int
    rate: int
    names: int
    age: float = 0.0


class Incoming:
    """Subscriber to the command topics of a twin.

    Args:
        loop: that carries commands out.
        limits: beyond which commands are refused before the loop hears of them.
        counts: of the diagnostics, which has `commands_refused`.
        logger: of the node.
        full_name: of a topic, as it is remapped.
        now_ns: stamp (ns) of the newest frame.
        record: is given each message that took effect, with its topic; nothing of what is refused, which may be large.
        tell_refused: is given the topic, the reason in a line, and how many commands were refused so far; as often as
            `TELLING_PERIOD` allows.
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
        tell_refused: Callable[[str, str, int], None],
    ) -> None:
        self._loop, self._limits, self._counts, self._logger = loop, limits, counts, logger
        self._full_name, self._now_ns = full_name, now_ns
        self._record, self._tell_refused = record, tell_refused
        self._warned = -WARNING_PERIOD  # s, when a refused command was last named
        self._told = -TELLING_PERIOD  # s, when one was last told on the topic
        self._second, self._taken = -SECOND, 0  # s, since when commands are counted, and how many there were

    def take(self, topic: str, data: bytes) -> None:
        """Accept or refuse a message of a topic of `INPUTS`."""
        try:
            if len(data) > self._limits.size:
                raise CommandError(f"a message of {len(data)} bytes; allowed: up to {self._limits.size} bytes")
            command = command_from_message(topic, data, self._limits.names)
            self._check_age(stamp_in(data))
            self._count()
        except CommandError as error:
            self._refuse(topic, error)
            return
        self._loop.submit(command, topic).add_done_callback(partial(self._on_obeyed, topic, data))

    def _check_age(self, stamp_ns: int) -> None:
        """Refuse a stamp (ns) too far from the newest frame; a stamp of 0 is accepted."""
        most, age = self._limits.age, (self._now_ns() - stamp_ns) / NANOSECONDS
        if most > 0.0 and stamp_ns != 0 and abs(age) > most:
            when = "older" if age > 0.0 else "later"
            raise CommandError(
                f"stamp {abs(age):.6g} s {when} than the newest frame; allowed: up to {most:g} s (command_max_age), or "
                "a stamp of 0"
            )

    def _count(self) -> None:
        """Refuse commands beyond the rate limit while time runs; commands refused by earlier checks do not count."""
        if self._loop.paused:
            return  # in lockstep a controller goes as fast as the frames, and holds up nobody
        now = time.monotonic()
        if now - self._second >= SECOND:
            self._second, self._taken = now, 0
        self._taken += 1
        if self._taken > self._limits.rate:
            raise CommandError(f"more commands than {self._limits.rate} a second")

    def _on_obeyed(self, topic: str, data: bytes, future: Any) -> None:
        if future.cancelled():
            return
        if (error := future.exception()) is not None:
            self._refuse(topic, error)
        else:
            self._record(topic, data)

    def _refuse(self, topic: str, error: BaseException) -> None:
        self._counts["commands_refused"] += 1
        now, count, reason = time.monotonic(), self._counts["commands_refused"], printable(error, LONGEST_REASON)
        if now - self._told >= TELLING_PERIOD:
            self._told = now
            self._tell_refused(topic, reason, count)
        if now - self._warned >= WARNING_PERIOD:
            self._warned = now
            self._logger.warning(
                f"{self._full_name(topic)}: command refused, the previous one stays in force: {reason} "
                f"({count} refused so far)"
            )


__all__ = ["CommandLimits", "Incoming"]
