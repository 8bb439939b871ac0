"""Executor for the callbacks of a node, the cheaper events executor where rclpy has one, and waiting in a callback."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Generator
from concurrent.futures import Future
from typing import Any

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor

TURN = 0.005  # s for which a callback that waits holds the others up


def new_executor(context: Context | None = None) -> Executor:
    """Executor of one thread, by default for the context of `rclpy.init`.

    rclpy's executor of events is in C++ and waits for no set of entities that is built anew for each message. Where it
    is not there, or cannot work with the middleware, the one that every rclpy has takes its place.
    """
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415 - from Jazzy on

        return EventsExecutor(context=context)
    except Exception:  # whatever its library or the middleware lacks: the other one works with each
        return SingleThreadedExecutor(context=context)


async def done(future: Future[Any], *, turn: float = TURN, within: float = math.inf) -> None:
    """Wait in a callback of a node for another thread, while the executor calls others between two turns.

    Args:
        future: of the other thread.
        turn: s for which others are held up at a time.
        within: s after which it returns in any case.

    rclpy resumes a callback that waits for a future of its own again and again, as fast as it can: that took as much of
    a core as the solver, and the interpreter from it.
    """
    ended = threading.Event()
    future.add_done_callback(lambda _: ended.set())
    until = time.monotonic() + within
    while not ended.wait(turn) and time.monotonic() < until:
        await _Turn()


class _Turn:
    """Awaitable that lets other callbacks run once."""

    def __await__(self) -> Generator[None, None, None]:
        yield


__all__ = ["done", "new_executor"]
