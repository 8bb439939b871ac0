"""What calls the node's callbacks: the executor of events where this rclpy has one, which costs less; waiting in it."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future as RosFuture


def new_executor(context: Context | None = None) -> Executor:
    """An executor of one thread, by default for the context of `rclpy.init`.

    rclpy's executor of events is in C++ and waits for no set of entities that is built anew for each message. Where it
    is not there, or cannot work with the middleware, the one that every rclpy has takes its place.
    """
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415 - from Jazzy on

        return EventsExecutor(context=context)
    except Exception:  # whatever its library or the middleware lacks: the other one works with each
        return SingleThreadedExecutor(context=context)


async def done(future: Future[Any], node: Node) -> None:
    """Wait in a callback of a node until another thread is done, while the executor calls others."""
    waiting: RosFuture[None] = RosFuture()

    def wake(_: Future[Any]) -> None:
        waiting.set_result(None)
        if node.executor is not None:
            node.executor.wake()

    future.add_done_callback(wake)
    await waiting


__all__ = ["done", "new_executor"]
