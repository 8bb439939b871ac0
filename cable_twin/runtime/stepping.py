"""Requested frames of a paused twin."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field


@dataclass(slots=True)
class Stepping:
    """Requested number of frames while paused, with its progress."""

    count: int
    on_frame: Callable[[int], bool] | None = None  # gets how many there were, says whether to go on
    taken: int = 0
    future: Future[int] = field(default_factory=Future)

    def took(self, took: bool) -> bool:
        """Record a computed or failed frame; returns whether the request is finished."""
        self.taken += took
        on = took and (self.on_frame is None or self.on_frame(self.taken))
        if on and self.taken < self.count:
            return False
        if self.future.set_running_or_notify_cancel():
            self.future.set_result(self.taken)
        return True


__all__ = ["Stepping"]
