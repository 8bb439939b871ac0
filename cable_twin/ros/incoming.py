"""Commands that come on topics: each is recorded as it came, then applied whole or refused whole, and told."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from cable_twin.command_messages import command_from_message
from cable_twin.records import CommandError
from cable_twin.ros.frame_loop import FrameLoop

WARNING_PERIOD = 1.0  # s between two warnings of refused commands


class Incoming:
    """Takes what comes for a twin.

    Args:
        loop: that carries commands out.
        counts: of the diagnostics, which has `commands_refused`.
        logger: of the node.
        full_name: of a topic, as it is remapped.
        record: is given each message with its topic, before anything comes of it.
    """

    def __init__(
        self,
        loop: FrameLoop,
        counts: dict[str, int],
        logger: Any,
        full_name: Callable[[str], str],
        record: Callable[[str, bytes], None],
    ) -> None:
        self._loop, self._counts, self._logger = loop, counts, logger
        self._full_name, self._record = full_name, record
        self._warned = -WARNING_PERIOD  # s, when a refused command was last named

    def take(self, topic: str, data: bytes) -> None:
        """A message of a topic of `INPUTS`."""
        self._record(topic, data)
        try:
            command = command_from_message(topic, data)
        except CommandError as error:
            self._refuse(topic, error)
            return
        self._loop.submit(command, topic).add_done_callback(partial(self._on_obeyed, topic))

    def _on_obeyed(self, topic: str, future: Any) -> None:
        if not future.cancelled() and future.exception() is not None:
            self._refuse(topic, future.exception())

    def _refuse(self, topic: str, error: BaseException) -> None:
        self._counts["commands_refused"] += 1
        now = time.monotonic()
        if now - self._warned >= WARNING_PERIOD:
            self._warned = now
            self._logger.warning(
                f"{self._full_name(topic)}: command refused, "
                f"the last good one stays: {error} ({self._counts['commands_refused']} refused so far)"
            )


__all__ = ["Incoming"]
